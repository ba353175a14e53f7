//! The record of a calibration: a TOML file, written once and never changed.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use crate::{
    Basis, BenchChange, Change, Finding, Kind, Value, Verdict,
    basis::SIMULATED,
    check::{CheckValues, Checked},
    finding::rounded,
    metrology::{ScrewError, ScrewMap},
};

/// The version of the file.
const FORMAT: u32 = 1;

/// The verdict after a change of the bench.
const VOID: &str = "void";

/// The verdict of a step that an interruption leaves unproven, until its end.
const BEGUN: &str = "begun";

/// How long a calibration holds, s: a year. What changes on the bench ends it earlier.
pub const HOLDS_S: i64 = 365 * 86_400;

/// How far a clock is set back by the service that keeps it right, s, at most.
const CLOCK_S: i64 = 60;

/// When, where and by whom a calibration was made.
#[derive(Debug, Clone, PartialEq)]
pub struct Circumstances {
    /// Its number among the records of its data directory, from 1. The order of records is that of their numbers, because a clock
    /// may be set back.
    pub sequence: u64,
    /// Time of its end, s since 1970.
    pub unix_s: i64,
    /// Time of its end as a person reads it, UTC.
    pub made: String,
    /// Name of the person who saw it.
    pub person: String,
    /// Name and version of the program.
    pub software: String,
    /// The session of the journal with the motions, or the runs that were evaluated.
    pub journal: Vec<String>,
    /// Temperature at the bench, °C, if it was told.
    pub temperature_c: Option<f64>,
}

/// Temperatures at a bench, °C, that a record takes.
const TEMPERATURES_C: RangeInclusive<f64> = -50.0..=100.0;

/// A temperature that no bench has.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("a temperature of {found} °C: it must lie between {} °C and {} °C", TEMPERATURES_C.start(), TEMPERATURES_C.end())]
pub struct NoTemperature {
    found: f64,
}

/// A temperature at the bench, °C, for a record.
///
/// # Errors
/// [`NoTemperature`], below −50 °C or above 100 °C, or no number.
pub fn temperature(found: f64) -> Result<f64, NoTemperature> {
    if TEMPERATURES_C.contains(&found) { Ok(found) } else { Err(NoTemperature { found }) }
}

/// A calibration as its file has it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    format: u32,
    /// What it shows.
    pub kind: Kind,
    /// `accepted`, `rig file` if that must be changed, `failed`, `begun` while a homing is under way or after its interruption,
    /// or `void` after a change of the bench; of a daily check `accepted`, `look` or `not to be trusted`.
    pub verdict: String,
    /// Why it failed, or what was changed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Its number among the records of its data directory, from 1; 0 in a record of an earlier version.
    #[serde(default, skip_serializing_if = "is_zero")]
    sequence: u64,
    made: String,
    made_unix_s: i64,
    expires_unix_s: i64,
    person: String,
    software: String,
    journal: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    temperature_c: Option<f64>,
    drives: [String; 2],
    /// SHA-256 of the keys of the rig file on which it rests.
    keys_sha256: String,
    /// SHA-256 of the protocols of a daily check: only checks with the same ones are compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    protocols_sha256: Option<String>,
    /// Covariance of the values, in their order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub covariance: Vec<Vec<f64>>,
    /// The error of the linear screw: height, error and standard deviation, mm.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub screw_mm: Vec<[f64; 3]>,
    /// Covariance of these errors, µm²: of each with those up to itself.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub screw_covariance_um2: Vec<Vec<f64>>,
    /// What was found.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub values: Vec<ValueFile>,
    /// What the rig file must say instead.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<ChangeFile>,
}

/// A quantity in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValueFile {
    /// Its name.
    pub name: String,
    /// The value.
    pub value: f64,
    /// Its standard uncertainty.
    pub standard_uncertainty: f64,
    /// The unit; 1 for a ratio.
    pub unit: String,
}

/// A change of the rig file in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChangeFile {
    /// Section and key.
    pub key: String,
    /// The value that it had.
    pub from: f64,
    /// The value to put there.
    pub to: f64,
}

