//! Equations (1), (4), (5), (8) and (9) of the paper as printed, in SI units, and its bounds.
//!
//! The studies judge them; no tier depends on them. Where text and formulas contradict each other or
//! mechanics, the documentation of the function says so.
//!
//! # Source
//! A Piezoelectric Tactile Sensor for Tissue Stiffness Detection with Arbitrary Contact Angle,
//! Sensors 20 (2020) 6607, section 2.

use std::f64::consts::{FRAC_PI_4, PI};

use num_complex::Complex64;

use crate::{ContactLaw, LawError};

/// The tissue properties in equation (1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TissueConstants {
    /// Young's modulus, Pa.
    pub young_pa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Density, kg/m³.
    pub density_kg_per_m3: f64,
    /// The coefficient a₁₁ of the mass. The paper gives no value.
    pub mass_factor: f64,
    /// The coefficient a₁₂ of the resistance. The paper gives no value.
    pub resistance_factor: f64,
}

/// The tissue's part of the equivalent circuit, equation (1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TissueImpedance {
    /// rₓ, kg/s.
    pub resistance_kg_per_s: f64,
    /// 1/cₓ, N/m. With S = πa² it is 2 E* a, the exact stiffness of a rigid punch.
    ///
    /// The text calls its counterpart c₁ of the sensor "the damping"; it is a compliance.
    pub stiffness_n_per_m: f64,
    /// lₓ, kg.
    pub mass_kg: f64,
}

impl TissueImpedance {
    /// Equation (1) for a contact of the area S in m².
    pub fn of(tissue: &TissueConstants, area_m2: f64) -> Self {
        let TissueConstants { young_pa, poisson, density_kg_per_m3, .. } = *tissue;
        let resistance = 2.0 * 2.0_f64.sqrt() * tissue.resistance_factor
            / (PI * (1.0 - poisson) * (1.0 + poisson).sqrt())
            * (density_kg_per_m3 * young_pa).sqrt()
            * area_m2;
        let stiffness = 2.0 / (PI.sqrt() * (1.0 - poisson * poisson)) * young_pa * area_m2.sqrt();
        let mass = 4.0 * tissue.mass_factor / (PI.powf(1.5) * (1.0 - poisson))
            * density_kg_per_m3
            * area_m2.powf(1.5);
        Self { resistance_kg_per_s: resistance, stiffness_n_per_m: stiffness, mass_kg: mass }
    }

    /// The mechanical impedance Zₓ = rₓ + j(ω lₓ − 1/(ω cₓ)), kg/s.
    pub fn at(&self, omega_rad_per_s: f64) -> Complex64 {
        Complex64::new(self.resistance_kg_per_s, self.reactance_kg_per_s(omega_rad_per_s))
    }

    fn reactance_kg_per_s(&self, omega_rad_per_s: f64) -> f64 {
        omega_rad_per_s * self.mass_kg - self.stiffness_n_per_m / omega_rad_per_s
    }
}

/// A ball of radius R pressed in by Δ along the probe at a contact angle.
///
/// The text writes the same depth as Δ and as δ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Press {
    /// R, mm.
    pub ball_mm: f64,
    /// δ, along the probe, mm.
    pub depth_mm: f64,
    /// α, rad.
    pub angle_rad: f64,
}

impl Press {
    /// The depth normal to the surface over the ball's radius.
    fn depth_rel(&self) -> f64 {
        self.depth_mm * self.angle_rad.cos() / self.ball_mm
    }
}

/// Equations (4) and (5): the contact radius a' in mm.
///
/// It is the radius of the ball's section at half the depth. The text asks for a ≤ R, which always
/// holds. The formula needs δ cos α ≤ 2R: beyond, the radius falls with the depth.
///
/// # Errors
/// [`LawError::Depth`] outside 0 ≤ δ cos α ≤ 2R.
pub fn contact_radius_mm(press: Press) -> Result<f64, LawError> {
    Ok(ContactLaw::Paper.at(press.depth_rel())?.radius_rel * press.ball_mm)
}

/// The values of cos 45° and cos² 45° in equations (8) and (9).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arithmetic {
    /// cos 45° = √½ and cos² 45° = ½.
    Exact,
    /// As printed: cos 45° = 0.7, but its square 0.5 instead of 0.49.
    Printed,
}

impl Arithmetic {
    fn cosine_and_square(self) -> (f64, f64) {
        match self {
            Self::Exact => (FRAC_PI_4.cos(), 0.5),
            Self::Printed => (0.7, 0.5),
        }
    }
}

