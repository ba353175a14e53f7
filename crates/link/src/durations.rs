//! How often something took how long.

use std::time::Duration;

/// Upper ends of the bins, s: from a line in memory to the longest time limit of a device. What takes
/// longer is in a bin of its own.
const BOUNDS_S: [f64; 13] =
    [0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0];

/// A histogram of durations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Durations {
    counts: [u64; BOUNDS_S.len() + 1],
    sum: Duration,
}

impl Durations {
    /// Counts one.
    pub fn note(&mut self, took: Duration) {
        let bin = BOUNDS_S.partition_point(|bound| *bound < took.as_secs_f64());
        self.counts[bin] += 1;
        self.sum = self.sum.saturating_add(took);
    }

    /// The upper end of each bin, s, with the number of durations in it.
    pub fn bins(&self) -> impl Iterator<Item = (f64, u64)> {
        BOUNDS_S.into_iter().chain([f64::INFINITY]).zip(self.counts)
    }

    /// Number of durations.
    pub fn count(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// All of them together.
    pub const fn sum(&self) -> Duration {
        self.sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_duration_is_in_the_bin_whose_upper_end_it_does_not_pass() {
        let mut durations = Durations::default();
        for ms in [0, 1, 2, 3, 5_000, 5_001, 3_600_000] {
            durations.note(Duration::from_millis(ms));
        }
        let bins: Vec<_> = durations.bins().filter(|(_, count)| *count > 0).collect();
        let expected =
            [(0.0005, 1), (0.001, 1), (0.002, 1), (0.005, 1), (5.0, 1), (f64::INFINITY, 2)];
        assert_eq!(bins, expected);
        assert_eq!((durations.count(), durations.sum()), (7, Duration::from_millis(3_610_007)));
    }
}
