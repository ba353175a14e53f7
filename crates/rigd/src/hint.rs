//! Advice after a fault.

use rig_engine::{ContactSenseFault, Device, FailureKind, Fault, RigState, Snapshot};
use rig_model::Clearance;

/// Advice for a command refused in this state.
pub(crate) const fn while_in(state: RigState) -> Option<&'static str> {
    match state {
        RigState::Latched => {
            Some("read the fault in GET /api/v1/rig, then POST /api/v1/acknowledge")
        }
        RigState::Running | RigState::WaitingForPerson | RigState::Paused => {
            Some("wait for the run to end, or abort it")
        }
        RigState::Preparing | RigState::Retracting => Some("try again in a moment"),
        RigState::Idle => None,
    }
}

/// Advice while the rig loop gives no sign of life.
pub(crate) const WHILE_SILENT: &str = "keep away from the stages, which may end their last move; a \
     stop, or 30 s without an answer, ends rigd and starts `rigd safe`, which stops both axes and retracts the \
     probe of a commissioned rig";

/// Advice for a person at the bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Hint {
    /// The advice, for every interface.
    pub(crate) text: &'static str,
    /// The next action.
    then: NextAction,
}

/// The next action after the cause of a fault is removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum NextAction {
    /// The rig is prepared again, and the probe, which may be in contact, is retracted first.
    Retract,
    /// The rig is prepared again.
    Prepare,
    /// A person states that nothing is below the probe, and the linear stage is homed.
    Home,
    /// The same, and looks then whether the zero that it went to is the right one.
    HomeAndMeasure,
    /// The rig is prepared again, with a homing of the rotary stage, and a person looks then whether its angle is the right one.
    HomeRotary,
    /// The bench is commissioned, step by step.
    Commission,
    /// This program is started again.
    Restart,
}

impl NextAction {
    /// What is to be done after it.
    const fn afterwards(self) -> &'static str {
        match self {
            Self::HomeAndMeasure => {
                "; check with a rule, before a sample is placed, that the probe is where its position says: a \
                 drive with an absolute encoder goes to the zero that it remembers"
            }
            Self::HomeRotary => {
                "; check with a level, before a sample is touched, that the table is at the angle that is shown: a drive with \
                 an absolute encoder goes to the zero that it remembers"
            }
            _ => "",
        }
    }
}

impl Hint {
    /// A hint for each next action, to see that every interface has its words for them.
    #[cfg(test)]
    pub(crate) fn of_every_action() -> [Self; 7] {
        [
            NextAction::Retract,
            NextAction::Prepare,
            NextAction::Home,
            NextAction::HomeAndMeasure,
            NextAction::HomeRotary,
            NextAction::Commission,
            NextAction::Restart,
        ]
        .map(|then| Self { text: "look", then })
    }

    /// For clients of the daemon.
    pub(crate) fn over_http(self) -> String {
        let then = match self.then {
            NextAction::Retract => {
                "POST /api/v1/acknowledge, which moves the probe to its clear position before anything turns"
            }
            NextAction::Prepare => "POST /api/v1/acknowledge",
            NextAction::HomeRotary => {
                "POST /api/v1/acknowledge, which takes the probe to its clear position and homes the rotary stage anew"
            }
            NextAction::Home | NextAction::HomeAndMeasure => {
                "POST /api/v1/home with {\"nothing_below_probe\": true}, which homes the linear stage in \
                 the direction that is set in its drive"
            }
            NextAction::Commission => {
                "POST /api/v1/commission asks for one step after the other, as `rigd commission` does after \
                 this daemon has ended"
            }
            NextAction::Restart => "start rigd again",
        };
        format!("{}; then {then}{}", self.text, self.then.afterwards())
    }

    /// For a person at a terminal, where every command opens the rig again.
    pub(crate) fn at_a_terminal(self) -> String {
        match self.then {
            NextAction::Retract => {
                format!(
                    "{}; then `rigd home`, which moves the probe to its clear position before anything turns, or \
                     `rigd run --resume`",
                    self.text
                )
            }
            NextAction::Home | NextAction::HomeAndMeasure => {
                format!(
                    "{}; then `rigd home --nothing-below-probe`, which homes the linear stage in the \
                     direction that is set in its drive{}",
                    self.text,
                    self.then.afterwards()
                )
            }
            NextAction::Commission => {
                format!("{}; `rigd commission` asks for one step after the other", self.text)
            }
            NextAction::HomeRotary => format!(
                "{}; home the rotary stage with the program of its drive, because the next command believes its position{}",
                self.text,
                self.then.afterwards()
            ),
            NextAction::Prepare | NextAction::Restart => self.text.to_owned(),
        }
    }
}

