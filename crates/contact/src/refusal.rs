//! Why a model declines to answer.

use crate::{LawError, Tier};

/// A contact outside the validity of what was asked.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// The depth is outside the contact law.
    #[error(transparent)]
    Law(#[from] LawError),
    /// The contact slips, and its stiffness depends on how it came there.
    #[error(
        "contact angle {angle_deg:.2}° slips at a friction coefficient of {coefficient}, \
         which holds up to {limit_deg:.2}°"
    )]
    Slips {
        /// The contact angle, degrees.
        angle_deg: f64,
        /// The coefficient of friction.
        coefficient: f64,
        /// The largest contact angle that sticks, degrees.
        limit_deg: f64,
    },
    /// The tier takes no move of the stage, because it does not know that the sensor gives way.
    #[error("tier {tier}: a move of the stage is not an indentation", tier = tier.name())]
    StageMove {
        /// The tier asked.
        tier: Tier,
    },
    /// The tier has no electrodes, and so no impedance.
    #[error("tier {tier} gives a shift and no impedance", tier = tier.name())]
    NoImpedance {
        /// The tier asked.
        tier: Tier,
    },
    /// The contact is too stiff for the tier's shape of the beam.
    #[error(
        "tier {tier}: contact stiffness of {ratio:.3} sensor stiffnesses is above {limit}",
        tier = tier.name()
    )]
    TooStiff {
        /// The tier asked.
        tier: Tier,
        /// The normal contact stiffness over that of the sensor's tip.
        ratio: f64,
        /// The largest ratio for which the tier holds.
        limit: f64,
    },
    /// No contact that the tier takes gives such a shift.
    #[error(
        "tier {tier}: a shift of {shift_hz:.3} Hz is beyond that of a contact of {limit} sensor \
         stiffnesses, the stiffest it takes",
        tier = tier.name()
    )]
    OutOfReach {
        /// The tier asked.
        tier: Tier,
        /// The shift, Hz.
        shift_hz: f64,
        /// The largest ratio for which the tier holds.
        limit: f64,
    },
}
