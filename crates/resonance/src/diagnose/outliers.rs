//! Finds outliers and decides whether they can be excluded.
//!
//! A wrong reading does not affect the others. But a wrong model makes right readings look like
//! outliers too, above all those near the resonance. So outliers are excluded only if they are few, if
//! the other readings are nearly as informative, and if no other cause explains them.

use crate::{
    circuit::trace::{Minimum, ModelEstimate, Row, Sample, Trace, UNKNOWNS},
    noise::VARIANCE_MIN,
    numeric::dense::Cholesky,
    numeric::descent::Normal,
};

/// One reading in five may be an outlier. With more, the other readings are unreliable too.
pub(crate) const READINGS_PER_OUTLIER: usize = 5;
/// Twice the log-likelihood that each excluded reading must gain over every other cause.
pub(crate) const GAIN_PER_OUTLIER: f64 = 28.0;
/// Largest number of rounds. Each brings the scale nearer to that of the good readings.
const ROUNDS: usize = 12;
/// The |r|² at which a Cauchy weight is a half, in units of the usual |r|².
pub(crate) const CAUCHY_MEANS: f64 = 3.0;
/// Largest factor by which the exclusion of outliers may raise the variance of the resonance.
const VARIANCE_RISE_MAX: f64 = 3.0;
/// Largest number of adjacent readings in one burst of outliers.
const BURST_MAX: usize = 5;
/// Fraction of the readings, those with the smallest |r|², whose trimmed mean defines the usual |r|².
/// The other fraction is as large as the largest accepted one of outliers.
const TRIMMED: f64 = 0.8;
/// The mean of an exponential distribution of mean 1 up to its 80 % point.
const TRIMMED_MEAN: f64 = 0.5977;

/// Number of readings that a model has as outliers, without those that are excluded already.
pub(crate) fn count(trace: &Trace, found: &Minimum) -> usize {
    let far = far(trace, found);
    let (sizes, usual) = sizes(trace, found);
    let is_far = |(sample, size): &(&Sample, &f64)| sample.weight > 0.0 && **size > far * usual;
    trace.samples.iter().zip(&sizes).filter(is_far).count()
}

/// The readings without outliers, their model, and whether the outliers may be excluded: they are few,
/// and the other readings are nearly as informative. `None` if there are no outliers. The search starts
/// at `near` or, without it, at a model with Cauchy weights.
pub(crate) fn without(
    trace: &Trace,
    plain: &Minimum,
    near: Option<ModelEstimate>,
) -> Option<(Trace, Minimum, bool)> {
    let readings = trace.used().0;
    let mut best = match near {
        Some(at) => Minimum { at, normal: trace.normal(&at), ..*plain },
        None => reweighted(trace, plain),
    };
    let mut excluded_before = 0;
    let mut rest = trace.clone();
    for _ in 0..ROUNDS {
        rest.clone_from(trace);
        let (sizes, usual) = sizes(trace, &best);
        let far = far(trace, &best);
        for (sample, size) in rest.samples.iter_mut().zip(&sizes) {
            if *size > far * usual {
                sample.weight = 0.0;
            }
        }
        let excluded = readings - rest.used().0;
        best = rest.minimum(best.at, best.free);
        if excluded * READINGS_PER_OUTLIER > readings {
            return Some((rest, best, false));
        }
        if excluded == excluded_before {
            break;
        }
        excluded_before = excluded;
    }
    let is_informative = is_informative(trace, &rest, &best);
    (excluded_before > 0).then_some((rest, best, is_informative))
}

/// Whether most of the readings that `rest` excludes are adjacent in frequency. Outliers come alone or
/// in short bursts; a peak that no circuit describes deviates over its whole width.
pub(crate) fn are_together(all: &Trace, rest: &Trace) -> bool {
    let used = all.samples.iter().zip(&rest.samples).filter(|(sample, _)| sample.weight > 0.0);
    let mut used: Vec<(f64, bool)> =
        used.map(|(one, kept)| (one.visit.frequency_hz, kept.weight == 0.0)).collect();
    used.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let longest = used.chunk_by(|a, b| a.1 == b.1).filter(|run| run[0].1).map(<[_]>::len).max();
    let excluded = used.iter().filter(|(_, is_excluded)| *is_excluded).count();
    longest.is_some_and(|longest| longest > BURST_MAX && 2 * longest > excluded)
}

