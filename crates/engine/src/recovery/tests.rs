use super::*;
use crate::interlock::bench::limits;

#[test]
fn a_drive_that_fails_in_each_move_and_is_well_in_between_is_not_moved_without_end() {
    let up = limits().linear.rest_target();
    for failing in [RecoveryReport::Alarmed(0x30), RecoveryReport::Lost] {
        let (now, patience) = (RigTime::ZERO, Duration::from_secs(60));
        let (mut recovery, mut step) = Recovery::begin(now, patience, RecoveryReport::Done);
        let (mut retracts, mut steps) = (0, 0);
        while !matches!(step, RecoveryStep::Finished(_)) {
            let report = match step {
                RecoveryStep::Retract(_) => {
                    retracts += 1;
                    failing
                }
                _ => RecoveryReport::Done,
            };
            step = recovery.ended(now, report, (Clearance::Unknown, false), up);
            steps += 1;
            assert!(steps < 50, "{failing:?}: no end");
        }
        assert_eq!(step, RecoveryStep::Finished(Clearance::Unknown));
        assert_eq!(retracts, 5, "{failing:?}");
        assert!(!recovery.is_worth_trying());
    }
}

/// A rotary drive that does not answer its stop hides where the linear stage was read back.
#[test]
fn a_stage_whose_stop_was_not_read_back_is_found_before_it_moves() {
    let silent =
        Failure { device: Device::RotaryStage, kind: FailureKind::Line, detail: String::new() };
    let report = RecoveryReport::of_result(&Err(Fault::Device(silent)));
    for cause in [RecoveryReport::Blocked, RecoveryReport::Done, RecoveryReport::Unready] {
        let (now, up) = (RigTime::ZERO, limits().linear.rest_target());
        let (mut recovery, _) = Recovery::begin(now, Duration::from_secs(60), cause);
        let step = recovery.ended(now, report, (Clearance::Unknown, false), up);
        let find = Operation::FindLinear { may_reset_alarm: false };
        assert_eq!(step, RecoveryStep::Do(find), "{cause:?}");
        // One that fails elsewhere again is not moved either.
        let step = recovery.ended(now, report, (Clearance::Unknown, false), up);
        assert!(matches!(step, RecoveryStep::Wait(_)), "{cause:?}: {step:?}");
    }
}

/// A line that breaks in the reset of an alarm leaves it to be reset, and one that always breaks there has an end.
#[test]
fn a_reset_whose_end_is_not_heard_is_made_again_three_times() {
    for unheard in [1, UNHEARD_RESETS_MAX, u32::MAX] {
        let up = limits().linear.rest_target();
        let (mut now, patience) = (RigTime::ZERO, Duration::from_secs(3600));
        let cause = RecoveryReport::Alarmed(0x30);
        let (mut recovery, mut step) = Recovery::begin(now, patience, cause);
        let (mut resets, mut steps) = (0, 0);
        while !matches!(step, RecoveryStep::Finished(_)) {
            let (report, clearance) = match step {
                RecoveryStep::Wait(pause) => {
                    now = now + pause;
                    step = recovery.waited();
                    continue;
                }
                RecoveryStep::Do(Operation::FindLinear { may_reset_alarm: true }) => {
                    resets += 1;
                    let is_heard = unheard < resets;
                    let report =
                        if is_heard { RecoveryReport::Done } else { RecoveryReport::Unready };
                    (report, Clearance::Unknown)
                }
                RecoveryStep::Retract(_) => (RecoveryReport::Done, Clearance::Clear),
                RecoveryStep::Do(Operation::StopMotion) => {
                    (RecoveryReport::Done, Clearance::Unknown)
                }
                RecoveryStep::Do(_) => (cause, Clearance::Unknown),
                RecoveryStep::Finished(_) => unreachable!(),
            };
            step = recovery.ended(now, report, (clearance, false), up);
            steps += 1;
            assert!(steps < 5000, "no end");
        }
        let is_out = step == RecoveryStep::Finished(Clearance::Clear);
        let expected = unheard.min(UNHEARD_RESETS_MAX) + 1;
        assert_eq!((resets, is_out), (expected, unheard < u32::MAX));
    }
}