/// A file that is no calibration.
#[derive(Debug, thiserror::Error)]
pub enum UnreadableCalibration {
    /// It is not TOML, or has other keys.
    #[error(transparent)]
    Toml(#[from] toml::de::Error),
    /// Another version of this program wrote it.
    #[error("it has the format {found}, and this program reads {FORMAT}")]
    Format {
        /// Its format.
        found: u32,
    },
}

/// A number that TOML does not have.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct Unwritable(#[from] toml::ser::Error);

impl Calibration {
    /// The record of a finding.
    pub fn new(kind: Kind, finding: Finding, basis: &Basis, around: Circumstances) -> Self {
        let Finding { verdict, values, covariance, screw } = finding;
        let (verdict, reason, changes) = match verdict {
            Verdict::Accepted => ("accepted", None, Vec::new()),
            Verdict::RigFile(changes) => ("rig file", None, changes),
            Verdict::Failed(why) => ("failed", Some(why), Vec::new()),
        };
        Self {
            format: FORMAT,
            kind,
            verdict: verdict.to_owned(),
            reason,
            sequence: around.sequence,
            made: around.made,
            made_unix_s: around.unix_s,
            expires_unix_s: around.unix_s + HOLDS_S,
            person: around.person,
            software: around.software,
            journal: around.journal,
            temperature_c: around.temperature_c,
            drives: basis.drives().clone(),
            keys_sha256: basis.sha256(kind),
            protocols_sha256: None,
            covariance,
            screw_mm: screw.errors.iter().map(screw_row).collect(),
            screw_covariance_um2: triangle_um2(&screw),
            values: values.into_iter().map(ValueFile::from).collect(),
            changes: changes.into_iter().map(ChangeFile::from).collect(),
        }
    }

    /// The record that a change of the bench has voided what was shown.
    pub fn void(kind: Kind, change: BenchChange, basis: &Basis, around: Circumstances) -> Self {
        let finding = Finding::failed(change.text().to_owned());
        Self { verdict: VOID.to_owned(), ..Self::new(kind, finding, basis, around) }
    }

    /// The record that the power of the drives is about to go, and that the step has not ended.
    pub fn begun(kind: Kind, basis: &Basis, around: Circumstances) -> Self {
        let finding = Finding::failed("the step has not ended".to_owned());
        Self { verdict: BEGUN.to_owned(), ..Self::new(kind, finding, basis, around) }
    }

