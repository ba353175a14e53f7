//! Whether two sweeps of one sensor agree.
//!
//! A slightly softening spring changes the readings of one sweep like a shift of the resonance; a
//! second sweep at another level reveals it. Sweeps up and down reveal a dependence on the direction.

use crate::Resonance;

/// Difference of two results, in standard deviations, that chance exceeds once in ten thousand times.
const APART_SIGMAS: f64 = 4.0;

impl Resonance {
    /// Whether another result for the same resonance, from a sweep in the other direction or at another
    /// level, differs by more than chance.
    pub fn is_apart_from(&self, other: &Self) -> bool {
        let difference_hz = (self.resonance_hz - other.resonance_hz).abs();
        difference_hz > APART_SIGMAS * self.sigma_hz.hypot(other.sigma_hz)
    }
}

impl Resonance {
    /// The resonance with the uncertainty that a result at another level leaves, which is `ratio` times
    /// the level of this one. A softening spring shifts the resonance by the square of the level, so
    /// that this result differs from that of a small drive by 1/(ratio² − 1) of the difference.
    #[must_use]
    pub fn with_level_doubt(&self, other: &Self, ratio: f64) -> Self {
        let off_hz = (self.resonance_hz - other.resonance_hz) / (ratio * ratio - 1.0);
        self.widened(off_hz * off_hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ModelOrder, outcome::Spread};

    /// A result of a sensor with a linewidth of 4.7 Hz.
    fn found(resonance_hz: f64) -> Resonance {
        let circuit = crate::Circuit {
            resonance_hz,
            q: 30.0,
            c0_farad: 27e-9,
            c1_farad: 2.7e-9,
            loss_tangent: 0.0,
        };
        let spread = Spread {
            covariance: [[0.0; 5]; 5],
            condition: 1.0,
            cost: 1.0,
            neighbours: 1.0,
            correlation: 1.0,
            count: 100,
            degrees: 1.0,
            settled: (1.0, 1.0),
            widened: 0.0,
        };
        let found = Resonance::new(&circuit, &spread, ModelOrder::Circuit, None);
        Resonance { sigma_hz: 0.01, ..found }
    }

    #[test]
    fn half_the_level_leaves_a_third_of_the_difference() {
        let at_half = found(140.0).with_level_doubt(&found(139.7), 2.0);
        assert!((at_half.covariance[0][0] - 0.01).abs() < 1e-9, "{at_half:?}");
        assert_eq!(at_half.resonance_hz, 140.0);
        let same = found(140.0).with_level_doubt(&found(140.0), 2.0);
        assert!(same.covariance[0][0] < 1e-12, "{same:?}");
    }

    #[test]
    fn results_are_apart_from_four_standard_deviations_on() {
        let one = found(140.0);
        // The limit applies to the difference of two results.
        for (by_hz, is_apart) in [(0.056, false), (-0.056, false), (0.057, true), (-0.057, true)] {
            assert_eq!(one.is_apart_from(&found(140.0 + by_hz)), is_apart, "{by_hz}");
        }
    }
}
