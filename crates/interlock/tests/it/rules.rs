//! Each rule of the interlock alone: refused commands, and admitted ones close to them.

use std::time::Duration;

use rig_interlock::{Interlock, Outcome, PortCommand, Refusal, Word};
use rig_model::{Position, RigTime};

use crate::bench::{
    FLOOR_MM, REST_MM, fresh, lift, linear_at, lower, prepared, prepared_with_pin, rotary_at, turn,
};

const NOW: RigTime = RigTime::from_micros(1_000_000);

#[track_caller]
fn refused(interlock: &mut Interlock, command: PortCommand) -> Refusal {
    let before = interlock.clone();
    let refusal = interlock.admit(NOW, &command).expect_err("it must be refused");
    assert_eq!(*interlock, before, "a refusal changes nothing");
    refusal
}

#[track_caller]
fn admitted(interlock: &mut Interlock, command: PortCommand, outcome: Outcome) {
    interlock.admit(NOW, &command).unwrap();
    interlock.ended(NOW, &command, &outcome);
}

#[test]
fn the_sample_turns_only_under_a_probe_that_was_read_back_clear() {
    let mut interlock = prepared(NOW);
    admitted(&mut interlock, turn(30.0), rotary_at(30.0));
    interlock.intent_is_durable(Position::new(9.5));
    admitted(&mut interlock, lower(20.0), linear_at(20.0));
    assert!(matches!(refused(&mut interlock, turn(0.0)), Refusal::NotClear { .. }));
    assert!(matches!(refused(&mut interlock, PortCommand::HomeRotary), Refusal::NotClear { .. }));
    // A retract that ends elsewhere proves nothing of a homing, which may turn anywhere.
    admitted(&mut interlock, lift(), linear_at(REST_MM - 0.02));
    assert!(matches!(refused(&mut interlock, PortCommand::HomeRotary), Refusal::NotClear { .. }));
    admitted(&mut interlock, lift(), linear_at(REST_MM));
    admitted(&mut interlock, turn(0.0), rotary_at(0.0));
}

#[test]
fn below_the_clear_position_the_sample_turns_as_far_as_its_edges_stay_below_the_probe() {
    // The edge 20 mm beside the pivot and 0.5 mm above it, and 0.5 mm of room. A read-back is off by 0.05° at
    // most, and the stage by as much again from a target.
    let edge_mm = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        10.0 + 0.5 * cos + 20.0 * sin
    };
    for (from, to, steepest) in
        [(0.0, 15.0, 15.1), (15.0, -30.0, 30.1), (-30.0, 10.0, 30.05), (45.0, 0.0, 45.05)]
    {
        let mut interlock = prepared(NOW);
        admitted(&mut interlock, turn(from), rotary_at(from));
        interlock.intent_is_durable(Position::new(1.0));
        let clear_mm = edge_mm(steepest) + 0.5;
        admitted(&mut interlock, lower(clear_mm - 0.011), linear_at(clear_mm - 0.011));
        assert!(matches!(refused(&mut interlock, turn(to)), Refusal::NotClear { .. }), "{to}");
        admitted(&mut interlock, lower(clear_mm), linear_at(clear_mm));
        assert!(matches!(
            refused(&mut interlock, PortCommand::HomeRotary),
            Refusal::NotClear { .. }
        ));
        let later = NOW + Duration::from_secs(61);
        assert!(
            interlock.needs_reading(later, &turn(to)) && !interlock.needs_reading(NOW, &turn(to))
        );
        admitted(&mut interlock, turn(to), rotary_at(to));
        // The intent was for the tilt before.
        assert!(matches!(refused(&mut interlock, lower(clear_mm - 1.0)), Refusal::NoIntent { .. }));
        // Nobody knows where a turn that failed has ended.
        admitted(&mut interlock, turn(to), Outcome::Failed);
        interlock.operator(NOW, "somebody", Word::Acknowledgement).unwrap();
        interlock.read(NOW, &linear_at(clear_mm));
        let refusal = interlock.admit(NOW, &turn(to)).unwrap_err();
        let is_refused =
            matches!(refusal, Refusal::NotClear { .. } | Refusal::NotIdentified { .. });
        assert!(is_refused, "{refusal}");
    }
}

