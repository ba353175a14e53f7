//! A free resonance that drifts while a run goes on, on many seeds.

use rig_engine::{ContactSenseFault, Event, Fault, RunStatus, SweepPurpose, TouchOutcome};
use rig_protocol::{Action, NoLoadPolicy, Plan, Step, StepId};

use crate::world::{FREE_HZ, LOADED_HZ, World, plan};

/// A run with a survey and a check of the level, on a sensor that walks by this, Hz, and warms up by this, Hz, in an hour.
fn run(seed: u64, walk_hz: f64, warm_up_hz: f64, softening_hz: f64) -> World {
    let mut world = World::new(None);
    world.random = seed;
    world.walk_hz_per_sqrt_hour = walk_hz;
    world.drift_hz_per_s = warm_up_hz / 3600.0;
    let full_v = plan().no_load_sweep.level.volt;
    world.softening_hz_per_v2 = softening_hz / (full_v * full_v);
    world.play_plan(&Plan { survey_s: Some(20), level_check: true, ..plan() });
    world
}

/// Whether the impedance of the clear probe was read again in a search: the search then went up to read.
fn is_anew(event: &Event) -> bool {
    matches!(event, Event::SurfaceFound { trail, .. } if trail.windows(2).any(|two| {
        let [(before, _), (after, _)] = two else { return false };
        after.value() > before.value() + 0.05
    }))
}

#[test]
fn a_drift_ends_no_run_and_moves_no_surface() {
    let mut again = 0;
    for (walk_hz, warm_up_hz) in [(0.5, 0.0), (2.0, 0.0), (0.1, 0.5), (0.1, 5.0), (0.1, 20.0)] {
        for seed in 1..=12 {
            let world = run(seed, walk_hz, warm_up_hz, 0.0);
            let told = format!("{walk_hz}, {warm_up_hz} Hz, seed {seed}");
            assert_eq!(world.endings(), [RunStatus::Completed], "{told}: {:?}", world.refused());
            for (step, depth_mm) in &world.depths_mm {
                // What the check of slip lets pass, and half of a fine step.
                let is_right = (depth_mm - 0.5).abs() <= 0.025 + 0.0025 + 1e-9;
                assert!(is_right, "{told}: {step} at {depth_mm} mm");
            }
            again += world.events.iter().filter(|event| is_anew(event)).count();
        }
    }
    assert!(0 < again, "no search had to read the clear probe again");
}

#[test]
fn the_standard_deviation_of_a_shift_has_the_share_of_the_drift() {
    let (mut far, mut far_without, mut all) = (0, 0, 0);
    for seed in 1..=200 {
        let world = run(seed, 3.0, 0.0, 0.0);
        let finished = world.events.iter().filter_map(|event| match event {
            Event::TouchFinished(result) => Some(result),
            _ => None,
        });
        // The references before the first touch say little of a drift.
        for result in finished.skip(1) {
            let TouchOutcome::Measured { loaded, drift_sigma_hz, .. } = &result.outcome else {
                continue;
            };
            let shift_hz = loaded.resonance_hz - result.no_load.resonance_hz;
            let off_hz = (shift_hz - (LOADED_HZ - FREE_HZ)).abs();
            let sigma_hz = loaded.sigma_hz.hypot(result.no_load.sigma_hz);
            all += 1;
            far += usize::from(3.0 * sigma_hz.hypot(*drift_sigma_hz) < off_hz);
            far_without += usize::from(3.0 * sigma_hz < off_hz);
        }
    }
    assert!(10 * far < all && 9 * all < 10 * far_without, "{far} and {far_without} of {all}");
}

/// Thirty touches with references by drift, at a bench that walks and jumps. The sample is placed again before the 25th.
fn by_drift(seed: u64, walk_hz: f64, target_hz: f64, jump: Option<(usize, f64)>) -> World {
    let mut plan = Plan { no_load: NoLoadPolicy::ByDrift, ..plan() };
    plan.no_load_sweep.target_sigma_hz = target_hz;
    let (place, reference, touch) = (&plan.steps[0], &plan.steps[1], &plan.steps[2]);
    let mut steps = Vec::new();
    for number in 0..30 {
        if number % 24 == 0 {
            steps.push(Step { id: StepId(format!("place/{number}")), ..place.clone() });
        }
        for one in [reference, touch] {
            let kind = if matches!(one.action, Action::Touch(_)) { "touch" } else { "no-load" };
            steps.push(Step { id: StepId(format!("{kind}/{number}")), ..one.clone() });
        }
    }
    plan.steps = steps;
    let mut world = World::new(None);
    (world.random, world.walk_hz_per_sqrt_hour, world.jump) = (seed, walk_hz, jump);
    world.play_plan(&plan);
    world
}

