//! Plans of the shipped files, and the messages for faulty ones.

use std::collections::BTreeSet;

use rig_model::{
    AnalyzerRange, Axis, AxisLimits, Geometry, MotionLimits, Orientation, Position, RigLimits, Span,
};

use crate::{
    Action, AngleKnowledge, ModelOrigin, Phase, Plan, Prompt, Protocol, Touch, layout::Draws,
};

const THREE_DIRECTION: &str = include_str!("../../../config/protocols/three-direction.toml");
const SMOKE: &str = include_str!("../../../config/protocols/smoke.toml");

fn limits() -> RigLimits {
    let linear = AxisLimits {
        travel: Span::new(0.0, 100.0),
        soft: Span::new(15.0, 95.0),
        rest: Position::new(45.0),
        tolerance: 0.002,
        max_speed_per_s: 50.0,
    };
    let rotary = AxisLimits {
        travel: Span::new(-90.0, 90.0),
        soft: Span::new(-50.0, 50.0),
        rest: Position::new(0.0),
        tolerance: 0.02,
        max_speed_per_s: 60.0,
    };
    RigLimits {
        linear: Axis::new("linear stage", linear).unwrap(),
        rotary: Axis::new("rotary stage", rotary).unwrap(),
        geometry: Geometry {
            surface: Position::new(20.0),
            surface_above_pivot_mm: 2.0,
            probe_beside_pivot_mm: 0.0,
            probe_radius_mm: 0.5,
            sample_half_width_mm: 25.0,
            surface_tolerance_mm: 0.2,
        },
        motion: MotionLimits {
            max_indentation_mm: 0.8,
            travel_speed_mm_per_s: 20.0,
            contact_speed_mm_per_s: 1.0,
            rotary_speed_deg_per_s: 20.0,
        },
        analyzer: AnalyzerRange { frequency_hz: (4.0, 8e6), max_level_v: 5.0 },
    }
}

fn plan_of(text: &str) -> Plan {
    Plan::new(&Protocol::read("protocol.toml", text), &limits(), None).unwrap()
}

/// The three-direction protocol with some of its lines changed. Each must be there.
#[track_caller]
fn changed(changes: &[(&str, &str)]) -> String {
    let mut text = THREE_DIRECTION.to_owned();
    for (old, new) in changes {
        assert!(text.contains(old), "{old:?} is not in the file");
        text = text.replacen(old, new, 1);
    }
    text
}

/// The messages for a protocol, without the location, which each test would have to count out.
#[track_caller]
fn complaints(changes: &[(&str, &str)], limits: &RigLimits) -> String {
    let protocol = Protocol::read("protocol.toml", &changed(changes));
    let known: Vec<_> = ["1", "2", "3", "4", "5"].map(str::to_owned).into();
    let faults = Plan::new(&protocol, limits, Some(&known)).unwrap_err();
    faults.iter().map(|fault| fault.to_string() + "\n").collect()
}

fn touches(plan: &Plan, wanted: Phase) -> Vec<Touch> {
    let touch = |action| match action {
        Action::Touch(touch) if touch.phase == wanted => Some(touch),
        _ => None,
    };
    plan.steps.iter().filter_map(|step| touch(step.action)).collect()
}

fn prompts(plan: &Plan) -> Vec<Prompt> {
    let prompt = |action| match action {
        Action::Prompt(prompt) => Some(prompt),
        _ => None,
    };
    plan.steps.iter().filter_map(|step| prompt(step.action)).collect()
}

/// Walks through the plan as a bench would, and fails where something was not asked for.
#[track_caller]
fn check_that_every_touch_is_prepared(plan: &Plan) {
    let (mut sample, mut orientation, mut no_load) = (None, None, None);
    for step in &plan.steps {
        match step.action {
            Action::Prompt(Prompt::PlaceSample { sample: placed }) => {
                assert_ne!(sample.replace(placed), Some(placed), "{}: it lies there", step.id);
            }
            Action::Prompt(Prompt::TurnSensor { orientation: turned }) => {
                assert_ne!(orientation.replace(turned), Some(turned), "{}: it stands so", step.id);
            }
            Action::NoLoad(pose) => no_load = Some(pose),
            Action::Touch(touch) => {
                assert_eq!(sample, Some(touch.sample), "{}", step.id);
                assert_eq!(orientation, Some(touch.pose.direction.orientation()), "{}", step.id);
                assert!(no_load.is_some(), "{}", step.id);
            }
        }
    }
    let ids: BTreeSet<_> = plan.steps.iter().map(|step| &step.id).collect();
    assert_eq!(ids.len(), plan.steps.len(), "addresses are unique");
}

