//! `rigd identify`: who answers on the ports of a rig.

use clap::Args;
use rig_model::with_causes;
use serde::Serialize;

use super::{
    Failure,
    args::{OutputArgs, RigArgs},
    table::{concluded, facts, print, print_json},
};
use crate::rig::{self, DeviceSeen};

#[derive(Debug, Args)]
pub(super) struct IdentifyArgs {
    #[command(flatten)]
    rig: RigArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// A device, for a program.
#[derive(Debug, Serialize)]
struct DeviceView {
    role: &'static str,
    port: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    identity: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    firmware: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

pub(super) fn identify(args: &IdentifyArgs) -> Result<(), Failure> {
    let rig::Inspection { ports, devices } = rig::inspect(args.rig.load()?)?;
    // A device whose port is not open has no error of its own.
    let why_closed = |name: &str| {
        let port = ports.iter().find(|port| port.name == name)?;
        Some(with_causes(port.outcome.as_ref().err()?))
    };
    let view = |DeviceSeen { role, port, outcome, .. }: DeviceSeen| {
        let mut view = DeviceView { role, port, identity: None, firmware: None, error: None };
        match outcome {
            Some(Ok(facts)) => {
                view.identity = Some(facts.identity);
                view.firmware = facts.firmware;
            }
            Some(Err(error)) => view.error = Some(with_causes(&error)),
            None => view.error = why_closed(&view.port),
        }
        view
    };
    let devices = devices.map(view);
    let silent = devices.iter().filter(|device| device.identity.is_none()).count();
    let printed = if args.output.json {
        print_json(&devices)
    } else {
        print(&facts(&devices.each_ref().map(|device| (device.role, text(device)))))
    };
    concluded(printed, if silent > 0 { Err(Failure::Unidentified { silent }) } else { Ok(()) })
}

fn text(device: &DeviceView) -> String {
    let Some(identity) = &device.identity else {
        return format!("not identified: {}", device.error.as_deref().unwrap_or_default());
    };
    let firmware = device.firmware.as_deref();
    let firmware = firmware.map_or(String::new(), |firmware| format!(", firmware {firmware}"));
    format!("{identity}{firmware}, on {}", device.port)
}
