//! The pose of the probe against the surface.
//!
//! Coordinates: x along the bimorph towards the tip, z along the probe away from the sample, y to
//! the left.

use std::f64::consts::FRAC_PI_2;

use rig_model::Direction;

/// Angles that do not describe a contact.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// The contact angle is outside [0, π/2).
    #[error("contact angle {}° is outside [0°, 90°)", angle_rad.to_degrees())]
    Angle {
        /// The requested angle, rad.
        angle_rad: f64,
    },
    /// The azimuth is not a number.
    #[error("azimuth {azimuth_rad} rad is not a number")]
    Azimuth {
        /// The requested azimuth, rad.
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

#[cfg(test)]
mod tests {
    use super::*;

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
