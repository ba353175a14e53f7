//! The options that describe a sensor and a contact.

use clap::builder::{PossibleValuesParser, TypedValueParser};
use rig_contact::{
    Contact, ContactLaw, Depth, Direction, Friction, Pose, Sensor, SensorDesign, Tier,
    inverse::TissueKind,
};
use serde::Serialize;

use crate::outcome::StudyError;

/// The sensor: the reference sensor with changes.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(crate) struct SensorArgs {
    /// Free length of the bimorph, mm.
    #[arg(long, default_value_t = SensorDesign::reference().length_mm)]
    length_mm: f64,
    /// Radius of the ball at the tip of the probe, mm.
    #[arg(long, default_value_t = SensorDesign::reference().probe_radius_mm)]
    radius_mm: f64,
    /// Length of the probe from the middle of the bimorph to the centre of the ball, mm.
    #[arg(long, default_value_t = SensorDesign::reference().arm_mm)]
    arm_mm: f64,
    /// Width of the bimorph, mm.
    #[arg(long, default_value_t = SensorDesign::reference().width_mm)]
    width_mm: f64,
    /// Mass of the probe, g.
    #[arg(long, default_value_t = SensorDesign::reference().tip_mass_g)]
    tip_mass_g: f64,
}

impl SensorArgs {
    pub(crate) fn sensor(&self) -> Result<Sensor, StudyError> {
        let design = SensorDesign {
            length_mm: self.length_mm,
            probe_radius_mm: self.radius_mm,
            arm_mm: self.arm_mm,
            width_mm: self.width_mm,
            tip_mass_g: self.tip_mass_g,
            ..SensorDesign::reference()
        };
        Sensor::new(design).map_err(StudyError::arguments)
    }
}

/// The contact, and the properties of the tissue except its stiffness.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(crate) struct ContactArgs {
    /// Angle between probe and surface normal, degrees.
    #[arg(long, default_value_t = 0.0)]
    angle_deg: f64,
    /// Direction in which the surface leans.
    #[arg(long, default_value = "front", value_parser = direction_parser())]
    direction: Direction,
    /// Indentation along the probe, mm.
    #[arg(long, default_value_t = 0.5, value_parser = not_negative)]
    indentation_mm: f64,
    /// Take the indentation as a move of the stage, which also deflects the sensor.
    #[arg(long)]
    stage: bool,
    /// Contact law. Default: the paper's for T0 and T0b, Sneddon's for the other tiers.
    #[arg(long, value_parser = law_parser())]
    law: Option<ContactLaw>,
    /// Coefficient of friction. Default: the contact always sticks.
    #[arg(long, conflicts_with = "frictionless", value_parser = not_negative)]
    friction: Option<f64>,
    /// The contact slides without resistance.
    #[arg(long)]
    frictionless: bool,
    /// Poisson's ratio of the tissue.
    #[arg(long, default_value_t = 0.5)]
    poisson: f64,
    /// Loss factor of the tissue.
    #[arg(long, default_value_t = 0.1)]
    loss: f64,
}

impl ContactArgs {
    pub(crate) fn contact(&self, tier: Tier) -> Result<Contact, StudyError> {
        let pose = Pose::leaning(self.direction, self.angle_deg.to_radians())
            .map_err(StudyError::arguments)?;
        Ok(Contact {
            pose,
            depth: self.depth(self.indentation_mm),
            law: self.law(tier),
            friction: self.friction(),
        })
    }

    /// A depth of the selected kind.
    pub(crate) fn depth(&self, along_probe_mm: f64) -> Depth {
        if self.stage {
            Depth::Stage { along_probe_mm }
        } else {
            Depth::Indentation { along_probe_mm }
        }
    }

    pub(crate) fn law(&self, tier: Tier) -> ContactLaw {
        self.law.unwrap_or(match tier {
            Tier::T0 | Tier::T0b => ContactLaw::Paper,
            _ => ContactLaw::Sneddon,
        })
    }

    pub(crate) fn friction(&self) -> Friction {
        match (self.friction, self.frictionless) {
            (Some(coefficient), _) => Friction::Coulomb { coefficient },
            (None, true) => Friction::Frictionless,
            (None, false) => Friction::Sticking,
        }
    }

    pub(crate) fn kind(&self) -> TissueKind {
        TissueKind { poisson: self.poisson, loss: self.loss }
    }
}

/// The description of a contact in results.
#[derive(Debug, Clone, Copy, Serialize)]
pub(crate) struct ContactNames {
    direction: &'static str,
    angle_deg: f64,
    depth_mm: f64,
    control: &'static str,
    law: &'static str,
    poisson: f64,
}

impl ContactArgs {
    pub(crate) fn names(&self, tier: Tier) -> ContactNames {
        ContactNames {
            direction: self.direction.name(),
            angle_deg: self.angle_deg,
            depth_mm: self.indentation_mm,
            control: if self.stage { "stage" } else { "indentation" },
            law: self.law(tier).name(),
            poisson: self.poisson,
        }
    }
}

impl ContactNames {
    pub(crate) const fn law(&self) -> &'static str {
        self.law
    }
}

/// A parser of names, without regard to case.
fn named<T: Copy + Send + Sync + 'static>(
    all: &'static [T],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(all.iter().map(|&one| name(one))).map(move |given| {
        let is_given = |one: &&T| name(**one).eq_ignore_ascii_case(&given);
        *all.iter().find(is_given).expect("the parser accepts only these names")
    })
}

pub(crate) fn tier_parser() -> impl TypedValueParser<Value = Tier> {
    named(&Tier::ALL, Tier::name)
}

/// A number that is not finite, or below zero.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NotANumber {
    /// Not a number at all.
    #[error(transparent)]
    Text(#[from] std::num::ParseFloatError),
    /// A negative, infinite or undefined number.
    #[error("{found} is not a number of zero or more")]
    Below {
        /// The value given.
        found: f64,
    },
}

/// Reads a finite number of zero or more.
pub(crate) fn not_negative(text: &str) -> Result<f64, NotANumber> {
    let found: f64 = text.parse()?;
    if found.is_finite() && found >= 0.0 {
        return Ok(found);
    }
    Err(NotANumber::Below { found })
}

fn direction_parser() -> impl TypedValueParser<Value = Direction> {
    named(&Direction::ALL, Direction::name)
}

fn law_parser() -> impl TypedValueParser<Value = ContactLaw> {
    named(&ContactLaw::ALL, ContactLaw::name)
}
