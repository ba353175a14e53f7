//! From frequency shifts back to stiffness, with its uncertainty.
//!
//! One touch at a known angle gives a stiffness. Touches at several spins of the probe about its own
//! axis, or at several depths, give stiffness and contact angle together. The result says whether
//! the touches identify the angle; an unknown stiffness is refused.

mod one_touch;
mod tilt;

pub use one_touch::{OneTouch, TouchSigmas};
pub use tilt::{
    AnglePrior, AzimuthPrior, Interval, LogVariances, ShiftSigmas, SiteTouch, TiltInference,
    TouchModel, infer_tilt,
};

use crate::{Refusal, Tissue, TissueError};

/// The tissue properties that the inference of a stiffness assumes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TissueKind {
    /// Poisson's ratio.
    pub poisson: f64,
    /// Loss factor.
    pub loss: f64,
}

impl TissueKind {
    /// Soft silicone or tissue: incompressible, loss factor 0.1.
    pub const SOFT: Self = Self { poisson: 0.5, loss: 0.1 };

    /// Tangential over normal stiffness of a sticking contact, 2(1 − ν)/(2 − ν).
    ///
    /// # Source
    /// Mindlin, J. Appl. Mech. 16 (1949) 259.
    pub fn tangential_ratio(self) -> f64 {
        2.0 * (1.0 - self.poisson) / (2.0 - self.poisson)
    }

    fn with(self, young_mpa: f64) -> Result<Tissue, TissueError> {
        Tissue::new(young_mpa, self.poisson, self.loss)
    }
}

/// A refused inference.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum InverseError {
    /// The shift is zero, negative or not a number.
    #[error("a shift of {shift_hz} Hz shows no contact")]
    NoContact {
        /// The shift given, Hz.
        shift_hz: f64,
    },
    /// The standard deviation of the stiffness is too large for a result.
    #[error("the relative standard deviation of the stiffness is {relative:.2}, above {limit}")]
    TooUncertain {
        /// The standard deviation over the value.
        relative: f64,
        /// The largest allowed ratio.
        limit: f64,
    },
    /// No stiffness and tilt explain the touches.
    #[error("touches disagree: chi-squared {chi_squared:.1} with {freedom} degrees of freedom")]
    Inconsistent {
        /// The smallest sum of squared deviations over their variances.
        chi_squared: f64,
        /// Number of touches less that of unknowns.
        freedom: usize,
    },
    /// The list of touches is empty.
    #[error("no touches to infer a stiffness from")]
    NoTouches,
    /// A standard deviation or a bound is not a positive number.
    #[error("{what} must be a positive number, found {found}")]
    NotPositive {
        /// The faulty quantity.
        what: &'static str,
        /// The value given.
        found: f64,
    },
    /// The contact is outside the model.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The assumed tissue is not valid.
    #[error(transparent)]
    Tissue(#[from] TissueError),
}

/// The largest relative standard deviation of a result.
const RELATIVE_SIGMA_MAX: f64 = 0.5;
