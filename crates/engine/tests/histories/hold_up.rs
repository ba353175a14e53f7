//! The host is held up at every operation of a run.

use rig_engine::{Event, Fault, RigState, RunStatus, TouchOutcome};
use rig_model::Clearance;

use crate::world::{NONSENSE, Trouble, World};

/// Whether an event has a reading that was taken while the host was held up.
fn has_nonsense(event: &Event) -> bool {
    let is_nonsense = |reading: &rig_model::Reading| reading.measured == NONSENSE;
    match event {
        Event::Measured { readings, .. } => readings.iter().any(is_nonsense),
        Event::SurfaceFound { trail, .. } | Event::SurfaceNotFound { trail, .. } => {
            trail.iter().any(|(_, reading)| is_nonsense(reading))
        }
        Event::SweepFinished(sweep) => sweep.readings.iter().any(is_nonsense),
        _ => false,
    }
}

#[test]
fn readings_of_a_host_that_was_held_up_are_measured_again() {
    let mut undisturbed = World::new(None);
    undisturbed.play();
    let mut repeated = 0;
    for (at, times) in (0..undisturbed.operations).flat_map(|at| [(at, 0), (at, 1), (at, 2)]) {
        let mut world = World::new(Some((at, Trouble::HoldUp(times))));
        world.play();
        let context = format!("held up {} times from operation {at}", times + 1);
        assert_eq!(world.endings(), [RunStatus::Completed], "{context}");
        assert!(!world.events.iter().any(has_nonsense), "{context}");
        let stalls: Vec<bool> = world.events.iter().filter_map(again).collect();
        assert!(!stalls.is_empty(), "{context}");
        if stalls[0] {
            repeated += 1;
            assert_eq!(stalls.len(), times as usize + 1, "{context}");
        }
        let is_measured = |event: &&Event| match event {
            Event::TouchFinished(result) => {
                matches!(result.outcome, TouchOutcome::Measured { .. })
            }
            _ => false,
        };
        assert_eq!(world.events.iter().filter(is_measured).count(), 3, "{context}");
    }
    assert!(repeated > 100, "{repeated} measurements were repeated");
}

#[test]
fn a_host_that_is_held_up_again_and_again_ends_the_run_with_a_clear_probe() {
    let mut undisturbed = World::new(None);
    undisturbed.play();
    let mut latched = 0;
    for at in 0..undisturbed.operations {
        let mut world = World::new(Some((at, Trouble::HoldUp(100))));
        world.play();
        let end = world.engine.snapshot();
        if end.state != RigState::Latched {
            assert_eq!(world.endings(), [RunStatus::Completed], "operation {at}");
            continue;
        }
        latched += 1;
        assert!(matches!(end.fault, Some(Fault::HeldUp { attempts: 4, .. })), "{:?}", end.fault);
        assert_eq!(end.clearance, Clearance::Clear, "operation {at}");
    }
    assert!(latched > 30, "{latched} latched");
}

/// Whether a hold-up says that something is measured again.
fn again(event: &Event) -> Option<bool> {
    match event {
        Event::Stalled { is_measured_again, .. } => Some(*is_measured_again),
        _ => None,
    }
}
