//! Out of whatever went wrong: stop, retract, prove it.
//!
//! Also the way into service: home what is not homed, with the probe moving up first.

use rig_model::{Clearance, RigLimits};

use crate::{Failure, FailureKind, Operation, operation::retract};

/// A retract that cannot be shown to have worked is repeated this often. After that nothing moves.
const RETRACT_ATTEMPTS: u32 = 3;

/// The next step of a recovery.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum RecoveryStep {
    Do(Operation),
    /// The recovery is finished: the probe is clear, or nothing moves and it is unknown.
    Finished(Clearance),
}

/// Stops both axes and takes the probe clear.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Recovery {
    attempts_left: u32,
}

impl Recovery {
    /// No retract if the linear stage is lost: it does not know which way is up.
    pub(crate) const fn begin(is_linear_lost: bool) -> (Self, RecoveryStep) {
        let recovery = Self { attempts_left: if is_linear_lost { 0 } else { RETRACT_ATTEMPTS } };
        (recovery, RecoveryStep::Do(Operation::StopMotion))
    }

    /// The linear stage was lost during the recovery: it is not moved again.
    pub(crate) const fn give_up(&mut self) {
        self.attempts_left = 0;
    }

    /// An operation of the recovery has ended or failed; `clearance` is the present one.
    ///
    /// The stop is not repeated when it fails: the retract that follows is the safest thing to do
    /// whether or not the rotary stage has answered.
    pub(crate) fn ended(&mut self, clearance: Clearance, limits: &RigLimits) -> RecoveryStep {
        if clearance == Clearance::Clear && self.attempts_left < RETRACT_ATTEMPTS {
            return RecoveryStep::Finished(clearance);
        }
        if self.attempts_left == 0 {
            return RecoveryStep::Finished(Clearance::Unknown);
        }
        self.attempts_left -= 1;
        RecoveryStep::Do(retract(limits))
    }
}

/// Brings the rig into service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Preparing {
    HomingLinear,
    Clearing,
    HomingRotary,
    Levelling,
}

impl Preparing {
    /// The operation of this stage.
    pub(crate) fn operation(self, limits: &RigLimits) -> Operation {
        match self {
            Self::HomingLinear => Operation::PrepareLinear,
            Self::Clearing => retract(limits),
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
            Self::HomingLinear => Some(Self::Clearing),
            Self::Clearing => Some(Self::HomingRotary),
            Self::HomingRotary => Some(Self::Levelling),
            Self::Levelling => None,
        }
    }
}

/// Whether an operation ended early because it was asked to, and so is no fault of its own.
pub(crate) fn is_interruption(failure: &Failure) -> bool {
    failure.kind == FailureKind::Interrupted
}
