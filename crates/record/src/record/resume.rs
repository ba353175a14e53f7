//! Records after the end of a run: it is resumed, given up, amended, or archived.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{CitedCalibration, Device, Source};

/// A run is resumed after an interruption, a fault or an abort. The times of the following records
/// count on the clock of this epoch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Resumed {
    /// Number of the epoch: the opening of the journal from which the rig's clock counts.
    pub epoch: u64,
    /// Name of the operator.
    pub who: String,
    /// Address of the next touch; `None` when every touch has an outcome.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
    /// Number of touches that have an outcome.
    pub touches_done: u32,
    /// Number of touches that have none.
    pub touches_left: u32,
    /// Differences from the part before; the operator confirmed all of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<Change>,
    /// Version of the program.
    pub software: String,
    /// The text of the rig file, if it has changed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rig: Option<Source>,
    /// The scene behind a simulated rig, where its file has changed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<Source>,
    /// What a run would cite that began now, if a calibration or a correction has changed: touches from here on rest on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrations: Option<Vec<CitedCalibration>>,
    /// Devices on the ports.
    pub devices: Vec<Device>,
}

/// A difference between two parts of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Change {
    /// The changes: `rig file`, `scene file`, `software`, the role of a device, or a calibration or correction, such as
    /// `calibration (scale)`.
    pub what: String,
    /// Before; of a file, its name. Of a calibration, the one that the part before cites.
    pub was: String,
    /// Now; of a file, its name.
    pub is: String,
}

/// A run is given up.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct GivenUp {
    /// Number of the epoch.
    pub epoch: u64,
    /// Name of the operator.
    pub who: String,
}

/// The effect of an amendment on a touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Amendment {
    /// The touch is measured again. The earlier outcome stays in its run.
    Redo,
    /// The touch is left out: not measured, or its outcome not used.
    Skip,
}

impl Amendment {
    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Redo => "redo",
            Self::Skip => "skip",
        }
    }
}

/// An amendment of a touch. The journal of the run itself is unchanged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Amended {
    /// Id of the run.
    pub run: String,
    /// Digest of the last record of the run when it was amended.
    pub head: String,
    /// Address of the touch.
    pub step: String,
    /// Whether the touch is measured again or skipped.
    pub what: Amendment,
    /// Name of the operator.
    pub who: String,
    /// The reason that the operator gave.
    pub why: String,
    /// Version of the program.
    pub software: String,
    /// The text of the rig file, for a touch that is measured again with another one than that of the run's last part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rig: Option<Source>,
    /// What a run would cite that began now, for a touch that is measured again after a calibration or a correction has
    /// changed: it rests on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrations: Option<Vec<CitedCalibration>>,
    /// Devices on the ports, for a touch that is measured again.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub devices: Vec<Device>,
    /// Differences from the run; the operator confirmed all of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<Change>,
}

/// The readings of a run were moved to an archive: the first record of the note that stays.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Archived {
    /// Id of the run.
    pub run: String,
    /// Number of its records.
    pub records: u64,
    /// Digest of its last record.
    pub head: String,
    /// Path of its folder in the archive.
    pub place: String,
    /// Name of the operator.
    pub who: String,
}
