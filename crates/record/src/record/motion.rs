//! Moves, and searches for the surface.

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

/// The purpose of a move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MoveReason {
    /// Homing of the axis.
    Home,
    /// Travel with the probe clear.
    Travel,
    /// Search for the surface.
    Approach,
    /// Indentation of the sample.
    Indent,
    /// Manual move of a person.
    ByHand,
    /// Retract to the clear position.
    Retract,
    /// Rotation to a contact angle.
    Rotate,
}

/// A move that is about to be commanded. Positions are in the unit of the axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Intent {
    /// Purpose of the move.
    pub what: MoveReason,
    /// Axis of the move; its name has the unit of the positions.
    pub axis: Axis,
    /// Last known position.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<f64>,
    /// Target, in the unit of the axis.
    pub to: f64,
    /// The position that must not be passed in this move.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
}

/// A move that was done. Positions are in the unit of the axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Move {
    /// Axis of the move; its name has the unit of the positions.
    pub axis: Axis,
    /// Target, in the unit of the axis.
    pub target: f64,
    /// Position after the move, in the unit of the axis.
    pub read_back: f64,
    /// Whether this shows the probe to be clear.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_clear: bool,
}

/// The surface of a sample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Surface {
    /// Address of the step.
    pub step: String,
    /// Pose of the sample.
    pub pose: Pose,
    /// Position of the linear axis, mm.
    pub position_mm: f64,
    /// Its standard deviation, mm.
    pub sigma_mm: f64,
    /// The fit of a descent; missing for a search in steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub onset: Option<Onset>,
    /// Every position of the search with its reading, in order.
    pub trail: Vec<SurfaceReading>,
}

/// What was fitted together with the surface to the readings of a descent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Onset {
    /// The latency, from that of the rig file and from these readings, s.
    pub latency_s: f64,
    /// Its standard deviation, s.
    pub latency_sigma_s: f64,
    /// Change of the surface for each second of latency beyond that one, mm/s.
    pub mm_per_latency_s: f64,
    /// The exponent with which the resonance rises with the depth.
    pub exponent: f64,
    /// χ² per degree of freedom.
    pub chi_squared_per_dof: f64,
}

/// A search that found no surface. The next record has the reason.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LostSurface {
    /// Address of the step.
    pub step: String,
    /// Pose of the sample.
    pub pose: Pose,
    /// Every position of the search with its reading, in order.
    pub trail: Vec<SurfaceReading>,
    /// Why a descent has not found the surface. The search in steps follows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// A way down at even speed, with readings of the impedance one after the other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Descent {
    /// Address of the step.
    pub step: String,
    /// Pose of the sample.
    pub pose: Pose,
    /// The lowest position that it could have reached, mm.
    pub target_mm: f64,
    /// Its speed, mm/s.
    pub speed_mm_per_s: f64,
    /// Position of the linear stage at rest after it, mm.
    pub read_back_mm: f64,
    /// Why it ended: "contact", "target", "late", `held_up`, "flagged", "frozen", `not_clear` or `broken_off`.
    pub end: String,
    /// Positions that were read on the way.
    pub way: Vec<WayPoint>,
    /// The readings, in order. The first 8 are those of the clear probe, with which the others are compared.
    pub readings: Vec<ReadingRecord>,
}

/// A position of a moving axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WayPoint {
    /// When it was read, s on the rig's clock.
    pub at_s: f64,
    /// The position, mm.
    pub position_mm: f64,
}

/// After the sweep of a touch the surface was looked for again, so that lost steps are found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CheckedSurface {
    /// Address of the step.
    pub step: String,
    /// Pose of the sample.
    pub pose: Pose,
    /// The positions above and below the surface found, with their readings, in order. If the probe
    /// seemed to touch above it, the clear probe and the place above it once more come in between.
    pub trail: Vec<SurfaceReading>,
}

/// A position of the search for the surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SurfaceReading {
    /// Position of the linear axis as read back, mm.
    pub position_mm: f64,
    /// The impedance there.
    pub reading: ReadingRecord,
}
