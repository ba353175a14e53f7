//! Findings and the verdict.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A property that every sound journal has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Check {
    /// Every record can be read, and its kind is known.
    Readable,
    /// Records are numbered without gaps.
    Complete,
    /// The digest of each record covers the record and the one before it.
    Digest,
    /// The entry in the list of runs is the one that was written, and fits the records.
    List,
    /// A run that has ended for good has the seal of its records, and no other run has one.
    Seal,
    /// Times do not decrease, and a new clock begins only with a new epoch.
    Time,
    /// One writer: no record of another run lies between those of a run.
    OneWriter,
    /// A run begins with its settings and ends with its ending.
    Ends,
    /// The planned touches are those of the protocol in its order, and the steps those that they need.
    Plan,
    /// Steps follow each other in the order of the plan.
    StepOrder,
    /// The rotary stage moves only while the probe is shown clear.
    TurnedClear,
    /// "Clear" is said only of a read-back at the clear position.
    FalseClear,
    /// Moves end at their targets.
    AtTarget,
    /// Targets and read-backs lie within the soft limits.
    Limits,
    /// The probe is lowered only from a known position, and only after an intent.
    Intent,
    /// The probe goes no deeper than declared, and nothing deeper than permitted is declared.
    Depth,
    /// The search goes down in steps no larger than the coarse one.
    SearchStep,
    /// Moves are no faster than permitted.
    Speed,
    /// Nothing but a retract follows a fault, nothing moves while a person works at the bench, and no step follows a
    /// refusal that ends the run.
    Stopped,
    /// A run ends with the probe clear, or with a fault.
    EndsClear,
    /// The sample of a touch is the one that was placed.
    Sample,
    /// The sensor is mounted for the direction of the touch.
    Orientation,
    /// A result belongs to the pose in which the axes were.
    Pose,
    /// Readings were taken while the axes were in that pose.
    ReadingTime,
    /// No record has the readings of another one.
    Distinct,
    /// Sweeps are numbered in order, and have the purpose of their step.
    Sweep,
    /// Every planned touch has at most one result, and is made again only after a refusal; every touch of a completed
    /// run has one.
    Row,
    /// The reference of a touch is the last no-load sweep before it.
    Reference,
    /// A touch repeats the values of its sweep, its surface and its read-backs.
    Copy,
    /// The shift is the difference of the resonances.
    Shift,
    /// The surface follows from the search.
    Surface,
    /// The depth is the surface less the read-back, and the one that the protocol asks for.
    Indentation,
    /// An accepted resonance follows from the readings.
    Resonance,
    /// Its standard deviation follows from the readings, and those of a run are not all small.
    Sigma,
    /// An accepted sweep keeps the window and the precision that the protocol asks for.
    Request,
    /// The cited calibrations are the files that are there, the map of the screw is that of its file, and the touches from
    /// which it was made bear it.
    Calibration,
}

impl Check {
    /// All checks.
    pub const ALL: [Self; 36] = [
        Self::Readable,
        Self::Complete,
        Self::Digest,
        Self::List,
        Self::Seal,
        Self::Time,
        Self::OneWriter,
        Self::Ends,
        Self::Plan,
        Self::StepOrder,
        Self::TurnedClear,
        Self::FalseClear,
        Self::AtTarget,
        Self::Limits,
        Self::Intent,
        Self::Depth,
        Self::SearchStep,
        Self::Speed,
        Self::Stopped,
        Self::EndsClear,
        Self::Sample,
        Self::Orientation,
        Self::Pose,
        Self::ReadingTime,
        Self::Distinct,
        Self::Sweep,
        Self::Row,
        Self::Reference,
        Self::Copy,
        Self::Shift,
        Self::Surface,
        Self::Indentation,
        Self::Resonance,
        Self::Sigma,
        Self::Request,
        Self::Calibration,
    ];

    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Readable => "readable",
            Self::Complete => "complete",
            Self::Digest => "digest",
            Self::List => "list",
            Self::Seal => "seal",
            Self::Time => "time",
            Self::OneWriter => "one_writer",
            Self::Ends => "ends",
            Self::Plan => "plan",
            Self::StepOrder => "step_order",
            Self::TurnedClear => "turned_clear",
            Self::FalseClear => "false_clear",
            Self::AtTarget => "at_target",
            Self::Limits => "limits",
            Self::Intent => "intent",
            Self::Depth => "depth",
            Self::SearchStep => "search_step",
            Self::Speed => "speed",
            Self::Stopped => "stopped",
            Self::EndsClear => "ends_clear",
            Self::Sample => "sample",
            Self::Orientation => "orientation",
            Self::Pose => "pose",
            Self::ReadingTime => "reading_time",
            Self::Distinct => "distinct",
            Self::Sweep => "sweep",
            Self::Row => "row",
            Self::Reference => "reference",
            Self::Copy => "copy",
            Self::Shift => "shift",
            Self::Surface => "surface",
            Self::Indentation => "indentation",
            Self::Resonance => "resonance",
            Self::Sigma => "sigma",
            Self::Request => "request",
            Self::Calibration => "calibration",
        }
    }
}

