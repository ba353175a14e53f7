//! The section `[aim]`: what a protocol wants of its touches, and how their time is split.
//!
//! A protocol may say how well it wants the stiffness of each touch, or how long a touch may take, instead of
//! how well each resonance and each surface is measured. The settings that it leaves out are then chosen: the
//! targets of both sweeps, the fine step of the search, and how often the reference is measured. A setting that
//! it states stays as stated.
//!
//! The standard deviation here is that of a touch by itself: sweep, reference, surface, depth and angle. The
//! errors that all touches share, those of sensor and model, are not in it, because no setting of a touch
//! lowers them.

mod choose;
mod error;
mod split;

use std::fmt;

use rig_files::settings::{Setting, Table};

use crate::{NoLoadPolicy, Pose, StepId, fault::ProtocolFault};

pub(crate) use choose::{check, choose};

/// What a protocol wants of its touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wanted {
    /// The largest relative standard deviation of the stiffness of a touch, %.
    StiffnessPercent(f64),
    /// The mean time of a touch, s: that of the whole run without the time of persons, over its touches.
    SecondsPerTouch(f64),
}

impl Wanted {
    /// The key of the protocol file.
    pub const fn key(self) -> &'static str {
        match self {
            Self::StiffnessPercent(_) => "stiffness_percent",
            Self::SecondsPerTouch(_) => "seconds_per_touch",
        }
    }

    /// The value of the key, in its unit.
    pub const fn value(self) -> f64 {
        match self {
            Self::StiffnessPercent(value) | Self::SecondsPerTouch(value) => value,
        }
    }
}

impl fmt::Display for Wanted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::StiffnessPercent(percent) => {
                write!(f, "the stiffness of each touch to {percent} %")
            }
            Self::SecondsPerTouch(seconds) => write!(f, "{seconds} s a touch"),
        }
    }
}

/// The keys of the section.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct AimKeys {
    /// `None` if the file gives none or both, which is a fault.
    pub(crate) wanted: Option<Setting<Wanted>>,
    /// Assumed stiffness of samples of which nothing is known, MPa.
    pub(crate) softest_mpa: Option<Setting<f64>>,
}

/// Reads the section.
pub(crate) fn read(table: &mut Table<'_>) -> AimKeys {
    let percent = table.number("stiffness_percent").range(0.01..=100.0).optional();
    let seconds = table.number("seconds_per_touch").range(0.1..=86_400.0).optional();
    let softest_mpa = table.number("softest_mpa").range(1e-6..=1e6).optional();
    let wanted = match (percent, seconds) {
        (Some(percent), None) => Some(percent.map(Wanted::StiffnessPercent)),
        (None, Some(seconds)) => Some(seconds.map(Wanted::SecondsPerTouch)),
        (Some(percent), Some(_)) => {
            table.refuse(&percent, &ProtocolFault::TwoAims);
            None
        }
        (None, None) => {
            if table.is_there() {
                table.refuse(table.location(), &ProtocolFault::NoAim);
            }
            None
        }
    };
    AimKeys { wanted, softest_mpa }
}

/// A touch before it is made, for the models of the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedTouch<'a> {
    /// Name of the sample.
    pub sample: &'a str,
    /// Young's modulus to be assumed if that of the sample is not known, MPa.
    pub assumed_mpa: Option<f64>,
    /// Pose of the surface.
    pub pose: Pose,
    /// Position of the linear stage at which the tip is expected to touch, mm.
    pub surface_mm: f64,
    /// Depth below the surface, along the probe, mm.
    pub indentation_mm: f64,
}

/// How the stiffness of a touch depends on what is measured. Changes of the stiffness are relative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensitivity {
    /// Change with the shift, 1/Hz.
    pub per_hz: f64,
    /// Change with the depth below the surface, 1/mm.
    pub per_mm: f64,
    /// Standard deviation that the stage makes, whose depth is not the one that it states.
    pub of_depth: f64,
    /// Standard deviation that the contact angle makes.
    pub of_angle: f64,
}

/// Why there is no sensitivity of a touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoSensitivity {
    /// Nothing is known of the sample, and the protocol assumes nothing.
    #[error("the stiffness of the sample is not known")]
    UnknownSample,
    /// The models of the sensor do not hold for this touch.
    #[error("the models of the sensor do not hold there")]
    OutsideModel,
}

/// The models of the sensor, as far as an aim needs them.
pub trait TouchModel {
    /// How the stiffness of a touch depends on what is measured.
    ///
    /// # Errors
    /// [`NoSensitivity`].
    fn sensitivity(&self, touch: &ExpectedTouch<'_>) -> Result<Sensitivity, NoSensitivity>;
}

/// The settings that an aim chooses, as far as the file leaves them out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AimSettings {
    /// `target_sigma_hz` of `[contact_sweep]`.
    pub contact_sigma_hz: f64,
    /// `target_sigma_hz` of `[no_load_sweep]`.
    pub no_load_sigma_hz: f64,
    /// `fine_step_mm` of `[approach]`.
    pub fine_step_mm: f64,
    /// `no_load`.
    pub no_load: NoLoadPolicy,
}

/// A cause of the error of a touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorPart {
    /// The resonance in contact.
    Sweep,
    /// The reference, and the drift since it was measured.
    Reference,
    /// The position of the surface.
    Surface,
    /// The depth below the surface, as the stage keeps it.
    Depth,
    /// The contact angle.
    Angle,
}

impl ErrorPart {
    /// All parts, in the order of the outputs.
    pub const ALL: [Self; 5] =
        [Self::Sweep, Self::Reference, Self::Surface, Self::Depth, Self::Angle];

    /// The word in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sweep => "sweep",
            Self::Reference => "reference",
            Self::Surface => "surface",
            Self::Depth => "depth",
            Self::Angle => "angle",
        }
    }
}

/// Relative standard deviations of the stiffness, %.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Percents {
    /// Root mean square over the touches.
    pub all: f64,
    /// Of the touch whose standard deviation is largest.
    pub worst: f64,
}

/// Expected time of a touch by what it is for, s: means over the touches of a plan.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PartTimes {
    /// Sweeps in contact.
    pub sweep_s: f64,
    /// Sweeps of the free sensor, with the survey.
    pub reference_s: f64,
    /// The way down and the search for the surface.
    pub surface_s: f64,
    /// Everything else: rotation, indentation, dwell, check of slip, retract, waiting for the ring.
    pub rest_s: f64,
}

impl PartTimes {
    /// All parts together, s.
    pub fn together_s(&self) -> f64 {
        self.sweep_s + self.reference_s + self.surface_s + self.rest_s
    }
}

/// An aim with the settings chosen for it, and what is expected of them.
#[derive(Debug, Clone, PartialEq)]
pub struct AimPlan {
    /// What the protocol wants.
    pub wanted: Wanted,
    /// The settings of the plan.
    pub settings: AimSettings,
    /// The keys of `settings` that the file states, dotted.
    pub stated: Vec<&'static str>,
    /// Expected time of a touch.
    pub times: PartTimes,
    /// Expected standard deviations, in the order of [`ErrorPart::ALL`].
    pub parts: [Percents; ErrorPart::ALL.len()],
    /// All parts together.
    pub together: Percents,
    /// The touch whose standard deviation is expected to be the largest.
    pub worst: StepId,
}

/// The dotted keys of [`AimSettings`], in the order of its fields.
pub const AIM_KEYS: [&str; 4] = [
    "contact_sweep.target_sigma_hz",
    "no_load_sweep.target_sigma_hz",
    "approach.fine_step_mm",
    "no_load",
];
