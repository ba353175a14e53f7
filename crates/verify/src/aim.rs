//! The aim of a protocol: the settings that the file leaves out are those that the run says it has chosen.

use crate::{
    finding::{Check, Findings},
    record::Aim,
    settings::Protocol,
};

/// Takes what the file leaves out from the first record of the run.
pub(crate) fn complete(protocol: &mut Protocol, recorded: Option<&Aim>) {
    let Some(Aim { settings, .. }) = recorded.filter(|_| protocol.aim.is_some()) else { return };
    protocol.approach.fine_step_mm.get_or_insert(settings.fine_step_mm);
    protocol.no_load_sweep.target_sigma_hz.get_or_insert(settings.no_load_sigma_hz);
    protocol.contact_sweep.target_sigma_hz.get_or_insert(settings.contact_sigma_hz);
    protocol.no_load.get_or_insert_with(|| settings.no_load.clone());
}

/// Checks that the aim is that of the file, that its settings are those that the file states, and that the run
/// expected to reach it.
pub(crate) fn check(
    protocol: &Protocol,
    recorded: Option<&Aim>,
    record: u64,
    findings: &mut Findings,
) {
    let mut differ = |what: &str, expected: String, found: String| {
        if expected != found {
            findings.add(Check::Plan, record, what, expected, found);
        }
    };
    let of_file = protocol.aim.as_ref().map(|aim| (aim.stiffness_percent, aim.seconds_per_touch));
    let of_run = recorded.map(|aim| (aim.stiffness_percent, aim.seconds_per_touch));
    differ("the aim of the run", format!("{of_file:?}"), format!("{of_run:?}"));
    let Some(aim) = recorded else { return };
    let settings = &aim.settings;
    let number = |stated: Option<f64>, chosen: f64| {
        (stated.unwrap_or(chosen).to_string(), chosen.to_string())
    };
    let no_load = protocol.no_load.as_ref().unwrap_or(&settings.no_load);
    let pairs = [
        number(protocol.contact_sweep.target_sigma_hz, settings.contact_sigma_hz),
        number(protocol.no_load_sweep.target_sigma_hz, settings.no_load_sigma_hz),
        number(protocol.approach.fine_step_mm, settings.fine_step_mm),
        (no_load.clone(), settings.no_load.clone()),
    ];
    for (stated, chosen) in pairs {
        differ("a setting that the protocol states, in the aim of the run", stated, chosen);
    }
    let limits = [(aim.stiffness_percent, aim.worst_percent), (aim.seconds_per_touch, aim.seconds)];
    for (wanted, expected) in limits {
        if let Some(wanted) = wanted.filter(|wanted| expected.is_nan() || expected > *wanted) {
            let what = "an aim that the run did not expect to reach";
            findings.add(Check::Plan, record, what, wanted, expected);
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    const TEXT: &str = "samples = ['1']\ndirections = ['front']\nangles_deg = [0]\n\
        touch = { indentation_mm = 0.5 }\n\
        contact_sweep = { min_hz = 1, max_hz = 2 }\n\
        no_load_sweep = { min_hz = 1, max_hz = 2, target_sigma_hz = 0.02 }\n\
        approach = { give_up_below_mm = 1, coarse_step_mm = 0.1, contact_threshold = 0.1 }\n";
    const AIM: &str = "aim = { stiffness_percent = 3 }\n";

    fn recorded() -> Value {
        json!({
            "stiffness_percent": 3.0,
            "settings": {
                "contact_sigma_hz": 0.05, "no_load_sigma_hz": 0.02, "fine_step_mm": 0.016,
                "no_load": "every-sample",
            },
            "seconds": 4.9,
            "worst_percent": 2.9,
        })
    }

    /// The findings about a protocol and what the run recorded.
    #[track_caller]
    fn found(text: &str, recorded: &Value) -> Vec<String> {
        let mut protocol: Protocol = toml::from_str(text).unwrap();
        let recorded: Option<Aim> = serde_json::from_value(recorded.clone()).unwrap();
        complete(&mut protocol, recorded.as_ref());
        let mut findings = Findings::default();
        check(&protocol, recorded.as_ref(), 1, &mut findings);
        findings.0.iter().map(|finding| finding.what.clone()).collect()
    }

    #[test]
    fn a_run_fills_in_what_its_protocol_leaves_out_and_nothing_else() {
        let with_aim = format!("{TEXT}{AIM}");
        assert!(found(&with_aim, &recorded()).is_empty());
        assert!(found(TEXT, &Value::Null).is_empty());
        let mut protocol: Protocol = toml::from_str(&with_aim).unwrap();
        let aim: Aim = serde_json::from_value(recorded()).unwrap();
        complete(&mut protocol, Some(&aim));
        assert_eq!(protocol.approach.fine_step_mm, Some(0.016));
        assert_eq!(protocol.contact_sweep.target_sigma_hz(), Some(0.05));
        // Without an aim in the file the record has nothing to say.
        let mut protocol: Protocol = toml::from_str(TEXT).unwrap();
        complete(&mut protocol, Some(&aim));
        assert_eq!(protocol.approach.fine_step_mm, None);
    }

    #[test]
    fn a_forged_aim_is_found() {
        let with_aim = format!("{TEXT}{AIM}");
        let rows: [(&str, &str, Value, &str); 5] = [
            (&with_aim, "/stiffness_percent", json!(4.0), "the aim of the run"),
            (&with_aim, "/settings/no_load_sigma_hz", json!(0.03), "a setting that the protocol"),
            (&with_aim, "/worst_percent", json!(3.1), "did not expect to reach"),
            (TEXT, "/seconds", json!(1.0), "the aim of the run"),
            (&with_aim, "", Value::Null, "the aim of the run"),
        ];
        for (text, path, value, expected) in rows {
            let mut forged = recorded();
            *forged.pointer_mut(path).unwrap() = value;
            let findings = found(text, &forged);
            assert!(findings.iter().any(|what| what.contains(expected)), "{path}: {findings:?}");
        }
    }
}
