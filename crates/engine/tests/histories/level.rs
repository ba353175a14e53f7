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
fn the_sweep_after_the_survey_is_at_half_the_level() {
    let full_v = plan().no_load_sweep.level.volt;
    for level_check in [false, true] {
        let world = run(level_check, 0.0);
        assert_eq!(world.endings(), [RunStatus::Completed], "{:#?}", world.events);
        let sweeps = sweeps(&world);
        assert_eq!(sweeps[0], (full_v, true));
        let second_v = if level_check { 0.5 * full_v } else { full_v };
        assert_eq!(sweeps[1], (second_v, false));
        assert!(sweeps[2..].iter().all(|sweep| *sweep == (full_v, false)), "{sweeps:?}");
    }
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
