//! Checks a rig and advises on each problem.
//!
//! Every check gives a finding, also a good one, so that a person sees that the check was made.

pub(crate) mod advice;
pub(crate) mod commissioning;
mod data;
mod device;
mod growth;
#[cfg(target_os = "linux")]
pub(crate) mod host;
// Groups, udev, brltty and ModemManager are of Linux.
#[cfg(not(target_os = "linux"))]
#[path = "doctor/other_host.rs"]
pub(crate) mod host;
pub(crate) mod hub;
mod port;
#[cfg(test)]
mod tests;
#[cfg(target_os = "linux")]
mod usbtmc;

use std::path::Path;

use self::host::HostFacts;
use crate::rig::Inspection;

/// The severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Level {
    /// No problem.
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

/// The result of one check.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Finding {
    /// The part of the rig.
    pub(crate) part: &'static str,
    /// The thing checked.
    pub(crate) check: &'static str,
    pub(crate) level: Level,
    /// The observation, as text.
    pub(crate) text: String,
    /// Advice; empty if all is well.
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

/// The findings about the data directory, the last session with this rig (its name, and whether it is simulated), the computer, the ports, and
/// the devices.
pub(crate) fn findings(
    data: &Path,
    rig: (&str, bool),
    host: Option<&HostFacts>,
    inspection: &Inspection,
) -> Vec<Finding> {
    let mut all = data::findings(data, rig);
    all.extend(host.map(host::findings).unwrap_or_default());
    all.extend(inspection.ports.iter().flat_map(port::findings));
    all.extend(inspection.devices.iter().flat_map(device::findings));
    all
}
