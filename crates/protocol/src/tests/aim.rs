//! What an aim chooses, what it keeps, and what it refuses.

use super::*;
use crate::{AIM_KEYS, AimPlan, ErrorPart, NoLoadPolicy, Wanted};

const WANTED: &str = "stiffness_percent = 2.9";
/// The time limit of a sweep in contact.
const CONTACT_LIMIT: &str = "below.\ntime_limit_s = 30";

#[track_caller]
fn aimed(changes: &[(&str, &str)]) -> AimPlan {
    plan_of(&replaced(THREE_DIRECTION.to_owned(), changes)).aim.unwrap()
}

#[track_caller]
fn refused(changes: &[(&str, &str)]) -> String {
    let text = replaced(THREE_DIRECTION.to_owned(), changes);
    let protocol = Protocol::read("protocol.toml", &text);
    let faults = Plan::new(&protocol, &limits(), None, &PaperLike).unwrap_err();
    faults.iter().map(|fault| fault.to_string() + "\n").collect()
}

#[test]
fn a_wider_aim_takes_less_time_and_each_is_kept() {
    let mut last = f64::INFINITY;
    for percent in [2.4, 2.6, 3.0, 5.0, 20.0] {
        let aim = aimed(&[(WANTED, &format!("stiffness_percent = {percent}"))]);
        assert!(aim.together.worst <= percent, "{aim:?}");
        // Another policy of the reference has to save 5 %.
        assert!(aim.times.together_s() <= 1.05 * last, "{percent}: {aim:?}");
        last = aim.times.together_s();
    }
}

#[test]
fn more_time_gives_a_smaller_error_and_is_not_exceeded() {
    let mut last = f64::INFINITY;
    let fastest = aimed(&[(WANTED, "stiffness_percent = 100")]).times.together_s();
    for factor in [1.01, 1.1, 1.5, 3.0] {
        let seconds = factor * fastest;
        let aim = aimed(&[(WANTED, &format!("seconds_per_touch = {seconds}"))]);
        assert_eq!(aim.wanted, Wanted::SecondsPerTouch(seconds));
        assert!(aim.times.together_s() <= seconds, "{aim:?}");
        assert!(aim.together.all <= last, "{factor}: {aim:?}");
        last = aim.together.all;
    }
}

/// The plan is made of the settings chosen, and what is expected of them is what the plan itself says.
#[test]
fn the_plan_has_the_settings_and_the_time_that_the_aim_states() {
    let plan = plan_of(THREE_DIRECTION);
    let aim = plan.aim.clone().unwrap();
    assert_eq!(plan.contact_sweep.target_sigma_hz, aim.settings.contact_sigma_hz);
    assert_eq!(plan.no_load_sweep.target_sigma_hz, aim.settings.no_load_sigma_hz);
    assert_eq!(plan.touch.approach.fine_step_mm, aim.settings.fine_step_mm);
    assert_eq!(plan.no_load, aim.settings.no_load);
    let whole_s = plan.summary(&limits()).duration_s;
    assert!((aim.times.together_s() * 110.0 / whole_s - 1.0).abs() < 1e-9, "{aim:?}");
    let sum = |of: &dyn Fn(ErrorPart) -> f64| {
        ErrorPart::ALL.iter().map(|part| of(*part).powi(2)).sum::<f64>().sqrt()
    };
    let all = sum(&|part| aim.parts[part as usize].all);
    let worst = sum(&|part| aim.parts[part as usize].worst);
    assert!((all - aim.together.all).abs() < 1e-9 && (worst - aim.together.worst).abs() < 1e-9);
    assert!(aim.worst.0.contains("/45/") && aim.worst.0.starts_with("main/1/"), "{aim:?}");
}

/// Each key by itself, and all of them: then the aim only says what to expect.
#[test]
fn what_the_file_states_stays_as_stated() {
    let rows = [
        ("# target_sigma_hz = 0.05", "target_sigma_hz = 0.013"),
        ("# target_sigma_hz = 0.02", "target_sigma_hz = 0.013"),
        ("# fine_step_mm = 0.016", "fine_step_mm = 0.013"),
        ("# no_load = \"every-sample\"", "no_load = \"every-pose\""),
    ];
    let values = |aim: &AimPlan| {
        let settings = aim.settings;
        [
            settings.contact_sigma_hz == 0.013,
            settings.no_load_sigma_hz == 0.013,
            settings.fine_step_mm == 0.013,
            settings.no_load == NoLoadPolicy::EveryPose,
        ]
    };
    for (index, row) in rows.iter().enumerate() {
        let aim = aimed(&[*row, (WANTED, "stiffness_percent = 4")]);
        let mut expected = [false; 4];
        expected[index] = true;
        assert_eq!(values(&aim), expected, "{row:?}: {aim:?}");
        assert_eq!(aim.stated, [AIM_KEYS[index]]);
    }
    let aim = aimed(&[rows[0], rows[1], rows[2], rows[3], (WANTED, "stiffness_percent = 4")]);
    assert_eq!((values(&aim), aim.stated), ([true; 4], AIM_KEYS.to_vec()));
}

