//! The aim of a protocol in the journal, in the answers for programs, and in words.

use rig_protocol::{AIM_KEYS, AimPlan, AimSettings, ErrorPart, NoLoadPolicy, Wanted};
use rig_store as store;

/// The aim in the types of the journal.
pub(crate) fn recorded(aim: &AimPlan) -> store::Aim {
    let AimPlan { wanted, settings, stated, times, parts, together, worst } = aim;
    let seconds_of = |part| match part {
        ErrorPart::Sweep => Some(times.sweep_s),
        ErrorPart::Reference => Some(times.reference_s),
        ErrorPart::Surface => Some(times.surface_s),
        ErrorPart::Depth | ErrorPart::Angle => None,
    };
    let of_error = ErrorPart::ALL.iter().zip(parts).map(|(part, percents)| store::AimPart {
        part: part.name().to_owned(),
        seconds: seconds_of(*part),
        percent: Some(percents.all),
        worst_percent: Some(percents.worst),
    });
    let rest = store::AimPart {
        part: "rest".to_owned(),
        seconds: Some(times.rest_s),
        percent: None,
        worst_percent: None,
    };
    let (stiffness_percent, seconds_per_touch) = match wanted {
        Wanted::StiffnessPercent(percent) => (Some(*percent), None),
        Wanted::SecondsPerTouch(seconds) => (None, Some(*seconds)),
    };
    store::Aim {
        stiffness_percent,
        seconds_per_touch,
        settings: store::AimSettings {
            contact_sigma_hz: settings.contact_sigma_hz,
            no_load_sigma_hz: settings.no_load_sigma_hz,
            fine_step_mm: settings.fine_step_mm,
            no_load: settings.no_load.word().to_owned(),
        },
        stated: stated.iter().map(|key| (*key).to_owned()).collect(),
        parts: of_error.chain([rest]).collect(),
        seconds: times.together_s(),
        percent: together.all,
        worst_percent: together.worst,
        worst: worst.to_string(),
    }
}

/// The settings that a run had chosen when it began; `None` if the journal names a policy that is not known.
pub(crate) fn chosen(settings: &store::AimSettings) -> Option<AimSettings> {
    Some(AimSettings {
        contact_sigma_hz: settings.contact_sigma_hz,
        no_load_sigma_hz: settings.no_load_sigma_hz,
        fine_step_mm: settings.fine_step_mm,
        no_load: NoLoadPolicy::of_word(&settings.no_load)?,
    })
}

/// The plan of the aim, for a person: a line for each part with its setting, time and contribution. `screw_file` is the
/// calibration with the error of the screw, if the plan has used one.
pub(crate) fn lines(aim: &AimPlan, screw_file: Option<&str>) -> Vec<String> {
    let AimPlan { wanted, settings, stated, times, parts, together, worst } = aim;
    let values = [
        settings.contact_sigma_hz.to_string(),
        settings.no_load_sigma_hz.to_string(),
        settings.fine_step_mm.to_string(),
        format!("\"{}\"", settings.no_load.word()),
    ];
    let setting = |index: usize| {
        let key = AIM_KEYS[index];
        let by_file = if stated.contains(&key) { ", stated" } else { "" };
        format!("{key} = {}{by_file}", values[index])
    };
    let cell = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.2}"));
    let row = |name: &str, seconds, all, worst, setting: &str| {
        format!("  {name:<9} {:>6} {:>6} {:>6}  {setting}", cell(seconds), cell(all), cell(worst))
            .trim_end()
            .to_owned()
    };
    let error = |part: ErrorPart, seconds, setting: &str| {
        let percents = parts[part as usize];
        row(part.name(), seconds, Some(percents.all), Some(percents.worst), setting)
    };
    let depth = screw_file.unwrap_or("rig: sensor.uncertainty.depth_mm");
    vec![
        format!("aim: {wanted}. Expected of a touch:"),
        format!("  {:<9} {:>6} {:>6} {:>6}  setting", "part", "s", "% rms", "% max"),
        error(ErrorPart::Sweep, Some(times.sweep_s), &setting(0)),
        error(ErrorPart::Reference, Some(times.reference_s), &setting(1)),
        row("", None, None, None, &setting(3)),
        error(ErrorPart::Surface, Some(times.surface_s), &setting(2)),
        error(ErrorPart::Depth, None, depth),
        error(ErrorPart::Angle, None, "rig: sensor.uncertainty.angle_deg"),
        row("rest", Some(times.rest_s), None, None, "rotation, indentation, dwell, way up"),
        row(
            "together",
            Some(times.together_s()),
            Some(together.all),
            Some(together.worst),
            "without sensor and model",
        ),
        format!("  % max is expected of {worst}."),
    ]
}