#[test]
fn an_old_proof_of_a_clear_probe_must_be_read_anew() {
    let mut interlock = prepared(NOW);
    let later = NOW + Duration::from_secs(61);
    assert!(!interlock.needs_reading(NOW, &turn(30.0)));
    assert!(interlock.needs_reading(later, &turn(30.0)));
    let refusal = interlock.admit(later, &turn(30.0)).unwrap_err();
    assert!(matches!(refusal, Refusal::ClearIsOld { .. }), "{refusal}");
    let mut moved = interlock.clone();
    moved.read(later, &linear_at(20.0));
    assert!(matches!(moved.admit(later, &turn(30.0)), Err(Refusal::NotClear { .. })));
    interlock.read(later, &linear_at(REST_MM));
    interlock.admit(later, &turn(30.0)).unwrap();
}

#[test]
fn the_floor_follows_from_geometry_and_the_deepest_indentation_whatever_was_declared() {
    let mut interlock = prepared(NOW);
    interlock.intent_is_durable(Position::new(1.0));
    admitted(&mut interlock, lower(10.0), linear_at(10.0));
    assert!(matches!(refused(&mut interlock, lower(FLOOR_MM - 0.001)), Refusal::BelowFloor { .. }));
    admitted(&mut interlock, lower(FLOOR_MM), linear_at(FLOOR_MM));
    // At a tilt the surface lies elsewhere: the ball of 0.5 mm touches at 0.5 / cos 45° − 0.5
    // above.
    admitted(&mut interlock, lift(), linear_at(REST_MM));
    admitted(&mut interlock, turn(45.0), rotary_at(45.0));
    interlock.intent_is_durable(Position::new(1.0));
    let (cos, deepest_mm) = (0.5_f64.sqrt(), 0.6);
    let floor_mm = 10.0 + 0.5 / cos - 0.5 - 0.5 / cos - deepest_mm;
    admitted(&mut interlock, lower(10.2), linear_at(10.2));
    assert!(matches!(refused(&mut interlock, lower(floor_mm - 0.001)), Refusal::BelowFloor { .. }));
    admitted(&mut interlock, lower(floor_mm + 0.001), linear_at(floor_mm));
}

#[test]
fn the_floor_above_a_pin_follows_its_slope() {
    let mut interlock = prepared_with_pin(NOW, 2.0);
    admitted(&mut interlock, turn(45.0), rotary_at(45.0));
    interlock.intent_is_durable(Position::new(1.0));
    // The top of the pin is at the height of the rotary axis, its axis 2 mm below. Both are turned by 45°, and the centre of
    // the ball of 0.5 mm on the vertical through the rotary axis is 2.5 mm from that of the pin.
    let aside_mm = 2.0 * 0.5_f64.sqrt();
    let tip_mm = 10.0 - aside_mm + (2.5_f64.powi(2) - aside_mm.powi(2)).sqrt() - 0.5;
    let tolerance_mm = 0.5 / 0.5_f64.sqrt();
    let floor_mm = tip_mm - tolerance_mm - 0.6;
    admitted(&mut interlock, lower(10.1), linear_at(10.1));
    assert!(matches!(refused(&mut interlock, lower(floor_mm - 0.001)), Refusal::BelowFloor { .. }));
    admitted(&mut interlock, lower(floor_mm + 0.001), linear_at(floor_mm));
}

