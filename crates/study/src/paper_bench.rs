//! The samples, angles and depth of the paper's bench.

use rig_contact::{Contact, ContactLaw, Depth, Direction, Pose, Tissue};

/// Young's moduli of the paper's samples, softest first, MPa.
///
/// # Source
/// Sensors 20 (2020) 6607, Table 2.
pub(crate) const SAMPLES_MPA: [f64; 5] = [0.045, 0.104, 0.235, 0.320, 0.649];
/// Contact angles of the paper, degrees.
pub(crate) const ANGLES_DEG: [f64; 4] = [0.0, 15.0, 30.0, 45.0];
/// Indentation of the paper, mm.
pub(crate) const INDENTATION_MM: f64 = 0.5;

/// The quantity that is held at the nominal depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Control {
    /// The indentation is held.
    Indentation,
    /// The position of the stage; the sensor deflects.
    Stage,
}

impl Control {
    pub(crate) const ALL: [Self; 2] = [Self::Indentation, Self::Stage];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Indentation => "indentation",
            Self::Stage => "stage",
        }
    }

    pub(crate) const fn depth(self, along_probe_mm: f64) -> Depth {
        match self {
            Self::Indentation => Depth::Indentation { along_probe_mm },
            Self::Stage => Depth::Stage { along_probe_mm },
        }
    }
}

/// A soft tissue.
pub(crate) fn tissue(young_mpa: f64) -> Tissue {
    Tissue::soft(young_mpa).expect("the studies' stiffnesses are positive")
}

/// A sticking contact in one of the paper's directions.
pub(crate) fn contact(
    direction: Direction,
    angle_deg: f64,
    depth: Depth,
    law: ContactLaw,
) -> Contact {
    let pose = Pose::leaning(direction, angle_deg.to_radians())
        .expect("the studies' angles are below a right angle");
    Contact { law, ..Contact::new(pose, depth) }
}
