//! The stiffness of a contact over the motions of the tip.
//!
//! In the coordinates of a [`Pose`], the tip moves by its deflection w along z, its slope
//! φ = ∂w/∂x, and its twist θ about x. The reference adds the other motions across the plane of
//! bending, in which the bimorph is a hundred times stiffer.

use crate::{
    Load, Pose,
    rest::{Rest, pull},
    section::Section,
};

/// A stiffness over the tip's motions (w, φ, θ), in SI units.
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
    /// The stiffness of the tissue.
    pub(crate) fn of_tissue(section: &Section, pose: &Pose, load: &Load, rest: &Rest) -> Self {
        let n = pose.normal();
        let point = rest.point(section, pose);
        let column = |motion: usize| point.map(|along| along[motion]);
        let (w, p, t) = (column(0), column(1), column(4));
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let tangential = load.tangential_n_per_m;
        let rest = load.normal_n_per_m - tangential;
        let [along_w, along_p, along_t] = [dot(n, w), dot(n, p), dot(n, t)];
        Self {
            ww: tangential * dot(w, w) + rest * along_w * along_w,
            wp: tangential * dot(w, p) + rest * along_w * along_p,
            pp: tangential * dot(p, p) + rest * along_p * along_p,
            wt: tangential * dot(w, t) + rest * along_w * along_t,
            pt: tangential * dot(p, t) + rest * along_p * along_t,
            tt: tangential * dot(t, t) + rest * along_t * along_t,
        }
    }

    /// What the force at rest adds.
    pub(crate) fn of_force(section: &Section, rest: &Rest) -> Self {
        let ((ww, wp, pp), force) = (pull(section), rest.pull_n());
        let (slope, twist) = rest.arm_n_m(section);
        Self { ww: force * ww, wp: force * wp, pp: force * pp + slope, wt: 0.0, pt: 0.0, tt: twist }
    }

    /// Both.
    pub(crate) fn of(section: &Section, pose: &Pose, load: &Load) -> Self {
        let rest = Rest::of(section, pose, load.force_n);
        let mut sum = Self::of_tissue(section, pose, load, &rest);
        let added = Self::of_force(section, &rest);
        sum.ww += added.ww;
        sum.wp += added.wp;
        sum.pp += added.pp;
        sum.tt += added.tt;
        sum
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
    /// (1, φ/w, 0) without a force.
    #[test]
    fn the_tip_stiffness_is_the_squared_motion_of_the_contact_point() {
        let sensor = Sensor::reference();
        let section = sensor.section();
        let (r, h, slope, tau) = (section.radius_m, section.arm_m, 43.0, 0.6);
        let load = Load { normal_n_per_m: 1.0, tangential_n_per_m: tau, ..Load::NONE };
        for degrees in [0.0_f64, 20.0, 45.0, 80.0] {
            for direction in Direction::ALL {
                let pose = Pose::leaning(direction, degrees.to_radians()).unwrap();
                let k = TipStiffness::of(section, &pose, &load);
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
