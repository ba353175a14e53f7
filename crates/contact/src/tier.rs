//! The tiers: their names and their validity.

use crate::rest::TURN_MAX_RAD;

/// A model of the sensor's vibration, from the cheapest to the most expensive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Tier {
    /// Equation (7): proportional to the contact stiffness.
    T0,
    /// Equation (7) with the loaded sensor's frequency.
    T0b,
    /// One mass between two springs.
    T1,
    /// T1 with tangential stiffness, tilt and probe arm.
    T2,
    /// T2 with the static deflection of the sensor under a stage move.
    T2s,
    /// One beam element, under the static force of the contact.
    E1,
    /// E1 with the static deflection of the sensor under a stage move.
    E1s,
    /// The exact beam without losses, with static deflection and force.
    Exact,
    /// Sixteen elements in space with losses and electrodes, with static deflection and force.
    Reference,
}

/// The validity of a tier.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Validity {
    /// Largest contact stiffness over the stiffness of the sensor's tip, 3EI/L³.
    pub stiffness_ratio_max: f64,
    /// Largest turn of the end of the sensor by the force of the contact, rad; infinite for a tier
    /// that leaves this force out.
    pub turn_max_rad: f64,
    /// Whether it models the static deflection of the sensor under a stage move.
    pub takes_stage_moves: bool,
    /// Whether it models losses and electrodes, and so gives an impedance.
    pub has_impedance: bool,
}

impl Tier {
    /// All tiers, from the cheapest to the most expensive.
    pub const ALL: [Self; 9] = [
        Self::T0,
        Self::T0b,
        Self::T1,
        Self::T2,
        Self::T2s,
        Self::E1,
        Self::E1s,
        Self::Exact,
        Self::Reference,
    ];

    /// The word on the command line and in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::T0 => "T0",
            Self::T0b => "T0b",
            Self::T1 => "T1",
            Self::T2 => "T2",
            Self::T2s => "T2s",
            Self::E1 => "E1",
            Self::E1s => "E1s",
            Self::Exact => "exact",
            Self::Reference => "reference",
        }
    }

    /// The validity of the tier.
    ///
    /// The ratios are those at which the error of the mode shape reaches 3 %. T0 and T0b end with the
    /// range on which their constant was fitted. The limit of the reference is the stiffness at which
    /// the held beam shows no resonance in the impedance.
    pub const fn validity(self) -> Validity {
        let (stiffness_ratio_max, takes_stage_moves, has_impedance) = match self {
            Self::T0 | Self::T0b => (3.0, false, false),
            Self::T1 | Self::T2 => (10.0, false, false),
            Self::T2s => (10.0, true, false),
            Self::E1 => (30.0, false, true),
            Self::E1s => (30.0, true, true),
            Self::Exact => (f64::INFINITY, true, false),
            Self::Reference => (1e4, true, true),
        };
        let turn_max_rad = match self {
            Self::T0 | Self::T0b | Self::T1 | Self::T2 | Self::T2s => f64::INFINITY,
            Self::E1 | Self::E1s | Self::Exact | Self::Reference => TURN_MAX_RAD,
        };
        Validity { stiffness_ratio_max, turn_max_rad, takes_stage_moves, has_impedance }
    }
}