#[test]
fn settings_that_a_run_has_chosen_are_used_again() {
    let text = THREE_DIRECTION;
    let chosen = plan_of(text);
    let mut settings = chosen.aim.clone().unwrap().settings;
    settings.fine_step_mm = 0.033;
    let protocol = Protocol::read("protocol.toml", text).with_chosen(&settings);
    let plan = Plan::new(&protocol, &limits(), None, &PaperLike).unwrap();
    assert_eq!(plan.touch.approach.fine_step_mm, 0.033);
    assert_eq!(plan.steps, chosen.steps);
    assert_eq!(plan.aim, None);
}

#[test]
fn an_aim_asks_a_coarse_stage_for_no_finer_step_than_it_makes() {
    let coarse = AxisLimits {
        travel: Span::new(0.0, 100.0),
        soft: Span::new(15.0, 95.0),
        rest: Position::new(45.0),
        tolerance: 0.06,
        max_speed_per_s: 50.0,
    };
    let limits = RigLimits { linear: Axis::new("linear stage", coarse).unwrap(), ..limits() };
    let protocol = Protocol::read("protocol.toml", THREE_DIRECTION);
    let plan = Plan::new(&protocol, &limits, None, &PaperLike).unwrap();
    assert!(plan.touch.approach.fine_step_mm >= 0.06, "{:?}", plan.touch.approach);
}

/// A planned sweep has too few readings for a finer target.
#[test]
fn an_aim_with_all_the_time_asks_for_no_target_that_a_sweep_does_not_reach() {
    // A sweep that ends at its limit above its target is refused.
    let limited = (CONTACT_LIMIT, "below.\ntime_limit_s = 0.6");
    let aim = aimed(&[limited, (WANTED, "seconds_per_touch = 10")]);
    assert!(aim.settings.contact_sigma_hz > 0.03, "{:?}", aim.settings);
    for seconds in ["7", "10", "1000"] {
        let aim = aimed(&[(WANTED, &format!("seconds_per_touch = {seconds}"))]);
        assert!(aim.settings.contact_sigma_hz >= 0.02, "{seconds} s: {:?}", aim.settings);
    }
}

#[test]
fn an_aim_out_of_reach_or_without_a_meaning_is_refused_with_its_limit() {
    let uniform = "[contact_sweep]\nmethod = \"uniform\"\npoints = 101\nsettle_s = 0.1";
    let contact = "[contact_sweep]\nmethod = \"adaptive\"";
    let rows: [(&[(&str, &str)], &str); 12] = [
        (&[(WANTED, "stiffness_percent = 1")], "is below 2.27"),
        (&[(WANTED, "seconds_per_touch = 2")], "is below 5.60 s"),
        (&[(WANTED, "seconds_per_touch = 2")], "use at least 5.60"),
        (&[(WANTED, "")], "[aim] has neither"),
        (&[(WANTED, "stiffness_percent = 2\nseconds_per_touch = 5")], "here are both"),
        (&[(WANTED, "stiffness_percent = 0.001")], "is below the limit of 0.01"),
        (&[("\"5\"]", "\"unknown\"]")], "softest_mpa = 0.05"),
        (&[("\"5\"]", "\"beyond\"]")], "main/beyond/back/45/1: the models of the sensor do not"),
        (&[(contact, uniform)], "method \"uniform\" measures"),
        (
            &[("# slip_mm = 0.025", "slip_mm = 0.001")],
            "slip_mm = 0.001, which no fine step exceeds",
        ),
        (&[("coarse_step_mm = 0.1", "coarse_step_mm = 0.001")], "use at least 0.002"),
        (&[(CONTACT_LIMIT, "below.\ntime_limit_s = 0.15")], "is below 0.2"),
    ];
    for (changes, message) in rows {
        let found = refused(changes);
        assert!(found.contains(message), "{changes:?}: {found}");
        assert_eq!(
            found.lines().filter(|line| line.contains("protocol.toml:")).count(),
            1,
            "{found}"
        );
    }
    let assumed = [("\"5\"]", "\"unknown\"]"), ("# softest_mpa", "softest_mpa")];
    assert_eq!(aimed(&assumed).worst.0, aimed(&[]).worst.0);
}

#[test]
fn a_protocol_without_an_aim_states_every_key() {
    let found = refused(&[("[aim]\n", "\n"), (WANTED, "")]);
    for missing in ["`fine_step_mm` is missing", "`target_sigma_hz` is missing"] {
        assert!(found.contains(missing), "{found}");
    }
}
