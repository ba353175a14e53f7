//! The frequency shift of each sample at each angle: the paper's Figures 11 and 12.

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
}

/// A mean of shifts with two estimates of its error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mean {
    /// Mean shift, Hz.
    pub shift_hz: f64,
    /// Standard deviation of the mean, propagated from independent values, Hz.
    pub sigma_hz: f64,
    /// Standard deviation of the averaged values, Hz; `None` for a single value. Unlike `sigma_hz` it
    /// includes placement, depth, tissue and the difference between directions.
    pub spread_hz: Option<f64>,
    /// Number of averaged values.
    pub count: usize,
}

impl Mean {
    /// Standard deviation of the mean, Hz: the larger of the propagated one and the one from the
    /// scatter of the values. The scatter includes all errors, but may be small by chance for a few
    /// values.
    pub fn standard_error_hz(&self) -> f64 {
        let from_scatter = self.spread_hz.map_or(0.0, |spread| spread / (self.count as f64).sqrt());
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
            DirectionMean { sample, angle_deg, direction, mean: mean(values) }
        })
        .collect()
}

/// The mean of the directions at each angle, ordered by sample and angle.
///
/// `means` must have the order of [`by_direction`].
pub fn by_angle(means: &[DirectionMean]) -> Vec<AngleMean> {
    means
        .chunk_by(|a, b| (a.sample, a.angle_deg) == (b.sample, b.angle_deg))
        .map(|directions| {
            let DirectionMean { sample, angle_deg, .. } = directions[0];
            let values = directions.iter().map(|one| (one.mean.shift_hz, one.mean.sigma_hz));
            AngleMean { sample, angle_deg, mean: mean(values) }
        })
        .collect()
}

/// The mean of at least one value with its standard deviation.
fn mean(values: impl ExactSizeIterator<Item = (f64, f64)> + Clone) -> Mean {
    let count = values.len();
    let n = count as f64;
    let shift_hz = values.clone().map(|(shift, _)| shift).sum::<f64>() / n;
    let variance = values.clone().map(|(_, sigma)| sigma * sigma).sum::<f64>();
    let squares = values.map(|(shift, _)| (shift - shift_hz).powi(2)).sum::<f64>();
    let spread_hz = (count > 1).then(|| (squares / (n - 1.0)).sqrt());
    Mean { shift_hz, sigma_hz: variance.sqrt() / n, spread_hz, count }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touch(sample: usize, direction: usize, angle_deg: f64, shift_hz: f64) -> TouchShift {
        TouchShift { sample, direction, angle_deg, shift_hz, sigma_hz: 0.3 }
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

        let means = by_angle(&cells);
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
        assert_eq!(by_angle(&[]), []);
    }
}