/// A record that does not have a property of sound journals.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// The property.
    pub check: Check,
    /// Number of the record in its run, from 1; 0 for the run as a whole.
    pub record: u64,
    /// What is wrong.
    pub what: String,
    /// The value by this checker, or the condition that does not hold.
    pub expected: String,
    /// The value in the journal.
    pub found: String,
    /// The allowed difference or the limit, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<String>,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { check, record, what, expected, found, limit } = self;
        write!(f, "{}: record {record}: {what}: expected {expected}, found {found}", check.name())?;
        limit.iter().try_for_each(|limit| write!(f, " (limit {limit})"))
    }
}

/// The result of a check.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Verdict {
    /// Id of the run.
    pub run: String,
    /// Whether nothing was found.
    pub is_sound: bool,
    /// Number of records checked.
    pub records: u64,
    /// Number of accepted sweeps that were fitted again.
    pub sweeps: u64,
    /// Digest of the last record, in hexadecimal; empty for a run without records.
    pub digest: String,
    /// Version of the checker.
    pub checker: String,
    /// The part of the run that is in an archive, and was not checked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub archived: Option<ArchivedPart>,
    /// What was found, in the order of the records.
    pub findings: Vec<Finding>,
    /// What could not be checked because it is not here, in sentences.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
}

/// The readings of a run that were moved to an archive.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ArchivedPart {
    /// Number of records of which only the digests are left.
    pub records: u64,
    /// Path of the run in the archive.
    pub place: String,
}

impl Verdict {
    /// The verdict in a sentence.
    pub fn sentence(&self) -> String {
        let Self { records, sweeps, findings, .. } = self;
        match (findings.len(), &self.archived) {
            (0, Some(part)) => format!(
                "sound as far as it is here: {records} records, {} of them readings that are in {}",
                part.records, part.place
            ),
            (count, _) => Self::counted(count, *records, *sweeps),
        }
    }

    fn counted(findings: usize, records: u64, sweeps: u64) -> String {
        match findings {
            0 => format!("sound: {records} records, {sweeps} resonances fitted again"),
            1 => format!("not sound: 1 finding in {records} records"),
            count => format!("not sound: {count} findings in {records} records"),
        }
    }
}

/// Collects findings.
#[derive(Debug, Default)]
pub(crate) struct Findings(pub(crate) Vec<Finding>);

impl Findings {
    /// Adds a finding at a record.
    pub(crate) fn add(
        &mut self,
        check: Check,
        record: u64,
        what: impl Into<String>,
        expected: impl fmt::Display,
        found: impl fmt::Display,
    ) {
        self.within(check, record, what, expected, found, None);
    }

    /// Adds a finding with the limit that was passed.
    pub(crate) fn within(
        &mut self,
        check: Check,
        record: u64,
        what: impl Into<String>,
        expected: impl fmt::Display,
        found: impl fmt::Display,
        limit: Option<String>,
    ) {
        let (what, expected, found) = (what.into(), expected.to_string(), found.to_string());
        self.0.push(Finding { check, record, what, expected, found, limit });
    }

    /// Adds a finding unless two numbers agree to `limit`. A number that is not finite never agrees.
    pub(crate) fn agree(
        &mut self,
        check: Check,
        record: u64,
        what: &str,
        (expected, found): (f64, f64),
        limit: f64,
    ) {
        if (found - expected).abs() <= limit {
            return;
        }
        self.within(check, record, what, expected, found, Some(limit.to_string()));
    }
}
