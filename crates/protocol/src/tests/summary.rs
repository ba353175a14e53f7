//! What a plan says beforehand: its extremes and its duration.

use super::*;

#[test]
fn a_summary_holds_the_extremes_that_the_touches_ask_for() {
    let summary = plan_of(THREE_DIRECTION).summary(&limits());
    assert_eq!((summary.touches, summary.no_loads, summary.prompts), (110, 19, 20));
    assert_eq!(summary.rotary, Span::new(-45.0, 45.0));
    // The level surface at 20 mm, 0.8 mm to give up and 0.5 mm of indentation.
    assert!((summary.linear.min.value() - 18.7).abs() < 1e-9);
    assert_eq!(summary.linear.max.value(), 45.0);
}

#[test]
fn a_reference_by_drift_is_expected_where_the_drift_would_pass_its_limit() {
    let of = |policy: &str, target_hz: &str| {
        let no_load = format!("\nno_load = {policy:?}");
        let target = format!("target_sigma_hz = {target_hz}\n");
        let text = changed(&[
            ("\nno_load = \"every-sample\"", &no_load),
            ("target_sigma_hz = 0.02\n", &target),
        ]);
        plan_of(&text)
    };
    let count = |policy: &str, target_hz: &str| of(policy, target_hz).summary(&limits()).no_loads;
    assert_eq!((count("every-touch", "0.02"), count("every-sample", "0.02")), (110, 19));
    // 0.3 Hz in an hour pass 0.02 Hz in 16 s, and 0.04 Hz in 64 s.
    let counts = ["0.001", "0.01", "0.02", "0.1"].map(|target_hz| count("by-drift", target_hz));
    assert_eq!((counts[0], counts[3]), (110, 19));
    assert!(19 < counts[2] && counts[2] < counts[1] && counts[1] < 60, "{counts:?}");
    // The first reference after a person is no matter of the drift, and no other step is.
    let plan = of("by-drift", "0.02");
    let by_drift = (0..plan.steps.len()).filter(|index| plan.is_by_drift(*index)).count();
    assert_eq!(by_drift, 110 - 19);
    let of_sample = of("every-sample", "0.02");
    assert!((0..of_sample.steps.len()).all(|index| !of_sample.is_by_drift(index)));
}

