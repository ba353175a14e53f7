//! Checks of devices: identity, settings, and state of the axes.

use rig_model::with_causes;

use super::{
    Finding, Findings,
    advice::{NOT_HOMED, on_device},
};
use crate::{
    hint::LOST,
    rig::{AxisFacts, AxisPosition, AxisState, DeviceError, DeviceSeen},
};

pub(super) fn findings(device: &DeviceSeen) -> Vec<Finding> {
    let mut findings = Findings::of(device.role);
    let facts = match &device.outcome {
        None => {
            let text = format!("not asked: {} is not open", device.port);
            findings.problem("identity", text, "solve the problem of the port first");
            return findings.all;
        }
        Some(Err(error)) => {
            findings.problem("identity", with_causes(error), on_device(error, device.kind));
            return findings.all;
        }
        Some(Ok(facts)) => facts,
    };
    findings.ok("identity", &facts.identity);
    findings.ok("firmware", facts.firmware.as_deref().unwrap_or("it does not say"));
    match (&facts.settings, &facts.axis) {
        (Ok(()), Some(axis)) => findings.ok("settings", settings(axis)),
        (Ok(()), None) => findings.ok("settings", "taken, and read back"),
        (Err(error), _) => {
            let error = DeviceError::from(error.clone());
            findings.problem("settings", with_causes(&error), on_device(&error, device.kind));
        }
    }
    if let Some(axis) = &facts.axis {
        stands(&mut findings, axis);
    }
    findings.all
}

/// Nothing is written into a drive before the rig is opened for work.
const fn settings(axis: &AxisFacts) -> &'static str {
    if axis.has_settings {
        "those of the rig file"
    } else {
        "replaced by those of the rig file when the rig is opened for work"
    }
}

fn stands(findings: &mut Findings, AxisFacts { at, place, state, .. }: &AxisFacts) {
    match place {
        AxisPosition::InLimits => findings.ok("position", format!("{at}, within its soft limits")),
        AxisPosition::NotHomed => {
            findings.warning("position", format!("{at}, not homed"), NOT_HOMED);
        }
        AxisPosition::BeyondTravel(travel) => {
            findings.problem("position", format!("{at}, outside its travel {travel}"), LOST);
        }
        AxisPosition::BeyondLimits(soft) => findings.warning(
            "position",
            format!("{at}, outside its soft limits {soft}"),
            "check by eye that it is there; if not, correct the sign and the size of its step and \
             its zero in the rig file before anything moves",
        ),
    }
    match state {
        AxisState::Ready => findings.ok("state", "no alarm, at rest"),
        AxisState::Alarmed(alarm) => findings.problem(
            "state",
            format!("alarm {alarm}"),
            "remove its cause; the next command that opens the rig for work resets the alarm",
        ),
        AxisState::Moving => findings.problem(
            "state",
            "moves without a command from rigd",
            "find the other program or signal that drives it, and stop it",
        ),
        AxisState::NotInService => findings.warning(
            "state",
            "takes no moves, and has not the settings that rigd gives it for work",
            "if it stays so when the rig is opened for work, look for a stop input, a missing enable signal, \
             or a tool that holds the drive",
        ),
        AxisState::NotReady => findings.problem(
            "state",
            "takes no moves",
            "look for a stop input, a missing enable signal, or a tool that holds the drive",
        ),
    }
}
