//! The pose of the probe to the sample.

use std::{
    f64::consts::{FRAC_PI_2, PI},
    fmt,
};

use crate::{Deg, Position};

/// The direction in which the surface leans, seen from the sensor.
///
/// Front and back are the two senses of the rotary stage. Left needs the sensor turned a quarter
/// about its own axis, which needs a person.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Direction {
    /// The surface leans in the plane of bending, positive angle.
    Front,
    /// The surface leans in the plane of bending, negative angle.
    Back,
    /// The surface leans across the plane of bending; right is its mirror image.
    Left,
}

impl Direction {
    /// All directions, in the paper's order.
    pub const ALL: [Self; 3] = [Self::Front, Self::Back, Self::Left];

    /// The word in protocol files, results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Front => "front",
            Self::Back => "back",
            Self::Left => "left",
        }
    }

    /// The orientation of the sensor for this direction.
    pub const fn orientation(self) -> Orientation {
        match self {
            Self::Front | Self::Back => Orientation::FrontBack,
            Self::Left => Orientation::Left,
        }
    }

    /// The azimuth of the surface's normal about the probe, from the front over the left, rad.
    ///
    /// At the front the normal leans towards the tip of the bimorph, at the back towards its clamp.
    pub const fn azimuth_rad(self) -> f64 {
        match self {
            Self::Front => 0.0,
            Self::Back => PI,
            Self::Left => FRAC_PI_2,
        }
    }

    /// The position of the rotary stage for a contact angle in this direction.
    pub fn rotary_position(self, angle: ContactAngle) -> Position<Deg> {
        match self {
            Self::Front | Self::Left => Position::new(angle.degrees()),
            // Minus zero would be printed.
            Self::Back => Position::new(0.0 - angle.degrees()),
        }
    }
}

impl fmt::Display for Direction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The orientation of the sensor about its own axis. A person turns it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Orientation {
    /// The rotary stage leans the surface in the plane of bending.
    FrontBack,
    /// The sensor is turned a quarter: the surface leans across the plane of bending.
    Left,
}

impl Orientation {
    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::FrontBack => "front/back",
            Self::Left => "left",
        }
    }
}

impl fmt::Display for Orientation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The angle between the probe and the normal of the surface, from 0° to less than 90°.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct ContactAngle(f64);

/// A contact angle outside [0°, 90°).
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("contact angle {degrees}° is outside [0°, 90°)")]
pub struct ContactAngleError {
    /// The requested angle.
    pub degrees: f64,
}

impl ContactAngle {
    /// Checks an angle in degrees.
    ///
    /// # Errors
    /// [`ContactAngleError`] outside [0°, 90°).
    pub fn new(degrees: f64) -> Result<Self, ContactAngleError> {
        if (0.0..90.0).contains(&degrees) {
            Ok(Self(degrees))
        } else {
            Err(ContactAngleError { degrees })
        }
    }

    /// The angle in degrees.
    pub const fn degrees(self) -> f64 {
        self.0
    }

    /// The angle in radians.
    pub fn radians(self) -> f64 {
        self.0.to_radians()
    }
}

impl fmt::Display for ContactAngle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}°", self.0)
    }
}
