//! The sensor of a rig, and the quantities on which the stiffness of a touch depends.

use crate::{ContactLaw, Depth, Friction, Sensor, Tissue, TissueError, inverse::TissueKind};

/// A sensor, its contact with the samples, and how well both are known.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorDescription {
    /// Geometry and materials of the sensor.
    pub sensor: Sensor,
    /// Whether the sensor deflects when the stage moves. Otherwise the whole move is an indentation.
    pub deflects: bool,
    /// Growth of the contact with depth.
    pub law: ContactLaw,
    /// Contact along the surface while the sensor vibrates.
    pub friction: Friction,
    /// Assumed properties of every sample, apart from its stiffness.
    pub kind: TissueKind,
    /// Standard deviations of the conditions of a touch.
    pub uncertainty: Uncertainty,
}

/// Standard deviations of the conditions of a touch, apart from that of its shift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uncertainty {
    /// Of the indentation of each touch, mm, in addition to that of the surface found.
    pub depth_mm: f64,
    /// Of the contact angle, degrees.
    pub angle_deg: f64,
    /// Of the stiffness from one point of a sample to the next, relative.
    pub sample_rel: f64,
    /// Of the common factor of all stiffnesses, without a sample of known stiffness, relative.
    pub scale_rel: f64,
}

impl Uncertainty {
    /// Good stages and a levelled sample give 20 µm and 1°. Without a measurement, the constants of
    /// a bimorph are known to a tenth.
    pub const TYPICAL: Self =
        Self { depth_mm: 0.02, angle_deg: 1.0, sample_rel: 0.03, scale_rel: 0.1 };
}

impl SensorDescription {
    /// The paper's sensor on soft samples, with typical uncertainties.
    pub fn reference() -> Self {
        Self {
            sensor: Sensor::reference(),
            deflects: false,
            law: ContactLaw::Sneddon,
            friction: Friction::Sticking,
            kind: TissueKind::SOFT,
            uncertainty: Uncertainty::TYPICAL,
        }
    }

    /// The depth of a contact when the stage is this far below the surface, mm along the probe.
    pub const fn depth(&self, along_probe_mm: f64) -> Depth {
        if self.deflects {
            Depth::Stage { along_probe_mm }
        } else {
            Depth::Indentation { along_probe_mm }
        }
    }

    /// A sample of this stiffness, MPa.
    ///
    /// # Errors
    /// [`TissueError`].
    pub fn tissue(&self, stiffness_mpa: f64) -> Result<Tissue, TissueError> {
        Tissue::new(stiffness_mpa, self.kind.poisson, self.kind.loss)
    }
}
