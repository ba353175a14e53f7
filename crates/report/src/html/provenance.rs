//! Where the numbers come from.

use rig_chart::Escaped;
use rig_record::{ChainCheck, Run, RunStarted, Source};

use super::element::add;
use crate::data::RunData;

/// Everything needed to judge the run and to repeat it.
pub(crate) fn provenance(run: &Run, check: &ChainCheck, data: &RunData) -> String {
    let mut html = String::from("<dl class=\"facts\">\n");
    let mut fact = |name: &str, value: &str| {
        let (name, value) = (Escaped(name), Escaped(value));
        add(&mut html, format_args!("<div><dt>{name}</dt><dd>{value}</dd></div>\n"));
    };
    fact("run", &run.id.to_string());
    fact("began", &run.started_at);
    fact("ended", run.finished_at.as_deref().unwrap_or("not yet"));
    if let Some(started) = &data.started {
        fact("program", &started.software);
        fact("seed", &started.seed.to_string());
        for device in &started.devices {
            fact(&device.role, &device.identity);
        }
    }
    match check {
        ChainCheck::Intact { records, digest } => {
            fact("journal", &format!("{records} records, chain intact"));
            fact("digest", &digest.to_string());
        }
        ChainCheck::Broken { seq, flaw } => {
            fact("journal", &format!("damaged at record {seq}: {flaw}"));
        }
    }
    html.push_str("</dl>\n");
    if let Some(started) = &data.started {
        html.push_str(&sources(started));
    }
    html
}

/// The files as they were read when the run began.
fn sources(started: &RunStarted) -> String {
    let RunStarted { protocol, rig, scene, .. } = started;
    let files = [("Protocol", Some(protocol)), ("Rig", Some(rig)), ("Scene", scene.as_ref())];
    let mut html = String::new();
    for (what, source) in files {
        let Some(Source { name, toml }) = source else { continue };
        let (name, toml) = (Escaped(name), Escaped(toml));
        add(
            &mut html,
            format_args!(
                "<details><summary>{what} “{name}”</summary>\n<pre tabindex=\"0\">{toml}</pre>\n\
                 </details>\n"
            ),
        );
    }
    html
}
