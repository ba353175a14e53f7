//! Faulty protocols and their messages.

use super::*;

#[test]
fn ten_faults_of_a_protocol_give_ten_messages_whatever_their_kind() {
    let text = changed(&[
        ("samples = [", "sample = ["),
        ("[0, 15, 30, 45]", "[0, 15, 15, 60]"),
        ("repeats = 1", "repeats = 0"),
        ("order = \"by-travel\"", "order = \"shuffled\""),
        ("seed = 2020", "seed = \"2020\""),
        ("\nindentation_mm = 0.5", "\nindentation_mm = 3.5"),
        ("fine_step_mm = 0.015", "fine_step_mm = 0.0005"),
        ("max_hz = 160", "max_hz = 120"),
        ("time_limit_s = 30", "time_limit_s = 0"),
        ("classes = 5", ""),
        ("max_angle_deg = 45", "max_angle_deg = 55"),
    ]);
    let protocol = Protocol::read("protocol.toml", &text);
    insta::assert_snapshot!(Plan::new(&protocol, &limits(), None, &PaperLike).unwrap_err());
}

#[test]
fn a_uniform_sweep_that_takes_longer_than_it_may_is_refused() {
    let uniform = |settle_s: f64| {
        let method = format!("method = \"uniform\"\npoints = 101\nsettle_s = {settle_s}");
        complaints(&[("method = \"adaptive\"", &method)], &limits())
    };
    let complaint = uniform(0.5);
    assert!(
        complaint.contains("101 points take 65 s, longer than time_limit_s = 30"),
        "{complaint}"
    );
    assert!(complaint.contains("allow 65 s"), "{complaint}");
}

#[test]
fn two_angles_that_the_rotary_stage_cannot_tell_apart_are_refused() {
    let said = complaints(&[("[0, 15, 30, 45]", "[0, 15, 45, 45.0000001]")], &limits());
    let tolerance = limits().rotary.tolerance();
    assert!(
        said.contains(&format!(
            "angles_deg: 45.0000001 is within {tolerance}° of 45, the accuracy"
        )),
        "{said}"
    );
    let apart = format!("[0, 15, 44, {}]", 44.0 + 2.0 * tolerance);
    let changes = [("[0, 15, 30, 45]", apart.as_str())];
    let text = changed(&changes);
    let protocol = Protocol::read("protocol.toml", &text);
    Plan::new(&protocol, &limits(), None, &PaperLike).unwrap();
}

#[test]
fn a_number_in_another_unit_is_told_what_it_would_be() {
    let changes = [
        ("\nindentation_mm = 0.5", "\nindentation_mm = 0.0005"),
        ("start_above_mm = 0.71", "start_above_mm = 0.00071"),
        ("coarse_step_mm = 0.1", "coarse_step_mm = 100"),
        ("contact_threshold = 0.10", "contact_threshold = 5"),
        ("min_hz = 125", "min_hz = 0.125"),
        ("target_sigma_hz = 0.05", "target_sigma_hz = 1e-6"),
        ("level_v = 5", "level_v = 5000"),
        ("max_indentation_mm = 0.5", "max_indentation_mm = 500"),
    ];
    insta::assert_snapshot!(complaints(&changes, &limits()));
}