/// The model with Cauchy weights, which give outliers little influence.
fn reweighted(trace: &Trace, plain: &Minimum) -> Minimum {
    let mut best = *plain;
    let mut weighted = trace.clone();
    for _ in 0..ROUNDS {
        weighted.clone_from(trace);
        let (sizes, usual) = sizes(trace, &best);
        for (sample, size) in weighted.samples.iter_mut().zip(&sizes) {
            sample.weight /= 1.0 + size / (CAUCHY_MEANS * usual);
        }
        best = weighted.minimum(best.at, best.free);
    }
    best
}

/// The |r|² beyond which a reading is an outlier, in units of the usual |r|². One good reading in a
/// million exceeds it: |r|² is exponentially distributed, and the usual one is estimated from few parts.
fn far(trace: &Trace, found: &Minimum) -> f64 {
    let half = 0.5 * (2 * trace.used().0).saturating_sub(found.free).max(1) as f64;
    half * ((1e6_f64.ln() / half).exp() - 1.0)
}

/// Whether the readings in `rest` determine the resonance nearly as well as all would.
fn is_informative(all: &Trace, rest: &Trace, found: &Minimum) -> bool {
    let variance = |trace: &Trace| {
        let mut normal = Normal::default();
        let mut samples = trace.samples.iter();
        // The readings of the model, because an outlier has no information.
        all.ideal_rows(&found.at, |row| {
            let weight = samples.next().map_or(0.0, |sample| sample.weight);
            normal.add(row.residual, &row.slopes, weight);
        });
        let mut unit = [0.0; UNKNOWNS];
        unit[0] = 1.0;
        Cholesky::new(&normal.matrix, found.free, 0.0)
            .map_or(f64::INFINITY, |factor| factor.solve(&unit)[0])
    };
    variance(rest) < VARIANCE_RISE_MAX * variance(all)
}

/// One minus the leverage of a reading: the share of its |r|² that remains after a fit of `free` unknowns
/// with this inverse of its normal matrix. At least 0.05, because the slopes hold only near the model.
pub(crate) fn remaining_share(
    sample: &Sample,
    row: &Row,
    inverse: &[[f64; UNKNOWNS]; UNKNOWNS],
    free: usize,
) -> f64 {
    let mut leverage = 0.0;
    for (left, line) in row.slopes.iter().zip(inverse).take(free) {
        for (right, element) in row.slopes.iter().zip(line) {
            leverage += element * (left.conj() * right).re;
        }
    }
    // Each of the two parts of a reading has half of the leverage.
    (1.0 - 0.5 * sample.weight * leverage).clamp(0.05, 1.0)
}

/// The weighted |r|² of every sample, corrected for its leverage, and the usual value among those in use.
pub(crate) fn sizes(trace: &Trace, found: &Minimum) -> (Vec<f64>, f64) {
    let inverse = Cholesky::new(&found.normal.matrix, found.free, 0.0)
        .map_or([[0.0; UNKNOWNS]; UNKNOWNS], |factor| factor.inverse());
    let mut sizes = Vec::with_capacity(trace.samples.len());
    let mut used = Vec::with_capacity(trace.samples.len());
    trace.rows(&found.at, |sample, row| {
        let share = remaining_share(sample, &row, &inverse, found.free);
        let size = sample.weight * row.residual.norm_sqr() / share;
        sizes.push(size);
        if sample.weight > 0.0 {
            used.push(size);
        }
    });
    used.sort_unstable_by(f64::total_cmp);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "below its length"
    )]
    used.truncate((used.len() as f64 * TRIMMED).ceil() as usize);
    let mean = used.iter().sum::<f64>() / used.len() as f64;
    // Readings that are weighted by their settling may have smaller errors than their weights assume. Then
    // the usual |r|² is at least that of the noise, which both parts have.
    let known = trace.weighed_for.map_or(VARIANCE_MIN, |variance| 2.0 * variance);
    (sizes, (mean / TRIMMED_MEAN).max(known))
}
