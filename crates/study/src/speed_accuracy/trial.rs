//! Repeated sweeps and their results.

use rayon::prelude::*;

use super::{
    case::{Case, RESONANCES_HZ},
    estimator::SweepEstimator,
    method::Method,
};
use crate::{analyzer::sensor, bound::Information};
use rig_model::random::Stream;

/// The result of one estimator for one sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Trial {
    pub(super) time_s: f64,
    /// The Cramér–Rao bound of the measured points, Hz.
    pub(super) bound_hz: f64,
    /// The estimate; `None` for a refusal.
    pub(super) found: Option<Estimate>,
}

/// An estimated resonance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Estimate {
    pub(super) error_hz: f64,
    /// The stated standard deviation; `None` for baselines.
    pub(super) sigma_hz: Option<f64>,
}

/// All sweeps of one method in one case by one estimator.
#[derive(Debug, Clone)]
pub(super) struct Group {
    pub(super) case: Case,
    pub(super) method: Method,
    pub(super) estimator: SweepEstimator,
    pub(super) trials: Vec<Trial>,
}

/// Measures `trials` sweeps and applies every suitable estimator.
pub(super) fn run(case: Case, method: Method, trials: u32, seed: u64) -> Vec<Group> {
    let estimators = SweepEstimator::of(method);
    let sweeps: Vec<Vec<Trial>> = (0..trials)
        .into_par_iter()
        .map(|trial| one(case, method, &estimators, seed, trial))
        .collect();
    let group = |(place, &estimator): (usize, &SweepEstimator)| {
        let trials = sweeps.iter().map(|by_reader| by_reader[place]).collect();
        Group { case, method, estimator, trials }
    };
    estimators.iter().enumerate().map(group).collect()
}

/// Applies every estimator to one sweep.
fn one(
    case: Case,
    method: Method,
    estimators: &[SweepEstimator],
    seed: u64,
    trial: u32,
) -> Vec<Trial> {
    let mut random = Stream::new(seed, case.number() << 20 | u64::from(trial));
    let (low_hz, high_hz) = RESONANCES_HZ;
    let resonance_hz = low_hz + (high_hz - low_hz) * random.uniform();
    let circuit = sensor(resonance_hz, case.q, case.coupling);
    let measured = method.measure(&circuit, &case, random);
    let points = &measured.points;
    let information = match method {
        Method::Steady { .. } => Information::settled(&circuit, points),
        _ => Information::in_time(&circuit, points),
    };
    let bound_hz = case.noise * resonance_hz * information.relative_bound();
    let read = |estimator: &SweepEstimator| {
        let found = estimator.estimate(&measured).map(|one| Estimate {
            error_hz: one.resonance_hz - resonance_hz,
            sigma_hz: one.sigma_hz,
        });
        Trial { time_s: measured.time_s, bound_hz, found }
    };
    estimators.iter().map(read).collect()
}

impl Group {
    fn found(&self) -> impl Iterator<Item = Estimate> + '_ {
        self.trials.iter().filter_map(|trial| trial.found)
    }

    /// Number of accepted sweeps.
    pub(super) fn answers(&self) -> usize {
        self.found().count()
    }

    /// The mean error of the estimates, Hz.
    pub(super) fn bias_hz(&self) -> Option<f64> {
        mean(self.found().map(|found| found.error_hz))
    }

    /// The mean error in stated standard deviations.
    pub(super) fn bias_sigmas(&self) -> Option<f64> {
        mean(self.found().filter_map(|found| Some(found.error_hz / found.sigma_hz?)))
    }

    /// The root mean square error of the estimates, including bias, Hz.
    pub(super) fn rmse_hz(&self) -> Option<f64> {
        mean(self.found().map(|found| found.error_hz.powi(2))).map(f64::sqrt)
    }

    /// Relative standard error of the mean square error.
    pub(super) fn mean_square_rel(&self) -> Option<f64> {
        let squares = || self.found().map(|found| found.error_hz.powi(2));
        let (n, all) = (squares().count() as f64, mean(squares())?);
        let spread: f64 = squares().map(|square| (square - all).powi(2)).sum();
        (n > 1.0).then(|| (spread / (n - 1.0) / n).sqrt() / all)
    }

    /// The root mean square of the bounds, Hz.
    pub(super) fn bound_hz(&self) -> Option<f64> {
        let squares = self.trials.iter().map(|trial| trial.bound_hz.powi(2));
        mean(squares).map(f64::sqrt).filter(|bound| bound.is_finite())
    }

    /// The largest error in units of the stated standard deviation.
    pub(super) fn worst_sigmas(&self) -> Option<f64> {
        self.found()
            .filter_map(|found| Some((found.error_hz / found.sigma_hz?).abs()))
            .max_by(f64::total_cmp)
    }

    /// The share of the stated 95 % intervals that contain the truth.
    pub(super) fn coverage(&self) -> Option<f64> {
        const INTERVAL_SIGMAS: f64 = 1.96;
        let is_inside = |found: Estimate| {
            Some(f64::from(found.error_hz.abs() < INTERVAL_SIGMAS * found.sigma_hz?))
        };
        mean(self.found().filter_map(is_inside))
    }

    /// The error that is to be expected, Hz: of a planned sweep what it states, of given points their bound, which the fit
    /// reaches.
    pub(super) fn expected_hz(&self) -> Option<f64> {
        match self.method {
            Method::Decay { .. } | Method::Unsurveyed { .. } => {
                mean(self.found().filter_map(|found| Some(found.sigma_hz?.powi(2)))).map(f64::sqrt)
            }
            Method::Steady { .. } | Method::Even { .. } | Method::Fast { .. } => self.bound_hz(),
        }
    }

    /// The time within which this share of the sweeps ends, s.
    pub(super) fn time_s(&self, share: f64) -> f64 {
        let mut times: Vec<f64> = self.trials.iter().map(|trial| trial.time_s).collect();
        times.sort_by(f64::total_cmp);
        quantile(&times, share)
    }

    /// The mean time of a sweep, s.
    pub(super) fn mean_time_s(&self) -> f64 {
        mean(self.trials.iter().map(|trial| trial.time_s)).unwrap_or(f64::NAN)
    }

    /// The share of all sweeps that reach this stated standard deviation within this time.
    pub(super) fn reached(&self, target_hz: f64, within_s: f64) -> f64 {
        let reaches = |trial: &&Trial| {
            let sigma_hz = trial.found.and_then(|found| found.sigma_hz);
            sigma_hz.is_some_and(|sigma| sigma <= target_hz) && trial.time_s <= within_s
        };
        self.trials.iter().filter(reaches).count() as f64 / self.trials.len() as f64
    }

    /// The time within which this share of all sweeps reaches the target, s; `None` if fewer sweeps
    /// do.
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

/// The quantile of sorted values.
pub(super) fn quantile(sorted: &[f64], share: f64) -> f64 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of a count of values"
    )]
    let place = (share * sorted.len() as f64).ceil() as usize;
    sorted[place.clamp(1, sorted.len()) - 1]
}
