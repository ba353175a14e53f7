//! Residual transients that look like outliers.
//!
//! A sweep that does not wait for settling has large errors beside a narrow resonance. A robust fit
//! leaves them out, and the rest looks good although it contains smaller ones. Transients are as large
//! as the resonance, the dwell and the drive make them, on every reading beside the resonance; outliers
//! have any size and any place. So the likelihoods of both are compared.

use std::f64::consts::{LN_10, TAU};

use num_complex::Complex64;

use crate::{
    circuit::trace::{Minimum, Timing, Trace},
    diagnose::{
        alternatives::Fitted,
        outliers::left,
        unknown_dwell::{DWELLS, visit},
    },
    numeric::dense::Cholesky,
};

/// Twice the log-likelihood that transients must gain over outliers to be the more likely cause.
const PRESENT: f64 = 10.0;
/// Share of outliers among readings, in both cases.
const SHARE: f64 = 0.1;
/// Density of the logarithm of an outlier, which has any phase and is wrong by a factor of 0.01 to 100.
const ANYWHERE: f64 = 1.0 / (4.0 * LN_10 * TAU);
/// Factor of the variance of transients: the circuit that gives their size is uncertain.
const MARGIN: f64 = 1.5;

/// A residual: |r|², the variance of each part by noise, and the part of it that the fit leaves.
#[derive(Debug, Clone, Copy)]
struct Part {
    square: f64,
    noise: f64,
    left: f64,
}

/// Whether readings that the fit `found` to `rest` leaves out are rather those of a sweep that has not
/// settled; `noise` is the variance of each part of a reading of ten cycles.
pub(crate) fn is_unsettled(all: &Trace, rest: &Trace, found: &Minimum, noise: f64) -> bool {
    gain(all, rest, found, noise) > PRESENT
}

/// Twice the log-likelihood that transients gain, for the most likely dwell and drive.
fn gain(all: &Trace, rest: &Trace, found: &Minimum, noise: f64) -> f64 {
    let Some(factor) = Cholesky::new(&found.normal.matrix, found.free, 0.0) else { return 0.0 };
    let inverse = factor.inverse();
    let mut parts = Vec::with_capacity(all.samples.len());
    let mut samples = all.samples.iter();
    rest.rows(&found.at, |sample, row| {
        let weight = samples.next().map_or(0.0, |sample| sample.weight);
        let left = if weight > 0.0 { left(sample, &row, &inverse, found.free) } else { 0.0 };
        parts.push(Part { square: row.residual.norm_sqr(), noise: noise / weight, left });
    });
    let fitted = Fitted::new(rest, found);
    let time_constant_s = fitted.time_constant_s();
    let mut most = 0.0_f64;
    let mut consider = |transients: &[f64]| most = most.max(gained(&parts, transients));
    let continued = |left: Vec<Complex64>| -> Vec<f64> {
        left.into_iter().map(|one| 0.5 * MARGIN * one.norm_sqr()).collect()
    };
    match rest.timing {
        Timing::Waited if rest.weighed_for.is_none() => {
            consider(&continued(fitted.left_after(|sample| sample.visit)));
            consider(&rest.transients(&found.at, |sample| sample.visit));
        }
        Timing::Unknown => {
            for dwell in DWELLS {
                let visit = |sample: &_| visit(dwell, time_constant_s, sample);
                consider(&continued(fitted.left_after(visit)));
                consider(&rest.transients(&found.at, visit));
            }
        }
        Timing::Waited | Timing::Exact(_) | Timing::AnyPhase => {}
    }
    most
}

/// Twice the log-likelihood that transients of these variances gain.
fn gained(parts: &[Part], transients: &[f64]) -> f64 {
    let of = |(part, transient): (&Part, &f64)| {
        let with = density(part.square, part.noise + transient);
        2.0 * part.left * (with / density(part.square, part.noise)).ln()
    };
    parts.iter().zip(transients).filter(|(part, _)| part.left > 0.0).map(of).sum()
}

/// Density of a residual of this |r|² that is an outlier or has this variance of each part.
fn density(square: f64, variance: f64) -> f64 {
    (1.0 - SHARE) * (-0.5 * square / variance).exp() / (TAU * variance) + SHARE * ANYWHERE
}

#[cfg(test)]
mod tests {
    use rig_model::random::Stream;

    use super::*;

    /// Size of the transients of a narrow resonance in the middle of a hundred readings.
    fn transient(i: u32) -> f64 {
        0.1 / (1.0 + (f64::from(i) - 50.0).powi(2)).powi(2)
    }

    /// Twice the log-likelihood that transients gain for noise of 0.5 %, with residuals that `off` makes
    /// wrong.
    fn gained_by(off: impl Fn(u32, &mut Stream) -> f64, random: &mut Stream) -> f64 {
        let transients: Vec<f64> = (0..100).map(transient).collect();
        let noise = 0.005_f64.powi(2);
        let mut part = |i| {
            let square = random.normal().powi(2) + random.normal().powi(2);
            let more = off(i, random);
            Part { square: square * (noise + more * more), noise, left: 1.0 }
        };
        let parts: Vec<Part> = (0..100).map(&mut part).collect();
        gained(&parts, &transients)
    }

    #[test]
    fn transients_lie_where_the_resonance_is_and_outliers_anywhere() {
        let mut random = Stream::new(1, 1);
        for _ in 0..200 {
            let unsettled = gained_by(|i, _| transient(i).sqrt(), &mut random);
            assert!(unsettled > PRESENT, "{unsettled}");
            let is_outlier = |random: &mut Stream| random.uniform() < 0.1;
            let of_outlier = |_, random: &mut Stream| if is_outlier(random) { 1.0 } else { 0.0 };
            let outliers = gained_by(of_outlier, &mut random);
            assert!(outliers < 0.0, "{outliers}");
        }
    }
}
