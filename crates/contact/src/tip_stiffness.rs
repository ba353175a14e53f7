//! The stiffness of a contact over the motions of the tip.
//!
//! In the coordinates of a [`Pose`], the tip moves by its deflection w along z, its slope
//! φ = ∂w/∂x, and its twist θ about x. The reference adds the other motions across the plane of
//! bending, in which the bimorph is a hundred times stiffer.

use crate::{Pose, section::Section};

/// A contact stiffness over the tip's motions (w, φ, θ), in SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TipStiffness {
    pub(crate) ww: f64,
    pub(crate) wp: f64,
    pub(crate) pp: f64,
    pub(crate) wt: f64,
    pub(crate) pt: f64,
    pub(crate) tt: f64,
}

impl TipStiffness {
    /// The stiffness for a normal contact stiffness of 1 N/m and a tangential one of `tau`.
    ///
    /// With the normal n = (a, b, c) the contact point lies at −h ẑ − R n from the end of the
    /// bimorph. It moves by ((h + R c) φ, (h + R c) θ, w − R (a φ + b θ)); the part of that along n
    /// is c w + h (a φ + b θ), because turning about the ball's centre moves it sideways only.
    pub(crate) fn of(section: &Section, pose: &Pose, tau: f64) -> Self {
        let [nx, ny, nz] = pose.normal();
        let (r, h) = (section.radius_m, section.arm_m);
        let reach = h + r * nz;
        let rest = 1.0 - tau;
        Self {
            ww: tau + rest * nz * nz,
            wp: nx * (rest * nz * h - tau * r),
            pp: tau * (reach * reach + r * r * nx * nx) + rest * h * h * nx * nx,
            wt: ny * (rest * nz * h - tau * r),
            pt: nx * ny * (tau * r * r + rest * h * h),
            tt: tau * (reach * reach + r * r * ny * ny) + rest * h * h * ny * ny,
        }
    }

    /// Whether bending the beam twists it too.
    pub(crate) fn is_twisting(&self) -> bool {
        self.wt != 0.0 || self.pt != 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Direction, Sensor};

    /// The front/back and left formulas of the lumped tier, which are this matrix between
    /// (1, φ/w, 0).
    #[test]
    fn the_tip_stiffness_is_the_squared_motion_of_the_contact_point() {
        let sensor = Sensor::reference();
        let section = sensor.section();
        let (r, h, slope, tau) = (section.radius_m, section.arm_m, 43.0, 0.6);
        for degrees in [0.0_f64, 20.0, 45.0, 80.0] {
            for direction in Direction::ALL {
                let pose = Pose::leaning(direction, degrees.to_radians()).unwrap();
                let k = TipStiffness::of(section, &pose, tau);
                let found = k.ww + slope * (2.0 * k.wp + slope * k.pp);
                let (s, c) = degrees.to_radians().sin_cos();
                let in_plane = |s: f64| {
                    (c + h * slope * s).powi(2) + tau * (h * slope * c + r * slope - s).powi(2)
                };
                let expected = match direction {
                    Direction::Front => in_plane(s),
                    Direction::Back => in_plane(-s),
                    Direction::Left => c * c + tau * (s * s + (h * slope + r * slope * c).powi(2)),
                };
                assert!((found - expected).abs() < 1e-12, "{direction:?} {degrees}: {found}");
            }
        }
    }
}
