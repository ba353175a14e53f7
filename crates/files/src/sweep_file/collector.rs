//! The faults of a sweep file while it is read.

use std::fmt;

use super::fault::SweepFileFault;
use crate::{Complaint, Faults, Location};

/// Largest number of different faults that are reported. More of them rarely help a person.
const FAULTS_MAX: usize = 20;

/// The different faults found so far, up to a limit, each with the number of its repetitions.
#[derive(Debug, Default)]
pub(super) struct FaultCollector {
    list: Vec<Collected>,
    /// Place of the first fault beyond the limit.
    more_at: Option<Location>,
}

/// A fault at its first place.
#[derive(Debug)]
struct Collected {
    location: Location,
    fault: SweepFileFault,
    /// Number of further places with the same fault.
    repetitions: usize,
}

impl FaultCollector {
    /// Adds a fault. A row often has the fault of the row before: it is counted there.
    pub(super) fn refuse(&mut self, location: Location, fault: SweepFileFault) {
        if let Some(same) = self.list.iter_mut().find(|earlier| earlier.fault == fault) {
            same.repetitions += 1;
        } else if self.list.len() < FAULTS_MAX {
            self.list.push(Collected { location, fault, repetitions: 0 });
        } else {
            self.more_at.get_or_insert(location);
        }
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Whether there are more different faults than are reported.
    pub(super) const fn is_full(&self) -> bool {
        self.more_at.is_some()
    }

    /// The faults of the file `name`, for a person.
    pub(super) fn into_faults(self, name: &str) -> Faults {
        let mut faults = Faults::new(name);
        for collected in &self.list {
            faults.refuse(collected.location, collected);
        }
        if let Some(location) = self.more_at {
            faults.refuse(location, &SweepFileFault::More { shown: FAULTS_MAX });
        }
        faults
    }
}

impl fmt::Display for Collected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { fault, repetitions, .. } = self;
        write!(f, "{fault}")?;
        match repetitions {
            0 => Ok(()),
            1 => f.write_str(" (and once more below)"),
            more => write!(f, " (and {more} times more below)"),
        }
    }
}

impl Complaint for Collected {
    fn suggestion(&self) -> Option<String> {
        self.fault.suggestion()
    }
}
