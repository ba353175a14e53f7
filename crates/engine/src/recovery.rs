//! The way out of contact after a fault or an abort: stop, retract, and prove that the probe is clear.
//!
//! ```text
//!          alarm, position lost, or
//!          not where it can be
//!        ┌───────────────────────────┐            ┌──────────────┐ not yet clear
//!        │                           ▼            ▼              │
//!  ┌──────┐  ┌────────────┐  ┌──────────────┐  ┌─────────────┐   │
//!  │ Stop │─▶│ Retract    │  │ Find again   │─▶│ Retract     │─▶─┤
//!  └──────┘  └────────────┘  └──────────────┘  └─────────────┘   │ clear
//!                 │ ▲           ▲      │ not ready, alarm         ▼
//!                 ▼ │           │      ▼                      finished
//!               finished       ┌──────────┐ patience is over
//!                              │ Wait     │─────────────────▶ finished, not clear
//!                              └──────────┘                   (tried again: engine/attempts.rs)
//! ```
//!
//! A drive that does not answer, or refuses a request, is asked again until the patience of the rig file is
//! over. When it answers, it is identified again and then moved. An alarm is reset once, and one other alarm
//! that comes after it; a reset whose end was not heard does not count, a few times. A drive whose emergency
//! stop is pressed is not moved again: nothing may move when the button is released. A stage that moved and is
//! not clear after a few retracts, or that does not know its position and has no safe way to find it, is not
//! moved again. Nothing moves before the stage was read back, at its stop or found again, where its last moves
//! can have led it. A probe above its clear position stays there: a way out goes up or nowhere. A stage that is
//! found without its position is homed first, if that leads away from the sample.
//!
//! A rotary stage that was to turn, and has not answered the stop, gets it again: whenever the linear stage is waited for, and
//! once the probe is clear. The retract never waits for it.
//!
//! It also prepares the rig: it finds the linear stage, moves the probe clear, and homes the rotary stage
//! if it is not homed. A linear stage that has lost its position is homed in an unknown direction only
//! after a person has stated that nothing is below the probe.

#[cfg(test)]
mod tests;

use std::time::Duration;

use rig_model::{Clearance, Mm, RigLimits, RigTime, Target};

use crate::{Device, Failure, FailureKind, Operation, Report, fault::Fault, operation::retract};

/// Number of retracts that may end without an answer of "clear" from a drive that answers. A stage that
/// is blocked is not pushed without end.
const RETRACT_ATTEMPTS: u32 = 3;

/// Number of retracts after which the drive is found again at once, because of an alarm or a lost position. An alarm
/// that comes with each move and goes by itself is not pushed against without end.
const FINDS_MAX: u32 = 4;

/// Number of homings of a stage that has lost its position, in the attempts of the latched rig too.
const HOMINGS_MAX: u32 = 4;

/// Number of different alarms that are reset. One that comes back shows that its cause is still there.
const RESETS_MAX: usize = 2;

/// Number of resets that do not count because the drive did not answer until their end.
const UNHEARD_RESETS_MAX: u32 = 3;

/// Number of stops that the rotary stage gets after the first one, in a recovery and in each attempt of a latched rig.
const ROTARY_STOPS_MAX: u32 = 8;

/// The first pause before another attempt. Each following pause is twice as long.
const FIRST_PAUSE: Duration = Duration::from_millis(500);

/// The longest pause between two attempts, so that a drive that is back is noticed soon.
const LONGEST_PAUSE: Duration = Duration::from_secs(5);

/// The next step of a recovery.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum RecoveryStep {
    Do(Operation),
    /// Take the probe here.
    Retract(Target<Mm>),
    /// Wait, then call [`Recovery::waited`].
    Wait(Duration),
    /// The recovery is finished: the probe is clear, or nothing moves and it is unknown.
    Finished(Clearance),
}

/// The end of an operation of the recovery, as far as the linear stage is concerned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RecoveryReport {
    /// It ended in order. Whether the probe is clear is for the interlock to say.
    Done,
    /// The linear drive does not answer, or refuses a request, as one that boots or is busy does.
    Unready,
    /// The drive has an alarm with this code.
    Alarmed(u16),
    /// Its emergency stop is pressed.
    EmergencyStopped,
    /// It was moved, and is not where it should be.
    Blocked,
    /// The position is not known, and a homing leads away from the sample.
    Unhomed,
    /// The position is not known, and there is no safe way to find it.
    Lost,
    /// It failed elsewhere than in the linear stage, so that nothing was read back.
    Unread,
}

