//! The linear drive in trouble at every operation of a run: the probe ends clear, or the rig ends
//! latched with its first cause, and nothing moves from a position that is not known.

use rig_engine::{
    Command, Device, Event, FailureKind, Fault, Jump, LeftRig, Operation, RigState, Snapshot,
};
use rig_model::{Clearance, Position, Span};

use crate::{
    drive::DriveTrouble,
    world::{REST_MM, STEPS_MAX, Trouble, World},
};

/// The end of a run with a trouble at each of its operations.
fn each_operation(trouble: DriveTrouble, mut check: impl FnMut(&World, &Snapshot, &str)) {
    let mut undisturbed = World::new(None);
    undisturbed.play();
    let mut troubled = 0;
    // The rig is prepared by four operations, the first of which reads where the stage is.
    for at in 1..undisturbed.operations {
        let mut world = World::new(Some((at, Trouble::Drive(trouble))));
        world.play();
        let end = world.engine.snapshot();
        let context = format!("{trouble:?} at operation {at}: {end:?}");
        if end.state != RigState::Latched {
            // The trouble began and ended within a measurement.
            continue;
        }
        troubled += 1;
        assert!(end.fault.is_some(), "{context}");
        check(&world, &end, &context);
    }
    assert!(troubled > 50, "{trouble:?} was met {troubled} times");
}

fn is_clear(world: &World, end: &Snapshot, context: &str) {
    assert_eq!(end.clearance, Clearance::Clear, "{context}");
    // A drive that is homed upwards stays where that has ended.
    assert!(REST_MM - 0.011 < world.linear_mm, "{context}");
}

/// The first operation finds the stage, the second one takes it to its clear position.
#[test]
fn a_probe_above_its_clear_position_stays_there_on_the_way_out() {
    for start_mm in [40.5, 45.0, 49.0] {
        for trouble in [Trouble::Fails, Trouble::Stalls] {
            for at in 0..2 {
                let mut world = World::new(Some((at, trouble)));
                world.linear_mm = start_mm;
                world.play();
                let end = world.engine.snapshot();
                let context = format!("{trouble:?} at operation {at} from {start_mm} mm: {end:?}");
                if (trouble, at) == (Trouble::Stalls, 0) {
                    // Nothing is wrong with a stage that is found where it is.
                    assert_eq!(end.state, RigState::Idle, "{context}");
                    continue;
                }
                assert_eq!(end.state, RigState::Latched, "{context}");
                assert_eq!(end.clearance, Clearance::Clear, "{context}");
                assert_eq!(world.linear_mm, start_mm, "{context}");
            }
        }
    }
}

/// A move up by hand that fails on its way leaves the probe above what was read back last, where a move to the clear
/// position would go down.
#[test]
fn a_probe_that_a_failed_move_left_above_its_clear_position_is_found_there() {
    let mut world = World::new(None);
    world.command(Command::Prepare);
    while world.in_flight.is_some() {
        world.step();
    }
    world.command(Command::MoveLinear(Position::new(47.0)));
    world.trouble = Some((world.operations, Trouble::Fails));
    world.linear_mm = 43.0;
    while world.engine.snapshot().state != RigState::Latched {
        world.step();
    }
    assert_eq!(world.engine.snapshot().clearance, Clearance::Clear);
    assert_eq!(world.linear_mm, 43.0);
}

/// What waits for a state that does not come, as the two tests above and others do, is ended by [`STEPS_MAX`].
#[test]
#[should_panic(expected = "the history did not end")]
fn a_history_without_an_end_is_given_up() {
    let mut world = World::new(Some((30, Trouble::Drive(DriveTrouble::Silent { seconds: 60 }))));
    world.command(Command::Prepare);
    world.steps = STEPS_MAX - 2;
    while world.engine.snapshot().state != RigState::Latched {
        world.step();
    }
}

#[test]
fn a_bus_that_is_silent_for_a_while_is_waited_for_and_the_probe_retracts() {
    for seconds in [1, 20, 100] {
        each_operation(DriveTrouble::Silent { seconds }, is_clear);
    }
}

/// A drive that boots, or is busy with itself, refuses what it is asked for a while.
#[test]
fn a_drive_that_refuses_a_few_requests_is_asked_again_and_the_probe_retracts() {
    for requests in [1, 3, 6, 12] {
        each_operation(DriveTrouble::Refuses { requests }, is_clear);
    }
}