fn references(world: &World) -> usize {
    let is_one = |event: &&Event| matches!(event, Event::SweepFinished(sweep) if sweep.purpose == SweepPurpose::NoLoad);
    world.events.iter().filter(is_one).count()
}

#[test]
fn a_reference_by_drift_is_left_out_until_the_drift_asks_for_it() {
    let counts = [0.05, 1.0].map(|walk_hz| {
        let of = |seed| {
            let world = by_drift(seed, walk_hz, 0.05, None);
            assert_eq!(world.depths_mm.len(), 30, "{:?}", world.engine.snapshot().fault);
            references(&world)
        };
        (1..=6).map(of).sum::<usize>()
    });
    println!("{counts:?} references of 180 touches");
    // Two of each run are those after the sample was placed.
    assert!(12 < counts[0] && 3 * counts[0] < 2 * counts[1] && counts[1] <= 180, "{counts:?}");
}

/// The touches between two references with a jump in between are those that the run names.
#[test]
fn a_jump_between_two_references_names_the_touches_between_them() {
    let mut named = 0;
    for seed in 1..=6 {
        let world = by_drift(seed, 0.05, 0.01, Some((20, 0.6)));
        let (mut since, mut all) = (Vec::new(), Vec::new());
        for event in &world.events {
            match event {
                Event::TouchFinished(result) if !result.is_refused() => {
                    since.push(result.step.clone());
                }
                Event::SweepFinished(sweep) if sweep.purpose == SweepPurpose::NoLoad => {
                    all = std::mem::take(&mut since);
                }
                Event::ReferenceJumped { off_hz, sigma_hz, touches } => {
                    assert_eq!(touches, &all);
                    assert!((0.4..0.8).contains(off_hz) && 2.0 * sigma_hz < *off_hz, "{event:?}");
                    named += 1;
                }
                _ => {}
            }
        }
    }
    assert!(0 < named, "no run named a jump");
}

/// The sensor of these tests has a linewidth of 2.8 Hz and a strong coupling, so that a drift of 0.06 Hz passes for a
/// contact. Where the references have shown little of such a drift by chance, a search and the check after it can both be
/// wrong: this holds that to few touches, and not to none.
#[test]
fn most_drifts_that_pass_for_a_contact_are_refused_above_the_sample() {
    let (mut refused, mut wrong) = (0, 0);
    for walk_hz in [5.0, 20.0] {
        for seed in 1..=12 {
            let world = run(seed, walk_hz, 0.0, 0.0);
            for event in &world.events {
                let Event::TouchFinished(result) = event else { continue };
                let TouchOutcome::Measured { .. } = result.outcome else { continue };
                let depth_mm = world.depths_mm[&result.step.0];
                wrong += usize::from(0.025 + 0.0025 + 1e-9 < (depth_mm - 0.5).abs());
            }
            let fault = world.engine.snapshot().fault;
            refused += usize::from(matches!(
                fault,
                Some(Fault::ContactSense(ContactSenseFault::DriftsTooFast { .. }))
            ));
        }
    }
    assert!(6 < refused && wrong <= 4, "{refused} of 24 runs refused, {wrong} touches wrong");
    println!("{refused} of 24 runs refused, {wrong} touches wrong");
}

#[test]
fn a_resonance_that_changes_with_the_level_is_told_from_one_that_drifts() {
    let is_nonlinear = |world: &World| {
        let fault = world.engine.snapshot().fault;
        matches!(fault, Some(Fault::NoReference { reason, .. }) if reason.contains("amplitude"))
    };
    for seed in 1..=12 {
        assert!(is_nonlinear(&run(seed, 0.1, 5.0, 0.5)), "seed {seed}");
        assert!(!is_nonlinear(&run(seed, 5.0, 0.0, 0.0)), "seed {seed}");
        assert!(!is_nonlinear(&run(seed, 0.1, 20.0, 0.0)), "seed {seed}");
    }
}
