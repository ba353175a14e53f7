//! Refusals of the models.

use crate::{LawError, PoseError, Tier};

/// A contact outside the validity of a model.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// The depth is outside the contact law.
    #[error(transparent)]
    Law(#[from] LawError),
    /// The angle describes no contact.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// The contact slips, so that its stiffness depends on its history.
    #[error(
        "a contact at {angle_deg:.2}° slips at a friction coefficient of {coefficient}: it sticks \
         from {needed:.3} on"
    )]
    Slips {
        /// The contact angle, degrees.
        angle_deg: f64,
        /// The coefficient of friction.
        coefficient: f64,
        /// The smallest coefficient at which it sticks.
        needed: f64,
    },
    /// The tier takes no stage moves, because it lacks the static deflection of the sensor.
    #[error("tier {tier}: a move of the stage is not an indentation", tier = tier.name())]
    StageMove {
        /// The tier that refuses.
        tier: Tier,
    },
    /// The tier has no electrodes, and so no impedance.
    #[error("tier {tier} gives a shift and no impedance", tier = tier.name())]
    NoImpedance {
        /// The tier that refuses.
        tier: Tier,
    },
    /// The contact is too stiff for the mode shape of the tier.
    #[error(
        "tier {tier}: contact stiffness of {ratio:.3} sensor stiffnesses is above {limit}",
        tier = tier.name()
    )]
    TooStiff {
        /// The tier that refuses.
        tier: Tier,
        /// The normal contact stiffness over that of the sensor's tip.
        ratio: f64,
        /// The largest valid ratio.
        limit: f64,
    },
    /// The force of the contact bends the sensor too far.
    #[error(
        "tier {tier}: the force of the contact turns the end of the sensor by {turn_deg:.2}°, above \
         {limit_deg:.2}°",
        tier = tier.name()
    )]
    Turned {
        /// The tier that refuses.
        tier: Tier,
        /// The turn of the end of the bimorph at rest, degrees.
        turn_deg: f64,
        /// The largest valid turn, degrees.
        limit_deg: f64,
    },
    /// The shift exceeds that of the stiffest contact in the tier's validity.
    #[error(
        "tier {tier}: a shift of {shift_hz:.3} Hz is beyond that of a contact of {limit} sensor \
         stiffnesses, the stiffest it takes",
        tier = tier.name()
    )]
    OutOfReach {
        /// The tier that refuses.
        tier: Tier,
        /// The requested shift, Hz.
        shift_hz: f64,
        /// The largest valid ratio.
        limit: f64,
    },
}
