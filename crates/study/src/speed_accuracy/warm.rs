//! Readings one after the other of a resonance that moves in between, as in a run.

use rayon::prelude::*;
use rig_model::{SweepMethod, Window, random::Stream};
use rig_resonance::{Past, Prior, Resonance};

use super::{
    cell::{Cell, RESONANCES_HZ},
    way::{cold, plan, request},
};
use crate::analyzer::{Analyzer, sensor};

/// How far the resonance is believed to move between two readings, Hz.
const MOVES_HZ: f64 = 1.0;
/// The part of it that it does move at most: what was believed also has an error.
const MOVES_PART: f64 = 0.9;
/// Readings in a row.
const READINGS: usize = 20;

/// Warm readings of one kind.
#[derive(Debug, Clone)]
pub(super) struct Warm {
    pub(super) cell: Cell,
    pub(super) target_hz: f64,
    /// The time of each reading, s, in rising order; infinite where it was refused or not as good
    /// as asked.
    pub(super) times_s: Vec<f64>,
    /// The time of all together, s.
    pub(super) total_s: f64,
    /// The largest error in units of what was claimed.
    pub(super) worst_sigmas: f64,
}

impl Warm {
    /// Good readings per second.
    pub(super) fn per_second(&self) -> f64 {
        let good = self.times_s.iter().filter(|time| time.is_finite()).count();
        good as f64 / self.total_s
    }
}

/// Tracks a resonance in so many runs.
pub(super) fn track(method: SweepMethod, cell: Cell, target_hz: f64, runs: u32, seed: u64) -> Warm {
    let one = |run: u32| {
        let chance = Stream::new(seed, cell.number() << 20 | u64::from(run));
        follow(method, &cell, target_hz, chance)
    };
    let runs: Vec<Vec<(f64, Option<Resonance>, f64)>> =
        (0..runs).into_par_iter().map(one).collect();
    let mut warm = Warm { cell, target_hz, times_s: Vec::new(), total_s: 0.0, worst_sigmas: 0.0 };
    for (time_s, found, error_hz) in runs.into_iter().flatten() {
        let is_good = found.is_some_and(|found| found.sigma_hz <= target_hz);
        warm.times_s.push(if is_good { time_s } else { f64::INFINITY });
        warm.total_s += time_s;
        let sigmas = found.map_or(0.0, |found| (error_hz / found.sigma_hz).abs());
        warm.worst_sigmas = warm.worst_sigmas.max(sigmas);
    }
    warm.times_s.sort_by(f64::total_cmp);
    warm
}

/// One run: times, results and errors of the readings after the first.
fn follow(
    method: SweepMethod,
    cell: &Cell,
    target_hz: f64,
    mut chance: Stream,
) -> Vec<(f64, Option<Resonance>, f64)> {
    let (low_hz, high_hz) = RESONANCES_HZ;
    let between = |part: f64| low_hz + (high_hz - low_hz) * part;
    let mut resonance_hz = between(chance.uniform());
    let circuit = |resonance_hz: f64| sensor(resonance_hz, cell.q, cell.coupling);
    let steps: [f64; READINGS] = std::array::from_fn(|_| 2.0 * chance.uniform() - 1.0);
    let mut analyzer = Analyzer::at_rest(circuit(resonance_hz), cell.noise, chance);
    let request = request(method, target_hz);
    let first = plan(&mut analyzer, &request, &cold(cell.noise));
    let Some(mut last) = first.verdict.accepted().copied() else { return Vec::new() };
    let mut readings = Vec::new();
    for step in steps {
        resonance_hz = (resonance_hz + MOVES_PART * MOVES_HZ * step).clamp(low_hz, high_hz);
        analyzer.set_circuit(circuit(resonance_hz));
        let within =
            Window { min_hz: last.resonance_hz - MOVES_HZ, max_hz: last.resonance_hz + MOVES_HZ };
        // The noise of the analyzer is known from all of its readings, not from the last few alone.
        let prior = Prior {
            noise: cold(cell.noise).noise,
            past: Past::Unknown,
            ..Prior::moved(&last, within)
        };
        let measured = plan(&mut analyzer, &request, &prior);
        let found = measured.verdict.accepted().copied();
        let error_hz = found.map_or(0.0, |found| found.resonance_hz - resonance_hz);
        readings.push((measured.time_s, found, error_hz));
        let Some(found) = found else { break };
        last = found;
    }
    readings
}