#[test]
fn a_bus_that_stays_silent_is_given_up_when_the_patience_is_over_and_not_before() {
    each_operation(DriveTrouble::Silent { seconds: 100_000 }, |world, end, context| {
        assert_eq!(end.clearance, Clearance::Unknown, "{context}");
        let first = world.events.iter().position(|event| matches!(event, Event::Faulted { .. }));
        assert!(first.is_some(), "{context}");
        let waited_s = world.now.since(world.faulted_at.unwrap()).as_secs_f64();
        assert!((110.0..140.0).contains(&waited_s), "gave up after {waited_s} s: {context}");
        // The fault is reported at once, and only once.
        let faults = world.events.iter().filter(|event| matches!(event, Event::Faulted { .. }));
        assert!(faults.count() <= 3, "{context}");
    });
}

#[test]
fn the_fault_is_shown_while_the_drive_is_waited_for() {
    let trouble = Trouble::Drive(DriveTrouble::Silent { seconds: 60 });
    let mut world = World::new(Some((30, trouble)));
    world.play_until(|world| world.engine.snapshot().state == RigState::Retracting);
    assert!(matches!(world.engine.snapshot().fault, Some(Fault::Device(_))));
}

#[test]
fn an_alarm_is_reset_once_and_another_one_after_it_and_the_probe_retracts() {
    for (resets, is_another) in [(1, false), (2, true)] {
        each_operation(DriveTrouble::Alarm { resets, is_another }, |world, end, context| {
            is_clear(world, end, context);
            assert_eq!(world.drive.unwrap().resets, resets, "{context}");
        });
    }
}

#[test]
fn an_alarm_that_stays_is_reset_no_second_time_and_a_third_alarm_not_at_all() {
    for (resets, is_another, used) in [(2, false, 1), (3, true, 2)] {
        each_operation(DriveTrouble::Alarm { resets, is_another }, |world, end, context| {
            assert_eq!(end.clearance, Clearance::Unknown, "{context}");
            assert_eq!(world.drive.unwrap().resets, used, "{context}");
        });
    }
}

/// Whichever drive tells it. The rotary stage moves only while the probe is clear.
#[test]
fn a_pressed_emergency_stop_is_not_pushed_against() {
    each_operation(DriveTrouble::EmergencyStop, |world, end, context| {
        let is_of_rotary = matches!(&end.fault, Some(Fault::Device(failure)) if failure.device == Device::RotaryStage);
        assert!(is_of_rotary || end.clearance == Clearance::Unknown, "{context}");
        assert_ne!(end.clearance, Clearance::InContact, "{context}");
        assert!(world.drive.unwrap().refused <= 1, "{context}: {:?}", world.drive);
        assert_eq!(world.engine.snapshot().state, RigState::Latched, "{context}");
    });
}

#[test]
fn a_drive_that_lost_its_position_is_homed_only_away_from_the_sample() {
    each_operation(DriveTrouble::Unhomed { is_homing_safe: true }, is_clear);
    each_operation(DriveTrouble::HomedUnheard, is_clear);
    each_operation(DriveTrouble::Unhomed { is_homing_safe: false }, |world, end, context| {
        // The world refuses every move from here on.
        assert!(world.is_lost, "{context}");
        assert_eq!(end.clearance, Clearance::Unknown, "{context}");
    });
}

/// Its drive may have been switched off meanwhile, and the sample is still in place.
#[test]
fn a_stage_that_was_in_service_is_found_again_and_not_homed_towards_the_sample() {
    let mut world = World::new(Some((30, Trouble::Stop)));
    world.play();
    assert_eq!(world.engine.snapshot().clearance, Clearance::Clear);
    world.command(Command::Acknowledge);
    let first = world.in_flight.as_ref().map(|(_, operation)| operation);
    assert!(matches!(first, Some(Operation::FindLinear { .. })), "{first:?}");
}

/// Steps until the rig is at rest.
fn settle(world: &mut World, at: usize) {
    let is_at_rest =
        |world: &World| matches!(world.engine.snapshot().state, RigState::Idle | RigState::Latched);
    let settled = (0..100).any(|_| {
        let is_over = is_at_rest(world);
        if !is_over {
            world.step();
        }
        is_over
    });
    assert!(settled, "trouble at operation {at}");
}

