//! What a protocol wants of its touches, and the settings that were chosen for it.

use serde::{Deserialize, Serialize};

/// What a protocol wants of its touches, the settings that were chosen for it, and what was expected of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Aim {
    /// The largest relative standard deviation of the stiffness of a touch that is wanted, %.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stiffness_percent: Option<f64>,
    /// The mean time of a touch that is wanted, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds_per_touch: Option<f64>,
    /// The settings of the run.
    pub settings: AimSettings,
    /// The keys of these settings that the protocol states, dotted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stated: Vec<String>,
    /// What each part of a touch was expected to take and to contribute.
    pub parts: Vec<AimPart>,
    /// Expected time of a touch, s.
    pub seconds: f64,
    /// Root mean square of the expected standard deviations of the touches, %.
    pub percent: f64,
    /// The largest of them, %.
    pub worst_percent: f64,
    /// The touch that has it.
    pub worst: String,
}

/// Settings that an aim chooses, or that the protocol states.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AimSettings {
    /// Target of the sweeps in contact, Hz.
    pub contact_sigma_hz: f64,
    /// Target of the references, Hz.
    pub no_load_sigma_hz: f64,
    /// The last step of the search for the surface, mm.
    pub fine_step_mm: f64,
    /// When the reference is measured, as in a protocol.
    pub no_load: String,
}

/// A part of a touch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AimPart {
    /// `sweep`, `reference`, `surface`, `depth`, `angle` or `rest`.
    pub part: String,
    /// Its expected time, s; the errors of depth and angle take none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Root mean square of the standard deviations that it was expected to cause, %; `rest` causes none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub percent: Option<f64>,
    /// The standard deviation that it was expected to cause in the worst touch, %.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worst_percent: Option<f64>,
}