/// Advice for an axis with an impossible position. Nothing here may move it: a
/// move that starts from a wrong position, or goes the wrong way, ends in the sample.
pub(crate) const LOST: &str = "move nothing, not even with the tool of the drive: check by eye \
                               where the axis is (switch the drives off only if the linear stage has a \
                               brake), and compare the sign and the size of its step, its zero and its \
                               travel in the rig file with the bench";

/// Advice for a linear stage that is not where its last moves can have led.
const JUMPED: &str = "the position of the linear stage may be wrong, so that a move up may lead down: lift the probe by hand if it \
                      touches, take the sample away, and see with your own eyes that nothing is below the \
                      probe, down to the end of its travel";

/// Advice where the position of the linear stage may be wrong.
const AFTER_A_JUMP: Hint = Hint { text: JUMPED, then: NextAction::HomeAndMeasure };

/// Advice for a linear stage that does not know its position and may home downwards.
const UNHOMED: &str = "homing this stage may lead downwards: lift the probe by hand if it touches, take \
                       the sample away, and see with your own eyes that nothing is below the probe, down \
                       to the end of its travel";

/// Advice for a rotary stage that is not where it came to rest.
const TURNED: &str =
    "check by eye that the probe is clear of the table, and that the table may turn";

/// Advice for a rigd that was held up.
const HELD_UP: &str =
    "look for the load of the computer and of its disk, and keep it from sleeping";

/// Advice for a bench that nobody has commissioned.
const UNCOMMISSIONED: &str =
    "nothing moves until every step of the commissioning is shown, or shown again";

/// Advice after an emergency stop.
const EMERGENCY_STOP: &str = "make the bench safe before the emergency stop is released: nothing moves by its release, and \
                              the acknowledgement moves the probe to its clear position before anything turns";

/// Advice when the journal fails while the probe may be in the sample: nothing else retracts without a journal.
pub(crate) const WITHOUT_DISK: &str = "the probe may still be in contact: touch neither the sample nor the stages; end rigd, then run \
                                       `rigd safe`, which retracts the probe without a journal; then check the disk of \
                                       the data directory";

/// Advice after a mistake of the program itself.
const MAINTAINER: &str = "keep the journal of this run for the maintainer of rigd";

/// Advice during the way out of contact, which is automatic.
pub(crate) fn during_retract(fault: &Fault) -> String {
    let is_silent = matches!(fault, Fault::Device(failure) if failure.kind == FailureKind::Line);
    let cure = if is_silent {
        "; a power or cable that is seen to be off may be restored without touching these"
    } else {
        ""
    };
    format!(
        "rigd is taking the probe out of contact and keeps trying for the patience_s of the rig \
         file: touch neither the sample nor the stages{cure}"
    )
}

/// Advice while the latched rig goes on trying to retract.
pub(crate) fn during_attempts(attempts: u32, then: Hint) -> String {
    format!(
        "rigd tries every 30 s to find the linear drive and to retract (attempts so far: {attempts}), and \
         lowers and turns nothing; POST /api/v1/stop ends the attempts; {}",
        then.over_http()
    )
}

/// Whether the linear stage has lost its position, and may home downwards.
pub(crate) fn is_unhomed(fault: &Fault) -> bool {
    matches!(fault, Fault::Device(failure)
        if (failure.device, failure.kind) == (Device::LinearStage, FailureKind::Unhomed))
}

/// After the contact sense has contradicted itself.
const fn contact_sense(fault: &ContactSenseFault) -> &'static str {
    match fault {
        ContactSenseFault::SurfaceMoved { .. } => {
            "look whether the sample has moved, and whether the linear stage has lost steps: its scale \
             and its read-back must agree"
        }
        ContactSenseFault::SurfaceTooLow { .. } => {
            "look whether the sample is in place and as high as the geometry of the rig file says, and whether the linear \
             stage has lost steps: its scale and its read-back must agree"
        }
        ContactSenseFault::TooNoisy { .. } => {
            "check the cable of the sensor and the level of the drive, or raise contact_threshold in the protocol"
        }
        ContactSenseFault::DriftsTooFast { .. } => {
            "let sensor and analyzer warm up, keep draughts and light off the sensor, or raise contact_threshold in \
             the protocol"
        }
        ContactSenseFault::NotFree { .. }
        | ContactSenseFault::NoResponse { .. }
        | ContactSenseFault::Frozen { .. }
        | ContactSenseFault::ReferenceMoved { .. } => {
            "check that nothing touches the probe, and check the cable of the sensor and the analyzer"
        }
    }
}

/// Advice after a run that was interrupted.
const fn after_interruption(may_touch: bool) -> Hint {
    if may_touch {
        let text = "check by eye where the probe is, and touch neither the sample nor the stages";
        return Hint { text, then: NextAction::Retract };
    }
    Hint { text: "check the bench by eye", then: NextAction::Prepare }
}