impl RecoveryReport {
    /// The end of an operation of the recovery.
    pub(crate) fn of_result(result: &Result<Report, Fault>) -> Self {
        match result {
            Ok(Report::Unhomed) => Self::Unhomed,
            Ok(Report::Stopped(None)) => Self::Lost,
            Ok(_) => Self::Done,
            Err(fault) => match Self::of(fault) {
                Self::Done => Self::Unread,
                report => report,
            },
        }
    }

    /// The part of a fault about the linear stage.
    pub(crate) fn of(fault: &Fault) -> Self {
        match fault {
            // The button of either drive: nothing moves until a person has acknowledged it (ISO 13850).
            Fault::Device(failure) if failure.kind == FailureKind::EmergencyStopped => {
                Self::EmergencyStopped
            }
            Fault::Device(failure) if failure.device == Device::LinearStage => match failure.kind {
                FailureKind::Line
                | FailureKind::Refused
                | FailureKind::Restarted
                | FailureKind::HeldUp => Self::Unready,
                FailureKind::Alarmed { code } => Self::Alarmed(code),
                FailureKind::Moved | FailureKind::Lost | FailureKind::Unhomed => Self::Lost,
                FailureKind::Blocked
                | FailureKind::Unmoved
                | FailureKind::Interrupted
                | FailureKind::EmergencyStopped => Self::Blocked,
            },
            Fault::PositionJumped { .. } => Self::Lost,
            _ => Self::Done,
        }
    }
}

/// Stops both axes and takes the probe clear.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Recovery {
    phase: Phase,
    /// When waiting ends.
    give_up_at: RigTime,
    pause: Duration,
    retracts_left: u32,
    finds_left: u32,
    homings_left: u32,
    /// The alarms that were reset.
    reset: Vec<u16>,
    /// The last of them is being reset.
    is_resetting: bool,
    unheard_resets_left: u32,
    /// The patience ended while a drive was waited for.
    is_out_of_patience: bool,
    rotary_stops_left: u32,
    /// The clearance at the end, if the rotary stage had not answered its stop.
    unstopped: Option<Clearance>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Both axes are being stopped; then the drive is found again first, if its fault asks for it.
    Stopping {
        cause: RecoveryReport,
    },
    Finding,
    Retracting,
    Waiting,
    /// The rotary stage is stopped again.
    StoppingRotary(After),
    /// It has not answered, and is stopped again before the end with this clearance.
    WaitingForRotary(Clearance),
    Finished,
}

/// What follows when the rotary stage was stopped again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum After {
    /// A pause, after which the linear stage is found.
    Pause(Duration),
    /// The end of the recovery.
    End(Clearance),
}

impl Recovery {
    /// Begins with a stop. `cause` is the fault of the linear stage, if it is known.
    pub(crate) fn begin(
        now: RigTime,
        patience: Duration,
        cause: RecoveryReport,
    ) -> (Self, RecoveryStep) {
        let recovery = Self {
            phase: Phase::Stopping { cause },
            give_up_at: now + patience,
            pause: FIRST_PAUSE,
            retracts_left: RETRACT_ATTEMPTS,
            finds_left: FINDS_MAX,
            homings_left: HOMINGS_MAX,
            reset: Vec::new(),
            is_resetting: false,
            unheard_resets_left: UNHEARD_RESETS_MAX,
            is_out_of_patience: false,
            rotary_stops_left: ROTARY_STOPS_MAX,
            unstopped: None,
        };
        (recovery, RecoveryStep::Do(Operation::StopMotion))
    }

    /// An operation of the recovery has ended; `clearance` is the present one, `may_turn` says whether the rotary stage has
    /// been told to turn and has not come to rest since, and `up` is the target of a retract.
    pub(crate) fn ended(
        &mut self,
        now: RigTime,
        report: RecoveryReport,
        (clearance, may_turn): (Clearance, bool),
        up: Target<Mm>,
    ) -> RecoveryStep {
        if let Phase::StoppingRotary(after) = self.phase {
            return self.rotary_answered(now, after, may_turn);
        }
        let step = self.next(now, report, clearance, up);
        let after = match step {
            RecoveryStep::Wait(pause) => After::Pause(pause),
            RecoveryStep::Finished(clearance) => After::End(clearance),
            _ => return step,
        };
        if may_turn { self.stop_rotary(after) } else { step }
    }

