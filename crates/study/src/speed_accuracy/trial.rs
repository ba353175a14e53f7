//! Sweeps, many times over, and what came out.

use rayon::prelude::*;

use super::{
    cell::{Cell, RESONANCES_HZ},
    reader::Reader,
    way::Way,
};
use crate::{analyzer::sensor, bound::Information};
use rig_model::random::Stream;

/// One sweep, as one reader read it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Trial {
    pub(super) time_s: f64,
    /// The Cramér–Rao bound of the points measured.
    pub(super) bound_hz: f64,
    /// What was found; nothing for a refusal.
    pub(super) found: Option<Found>,
}

/// A resonance that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Found {
    pub(super) error_hz: f64,
    /// What the reader claims; baselines claim nothing.
    pub(super) sigma_hz: Option<f64>,
}

/// All sweeps of one way in one cell by one reader.
#[derive(Debug, Clone)]
pub(super) struct Group {
    pub(super) cell: Cell,
    pub(super) way: Way,
    pub(super) reader: Reader,
    pub(super) trials: Vec<Trial>,
}

/// Measures so many times, and lets every reader that can read them.
pub(super) fn run(cell: Cell, way: Way, trials: u32, seed: u64) -> Vec<Group> {
    let readers = Reader::of(way);
    let sweeps: Vec<Vec<Trial>> =
        (0..trials).into_par_iter().map(|trial| one(cell, way, &readers, seed, trial)).collect();
    let group = |(place, &reader): (usize, &Reader)| {
        let trials = sweeps.iter().map(|by_reader| by_reader[place]).collect();
        Group { cell, way, reader, trials }
    };
    readers.iter().enumerate().map(group).collect()
}

/// One sweep, by every reader.
fn one(cell: Cell, way: Way, readers: &[Reader], seed: u64, trial: u32) -> Vec<Trial> {
    let mut chance = Stream::new(seed, cell.number() << 20 | u64::from(trial));
    let (low_hz, high_hz) = RESONANCES_HZ;
    let resonance_hz = low_hz + (high_hz - low_hz) * chance.uniform();
    let circuit = sensor(resonance_hz, cell.q, cell.coupling);
    let measured = way.measure(&circuit, &cell, chance);
    let points = &measured.points;
    let information = match way {
        Way::Steady { .. } => Information::settled(&circuit, points),
        _ => Information::in_time(&circuit, points),
    };
    let bound_hz = cell.noise * resonance_hz * information.relative_bound();
    let read = |reader: &Reader| {
        let found = reader
            .read(&measured)
            .map(|(found_hz, sigma_hz)| Found { error_hz: found_hz - resonance_hz, sigma_hz });
        Trial { time_s: measured.time_s, bound_hz, found }
    };
    readers.iter().map(read).collect()
}

impl Group {
    fn found(&self) -> impl Iterator<Item = Found> + '_ {
        self.trials.iter().filter_map(|trial| trial.found)
    }

    /// How many sweeps gave a resonance.
    pub(super) fn answers(&self) -> usize {
        self.found().count()
    }

    /// The mean error of the answers, Hz.
    pub(super) fn bias_hz(&self) -> Option<f64> {
        mean(self.found().map(|found| found.error_hz))
    }

    /// The root mean square of the errors of the answers, bias included, Hz.
    pub(super) fn rmse_hz(&self) -> Option<f64> {
        mean(self.found().map(|found| found.error_hz.powi(2))).map(f64::sqrt)
    }

    /// The root mean square of the bounds, Hz.
    pub(super) fn bound_hz(&self) -> Option<f64> {
        let squares = self.trials.iter().map(|trial| trial.bound_hz.powi(2));
        mean(squares).map(f64::sqrt).filter(|bound| bound.is_finite())
    }

    /// The largest error in units of what the reader claimed.
    pub(super) fn worst_sigmas(&self) -> Option<f64> {
        self.found()
            .filter_map(|found| Some((found.error_hz / found.sigma_hz?).abs()))
            .max_by(f64::total_cmp)
    }

    /// The time that this share of the sweeps needs at most, s.
    pub(super) fn time_s(&self, share: f64) -> f64 {
        let mut times: Vec<f64> = self.trials.iter().map(|trial| trial.time_s).collect();
        times.sort_by(f64::total_cmp);
        quantile(&times, share)
    }

    /// The share of all sweeps that reach this claimed standard deviation within this time.
    pub(super) fn reached(&self, target_hz: f64, within_s: f64) -> f64 {
        let reaches = |trial: &&Trial| {
            let sigma_hz = trial.found.and_then(|found| found.sigma_hz);
            sigma_hz.is_some_and(|sigma| sigma <= target_hz) && trial.time_s <= within_s
        };
        self.trials.iter().filter(reaches).count() as f64 / self.trials.len() as f64
    }

    /// The time within which this share of all sweeps reaches the target, s; nothing where fewer do.
    pub(super) fn time_to_reach_s(&self, target_hz: f64, share: f64) -> Option<f64> {
        let reaching = |trial: &&Trial| {
            trial.found.is_some_and(|found| found.sigma_hz.is_some_and(|sigma| sigma <= target_hz))
        };
        let mut times: Vec<f64> = self.trials.iter().filter(reaching).map(|t| t.time_s).collect();
        times.resize(self.trials.len(), f64::INFINITY);
        times.sort_by(f64::total_cmp);
        Some(quantile(&times, share)).filter(|time| time.is_finite())
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_usize), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// The value that this share of the sorted values does not exceed.
pub(super) fn quantile(sorted: &[f64], share: f64) -> f64 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of a count of values"
    )]
    let place = (share * sorted.len() as f64).ceil() as usize;
    sorted[place.clamp(1, sorted.len()) - 1]
}
