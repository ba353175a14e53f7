//! Residual transients of a drive that starts at any phase at each change of frequency.
//!
//! Such a transient is an error of known size and random phase. It is largest at the resonance, so
//! that residuals that scatter more there than elsewhere show it. The likelihoods of the residuals with
//! and without transients are compared, each for its most likely noise.

use num_complex::Complex64;

use crate::{
    circuit::trace::{Minimum, Trace},
    numeric::dense::Cholesky,
};

/// Twice the log-likelihood that transients must gain to be accepted. By Markov's inequality, settled
/// readings reach it less than once in eight thousand sweeps.
const PRESENT: f64 = 18.0;
/// Transients matter if they shift the resonance by this many of its standard deviations.
const RELEVANT_SIGMAS: f64 = 0.5;
/// The noise below the transients is sought over this range of the logarithm of its variance, in this
/// many steps, each of which shortens the range by a third.
const LN_RANGE: f64 = 12.0;
const STEPS: usize = 24;

/// The effect of residual transients on a fit of settled readings.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AnyPhase {
    /// Twice the log-likelihood that they gain; negative if the readings speak against them.
    gain: f64,
    /// Variance that they add to the logarithm of the resonance.
    variance: f64,
}

/// A residual: |r|², the variance of each part for noise of variance 1, and that of the transient.
type Part = (f64, f64, f64);

impl AnyPhase {
    /// The effect on this fit, for this variance of the noise; `None` if it is negligible.
    pub(crate) fn of(trace: &Trace, found: &Minimum, noise: f64) -> Option<Self> {
        let inverse =
            Cholesky::new(&found.normal.matrix, found.free, 0.0)?.inverse_leading(found.free);
        let transients = trace.transients(&found.at, |sample| sample.visit);
        let mut parts: Vec<Part> = Vec::with_capacity(transients.len());
        let (mut variance, mut index) = (0.0, 0);
        trace.rows(&found.at, |sample, row| {
            let transient = transients[index];
            index += 1;
            if sample.weight > 0.0 {
                let lever: Complex64 =
                    row.slopes.iter().zip(&inverse[0]).take(found.free).map(|(a, b)| a * b).sum();
                variance += (sample.weight * sample.weight) * lever.norm_sqr() * transient;
                parts.push((row.residual.norm_sqr(), 1.0 / sample.weight, transient));
            }
        });
        let is_relevant = variance > RELEVANT_SIGMAS.powi(2) * noise * inverse[0][0];
        is_relevant.then(|| Self { gain: gain(&parts), variance })
    }

    /// Whether the readings contain transients.
    pub(crate) fn is_present(&self) -> bool {
        self.gain > PRESENT
    }

    /// Addition to the relative variance of the resonance: theirs times their probability, which is one
    /// half before the readings.
    pub(crate) fn widening(&self) -> f64 {
        self.variance / (1.0 + (-0.5 * self.gain).exp())
    }
}

/// Twice the log-likelihood that transients gain over noise alone.
fn gain(parts: &[Part]) -> f64 {
    let cost: f64 = parts.iter().map(|(square, unit, _)| square / unit).sum();
    let alone = cost / (2 * parts.len()) as f64;
    // Minus twice the log-likelihood for this variance of the noise.
    let minus = |noise: f64, with: f64| -> f64 {
        let of = |(square, unit, transient): &Part| {
            let variance = noise * unit + with * transient;
            2.0 * variance.ln() + square / variance
        };
        parts.iter().map(of).sum()
    };
    let (mut low, mut high) = (alone.ln() - LN_RANGE, alone.ln());
    for _ in 0..STEPS {
        let third = (high - low) / 3.0;
        let (left, right) = (low + third, high - third);
        if minus(left.exp(), 1.0) < minus(right.exp(), 1.0) {
            high = right;
        } else {
            low = left;
        }
    }
    minus(alone, 0.0) - minus((0.5 * (low + high)).exp(), 1.0)
}

#[cfg(test)]
mod tests {
    use rig_model::random::Stream;

    use super::*;

    /// Residuals of a resonance in the middle of a hundred readings, over noise of variance 1. Transients
    /// of up to `expected` times the noise are there or not.
    fn parts(is_present: bool, expected: f64, random: &mut Stream) -> Vec<Part> {
        let of = |i: u32| {
            let transient = expected / (1.0 + (f64::from(i) / 8.0 - 6.0).powi(2));
            let variance = if is_present { 1.0 + transient } else { 1.0 };
            let square = random.normal().powi(2) + random.normal().powi(2);
            (variance * square, 1.0, transient)
        };
        (0..100).map(of).collect()
    }

    #[test]
    fn residuals_tell_transients_from_noise() {
        let mut random = Stream::new(1, 1);
        for _ in 0..200 {
            let present = gain(&parts(true, 50.0, &mut random));
            assert!(present > PRESENT, "{present}");
            let absent = gain(&parts(false, 50.0, &mut random));
            assert!(absent < -PRESENT, "{absent}");
            let unseen = gain(&parts(false, 0.05, &mut random));
            assert!(unseen.abs() < 3.0, "{unseen}");
        }
    }
}