/// Nothing proves that there is no sample below: not a new program, not a probe that was clear.
#[test]
fn a_stage_is_homed_in_any_direction_only_by_a_person_who_has_seen_that_nothing_is_below_it() {
    let lost = Trouble::Drive(DriveTrouble::Unhomed { is_homing_safe: false });
    let is_homed = |world: &World| world.homings > 0;
    for at in 0..30 {
        let mut world = World::new(Some((at, lost)));
        world.play();
        let end = world.engine.snapshot();
        assert_eq!((end.state, is_homed(&world)), (RigState::Latched, false), "{at}");
        // Whatever else a person does.
        world.command(Command::Acknowledge);
        settle(&mut world, at);
        assert_eq!((world.engine.snapshot().state, is_homed(&world)), (RigState::Latched, false));
        (world.trouble, world.is_lost) = (None, false);
        world.command(Command::HomeLinear);
        settle(&mut world, at);
        assert_eq!(world.engine.snapshot().state, RigState::Idle, "{at}");
        assert_eq!(world.homings, 1, "{at}");
        let stated = |event: &Event| matches!(event, Event::Operator { action, .. } if action.contains("nothing below"));
        assert!(world.events.iter().any(stated), "{at}");
        assert_eq!(world.engine.snapshot().clearance, Clearance::Clear, "{at}");
    }
}

#[test]
fn a_drive_that_says_that_it_is_elsewhere_is_not_moved() {
    // Beyond the way of any move, also of one that was under way.
    let kinds = [FailureKind::Line, FailureKind::Blocked];
    for (by_mm, then) in [45.0, -45.0].into_iter().flat_map(|by_mm| kinds.map(|then| (by_mm, then)))
    {
        each_operation(DriveTrouble::Jumped { by_mm, then }, |world, end, context| {
            assert!(world.is_lost, "{context}");
            assert_eq!(end.clearance, Clearance::Unknown, "{context}");
            let jumped = |event: &Event| {
                matches!(event, Event::Faulted { fault: Fault::PositionJumped { .. }, .. })
            };
            assert!(world.events.iter().any(jumped), "{context}");
        });
    }
}

/// From above its clear position the way there leads down, and the position may be wrong.
#[test]
fn an_acknowledgement_moves_no_stage_that_is_not_where_its_last_moves_can_have_led() {
    let mut world = World::new(Some((30, JUMPED)));
    world.play();
    let is_jumped =
        |world: &World| matches!(world.engine.snapshot().fault, Some(Fault::PositionJumped { .. }));
    for _ in 0..3 {
        world.command(Command::Acknowledge);
        settle(&mut world, 30);
        // The world refuses every move from here on.
        assert!(world.is_lost && is_jumped(&world), "{:?}", world.engine.snapshot());
        assert_eq!(world.engine.snapshot().state, RigState::Latched);
    }
    (world.trouble, world.is_lost, world.drive) = (None, false, None);
    world.command(Command::HomeLinear);
    settle(&mut world, 30);
    assert_eq!(world.engine.snapshot().state, RigState::Idle, "{:?}", world.engine.snapshot());
}

/// A person has it homed after any fault, and the homing is broken off. The drive goes on saying that it is homed, at a place where
/// its last moves can have led it.
#[test]
fn a_homing_anew_that_is_broken_off_leaves_no_position_that_is_believed() {
    let alarmed = FailureKind::Alarmed { code: 0x66 };
    for kind in [FailureKind::Line, FailureKind::Blocked, alarmed, FailureKind::Unmoved] {
        let mut world = World::new(None);
        world.play();
        world.command(Command::Stop);
        settle(&mut world, 0);
        assert_eq!(world.engine.snapshot().state, RigState::Latched);
        world.command(Command::HomeLinear);
        let (id, operation) = world.in_flight.take().unwrap();
        assert!(matches!(operation, Operation::HomeLinear { anew: true }), "{operation:?}");
        world.fail(id, kind);
        settle(&mut world, 0);
        let Snapshot { state, clearance, jump, .. } = world.engine.snapshot();
        // One that has moved nothing leaves the position as it was.
        let is_made = kind != FailureKind::Unmoved;
        assert_eq!(jump.is_some_and(|jump| jump.is_homing_open), is_made, "{kind:?}");
        let probe = if is_made { Clearance::Unknown } else { Clearance::Clear };
        assert_eq!((state, clearance), (RigState::Latched, probe), "{kind:?}");
        let next = if is_made { Command::HomeLinear } else { Command::Acknowledge };
        world.command(next);
        settle(&mut world, 0);
        assert_eq!(world.engine.snapshot().state, RigState::Idle, "{kind:?}");
    }
}

const JUMPED: Trouble =
    Trouble::Drive(DriveTrouble::Jumped { by_mm: 45.0, then: FailureKind::Line });

