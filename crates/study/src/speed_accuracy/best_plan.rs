//! The best plan for a known sensor, with which planners are compared.

use rayon::prelude::*;
use rig_contact::Circuit;
use rig_model::SweepPoint;

use super::case::Case;
use crate::{analyzer::WINDOW, bound::time_to_reach_s};

/// Three frequencies in turn, from rest and without waiting. Two settled frequencies would not
/// determine five unknowns.
#[derive(Debug, Clone, Copy)]
struct FrequencyCycle {
    /// Offsets from the resonance, linewidths.
    offsets: [f64; FREQUENCIES],
    cycles: [f64; FREQUENCIES],
}

const FREQUENCIES: usize = 3;
/// Offsets and cycles of the start values.
const OFFSETS: [f64; 6] = [-5.0, -1.5, -0.4, 0.4, 1.5, 5.0];
const CYCLES: [f64; 3] = [2.0, 8.0, 30.0];
/// Smallest step of a search, relative to the first.
const FINEST: f64 = 0.02;
/// Largest number of cycles of one visit.
const CYCLES_MAX: f64 = 500.0;
/// Number of start values that are refined.
const STARTS: usize = 12;

/// The shortest time found in which the Cramér–Rao bound of the readings falls to the target, s.
pub(super) fn time_s(case: &Case, target_hz: f64, limit_s: f64) -> f64 {
    let circuit = case.middle();
    let wanted = target_hz / circuit.series_resonance_hz / case.noise;
    let of_cycle =
        |cycle: &FrequencyCycle| time_to_reach_s(&circuit, cycle.points(&circuit), wanted, limit_s);
    let mut starts: Vec<(f64, FrequencyCycle)> = FrequencyCycle::starts()
        .into_par_iter()
        .map(|cycle| (of_cycle(&cycle), cycle))
        .filter(|(time_s, _)| time_s.is_finite())
        .collect();
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    starts.truncate(STARTS);
    let ends = starts.into_par_iter().map(|(time, cycle)| descend(time, cycle, &of_cycle));
    ends.reduce(|| f64::INFINITY, f64::min)
}

/// Coordinate descent with shrinking steps.
fn descend(
    mut best_s: f64,
    mut cycle: FrequencyCycle,
    time_s: &impl Fn(&FrequencyCycle) -> f64,
) -> f64 {
    let mut size = 1.0;
    while size > FINEST {
        let before_s = best_s;
        for neighbour in cycle.neighbours(size) {
            let time_s = time_s(&neighbour);
            if time_s < best_s {
                (best_s, cycle) = (time_s, neighbour);
            }
        }
        if best_s >= before_s {
            size *= 0.5;
        }
    }
    best_s
}

impl FrequencyCycle {
    fn starts() -> Vec<Self> {
        let mut starts = Vec::new();
        for first in OFFSETS {
            for second in OFFSETS.into_iter().filter(|&second| second != first) {
                for third in OFFSETS.into_iter().filter(|&third| third != second && third != first)
                {
                    let offsets = [first, second, third];
                    starts.extend(CYCLES.map(|n| Self { offsets, cycles: [n; FREQUENCIES] }));
                }
            }
        }
        starts
    }

    fn neighbours(&self, size: f64) -> Vec<Self> {
        let mut all = Vec::new();
        for which in 0..FREQUENCIES {
            for by in [-size, size] {
                let mut one = *self;
                one.offsets[which] += by;
                all.push(one);
                let mut one = *self;
                let cycles = one.cycles[which] * (1.0 + size).powf(by.signum());
                one.cycles[which] = cycles.round().clamp(1.0, CYCLES_MAX);
                all.push(one);
            }
        }
        all
    }

    fn points(self, circuit: &Circuit) -> impl Iterator<Item = SweepPoint> {
        let resonance_hz = circuit.series_resonance_hz;
        let linewidth_hz = resonance_hz / circuit.q;
        let points = std::array::from_fn::<_, FREQUENCIES, _>(|which| {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "whole and small"
            )]
            let cycles = self.cycles[which] as u32;
            let frequency_hz = resonance_hz + self.offsets[which] * linewidth_hz;
            let frequency_hz = frequency_hz.clamp(WINDOW.min_hz, WINDOW.max_hz);
            SweepPoint { frequency_hz, settle_s: 0.0, cycles }
        });
        points.into_iter().cycle()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::speed_accuracy::case::NOISE;

    /// The best plans of an independent search over pairs and even sweeps, with four unknowns.
    #[test]
    fn plans_are_no_worse_than_those_of_an_independent_search() {
        for (q, coupling, target_hz, seconds) in
            [(100.0, 0.1, 0.01, 0.25), (30.0, 0.1, 0.01, 0.30), (100.0, 0.02, 0.03, 0.21)]
        {
            let found_s = time_s(&Case { q, coupling, noise: NOISE }, target_hz, 5.0);
            assert!((0.2 * seconds..seconds).contains(&found_s), "{q} {coupling}: {found_s}");
        }
    }
}