#[test]
fn near_the_sample_the_probe_goes_slowly_and_in_short_steps() {
    let mut interlock = prepared(NOW);
    interlock.intent_is_durable(Position::new(1.0));
    let fast = |mm| PortCommand::MoveLinear { to: Position::new(mm), speed_mm_per_s: 10.0 };
    let too_fast = |mm| PortCommand::MoveLinear { to: Position::new(mm), speed_mm_per_s: 10.1 };
    assert!(matches!(refused(&mut interlock, too_fast(20.0)), Refusal::TooFast { .. }));
    assert!(matches!(refused(&mut interlock, fast(f64::NAN)), Refusal::NoIntent { .. }));
    // 0.5 mm above the expected surface a sample may begin.
    admitted(&mut interlock, fast(10.5), linear_at(10.5));
    assert!(matches!(refused(&mut interlock, fast(10.4)), Refusal::TooFast { .. }));
    let stopped = PortCommand::MoveLinear { to: Position::new(10.4), speed_mm_per_s: 0.0 };
    assert!(matches!(refused(&mut interlock, stopped), Refusal::TooFast { .. }));
    // 1.6 mm below is the floor; no step is longer than tolerance and indentation, 1.1 mm.
    assert!(matches!(refused(&mut interlock, lower(9.39)), Refusal::StepTooLong { .. }));
    admitted(&mut interlock, lower(9.41), linear_at(9.41));
    // Up again at any speed.
    admitted(&mut interlock, fast(9.8), linear_at(9.8));
    let spinning = PortCommand::MoveRotary { to: Position::new(9.0), speed_deg_per_s: 20.1 };
    admitted(&mut interlock, lift(), linear_at(REST_MM));
    assert!(matches!(refused(&mut interlock, spinning), Refusal::TooFast { .. }));
}

#[test]
fn readings_stream_only_while_nothing_moves_or_the_probe_goes_down_slowly() {
    let mut interlock = prepared(NOW);
    let descend =
        |mm, speed_mm_per_s| PortCommand::Descend { to: Position::new(mm), speed_mm_per_s };
    assert!(matches!(refused(&mut interlock, descend(10.0, 1.0)), Refusal::NoIntent { .. }));
    interlock.intent_is_durable(Position::new(1.0));
    assert!(matches!(refused(&mut interlock, descend(10.0, 1.01)), Refusal::TooFast { .. }));
    assert!(matches!(
        refused(&mut interlock, descend(FLOOR_MM - 0.001, 1.0)),
        Refusal::BelowFloor { .. }
    ));
    for (going, is_allowed) in [(descend(9.41, 1.0), true), (lower(20.0), false)] {
        let mut interlock = interlock.clone();
        interlock.admit(NOW, &going).unwrap();
        assert!(matches!(refused(&mut interlock, PortCommand::Measure), Refusal::Moving { .. }));
        assert_eq!(interlock.admit(NOW, &PortCommand::Stream).is_ok(), is_allowed);
        // One at a time.
        assert!(interlock.admit(NOW, &PortCommand::Stream).is_err());
        assert!(matches!(refused(&mut interlock, lower(20.0)), Refusal::PortBusy { .. }));
    }
    admitted(&mut interlock, PortCommand::Stream, Outcome::Interrupted);
}

#[test]
fn the_probe_goes_down_only_as_far_as_a_durable_intent() {
    let mut interlock = prepared(NOW);
    assert!(matches!(refused(&mut interlock, lower(20.0)), Refusal::NoIntent { .. }));
    interlock.intent_is_durable(Position::new(15.0));
    assert!(matches!(refused(&mut interlock, lower(14.9)), Refusal::NoIntent { .. }));
    admitted(&mut interlock, lower(15.0), linear_at(15.0));
    // It ends when the probe is clear again.
    admitted(&mut interlock, lift(), linear_at(REST_MM));
    assert!(matches!(refused(&mut interlock, lower(20.0)), Refusal::NoIntent { .. }));
}