/// Whatever breaks the find of an acknowledgement off, or the homing of a person. After a homing, the drive says that it is where
/// its last moves can have led it.
#[test]
fn what_is_broken_off_leaves_a_wrong_position_wrong() {
    let breaks = [
        FailureKind::Line,
        FailureKind::Refused,
        FailureKind::Blocked,
        FailureKind::Interrupted,
        FailureKind::Alarmed { code: 0x66 },
    ];
    for kind in breaks {
        for command in [Command::Acknowledge, Command::HomeLinear] {
            let context = format!("{command:?}, {kind:?}");
            let mut world = World::new(Some((30, JUMPED)));
            world.play();
            let is_homing = matches!(command, Command::HomeLinear);
            // The world refuses every move of a drive that says that it is elsewhere.
            if is_homing {
                (world.trouble, world.is_lost, world.drive) = (None, false, None);
            }
            for _ in 0..3 {
                world.command(command.clone());
                let (id, _) = world.in_flight.take().unwrap();
                world.fail(id, kind);
                let moves = |world: &World| {
                    let is_move = |event: &&Event| matches!(event, Event::LinearMoved { .. });
                    world.events.iter().filter(is_move).count()
                };
                let before = moves(&world);
                settle(&mut world, 30);
                assert_eq!(moves(&world), before, "{context}");
                let Snapshot { state, clearance, jump, .. } = world.engine.snapshot();
                assert_eq!(
                    (state, clearance),
                    (RigState::Latched, Clearance::Unknown),
                    "{context}"
                );
                assert_eq!(jump.unwrap().is_homing_open, is_homing, "{context}");
            }
            (world.trouble, world.is_lost, world.drive) = (None, false, None);
            world.command(Command::HomeLinear);
            settle(&mut world, 30);
            let snapshot = world.engine.snapshot();
            assert_eq!((snapshot.state, snapshot.jump), (RigState::Idle, None), "{context}");
        }
    }
}

/// The program was ended after it had said so, and started again.
#[test]
fn a_position_that_was_said_to_be_wrong_is_so_for_the_next_program_too() {
    let mut world = World::new(None);
    let is_jumped =
        |world: &World| matches!(world.engine.snapshot().fault, Some(Fault::PositionJumped { .. }));
    let left = |jump| LeftRig {
        message: "smoke-1 was interrupted".to_owned(),
        may_touch: true,
        was_lowered: true,
        jump,
    };
    let elsewhere = Some(Jump { last_moves: Span::new(-60.0, -50.0), is_homing_open: false });
    // It was not commissioned any more, and is.
    world.engine.latch_uncommissioned("geometry".to_owned(), elsewhere, &mut Vec::new());
    world.engine.latch_interrupted(left(elsewhere), &mut Vec::new());
    let Snapshot { state, fault, jump, .. } = world.engine.snapshot();
    assert_eq!((state, jump), (RigState::Latched, elsewhere));
    assert!(matches!(fault, Some(Fault::Interrupted(_))), "{fault:?}");
    // The way out of contact without the rest of the rig.
    let mut safe = World::new(None);
    let mut effects = Vec::new();
    safe.engine.leave_contact(safe.now, Fault::Interrupted(left(elsewhere)), &mut effects);
    safe.carry_out(effects);
    settle(&mut safe, 0);
    let jumped =
        |event: &Event| matches!(event, Event::Faulted { fault: Fault::PositionJumped { .. }, .. });
    assert!(safe.events.iter().any(jumped), "{:?}", safe.events);
    assert!(!safe.events.iter().any(|event| matches!(event, Event::LinearMoved { .. })));

    for _ in 0..3 {
        world.command(Command::Acknowledge);
        settle(&mut world, 0);
        assert!(is_jumped(&world), "{:?}", world.engine.snapshot());
        let moved = |event: &Event| matches!(event, Event::LinearMoved { .. });
        assert!(!world.events.iter().any(moved));
    }
    world.command(Command::HomeLinear);
    settle(&mut world, 0);
    assert_eq!(world.engine.snapshot().state, RigState::Idle, "{:?}", world.engine.snapshot());
}

#[test]
fn an_operation_of_the_recovery_that_never_ends_latches_the_rig() {
    let mut undisturbed = World::new(Some((30, Trouble::Stop)));
    undisturbed.play();
    for at in 31..undisturbed.operations {
        let mut world = World::new(Some((30, Trouble::Stop)));
        world.then = Some((at, Trouble::Hangs));
        world.play();
        assert_eq!(world.engine.snapshot().state, RigState::Latched);
        assert_ne!(world.engine.snapshot().clearance, Clearance::Clear);
    }
}
