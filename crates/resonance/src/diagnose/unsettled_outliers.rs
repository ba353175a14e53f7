//! Residual transients that look like outliers.
//!
//! A sweep that does not wait for settling has large errors beside a narrow resonance. A robust fit
//! excludes those readings, and the others look good although they contain smaller errors of the same
//! cause. The circuit, the dwell and the drive determine the size of a transient at each frequency,
//! whereas an outlier has any size at any frequency. So the likelihoods of both are compared.

use std::f64::consts::{LN_10, TAU};

use crate::{
    circuit::{
        ringup::Visit,
        trace::{Minimum, Sample, Timing, Trace},
    },
    diagnose::{
        alternatives::Fitted,
        outliers::remaining_share,
        unknown_dwell::{DWELLS, visit},
    },
    numeric::dense::Cholesky,
};

/// Twice the log-likelihood that transients must gain over outliers to be the more likely cause.
const PRESENT: f64 = 10.0;
/// Share of outliers among the readings, with transients and without.
const SHARE: f64 = 0.1;
/// Probability density of the logarithm of an outlier: its factor is between 0.01 and 100, and its phase is
/// any.
const ANYWHERE: f64 = 1.0 / (4.0 * LN_10 * TAU);
/// Factor of the variance of transients, because the circuit that determines it is uncertain.
const MARGIN: f64 = 1.5;

/// The residual of a reading.
#[derive(Debug, Clone, Copy)]
struct Residual {
    /// |r|².
    square: f64,
    /// The variance of each part by noise.
    noise: f64,
    /// The share of |r|² that remains after the fit; 0 for a reading that is not in use.
    share: f64,
}

/// Whether transients explain the readings that `rest` excludes better than outliers do. `found` is the fit
/// to `rest`, and `noise` the variance of each part of a reading of ten cycles.
pub(crate) fn is_unsettled(all: &Trace, rest: &Trace, found: &Minimum, noise: f64) -> bool {
    gain(all, rest, found, noise) > PRESENT
}

/// Twice the log-likelihood that transients gain over outliers, for the most likely dwell and drive.
fn gain(all: &Trace, rest: &Trace, found: &Minimum, noise: f64) -> f64 {
    let residuals = residuals(all, rest, found, noise);
    let fitted = Fitted::new(rest, found);
    let time_constant_s = fitted.time_constant_s();
    let of_visits = |visit: &dyn Fn(&Sample) -> Visit| {
        let transients = fitted.left_after(visit).into_iter();
        // For a drive that continues at each change of frequency, and for one that starts at any phase.
        let continued: Vec<f64> = transients.map(|one| 0.5 * MARGIN * one.norm_sqr()).collect();
        let any_phase = rest.transients(&found.at, visit);
        gain_of(&residuals, &continued).max(gain_of(&residuals, &any_phase))
    };
    match rest.timing {
        Timing::Waited if rest.weighed_for.is_none() => of_visits(&|sample| sample.visit).max(0.0),
        Timing::Unknown => DWELLS
            .into_iter()
            .map(|dwell| of_visits(&|sample| visit(dwell, time_constant_s, sample)))
            .fold(0.0, f64::max),
        Timing::Waited | Timing::Exact(_) | Timing::AnyPhase => 0.0,
    }
}

/// The residuals of all readings from the fit to `rest`; none if the fit has no covariance.
fn residuals(all: &Trace, rest: &Trace, found: &Minimum, noise: f64) -> Vec<Residual> {
    let Some(factor) = Cholesky::new(&found.normal.matrix, found.free, 0.0) else {
        return Vec::new();
    };
    let inverse = factor.inverse();
    let mut residuals = Vec::with_capacity(all.samples.len());
    let mut samples = all.samples.iter();
    rest.rows(&found.at, |sample, row| {
        let weight = samples.next().map_or(0.0, |sample| sample.weight);
        let is_used = weight > 0.0;
        let share = if is_used { remaining_share(sample, &row, &inverse, found.free) } else { 0.0 };
        residuals.push(Residual { square: row.residual.norm_sqr(), noise: noise / weight, share });
    });
    residuals
}

/// Twice the log-likelihood that transients of these variances gain over outliers.
fn gain_of(residuals: &[Residual], variances: &[f64]) -> f64 {
    let of = |(residual, variance): (&Residual, &f64)| {
        let Residual { square, noise, share } = *residual;
        2.0 * share * (density(square, noise + variance) / density(square, noise)).ln()
    };
    residuals.iter().zip(variances).filter(|(residual, _)| residual.share > 0.0).map(of).sum()
}

/// Probability density of a residual of this |r|² that is an outlier or has this variance of each part.
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

    /// Twice the log-likelihood that transients gain over outliers, for noise of 0.5 % and these additional
    /// standard deviations of the residuals.
    fn gain_with(off: impl Fn(u32, &mut Stream) -> f64, random: &mut Stream) -> f64 {
        let transients: Vec<f64> = (0..100).map(transient).collect();
        let noise = 0.005_f64.powi(2);
        let mut residual = |i| {
            let square = random.normal().powi(2) + random.normal().powi(2);
            let more = off(i, random);
            Residual { square: square * (noise + more * more), noise, share: 1.0 }
        };
        let residuals: Vec<Residual> = (0..100).map(&mut residual).collect();
        gain_of(&residuals, &transients)
    }

    #[test]
    fn transients_lie_where_the_resonance_is_and_outliers_anywhere() {
        let mut random = Stream::new(1, 1);
        for _ in 0..200 {
            let unsettled = gain_with(|i, _| transient(i).sqrt(), &mut random);
            assert!(unsettled > PRESENT, "{unsettled}");
            let is_outlier = |random: &mut Stream| random.uniform() < 0.1;
            let of_outlier = |_, random: &mut Stream| if is_outlier(random) { 1.0 } else { 0.0 };
            let outliers = gain_with(of_outlier, &mut random);
            assert!(outliers < 0.0, "{outliers}");
        }
    }
}
