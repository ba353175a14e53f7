//! Readings that must agree before they are taken.

/// Readings of one quantity. It is settled when enough of them agree; one that contradicts the others is asked
/// for again, until there were too many.
#[derive(Debug, Clone)]
pub(crate) struct Agreement {
    readings: Vec<f64>,
    tolerance: f64,
    needed: usize,
    most: usize,
}

/// The mean of readings that agree, and its standard deviation by their scatter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Mean {
    pub(crate) value: f64,
    pub(crate) sigma: f64,
}

/// After a reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Progress {
    /// More are needed. `contradicts` says that this one agrees with none before it.
    More { contradicts: bool },
    /// Enough agree.
    Settled(Mean),
    /// Too many contradict each other.
    Failed,
}

impl Agreement {
    /// Settled when `needed` readings lie within `tolerance` of the last one, failed after twice as many.
    pub(crate) const fn new(needed: usize, tolerance: f64) -> Self {
        Self { readings: Vec::new(), tolerance, needed, most: 2 * needed }
    }

    pub(crate) fn add(&mut self, reading: f64) -> Progress {
        let is_first = self.readings.is_empty();
        self.readings.push(reading);
        let near: Vec<f64> = self
            .readings
            .iter()
            .copied()
            .filter(|other| (other - reading).abs() <= self.tolerance)
            .collect();
        if self.needed <= near.len() {
            return Progress::Settled(mean(&near));
        }
        if self.most <= self.readings.len() {
            return Progress::Failed;
        }
        Progress::More { contradicts: !is_first && near.len() == 1 }
    }
}

fn mean(readings: &[f64]) -> Mean {
    let n = readings.len() as f64;
    let value = readings.iter().sum::<f64>() / n;
    let squares: f64 = readings.iter().map(|reading| (reading - value).powi(2)).sum();
    Mean { value, sigma: (squares / (n - 1.0).max(1.0) / n).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::{Progress::*, *};

    #[test]
    fn readings_settle_when_enough_agree_and_fail_when_too_many_do_not() {
        let check = |readings: &[f64], expected: &[Progress]| {
            let mut agreement = Agreement::new(3, 0.1);
            let found: Vec<_> = readings.iter().map(|reading| agreement.add(*reading)).collect();
            assert_eq!(found, expected, "{readings:?}");
        };
        let exact = |value| Settled(Mean { value, sigma: 0.0 });
        let (more, odd) = (More { contradicts: false }, More { contradicts: true });
        check(&[1.0, 1.0, 1.0], &[more, more, exact(1.0)]);
        check(&[2.0, 1.0, 1.0, 1.0], &[more, odd, more, exact(1.0)]);
        check(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[more, odd, odd, odd, odd, Failed]);
        check(&[1.0, -1.0, 1.0, -1.0, 0.0, 1.0], &[more, odd, more, more, odd, exact(1.0)]);
    }

    #[test]
    fn the_scatter_of_readings_gives_the_standard_deviation_of_their_mean() {
        let mut agreement = Agreement::new(4, 1.0);
        let last = [1.0, 1.2, 1.4, 1.6].map(|reading| agreement.add(reading))[3];
        let Settled(Mean { value, sigma }) = last else { panic!("{last:?}") };
        assert!((value - 1.3).abs() < 1e-12);
        // The standard deviation of the readings is the root of 0.2 / 3.
        assert!((sigma - (0.2_f64 / 3.0 / 4.0).sqrt()).abs() < 1e-12);
    }
}
