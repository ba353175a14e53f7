//! What a person can do after a fault.

use rig_engine::{Device, FailureKind, Fault, StateWord};
use rig_model::Clearance;

/// What to do when a command is refused in this state.
pub(crate) const fn while_in(state: StateWord) -> Option<&'static str> {
    match state {
        StateWord::Latched => {
            Some("look at the fault in GET /api/v1/rig, then POST /api/v1/acknowledge")
        }
        StateWord::Running | StateWord::WaitingForPerson | StateWord::Paused => {
            Some("wait for the run to end, or abort it")
        }
        StateWord::Preparing | StateWord::Retracting => Some("try again in a moment"),
        StateWord::Idle => None,
    }
}

/// What to do next, for a person at the bench.
pub(crate) fn after(fault: &Fault, clearance: Clearance) -> &'static str {
    if clearance != Clearance::Clear {
        return "the probe may still be in contact: do not touch the sample or the stages; check by \
                eye, cure the cause, then acknowledge, and the probe is retracted first";
    }
    match fault {
        Fault::Device(failure) => match (failure.device, failure.kind) {
            (Device::Journal, _) => "free the disk or mount it again, then restart rigd",
            (_, FailureKind::Line) => {
                "check the power and the cable of the device, then acknowledge"
            }
            (Device::Analyzer, _) => "look at the display of the analyzer, then acknowledge",
            (_, _) => {
                "look for an alarm on the drive and for what blocks the axis, then acknowledge"
            }
        },
        Fault::ContactTooEarly { .. } => {
            "check that the sample lies where the rig file says, and that nothing touches the \
             probe; then acknowledge"
        }
        Fault::NoContact { .. } => {
            "check that the sample is in place and the probe is intact; then acknowledge"
        }
        Fault::NoReference { .. } => {
            "check the cable of the sensor and the no-load window of the protocol; then acknowledge"
        }
        Fault::Stopped { .. } => "make sure that the bench is safe, then acknowledge",
        Fault::LinearTarget(_)
        | Fault::RotaryTarget(_)
        | Fault::NoReferenceBefore { .. }
        | Fault::OutOfOrder { .. }
        | Fault::Interlock(_)
        | Fault::MissingReadings { .. }
        | Fault::Overdue { .. }
        | Fault::NotProvenClear => {
            "keep the journal of this run for whoever maintains rigd, then acknowledge"
        }
    }
}
