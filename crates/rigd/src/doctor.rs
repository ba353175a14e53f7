//! Whether a rig is fit for use, and what to do where it is not.
//!
//! Everything that was looked at gives a finding, also what is well: a person must see that it was
//! looked at.

mod data;
mod device;
mod port;
#[cfg(test)]
mod tests;

use std::path::Path;

use crate::rig::{DeviceError, Inspection, OpenError};

/// How grave a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Level {
    /// As it should be.
    Ok,
    /// It works, and could be better.
    Warning,
    /// It does not work.
    Problem,
}

impl Level {
    /// The word in results.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Warning => "warning",
            Self::Problem => "problem",
        }
    }
}

/// What was found when one thing was looked at.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Finding {
    /// The part of the rig.
    pub(crate) part: &'static str,
    /// What was looked at.
    pub(crate) check: &'static str,
    pub(crate) level: Level,
    /// What was seen.
    pub(crate) text: String,
    /// What to do about it; nothing where all is well.
    pub(crate) advice: Option<&'static str>,
}

/// The findings of one part of the rig.
struct Findings {
    part: &'static str,
    all: Vec<Finding>,
}

impl Findings {
    const fn of(part: &'static str) -> Self {
        Self { part, all: Vec::new() }
    }

    fn ok(&mut self, check: &'static str, text: impl Into<String>) {
        self.add(check, Level::Ok, text.into(), None);
    }

    fn warning(&mut self, check: &'static str, text: impl Into<String>, advice: &'static str) {
        self.add(check, Level::Warning, text.into(), Some(advice));
    }

    fn problem(&mut self, check: &'static str, text: impl Into<String>, advice: &'static str) {
        self.add(check, Level::Problem, text.into(), Some(advice));
    }

    fn add(
        &mut self,
        check: &'static str,
        level: Level,
        text: String,
        advice: Option<&'static str>,
    ) {
        self.all.push(Finding { part: self.part, check, level, text, advice });
    }
}

/// Everything that was found: of the data directory, the ports, and the devices.
pub(crate) fn findings(data: &Path, inspection: &Inspection) -> Vec<Finding> {
    let mut all = data::findings(data);
    all.extend(inspection.ports.iter().flat_map(port::findings));
    all.extend(inspection.devices.iter().flat_map(device::findings));
    all
}

/// What to do about an axis that says that it is where it cannot be. Nothing here may move it: a
/// move that starts from a wrong position, or goes the wrong way, ends in the sample.
pub(crate) const LOST: &str = "move nothing, not with the tool of the drive either: with the drives off, look where the axis \
     stands, and correct the sign and the size of its step, its zero or its travel in the rig file";

/// What to do about an axis that is not homed. Which way it homes is set in the drive.
const NOT_HOMED: &str = "clear the whole travel of the axis before the rig is opened for work: it is homed then, by \
     the procedure that is set in the drive";

/// What to do about a rig that cannot be opened, where that is known.
pub(crate) fn advice_on_rig(error: &OpenError) -> Option<&'static str> {
    match error {
        OpenError::Port { source, .. } => Some(advice_on_port(source)),
        OpenError::Device { source, .. } => Some(advice(source)),
        _ => None,
    }
}

/// What to do about a port that cannot be opened.
const fn advice_on_port(error: &rig_link::OpenError) -> &'static str {
    use rig_link::OpenError;
    match error {
        OpenError::Absent { .. } => {
            "plug it in; `rigd ports` shows what is attached, and the rig file must name it"
        }
        OpenError::Busy { .. } => "end that program",
        OpenError::Permission { .. } => {
            "add this user to the group of the device (often dialout), and log in again"
        }
        OpenError::TimedOut { .. } => "check the address, the network and the power",
        OpenError::Io { .. } => "check the address or the name, and the cable",
    }
}

/// What to do about a device that does not answer as it should.
fn advice(error: &DeviceError) -> &'static str {
    use rig_analyzer::AnalyzerError;
    use rig_stage::{BusError, LineFault, StageError};
    const WIRING: &str = "check the power and the cable of the device; then compare speed, parity \
                          and, for a drive, the unit id with what is set on it";
    const CHANGED: &str = "the drive does not keep the settings it is given: check the register map \
                           and the unit id, and that no other tool writes to it";
    const LINE: &str = "check the cable and the adapter, and that no other program uses the port";
    const MANUAL: &str = "look at the display of the device, and up its answer in its manual";
    let on_bus = |source: &BusError| match source {
        BusError::Failed(LineFault::NoAnswer { .. }) => WIRING,
        BusError::Failed(LineFault::Changed { .. }) => CHANGED,
        BusError::Failed(_) => LINE,
        BusError::Refused(_) => MANUAL,
    };
    match error {
        DeviceError::Analyzer(AnalyzerError::WrongInstrument { .. }) => {
            "name its dialect in the rig file, or connect the instrument that is named there"
        }
        DeviceError::Analyzer(AnalyzerError::Line { .. } | AnalyzerError::Frame { .. }) => WIRING,
        DeviceError::Analyzer(AnalyzerError::Reopen { .. } | AnalyzerError::Unquiet { .. }) => LINE,
        DeviceError::Linear(StageError::Bus(error))
        | DeviceError::Rotary(StageError::Bus(error)) => on_bus(error),
        DeviceError::Linear(StageError::BeyondTravel { .. })
        | DeviceError::Rotary(StageError::BeyondTravel { .. }) => LOST,
        _ => MANUAL,
    }
}