/// Advice where the position of an axis cannot be relied on.
fn without_position(fault: &Fault) -> Option<Hint> {
    match fault {
        _ if is_unhomed(fault) => Some(Hint { text: UNHOMED, then: NextAction::Home }),
        _ if fault.jump().is_some() => Some(AFTER_A_JUMP),
        Fault::Device(failure) if failure.kind == FailureKind::Lost => {
            Some(Hint { text: LOST, then: NextAction::Restart })
        }
        Fault::Device(failure) if failure.kind == FailureKind::Moved => {
            // Of the linear stage, a position that no last move explains is a jump, which has an advice of its own.
            let is_rotary = failure.device == Device::RotaryStage;
            is_rotary.then_some(Hint { text: TURNED, then: NextAction::HomeRotary })
        }
        _ => None,
    }
}

/// Advice for a rig that a fault has latched.
pub(crate) fn latched(snapshot: &Snapshot, fault: &Fault) -> Hint {
    if is_jumped(snapshot, fault) { AFTER_A_JUMP } else { after(fault, snapshot.clearance) }
}

/// Whether the position of the linear stage may be wrong, which outweighs the first cause. What keeps it from being homed comes
/// before it.
pub(crate) fn is_jumped(snapshot: &Snapshot, fault: &Fault) -> bool {
    let keeps_from_homing = match fault {
        Fault::Device(failure) => {
            matches!(failure.kind, FailureKind::Lost | FailureKind::EmergencyStopped)
                || failure.device == Device::Journal
        }
        Fault::NotCommissioned { .. } => true,
        _ => false,
    };
    snapshot.jump.is_some() && !keeps_from_homing
}

/// Advice after a fault.
pub(crate) fn after(fault: &Fault, clearance: Clearance) -> Hint {
    let device = match fault {
        Fault::Device(failure) => Some((failure.device, failure.kind)),
        _ => None,
    };
    if let Some(hint) = without_position(fault) {
        return hint;
    }
    if matches!(fault, Fault::NotCommissioned { .. }) {
        return Hint { text: UNCOMMISSIONED, then: NextAction::Commission };
    }
    if let Fault::Interrupted(left) = fault {
        return after_interruption(left.may_touch);
    }
    if let Some((_, FailureKind::EmergencyStopped)) = device {
        let is_clear = clearance == Clearance::Clear;
        let then = if is_clear { NextAction::Prepare } else { NextAction::Retract };
        return Hint { text: EMERGENCY_STOP, then };
    }
    let is_of_disk = matches!(device, Some((Device::Journal, FailureKind::Line)));
    if is_of_disk && clearance != Clearance::Clear {
        return Hint { text: WITHOUT_DISK, then: NextAction::Restart };
    }
    if clearance != Clearance::Clear {
        let text = "the probe may still be in contact: do not touch the sample or the stages; \
                    check by eye, and remove the cause";
        return Hint { text, then: NextAction::Retract };
    }
    if is_of_disk {
        let text = "check the disk of the data directory";
        return Hint { text, then: NextAction::Restart };
    }
    let text = match fault {
        Fault::Device(failure) => match (failure.device, failure.kind) {
            (Device::Journal | Device::Interlock, _) => MAINTAINER,
            (_, FailureKind::Line) => "check the power and the cable of the device",
            (_, FailureKind::HeldUp) => HELD_UP,
            (_, FailureKind::Restarted) => "check the power of the device",
            (Device::Analyzer, _) => "read the display of the analyzer",
            (_, _) => "look for an alarm on the drive and for an obstacle in the way of the axis",
        },
        Fault::ContactTooEarly { .. } => {
            "check that the surface of the sample is at the height in the rig file, and that \
             nothing touches the probe"
        }
        Fault::ContactSense(fault) => contact_sense(fault),
        Fault::NoContact { .. } => "check that the sample is in place and the probe is intact",
        Fault::NoReference { .. } => {
            "check the cable of the sensor and the no-load window of the protocol"
        }
        Fault::Stopped { .. } => "make sure that the bench is safe",
        Fault::HeldUp { .. } => HELD_UP,
        Fault::Panicked { .. } => return Hint { text: MAINTAINER, then: NextAction::Restart },
        Fault::PositionJumped { .. }
        | Fault::LinearTarget(_)
        | Fault::RotaryTarget(_)
        | Fault::NoReferenceBefore { .. }
        | Fault::OutOfOrder { .. }
        | Fault::Interlock(_)
        | Fault::MissingReadings { .. }
        | Fault::Overdue { .. }
        | Fault::Interrupted(_)
        | Fault::NotCommissioned { .. }
        | Fault::NotProvenClear => MAINTAINER,
    };
    Hint { text, then: NextAction::Prepare }
}
