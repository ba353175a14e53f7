//! A rig that is not commissioned moves by short steps that a person has confirmed, and not otherwise.

use std::time::Duration;

use rig_interlock::{Interlock, Outcome, PortCommand, Proven, Refusal, Word};
use rig_model::{Position, RigTime};

use crate::bench::{lift, limits, turn};

const NOW: RigTime = RigTime::from_micros(1_000_000);

fn up(by_mm: f64, speed_mm_per_s: f64) -> PortCommand {
    PortCommand::JogLinear { from: Position::new(20.0), is_homed: true, by_mm, speed_mm_per_s }
}

fn tilt(by_deg: f64, speed_deg_per_s: f64) -> PortCommand {
    PortCommand::JogRotary { from: Position::new(0.0), is_homed: true, by_deg, speed_deg_per_s }
}

/// The first refusal of a step that a person has confirmed.
fn confirmed(proven: Proven, step: PortCommand) -> Result<(), Refusal> {
    let mut interlock = Interlock::new(limits(), proven);
    interlock.operator(NOW, "ada", Word::ThisStep).unwrap();
    interlock.admit(NOW, &step)
}

#[test]
fn nothing_but_stops_and_short_steps_is_admitted_before_signs_and_scales_are_shown() {
    for proven in [Proven::Nothing, Proven::Signs, Proven::Scales] {
        let mut interlock = Interlock::new(limits(), proven);
        for word in [Word::Command, Word::Acknowledgement, Word::NothingBelow, Word::ThisStep] {
            interlock.operator(NOW, "ada", word).unwrap();
            for command in [
                PortCommand::FindLinear,
                PortCommand::HomeLinear,
                PortCommand::HomeRotary,
                lift(),
                turn(1.0),
            ] {
                let refusal = interlock.admit(NOW, &command).unwrap_err();
                assert!(matches!(refusal, Refusal::NotCommissioned { .. }), "{refusal}");
            }
        }
        for command in [PortCommand::Stop, PortCommand::Measure] {
            interlock.admit(NOW, &command).unwrap();
            interlock.ended(NOW, &command, &Outcome::Done);
        }
    }
}

#[test]
fn a_step_is_as_long_and_as_fast_as_what_is_shown_allows() {
    let check = |proven, step, is_admitted: bool| {
        let found = confirmed(proven, step);
        assert_eq!(found.is_ok(), is_admitted, "{proven:?} {step:?}: {found:?}");
    };
    for sign in [1.0, -1.0] {
        check(Proven::Nothing, up(sign * 0.2, 1.0), true);
        check(Proven::Nothing, up(sign * 0.201, 1.0), false);
        check(Proven::Nothing, tilt(sign, 5.0), true);
        check(Proven::Nothing, tilt(sign * 1.01, 5.0), false);
        check(Proven::Signs, up(sign * 0.2, 1.0), true);
        check(Proven::Signs, up(sign * 0.201, 1.0), false);
        check(Proven::Signs, tilt(sign * 1.01, 5.0), false);
        check(Proven::Scales, up(sign * 10.0, 1.0), true);
        check(Proven::Scales, up(sign * 10.1, 1.0), false);
        check(Proven::Scales, tilt(sign * 30.0, 5.0), true);
    }
    for speed in [1.01, 0.0, -1.0, f64::NAN] {
        check(Proven::Nothing, up(0.2, speed), false);
    }
    check(Proven::Nothing, up(f64::NAN, 1.0), false);
    check(Proven::Nothing, up(f64::INFINITY, 1.0), false);
    // A position that is known does not lead out of the travel; an unknown one says nothing.
    let below = |by_mm| PortCommand::JogLinear {
        from: Position::new(-40.0),
        is_homed: true,
        by_mm,
        speed_mm_per_s: 1.0,
    };
    check(Proven::Nothing, below(0.2), true);
    check(Proven::Signs, below(0.2), false);
    // Limits are found by a step a little beyond the travel, once scales are shown, and never towards the table.
    let near = |from, by_mm| PortCommand::JogLinear {
        from: Position::new(from),
        is_homed: true,
        by_mm,
        speed_mm_per_s: 1.0,
    };
    let travel = limits().linear.travel();
    let (low, high) = (travel.min.value(), travel.max.value());
    check(Proven::Scales, near(high - 1.0, 2.0), true);
    check(Proven::Scales, near(high - 1.0, 2.1), false);
    check(Proven::Signs, near(high, 0.1), false);
    check(Proven::Scales, near(low, -0.1), false);
    // Nor does a step lead down below the lower soft limit. One that leads up from there is admitted.
    let soft = limits().linear.soft().min.value();
    for proven in [Proven::Signs, Proven::Scales] {
        check(proven, near(soft + 0.2, -0.2), true);
        check(proven, near(soft + 0.1, -0.2), false);
        check(proven, near(soft - 0.5, -0.1), false);
        check(proven, near(soft - 0.5, 0.2), true);
    }
    let refusal = confirmed(Proven::Scales, near(soft, -0.2)).unwrap_err().to_string();
    assert!(
        refusal.ends_with("down to 0.800 mm, below the lower soft limit of 1.000 mm"),
        "{refusal}"
    );
    let high = limits().rotary.travel().max.value();
    let out = |by_deg| PortCommand::JogRotary {
        from: Position::new(high),
        is_homed: true,
        by_deg,
        speed_deg_per_s: 5.0,
    };
    check(Proven::Scales, out(3.0), true);
    check(Proven::Scales, out(3.1), false);
    // A rig in service is moved otherwise.
    check(Proven::Bench, up(0.1, 1.0), false);
}

