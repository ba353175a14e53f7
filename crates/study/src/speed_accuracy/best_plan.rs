//! The best plan found by somebody who knows the sensor beforehand: what planners are held against.

use rayon::prelude::*;
use rig_contact::Circuit;
use rig_model::SweepPoint;

use super::cell::Cell;
use crate::{analyzer::WINDOW, bound::time_to_reach_s};

/// Three frequencies in turn, from rest and without waiting: with two, five unknowns are not determined
/// once the motion has settled.
#[derive(Debug, Clone, Copy)]
struct Hops {
    /// Distances from the resonance, in linewidths.
    offsets: [f64; PLACES],
    cycles: [f64; PLACES],
}

const PLACES: usize = 3;
/// Distances and lengths that searches begin with.
const OFFSETS: [f64; 6] = [-5.0, -1.5, -0.4, 0.4, 1.5, 5.0];
const CYCLES: [f64; 3] = [2.0, 8.0, 30.0];
/// Where a search ends, as a part of its first step.
const FINEST: f64 = 0.02;
/// Cycles of the longest visit considered.
const CYCLES_MAX: f64 = 500.0;
/// Searches that are followed to their end.
const STARTS: usize = 12;

/// The least time found in which the Cramér–Rao bound of the readings is down at the target, s.
pub(super) fn time_s(cell: &Cell, target_hz: f64, limit_s: f64) -> f64 {
    let circuit = cell.middle();
    let wanted = target_hz / circuit.series_resonance_hz / cell.noise;
    let of_hops = |hops: &Hops| time_to_reach_s(&circuit, hops.points(&circuit), wanted, limit_s);
    let mut starts: Vec<(f64, Hops)> = Hops::starts()
        .into_par_iter()
        .map(|hops| (of_hops(&hops), hops))
        .filter(|(time_s, _)| time_s.is_finite())
        .collect();
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    starts.truncate(STARTS);
    let ends = starts.into_par_iter().map(|(time, hops)| descend(time, hops, &of_hops));
    ends.reduce(|| f64::INFINITY, f64::min)
}

/// Steps of one number at a time for as long as they help, then smaller ones.
fn descend(mut best_s: f64, mut hops: Hops, time_s: &impl Fn(&Hops) -> f64) -> f64 {
    let mut size = 1.0;
    while size > FINEST {
        let before_s = best_s;
        for neighbour in hops.neighbours(size) {
            let time_s = time_s(&neighbour);
            if time_s < best_s {
                (best_s, hops) = (time_s, neighbour);
            }
        }
        if best_s >= before_s {
            size *= 0.5;
        }
    }
    best_s
}

impl Hops {
    fn starts() -> Vec<Self> {
        let mut starts = Vec::new();
        for first in OFFSETS {
            for second in OFFSETS.into_iter().filter(|&second| second != first) {
                for third in OFFSETS.into_iter().filter(|&third| third != second && third != first)
                {
                    let offsets = [first, second, third];
                    starts.extend(CYCLES.map(|n| Self { offsets, cycles: [n; PLACES] }));
                }
            }
        }
        starts
    }

    fn neighbours(&self, size: f64) -> Vec<Self> {
        let mut all = Vec::new();
        for which in 0..PLACES {
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
        let points = std::array::from_fn::<_, PLACES, _>(|which| {
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
    use crate::speed_accuracy::cell::NOISE;

    /// The best of an independent search of pairs and of even sweeps, four unknowns.
    #[test]
    fn plans_are_no_worse_than_those_of_an_independent_search() {
        for (q, coupling, target_hz, seconds) in
            [(100.0, 0.1, 0.01, 0.25), (30.0, 0.1, 0.01, 0.30), (100.0, 0.02, 0.03, 0.21)]
        {
            let found_s = time_s(&Cell { q, coupling, noise: NOISE }, target_hz, 5.0);
            assert!((0.2 * seconds..seconds).contains(&found_s), "{q} {coupling}: {found_s}");
        }
    }
}