/// Nor in the attempts of a latched rig.
#[test]
fn a_drive_that_never_ends_its_homing_is_not_homed_without_end() {
    let up = limits().linear.rest_target();
    let (mut now, patience) = (RigTime::ZERO, Duration::from_secs(3600));
    let (mut recovery, mut step) = Recovery::begin(now, patience, RecoveryReport::Done);
    let (mut homings, mut attempts) = (0, 0);
    for _ in 0..200 {
        let report = match step {
            RecoveryStep::Wait(pause) => {
                now = now + pause;
                step = recovery.waited();
                continue;
            }
            RecoveryStep::Finished(_) => {
                attempts += 1;
                step = recovery.again(now);
                continue;
            }
            RecoveryStep::Do(Operation::HomeUpwards) => {
                homings += 1;
                RecoveryReport::Unready
            }
            RecoveryStep::Do(_) => RecoveryReport::Unhomed,
            RecoveryStep::Retract(_) => panic!("a stage without a position is moved"),
        };
        step = recovery.ended(now, report, (Clearance::Unknown, false), up);
    }
    assert_eq!(homings, HOMINGS_MAX);
    assert!(attempts > 10 && !recovery.is_worth_trying(), "{attempts}");
}

/// A rotary stage that was to turn and did not answer the stop: it gets it again once the probe is clear, and before each
/// pause in which the linear stage is waited for, and later in the attempts of a latched rig.
#[test]
fn a_rotary_stage_that_does_not_answer_is_stopped_again() {
    let up = limits().linear.rest_target();
    for (is_linear_ready, answers_at) in [(true, 2), (true, 100), (false, 2), (false, 100)] {
        let mut now = RigTime::ZERO;
        let patience = Duration::from_secs(60);
        let (mut recovery, mut step) = Recovery::begin(now, patience, RecoveryReport::Unread);
        let (mut stops, mut retracts, mut steps) = (0, 0, 0);
        while !matches!(step, RecoveryStep::Finished(_)) {
            steps += 1;
            assert!(steps < 200, "no end");
            let (report, clearance) = match step {
                RecoveryStep::Wait(pause) => {
                    now = now + pause;
                    step = recovery.waited();
                    continue;
                }
                RecoveryStep::Do(Operation::StopRotary) => {
                    stops += 1;
                    (RecoveryReport::Unread, Clearance::Unknown)
                }
                RecoveryStep::Retract(_) => {
                    retracts += 1;
                    (RecoveryReport::Done, Clearance::Clear)
                }
                RecoveryStep::Do(Operation::FindLinear { .. }) if !is_linear_ready => {
                    (RecoveryReport::Unready, Clearance::Unknown)
                }
                RecoveryStep::Do(Operation::FindLinear { .. }) => {
                    (RecoveryReport::Done, Clearance::Unknown)
                }
                _ => (RecoveryReport::Unread, Clearance::Unknown),
            };
            let may_turn = stops < answers_at;
            step = recovery.ended(now, report, (clearance, may_turn), up);
        }
        let told = format!("{is_linear_ready}, {answers_at}: {stops} stops, {retracts} retracts");
        let most = answers_at.min(1 + ROTARY_STOPS_MAX - u32::from(answers_at > 8));
        assert_eq!((stops, retracts), (most, u32::from(is_linear_ready)), "{told}");
        let is_open = !is_linear_ready || answers_at > 8;
        assert_eq!(recovery.is_worth_trying(), is_open, "{told}");
        // The linear stage is not moved again because of the rotary one.
        let next = is_open.then(|| recovery.again(now));
        let expected = is_open.then_some(RecoveryStep::Do(if is_linear_ready {
            Operation::StopRotary
        } else {
            Operation::FindLinear { may_reset_alarm: false }
        }));
        assert_eq!(next, expected, "{told}");
    }
}

/// Long before the patience is over, and the attempts of a latched rig do not follow.
#[test]
fn a_stage_that_is_blocked_is_retracted_three_times_and_then_left() {
    let up = limits().linear.rest_target();
    let (mut now, patience) = (RigTime::ZERO, Duration::from_secs(3600));
    let (mut recovery, mut step) = Recovery::begin(now, patience, RecoveryReport::Done);
    let (mut retracts, mut steps) = (0, 0);
    while !matches!(step, RecoveryStep::Finished(_)) {
        let report = match step {
            RecoveryStep::Wait(pause) => {
                now = now + pause;
                step = recovery.waited();
                continue;
            }
            RecoveryStep::Retract(_) => {
                retracts += 1;
                RecoveryReport::Blocked
            }
            _ => RecoveryReport::Done,
        };
        step = recovery.ended(now, report, (Clearance::Unknown, false), up);
        steps += 1;
        assert!(steps < 50, "no end");
    }
    assert_eq!((step, retracts), (RecoveryStep::Finished(Clearance::Unknown), 3));
    assert!(!recovery.is_worth_trying());
}
