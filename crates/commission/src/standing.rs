//! Which steps of commissioning a rig has behind it.

use crate::{Basis, Calibration, Kind, Step};

/// Why a step is missing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Why {
    /// It was never made.
    Never,
    /// Its last record was made with other values in the rig file.
    OtherKeys,
    /// Its last record was made with other drives, or on another port.
    OtherDrives,
    /// It failed.
    Failed,
    /// It found that the rig file must be changed.
    RigFile,
    /// Its record has expired.
    Expired,
    /// The bench was changed since.
    Changed,
}

impl Why {
    /// For a person.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Never => "never made",
            Self::OtherKeys => "made with other values in the rig file",
            Self::OtherDrives => "made with other drives or another port",
            Self::Failed => "failed",
            Self::RigFile => "it says that the rig file must be changed",
            Self::Expired => "expired",
            Self::Changed => "the bench was changed since",
        }
    }
}

/// What calibrations show of a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Standing {
    /// Each step, with its record that fits, or why there is none.
    pub steps: Vec<(Step, Result<Calibration, Why>)>,
}

impl Standing {
    /// The last record of each step decides.
    pub fn of(records: &[Calibration], basis: &Basis, unix_s: i64) -> Self {
        let steps = Step::ALL.map(|step| (step, standing(step, records, basis, unix_s)));
        Self { steps: steps.into() }
    }

    /// The steps without a record that fits, in their order.
    pub fn missing(&self) -> impl Iterator<Item = (Step, Why)> {
        self.steps.iter().filter_map(|(step, found)| found.as_ref().err().map(|why| (*step, *why)))
    }

    /// Whether a step has a record that fits.
    pub fn has(&self, step: Step) -> bool {
        self.steps.iter().any(|(held, found)| *held == step && found.is_ok())
    }

    /// Whether the rig may move.
    pub fn is_complete(&self) -> bool {
        self.missing().next().is_none()
    }
}

impl std::fmt::Display for Standing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (index, (step, why)) in self.missing().enumerate() {
            let comma = if index == 0 { "" } else { ", " };
            write!(f, "{comma}{} ({})", step.name(), why.text())?;
        }
        Ok(())
    }
}

fn standing(
    step: Step,
    records: &[Calibration],
    basis: &Basis,
    unix_s: i64,
) -> Result<Calibration, Why> {
    let of_step = || records.iter().filter(|record| record.kind == Kind::from(step));
    let fitting =
        of_step().filter(|record| record.has_drives_of(basis) && record.has_keys_of(basis));
    // Of two within one second, the later one in the order of the names.
    let last = fitting.max_by_key(|record| record.made_unix_s()).ok_or_else(|| {
        match of_step().max_by_key(|record| record.made_unix_s()) {
            None => Why::Never,
            Some(last) if last.has_drives_of(basis) => Why::OtherKeys,
            Some(_) => Why::OtherDrives,
        }
    })?;
    if last.is_expired(unix_s) {
        Err(Why::Expired)
    } else if last.is_accepted() {
        Ok(last.clone())
    } else if last.is_void() {
        Err(Why::Changed)
    } else if last.changes.is_empty() {
        Err(Why::Failed)
    } else {
        Err(Why::RigFile)
    }
}
