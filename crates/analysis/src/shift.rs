//! The frequency shift of each sample at each angle: the paper's Figures 11 and 12.

use crate::reference::Reference;

/// The shift of one touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchShift {
    /// Index of the sample.
    pub sample: usize,
    /// Index of the direction.
    pub direction: usize,
    /// Contact angle, degrees.
    pub angle_deg: f64,
    /// Resonance in contact less the no-load resonance, Hz.
    pub shift_hz: f64,
    /// Standard deviation of the shift, Hz.
    pub sigma_hz: f64,
    /// Its reference, which it may share with other touches.
    pub reference: Reference,
}

/// A mean of shifts with two estimates of its error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mean {
    /// Mean shift, Hz.
    pub shift_hz: f64,
    /// Standard deviation of the mean, propagated from those of the values and from what these share by their
    /// references, Hz.
    pub sigma_hz: f64,
    /// Mean covariance of two averaged values, Hz²; zero if they share no reference. The scatter of the values does
    /// not show it.
    pub shared_hz2: f64,
    /// Standard deviation of the averaged values, Hz; `None` for a single value. Unlike `sigma_hz` it
    /// includes placement, depth, tissue and the difference between directions.
    pub spread_hz: Option<f64>,
    /// Number of averaged values.
    pub count: usize,
}

impl Mean {
    /// Standard deviation of the mean, Hz: the larger of the propagated one and the one from the
    /// scatter of the values and what they share. The scatter includes all errors of each value by itself, but may be
    /// small by chance for a few values.
    pub fn standard_error_hz(&self) -> f64 {
        let variance_hz2 = |spread_hz: f64| spread_hz.powi(2) / self.count as f64 + self.shared_hz2;
        let from_scatter =
            self.spread_hz.map_or(0.0, |spread| variance_hz2(spread).max(0.0).sqrt());
        self.sigma_hz.max(from_scatter)
    }
}

/// The mean shift of one sample at one angle in one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirectionMean {
    /// Index of the sample.
    pub sample: usize,
    /// Contact angle, degrees.
    pub angle_deg: f64,
    /// Index of the direction.
    pub direction: usize,
    /// Mean of the repeats.
    pub mean: Mean,
}

/// The mean shift of one sample at one angle over the directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AngleMean {
    /// Index of the sample.
    pub sample: usize,
    /// Contact angle, degrees.
    pub angle_deg: f64,
    /// Mean of the directions, each with the same weight.
    pub mean: Mean,
}

/// The mean of the repeats in each direction, ordered by sample, angle and direction.
pub fn by_direction(touches: &[TouchShift]) -> Vec<DirectionMean> {
    let mut touches = touches.to_vec();
    // The sort is stable: repeats stay in their order.
    touches.sort_by(|a, b| {
        (a.sample.cmp(&b.sample))
            .then(a.angle_deg.total_cmp(&b.angle_deg))
            .then(a.direction.cmp(&b.direction))
    });
    touches
        .chunk_by(|a, b| {
            (a.sample, a.angle_deg, a.direction) == (b.sample, b.angle_deg, b.direction)
        })
        .map(|repeats| {
            let TouchShift { sample, angle_deg, direction, .. } = repeats[0];
            let values = repeats.iter().map(|touch| (touch.shift_hz, touch.sigma_hz));
            let shared_hz2 =
                |a: usize, b: usize| repeats[a].reference.covariance_hz2(&repeats[b].reference);
            DirectionMean { sample, angle_deg, direction, mean: mean(values, shared_hz2) }
        })
        .collect()
}

/// The mean of the directions at each angle of these touches, ordered by sample and angle.
///
/// `means` must be those of [`by_direction`].
pub fn by_angle(touches: &[TouchShift], means: &[DirectionMean]) -> Vec<AngleMean> {
    means
        .chunk_by(|a, b| (a.sample, a.angle_deg) == (b.sample, b.angle_deg))
        .map(|directions| {
            let DirectionMean { sample, angle_deg, .. } = directions[0];
            let values = directions.iter().map(|one| (one.mean.shift_hz, one.mean.sigma_hz));
            let of: Vec<Vec<Reference>> =
                directions.iter().map(|one| references(touches, one)).collect();
            let shared_hz2 = |a: usize, b: usize| mean_covariance_hz2(&of[a], &of[b]);
            AngleMean { sample, angle_deg, mean: mean(values, shared_hz2) }
        })
        .collect()
}

/// The covariance of the means of two samples at one angle of these touches by their references, Hz².
///
/// `means` must be those of [`by_direction`].
pub fn between_samples_hz2(
    touches: &[TouchShift],
    means: &[DirectionMean],
    angle_deg: f64,
    [a, b]: [usize; 2],
) -> f64 {
    let directions = |sample: usize| -> Vec<Vec<Reference>> {
        let here = |one: &&DirectionMean| (one.sample, one.angle_deg) == (sample, angle_deg);
        means.iter().filter(here).map(|one| references(touches, one)).collect()
    };
    let [a, b] = [directions(a), directions(b)];
    let each = a.iter().flat_map(|a| b.iter().map(|b| mean_covariance_hz2(a, b)));
    each.sum::<f64>() / (a.len() * b.len()).max(1) as f64
}

/// The references of the touches behind a mean.
fn references(touches: &[TouchShift], mean: &DirectionMean) -> Vec<Reference> {
    let key = (mean.sample, mean.angle_deg, mean.direction);
    let is_here = |one: &&TouchShift| (one.sample, one.angle_deg, one.direction) == key;
    touches.iter().filter(is_here).map(|one| one.reference).collect()
}

