//! The tiers in closed form: T0 and T0b after equation (7), T1 and T2 with one spring and one mass.
//!
//! Their two constants are the no-load resonance and the sensitivity that the paper prints. The
//! constants of another sensor follow by the ratio of its beam to the reference's.

use crate::{ContactLaw, ExactBeam, Load, Pose, Sensor, tip_stiffness::TipStiffness};

/// The no-load resonance that the paper prints, Hz.
pub(crate) const PRINTED_NO_LOAD_HZ: f64 = 140.4;
/// The sensitivity that the paper prints, from the softest sample to the stiffest, Hz/MPa.
pub(crate) const PRINTED_SENSITIVITY_HZ_PER_MPA: f64 = 134.11;
/// Young's moduli of the softest and of the stiffest sample of the paper, MPa.
pub(crate) const PRINTED_RANGE_MPA: (f64, f64) = (0.045, 0.649);
/// Depth over ball radius at which the sensitivity was taken.
const PRINTED_DEPTH_REL: f64 = 1.0;
/// Poisson's ratio of the samples.
const PRINTED_POISSON: f64 = 0.5;

/// The constants of a sensor in tiers T0 to T2, for one contact law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lumped {
    sensor: Sensor,
    no_load_hz: f64,
    /// T0: shift for a normal contact stiffness of 1 N/m.
    hz_per_n_per_m: f64,
    /// T0b: product of shift and loaded resonance over the squared no-load resonance, for 1 N/m.
    product_per_n_per_m: f64,
    /// T1: stiffness at the contact point of the upright probe.
    contact_n_per_m: f64,
    /// T2: stiffness at the end of the bimorph.
    tip_n_per_m: f64,
}

impl Lumped {
    /// The constants of a sensor for this contact law.
    pub(crate) fn new(sensor: &Sensor, law: ContactLaw) -> Self {
        let reference = Sensor::reference();
        let (section, of_reference) = (sensor.section(), reference.section());
        let exact = ExactBeam::new(sensor).no_load_hz() / ExactBeam::new(&reference).no_load_hz();
        let length = section.length_m / of_reference.length_m;
        let bending = section.bending_n_m2 / of_reference.bending_n_m2;
        // The contact stiffness of a sample of 1 MPa at the printed depth.
        let radius_m = law.at_valid(PRINTED_DEPTH_REL).radius_rel * of_reference.radius_m;
        let per_mpa = 2e6 * radius_m / (1.0 - PRINTED_POISSON * PRINTED_POISSON);
        let contact = per_mpa / ratio_per_mpa(1.0);
        let tip = contact * upright_gain(&reference) * bending / length.powi(3);
        Self {
            sensor: *sensor,
            no_load_hz: PRINTED_NO_LOAD_HZ * exact,
            // Equation (7) has ω L in its denominator.
            hz_per_n_per_m: PRINTED_SENSITIVITY_HZ_PER_MPA / per_mpa / (exact * length),
            product_per_n_per_m: 0.25 * ratio_per_mpa(0.5) / per_mpa / (exact * exact * length),
            contact_n_per_m: tip / upright_gain(sensor),
            tip_n_per_m: tip,
        }
    }

    /// Resonance of the free sensor, Hz.
    pub(crate) const fn no_load_hz(&self) -> f64 {
        self.no_load_hz
    }

    /// T0: the shift proportional to the contact stiffness, Hz.
    pub(crate) fn proportional_hz(&self, normal_n_per_m: f64) -> f64 {
        self.hz_per_n_per_m * normal_n_per_m
    }

    /// T0b: the shift by equation (7) with the loaded sensor's ω, Hz.
    ///
    /// Δf (f₀ + Δf) is proportional to the contact stiffness, with a constant of its own.
    pub(crate) fn loaded_hz(&self, normal_n_per_m: f64) -> f64 {
        0.5 * self.shift_of_ratio(4.0 * self.product_per_n_per_m * normal_n_per_m)
    }

    /// T1: the shift of one mass between two springs, Hz.
    pub(crate) fn upright_hz(&self, normal_n_per_m: f64) -> f64 {
        self.shift_of_ratio(normal_n_per_m / self.contact_n_per_m)
    }

    /// T2: the shift of T1 with tangential stiffness, tilt and probe arm, Hz.
    ///
    /// `tangential_ratio` is the tangential over the normal contact stiffness.
    pub(crate) fn tilted_hz(&self, pose: &Pose, normal_n_per_m: f64, tangential_ratio: f64) -> f64 {
        let gain = gain(&self.sensor, pose, tangential_ratio);
        self.shift_of_ratio(normal_n_per_m * gain / self.tip_n_per_m)
    }

    /// f₀ (√(1 + r) − 1) without loss of digits at small r.
    fn shift_of_ratio(&self, ratio: f64) -> f64 {
        self.no_load_hz * ratio / (1.0 + (1.0 + ratio).sqrt())
    }

    /// T2's inverse, N/m.
    pub(crate) fn stiffness_of_tilted(
        &self,
        pose: &Pose,
        shift_hz: f64,
        tangential_ratio: f64,
    ) -> f64 {
        let relative = shift_hz / self.no_load_hz;
        relative * (2.0 + relative) * self.tip_n_per_m / gain(&self.sensor, pose, tangential_ratio)
    }
}

/// The contact point's squared motion for a unit deflection of the tip, weighted by stiffness.
///
/// The slope is that of a beam under a static force at its end, 1.5/L.
fn gain(sensor: &Sensor, pose: &Pose, tangential_ratio: f64) -> f64 {
    let section = sensor.section();
    let slope = 1.5 / section.length_m;
    let load = Load { normal_n_per_m: 1.0, tangential_n_per_m: tangential_ratio, ..Load::NONE };
    let k = TipStiffness::of(section, pose, &load);
    k.ww + slope * (2.0 * k.wp + slope * k.pp)
}

fn upright_gain(sensor: &Sensor) -> f64 {
    let poisson = PRINTED_POISSON;
    gain(sensor, &Pose::UPRIGHT, 2.0 * (1.0 - poisson) / (2.0 - poisson))
}

/// The stiffness ratio r of a sample of 1 MPa with which a shift of `share` f₀ (√(1 + r) − 1) has
/// the printed sensitivity: 2.57 for T1.
///
/// The root of √(1 + r E₅) − √(1 + r E₁) = S (E₅ − E₁)/(share f₀), by Newton's method. The left side
/// rises and is concave in r, so that a start below the root converges without overshoot.
fn ratio_per_mpa(share: f64) -> f64 {
    let (soft, hard) = PRINTED_RANGE_MPA;
    let wanted = PRINTED_SENSITIVITY_HZ_PER_MPA * (hard - soft) / (share * PRINTED_NO_LOAD_HZ);
    let mut ratio = 1.0_f64;
    for _ in 0..NEWTON_STEPS {
        let (a, b) = ((1.0 + ratio * hard).sqrt(), (1.0 + ratio * soft).sqrt());
        let slope = 0.5 * (hard / a - soft / b);
        ratio -= (a - b - wanted) / slope;
    }
    ratio
}

/// From 1 to the roots at 2.57 and 7.0 six steps reach the last digit.
const NEWTON_STEPS: u32 = 8;

#[cfg(test)]
mod tests;