/// The way of two readings of 26 ms and of a stop of 30 ms, over a coarse step.
#[test]
fn a_descent_is_as_fast_as_the_coarse_step_allows_and_needs_a_stream() {
    let asked = |keys: &str, limits: &RigLimits| {
        complaints(&[("[approach]\n", &format!("[approach]\n{keys}\n"))], limits)
    };
    let with = |overhead_s| {
        let stream = ReadingStream { overhead_s, ..limits().analyzer.stream };
        let analyzer = AnalyzerRange { stream, ..limits().analyzer };
        RigLimits { analyzer, ..limits() }
    };
    let descent = "method = \"descent\"";
    for (keys, limits, expected) in [
        ("speed_mm_per_s = 1", limits(), "for the method \"descent\" only"),
        (
            &*format!("{descent}\nslow_speed_mm_per_s = 0.1"),
            limits(),
            "and repeats = 1; write repeats",
        ),
        (&*format!("{descent}\nspeed_mm_per_s = 9"), limits(), "limits.contact_speed_mm_per_s"),
        (
            &*format!("{descent}\nspeed_mm_per_s = 0.0005"),
            limits(),
            "below 0.001 mm/s, the slowest",
        ),
        (descent, with(None), "stream_overhead_s"),
        (descent, with(Some(0.5)), "no faster than the search in steps"),
        (&*format!("{descent}\nspeed_mm_per_s = 0.9"), with(Some(0.1)), "above 0.38 mm/s"),
    ] {
        let found = asked(keys, &limits);
        assert!(found.contains(expected), "{keys}: {found}");
    }
    let halfway = "\nindentation_mm = 0.5\nhalfway_mm = 0.05";
    let changes = [
        ("\nindentation_mm = 0.5", halfway),
        ("[approach]\n", &format!("[approach]\n{descent}\n")),
    ];
    let found = complaints(&changes, &limits());
    assert!(found.contains("the probe would go up to it; use at least 0.1"), "{found}");
    let text = changed(&[("[approach]\n", &format!("[approach]\n{descent}\n"))]);
    let plan = |limits: &RigLimits| {
        Plan::new(&Protocol::read("protocol.toml", &text), limits, None, &PaperLike).unwrap()
    };
    let speed = |limits: &RigLimits| plan(limits).touch.approach.descent_mm_per_s.unwrap();
    assert!((speed(&limits()) - limits().motion.contact_speed_mm_per_s).abs() < 1e-9);
    assert!((speed(&with(Some(0.1))) - 0.1 / (2.0 * 0.116 + 0.03)).abs() < 1e-9);
}

#[test]
fn an_unknown_angle_needs_all_three_directions() {
    let changes =
        [("angle = \"known\"", "angle = \"unknown\""), ("\"back\", \"left\"]", "\"left\"]")];
    let found = complaints(&changes, &limits());
    assert!(found.contains("three directions, and \"back\" is not among them; add it"), "{found}");
}

#[test]
fn a_check_of_the_level_needs_a_survey() {
    let found = complaints(&[("survey_s = 10\n", "")], &limits());
    assert!(found.contains("level_check is part of a survey, and there is no survey_s"), "{found}");
}

#[test]
fn a_protocol_that_contradicts_itself_is_refused() {
    let changes = [
        ("samples = [\"1\", \"2\"", "samples = [\"a/b\", \"2\", \"2\""),
        ("[\"front\", \"back\", \"left\"]", "[\"front\", \"left\", \"left\"]"),
        ("coarse_step_mm = 0.1", "coarse_step_mm = 0.7"),
        ("fine_step_mm = 0.015", "fine_step_mm = 0.75\nslip_mm = 0.6"),
        ("[contact_sweep]\nmethod = \"adaptive\"", "[contact_sweep]\nmethod = \"uniform\""),
        ("level_v = 5\n\n# Before", "level_v = 5\npoints = 11\n# Before"),
        ("survey_s = 10", "survey_s = 5"),
        ("trials = 50", "trials = 4"),
        ("classes = 5", "classes = 7"),
        ("min_angle_deg = 0\nmax_angle_deg = 45", "min_angle_deg = 30\nmax_angle_deg = 20"),
        ("max_indentation_mm = 0.5", "max_indentation_mm = 0.3"),
    ];
    insta::assert_snapshot!(complaints(&changes, &limits()));
}

