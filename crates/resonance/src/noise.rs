//! The noise of readings and the allowed χ² of a fit.

/// Noise known from earlier readings of the same analyzer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoisePrior {
    /// Standard deviation of the real and of the imaginary part of the relative error of a reading
    /// of ten cycles.
    pub at_ten_cycles: f64,
    /// Degrees of freedom of `at_ten_cycles`; infinite if the noise is known exactly.
    pub degrees_of_freedom: f64,
}

impl NoisePrior {
    /// Degrees of freedom of a noise value that the user states.
    pub const STATED_DEGREES: f64 = 100.0;
}

/// The assumed noise of an analyzer before any readings.
pub(crate) const NOISE: NoisePrior = NoisePrior { at_ten_cycles: 0.005, degrees_of_freedom: 4.0 };

/// Smallest possible variance of each part of a reading, from an analyzer or a file: the ninth digit.
/// Smaller residuals are rounding errors, which are neither random nor evenly distributed.
pub(crate) const VARIANCE_MIN: f64 = 1e-8 * 1e-8;

/// A variance with its degrees of freedom.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PooledVariance {
    sum: f64,
    degrees: f64,
}

impl PooledVariance {
    /// The variance of a prior.
    pub(crate) fn known(noise: &NoisePrior) -> Self {
        // With more than a million, added readings would be lost in rounding.
        let degrees = noise.degrees_of_freedom.min(1e6);
        Self { sum: degrees * noise.at_ten_cycles.powi(2), degrees }
    }

    /// Converts the variance to the public type.
    pub(crate) fn prior(self) -> NoisePrior {
        NoisePrior { at_ten_cycles: self.deviation(), degrees_of_freedom: self.degrees }
    }

    /// Pools the variance with `cost`, the weighted sum of |r|² of readings.
    pub(crate) fn with(self, cost: f64, degrees: f64) -> Self {
        Self { sum: self.sum + cost, degrees: self.degrees + degrees }
    }

    /// Whether it is a guess: no more degrees of freedom than that of an unknown analyzer.
    pub(crate) fn is_guess(self) -> bool {
        self.degrees <= NOISE.degrees_of_freedom
    }

    /// The variance of each part of a reading of ten cycles.
    pub(crate) fn variance(self) -> f64 {
        self.sum / self.degrees
    }

    /// Twice the log-likelihood gained when the sum falls by `saved`.
    pub(crate) fn gain(self, saved: f64) -> f64 {
        // A residual of zero is rounding, not certainty.
        self.degrees * (self.sum / (self.sum - saved).max(1e-12 * self.sum)).ln()
    }

    /// The standard deviation of each part of a reading of ten cycles.
    pub(crate) fn deviation(self) -> f64 {
        self.variance().sqrt()
    }
}

/// χ² may exceed its mean by this many of its standard deviations.
pub(crate) const CHI_SQUARED_SIGMAS: f64 = 5.0;

/// The upper limit of χ² per degree of freedom, with the tail probability of a normal variable at
/// `sigmas` standard deviations. χ² is relative to the prior noise or, without one, to the scatter
/// between neighbours.
pub(crate) fn allowed(degrees: f64, noise: Option<&NoisePrior>, sigmas: f64) -> f64 {
    if let Some(prior) = noise {
        // The cube root of χ²/n is nearly normal with mean 1 − 2/9n and variance 2/9n (Wilson and
        // Hilferty); the uncertainty of the prior is added.
        let part = 2.0 / 9.0 * (1.0 / degrees + 1.0 / prior.degrees_of_freedom);
        return (1.0 - 2.0 / (9.0 * degrees) + sigmas * part.sqrt()).powi(3);
    }
    // The inverse, von Neumann's ratio, is normally distributed with variance 1/n.
    let inverse = 1.0 - sigmas / degrees.sqrt();
    if inverse > 0.0 { 1.0 / inverse } else { f64::INFINITY }
}

/// Ratio of the 97.5 % points of Student's and the normal distribution.
///
/// # Source
/// Abramowitz and Stegun 26.7.5, two terms; within 0.5 % from 8 degrees of freedom upwards.
pub(crate) fn student_factor(degrees: f64) -> f64 {
    const Z2: f64 = 1.96 * 1.96;
    1.0 + (Z2 + 1.0) / (4.0 * degrees) + ((5.0 * Z2 + 16.0) * Z2 + 3.0) / (96.0 * degrees * degrees)
}
