//! Devices: who they are, whether they take their settings, and how an axis stands.

use rig_model::with_causes;

use super::{Finding, Findings, advice};
use crate::rig::{AxisFacts, AxisState, DeviceError, DeviceSeen};

pub(super) fn findings(device: &DeviceSeen) -> Vec<Finding> {
    let mut findings = Findings::of(device.role);
    let facts = match &device.outcome {
        None => {
            let text = format!("not asked: {} is not open", device.port);
            findings.problem("identity", text, "see to the port first");
            return findings.all;
        }
        Some(Err(error)) => {
            findings.problem("identity", with_causes(error), advice(error));
            return findings.all;
        }
        Some(Ok(facts)) => facts,
    };
    findings.ok("identity", &facts.identity);
    findings.ok("firmware", facts.firmware.as_deref().unwrap_or("it does not say"));
    match &facts.settings {
        Ok(()) => findings.ok("settings", "taken, and read back"),
        Err(error) => {
            let error = DeviceError::from(error.clone());
            findings.problem("settings", with_causes(&error), advice(&error));
        }
    }
    if let Some(axis) = &facts.axis {
        stands(&mut findings, axis);
    }
    findings.all
}

fn stands(findings: &mut Findings, AxisFacts { at, state }: &AxisFacts) {
    match state {
        AxisState::Ready => findings.ok("state", format!("ready, at {at}")),
        AxisState::Alarmed(alarm) => findings.problem(
            "state",
            format!("alarm {alarm}, at {at}"),
            "cure its cause, then `rigd home` resets it",
        ),
        AxisState::Moving => findings.problem(
            "state",
            format!("moves, at {at}, and not because of rigd"),
            "find out what else drives it, and stop that",
        ),
        AxisState::NotHomed => findings.warning(
            "state",
            format!("not homed, at {at}"),
            "`rigd home` homes it, as everything does that opens the rig for work",
        ),
        AxisState::BeyondLimits => findings.warning(
            "state",
            format!("outside its soft limits, at {at}"),
            "check zero and step size in the rig file; `rigd home` brings it back inside",
        ),
        AxisState::NotReady => findings.problem(
            "state",
            format!("takes no moves, at {at}"),
            "look for a stop input, a missing enable signal, or a tool that holds the drive",
        ),
    }
}
