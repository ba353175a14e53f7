//! The steps of a plan: their order, and what they ask of a person.

use super::*;

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
        let no_load = format!("\nno_load = {policy:?}");
        let text = changed(&[
            ("\nno_load = \"every-sample\"", &no_load),
            ("repeats = 1", "repeats = 3"),
            ("trials = 50", "trials = 5"),
        ]);
        let plan = plan_of(&text);
        check_that_every_touch_is_prepared(&plan);
        let is_no_load = |step: &&crate::Step| matches!(step.action, Action::NoLoad(_));
        assert_eq!(plan.steps.iter().filter(is_no_load).count(), expected, "{policy}");
    }
    check("every-touch", 5 * 3 * 4 * 3 + 5);
    // One before each touch, of which the rig leaves out those that the drift does not need.
    check("by-drift", 5 * 3 * 4 * 3 + 5);
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
fn the_model_is_learnt_unless_the_protocol_says_otherwise() {
    let of = |text: &str| Protocol::read("protocol.toml", text).model();
    assert_eq!(of(THREE_DIRECTION), ModelOrigin::Learnt);
    assert_eq!(of(SMOKE), ModelOrigin::Learnt);
    let described = changed(&[("model = \"learnt\"", "model = \"described\"")]);
    assert_eq!(of(&described), ModelOrigin::Described);
    assert_eq!(plan_of(&described), plan_of(&changed(&[])));
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
        assert_eq!(rest.after(from).steps, rest.steps[from..]);
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
