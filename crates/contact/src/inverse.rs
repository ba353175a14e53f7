//! From frequency shifts back to stiffness, with its uncertainty.
//!
//! One touch at a known angle gives a stiffness. Touches at several spins of the probe about its
//! own axis, or at several depths, give stiffness and contact angle together; what they cannot tell
//! apart is said, and what they cannot tell at all is refused.

mod one_touch;
mod tilt;

pub use one_touch::{OneTouch, Spread};
pub use tilt::{AnglePrior, AzimuthPrior, Interval, Probing, TiltInference, Touch, infer_tilt};

use crate::{Refusal, Tissue, TissueError};

/// What is taken as known of a tissue when its stiffness is sought.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TissueKind {
    /// Poisson's ratio.
    pub poisson: f64,
    /// Loss factor.
    pub loss: f64,
}

impl TissueKind {
    /// Soft silicone or tissue: incompressible, with a loss factor of 0.1.
    pub const SOFT: Self = Self { poisson: 0.5, loss: 0.1 };

    fn with(self, young_mpa: f64) -> Result<Tissue, TissueError> {
        Tissue::new(young_mpa, self.poisson, self.loss)
    }
}

/// Why no stiffness is given.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum InverseError {
    /// The shift is zero, negative or not a number: nothing was touched.
    #[error("a shift of {shift_hz} Hz is no contact")]
    NoContact {
        /// The shift given, Hz.
        shift_hz: f64,
    },
    /// The stiffness would be known too badly to be called a result.
    #[error("stiffness is known to {relative:.2} of itself only, {limit} is allowed")]
    TooUncertain {
        /// The standard deviation over the value.
        relative: f64,
        /// The largest that is given as a result.
        limit: f64,
    },
    /// The touches contradict each other under every stiffness and tilt.
    #[error("touches disagree: chi-squared {chi_squared:.1} with {freedom} degrees of freedom")]
    Inconsistent {
        /// The smallest sum of squared deviations in their standard deviations.
        chi_squared: f64,
        /// Number of touches less that of unknowns.
        freedom: usize,
    },
    /// There is no touch to infer from.
    #[error("no touches to infer a stiffness from")]
    NoTouches,
    /// A standard deviation or a bound that is not a positive number.
    #[error("{what} must be a positive number, found {found}")]
    NotPositive {
        /// The quantity at fault.
        what: &'static str,
        /// Its value.
        found: f64,
    },
    /// The contact is outside the model.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The tissue assumed is none.
    #[error(transparent)]
    Tissue(#[from] TissueError),
}

/// The largest relative standard deviation that is given as a result.
const RELATIVE_SIGMA_MAX: f64 = 0.5;