#[test]
fn the_expected_duration_is_the_sum_that_the_documentation_gives() {
    let adaptive = "method = \"adaptive\"";
    let uniform = "method = \"uniform\"\npoints = 11\nsettle_s = 0.3";
    let blind = THREE_DIRECTION.find("[blind]").unwrap();
    let blind = &THREE_DIRECTION[blind..];
    let text = changed(&[
        (blind, ""),
        ("[\"1\", \"2\", \"3\", \"4\", \"5\"]", "[\"1\"]"),
        ("[\"front\", \"back\", \"left\"]", "[\"back\"]"),
        ("[0, 15, 30, 45]", "[0]"),
        ("repeats = 1", "repeats = 2"),
        ("\nno_load = \"every-sample\"", "\nno_load = \"once\""),
        ("survey_s = 10\n", ""),
        ("fine_step_mm = 0.015", "fine_step_mm = 0.01"),
        ("level_check = true\n", ""),
        (adaptive, uniform),
        (adaptive, uniform),
    ]);
    // 125 to 160 Hz, and a Q of 66.
    let time_constant_s = 66.0 / (std::f64::consts::PI * 142.5);
    let no_load_s = 11.0 * (0.3 + 20.0 / 142.5);
    let contact_s = 11.0 * (0.3 + 20.0 / 195.0);
    let reading_s = 0.005 + 2.0 / 142.5 + 0.02;
    // 20 mm/s and 1 mm/s at 200 mm/s².
    let short_s = |way_mm: f64| 0.025 + 2.0 * (way_mm / 200.0).sqrt();
    let long_s = |way_mm: f64| 0.025 + way_mm / 20.0 + 0.1;
    let slow_s = |way_mm: f64| 0.025 + way_mm + 0.005;
    let (fine_s, no_turn_s) = (reading_s + slow_s(0.01), 0.025);
    let test_s = 3.0 * time_constant_s - no_turn_s + 2.0 * (2.0 / 142.5 + 0.02);
    // Up by 0.5 + 0.025 + 0.1 mm, then down by 0.1 mm while it rings, and by 2 · 0.025 mm.
    let slip_s = short_s(0.625) + 3.0 * time_constant_s + 2.0 * reading_s - 0.005 + slow_s(0.05);
    let indented_s = slow_s(0.5) + 0.5 + contact_s + slip_s;
    // From 45 mm to 0.71 mm above the surface at 20 mm in 61 steps of 0.4 mm, from there in steps of 0.1 mm, and in a
    // pass of 10 finer ones.
    let cold_s = short_s(0.0)
        + 5.0 * time_constant_s
        + 61.0 * (short_s(0.4) + reading_s)
        + reading_s
        + 7.1 * (reading_s + slow_s(0.1))
        + short_s(0.2)
        + 3.0 * time_constant_s
        + 5.5 * fine_s;
    // The edge of the next touch, at 0.04°, reaches 20.2175 mm.
    let up_s = short_s(0.7175);
    let first_s = 4.0 * time_constant_s + test_s + cold_s + indented_s + up_s;
    // Then from 0.5 mm above the edge to 0.2 mm above the surface, which is known to 0.13 · 0.2 mm: slowly to four
    // times that and 0.02 mm, in one step to 1.5 times that, and in fine ones.
    let warm_s = short_s(0.5175)
        + slow_s(0.2 - 0.124)
        + 2.0 * reading_s
        + (0.025 + 0.124 - 0.039)
        + 4.4 * fine_s;
    let second_s = 4.0 * time_constant_s - up_s + test_s + warm_s + indented_s + long_s(25.0);

    let found = plan_of(&text).summary(&limits()).duration_s;
    // To level for the sample, to the reference and to both touches.
    let expected = no_load_s + first_s + second_s + 4.0 * no_turn_s;
    assert!((found - expected).abs() < 1e-5 * expected, "{found} {expected}");
    let mut halfway = plan_of(&text);
    halfway.touch.halfway_mm = Some(0.25);
    let longer = halfway.summary(&limits());
    let halfway_s = 2.0 * (0.5 + 0.025 + contact_s);
    assert!((longer.duration_s - found - halfway_s).abs() < 1e-9 * expected, "{longer:?}");
    assert!((longer.halfway_s - halfway_s).abs() < 1e-9 * halfway_s, "{longer:?}");
    let surveyed = Plan { survey_s: Some(20), ..plan_of(&text) }.summary(&limits());
    assert!((surveyed.duration_s - found - 20.0).abs() < 1e-9 * expected, "{surveyed:?}");

    // An analyzer that integrates for 0.08 s at least, and takes 5 ms more beside that: 4 readings with the probe clear, 2
    // of the slip and those of the search, in both touches, and 11 of each sweep, which are longer than 0.08 s.
    let AnalyzerRange { stream, .. } = limits().analyzer;
    let stream = ReadingStream { overhead_s: Some(0.015), ..stream };
    let analyzer = AnalyzerRange { shortest_integration_s: 0.08, stream, ..limits().analyzer };
    let slow = plan_of(&text).summary(&RigLimits { analyzer, ..limits() }).duration_s;
    let readings = (6.0 + 61.0 + 1.0 + 7.1 + 5.5) + (6.0 + 2.0 + 4.4);
    let longer_s = readings * (0.08 - 2.0 / 142.5 + 0.005) + 33.0 * 0.005;
    assert!((slow - found - longer_s).abs() < 1e-5 * longer_s, "{} {longer_s}", slow - found);
}