#[test]
fn the_paper_s_protocol_touches_every_pose_once_and_asks_for_little() {
    let plan = plan_of(THREE_DIRECTION);
    check_that_every_touch_is_prepared(&plan);
    let main = touches(&plan, Phase::Main);
    assert_eq!(main.len(), 5 * 3 * 4);
    let poses: BTreeSet<_> =
        main.iter().map(|touch| format!("{} {:?}", touch.sample, touch.pose)).collect();
    assert_eq!(poses.len(), main.len());
    assert_eq!(touches(&plan, Phase::Blind).len(), 50);
    assert_eq!(plan.classes, Some(5));

    // Five samples are placed, and the sensor is set up once and turned once for each of them.
    let is_main = |step: &&crate::Step| step.id.0.starts_with("main/");
    let main_steps = plan.steps.iter().filter(is_main);
    let asked = main_steps.filter(|step| matches!(step.action, Action::Prompt(_)));
    assert_eq!(asked.count(), 5 + 1 + 5);
}

#[test]
fn steps_come_in_an_order_that_a_person_understands() {
    let steps = plan_of(SMOKE).steps;
    let lines: Vec<_> = steps.iter().map(|step| format!("{} {:?}", step.id, step.action)).collect();
    insta::assert_snapshot!(lines.join("\n"));
}

#[test]
fn a_random_order_costs_no_prompt_and_depends_on_the_seed_alone() {
    let random = |seed: &str| {
        let drawn = ("order = \"by-mounting\"", "order = \"drawn\"");
        let random = ("order = \"by-travel\"", "order = \"random\"");
        plan_of(&changed(&[drawn, random, ("seed = 2020", seed)]))
    };
    let (plan, again, other) = (random("seed = 7"), random("seed = 7"), random("seed = 8"));
    check_that_every_touch_is_prepared(&plan);
    assert_eq!(plan, again);
    assert_ne!(touches(&plan, Phase::Main), touches(&other, Phase::Main));

    let drawn = ("order = \"by-mounting\"", "order = \"drawn\"");
    let listed = plan_of(&changed(&[drawn, ("seed = 2020", "seed = 7")]));
    let main_prompts = |plan: &Plan| {
        let main = plan.steps.iter().filter(|step| step.id.0.starts_with("main/"));
        main.filter(|step| matches!(step.action, Action::Prompt(_))).count()
    };
    assert_eq!(main_prompts(&plan), main_prompts(&listed));
    assert_eq!(touches(&plan, Phase::Blind), touches(&listed, Phase::Blind), "a stream of its own");
}

#[test]
fn an_order_by_travel_turns_less_and_keeps_the_touches_and_the_prompts() {
    let order = |order: &str| plan_of(&changed(&[("order = \"by-travel\"", order)]));
    let (listed, travel) = (order("order = \"listed\""), order("order = \"by-travel\""));
    check_that_every_touch_is_prepared(&travel);
    assert_eq!(prompts(&listed).len(), prompts(&travel).len());
    let way = |plan: &Plan| {
        let (mut here, mut way_deg) = (0.0, 0.0);
        for step in plan.steps.iter().filter(|step| step.id.0.starts_with("main/")) {
            let there = match step.action {
                Action::Prompt(Prompt::PlaceSample { .. }) => 0.0,
                Action::Prompt(_) => here,
                Action::NoLoad(pose) | Action::Touch(Touch { pose, .. }) => {
                    pose.direction.rotary_position(pose.angle).value()
                }
            };
            way_deg += f64::abs(there - here);
            here = there;
        }
        way_deg
    };
    // Listed: 225° for each sample and 45° to level it. By travel: 180° when the left comes last, else 135° and 45°.
    let (listed_deg, travel_deg) = (way(&listed), way(&travel));
    assert!((listed_deg, travel_deg) == (1305.0, 900.0), "{listed_deg}°, {travel_deg}°");
    let key = |touch: &Touch| (touch.sample, format!("{:?}", touch.pose), touch.repeat);
    let sorted = |plan: &Plan| {
        let mut all: Vec<_> = touches(plan, Phase::Main).iter().map(key).collect();
        all.sort();
        all
    };
    assert_eq!(sorted(&listed), sorted(&travel));
}

