//! Static equilibrium of tissue and sensor under a move of the stage.
//!
//! A move of the stage is not an indentation: the ball indents the tissue by d while the bimorph
//! deflects by c F(d), with the compliance c of the ball along the surface's normal. The sum is the
//! move along that normal. The sum rises with d, so that the equilibrium is unique. The static
//! contact has no friction, because a resting contact creeps; friction acts in vibration only.

use crate::{ContactLaw, ContactPatch, LawError};

/// The contact in equilibrium.
///
/// `move_rel` is the stage's move along the surface's normal in ball radii. `compliance_rel` gives
/// c E* R, the compliance of the ball relative to that of the tissue, at a relative force. It changes
/// little with the force.
///
/// # Errors
/// [`LawError::Depth`] when the equilibrium lies beyond the law's validity.
pub(crate) fn of_stage_move(
    law: ContactLaw,
    move_rel: f64,
    compliance_rel: impl Fn(f64) -> f64,
) -> Result<ContactPatch, LawError> {
    let limit_rel = law.depth_limit_rel();
    let refuse = |depth_rel| Err(LawError::Depth { law, depth_rel, limit_rel });
    if move_rel.is_nan() || move_rel < 0.0 {
        return refuse(move_rel);
    }
    let most = law.at_valid(limit_rel);
    let given = compliance_rel(most.force_rel) * most.force_rel;
    if most.depth_rel + given < move_rel {
        return refuse(move_rel - given);
    }
    let start = hertz_equilibrium(move_rel, compliance_rel(0.0));
    let mut patch = law.at_valid(start.min(limit_rel));
    // The sum is convex and rises: from any start the first Newton step lands above the equilibrium,
    // and the next ones descend to it. A step shrinks a depth that the force dominates to a third in
    // the worst case.
    for _ in 0..STEPS_MAX {
        let compliance_rel = compliance_rel(patch.force_rel);
        let excess = patch.depth_rel + compliance_rel * patch.force_rel - move_rel;
        let step = excess / (1.0 + 2.0 * compliance_rel * patch.radius_rel);
        patch = law.at_valid((patch.depth_rel - step).clamp(0.0, limit_rel));
        if step.abs() <= STEP_TOLERANCE * patch.depth_rel {
            break;
        }
    }
    Ok(patch)
}

/// The contact in equilibrium when its normal stiffness 2 E* a is known.
///
/// `compliance_rel` gives the sensor's compliance c times that stiffness at a ratio of relative force
/// to contact radius: D + c F/R is the move.
///
/// # Errors
/// [`LawError::Depth`] when the equilibrium lies beyond the law's validity.
pub(crate) fn of_known_stiffness(
    law: ContactLaw,
    move_rel: f64,
    compliance_rel: impl Fn(f64) -> f64,
) -> Result<ContactPatch, LawError> {
    let limit_rel = law.depth_limit_rel();
    let sum = |patch: &ContactPatch| {
        let ratio = if patch.radius_rel == 0.0 { 0.0 } else { patch.force_rel / patch.radius_rel };
        patch.depth_rel + 0.5 * compliance_rel(ratio) * ratio
    };
    let (mut low, mut high) = (0.0, limit_rel.min(move_rel));
    let top = law.at(high)?;
    if sum(&top) < move_rel {
        let depth_rel = move_rel - sum(&top) + limit_rel;
        return Err(LawError::Depth { law, depth_rel, limit_rel });
    }
    // F/(2a) is close to a third of the depth for every law, so that the sum is nearly linear.
    let mut patch = law.at_valid(high * move_rel / sum(&top).max(f64::MIN_POSITIVE));
    for _ in 0..STEPS_MAX {
        let found = sum(&patch);
        if found > move_rel {
            high = patch.depth_rel;
        } else {
            low = patch.depth_rel;
        }
        let next = patch.depth_rel * move_rel / found.max(f64::MIN_POSITIVE);
        let next = if low < next && next < high { next } else { 0.5 * (low + high) };
        let step = (next - patch.depth_rel).abs();
        patch = law.at_valid(next);
        if step <= EXACT_TOLERANCE * next {
            break;
        }
    }
    Ok(patch)
}

/// A few Newton steps for Hertz's law in s with s² the depth: s² + 4/3 c s³ is the move.
fn hertz_equilibrium(move_rel: f64, compliance_rel: f64) -> f64 {
    let cubic = 4.0 / 3.0 * compliance_rel;
    let mut root = move_rel.sqrt();
    for _ in 0..3 {
        let excess = root * root * (1.0 + cubic * root) - move_rel;
        root -= excess / (root * (2.0 + 3.0 * cubic * root)).max(f64::MIN_POSITIVE);
    }
    root * root
}

/// Largest last step, relative to the depth. The remaining error is a hundredth of it, by the change
/// of the compliance with the force.
const STEP_TOLERANCE: f64 = 1e-10;
/// Largest last step, relative to the depth, of an iteration that converges linearly.
const EXACT_TOLERANCE: f64 = 1e-14;
/// Enough steps from a depth of two radii to one of 1e-20.
const STEPS_MAX: u32 = 60;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_equilibrium_holds_from_the_softest_sensor_to_the_stiffest() {
        for law in ContactLaw::ALL {
            for exponent in -16..=6 {
                let compliance_rel = 10.0_f64.powi(exponent);
                for move_rel in [1e-9, 1e-4, 0.1, 0.5, 0.9] {
                    let patch = of_stage_move(law, move_rel, |_| compliance_rel).unwrap();
                    let sum = patch.depth_rel + compliance_rel * patch.force_rel;
                    assert!(
                        (sum / move_rel - 1.0).abs() < 1e-12,
                        "{law:?} {compliance_rel} {move_rel}"
                    );
                }
            }
        }
    }

    #[test]
    fn no_move_is_no_contact_and_a_stiff_sensor_indents_by_the_whole_move() {
        assert_eq!(of_stage_move(ContactLaw::Sneddon, 0.0, |_| 1.0), Ok(ContactPatch::NONE));
        let patch = of_stage_move(ContactLaw::Sneddon, 0.7, |_| 0.0).unwrap();
        assert_eq!(patch, ContactLaw::Sneddon.at(0.7).unwrap());
    }

    #[test]
    fn a_move_beyond_the_law_is_taken_only_when_the_sensor_deflects_enough() {
        let law = ContactLaw::SneddonSeries;
        assert!(of_stage_move(law, 1.1, |_| 0.0).is_err());
        assert!(of_stage_move(law, 1.1, |_| 1.0).is_ok());
        let limit = law.at(1.0).unwrap();
        assert!(of_stage_move(law, 1.0 + 0.5 * limit.force_rel, |_| 0.5).is_ok());
        assert!(of_stage_move(law, 1.0 + 0.501 * limit.force_rel, |_| 0.5).is_err());
        assert!(of_stage_move(law, f64::NAN, |_| 1.0).is_err());
        assert!(of_stage_move(law, -1e-9, |_| 1.0).is_err());
    }
}
