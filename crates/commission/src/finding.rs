//! What a step has found.

use crate::metrology::ScrewMap;

/// A quantity that was found, with its standard uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct Value {
    /// Its name, such as `linear.scale`.
    pub name: &'static str,
    /// The value.
    pub value: f64,
    /// Its standard uncertainty.
    pub standard_uncertainty: f64,
    /// The unit; 1 for a ratio.
    pub unit: &'static str,
}

/// A value of the rig file that is not that of the bench.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Section and key.
    pub key: &'static str,
    /// The value in the file.
    pub from: f64,
    /// The value to put there.
    pub to: f64,
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { key, from, to } = self;
        write!(f, "{key} = {from} must be changed to {to}")
    }
}

/// The verdict of a step.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// The bench is as the rig file says.
    Accepted,
    /// The rig file must be changed; the step is then made again.
    RigFile(Vec<Change>),
    /// Nothing was found, and why.
    Failed(String),
}

/// What a step has found.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The verdict.
    pub verdict: Verdict,
    /// The quantities that were found.
    pub values: Vec<Value>,
    /// Their covariance, in their order; empty if each has an error of its own.
    pub covariance: Vec<Vec<f64>>,
    /// The error of the linear screw.
    pub screw: ScrewMap,
}

impl Finding {
    /// The bench as the rig file says, or the changes that the rig file needs.
    pub fn of(values: Vec<Value>, changes: Vec<Change>) -> Self {
        let verdict =
            if changes.is_empty() { Verdict::Accepted } else { Verdict::RigFile(changes) };
        Self { verdict, values, covariance: Vec::new(), screw: ScrewMap::default() }
    }

    /// This finding with the covariance of its values.
    pub fn with_covariance(self, covariance: Vec<Vec<f64>>) -> Self {
        Self { covariance, ..self }
    }

    /// This finding with the error of the linear screw.
    pub fn with_screw(self, screw: ScrewMap) -> Self {
        Self { screw, ..self }
    }

    /// Nothing was found.
    pub(crate) fn failed(why: String) -> Self {
        Self { verdict: Verdict::Failed(why), ..Self::of(Vec::new(), Vec::new()) }
    }
}

/// Rounds a value for a rig file to `digits` significant digits.
pub(crate) fn rounded(value: f64, digits: i32) -> f64 {
    if value == 0.0 {
        return 0.0;
    }
    #[expect(clippy::cast_possible_truncation, reason = "the magnitude of a length has few digits")]
    let magnitude = value.abs().log10().floor() as i32;
    let unit = 10_f64.powi(digits - 1 - magnitude);
    (value * unit).round() / unit
}