/// The covariance of the means of two groups of other touches, Hz².
fn mean_covariance_hz2(a: &[Reference], b: &[Reference]) -> f64 {
    let sum: f64 = a.iter().flat_map(|a| b.iter().map(|b| a.covariance_hz2(b))).sum();
    sum / (a.len() * b.len()).max(1) as f64
}

/// The mean of at least one value with its standard deviation, and the covariance of two different values.
fn mean(
    values: impl ExactSizeIterator<Item = (f64, f64)> + Clone,
    shared_hz2: impl Fn(usize, usize) -> f64,
) -> Mean {
    let count = values.len();
    let n = count as f64;
    let shift_hz = values.clone().map(|(shift, _)| shift).sum::<f64>() / n;
    let variance = values.clone().map(|(_, sigma)| sigma * sigma).sum::<f64>();
    let squares = values.map(|(shift, _)| (shift - shift_hz).powi(2)).sum::<f64>();
    let spread_hz = (count > 1).then(|| (squares / (n - 1.0)).sqrt());
    let pairs = (0..count).flat_map(|a| (0..count).filter(move |b| *b != a).map(move |b| (a, b)));
    let shared: f64 = pairs.map(|(a, b)| shared_hz2(a, b)).sum();
    Mean {
        shift_hz,
        sigma_hz: (variance + shared).max(0.0).sqrt() / n,
        shared_hz2: if count > 1 { shared / (n * (n - 1.0)) } else { 0.0 },
        spread_hz,
        count,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A touch with this sweep as reference, which drifts by 0.2 Hz until then.
    fn referred(sweep: u64, sample: usize, direction: usize, shift_hz: f64) -> TouchShift {
        let reference = Reference { sweep, sigma_hz: 0.1, drift_sigma_hz: 0.2, next: None };
        TouchShift { sample, direction, angle_deg: 0.0, shift_hz, sigma_hz: 0.3, reference }
    }

    /// A touch with a reference of its own.
    fn touch(sample: usize, direction: usize, angle_deg: f64, shift_hz: f64) -> TouchShift {
        TouchShift { angle_deg, ..referred(shift_hz.to_bits(), sample, direction, shift_hz) }
    }

    #[test]
    fn repeats_are_averaged_within_a_direction_and_directions_with_equal_weight() {
        let touches = [
            touch(1, 0, 0.0, 50.0),
            touch(0, 2, 15.0, 9.0),
            touch(0, 0, 15.0, 5.0),
            touch(0, 0, 15.0, 7.0),
            touch(0, 0, 0.0, 8.0),
        ];
        let cells = by_direction(&touches);
        let keys: Vec<_> = cells.iter().map(|c| (c.sample, c.angle_deg, c.direction)).collect();
        assert_eq!(keys, [(0, 0.0, 0), (0, 15.0, 0), (0, 15.0, 2), (1, 0.0, 0)]);

        let repeated = cells[1].mean;
        assert_eq!((repeated.shift_hz, repeated.count), (6.0, 2));
        assert!((repeated.sigma_hz - 0.3 / 2.0_f64.sqrt()).abs() < 1e-15);
        assert!((repeated.spread_hz.unwrap() - 2.0_f64.sqrt()).abs() < 1e-15);
        assert_eq!(cells[0].mean.spread_hz, None, "one value has no spread");
        assert_eq!(cells[0].mean.standard_error_hz(), 0.3, "the fit alone");
        assert!((repeated.standard_error_hz() - 1.0).abs() < 1e-15, "the scatter is larger");

        let means = by_angle(&touches, &cells);
        let keys: Vec<_> = means.iter().map(|mean| (mean.sample, mean.angle_deg)).collect();
        assert_eq!(keys, [(0, 0.0), (0, 15.0), (1, 0.0)]);
        // Not (5 + 7 + 9)/3: the direction touched twice does not count twice.
        assert_eq!((means[1].mean.shift_hz, means[1].mean.count), (7.5, 2));
        let expected = (0.3_f64.powi(2) / 2.0 + 0.3_f64.powi(2)).sqrt() / 2.0;
        assert!((means[1].mean.sigma_hz - expected).abs() < 1e-15);
    }

    #[test]
    fn no_touches_give_no_means() {
        assert_eq!(by_direction(&[]), []);
        assert_eq!(by_angle(&[], &[]), []);
    }

    /// Of the variance of 0.09 Hz² of each touch, 0.05 Hz² are of the sweep and the drift that all have in common.
    #[test]
    fn the_mean_of_touches_with_one_reference_keeps_what_they_share() {
        let touches = [
            referred(7, 0, 0, 5.0),
            referred(7, 0, 0, 5.2),
            referred(7, 0, 2, 5.4),
            referred(7, 1, 0, 50.0),
            referred(8, 2, 0, 70.0),
        ];
        let cells = by_direction(&touches);
        let repeated = cells[0].mean;
        assert!((repeated.sigma_hz.powi(2) - (0.05 + 0.04 / 2.0)).abs() < 1e-12, "{repeated:?}");
        assert!((repeated.shared_hz2 - 0.05).abs() < 1e-12);
        let scatter_hz2 = 0.02 / 2.0 + 0.05;
        assert!(scatter_hz2 < repeated.sigma_hz.powi(2));
        assert_eq!(repeated.standard_error_hz(), repeated.sigma_hz, "the scatter is smaller");
        let all = by_angle(&touches, &cells)[0].mean;
        assert!(
            (all.sigma_hz.powi(2) - (0.05 + (0.04 / 2.0 + 0.04) / 4.0)).abs() < 1e-12,
            "{all:?}"
        );
        let between = |b: usize| between_samples_hz2(&touches, &cells, 0.0, [0, b]);
        assert!((between(1) - 0.05).abs() < 1e-12);
        assert_eq!(between(2), 0.0, "it has another reference");
    }
}
