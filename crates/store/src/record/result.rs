//! What the touches of a run together say.

use serde::{Deserialize, Serialize};

use super::Direction;

/// The analysis of a run.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Results {
    /// The reference over the run, when there was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub no_load: Option<NoLoad>,
    /// Shift per sample, direction and angle.
    pub shifts: Vec<Shift>,
    /// Shift against stiffness, when the stiffness of at least two samples is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensitivity: Option<Sensitivity>,
    /// The blind touches, when there were any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub classification: Option<Classification>,
}

/// The resonance with the probe clear, over a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NoLoad {
    /// Its mean, Hz.
    pub mean_hz: f64,
    /// Standard deviation of that mean, Hz.
    pub sigma_hz: f64,
    /// Difference between the highest and the lowest, Hz.
    pub span_hz: f64,
}

/// The shift of one sample at one pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Shift {
    /// Name of the sample.
    pub sample: String,
    /// The direction, or none for the mean of the directions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<Direction>,
    /// The contact angle, degrees.
    pub angle_deg: f64,
    /// The shift, Hz.
    pub shift_hz: f64,
    /// Its standard deviation from the fits alone, Hz.
    pub sigma_hz: f64,
    /// Standard deviation between the touches that were averaged, Hz, when there were several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spread_hz: Option<f64>,
}

/// How the shift grows with stiffness.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sensitivity {
    /// Slope by least squares, Hz/MPa.
    pub slope_hz_per_mpa: f64,
    /// Its standard deviation, Hz/MPa.
    pub slope_sigma_hz_per_mpa: f64,
    /// Slope between the softest and the stiffest sample, Hz/MPa.
    pub chord_hz_per_mpa: f64,
    /// Its standard deviation, Hz/MPa.
    pub chord_sigma_hz_per_mpa: f64,
}

/// How well the blind touches were sorted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Classification {
    /// Blind touches.
    pub trials: u32,
    /// Of which in the class of their sample.
    pub correct: u32,
}
