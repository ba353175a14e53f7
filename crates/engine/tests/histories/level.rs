//! A survey with a check of the level ends with a sweep at half the level, whose resonance must be the
//! same.

use rig_engine::{Event, Fault, RigState, RunStatus};
use rig_model::SweepMethod;
use rig_protocol::Plan;

use crate::world::{World, plan};

/// A run with a survey on a sensor that softens by this, Hz/V².
fn run(level_check: bool, softening_hz_per_v2: f64) -> World {
    let mut world = World::new(None);
    world.softening_hz_per_v2 = softening_hz_per_v2;
    world.play_plan(&Plan { survey_s: Some(20), level_check, ..plan() });
    world
}

/// The level of each sweep, V, and whether it is a survey.
fn sweeps(world: &World) -> Vec<(f64, bool)> {
    let begun = |event: &Event| match event {
        Event::SweepBegun { request, .. } => {
            Some((request.level.volt, matches!(request.method, SweepMethod::Survey { .. })))
        }
        _ => None,
    };
    world.events.iter().filter_map(begun).collect()
}

#[test]
fn the_sweeps_after_the_survey_are_at_half_and_full_level_in_turn() {
    let full_v = plan().no_load_sweep.level.volt;
    for level_check in [false, true] {
        let world = run(level_check, 0.0);
        assert_eq!(world.endings(), [RunStatus::Completed], "{:#?}", world.events);
        let sweeps = sweeps(&world);
        assert_eq!(sweeps[0], (full_v, true));
        let halves = sweeps.iter().filter(|(level_v, _)| *level_v < full_v).count();
        assert_eq!(halves > 0, level_check);
        let (checked, rest) = sweeps[1..].split_at(2 * halves);
        let turns = checked.chunks(2).all(|two| two == [(0.5 * full_v, false), (full_v, false)]);
        assert!(turns && rest.iter().all(|sweep| *sweep == (full_v, false)), "{sweeps:?}");
    }
}

/// Two hundredths of a hertz at the full level are seen on every seed, where a sweep finds a resonance to a thousandth, and a good
/// bench walks by some thousandths.
#[test]
fn a_softening_by_two_hundredths_of_a_hertz_ends_the_run() {
    let full_v = plan().no_load_sweep.level.volt;
    let mut completed = [0; 2];
    for (completed, softening_hz) in completed.iter_mut().zip([0.0, 0.02]) {
        for seed in 1..=20 {
            let mut world = World::new(None);
            world.random = seed;
            world.softening_hz_per_v2 = softening_hz / (full_v * full_v);
            world.play_plan(&Plan { survey_s: Some(20), level_check: true, ..plan() });
            *completed += usize::from(world.endings() == [RunStatus::Completed]);
        }
    }
    assert_eq!(completed, [20, 0]);
}

#[test]
fn a_resonance_that_falls_with_the_level_ends_the_run_before_the_first_touch() {
    let full_v = plan().no_load_sweep.level.volt;
    // Half a hertz at the full level.
    let softening = 0.5 / (full_v * full_v);
    let world = run(true, softening);
    let end = world.engine.snapshot();
    assert_eq!(end.state, RigState::Latched);
    let Some(Fault::NoReference { reason, .. }) = end.fault else { panic!("{:?}", end.fault) };
    assert!(reason.contains("changes with the amplitude"), "{reason}");
    assert!(!world.events.iter().any(|event| matches!(event, Event::TouchFinished(_))));
    let unnoticed = run(false, softening);
    assert_eq!(unnoticed.endings(), [RunStatus::Completed]);
}
