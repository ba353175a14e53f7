//! The time of the sweeps beside that of common practice.

use rig_record::{Circuit, Sweep, SweepOutcome};

/// Time of the sweeps on the rig's clock, and the time that common practice would have taken.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct SweepCost {
    /// Sweeps that gave a resonance.
    pub(crate) sweeps: u32,
    /// Time of these sweeps, s.
    pub(crate) taken_s: f64,
    /// Sum of [`practice_s`] over the same resonances, s.
    pub(crate) practice_s: f64,
}

impl SweepCost {
    pub(super) fn of(sweeps: &[Sweep]) -> Self {
        let mut cost = Self::default();
        for sweep in sweeps {
            let SweepOutcome::Accepted { resonance_hz, circuit: Some(circuit), .. } = sweep.outcome
            else {
                continue;
            };
            if sweep.readings.is_empty() {
                continue;
            }
            cost.sweeps += 1;
            cost.taken_s += swept_s(sweep);
            cost.practice_s += practice_s(resonance_hz, &circuit);
        }
        cost
    }
}

/// Time of a sweep from its first reading to the end of its last one, s; 0 without readings.
pub(super) fn swept_s(sweep: &Sweep) -> f64 {
    let ends = sweep.readings.first().zip(sweep.readings.last());
    ends.map_or(0.0, |(first, last)| {
        last.started_s + last.settle_s + last.integration_s - first.started_s
    })
}

/// Time of a careful sweep without a plan, s: 201 points, at each of them five time constants of
/// settling and ten cycles of integration.
fn practice_s(resonance_hz: f64, circuit: &Circuit) -> f64 {
    let time_constant_s = circuit.quality_factor / (std::f64::consts::PI * resonance_hz);
    201.0 * (5.0 * time_constant_s + 10.0 / resonance_hz)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn practice_takes_as_long_as_a_careful_sweep_by_hand() {
        #[track_caller]
        fn check(quality_factor: f64, expected_s: f64) {
            let circuit = Circuit {
                quality_factor,
                static_capacitance_f: 27e-9,
                capacitance_ratio: 0.05,
                loss_tangent: 0.02,
                loss_tangent_sigma: None,
                quality_factor_sigma: None,
                static_capacitance_sigma_f: None,
                capacitance_ratio_sigma: None,
            };
            let found_s = practice_s(140.0, &circuit);
            assert!((found_s - expected_s).abs() < 0.05, "{found_s} s, expected {expected_s} s");
        }
        // 201 · (5 Q/π + 10)/140, by hand.
        check(10.0, 37.2);
        check(30.0, 82.9);
        check(100.0, 242.9);
    }
}