    /// Stops the rotary stage again, if it has not been stopped too often.
    fn stop_rotary(&mut self, after: After) -> RecoveryStep {
        let Some(left) = self.rotary_stops_left.checked_sub(1) else {
            return self.after_rotary(after, true);
        };
        self.rotary_stops_left = left;
        self.phase = Phase::StoppingRotary(after);
        RecoveryStep::Do(Operation::StopRotary)
    }

    /// The rotary stage has stopped, or has not answered.
    fn rotary_answered(&mut self, now: RigTime, after: After, may_turn: bool) -> RecoveryStep {
        let After::End(clearance) = after else { return self.after_rotary(after, may_turn) };
        let is_over = self.rotary_stops_left == 0 || self.give_up_at < now + FIRST_PAUSE;
        if !may_turn || is_over {
            return self.after_rotary(after, may_turn);
        }
        self.phase = Phase::WaitingForRotary(clearance);
        RecoveryStep::Wait(FIRST_PAUSE)
    }

    fn after_rotary(&mut self, after: After, may_turn: bool) -> RecoveryStep {
        match after {
            After::Pause(pause) => {
                self.phase = Phase::Waiting;
                RecoveryStep::Wait(pause)
            }
            After::End(clearance) => {
                self.unstopped = may_turn.then_some(clearance);
                self.finish(clearance)
            }
        }
    }

    /// What follows the end of an operation, as far as the linear stage is concerned.
    fn next(
        &mut self,
        now: RigTime,
        report: RecoveryReport,
        clearance: Clearance,
        up: Target<Mm>,
    ) -> RecoveryStep {
        use RecoveryReport::{
            Alarmed, Blocked, Done, EmergencyStopped, Lost, Unhomed, Unread, Unready,
        };
        if std::mem::take(&mut self.is_resetting)
            && report == Unready
            && let Some(left) = self.unheard_resets_left.checked_sub(1)
        {
            self.unheard_resets_left = left;
            self.reset.pop();
        }
        match (self.phase, report) {
            // To release the button must start no motion: a person acknowledges first (ISO 13850).
            (Phase::Stopping { cause: EmergencyStopped }, _) | (_, EmergencyStopped) => {
                self.finish(Clearance::Unknown)
            }
            (Phase::Stopping { cause: Alarmed(_) | Lost }, _) => self.find(),
            (Phase::Stopping { .. } | Phase::Finding, Done) => self.retract(up),
            // Nothing moves before the stage was read back.
            (Phase::Stopping { .. }, _) => self.find(),
            (Phase::Retracting, Done | Unread) if clearance == Clearance::Clear => {
                self.finish(clearance)
            }
            (Phase::Retracting, Alarmed(code)) if self.may_reset(code) => self.find_at_once(),
            (Phase::Retracting, Lost) => self.find_at_once(),
            (Phase::Retracting, Done | Unread | Blocked | Alarmed(_))
            | (Phase::Finding, Blocked) => {
                self.retracts_left = self.retracts_left.saturating_sub(1);
                if self.retracts_left == 0 {
                    self.finish(Clearance::Unknown)
                } else {
                    self.wait(now)
                }
            }
            (Phase::Finding, Unhomed) => self.home_upwards(),
            (Phase::Finding, Alarmed(code)) if self.may_reset(code) => self.find_with_reset(code),
            (Phase::Retracting | Phase::Finding, Unready)
            | (Phase::Finding, Alarmed(_) | Unread) => self.wait(now),
            (Phase::Finding, Lost) | (Phase::Retracting, Unhomed) => {
                self.finish(Clearance::Unknown)
            }
            (
                Phase::Waiting
                | Phase::Finished
                | Phase::StoppingRotary(_)
                | Phase::WaitingForRotary(_),
                _,
            ) => self.finish(Clearance::Unknown),
        }
    }

    /// Begins one attempt more, without patience: the drive is found, and then one retract. If it is not worth finding, only
    /// the rotary stage is stopped.
    pub(crate) fn again(&mut self, now: RigTime) -> RecoveryStep {
        let is_worth_finding = std::mem::take(&mut self.is_out_of_patience);
        let unstopped = self.unstopped.take();
        self.give_up_at = now;
        (self.retracts_left, self.finds_left, self.rotary_stops_left) = (1, 1, 1);
        match unstopped {
            Some(clearance) if !is_worth_finding => self.stop_rotary(After::End(clearance)),
            _ => self.find(),
        }
    }