#[test]
fn a_drive_that_does_not_know_where_its_axis_is_makes_the_shortest_steps_alone() {
    for is_homed in [false, true] {
        let linear = |by_mm| PortCommand::JogLinear {
            from: Position::new(20.0),
            is_homed,
            by_mm,
            speed_mm_per_s: 1.0,
        };
        let rotary = |by_deg| PortCommand::JogRotary {
            from: Position::new(0.0),
            is_homed,
            by_deg,
            speed_deg_per_s: 5.0,
        };
        for (short, long) in [(linear(-0.2), linear(-10.0)), (rotary(1.0), rotary(30.0))] {
            confirmed(Proven::Scales, short).unwrap();
            let found = confirmed(Proven::Scales, long);
            assert_eq!(found.is_ok(), is_homed, "{long:?}: {found:?}");
            assert!(is_homed || matches!(found, Err(Refusal::JogUnhomed { .. })), "{found:?}");
        }
    }
    // Also after a gauge has shown that shorter steps are as long as that.
    let mut interlock = Interlock::new(limits(), Proven::Signs);
    interlock.operator(NOW, "ada", Word::ThisStep).unwrap();
    interlock.admit(NOW, &up(0.2, 1.0)).unwrap();
    interlock.ended(NOW, &up(0.2, 1.0), &Outcome::Done);
    interlock.operator(NOW, "ada", Word::LinearStepSeen).unwrap();
    interlock.operator(NOW, "ada", Word::ThisStep).unwrap();
    interlock.admit(NOW, &up(2.0, 1.0)).unwrap();
    interlock.ended(NOW, &up(2.0, 1.0), &Outcome::Done);
    interlock.operator(NOW, "ada", Word::ThisStep).unwrap();
    let PortCommand::JogLinear { from, by_mm, speed_mm_per_s, .. } = up(2.0, 1.0) else { return };
    let unhomed = PortCommand::JogLinear { from, is_homed: false, by_mm, speed_mm_per_s };
    let refusal = interlock.admit(NOW, &unhomed).unwrap_err();
    assert!(
        refusal.to_string().ends_with(
            "2.000 mm is more than the 0.200 mm that are allowed while the drive says that it does not know where its axis is"
        ),
        "{refusal}"
    );
}