#[test]
fn an_axis_moves_only_after_it_was_identified() {
    let mut interlock = fresh();
    interlock.intent_is_durable(Position::new(9.5));
    for command in [lift(), lower(20.0), turn(30.0)] {
        assert!(matches!(refused(&mut interlock, command), Refusal::NotIdentified { .. }));
    }
    admitted(&mut interlock, PortCommand::FindLinear, linear_at(49.0));
    assert!(matches!(refused(&mut interlock, turn(30.0)), Refusal::NotIdentified { .. }));
    admitted(&mut interlock, lift(), linear_at(REST_MM));
    admitted(&mut interlock, PortCommand::HomeRotary, rotary_at(0.0));
    // After a failure it is in doubt again, and only the retract needs no new identity.
    for (failing, next) in [(lower(20.0), lower(19.0)), (turn(10.0), turn(20.0))] {
        let mut interlock = prepared(NOW);
        interlock.intent_is_durable(Position::new(9.5));
        admitted(&mut interlock, failing, Outcome::Failed);
        interlock.operator(NOW, "somebody", Word::Acknowledgement).unwrap();
        admitted(&mut interlock, lift(), linear_at(REST_MM));
        interlock.intent_is_durable(Position::new(9.5));
        assert!(matches!(refused(&mut interlock, next), Refusal::NotIdentified { .. }));
    }
}

#[test]
fn after_a_fault_only_the_way_out_is_open_until_a_person_acknowledges() {
    let faults: [fn(&mut Interlock); 2] = [Interlock::latched, |interlock| {
        admitted(interlock, PortCommand::Measure, Outcome::Failed);
    }];
    for fault in faults {
        let mut interlock = prepared(NOW);
        interlock.intent_is_durable(Position::new(9.5));
        admitted(&mut interlock, lower(20.0), linear_at(20.0));
        fault(&mut interlock);
        for command in
            [lower(19.0), PortCommand::Measure, PortCommand::HomeLinear, PortCommand::HomeRotary]
        {
            assert!(matches!(refused(&mut interlock, command), Refusal::Latched { .. }));
        }
        admitted(&mut interlock, PortCommand::Stop, Outcome::Done);
        admitted(&mut interlock, PortCommand::FindLinear, linear_at(20.0));
        admitted(&mut interlock, lift(), linear_at(REST_MM));
        assert!(matches!(refused(&mut interlock, turn(0.0)), Refusal::Latched { .. }));
        assert!(interlock.is_latched());
        // Any other command of a person does not open it.
        interlock.operator(NOW, "somebody", Word::Command).unwrap();
        assert!(matches!(refused(&mut interlock, turn(0.0)), Refusal::Latched { .. }));
        interlock.operator(NOW, "somebody", Word::Acknowledgement).unwrap();
        admitted(&mut interlock, turn(0.0), rotary_at(0.0));
    }
}

#[test]
fn a_way_out_leads_up_or_nowhere() {
    let to = |mm| PortCommand::MoveLinear { to: Position::new(mm), speed_mm_per_s: 1.0 };
    let mut interlock = prepared(NOW);
    admitted(&mut interlock, to(45.0), linear_at(45.0));
    interlock.latched();
    assert!(matches!(refused(&mut interlock, lift()), Refusal::Latched { .. }));
    admitted(&mut interlock, to(45.0), linear_at(45.0));
    admitted(&mut interlock, to(46.0), linear_at(46.0));
    // A stage whose position is not known may be below.
    interlock.admit(NOW, &to(46.0)).unwrap();
    interlock.ended(NOW, &to(46.0), &Outcome::Failed);
    admitted(&mut interlock, lift(), linear_at(REST_MM));
    interlock.operator(NOW, "somebody", Word::Acknowledgement).unwrap();
    admitted(&mut interlock, PortCommand::FindLinear, linear_at(45.0));
    admitted(&mut interlock, lift(), linear_at(REST_MM));
}

#[test]
fn after_a_stop_nothing_goes_on_before_the_probe_is_clear() {
    let mut interlock = prepared(NOW);
    interlock.intent_is_durable(Position::new(9.5));
    admitted(&mut interlock, lower(20.0), linear_at(20.0));
    interlock.stop_asked(NOW, Duration::ZERO);
    assert!(matches!(refused(&mut interlock, lower(19.0)), Refusal::Stopping { .. }));
    assert!(matches!(refused(&mut interlock, PortCommand::Measure), Refusal::Stopping { .. }));
    admitted(&mut interlock, PortCommand::Stop, Outcome::Done);
    admitted(&mut interlock, lift(), linear_at(REST_MM));
    admitted(&mut interlock, PortCommand::Measure, Outcome::Done);
}