#[test]
fn a_protocol_that_the_bench_cannot_run_is_refused() {
    let limits = RigLimits {
        geometry: Geometry { surface_tolerance_mm: 0.5, ..limits().geometry },
        analyzer: AnalyzerRange {
            frequency_hz: (128.0, 250.0),
            max_level_v: 1.0,
            ..limits().analyzer
        },
        ..limits()
    };
    let changes = [
        ("[0, 15, 30, 45]", "[0, 15, 30, 52]"),
        ("\"5\"]", "\"6\"]"),
        ("\nindentation_mm = 0.5", "\nindentation_mm = 1.2"),
        ("\nmax_indentation_mm = 0.5", ""),
    ];
    insta::assert_snapshot!(complaints(&changes, &limits));
}

#[test]
fn a_search_that_leaves_the_reach_of_the_linear_stage_is_refused() {
    let changes = [
        ("start_above_mm = 0.71", "start_above_mm = 25"),
        ("give_up_below_mm = 0.8", "give_up_below_mm = 6"),
    ];
    insta::assert_snapshot!(complaints(&changes, &limits()));
}

#[test]
fn a_sample_whose_edge_rises_above_the_clear_position_is_refused() {
    let geometry = Geometry { sample_half_width_mm: 40.0, ..limits().geometry };
    insta::assert_snapshot!(complaints(&[("name", "name")], &RigLimits { geometry, ..limits() }));
}

#[test]
fn a_protocol_that_takes_too_long_is_refused() {
    insta::assert_snapshot!(complaints(
        &[("max_duration_h = 8", "max_duration_h = 0.1")],
        &limits()
    ));
}

#[test]
fn a_protocol_that_would_never_end_is_refused() {
    let angles: Vec<_> = (0..=50).map(|degrees| degrees.to_string()).collect();
    let changes = [
        ("[0, 15, 30, 45]", &*format!("[{}]", angles.join(", "))),
        ("repeats = 1", "repeats = 1000"),
    ];
    insta::assert_snapshot!(complaints(&changes, &limits()));
    let many = complaints(&[("trials = 50", "trials = 100000")], &limits());
    let said = "with 100000 trials the protocol has 100060 touches, above the limit of 100000";
    assert!(many.contains(said), "{many}");
}

#[test]
fn whatever_stands_in_a_protocol_it_is_read_or_refused_without_a_panic() {
    const SEED: u64 = 5;
    const JUNK: [&str; 12] = [
        "-1",
        "0",
        "1e400",
        "nan",
        "99999999999999999999",
        "\"\"",
        "\"µ/\"",
        "[]",
        "[[]]",
        "{}",
        "1979-05-27",
        "[1, \"a\", {}]",
    ];
    let mut random = Draws::Order.stream(SEED);
    let mut refused = 0;
    for case in 0..500 {
        let mut lines: Vec<_> = THREE_DIRECTION.lines().map(str::to_owned).collect();
        for _ in 0..=random.below(3) {
            let at = random.below(lines.len());
            let key = lines[at].split(" = ").next().unwrap_or_default().to_owned();
            lines[at] = format!("{key} = {}", JUNK[random.below(JUNK.len())]);
        }
        let text = lines.join("\n");
        let plan = Plan::new(&Protocol::read("protocol.toml", &text), &limits(), None, &PaperLike);
        match plan {
            Ok(plan) => check_that_every_touch_is_prepared(&plan),
            Err(faults) => {
                assert!(!faults.is_empty(), "case {case} of seed {SEED}:\n{text}");
                refused += 1;
            }
        }
    }
    // Otherwise the cases are too tame, or too wild, to show anything.
    assert!((50..500).contains(&refused), "{refused}");
}

#[test]
fn every_single_line_may_be_lost_without_a_panic() {
    let lines: Vec<_> = THREE_DIRECTION.lines().collect();
    for lost in 0..lines.len() {
        let kept: Vec<_> = [&lines[..lost], &lines[lost + 1..]].concat();
        let text = kept.join("\n");
        let protocol = Protocol::read("protocol.toml", &text);
        // The changed file either runs or has a message.
        if let Err(faults) = Plan::new(&protocol, &limits(), None, &PaperLike) {
            assert!(!faults.is_empty());
        }
    }
}