#[test]
fn blind_trials_are_drawn_evenly_from_the_whole_range() {
    let drawn = ("order = \"by-mounting\"", "order = \"drawn\"");
    let many = [drawn, ("trials = 50", "trials = 6000"), ("max_duration_h = 8", "")];
    let plan = plan_of(&changed(&many));
    check_that_every_touch_is_prepared(&plan);
    let blind = touches(&plan, Phase::Blind);
    let mut samples = [0_u32; 5];
    let mut directions = [0_u32; 3];
    let mut halves = [0_u32; 2];
    for touch in &blind {
        let degrees = touch.pose.angle.degrees();
        assert!((0.0..=45.0).contains(&degrees));
        assert!(((degrees * 100.0).round() - degrees * 100.0).abs() < 1e-9, "{degrees}");
        samples[touch.sample] += 1;
        directions[touch.pose.direction as usize] += 1;
        halves[usize::from(degrees > 22.5)] += 1;
    }
    // Five standard deviations of a binomial count.
    let is_even = |counts: &[u32]| {
        let share = 1.0 / counts.len() as f64;
        let (mean, sigma) = (6000.0 * share, (6000.0 * share * (1.0 - share)).sqrt());
        counts.iter().all(|&count| (f64::from(count) - mean).abs() < 5.0 * sigma)
    };
    let counts: [&[u32]; 3] = [&samples, &directions, &halves];
    assert!(counts.into_iter().all(is_even), "{counts:?}");
    let trials: Vec<_> = blind.iter().map(|touch| touch.repeat).collect();
    assert_eq!(trials, (1..=6000).collect::<Vec<_>>());
}

#[test]
fn blind_touches_by_mounting_are_those_drawn_with_the_fewest_changes_by_hand() {
    for seed in 0..20 {
        let seed = format!("seed = {seed}");
        let order = |order| {
            let order = format!("order = {order:?}");
            plan_of(&changed(&[("order = \"by-mounting\"", &order), ("seed = 2020", &seed)]))
        };
        let (drawn, together) = (order("drawn"), order("by-mounting"));
        check_that_every_touch_is_prepared(&together);
        assert_eq!(drawn.by_mounting(), together);
        let blind = touches(&together, Phase::Blind);
        let mut sorted = blind.clone();
        sorted.sort_by_key(|touch| touch.repeat);
        assert_eq!(sorted, touches(&drawn, Phase::Blind));
        let mounting = |touch: &Touch| (touch.sample, touch.pose.direction.orientation());
        let mut mountings: Vec<_> = blind.iter().map(mounting).collect();
        mountings.dedup();
        let changes = mountings
            .windows(2)
            .map(|pair| usize::from(pair[0].0 != pair[1].0) + usize::from(pair[0].1 != pair[1].1));
        // Each of the four other samples is placed once, and the sensor is turned once for each sample.
        assert!(changes.sum::<usize>() <= 9, "{mountings:?}");
        assert!(prompts(&together).len() <= prompts(&drawn).len());
    }
}

#[test]
fn the_no_load_resonance_is_measured_as_often_as_the_policy_says() {
    #[track_caller]
    fn check(policy: &str, expected: usize) {
        let no_load = format!("no_load = {policy:?}");
        let text = changed(&[
            ("no_load = \"every-sample\"", &no_load),
            ("repeats = 1", "repeats = 3"),
            ("trials = 50", "trials = 5"),
        ]);
        let plan = plan_of(&text);
        check_that_every_touch_is_prepared(&plan);
        let is_no_load = |step: &&crate::Step| matches!(step.action, Action::NoLoad(_));
        assert_eq!(plan.steps.iter().filter(is_no_load).count(), expected, "{policy}");
    }
    check("every-touch", 5 * 3 * 4 * 3 + 5);
    // The blind trials differ in their angles.
    check("every-pose", 5 * 3 * 4 + 5);
    // Two mountings of the sensor for each of five samples, and the blind trials that need a
    // person.
    let needing = |plan: &Plan| {
        let after_prompt = |pair: &[crate::Step]| {
            matches!(pair[0].action, Action::Prompt(_))
                && !matches!(pair[1].action, Action::Prompt(_))
        };
        plan.steps.windows(2).filter(|pair| after_prompt(pair)).count()
    };
    let text = changed(&[("repeats = 1", "repeats = 3"), ("trials = 50", "trials = 5")]);
    check("every-sample", needing(&plan_of(&text)));
    check("once", 1);
}