/// The acknowledgement would have counted once the retract had ended.
#[test]
fn a_stop_takes_back_an_acknowledgement_that_came_before_it() {
    let mut interlock = prepared(NOW);
    interlock.intent_is_durable(Position::new(9.5));
    admitted(&mut interlock, lower(20.0), linear_at(20.0));
    interlock.stop_asked(NOW, Duration::ZERO);
    interlock.admit(NOW, &lift()).unwrap();
    interlock.operator(NOW, "somebody", Word::Acknowledgement).unwrap();
    interlock.stop_asked(NOW, Duration::ZERO);
    interlock.ended(NOW, &lift(), &linear_at(21.0));
    assert!(matches!(refused(&mut interlock, lower(19.0)), Refusal::Stopping { .. }));
    admitted(&mut interlock, lift(), linear_at(REST_MM));
    admitted(&mut interlock, PortCommand::Measure, Outcome::Done);
}

#[test]
fn an_acknowledgement_covers_no_later_fault() {
    let mut interlock = prepared(NOW);
    interlock.intent_is_durable(Position::new(9.5));
    admitted(&mut interlock, lower(20.0), linear_at(20.0));
    interlock.admit(NOW, &lift()).unwrap();
    interlock.operator(NOW, "somebody", Word::Acknowledgement).unwrap();
    interlock.latched();
    interlock.ended(NOW, &lift(), &linear_at(REST_MM));
    assert!(matches!(refused(&mut interlock, turn(0.0)), Refusal::Latched { .. }));
    interlock.operator(NOW, "somebody", Word::Acknowledgement).unwrap();
    admitted(&mut interlock, turn(0.0), rotary_at(0.0));
}

#[test]
fn a_stop_that_is_sent_late_is_told() {
    let mut interlock = prepared(NOW);
    for (ms, is_late) in [(0, false), (100, false), (101, true)] {
        interlock.stop_asked(NOW, Duration::ZERO);
        let late = interlock.stop_sent(NOW + Duration::from_millis(ms));
        assert_eq!(late.is_some(), is_late, "{ms} ms");
        assert_eq!(interlock.stop_sent(NOW + Duration::from_secs(9)), None, "it was sent");
    }
}

#[test]
fn a_port_has_one_command_at_a_time_and_a_measurement_has_axes_that_stand_still() {
    let mut interlock = prepared(NOW);
    interlock.admit(NOW, &turn(30.0)).unwrap();
    assert!(matches!(refused(&mut interlock, PortCommand::Stop), Refusal::PortBusy { .. }));
    assert!(matches!(refused(&mut interlock, PortCommand::Measure), Refusal::Moving { .. }));
    interlock.ended(NOW, &turn(30.0), &rotary_at(30.0));
    interlock.admit(NOW, &PortCommand::Measure).unwrap();
    assert!(matches!(refused(&mut interlock, PortCommand::Measure), Refusal::PortBusy { .. }));
    // The way out does not wait for the analyzer.
    admitted(&mut interlock, lift(), linear_at(REST_MM));
}

