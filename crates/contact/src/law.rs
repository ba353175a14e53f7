//! Contact laws: contact radius and force of a rigid ball at a given depth.
//!
//! All quantities are relative to the ball's radius R and the contact modulus E* = E/(1 − ν²): depth
//! D = d/R, contact radius a/R, force F/(E* R²). Every law has the normal stiffness 2 E* a, which is
//! exact for any axisymmetric rigid punch on a linear half space. The force is the integral of that
//! stiffness.
//!
//! # Source
//! Stiffness: Pharr, Oliver and Brotzen, J. Mater. Res. 7 (1992) 613.

use crate::sneddon;

/// The law that gives contact radius and force at a depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ContactLaw {
    /// Equation (4) of the paper: the radius of the ball's section at half the depth. It falls beyond a
    /// depth of two radii, and is imaginary beyond four.
    Paper,
    /// Hertz's parabola, for shallow contacts. Beyond a depth of one radius its contact would be wider
    /// than the ball.
    Hertz,
    /// Sneddon's rigid sphere in a linear half space, exact.
    Sneddon,
    /// The power series of Sneddon's solution, within 1.1e-4 of its radius up to a depth of one
    /// radius.
    SneddonSeries,
    /// Finite strain of an incompressible neo-Hookean solid, a fit to finite-element runs up to a
    /// depth of one radius. Those of `tests/peers/contact.py` have up to 2 % less force and 3 % less
    /// stiffness. Its radius is that of the stiffness, not of the visible contact.
    NeoHookean,
}

/// Contact radius and force at one depth, relative to the ball and the contact modulus.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPatch {
    /// Depth normal to the surface over the ball's radius.
    pub depth_rel: f64,
    /// Contact radius over the ball's radius.
    pub radius_rel: f64,
    /// Normal force over contact modulus and ball radius squared.
    pub force_rel: f64,
}

impl ContactPatch {
    /// The patch at depth zero.
    pub const NONE: Self = Self { depth_rel: 0.0, radius_rel: 0.0, force_rel: 0.0 };
}

/// A depth outside the law's validity.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LawError {
    /// The depth is outside the law.
    #[error("{law} contact law: depth of {depth_rel} ball radii is outside [0, {limit_rel}]", law = law.name())]
    Depth {
        /// The contact law.
        law: ContactLaw,
        /// The depth over the ball's radius.
        depth_rel: f64,
        /// The largest depth over the ball's radius.
        limit_rel: f64,
    },
}

impl ContactLaw {
    /// All laws.
    pub const ALL: [Self; 5] =
        [Self::Paper, Self::Hertz, Self::Sneddon, Self::SneddonSeries, Self::NeoHookean];

    /// The word on the command line and in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Hertz => "hertz",
            Self::Sneddon => "sneddon",
            Self::SneddonSeries => "sneddon-series",
            Self::NeoHookean => "neo-hookean",
        }
    }

    /// The largest depth over the ball's radius for which the law holds.
    ///
    /// At two radii the top of the ball is level with the surface, and the paper's radius is largest.
    pub const fn depth_limit_rel(self) -> f64 {
        match self {
            Self::Paper | Self::Sneddon => 2.0,
            Self::Hertz | Self::SneddonSeries | Self::NeoHookean => 1.0,
        }
    }

    /// Contact radius and force at the depth `depth_rel`, in ball radii normal to the surface.
    ///
    /// # Errors
    /// [`LawError::Depth`] for a depth that is negative, beyond [`Self::depth_limit_rel`], or not a
    /// number.
    pub fn at(self, depth_rel: f64) -> Result<ContactPatch, LawError> {
        let limit_rel = self.depth_limit_rel();
        if !(0.0 <= depth_rel && depth_rel <= limit_rel) {
            return Err(LawError::Depth { law: self, depth_rel, limit_rel });
        }
        Ok(self.at_valid(depth_rel))
    }

    /// As [`Self::at`], for a valid depth.
    pub(crate) fn at_valid(self, depth_rel: f64) -> ContactPatch {
        let d = depth_rel;
        let hertz_force = || 4.0 / 3.0 * d * d.sqrt();
        let (radius_rel, force_rel) = match self {
            Self::Paper => paper(d),
            Self::Hertz => (d.sqrt(), hertz_force()),
            Self::Sneddon => sneddon::at(d),
            Self::SneddonSeries => sneddon::series_at(d),
            Self::NeoHookean => (d.sqrt() * (1.0 - 0.25 * d), hertz_force() * (1.0 - 0.15 * d)),
        };
        ContactPatch { depth_rel, radius_rel, force_rel }
    }
}

/// With cos θ = 1 − D/2 the radius is sin θ and the force ∫ 2 sin θ dD = 2θ − sin 2θ.
fn paper(depth_rel: f64) -> (f64, f64) {
    let radius = (depth_rel - 0.25 * depth_rel * depth_rel).max(0.0).sqrt();
    let twice = 4.0 * (0.5 * depth_rel.sqrt()).min(1.0).asin();
    (radius, angle_minus_sine(twice))
}

/// x − sin x, by its series for small x, where the difference would lose digits.
fn angle_minus_sine(x: f64) -> f64 {
    const SERIES_BELOW: f64 = 0.1;
    if x > SERIES_BELOW {
        return x - x.sin();
    }
    let square = x * x;
    let tail = 1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0));
    x * square / 6.0 * tail
}

#[cfg(test)]
mod tests;
