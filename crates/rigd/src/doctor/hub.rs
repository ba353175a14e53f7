//! Findings about the hub to which the journal is shipped. Nothing is shipped for them.

use std::path::Path;

use rig_files::service_file::HubFile;
use rig_hub::{Held, InletError, ShipperError};
use rig_model::with_causes;
use rig_store::StoreError;

use super::{Finding, Findings, Level};
use crate::{live::Audience, shipper};

/// A hub with fewer events behind it is as a running daemon leaves it.
const BEHIND_MAX: u64 = 1000;

/// The service file, which names the hub, cannot be read.
pub(crate) fn unread(text: String) -> Finding {
    let advice = "mend the service file, or run `rigd doctor` as the user of the daemon";
    Finding {
        part: "hub",
        check: "service file",
        level: Level::Warning,
        text,
        advice: Some(advice),
    }
}

pub(crate) fn findings(file: &HubFile, data: &Path) -> Vec<Finding> {
    let mut found = Findings::of("hub");
    let to = match shipper::destination(file) {
        Ok(to) => to,
        Err(error) => {
            let advice = "write the files of `[hub]` again with `rigd-hub bench add`";
            found.problem("certificate", with_causes(&error), advice);
            return found.all;
        }
    };
    let (bench, host, port) = (&file.bench, &file.host, file.port);
    match shipper::held(&to, data) {
        Ok((Held { quarantined: Some(reason), .. }, _)) => {
            let advice = "two computers ship the same journal: ask the administrator of the hub which one goes on";
            found.problem("journal", format!("quarantined: {reason}"), advice);
        }
        Ok((Held { event, .. }, last_event)) => {
            let behind = last_event.saturating_sub(event);
            let text = format!("{host}:{port} has {event} of {last_event} events of {bench}");
            if behind > BEHIND_MAX {
                let advice = "a running daemon ships them: look at `rigd_hub_connected` in its figures, and at its log";
                found.warning("journal", text, advice);
            } else {
                found.ok("journal", text);
            }
        }
        Err(ShipperError::Inlet(InletError::Journal(StoreError::NoJournal))) => {
            found.ok("journal", "there is none to ship yet");
        }
        Err(error) => {
            let advice = "the rig goes on measuring, and the journal is shipped later: look at network, certificate and \
                          `rigd-hub doctor`";
            found.problem("connection", format!("{host}:{port}: {}", with_causes(&error)), advice);
        }
    }
    if let Ok(Some(audience)) = Audience::of(file) {
        let address = audience.address();
        match audience.try_out() {
            Ok(()) => found.ok("live messages", format!("{address} takes messages of {bench}")),
            Err(error) => {
                let advice = "the rig goes on measuring and its journal is shipped, and only viewers miss it: look at the log of \
                              nats-server, and at `rigd-hub doctor`";
                found.warning("live messages", with_causes(&error), advice);
            }
        }
    }
    found.all
}