#[test]
fn the_linear_stage_is_homed_only_after_a_person_has_stated_that_nothing_is_below_the_probe() {
    let home = PortCommand::HomeLinear;
    for mut interlock in [fresh(), prepared(NOW)] {
        // Neither a new program nor a clear probe proves it.
        assert_eq!(refused(&mut interlock, home), Refusal::HomingUnproven);
        interlock.operator(NOW, "somebody", Word::Acknowledgement).unwrap();
        assert_eq!(refused(&mut interlock, home), Refusal::HomingUnproven);
        // The statement holds for one homing, also after a fault in contact.
        interlock.latched();
        interlock.operator(NOW, "somebody", Word::NothingBelow).unwrap();
        admitted(&mut interlock, home, linear_at(49.0));
        assert_eq!(refused(&mut interlock, home), Refusal::HomingUnproven);
        // It ends with any other command to the stage, with a stop, and after a minute.
        let state = |interlock: &mut Interlock| {
            interlock.operator(NOW, "somebody", Word::NothingBelow).unwrap();
        };
        state(&mut interlock);
        admitted(&mut interlock, lift(), linear_at(REST_MM));
        assert_eq!(refused(&mut interlock, home), Refusal::HomingUnproven);
        state(&mut interlock);
        interlock.stop_asked(NOW, Duration::ZERO);
        admitted(&mut interlock, PortCommand::Stop, Outcome::Done);
        interlock.read(NOW, &linear_at(REST_MM));
        assert_eq!(refused(&mut interlock, home), Refusal::HomingUnproven);
        state(&mut interlock);
        let late = interlock.admit(NOW + Duration::from_secs(61), &home);
        assert_eq!(late, Err(Refusal::HomingUnproven));
        interlock.admit(NOW + Duration::from_secs(60), &home).unwrap();
    }
}

#[test]
fn every_command_has_a_name_behind_it() {
    let mut interlock = prepared(NOW);
    interlock.latched();
    assert_eq!(interlock.operator(NOW, " ", Word::Acknowledgement), Err(Refusal::Anonymous));
    assert!(interlock.is_latched());
}

#[test]
fn an_old_tilt_must_be_read_anew_before_the_way_down_and_never_on_the_way_up() {
    let mut interlock = prepared(NOW);
    interlock.intent_is_durable(Position::new(9.5));
    let later = NOW + Duration::from_secs(61);
    assert!(!interlock.needs_tilt(NOW, &lower(20.0)));
    assert!(interlock.needs_tilt(later, &lower(20.0)));
    assert!(!interlock.needs_tilt(later, &lift()));
    let refusal = interlock.admit(later, &lower(20.0)).unwrap_err();
    assert!(matches!(refusal, Refusal::TiltIsOld { .. }), "{refusal}");
    interlock.clone().admit(later, &lift()).unwrap();
    interlock.read(later, &rotary_at(0.0));
    interlock.admit(later, &lower(20.0)).unwrap();
}

#[test]
fn the_probe_goes_down_only_while_the_rotary_stage_is_known() {
    let mut interlock = prepared(NOW);
    admitted(&mut interlock, turn(30.0), Outcome::Failed);
    interlock.operator(NOW, "somebody", Word::Acknowledgement).unwrap();
    interlock.read(NOW, &rotary_at(30.0));
    interlock.intent_is_durable(Position::new(9.5));
    assert!(matches!(refused(&mut interlock, lower(20.0)), Refusal::NotIdentified { .. }));
    admitted(&mut interlock, lift(), linear_at(REST_MM));
    admitted(&mut interlock, PortCommand::HomeRotary, rotary_at(0.0));
    interlock.intent_is_durable(Position::new(9.5));
    admitted(&mut interlock, lower(20.0), linear_at(20.0));
}

/// The clock of the caller stands still while a computer sleeps.
#[test]
fn what_was_read_or_stated_before_the_computer_was_held_up_is_older() {
    let minute = Duration::from_secs(61);
    let mut interlock = prepared(NOW);
    interlock.operator(NOW, "somebody", Word::NothingBelow).unwrap();
    interlock.held_up(minute);
    assert!(interlock.needs_reading(NOW, &turn(30.0)));
    assert!(matches!(refused(&mut interlock, turn(30.0)), Refusal::ClearIsOld { .. }));
    assert!(matches!(refused(&mut interlock, PortCommand::HomeLinear), Refusal::HomingUnproven));
    interlock.read(NOW, &linear_at(REST_MM));
    admitted(&mut interlock, turn(30.0), rotary_at(30.0));
    interlock.stop_asked(NOW, Duration::ZERO);
    interlock.held_up(minute);
    assert!(interlock.stop_sent(NOW).is_some());
    interlock.stop_asked(NOW, Duration::from_millis(101));
    assert!(interlock.stop_sent(NOW).is_some(), "it had waited");
}
