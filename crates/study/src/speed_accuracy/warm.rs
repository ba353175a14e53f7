//! Repeated readings of a resonance that moves in between, as in a run.

use rayon::prelude::*;
use rig_model::{Window, random::Stream};
use rig_resonance::{Prior, Resonance};

use super::{
    case::{Case, RESONANCES_HZ},
    method::{cold, plan, request, survey},
};
use crate::analyzer::{Analyzer, Gaps, sensor};

/// Largest assumed move of the resonance between two readings, linewidths.
const MOVES: f64 = 1.0;
/// Largest actual move, relative to the assumed one: the last estimate also has an error.
const MOVES_PART: f64 = 0.9;
/// Number of readings in a row.
const READINGS: usize = 20;

/// Warm readings in one case.
#[derive(Debug, Clone)]
pub(super) struct Warm {
    pub(super) case: Case,
    pub(super) target_hz: f64,
    /// The time of each reading, s, sorted.
    pub(super) times_s: Vec<f64>,
    /// Number of readings that are refused or miss the target.
    pub(super) missed: usize,
    /// Largest error in units of the stated standard deviation.
    pub(super) worst_sigmas: f64,
}

impl Warm {
    /// Readings that reach the target, a second of all readings.
    pub(super) fn per_second(&self) -> f64 {
        (self.times_s.len() - self.missed) as f64 / self.times_s.iter().sum::<f64>()
    }
}

/// One reading of a run.
struct WarmReading {
    time_s: f64,
    found: Option<Resonance>,
    error_hz: f64,
}

/// Tracks a resonance in `runs` runs.
pub(super) fn track(case: Case, target_hz: f64, runs: u32, seed: u64) -> Warm {
    let one = |run: u32| {
        let random = Stream::new(seed, case.number() << 20 | u64::from(run));
        follow(&case, target_hz, random)
    };
    let runs: Vec<Vec<WarmReading>> = (0..runs).into_par_iter().map(one).collect();
    let mut warm = Warm { case, target_hz, times_s: Vec::new(), missed: 0, worst_sigmas: 0.0 };
    for WarmReading { time_s, found, error_hz } in runs.into_iter().flatten() {
        let is_good = found.is_some_and(|found| found.sigma_hz <= target_hz);
        warm.times_s.push(time_s);
        warm.missed += usize::from(!is_good);
        let sigmas = found.map_or(0.0, |found| (error_hz / found.sigma_hz).abs());
        warm.worst_sigmas = warm.worst_sigmas.max(sigmas);
    }
    warm.times_s.sort_by(f64::total_cmp);
    warm
}

/// One run: the readings after the survey. A survey that is refused is a reading that is missed.
fn follow(case: &Case, target_hz: f64, mut random: Stream) -> Vec<WarmReading> {
    let (low_hz, high_hz) = RESONANCES_HZ;
    let between = |part: f64| low_hz + (high_hz - low_hz) * part;
    let mut resonance_hz = between(random.uniform());
    let circuit = |resonance_hz: f64| sensor(resonance_hz, case.q, case.coupling);
    let steps: [f64; READINGS] = std::array::from_fn(|_| 2.0 * random.uniform() - 1.0);
    let moves_hz = MOVES * resonance_hz / case.q;
    let mut analyzer =
        Analyzer::at_rest(circuit(resonance_hz), case.noise, random).with_any_phase(Gaps::USUAL);
    let request = request(target_hz);
    let first = survey(&mut analyzer, target_hz, case.noise);
    let Some(mut last) = first.verdict.accepted().copied() else {
        return vec![WarmReading { time_s: first.time_s, found: None, error_hz: 0.0 }];
    };
    let mut readings = Vec::new();
    for step in steps {
        resonance_hz = (resonance_hz + MOVES_PART * moves_hz * step).clamp(low_hz, high_hz);
        analyzer.set_circuit(circuit(resonance_hz));
        let within =
            Window { min_hz: last.resonance_hz - moves_hz, max_hz: last.resonance_hz + moves_hz };
        let prior = Prior::moved(&last, within, first.bench);
        let measured = plan(&mut analyzer, &request, &prior);
        let found = measured.verdict.accepted().copied();
        let error_hz = found.map_or(0.0, |found| found.resonance_hz - resonance_hz);
        let mut reading = WarmReading { time_s: measured.time_s, found, error_hz };
        let next = found.or_else(|| {
            // After a refusal the sensor is looked for again, which takes time too.
            let anywhere = Prior { bench: first.bench, ..cold(case.noise) };
            let again = plan(&mut analyzer, &request, &anywhere);
            reading.time_s += again.time_s;
            again.verdict.accepted().copied()
        });
        readings.push(reading);
        let Some(next) = next else { break };
        last = next;
    }
    readings
}