#[test]
fn the_sensor_is_not_turned_when_all_directions_need_it_to_stand_the_same_way() {
    let directions = "directions = [\"front\", \"back\", \"left\"]";
    for (listed, orientation) in [("left", Orientation::Left), ("back", Orientation::FrontBack)] {
        let listed = format!("directions = [{listed:?}]");
        let plan = plan_of(&changed(&[(directions, &listed)]));
        check_that_every_touch_is_prepared(&plan);
        let turns: Vec<_> = prompts(&plan)
            .into_iter()
            .filter(|prompt| matches!(prompt, Prompt::TurnSensor { .. }))
            .collect();
        assert_eq!(turns, [Prompt::TurnSensor { orientation }]);
    }
}

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
fn the_expected_duration_is_the_sum_that_the_documentation_gives() {
    let adaptive = "method = \"adaptive\"";
    let uniform = "method = \"uniform\"\npoints = 11\nsettle_s = 0.3";
    let blind = THREE_DIRECTION.find("[blind]").unwrap();
    let text = changed(&[
        (&THREE_DIRECTION[blind..], ""),
        ("[\"1\", \"2\", \"3\", \"4\", \"5\"]", "[\"1\"]"),
        ("[\"front\", \"back\", \"left\"]", "[\"back\"]"),
        ("[0, 15, 30, 45]", "[0]"),
        ("repeats = 1", "repeats = 2"),
        ("no_load = \"every-sample\"", "no_load = \"once\""),
        ("survey_s = 20\n", ""),
        ("level_check = true\n", ""),
        (adaptive, uniform),
        (adaptive, uniform),
    ]);
    // 125 to 160 Hz, and a Q of 66.
    let time_constant_s = 66.0 / (std::f64::consts::PI * 142.5);
    let no_load_s = 11.0 * (0.3 + 20.0 / 142.5);
    let contact_s = 11.0 * (0.3 + 20.0 / 195.0);
    let reading_s = 0.005 + 2.0 / 142.5;
    // 20 mm/s and 1 mm/s at 200 mm/s².
    let short_s = |way_mm: f64| 0.025 + 2.0 * (way_mm / 200.0).sqrt();
    let long_s = |way_mm: f64| 0.025 + way_mm / 20.0 + 0.1;
    let slow_s = |way_mm: f64| 0.025 + way_mm + 0.005;
    let (fine_s, no_turn_s) = (reading_s + slow_s(0.01), 0.025);
    let test_s = 3.0 * time_constant_s - no_turn_s + 2.0 * 2.0 / 142.5;
    // Up by 0.5 + 0.025 + 0.1 mm, then down by 0.1 mm while it rings, and by 2 · 0.025 mm.
    let slip_s = short_s(0.625) + 3.0 * time_constant_s + 2.0 * reading_s - 0.005 + slow_s(0.05);
    let indented_s = slow_s(0.5) + 0.5 + contact_s + slip_s;
    // From 45 mm to 0.71 mm above the surface at 20 mm, in steps of 0.1 mm, and in a pass of 10 finer ones.
    let cold_s = long_s(24.29)
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
}

