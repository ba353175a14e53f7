//! One contact of a sensor with a tissue, and the load at which it rests.

use crate::{ContactLaw, LawError, Pose, Refusal, Sensor, Spot, Tissue, stage};

/// What the depth of a contact is the depth of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Depth {
    /// The ball has sunk in by this much.
    Indentation {
        /// Along the probe, mm. Zero or less is no contact.
        along_probe_mm: f64,
    },
    /// The stage has moved by this much since the ball first touched; the bimorph gives way.
    Stage {
        /// Along the probe, mm. Zero or less is no contact.
        along_probe_mm: f64,
    },
}

/// What the contact does sideways while it vibrates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Friction {
    /// It sticks, with Mindlin's tangential stiffness.
    Sticking,
    /// It sticks up to this coefficient of friction, and is refused beyond.
    ///
    /// A ball pressed in at an angle α loads the contact sideways by τ tan α of the normal force, τ being the
    /// tangential over the normal stiffness, all the way from the first touch.
    Coulomb {
        /// Tangential over normal force at which the contact slips.
        coefficient: f64,
    },
    /// It sticks with this tangential over normal stiffness: 0 slides, 1 is as stiff both ways.
    Elastic {
        /// Tangential over normal stiffness, zero or more.
        tangential_ratio: f64,
    },
    /// It slides without resistance.
    Frictionless,
}

/// How the probe touches a tissue.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// How the probe stands to the surface.
    pub pose: Pose,
    /// How deep.
    pub depth: Depth,
    /// How radius and force follow from the depth.
    pub law: ContactLaw,
    /// What happens sideways.
    pub friction: Friction,
}

impl Contact {
    /// A sticking contact by Sneddon's solution.
    pub const fn new(pose: Pose, depth: Depth) -> Self {
        Self { pose, depth, law: ContactLaw::Sneddon, friction: Friction::Sticking }
    }

    /// The tangential over the normal contact stiffness.
    pub fn tangential_ratio(&self, tissue: &Tissue) -> f64 {
        match self.friction {
            Friction::Sticking | Friction::Coulomb { .. } => tissue.tangential_ratio(),
            Friction::Elastic { tangential_ratio } => tangential_ratio,
            Friction::Frictionless => 0.0,
        }
    }

    pub(crate) fn check_grip(&self, tissue: &Tissue) -> Result<(), Refusal> {
        let Friction::Coulomb { coefficient } = self.friction else { return Ok(()) };
        let limit_rad = (coefficient / tissue.tangential_ratio()).atan();
        let angle_rad = self.pose.angle_rad();
        if angle_rad <= limit_rad {
            return Ok(());
        }
        let (angle_deg, limit_deg) = (angle_rad.to_degrees(), limit_rad.to_degrees());
        Err(Refusal::Slips { angle_deg, coefficient, limit_deg })
    }
}

/// A contact at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// How far the ball has sunk in, normal to the surface, mm.
    pub depth_mm: f64,
    /// Contact radius, mm.
    pub radius_mm: f64,
    /// Force normal to the surface, N.
    pub force_n: f64,
    /// Stiffness normal to the surface, N/m.
    pub normal_n_per_m: f64,
    /// Stiffness along the surface, N/m.
    pub tangential_n_per_m: f64,
}

impl Load {
    /// No contact.
    pub const NONE: Self = Self {
        depth_mm: 0.0,
        radius_mm: 0.0,
        force_n: 0.0,
        normal_n_per_m: 0.0,
        tangential_n_per_m: 0.0,
    };

    /// The same contact with its stiffness multiplied.
    pub(crate) fn stiffer(&self, factor: f64) -> Self {
        Self {
            normal_n_per_m: self.normal_n_per_m * factor,
            tangential_n_per_m: self.tangential_n_per_m * factor,
            ..*self
        }
    }
}

impl Sensor {
    /// The contact at rest: its depth, radius, force and stiffness. Zero when there is no contact.
    ///
    /// # Errors
    /// [`Refusal::Law`] when the depth lies outside the contact law, or is not a number;
    /// [`Refusal::Slips`] when friction does not hold the contact.
    pub fn load(&self, tissue: &Tissue, contact: &Contact) -> Result<Load, Refusal> {
        contact.check_grip(tissue)?;
        let radius_m = self.section().radius_m;
        let modulus_pa = tissue.contact_modulus_pa();
        let spot = self.spot(modulus_pa, contact)?;
        let normal = 2.0 * modulus_pa * radius_m * spot.radius_rel;
        Ok(Load {
            depth_mm: spot.depth_rel * radius_m * 1e3,
            radius_mm: spot.radius_rel * radius_m * 1e3,
            force_n: modulus_pa * radius_m * radius_m * spot.force_rel,
            normal_n_per_m: normal,
            tangential_n_per_m: normal * contact.tangential_ratio(tissue),
        })
    }

    fn spot(&self, modulus_pa: f64, contact: &Contact) -> Result<Spot, LawError> {
        let section = self.section();
        let (Depth::Indentation { along_probe_mm } | Depth::Stage { along_probe_mm }) =
            contact.depth;
        if along_probe_mm <= 0.0 {
            return Ok(Spot::NONE);
        }
        let move_rel = along_probe_mm * 1e-3 * contact.pose.cos() / section.radius_m;
        match contact.depth {
            Depth::Indentation { .. } => contact.law.at(move_rel),
            Depth::Stage { .. } => {
                let compliance = section.normal_compliance_m_per_n(&contact.pose);
                stage::balance(contact.law, move_rel, compliance * modulus_pa * section.radius_m)
            }
        }
    }
}
