//! The true state of the bench and its safety violations, for tests only.

use rig_model::{Orientation, RigTime};

/// Something that must never happen on a bench.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Violation {
    /// Time of the violation.
    pub at: RigTime,
    /// Kind of the violation.
    pub kind: ViolationKind,
}

/// A safety violation.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ViolationKind {
    /// The rotary stage moved while the probe was in the sample.
    #[error("the rotary stage moved with the probe {indentation_mm:.3} mm deep")]
    RotatedInContact {
        /// Largest indentation meanwhile, mm.
        indentation_mm: f64,
    },
    /// A sample was put in place or taken away while the probe was in contact.
    #[error("the sample was changed with the probe {indentation_mm:.3} mm deep")]
    SampleChangedInContact {
        /// Indentation at that moment, mm.
        indentation_mm: f64,
    },
    /// The sensor was turned by hand while the probe was in contact.
    #[error("the sensor was turned with the probe {indentation_mm:.3} mm deep")]
    SensorTurnedInContact {
        /// Indentation at that moment, mm.
        indentation_mm: f64,
    },
    /// The probe was sent deeper than the sample bears.
    #[error("the probe was {indentation_mm:.3} mm deep, beyond the {limit_mm} mm of the sample")]
    PressedTooDeep {
        /// Indentation, mm.
        indentation_mm: f64,
        /// Deepest indentation of the sample, mm.
        limit_mm: f64,
    },
    /// The probe sank deeper than the sample bears by lost steps alone: no command lowered it since.
    #[error(
        "lost steps alone took the probe {indentation_mm:.3} mm deep, beyond the {limit_mm} mm of the \
         sample"
    )]
    SankTooDeep {
        /// Indentation, mm.
        indentation_mm: f64,
        /// Deepest indentation of the sample, mm.
        limit_mm: f64,
    },
}

impl ViolationKind {
    /// Largest depth of the probe in the sample, mm.
    pub const fn indentation_mm(&self) -> f64 {
        match *self {
            Self::RotatedInContact { indentation_mm }
            | Self::SampleChangedInContact { indentation_mm }
            | Self::SensorTurnedInContact { indentation_mm }
            | Self::PressedTooDeep { indentation_mm, .. }
            | Self::SankTooDeep { indentation_mm, .. } => indentation_mm,
        }
    }
}

/// The true state, for tests.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Name of the sample under the probe.
    pub sample: Option<String>,
    /// The orientation of the sensor.
    pub orientation: Orientation,
    /// Position of the tip of the probe on the linear axis, mm.
    pub tip_mm: f64,
    /// Position of the rotary stage, degrees.
    pub tilt_deg: f64,
    /// Depth of the tip below the undeformed surface along the probe, mm; negative while clear,
    /// minus infinity without a sample.
    pub indentation_mm: f64,
    /// The angle between the probe and the normal of the touched point, degrees, with its sign.
    pub contact_deg: f64,
    /// The modulus at the touched point, MPa.
    pub stiffness_mpa: Option<f64>,
    /// The resonance at this moment, Hz.
    pub resonance_hz: f64,
    /// Resonance without contact, Hz.
    pub no_load_hz: f64,
}

impl Truth {
    /// Whether the probe is in the sample.
    pub fn is_in_contact(&self) -> bool {
        self.indentation_mm > 0.0
    }
}
