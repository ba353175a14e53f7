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
    fn results_are_apart_from_four_standard_deviations_on() {
        let one = found(140.0);
        // The limit applies to the difference of two results.
        for (by_hz, is_apart) in [(0.056, false), (-0.056, false), (0.057, true), (-0.057, true)] {
            assert_eq!(one.is_apart_from(&found(140.0 + by_hz)), is_apart, "{by_hz}");
        }
    }
}
