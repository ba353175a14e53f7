//! Finds outliers and decides whether they can be excluded.
//!
//! Isolated wrong readings do not affect the others. But a wrong model makes readings look like
//! outliers too, above all those near the resonance. So outliers are excluded only if they are few, if
//! the rest is nearly as informative, and if no other cause explains them.

use crate::{
    circuit::trace::{Minimum, ModelEstimate, Row, Sample, Trace, UNKNOWNS},
    noise::VARIANCE_MIN,
    numeric::dense::Cholesky,
    numeric::descent::Normal,
};

/// One reading in five may be an outlier. With more, the rest is unreliable too.
pub(crate) const READINGS_PER_OUTLIER: usize = 5;
/// Twice the log-likelihood that each excluded reading must gain over every other cause.
pub(crate) const GAIN_PER_OUTLIER: f64 = 28.0;
/// Rounds of reweighting; each brings the scale nearer to that of the good readings.
const ROUNDS: usize = 12;
/// The point of half Cauchy weight, in means of |r|².
pub(crate) const CAUCHY_MEANS: f64 = 3.0;
/// Largest factor by which excluding outliers may raise the variance.
const LOST: f64 = 3.0;
/// Largest number of neighbours that pass for one burst of outliers.
const BURST_MAX: usize = 5;
/// Fraction of best-fitting readings that define the usual |r|². It tolerates as many outliers as are
/// accepted.
const TRIMMED: f64 = 0.8;
/// The mean of an exponential distribution of mean 1 up to its 80 % point.
const TRIMMED_MEAN: f64 = 0.5977;

/// Number of readings in use that are outliers of a model.
pub(crate) fn count(trace: &Trace, found: &Minimum) -> usize {
    let far = far(trace, found);
    let (sizes, usual) = sizes(trace, found);
    let is_far = |(sample, size): &(&Sample, &f64)| sample.weight > 0.0 && **size > far * usual;
    trace.samples.iter().zip(&sizes).filter(is_far).count()
}

/// The readings without outliers, their model, and whether the outliers may be excluded: they are few,
/// and the rest is nearly as informative. `None` if there is nothing to exclude. `near` is a robust
/// start value, if known.
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
    let mut left_out = 0;
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
        let now = readings - rest.used().0;
        best = rest.minimum(best.at, best.free);
        if now * READINGS_PER_OUTLIER > readings {
            return Some((rest, best, false));
        }
        if now == left_out {
            break;
        }
        left_out = now;
    }
    let is_enough = tells_as_much(trace, &rest, &best);
    (left_out > 0).then_some((rest, best, is_enough))
}

/// Whether most of the readings that `rest` leaves out are neighbours in frequency. Outliers come alone or
/// in short bursts; a peak that no circuit describes deviates over its whole width.
pub(crate) fn are_together(all: &Trace, rest: &Trace) -> bool {
    let used = all.samples.iter().zip(&rest.samples).filter(|(sample, _)| sample.weight > 0.0);
    let mut used: Vec<(f64, bool)> =
        used.map(|(one, left)| (one.visit.frequency_hz, left.weight == 0.0)).collect();
    used.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let longest = used.chunk_by(|a, b| a.1 == b.1).filter(|run| run[0].1).map(<[_]>::len).max();
    let left_out = used.iter().filter(|(_, is_left_out)| *is_left_out).count();
    longest.is_some_and(|longest| longest > BURST_MAX && 2 * longest > left_out)
}

/// The model with Cauchy weights, which reduce the scale despite outliers.
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

/// Ratio of |r|² to the mean of the others that one good reading in a million exceeds: |r|² is
/// exponentially distributed, and the mean is estimated from few parts.
fn far(trace: &Trace, found: &Minimum) -> f64 {
    let half = 0.5 * (2 * trace.used().0).saturating_sub(found.free).max(1) as f64;
    half * ((1e6_f64.ln() / half).exp() - 1.0)
}

/// Whether the remaining readings determine the resonance nearly as well as all would.
fn tells_as_much(all: &Trace, rest: &Trace, found: &Minimum) -> bool {
    let variance = |trace: &Trace| {
        let mut normal = Normal::default();
        let mut samples = trace.samples.iter();
        // Information of ideal readings of the model, because an outlier itself has none.
        all.ideal_rows(&found.at, |row| {
            let weight = samples.next().map_or(0.0, |sample| sample.weight);
            normal.add(row.residual, &row.slopes, weight);
        });
        let mut unit = [0.0; UNKNOWNS];
        unit[0] = 1.0;
        Cholesky::new(&normal.matrix, found.free, 0.0)
            .map_or(f64::INFINITY, |factor| factor.solve(&unit)[0])
    };
    variance(rest) < LOST * variance(all)
}

/// The part of the deviation of a reading that a fit with this inverse of its normal matrix leaves.
pub(crate) fn left(
    sample: &Sample,
    row: &Row,
    inverse: &[[f64; UNKNOWNS]; UNKNOWNS],
    free: usize,
) -> f64 {
    let mut taken = 0.0;
    for (left, line) in row.slopes.iter().zip(inverse).take(free) {
        for (right, element) in row.slopes.iter().zip(line) {
            taken += element * (left.conj() * right).re;
        }
    }
    // Each of the two parts of a reading has half of it.
    (1.0 - 0.5 * sample.weight * taken).clamp(0.05, 1.0)
}

/// The weighted |r|² of every sample, corrected for the reduction by the fit, and the usual value among
/// those in use.
pub(crate) fn sizes(trace: &Trace, found: &Minimum) -> (Vec<f64>, f64) {
    let inverse = Cholesky::new(&found.normal.matrix, found.free, 0.0)
        .map_or([[0.0; UNKNOWNS]; UNKNOWNS], |factor| factor.inverse());
    let mut sizes = Vec::with_capacity(trace.samples.len());
    let mut used = Vec::with_capacity(trace.samples.len());
    trace.rows(&found.at, |sample, row| {
        let size =
            sample.weight * row.residual.norm_sqr() / left(sample, &row, &inverse, found.free);
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
    // Unsettled readings may have less error than assumed; settled ones do not.
    let known = trace.weighed_for.map_or(VARIANCE_MIN, |variance| 2.0 * variance);
    (sizes, (mean / TRIMMED_MEAN).max(known))
}
