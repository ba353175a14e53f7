//! One contact of a sensor with a tissue, and the load at which it rests.

use crate::{
    ContactLaw, ContactPatch, LawError, Pose, Refusal, Sensor, Tissue, equilibrium,
    grip::needed_friction, rest::Rest,
};

/// The depth of a contact, as an indentation or as a move of the stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Depth {
    /// The indentation of the tissue by the ball.
    Indentation {
        /// Along the probe, mm. Zero or less is no contact.
        along_probe_mm: f64,
    },
    /// The move of the stage since the first touch. The bimorph deflects, so that the indentation is
    /// smaller.
    Stage {
        /// Along the probe, mm. Zero or less is no contact.
        along_probe_mm: f64,
    },
}

impl Depth {
    /// A depth of this kind, this many times as deep.
    pub(crate) const fn times(self, factor: f64) -> Self {
        match self {
            Self::Indentation { along_probe_mm } => {
                Self::Indentation { along_probe_mm: factor * along_probe_mm }
            }
            Self::Stage { along_probe_mm } => {
                Self::Stage { along_probe_mm: factor * along_probe_mm }
            }
        }
    }
}

/// The behaviour of the contact along the surface while it vibrates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Friction {
    /// The contact sticks, with Mindlin's tangential stiffness.
    Sticking,
    /// The contact sticks up to this coefficient of friction; a slipping contact is refused.
    ///
    /// A ball that is pressed in at an angle α loads the contact along the surface with τ tan α of
    /// the normal force from the first touch on. τ is the tangential over the normal stiffness. The arm
    /// of a sensor that gives way drags the ball in addition, the more the stiffer the tissue is.
    Coulomb {
        /// Tangential over normal force at which the contact slips.
        coefficient: f64,
    },
    /// The contact sticks with this tangential over normal stiffness: with 0 it slides, with 1 it is
    /// equally stiff both ways.
    Elastic {
        /// Tangential over normal stiffness, zero or more.
        tangential_ratio: f64,
    },
    /// The contact slides without resistance.
    Frictionless,
}

/// The geometry and the laws of one contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The pose of the probe against the surface.
    pub pose: Pose,
    /// Depth along the probe.
    pub depth: Depth,
    /// The law that gives radius and force at a depth.
    pub law: ContactLaw,
    /// Behaviour along the surface.
    pub friction: Friction,
}

impl Contact {
    /// A sticking contact with Sneddon's law.
    pub const fn new(pose: Pose, depth: Depth) -> Self {
        Self { pose, depth, law: ContactLaw::Sneddon, friction: Friction::Sticking }
    }

    /// The tangential over the normal contact stiffness.
    pub(crate) fn tangential_ratio(&self, tissue: &Tissue) -> f64 {
        match self.friction {
            Friction::Sticking | Friction::Coulomb { .. } => tissue.tangential_ratio(),
            Friction::Elastic { tangential_ratio } => tangential_ratio,
            Friction::Frictionless => 0.0,
        }
    }

    /// Refuses a contact that slips on its way to a depth, normal to the surface in ball radii.
    pub(crate) fn check_grip(
        &self,
        sensor: &Sensor,
        tissue: &Tissue,
        depth_rel: f64,
    ) -> Result<(), Refusal> {
        let Friction::Coulomb { coefficient } = self.friction else { return Ok(()) };
        let (modulus_pa, ratio) = (tissue.contact_modulus_pa(), tissue.tangential_ratio());
        let (section, pose) = (sensor.section(), &self.pose);
        let needed = needed_friction(section, pose, self.law, modulus_pa, ratio, depth_rel);
        if needed <= coefficient {
            return Ok(());
        }
        Err(Refusal::Slips { angle_deg: pose.angle_rad().to_degrees(), coefficient, needed })
    }
}

/// A contact at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// Indentation normal to the surface, mm.
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
    /// The load of a clear probe.
    pub const NONE: Self = Self {
        depth_mm: 0.0,
        radius_mm: 0.0,
        force_n: 0.0,
        normal_n_per_m: 0.0,
        tangential_n_per_m: 0.0,
    };

    /// This contact with a tissue this many times as stiff.
    pub(crate) fn stiffer(&self, factor: f64) -> Self {
        Self {
            normal_n_per_m: self.normal_n_per_m * factor,
            tangential_n_per_m: self.tangential_n_per_m * factor,
            force_n: self.force_n * factor,
            ..*self
        }
    }
}

impl Sensor {
    /// The contact at rest: its depth, radius, force and stiffness. All are zero without contact.
    ///
    /// # Errors
    /// [`Refusal::Law`] when the depth lies outside the contact law, or is not a number;
    /// [`Refusal::Slips`] when friction does not hold the contact.
    pub fn load(&self, tissue: &Tissue, contact: &Contact) -> Result<Load, Refusal> {
        let radius_m = self.section().radius_m;
        let modulus_pa = tissue.contact_modulus_pa();
        let patch = self.patch(modulus_pa, contact)?;
        contact.check_grip(self, tissue, patch.depth_rel)?;
        let normal = 2.0 * modulus_pa * radius_m * patch.radius_rel;
        Ok(Load {
            depth_mm: patch.depth_rel * radius_m * 1e3,
            radius_mm: patch.radius_rel * radius_m * 1e3,
            force_n: modulus_pa * radius_m * radius_m * patch.force_rel,
            normal_n_per_m: normal,
            tangential_n_per_m: normal * contact.tangential_ratio(tissue),
        })
    }

    /// The coefficient of friction that the contact needs to stick on its way to its depth; the arm of a
    /// sensor that gives way drags the ball along the surface. For [`Friction::Elastic`] with that
    /// tangential stiffness.
    ///
    /// # Errors
    /// [`Refusal::Law`] when the depth lies outside the contact law, or is not a number.
    pub fn needed_friction(&self, tissue: &Tissue, contact: &Contact) -> Result<f64, Refusal> {
        let modulus_pa = tissue.contact_modulus_pa();
        let depth_rel = self.patch(modulus_pa, contact)?.depth_rel;
        let ratio = contact.tangential_ratio(tissue);
        let section = self.section();
        Ok(needed_friction(section, &contact.pose, contact.law, modulus_pa, ratio, depth_rel))
    }

    fn patch(&self, modulus_pa: f64, contact: &Contact) -> Result<ContactPatch, LawError> {
        let section = self.section();
        let (Depth::Indentation { along_probe_mm } | Depth::Stage { along_probe_mm }) =
            contact.depth;
        if along_probe_mm <= 0.0 {
            return Ok(ContactPatch::NONE);
        }
        let move_rel = along_probe_mm * 1e-3 * contact.pose.cos() / section.radius_m;
        match contact.depth {
            Depth::Indentation { .. } => contact.law.at(move_rel),
            Depth::Stage { .. } => {
                let unit_n = modulus_pa * section.radius_m * section.radius_m;
                equilibrium::of_stage_move(contact.law, move_rel, |force_rel| {
                    let rest = Rest::of(section, &contact.pose, unit_n * force_rel);
                    rest.compliance_m_per_n * modulus_pa * section.radius_m
                })
            }
        }
    }
}
