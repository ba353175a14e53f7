//! The origin of the numbers.

use maud::{Markup, Render, html};
use rig_record::{ChainCheck, CitedCalibration, Run, RunStarted, Source};

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
            (fact("name", run.short_name()))
            @if let Some(operator) = data.operator() { (fact("operator", operator)) }
            (fact("began", &run.started_at))
            (fact("ended", run.finished_at.as_deref().unwrap_or("not yet")))
            @if let Some(started) = &data.started {
                (fact("program", &started.software))
                (fact("seed", started.seed))
                @for device in &started.devices { (fact(&device.role, &device.identity)) }
                @for calibration in &started.calibrations { (cited(calibration)) }
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
        @if let Some(started) = &data.started {
            (settings(&started.protocol.toml))
            (sources(started))
        }
    }
}

/// The sections of a protocol that say how a touch is made and measured.
const SECTIONS: [(&str, &str); 4] = [
    ("touch", "touch"),
    ("approach", "search for the surface"),
    ("no_load_sweep", "no-load sweep"),
    ("contact_sweep", "sweep in contact"),
];

/// The settings of the instruments, from the protocol.
fn settings(protocol_toml: &str) -> Markup {
    html! {
        dl.facts.settings {
            @for (section, name) in SECTIONS {
                @let keys = keys_of(protocol_toml, section);
                @if !keys.is_empty() { (fact(name, keys.join(", "))) }
            }
        }
    }
}

/// The settings `key = value` of a table of a protocol, which was read before.
fn keys_of(toml: &str, table: &str) -> Vec<String> {
    let all: toml::Table = toml.parse().unwrap_or_default();
    let keys = all.get(table).and_then(toml::Value::as_table);
    let settings = keys.into_iter().flatten().map(|(key, value)| format!("{key} = {value}"));
    settings.collect()
}

/// A calibration of the bench, its last daily check with the verdict, or a correction of the analyzer. Its file is found by the beginning of its digest.
fn cited(calibration: &CitedCalibration) -> Markup {
    let CitedCalibration { kind, made, person, sha256, verdict, cable, .. } = calibration;
    let digest = sha256.get(..12).unwrap_or(sha256);
    let told = format!("{made}, {person}, SHA-256 {digest}…");
    match (verdict, cable) {
        (Some(verdict), _) => fact("daily check", format!("{verdict}, {told}")),
        (None, Some(cable)) => fact(&format!("correction: {kind}"), format!("{cable}, {told}")),
        (None, None) => fact(&format!("calibration: {kind}"), told),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_found_however_a_protocol_is_written() {
        let toml = "contact_sweep = { max_hz = 205.0 }\n[touch] # how deep\nindentations_mm = [\n 0.1,\n 0.2,\n]\n\
                    [ approach ]\n\"step_mm\" = 0.05 # small\n";
        assert_eq!(keys_of(toml, "touch"), ["indentations_mm = [0.1, 0.2]"]);
        assert_eq!(keys_of(toml, "approach"), ["step_mm = 0.05"]);
        assert_eq!(keys_of(toml, "contact_sweep"), ["max_hz = 205.0"]);
        assert!(keys_of(toml, "no_load_sweep").is_empty());
    }
}
