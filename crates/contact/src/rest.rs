//! The sensor at rest under the force of its contact, around which it vibrates.
//!
//! The force along the surface's normal bends and twists the beam, so that the probe meets the surface
//! at another angle than it was set to. Its part along the beam pulls the beam straight (front) or
//! pushes on it (back), and its part along the probe pushes on the arm, which makes both less stiff.
//! All of this is of first order in the force, and of second order in the motions of the tip. Twist
//! and bending act on each other only through the contact. There is no static friction, because a
//! resting contact creeps.

use crate::{Pose, section::Section};

/// Largest turn of the end of the beam at rest, rad. Up to it the shift agrees within 0.7 % with that of
/// a chain of rigid links that turns by any angle.
pub(crate) const TURN_MAX_RAD: f64 = 0.15;

/// A sensor at rest under a force on its ball, in SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rest {
    /// The force of the surface on the ball, up to the one that turns the end by [`TURN_MAX_RAD`].
    force: [f64; 3],
    /// The end's deflection and slope in the plane of the probe, and its twist.
    deflection: f64,
    slope: f64,
    twist: f64,
    /// Turn of the end for the whole force, rad.
    pub(crate) turn_rad: f64,
    /// Motion of the ball along the surface's normal for each newton.
    pub(crate) compliance_m_per_n: f64,
}

/// The deflection and slope of the end.
type InPlane = (f64, f64);

impl Rest {
    /// The state at rest under a normal force, N.
    pub(crate) fn of(section: &Section, pose: &Pose, force_n: f64) -> Self {
        let n = pose.normal();
        let (l, h) = (section.length_m, section.arm_m);
        // The moments of a newton about the end of the bimorph.
        let [along, across] = section.offset_m;
        let (pitch, roll) = (n[0] * h + n[2] * along, n[1] * h + n[2] * across);
        let slope = (0.5 * n[2] * l + pitch) * l / section.bending_n_m2;
        let twist = roll * l / section.torsion_n_m2;
        let turn_rad = force_n * slope.hypot(twist);
        let held = force_n * (TURN_MAX_RAD / turn_rad.max(TURN_MAX_RAD));
        let force = n.map(|along| held * along);
        // The static stiffness of the end with the pull on the beam and the push on the arm.
        let stiffness = section.bending_n_m2 / l.powi(3);
        let (pull_ww, pull_wp, pull_pp) = pull(section);
        let ww = 12.0 * stiffness + force[0] * pull_ww;
        let wp = -6.0 * l * stiffness + force[0] * pull_wp;
        let pp = 4.0 * l * l * stiffness + force[0] * pull_pp - force[2] * h;
        let determinant = ww * pp - wp * wp;
        let (w, p) = (n[2], pitch);
        // For each newton.
        let (deflection, slope) =
            ((pp * w - wp * p) / determinant, (ww * p - wp * w) / determinant);
        let twist = roll / (section.torsion_n_m2 / l - force[2] * h);
        let shortening = pulled(section, (deflection, slope), (deflection, slope));
        let raised = h * (slope * slope + twist * twist);
        let compliance_m_per_n = n[2] * deflection
            + pitch * slope
            + roll * twist
            + n[1] * n[1] * l.powi(3) / (3.0 * section.lateral_n_m2)
            + 0.5 * held * (n[2] * raised - n[0] * shortening);
        Self {
            force,
            deflection: held * deflection,
            slope: held * slope,
            twist: held * twist,
            turn_rad,
            compliance_m_per_n,
        }
    }

    /// The force along the beam, N; positive where it pulls.
    pub(crate) const fn pull_n(&self) -> f64 {
        self.force[0]
    }

    /// What the force adds to the stiffness over slope and twist, by its push on the arm, N·m.
    pub(crate) fn arm_n_m(&self, section: &Section) -> (f64, f64) {
        let push = section.arm_m * self.force[2];
        (section.arm_m * self.force[0] * self.slope - push, -push)
    }

    /// The motion of the point of contact along x, y and z for each motion (w, φ, v, ψ, θ) of the end.
    ///
    /// The point lies at (x + h φ₀ − R a, y + h θ₀ − R b, −h − R c) from the end of the bimorph, with the
    /// normal (a, b, c) and the offset (x, y) of the ball. A deflection of a bent beam moves its end along the beam too.
    pub(crate) fn point(&self, section: &Section, pose: &Pose) -> [[f64; 5]; 3] {
        let [nx, ny, nz] = pose.normal();
        let (r, h) = (section.radius_m, section.arm_m);
        let at_rest = (self.deflection, self.slope);
        let shorter = |motion: InPlane| pulled(section, at_rest, motion);
        let [x, y] = section.offset_m;
        let (along, aside) = (x + h * self.slope - r * nx, y + h * self.twist - r * ny);
        let reach = h + r * nz;
        [
            [-shorter((1.0, 0.0)), reach - shorter((0.0, 1.0)), 0.0, -aside, 0.0],
            [0.0, 0.0, 1.0, along, reach],
            [1.0, along, 0.0, 0.0, aside],
        ]
    }
}

/// The stiffness over deflection and slope of the end that a pull of 1 N along the beam adds.
pub(crate) fn pull(section: &Section) -> (f64, f64, f64) {
    let l = section.length_m;
    (1.2 / l, -0.1, 2.0 / 15.0 * l)
}

/// ∫ a′ b′ dx over the beam, for two static shapes with these motions of the end.
fn pulled(section: &Section, a: InPlane, b: InPlane) -> f64 {
    let (ww, wp, pp) = pull(section);
    a.0 * (ww * b.0 + wp * b.1) + a.1 * (wp * b.0 + pp * b.1)
}

#[cfg(test)]
mod tests;
