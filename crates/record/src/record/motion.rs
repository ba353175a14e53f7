//! Moves and what is found by them.

use serde::{Deserialize, Serialize};

use super::{Pose, ReadingRecord};

/// An axis, and the unit of its positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// The vertical stage, in mm, upwards.
    LinearMm,
    /// The stage that tilts the sample, in degrees.
    RotaryDeg,
}

/// What a move is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MoveReason {
    /// To the reference of the axis.
    Home,
    /// From one place to another with the probe clear.
    Travel,
    /// Down, seeking the surface.
    Approach,
    /// Down into the sample.
    Indent,
    /// As a person at the bench wants it.
    ByHand,
    /// Up to the clear position.
    Retract,
    /// To a contact angle.
    Rotate,
}

/// A move that is about to be commanded. Positions are in the unit of the axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Intent {
    /// What it is for.
    pub what: MoveReason,
    /// The axis.
    pub axis: Axis,
    /// The last known position, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<f64>,
    /// The target.
    pub to: f64,
    /// The position that must not be passed in this move.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
}

/// A move that was done. Positions are in the unit of the axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Move {
    /// The axis.
    pub axis: Axis,
    /// The target.
    pub target: f64,
    /// Where the axis says it stands.
    pub read_back: f64,
    /// Whether this shows the probe to be clear.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_clear: bool,
}

/// Where the probe meets the sample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Surface {
    /// The step.
    pub step: String,
    /// How the sample stands.
    pub pose: Pose,
    /// Position of the linear axis, mm.
    pub position_mm: f64,
    /// Its standard deviation, mm.
    pub sigma_mm: f64,
    /// Every place that was tried, with its reading, in order.
    pub trail: Vec<SurfaceReading>,
}

/// The surface was sought and not found; why is in the record that follows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LostSurface {
    /// The step.
    pub step: String,
    /// How the sample stands.
    pub pose: Pose,
    /// Every place that was tried, with its reading, in order.
    pub trail: Vec<SurfaceReading>,
}

/// A place that was tried on the way to the surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SurfaceReading {
    /// Position of the linear axis as read back, mm.
    pub position_mm: f64,
    /// The impedance there.
    pub reading: ReadingRecord,
}
