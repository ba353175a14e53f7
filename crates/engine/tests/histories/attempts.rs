//! A latched rig whose drive did not answer in time tries again, and lowers and turns nothing. The world
//! checks each operation.

use std::time::Duration;

use rig_engine::{Command, Event, FailureKind, Operation, RigState};
use rig_model::Clearance;

use crate::{
    drive::{Drive, DriveTrouble},
    world::{REST_MM, Trouble, World},
};

/// A run whose drive falls silent at this operation, and this long after the rig has latched, s.
fn latched(at: usize, silent_s: u64, after_s: u64) -> World {
    let silent = Trouble::Drive(DriveTrouble::Silent { seconds: silent_s });
    let mut world = World::new(Some((at, silent)));
    world.play();
    let until = world.now + Duration::from_secs(after_s);
    for _ in 0..100_000 {
        let is_over = world.in_flight.is_none() && world.engine.deadline().is_none();
        if is_over || until <= world.now {
            return world;
        }
        world.step();
    }
    panic!("the attempts do not end");
}

/// The number of each attempt, and whether it failed.
fn attempts(world: &World) -> Vec<(u32, bool)> {
    let tried = |event: &Event| match event {
        Event::RetractTried { attempt, fault, .. } => Some((*attempt, fault.is_some())),
        _ => None,
    };
    world.events.iter().filter_map(tried).collect()
}

#[test]
fn after_the_patience_the_latched_rig_tries_every_half_minute_until_the_probe_is_clear() {
    for at in [10, 30, 60] {
        let world = latched(at, 1000, 5000);
        let end = world.engine.snapshot();
        assert_eq!((end.state, end.clearance), (RigState::Latched, Clearance::Clear));
        assert_eq!(end.attempts, None);
        assert!((world.linear_mm - REST_MM).abs() < 0.011);
        let attempts = attempts(&world);
        // 120 s of patience, then 30 s and the 2 s of an attempt at a time.
        assert!((25..=30).contains(&attempts.len()), "{attempts:?}");
        let last = attempts.len() - 1;
        for (place, (number, has_failed)) in attempts.iter().enumerate() {
            assert_eq!((*number as usize, *has_failed), (place + 1, place < last), "{attempts:?}");
        }
        let faults = world.events.iter().filter(|event| matches!(event, Event::Faulted { .. }));
        assert!(faults.count() <= 3, "the attempts repeat the fault");
    }
}

#[test]
fn the_attempts_end_after_a_day() {
    let world = latched(30, 1_000_000, 200_000);
    assert_eq!((attempts(&world).len(), world.engine.snapshot().attempts), (2880, None));
}

#[test]
fn the_attempts_end_with_a_stage_that_is_lost() {
    let mut world = latched(30, 1_000_000, 100);
    let begun = world.engine.snapshot().attempts.expect("it goes on trying");
    assert!((3..=4).contains(&begun), "{begun}");
    world.drive = Some(Drive::new(DriveTrouble::Unhomed { is_homing_safe: false }, world.now));
    let before_mm = world.linear_mm;
    while world.engine.snapshot().attempts.is_some() {
        world.step();
    }
    assert!((world.linear_mm - before_mm).abs() < 1e-9);
    let made = attempts(&world).last().map(|(number, _)| *number);
    assert!(made <= Some(begun + 1), "{made:?} after {begun}");
}

/// A latched rig whose drive has forgotten its position, in an attempt that homes it away from the sample.
fn homing_upwards() -> World {
    let mut world = latched(30, 1_000_000, 70);
    world.drive = Some(Drive::new(DriveTrouble::Unhomed { is_homing_safe: true }, world.now));
    let is_homing = |world: &World| matches!(world.in_flight, Some((_, Operation::HomeUpwards)));
    while !is_homing(&world) {
        world.step();
    }
    world
}

#[test]
fn an_attempt_homes_a_stage_upwards_that_has_forgotten_its_position() {
    let mut world = homing_upwards();
    let tried = attempts(&world).len();
    while world.engine.snapshot().attempts.is_some() {
        world.step();
    }
    let end = world.engine.snapshot();
    assert_eq!((end.state, end.clearance), (RigState::Latched, Clearance::Clear));
    assert_eq!(attempts(&world).len(), tried + 1);
    assert!(REST_MM - 0.011 < world.linear_mm, "{} mm", world.linear_mm);
}

#[test]
fn a_homing_upwards_that_a_person_stops_is_followed_by_nothing_until_it_is_acknowledged() {
    let mut world = homing_upwards();
    world.command(Command::Stop);
    assert!(world.was_interrupted);
    let (id, _) = world.in_flight.take().unwrap();
    world.fail(id, FailureKind::Interrupted);
    let end = world.engine.snapshot();
    assert_eq!((end.state, end.clearance), (RigState::Latched, Clearance::Unknown));
    assert_eq!((end.attempts, world.engine.deadline()), (None, None));
    assert!(world.in_flight.is_none(), "{:?}", world.in_flight);
    world.command(Command::Acknowledge);
    while world.in_flight.is_some() {
        world.step();
    }
    let end = world.engine.snapshot();
    assert_eq!((end.state, end.clearance), (RigState::Idle, Clearance::Clear));
}

#[test]
fn a_person_stops_the_attempts_or_acknowledges_during_one() {
    for is_in_flight in [false, true] {
        for command in [Command::Stop, Command::Acknowledge] {
            let mut world = latched(30, 1_000_000, 70);
            while is_in_flight && world.in_flight.is_none() {
                world.step();
            }
            let (is_stop, tried) = (command == Command::Stop, attempts(&world).len());
            world.drive = None;
            world.command(command);
            while world.in_flight.is_some() {
                world.step();
            }
            let end = world.engine.snapshot();
            assert_eq!((end.attempts, attempts(&world).len()), (None, tried));
            let expected = if is_stop { RigState::Latched } else { RigState::Idle };
            assert_eq!(end.state, expected, "in flight: {is_in_flight}");
            assert_eq!(world.engine.deadline(), None);
            assert_eq!(world.engine.admit(Command::Acknowledge).is_ok(), is_stop);
        }
    }
}

#[test]
fn an_attempt_that_never_ends_latches_the_rig_for_good() {
    let mut world = latched(30, 1_000_000, 70);
    while world.in_flight.is_none() {
        world.step();
    }
    let cause = world.engine.snapshot().fault;
    // Twice overdue: asked to end, and still silent.
    for _ in 0..2 {
        world.now = world.engine.deadline().unwrap();
        world.handle(rig_engine::Input::Tick);
    }
    let end = world.engine.snapshot();
    assert_eq!((end.state, end.attempts, end.fault), (RigState::Latched, None, cause));
    world.engine.admit(Command::Acknowledge).unwrap_err();
}
