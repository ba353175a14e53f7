//! What a report says of the aim of a protocol.

use rig_record::{Aim, AimPart, AimSettings};

use super::*;

fn aim(stiffness_percent: Option<f64>, seconds_per_touch: Option<f64>) -> Aim {
    let part = |part: &str, seconds: Option<f64>, percent: Option<f64>| AimPart {
        part: part.to_owned(),
        seconds,
        percent,
        worst_percent: percent,
    };
    Aim {
        stiffness_percent,
        seconds_per_touch,
        settings: AimSettings {
            contact_sigma_hz: 0.063,
            no_load_sigma_hz: 0.02,
            fine_step_mm: 0.02,
            no_load: "every-sample".to_owned(),
        },
        stated: vec!["no_load".to_owned()],
        parts: vec![
            part("sweep", Some(0.3), Some(0.5)),
            part("reference", Some(0.1), Some(0.2)),
            part("surface", Some(1.1), Some(0.4)),
            part("depth", None, Some(1.3)),
            part("angle", None, Some(0.8)),
            part("rest", Some(3.3), None),
        ],
        seconds: 4.8,
        percent: 1.7,
        worst_percent: 2.4,
        worst: "main/1/left/45/1".to_owned(),
    }
}

fn run(story: Story, aim: Aim) -> SampleRun {
    let mut run = SampleRun::new(story);
    run.change_start(|started| started.aim = Some(aim));
    run
}

#[test]
fn an_aim_that_is_reached_or_missed_is_said_in_text_page_and_data() {
    let rows = [
        (aim(Some(50.0), None), true, "50 % for each touch, reached; "),
        (aim(Some(0.1), None), false, "not reached: 110 touches are wider: main/1/"),
        (aim(None, Some(1e6)), true, "1000000 s a touch, reached; "),
        (aim(None, Some(0.1)), false, "not reached: a touch took longer; "),
    ];
    for (aim, is_reached, sentence) in rows {
        let is_of_touches = aim.stiffness_percent == Some(0.1);
        let run = run(Story::Complete, aim);
        let results = run.results();
        assert!(results.text().contains(sentence), "{sentence}: {}", results.text());
        let html = run.html();
        check_markup(&html);
        assert!(html.contains(sentence), "{sentence}");
        assert_eq!(html.contains("<p class=\"alarm\">Aim: "), !is_reached, "{sentence}");
        let found = results.summary().aim.unwrap();
        assert_eq!(found.is_reached, Some(is_reached));
        assert_eq!(found.wider.len(), if is_of_touches { 110 } else { 0 });
    }
}

#[test]
fn an_aim_says_how_many_touches_its_standard_deviation_leaves_out() {
    let run = run(Story::Refused, aim(None, Some(1e6)));
    let refused = run.results().summary().touches_refused;
    let sentence = format!("; {refused} touches were refused");
    assert!(run.results().text().contains(&sentence), "{}", run.results().text());
}

/// The parts add up to the whole, in time and in variance.
#[test]
fn the_parts_of_a_touch_are_those_of_the_run() {
    let results = run(Story::Complete, aim(Some(3.0), None)).results();
    let summary = results.summary();
    let found = summary.aim.unwrap();
    let seconds: f64 = found.parts.iter().filter_map(|part| part.seconds).sum();
    assert!((110.0 * seconds / summary.rig_seconds - 1.0).abs() < 1e-9, "{found:?}");
    let squares: f64 = found.parts.iter().filter_map(|part| part.percent).map(|p| p * p).sum();
    assert!((squares.sqrt() / found.percent.unwrap() - 1.0).abs() < 1e-9, "{found:?}");
    assert!(found.percent < found.worst_percent);
    let expected: f64 = found.parts.iter().filter_map(|part| part.expected_seconds).sum();
    assert!((expected - found.expected_seconds).abs() < 1e-9);
}

#[test]
fn a_run_without_touches_has_reached_no_aim_and_one_without_an_aim_says_nothing() {
    let results = run(Story::Empty, aim(Some(3.0), None)).results();
    assert_eq!(results.summary().aim.unwrap().is_reached, None);
    assert!(results.text().contains("3 % for each touch, no touch yet"), "{}", results.text());
    let results = SampleRun::new(Story::Complete).results();
    assert_eq!(results.summary().aim, None);
    assert!(!results.text().contains("aim:"));
}