    /// Whether only the patience has ended, or the rotary stage has not answered, so that a later attempt may succeed. A
    /// linear stage that is blocked or lost is not moved again.
    pub(crate) const fn is_worth_trying(&self) -> bool {
        self.is_out_of_patience || self.unstopped.is_some()
    }

    /// A pause is over.
    pub(crate) fn waited(&mut self) -> RecoveryStep {
        match self.phase {
            Phase::WaitingForRotary(clearance) => self.stop_rotary(After::End(clearance)),
            _ => self.find(),
        }
    }

    /// Whether the drive is being found again, so that its report is a position to be checked.
    pub(crate) const fn is_finding(&self) -> bool {
        matches!(self.phase, Phase::Finding)
    }

    fn find(&mut self) -> RecoveryStep {
        self.phase = Phase::Finding;
        RecoveryStep::Do(Operation::FindLinear { may_reset_alarm: false })
    }

    /// Finds the drive again after a retract.
    fn find_at_once(&mut self) -> RecoveryStep {
        let Some(left) = self.finds_left.checked_sub(1) else {
            return self.finish(Clearance::Unknown);
        };
        self.finds_left = left;
        self.find()
    }

    fn home_upwards(&mut self) -> RecoveryStep {
        let Some(left) = self.homings_left.checked_sub(1) else {
            return self.finish(Clearance::Unknown);
        };
        self.homings_left = left;
        RecoveryStep::Do(Operation::HomeUpwards)
    }

    fn may_reset(&self, code: u16) -> bool {
        self.reset.len() < RESETS_MAX && !self.reset.contains(&code)
    }

    fn find_with_reset(&mut self, code: u16) -> RecoveryStep {
        self.reset.push(code);
        self.is_resetting = true;
        RecoveryStep::Do(Operation::FindLinear { may_reset_alarm: true })
    }

    fn retract(&mut self, up: Target<Mm>) -> RecoveryStep {
        self.phase = Phase::Retracting;
        RecoveryStep::Retract(up)
    }

    fn wait(&mut self, now: RigTime) -> RecoveryStep {
        if self.give_up_at < now + self.pause {
            self.is_out_of_patience = true;
            return self.finish(Clearance::Unknown);
        }
        self.phase = Phase::Waiting;
        let pause = self.pause;
        self.pause = (2 * pause).min(LONGEST_PAUSE);
        RecoveryStep::Wait(pause)
    }

    fn finish(&mut self, clearance: Clearance) -> RecoveryStep {
        self.phase = Phase::Finished;
        RecoveryStep::Finished(clearance)
    }
}

/// Brings the rig into service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Preparing {
    /// A person has stated that nothing is below the probe.
    HomingLinear {
        /// Whether the stage is homed although its drive says that it is homed.
        anew: bool,
    },
    /// A sample may be below the probe, and the probe may be in it.
    FindingLinear,
    /// It has lost its position.
    HomingUpwards,
    Clearing,
    HomingRotary,
    Levelling,
}

impl Preparing {
    /// The operation of this stage.
    pub(crate) fn operation(self, limits: &RigLimits) -> Operation {
        match self {
            Self::HomingLinear { anew } => Operation::HomeLinear { anew },
            Self::FindingLinear => Operation::FindLinear { may_reset_alarm: true },
            Self::HomingUpwards => Operation::HomeUpwards,
            Self::Clearing => retract(limits, limits.linear.rest_target()),
            Self::HomingRotary => Operation::PrepareRotary,
            Self::Levelling => Operation::MoveRotary {
                target: limits.rotary.rest_target(),
                speed_deg_per_s: limits.motion.rotary_speed_deg_per_s,
            },
        }
    }

    /// The stage after this one.
    pub(crate) const fn next(self) -> Option<Self> {
        match self {
            Self::HomingLinear { .. } | Self::FindingLinear | Self::HomingUpwards => {
                Some(Self::Clearing)
            }
            Self::Clearing => Some(Self::HomingRotary),
            Self::HomingRotary => Some(Self::Levelling),
            Self::Levelling => None,
        }
    }
}

/// Whether an operation ended early on request, which is not a fault.
pub(crate) fn is_interruption(failure: &Failure) -> bool {
    failure.kind == FailureKind::Interrupted
}
