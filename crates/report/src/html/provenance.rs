//! The origin of the numbers.

use maud::{Markup, Render, html};
use rig_record::{ChainCheck, Run, RunStarted, Source};

use super::RunVerdict;
use crate::data::RunData;

/// Everything needed to judge the run and to repeat it.
pub(super) fn provenance(
    run: &Run,
    check: &ChainCheck,
    verdict: &RunVerdict,
    data: &RunData,
) -> Markup {
    html! {
        dl.facts {
            (fact("run", run.id.to_string()))
            (fact("began", &run.started_at))
            (fact("ended", run.finished_at.as_deref().unwrap_or("not yet")))
            @if let Some(started) = &data.started {
                (fact("program", &started.software))
                (fact("seed", started.seed))
                @for device in &started.devices { (fact(&device.role, &device.identity)) }
            }
            (fact("sealed", if run.is_sealed { "yes" } else { "no: it can be resumed" }))
            @match check {
                ChainCheck::Intact { records, digest } => {
                    (fact("journal", format!("{records} records, chain intact")))
                    (fact("digest", digest.to_string()))
                }
                ChainCheck::Broken { seq, flaw } => {
                    (fact("journal", format!("damaged at record {seq}: {flaw}")))
                }
            }
            (fact("checked", &verdict.sentence))
        }
        @if let Some(started) = &data.started { (sources(started)) }
    }
}

fn fact(name: &str, value: impl Render) -> Markup {
    html! { div { dt { (name) } dd { (value) } } }
}

/// The files as they were read when the run began.
fn sources(started: &RunStarted) -> Markup {
    let RunStarted { protocol, rig, scene, .. } = started;
    let files = [("Protocol", Some(protocol)), ("Rig", Some(rig)), ("Scene", scene.as_ref())];
    html! {
        @for (kind, source) in files {
            @if let Some(Source { name, toml }) = source {
                details {
                    summary { (kind) " “" (name) "”" }
                    pre tabindex="0" { (toml) }
                }
            }
        }
    }
}