    /// The record of a daily check with protocols of this digest.
    pub fn check(
        values: CheckValues,
        judged: &Checked,
        protocols_sha256: String,
        basis: &Basis,
        around: Circumstances,
    ) -> Self {
        let finding = Finding::of(values.to_values(), Vec::new());
        Self {
            verdict: judged.verdict.name().to_owned(),
            reason: judged.reason(),
            protocols_sha256: Some(protocols_sha256),
            ..Self::new(Kind::Check, finding, basis, around)
        }
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// [`UnreadableCalibration`].
    pub fn read(text: &str) -> Result<Self, UnreadableCalibration> {
        let calibration: Self = toml::from_str(text)?;
        match calibration.format {
            FORMAT => Ok(calibration),
            found => Err(UnreadableCalibration::Format { found }),
        }
    }

    /// The text of its file.
    ///
    /// # Errors
    /// [`Unwritable`].
    pub fn to_toml(&self) -> Result<String, Unwritable> {
        let text = toml::to_string(self)?;
        Ok(format!("# A calibration of a bench, written by rigd. It is never changed.\n{text}"))
    }

    /// Whether the bench was found as the rig file says.
    pub fn is_accepted(&self) -> bool {
        self.verdict == "accepted"
    }

    /// Whether it says that the step has not ended.
    pub(crate) fn is_begun(&self) -> bool {
        self.verdict == BEGUN
    }

    /// Whether it says that the bench was changed.
    pub(crate) fn is_void(&self) -> bool {
        self.verdict == VOID
    }

    /// Whether it was made with these keys.
    pub(crate) fn has_keys_of(&self, basis: &Basis) -> bool {
        self.keys_sha256 == basis.sha256(self.kind)
    }

    /// Whether it was made with these drives.
    pub(crate) fn has_drives_of(&self, basis: &Basis) -> bool {
        self.drives == *basis.drives()
    }

    /// Whether what it says of the bench holds here: a port or an instrument file that is exchanged, and put back, changes
    /// nothing of that. Each simulated bench is one of its own.
    pub(crate) fn is_of_bench(&self, basis: &Basis) -> bool {
        let is_simulated = self.drives.iter().any(|one| one.contains(SIMULATED));
        self.has_drives_of(basis) || !is_simulated && !basis.is_simulated()
    }

    /// SHA-256 of the protocols of a daily check.
    pub fn protocols_sha256(&self) -> Option<&str> {
        self.protocols_sha256.as_deref()
    }

    /// Whether it is a daily check with protocols of this digest.
    pub(crate) fn has_protocols(&self, sha256: &str) -> bool {
        self.protocols_sha256.as_deref() == Some(sha256)
    }

    /// Whether it has expired.
    pub(crate) const fn is_expired(&self, unix_s: i64) -> bool {
        self.expires_unix_s <= unix_s
    }

    /// Time at which it was made, UTC, for a person.
    pub fn made(&self) -> &str {
        &self.made
    }

    /// Name of the person who saw it.
    pub fn person(&self) -> &str {
        &self.person
    }

    /// The session of the journal with the motions, or the runs that were evaluated.
    pub fn journal(&self) -> &[String] {
        &self.journal
    }

    /// Time at which it was made, s since 1970.
    pub const fn made_unix_s(&self) -> i64 {
        self.made_unix_s
    }

    /// Its number among the records of its data directory, from 1; 0 in a record of an earlier version.
    pub const fn sequence(&self) -> u64 {
        self.sequence
    }

    /// What orders records: their numbers, and those of earlier versions by their times.
    pub(crate) const fn order(&self) -> (u64, i64) {
        (self.sequence, self.made_unix_s)
    }

    /// Whether its time is later than now.
    pub(crate) const fn is_of_later(&self, unix_s: i64) -> bool {
        unix_s + CLOCK_S < self.made_unix_s
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde calls it so")]
const fn is_zero(sequence: &u64) -> bool {
    *sequence == 0
}

/// The name of the file of a calibration made at this time, UTC, such as `scale-20261125T153000Z.toml`. The names
/// of a kind sort by time.
pub fn file_name(kind: Kind, compact_utc: &str) -> String {
    format!("{}-{compact_utc}.toml", kind.name())
}

fn screw_row(error: &ScrewError) -> [f64; 3] {
    [error.height_mm, error.error_mm, error.sigma_mm]
}

/// The lower triangle of the covariance of a map, µm², to six digits.
fn triangle_um2(screw: &ScrewMap) -> Vec<Vec<f64>> {
    let row = |(index, row): (usize, &Vec<f64>)| {
        row[..=index].iter().map(|entry_mm2| rounded(1e6 * entry_mm2, 6)).collect()
    };
    screw.covariance_mm2.iter().enumerate().map(row).collect()
}

impl From<Value> for ValueFile {
    fn from(value: Value) -> Self {
        let Value { name, value, standard_uncertainty, unit } = value;
        Self { name: name.to_owned(), value, standard_uncertainty, unit: unit.to_owned() }
    }
}

impl From<Change> for ChangeFile {
    fn from(Change { key, from, to }: Change) -> Self {
        Self { key: key.to_owned(), from, to }
    }
}

#[cfg(test)]
mod tests {
    use rig_files::rig_file::RigFile;

    use super::*;

    #[test]
    fn a_temperature_that_no_bench_has_is_refused_with_the_limits() {
        for found in [f64::NAN, f64::INFINITY, -400.0, 100.1] {
            let error = temperature(found).unwrap_err().to_string();
            assert!(error.ends_with("must lie between -50 °C and 100 °C"), "{error}");
        }
        assert_eq!(temperature(21.5), Ok(21.5));
    }

    #[test]
    fn a_calibration_reads_back_as_it_was_written_and_nothing_else_is_one() {
        let text = include_str!("../../../config/rigs/simulated.toml");
        let basis = Basis::of(&RigFile::read("rig.toml", text).unwrap(), [None, None]);
        let values = vec![Value {
            name: "linear.scale",
            value: 1.02,
            standard_uncertainty: 0.001,
            unit: "1",
        }];
        let change = Change { key: "linear.mm_per_step", from: 0.001, to: 0.00102 };
        let around = Circumstances {
            sequence: 3,
            unix_s: 1_795_000_000,
            made: "2026-11-18T09:06:40Z".to_owned(),
            person: "ada".to_owned(),
            software: "rigd 0".to_owned(),
            journal: vec!["019".to_owned()],
            temperature_c: Some(21.5),
        };
        let calibration =
            Calibration::new(Kind::Scale, Finding::of(values, vec![change]), &basis, around);
        let written = calibration.to_toml().unwrap();
        assert_eq!(Calibration::read(&written).unwrap(), calibration);
        assert!(!calibration.is_accepted());
        for (from, to) in
            [("format = 1", "format = 2"), ("person", "persons"), ("kind = ", "kind ")]
        {
            assert!(Calibration::read(&written.replacen(from, to, 1)).is_err(), "{to}");
        }
    }
}