/// Equation (8) without its constants: the fall a(0°) − a'(45°) of the contact radius over R, for
/// the depth δ in ball radii.
///
/// Multiplied by C E R/(π ω L Z₁ (1 − ν²)) it is D₁ in Hz. In the printed equation the roots end
/// before the terms with δ², which would add a length to an area; as in (9) they belong inside.
///
/// # Errors
/// [`LawError::Depth`] outside 0 ≤ δ ≤ 2R, where equation (4) does not hold.
pub fn angle_influence(depth_rel: f64, arithmetic: Arithmetic) -> Result<f64, LawError> {
    let upright = ContactLaw::Paper.at(depth_rel)?.radius_rel;
    Ok(upright - tilted(depth_rel, arithmetic))
}

fn tilted(depth_rel: f64, arithmetic: Arithmetic) -> f64 {
    let (cosine, square) = arithmetic.cosine_and_square();
    (cosine * depth_rel - 0.25 * square * depth_rel * depth_rel).max(0.0).sqrt()
}

/// Equation (9): D₁/D₂ at 0° for the stiffness ratio Eᵢ/Eⱼ, for the depth δ in ball radii.
///
/// The equation contains neither L nor any other constant of the sensor. The result is infinite for
/// equal stiffnesses.
///
/// # Errors
/// [`LawError::Depth`] outside 0 ≤ δ ≤ 2R.
pub fn influence_over_discrimination(
    depth_rel: f64,
    stiffness_ratio: f64,
    arithmetic: Arithmetic,
) -> Result<f64, LawError> {
    let fall = angle_influence(depth_rel, arithmetic)?;
    let upright = ContactLaw::Paper.at(depth_rel)?.radius_rel;
    // The limit of the quotient for shallow contacts, which follow Hertz.
    let relative = if depth_rel == 0.0 {
        1.0 - arithmetic.cosine_and_square().0.sqrt()
    } else {
        fall / upright
    };
    Ok(stiffness_ratio * relative / (stiffness_ratio - 1.0))
}

/// The R/δ at which equation (8) is zero.
///
/// It is (1 + cos 45°)/4 = 0.4268 exactly and 0.4167 in printed arithmetic, which the paper rounds
/// to 0.42. Both lie outside equation (4), which needs R ≥ 0.5 δ. Within it D₁ is always positive.
pub fn radius_without_angle_influence(arithmetic: Arithmetic) -> f64 {
    // R δ − δ²/4 = cos Rδ − cos² δ²/4.
    let (cosine, square) = arithmetic.cosine_and_square();
    0.25 * (1.0 - square) / (1.0 - cosine)
}

/// The largest R/δ for which D₁ < D₂ at 0°, or `None` when every ball separates the pair.
///
/// The shift falls by less than 1 − √cos 45° = 15.9 %, the fall in Hertz's contact of a large ball.
/// Any ball therefore separates every pair with Eᵢ > 1.1892 Eⱼ. The paper finds R < 2.5 Δ for its
/// ratio of 1.2, which has no upper bound; that bound belongs to a ratio of 1.17.
pub fn largest_separating_radius(stiffness_ratio: f64, arithmetic: Arithmetic) -> Option<f64> {
    // √((c D − s D²/4)/(D − D²/4)) > 1/q with q the ratio: (c q² − 1) > (s q² − 1) D/4.
    let (cosine, square) = arithmetic.cosine_and_square();
    let q2 = stiffness_ratio * stiffness_ratio;
    let (left, right) = (cosine * q2 - 1.0, square * q2 - 1.0);
    if left >= 0.0 {
        return None;
    }
    // Both negative: D > 4 left/right, that is R/δ < right/(4 left).
    Some(0.25 * right / left)
}

/// The largest R/δ for which D₁ < D₂ with D₂ taken at 45°, or `None` when every ball separates the
/// pair.
///
/// The condition is stricter at 45°: Eᵢ (a₀ − a₄₅) < (Eᵢ − Eⱼ) a₄₅.
pub fn largest_separating_radius_tilted(
    stiffness_ratio: f64,
    arithmetic: Arithmetic,
) -> Option<f64> {
    // a₀ < (2 − 1/q) a₄₅: with p the bracket, D − D²/4 < p² (c D − s D²/4).
    let (cosine, square) = arithmetic.cosine_and_square();
    let p2 = (2.0 - 1.0 / stiffness_ratio).powi(2);
    let (left, right) = (cosine * p2 - 1.0, square * p2 - 1.0);
    if left >= 0.0 {
        return None;
    }
    Some(0.25 * right / left)
}

#[cfg(test)]
mod tests;
