//! Touches: settings, pose and results.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Direction in which the surface leans.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// In the plane of bending, at a positive angle.
    Front,
    /// In the plane of bending, at a negative angle.
    Back,
    /// Across the plane of bending.
    Left,
}

impl Direction {
    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Front => "front",
            Self::Back => "back",
            Self::Left => "left",
        }
    }
}

/// The pose of the surface against the probe.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Pose {
    /// Direction of the tilt.
    pub direction: Direction,
    /// Contact angle, degrees.
    pub angle_deg: f64,
}

/// The part of the protocol.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// The grid of samples, directions and angles.
    Main,
    /// The random touches that are classified without their labels.
    Blind,
}

impl Phase {
    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Main => "main",
            Self::Blind => "blind",
        }
    }
}

/// The identity of a touch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TouchSettings {
    /// Address of the step.
    pub step: String,
    /// The part of the protocol.
    pub phase: Phase,
    /// Name of the sample.
    pub sample: String,
    /// Pose of the surface.
    pub pose: Pose,
    /// Number of the repeat, from 1.
    pub repeat: u32,
}

/// The result of a touch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Touch {
    /// Settings of the touch.
    pub touch: TouchSettings,
    /// Number of the sweep that gave the reference.
    pub no_load_sweep: u64,
    /// The reference, Hz.
    pub no_load_hz: f64,
    /// Its standard deviation, Hz.
    pub no_load_sigma_hz: f64,
    /// Standard deviation of what the free resonance has drifted since the reference, Hz, by the
    /// references so far. Zero in runs that did not learn their drift.
    #[serde(default)]
    pub drift_sigma_hz: f64,
    /// Number of the sweep in contact.
    pub sweep: u64,
    /// The resonance in contact, Hz.
    pub resonance_hz: f64,
    /// Its standard deviation, Hz.
    pub sigma_hz: f64,
    /// Resonance in contact less the reference, Hz.
    pub shift_hz: f64,
    /// Its standard deviation, Hz: of both resonances and of the drift between them.
    pub shift_sigma_hz: f64,
    /// The surface found, as a position of the linear axis, mm.
    pub surface_mm: f64,
    /// Its standard deviation, mm.
    pub surface_sigma_mm: f64,
    /// Depth below it along the probe axis during the sweep, mm.
    pub indentation_mm: f64,
    /// The linear axis as read back before the sweep, mm.
    pub linear_mm: f64,
    /// The tilt of the sample as read back, degrees.
    pub rotary_deg: f64,
    /// Whether the surface was found again after the sweep, so that steps lost in the touch would have shown.
    /// `None` in journals that do not say it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub is_slip_checked: Option<bool>,
    /// The measurement on the way to that depth, if the protocol asks for one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub halfway: Option<Halfway>,
}

/// The measurement of a touch at a smaller depth, with the same surface and reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Halfway {
    /// Number of its sweep.
    pub sweep: u64,
    /// The resonance there, Hz.
    pub resonance_hz: f64,
    /// Its standard deviation, Hz.
    pub sigma_hz: f64,
    /// Depth below the surface along the probe axis, mm.
    pub indentation_mm: f64,
    /// The linear axis as read back before the sweep, mm.
    pub linear_mm: f64,
}

/// A touch that gave no frequency shift.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RefusedTouch {
    /// Settings of the touch.
    pub touch: TouchSettings,
    /// The reason of the refusal.
    pub reason: String,
    /// Number of the sweep that gave the reference.
    pub no_load_sweep: u64,
    /// The reference, Hz.
    pub no_load_hz: f64,
    /// Its standard deviation, Hz.
    pub no_load_sigma_hz: f64,
    /// The tilt of the sample as read back, degrees.
    pub rotary_deg: f64,
    /// Position of the probe in the sample, if it was reached.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub indented: Option<TouchPosition>,
}

/// No drift explains a reference: the free resonance has jumped in the time since the one before it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ReferenceJumped {
    /// Number of the sweep that gave the reference before.
    pub no_load_sweep: u64,
    /// Number of the sweep that gave this one.
    pub next_no_load_sweep: u64,
    /// How far this one is from where the drift lets it be expected, Hz. If the sensor was measured more than once for it
    /// (a sweep was too vague, or the level was checked), the first of these resonances that is a jump.
    pub off_hz: f64,
    /// Its standard deviation there, Hz.
    pub sigma_hz: f64,
    /// Addresses of the measured touches in between, whose shifts may be wrong by it.
    pub touches: Vec<String>,
}

/// The position of the probe in a sample whose touch was refused.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TouchPosition {
    /// Number of the last sweep in contact.
    pub sweep: u64,
    /// The surface found, as a position of the linear axis, mm.
    pub surface_mm: f64,
    /// Its standard deviation, mm.
    pub surface_sigma_mm: f64,
    /// Depth below it along the probe axis, mm.
    pub indentation_mm: f64,
    /// The linear axis as read back, mm.
    pub linear_mm: f64,
}