#[test]
fn before_the_scale_is_shown_steps_grow_only_with_what_a_gauge_has_shown() {
    let mut interlock = Interlock::new(limits(), Proven::Signs);
    let step = |interlock: &mut Interlock, step: PortCommand| {
        interlock.operator(NOW, "ada", Word::ThisStep).unwrap();
        let admitted = interlock.admit(NOW, &step);
        if admitted.is_ok() {
            interlock.ended(NOW, &step, &Outcome::Done);
        }
        admitted.is_ok()
    };
    assert!(!step(&mut interlock, up(-1.0, 1.0)));
    // A word about a step that was not made opens nothing, nor does that of the other axis.
    interlock.operator(NOW, "ada", Word::LinearStepSeen).unwrap();
    assert!(!step(&mut interlock, up(-1.0, 1.0)));
    assert!(step(&mut interlock, up(-0.2, 1.0)));
    assert!(!step(&mut interlock, up(-1.0, 1.0)), "nobody has seen it");
    interlock.operator(NOW, "ada", Word::RotaryStepSeen).unwrap();
    assert!(!step(&mut interlock, up(-1.0, 1.0)));
    interlock.operator(NOW, "ada", Word::LinearStepSeen).unwrap();
    assert!(step(&mut interlock, up(0.2, 1.0)));
    assert!(!step(&mut interlock, up(-10.0, 1.0)));
    assert!(step(&mut interlock, up(-1.0, 1.0)));
    interlock.operator(NOW, "ada", Word::LinearStepSeen).unwrap();
    assert!(step(&mut interlock, up(-10.0, 1.0)) && !step(&mut interlock, up(-10.1, 1.0)));
    assert!(step(&mut interlock, tilt(1.0, 5.0)) && !step(&mut interlock, tilt(5.0, 5.0)));
}

#[test]
fn each_step_needs_a_word_of_its_own_which_grows_old_and_ends_with_a_stop() {
    let mut interlock = Interlock::new(limits(), Proven::Nothing);
    let refused = |interlock: &mut Interlock, at: RigTime| {
        let refusal = interlock.admit(at, &up(0.1, 1.0)).unwrap_err();
        assert!(matches!(refusal, Refusal::StepUnconfirmed { .. }), "{refusal}");
    };
    refused(&mut interlock, NOW);
    interlock.operator(NOW, "ada", Word::ThisStep).unwrap();
    interlock.admit(NOW, &up(0.1, 1.0)).unwrap();
    // One step at a time.
    let busy = interlock.admit(NOW, &tilt(0.1, 1.0)).unwrap_err();
    assert!(matches!(busy, Refusal::PortBusy { .. }), "{busy}");
    interlock.ended(NOW, &up(0.1, 1.0), &Outcome::Done);
    refused(&mut interlock, NOW);
    interlock.operator(NOW, "ada", Word::ThisStep).unwrap();
    refused(&mut interlock, RigTime::from_micros(62_000_000));
    interlock.stop_asked(NOW, Duration::ZERO);
    refused(&mut interlock, NOW);
    assert!(interlock.operator(NOW, " ", Word::ThisStep).is_err());
    // A step that failed does not keep a person from the next one.
    interlock.operator(NOW, "ada", Word::ThisStep).unwrap();
    interlock.admit(NOW, &up(0.1, 1.0)).unwrap();
    interlock.ended(NOW, &up(0.1, 1.0), &Outcome::Failed);
    interlock.operator(NOW, "ada", Word::ThisStep).unwrap();
    interlock.admit(NOW, &up(-0.1, 1.0)).unwrap();
}

#[test]
fn a_drive_is_written_to_and_homed_only_after_its_scale_is_shown() {
    for (proven, is_admitted) in [
        (Proven::Nothing, false),
        (Proven::Signs, false),
        (Proven::Scales, true),
        (Proven::Bench, false),
    ] {
        for command in [
            PortCommand::ClearLinear,
            PortCommand::ClearRotary,
            PortCommand::SeekLinear,
            PortCommand::SeekRotary,
        ] {
            assert_eq!(confirmed(proven, command).is_ok(), is_admitted, "{proven:?} {command:?}");
        }
    }
    // Each homing needs a word of its own.
    let mut interlock = Interlock::new(limits(), Proven::Scales);
    interlock.operator(NOW, "ada", Word::ThisStep).unwrap();
    interlock.admit(NOW, &PortCommand::SeekRotary).unwrap();
    interlock.ended(NOW, &PortCommand::SeekRotary, &Outcome::Done);
    let refusal = interlock.admit(NOW, &PortCommand::SeekRotary).unwrap_err();
    assert!(matches!(refusal, Refusal::StepUnconfirmed { .. }), "{refusal}");
    interlock.admit(NOW, &PortCommand::ClearRotary).unwrap();
}

#[test]
fn a_rig_that_is_shown_to_be_as_described_moves_as_any_other() {
    let mut interlock = Interlock::new(limits(), Proven::Nothing);
    interlock.prove(Proven::Bench);
    interlock.admit(NOW, &PortCommand::FindLinear).unwrap();
}