#[test]
fn ten_faults_of_a_protocol_give_ten_messages_whatever_their_kind() {
    let text = changed(&[
        ("samples = [", "sample = ["),
        ("[0, 15, 30, 45]", "[0, 15, 15, 60]"),
        ("repeats = 1", "repeats = 0"),
        ("order = \"by-travel\"", "order = \"shuffled\""),
        ("seed = 2020", "seed = \"2020\""),
        ("\nindentation_mm = 0.5", "\nindentation_mm = 3.5"),
        ("fine_step_mm = 0.01", "fine_step_mm = 0.0005"),
        ("max_hz = 160", "max_hz = 120"),
        ("time_limit_s = 30", "time_limit_s = 0"),
        ("classes = 5", ""),
        ("max_angle_deg = 45", "max_angle_deg = 55"),
    ]);
    let protocol = Protocol::read("protocol.toml", &text);
    insta::assert_snapshot!(Plan::new(&protocol, &limits(), None).unwrap_err());
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

#[test]
fn a_check_of_the_level_needs_a_survey() {
    let found = complaints(&[("survey_s = 20\n", "")], &limits());
    assert!(found.contains("level_check is part of a survey, and there is no survey_s"), "{found}");
}

#[test]
fn a_protocol_that_contradicts_itself_is_refused() {
    let changes = [
        ("samples = [\"1\", \"2\"", "samples = [\"a/b\", \"2\", \"2\""),
        ("[\"front\", \"back\", \"left\"]", "[\"front\", \"left\", \"left\"]"),
        ("coarse_step_mm = 0.1", "coarse_step_mm = 0.7"),
        ("fine_step_mm = 0.01", "fine_step_mm = 0.75\nslip_mm = 0.6"),
        ("[contact_sweep]\nmethod = \"adaptive\"", "[contact_sweep]\nmethod = \"uniform\""),
        ("level_v = 5\n\n# Before", "level_v = 5\npoints = 11\n# Before"),
        ("survey_s = 20", "survey_s = 5"),
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
        analyzer: AnalyzerRange { frequency_hz: (128.0, 250.0), max_level_v: 1.0 },
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
        let plan = Plan::new(&Protocol::read("protocol.toml", &text), &limits(), None);
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
        if let Err(faults) = Plan::new(&protocol, &limits(), None) {
            assert!(!faults.is_empty());
        }
    }
}

#[test]
fn the_model_is_learnt_unless_the_protocol_says_otherwise() {
    let of = |text: &str| Protocol::read("protocol.toml", text).model();
    assert_eq!(of(THREE_DIRECTION), ModelOrigin::Learnt);
    assert_eq!(of(SMOKE), ModelOrigin::Learnt);
    let described = changed(&[("model = \"learnt\"", "model = \"described\"")]);
    assert_eq!(of(&described), ModelOrigin::Described);
    assert_eq!(plan_of(&described), plan_of(THREE_DIRECTION));
}

#[test]
fn the_angle_is_known_to_the_analysis_unless_the_protocol_says_otherwise() {
    #[track_caller]
    fn check(text: &str, expected: AngleKnowledge) {
        assert_eq!(Protocol::read("protocol.toml", text).angle(), expected);
    }
    check(THREE_DIRECTION, AngleKnowledge::Known);
    check(SMOKE, AngleKnowledge::Known);
    let unknown = changed(&[("angle = \"known\"", "angle = \"unknown\"")]);
    check(&unknown, AngleKnowledge::Unknown);
    assert_eq!(plan_of(&unknown).steps.len(), plan_of(THREE_DIRECTION).steps.len());
}

#[test]
fn a_seed_draws_what_it_has_always_drawn() {
    let draws = |of: Draws| {
        let mut random = of.stream(1);
        std::array::from_fn::<_, 6, _>(|_| random.below(1000))
    };
    assert_eq!(draws(Draws::Order), [361, 728, 315, 785, 329, 329]);
    assert_eq!(draws(Draws::Blind), [661, 764, 214, 272, 457, 385]);
}

#[test]
fn the_rest_of_a_plan_has_every_touch_that_is_left_and_what_it_needs() {
    let plan = plan_of(SMOKE);
    let touches = |plan: &Plan| -> Vec<String> {
        let is_touch = |step: &&crate::Step| matches!(step.action, Action::Touch(_));
        plan.steps.iter().filter(is_touch).map(|step| step.id.to_string()).collect()
    };
    let all = touches(&plan);
    for done in 0..=all.len() {
        // The first ones are done, and one of the others.
        let is_done = |step: &str| {
            all[..done].iter().any(|known| known == step) || done > 3 && step == all[all.len() - 1]
        };
        let (rest, from) = plan.resumed(|step| is_done(&step.0));
        let mut found = touches(&rest);
        let left = &rest.steps[from..];
        assert!(left.iter().all(|step| !is_done(&step.id.0)), "{done} done");
        assert!(rest.steps[..from].iter().all(|step| plan.steps.contains(step)));
        if let Some(next) = left.iter().find(|step| matches!(step.action, Action::Touch(_))) {
            // Neither the sample under the probe nor the orientation of the sensor is known.
            let before: Vec<_> = left.iter().take(4).map(|step| step.action).collect();
            assert!(matches!(before[0], Action::Prompt(Prompt::PlaceSample { .. })), "{next:?}");
            assert!(matches!(before[1], Action::Prompt(Prompt::TurnSensor { .. })), "{next:?}");
            assert!(matches!((before[2], before[3]), (Action::NoLoad(_), Action::Touch(_))));
        }
        found.sort();
        let mut expected = all.clone();
        expected.sort();
        assert_eq!(found, expected, "{done} done");
    }
    // Nothing is done: the plan itself.
    assert_eq!(plan.resumed(|_| false), (plan.clone(), 0));
    let only = plan.only(&all[5]).unwrap();
    assert_eq!((touches(&only), only.steps.len()), (vec![all[5].clone()], 4));
    assert_eq!(plan.only("main/9/left/0/1"), None);
}
