//! The sample that the probe touches, as a soft half space.

use crate::{inverse::TissueKind, sensor::LOSS_MAX};

/// A checked tissue: linear, isotropic, at rest thick and wide against the contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tissue {
    young_mpa: f64,
    poisson: f64,
    loss: f64,
}

/// A refused tissue.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum TissueError {
    /// Young's modulus is not a positive number.
    #[error("tissue stiffness {young_mpa} MPa is not a positive number")]
    Stiffness {
        /// The value given, MPa.
        young_mpa: f64,
    },
    /// Poisson's ratio is outside [0, 0.5].
    #[error("tissue Poisson's ratio {poisson} is outside [0, 0.5]")]
    Poisson {
        /// The value given.
        poisson: f64,
    },
    /// The loss factor is outside [0, 1].
    #[error("tissue loss factor {loss} is outside [0, 1]")]
    Loss {
        /// The value given.
        loss: f64,
    },
}

impl Tissue {
    /// A tissue with Young's modulus in MPa, Poisson's ratio, and loss factor.
    ///
    /// # Errors
    /// [`TissueError`] for a modulus that is not positive, a Poisson's ratio outside [0, 0.5], or a
    /// loss factor outside [0, 1].
    pub fn new(young_mpa: f64, poisson: f64, loss: f64) -> Result<Self, TissueError> {
        if !(young_mpa.is_finite() && young_mpa > 0.0) {
            return Err(TissueError::Stiffness { young_mpa });
        }
        if !(0.0..=0.5).contains(&poisson) {
            return Err(TissueError::Poisson { poisson });
        }
        if !(0.0..=LOSS_MAX).contains(&loss) {
            return Err(TissueError::Loss { loss });
        }
        Ok(Self { young_mpa, poisson, loss })
    }

    /// A soft silicone or tissue: incompressible, with a loss factor of 0.1.
    ///
    /// # Errors
    /// [`TissueError::Stiffness`].
    pub fn soft(young_mpa: f64) -> Result<Self, TissueError> {
        Self::new(young_mpa, 0.5, 0.1)
    }

    /// Young's modulus, MPa.
    pub const fn young_mpa(&self) -> f64 {
        self.young_mpa
    }

    /// Poisson's ratio.
    pub const fn poisson(&self) -> f64 {
        self.poisson
    }

    /// Loss factor: the imaginary part of the modulus relative to the real one.
    pub const fn loss(&self) -> f64 {
        self.loss
    }

    /// A tissue this many times as stiff, with the same loss and Poisson's ratio.
    pub(crate) fn times(&self, factor: f64) -> Self {
        Self { young_mpa: self.young_mpa * factor, ..*self }
    }

    /// The contact modulus E/(1 − ν²), Pa.
    pub(crate) fn contact_modulus_pa(&self) -> f64 {
        self.young_mpa * 1e6 / (1.0 - self.poisson * self.poisson)
    }

    /// Tangential over normal stiffness of a sticking contact.
    pub(crate) fn tangential_ratio(&self) -> f64 {
        TissueKind { poisson: self.poisson, loss: self.loss }.tangential_ratio()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_taken_and_what_lies_beyond_is_refused() {
        assert!(Tissue::new(1e-30, 0.5, 1.0).is_ok());
        assert_eq!(
            Tissue::new(0.0, 0.5, 0.1).unwrap_err().to_string(),
            "tissue stiffness 0 MPa is not a positive number"
        );
        assert!(Tissue::new(f64::INFINITY, 0.5, 0.1).is_err());
        assert!(Tissue::new(0.1, 0.501, 0.1).is_err());
        assert!(Tissue::new(0.1, 0.5, -0.001).is_err());
        assert!(Tissue::new(0.1, 0.5, 1.001).is_err());
    }
}
