//! Nonlinearity from two sweeps at different levels.
//!
//! A slightly softening spring changes the readings of one sweep like a shift of the resonance; a
//! second sweep at another level reveals it. Sweeps up and down reveal a dependence on the direction.

use crate::{FitOutcome, Reason, Refusal, Resonance, diagnose::doubts::SIGMA_MAX_LINEWIDTHS};

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

impl FitOutcome {
    /// The resonance extrapolated to zero drive, from this sweep and one at a level `ratio` times as
    /// high. Softening is proportional to the square of the amplitude, so that the extrapolation in the
    /// square is linear. Refused if either result is, and as [`Reason::Nonlinear`] if they differ by
    /// more than chance, because a large effect is not linear.
    #[must_use]
    pub fn without_drive(&self, higher: &Self, ratio: f64) -> Self {
        let (low, high) = match (self, higher) {
            (Self::Accepted(low), Self::Accepted(high)) => (low, high),
            (Self::Refused(_), _) => return self.clone(),
            (_, Self::Refused(_)) => return higher.clone(),
        };
        let of_high = 1.0 / (1.0 - ratio * ratio);
        let of_low = 1.0 - of_high;
        let resonance_hz = of_low * low.resonance_hz + of_high * high.resonance_hz;
        let sigma_hz = (of_low * low.sigma_hz).hypot(of_high * high.sigma_hz);
        let mut covariance = low.covariance;
        covariance[0][0] =
            of_low.powi(2) * low.covariance[0][0] + of_high.powi(2) * high.covariance[0][0];
        let found = Resonance { resonance_hz, sigma_hz, covariance, ..*low };
        let limit_hz = SIGMA_MAX_LINEWIDTHS * low.circuit().linewidth_hz();
        let reason = if low.is_apart_from(high) {
            Reason::Nonlinear
        } else if sigma_hz < limit_hz {
            return Self::Accepted(found);
        } else {
            Reason::TooNoisy { sigma_hz, limit_hz }
        };
        Self::Refused(Refusal { reason, estimate: sigma_hz.is_finite().then_some(found) })
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

    #[test]
    fn a_straight_line_in_the_square_of_the_level_leads_to_no_drive() {
        // The shift is −10 mHz at level 1, −40 mHz at level 2 and −90 mHz at level 3.
        let at = |level: f64| FitOutcome::Accepted(found(140.0 - 0.01 * level * level));
        for (low, high) in [(1.0, 2.0), (2.0, 1.0), (0.5, 2.0)] {
            let verdict = at(low).without_drive(&at(high), high / low);
            let found = verdict.accepted().unwrap();
            assert!((found.resonance_hz - 140.0).abs() < 1e-9, "{found:?}");
            assert!(found.sigma_hz > 0.01, "{found:?}");
        }
        let FitOutcome::Refused(refusal) = at(1.0).without_drive(&at(3.0), 3.0) else { panic!() };
        assert_eq!(refusal.reason, Reason::Nonlinear);
    }

    #[test]
    fn the_same_level_twice_leads_nowhere() {
        let one = FitOutcome::Accepted(found(140.0));
        let FitOutcome::Refused(refusal) = one.without_drive(&one, 1.0) else { panic!() };
        assert!(matches!(refusal.reason, Reason::TooNoisy { .. }), "{refusal}");
        assert_eq!(refusal.estimate, None);
    }

    #[test]
    fn a_sweep_that_is_refused_alone_stays_so() {
        let refusal = Refusal { reason: Reason::NotSettled, estimate: None };
        let (one, refused) = (FitOutcome::Accepted(found(140.0)), FitOutcome::Refused(refusal));
        assert_eq!(one.without_drive(&refused, 2.0), refused);
        assert_eq!(refused.without_drive(&one, 2.0), refused);
    }
}
