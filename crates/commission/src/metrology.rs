//! The geometry of a bench, and the error of its linear screw, from touches on hard flat blocks at several tilts.
//!
//! A ball of radius R touches a plane at the distance d + b from the rotary axis, tilted by t, at the height
//!
//! ```text
//!   h = s − D + (D + b) / cos t − p tan t + e(h),   t = θ + t₀,   D = d + R
//! ```
//!
//! where s is the height of the level block, p the distance of the probe from the axis, t₀ the zero of the rotary stage,
//! b the height of a second block above the first, and e the error of the screw. Two things no touch finds: (p, t) and
//! (−p, −t) give the same heights, so that the sign of the rotary stage is found by the eye; and flat blocks give d + R
//! only. On one block, p and t₀ are nearly the same function of the tilt; on a second one they are not.
//!
//! The error of a screw repeats, and touches at one tilt share it: repeating them does not help. It is taken as a random
//! smooth function of the height, of unknown size and length; the result is the mean over both, weighted by how well
//! they explain the touches.

mod cholesky;
mod fit;
mod least_squares;
mod pin;
mod screw;

#[cfg(test)]
mod pin_tests;
#[cfg(test)]
mod tests;

pub(crate) use cholesky::Cholesky;
pub use fit::{BlockGeometry, fit};
pub use least_squares::TouchNoise;
pub use pin::{PinPrior, PinRadius, PinTouch, fit_pin};
pub use screw::{ScrewError, ScrewMap};

/// A touch on a hard flat block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockTouch {
    /// Tilt of the table by its drive, degrees.
    pub tilt_deg: f64,
    /// Position of the linear stage at the touch, mm.
    pub height_mm: f64,
    /// Height of this block above the first one, mm.
    pub raised_mm: f64,
}

/// Touches that do not give a geometry.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NoGeometry {
    /// Too few tilts for four unknowns.
    #[error("touches at {found} different tilts; at least {least} are needed")]
    TooFewTilts {
        /// Number of tilts.
        found: usize,
        /// Smallest number.
        least: usize,
    },
    /// Tilts on one side only, or close together.
    #[error(
        "the tilts reach from {from_deg:.1}° to {to_deg:.1}°; at least −{least_deg:.0}° to {least_deg:.0}° are needed"
    )]
    TooNarrow {
        /// The lowest tilt.
        from_deg: f64,
        /// The highest tilt.
        to_deg: f64,
        /// The least of both sides.
        least_deg: f64,
    },
    /// Heights that scatter more than touches and screws do.
    #[error(
        "χ² per degree of freedom is {found:.1}, where at most {limit} is allowed; the touch at {tilt_deg:.1}° and \
         {height_mm:.3} mm lies {off_mm:+.3} mm off where the others put it"
    )]
    Scattered {
        /// χ² per degree of freedom.
        found: f64,
        /// Largest value.
        limit: f64,
        /// Tilt of the touch that fits worst with the others.
        tilt_deg: f64,
        /// Its height.
        height_mm: f64,
        /// Its height less the one that the others give.
        off_mm: f64,
    },
    /// A value that is not finite, or heights that no geometry explains.
    #[error("the heights of the touches fit no geometry")]
    NoSolution,
}
