//! The pose of the probe against the surface, and the motion of the contact point.
//!
//! Coordinates: x along the bimorph towards the tip, z along the probe away from the sample, y to
//! the left. The tip moves by its deflection w along z, its slope φ = ∂w/∂x, and its twist θ about
//! x. The reference adds the other motions across the plane of bending, in which the bimorph is a
//! hundred times stiffer.

use std::f64::consts::{FRAC_PI_2, PI};

use crate::section::Section;

/// The direction in which the surface leans, seen from the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Direction {
    /// The surface's normal leans towards the tip of the bimorph.
    Front,
    /// The surface's normal leans towards the clamp.
    Back,
    /// The surface's normal leans across the bimorph. Right is the mirror image.
    Left,
}

impl Direction {
    /// All directions, in the paper's order.
    pub const ALL: [Self; 3] = [Self::Front, Self::Back, Self::Left];

    /// The azimuth of the surface's normal about the probe, from the front over the left, rad.
    pub const fn azimuth_rad(self) -> f64 {
        match self {
            Self::Front => 0.0,
            Self::Back => PI,
            Self::Left => FRAC_PI_2,
        }
    }

    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Front => "front",
            Self::Back => "back",
            Self::Left => "left",
        }
    }
}

/// Angles that do not describe a contact.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// The contact angle is outside [0, π/2).
    #[error("contact angle {}° is outside [0°, 90°)", angle_rad.to_degrees())]
    Angle {
        /// The angle asked for, rad.
        angle_rad: f64,
    },
    /// The azimuth is not a number.
    #[error("azimuth {azimuth_rad} rad is not a number")]
    Azimuth {
        /// The azimuth asked for, rad.
        azimuth_rad: f64,
    },
}

/// The contact angle between probe and surface normal, and the azimuth of that normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    angle_rad: f64,
    azimuth_rad: f64,
    /// The surface's normal, a unit vector in (x, y, z).
    normal: [f64; 3],
}

impl Pose {
    /// The probe normal to the surface.
    pub const UPRIGHT: Self = Self { angle_rad: 0.0, azimuth_rad: 0.0, normal: [0.0, 0.0, 1.0] };

    /// A pose with the contact angle in [0, π/2) and any azimuth, both in rad.
    ///
    /// # Errors
    /// [`PoseError`].
    pub fn new(angle_rad: f64, azimuth_rad: f64) -> Result<Self, PoseError> {
        if !(0.0..FRAC_PI_2).contains(&angle_rad) {
            return Err(PoseError::Angle { angle_rad });
        }
        if !azimuth_rad.is_finite() {
            return Err(PoseError::Azimuth { azimuth_rad });
        }
        let (sin, cos) = angle_rad.sin_cos();
        let (across, along) = azimuth_rad.sin_cos();
        Ok(Self { angle_rad, azimuth_rad, normal: [sin * along, sin * across, cos] })
    }

    /// A pose in one of the paper's directions, with the contact angle in [0, π/2), rad.
    ///
    /// # Errors
    /// [`PoseError::Angle`].
    pub fn leaning(direction: Direction, angle_rad: f64) -> Result<Self, PoseError> {
        let mut pose = Self::new(angle_rad, direction.azimuth_rad())?;
        // The sines of these azimuths are 0 and ±1; those of the nearest floats are not.
        let sin = angle_rad.sin();
        (pose.normal[0], pose.normal[1]) = match direction {
            Direction::Front => (sin, 0.0),
            Direction::Back => (-sin, 0.0),
            Direction::Left => (0.0, sin),
        };
        Ok(pose)
    }

    /// The contact angle, rad.
    pub const fn angle_rad(&self) -> f64 {
        self.angle_rad
    }

    /// The azimuth of the surface's normal about the probe, rad.
    pub const fn azimuth_rad(&self) -> f64 {
        self.azimuth_rad
    }

    /// The cosine of the contact angle.
    pub const fn cos(&self) -> f64 {
        self.normal[2]
    }

    /// The surface's normal, a unit vector in (x, y, z).
    pub(crate) const fn normal(&self) -> [f64; 3] {
        self.normal
    }
}

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
        let [nx, ny, nz] = pose.normal;
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
    use crate::Sensor;

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

    #[test]
    fn an_angle_of_ninety_degrees_is_refused_and_one_just_below_is_taken() {
        let refusal = Pose::new(FRAC_PI_2, 0.0).unwrap_err();
        assert_eq!(refusal.to_string(), "contact angle 90° is outside [0°, 90°)");
        assert!(Pose::new(FRAC_PI_2 - 1e-9, 0.0).is_ok());
        assert!(Pose::new(-1e-9, 0.0).is_err());
        assert!(Pose::new(f64::NAN, 0.0).is_err());
        assert!(Pose::new(0.1, f64::INFINITY).is_err());
    }
}
