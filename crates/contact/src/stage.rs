//! The balance between a stage that moves and a sensor that gives way.
//!
//! A move of the stage is not an indentation: the ball sinks in by d while the bimorph bends away
//! by c F(d), with the compliance c of the ball along the surface's normal. The sum is the move
//! along that normal. It is monotone in d, so that there is one balance. The contact is taken
//! without friction while it settles, because a resting contact creeps; friction acts in vibration
//! only.

use crate::{ContactLaw, LawError, Spot};

/// The contact at which ball and bimorph balance.
///
/// `move_rel` is the stage's move along the surface's normal in ball radii; `softness` is c E* R,
/// the compliance of the ball relative to that of the tissue.
///
/// # Errors
/// [`LawError::Depth`] when the balance lies beyond the law's validity.
pub(crate) fn balance(law: ContactLaw, move_rel: f64, softness: f64) -> Result<Spot, LawError> {
    let limit_rel = law.depth_limit_rel();
    let refuse = |depth_rel| Err(LawError::Depth { law, depth_rel, limit_rel });
    if move_rel.is_nan() || move_rel < 0.0 {
        return refuse(move_rel);
    }
    let most = law.at_valid(limit_rel);
    if most.depth_rel + softness * most.force_rel < move_rel {
        return refuse(move_rel - softness * most.force_rel);
    }
    let mut spot = law.at_valid(hertz_balance(move_rel, softness).min(limit_rel));
    // The sum is convex and rises: from wherever it starts, Newton's method lands above the balance
    // and then comes down to it. It shrinks a depth that the force dominates to a third at each step
    // at the worst.
    for _ in 0..STEPS_MAX {
        let excess = spot.depth_rel + softness * spot.force_rel - move_rel;
        let step = excess / (1.0 + 2.0 * softness * spot.radius_rel);
        spot = law.at_valid((spot.depth_rel - step).clamp(0.0, limit_rel));
        if step.abs() <= STEP_TOLERANCE * spot.depth_rel {
            break;
        }
    }
    Ok(spot)
}

/// The depth at which ball and bimorph balance with a known normal stiffness 2 E* a of the contact.
///
/// `give_rel` is the sensor's compliance times that stiffness: D + give F/(2 E* a R) is the move.
///
/// # Errors
/// [`LawError::Depth`] when the balance lies beyond the law's validity.
pub(crate) fn balance_of_stiffness(
    law: ContactLaw,
    move_rel: f64,
    give_rel: f64,
) -> Result<Spot, LawError> {
    let limit_rel = law.depth_limit_rel();
    let sum = |spot: &Spot| {
        let ratio = if spot.radius_rel == 0.0 { 0.0 } else { spot.force_rel / spot.radius_rel };
        spot.depth_rel + 0.5 * give_rel * ratio
    };
    let (mut low, mut high) = (0.0, limit_rel.min(move_rel));
    let top = law.at(high)?;
    if sum(&top) < move_rel {
        let depth_rel = move_rel - sum(&top) + limit_rel;
        return Err(LawError::Depth { law, depth_rel, limit_rel });
    }
    // F/(2a) is close to a third of the depth for every law, so that the sum is nearly linear.
    let mut spot = law.at_valid(high * move_rel / sum(&top).max(f64::MIN_POSITIVE));
    for _ in 0..STEPS_MAX {
        let found = sum(&spot);
        if found > move_rel {
            high = spot.depth_rel;
        } else {
            low = spot.depth_rel;
        }
        let next = spot.depth_rel * move_rel / found.max(f64::MIN_POSITIVE);
        let next = if low < next && next < high { next } else { 0.5 * (low + high) };
        let step = (next - spot.depth_rel).abs();
        spot = law.at_valid(next);
        if step <= EXACT_TOLERANCE * next {
            break;
        }
    }
    Ok(spot)
}

/// A few of Newton's steps for Hertz's law, in s with s² the depth: s² + 4/3 c s³ is the move.
fn hertz_balance(move_rel: f64, softness: f64) -> f64 {
    let cubic = 4.0 / 3.0 * softness;
    let mut root = move_rel.sqrt();
    for _ in 0..3 {
        let excess = root * root * (1.0 + cubic * root) - move_rel;
        root -= excess / (root * (2.0 + 3.0 * cubic * root)).max(f64::MIN_POSITIVE);
    }
    root * root
}

/// Relative to the depth. What is left is about the square of it.
const STEP_TOLERANCE: f64 = 1e-7;
/// Relative to the depth, where each step leaves a share of the last.
const EXACT_TOLERANCE: f64 = 1e-14;
/// Enough to come from a depth of two radii down to 1e-20.
const STEPS_MAX: u32 = 60;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_balance_holds_from_the_softest_sensor_to_the_stiffest() {
        for law in ContactLaw::ALL {
            for exponent in -16..=6 {
                let softness = 10.0_f64.powi(exponent);
                for move_rel in [1e-9, 1e-4, 0.1, 0.5, 0.9] {
                    let spot = balance(law, move_rel, softness).unwrap();
                    let sum = spot.depth_rel + softness * spot.force_rel;
                    assert!((sum / move_rel - 1.0).abs() < 1e-12, "{law:?} {softness} {move_rel}");
                }
            }
        }
    }

    #[test]
    fn no_move_is_no_contact_and_a_stiff_sensor_indents_by_the_whole_move() {
        assert_eq!(balance(ContactLaw::Sneddon, 0.0, 1.0), Ok(Spot::NONE));
        let spot = balance(ContactLaw::Sneddon, 0.7, 0.0).unwrap();
        assert_eq!(spot, ContactLaw::Sneddon.at(0.7).unwrap());
    }

    #[test]
    fn a_move_beyond_the_law_is_taken_only_when_the_sensor_gives_way_enough() {
        let law = ContactLaw::SneddonSeries;
        assert!(balance(law, 1.1, 0.0).is_err());
        assert!(balance(law, 1.1, 1.0).is_ok());
        let limit = law.at(1.0).unwrap();
        assert!(balance(law, 1.0 + 0.5 * limit.force_rel, 0.5).is_ok());
        assert!(balance(law, 1.0 + 0.501 * limit.force_rel, 0.5).is_err());
        assert!(balance(law, f64::NAN, 1.0).is_err());
        assert!(balance(law, -1e-9, 1.0).is_err());
    }
}
