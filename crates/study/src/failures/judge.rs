//! Judgement of an estimate: right, refused, or silently wrong.

use rayon::prelude::*;
use rig_model::{Reading, random::Stream};
use rig_resonance::{Estimator, FitOptions, FitOutcome, ModelOrder, Reason, fit};

use super::{
    axis::{Axis, SENSORS},
    simulated_sweep::SimulatedSweep,
};
use crate::bound::Information;

/// The outcome of a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// A result within the expected error.
    Right,
    /// The estimator refused the sweep.
    Refused,
    /// A wrong result without a warning.
    SilentlyWrong,
}

/// Largest error of an estimator with an uncertainty, in its own standard deviations. Noise alone
/// exceeds it once in two million sweeps.
const OWN_SIGMAS: f64 = 5.0;
/// Largest error of the other estimators, in Cramér–Rao bounds of an undisturbed sweep.
const BOUNDS: f64 = 10.0;

/// The outcomes of one estimator at one point of an axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Counts {
    pub(super) right: u32,
    pub(super) refused: u32,
    pub(super) wrong: u32,
}

impl Counts {
    pub(super) const fn sweeps(&self) -> u32 {
        self.right + self.refused + self.wrong
    }

    pub(super) fn share(&self, of: u32) -> f64 {
        f64::from(of) / f64::from(self.sweeps().max(1))
    }

    fn add(&mut self, outcome: Outcome) {
        match outcome {
            Outcome::Right => self.right += 1,
            Outcome::Refused => self.refused += 1,
            Outcome::SilentlyWrong => self.wrong += 1,
        }
    }
}

/// The result of the production fit for one sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FitResult {
    pub(super) outcome: Outcome,
    pub(super) reason: Option<Reason>,
    pub(super) model_order: Option<ModelOrder>,
    /// Error of a result over its stated standard deviation.
    pub(super) sigmas: Option<f64>,
    /// Whether two results that should agree differ; `None` for a single result.
    pub(super) differ: Option<bool>,
}

/// All sweeps at one point of an axis.
#[derive(Debug, Clone)]
pub(super) struct AxisPoint {
    pub(super) axis: Axis,
    pub(super) value: f64,
    /// In the order of [`Estimator::ALL`]; the last one is the production fit.
    pub(super) counts: [Counts; Estimator::ALL.len()],
    pub(super) result: Vec<FitResult>,
}

/// Judges every estimator on `trials` sweeps of each sensor; `None` if no sensor has a sweep here.
pub(super) fn judge(axis: Axis, point: usize, trials: u32, seed: u64) -> Option<AxisPoint> {
    let value = axis.values()[point];
    let simulated: Vec<(u64, SimulatedSweep)> = SENSORS
        .into_iter()
        .zip(0_u64..)
        .filter_map(|(sensor, number)| Some((number, axis.simulated(sensor, value)?)))
        .collect();
    let sweeps: Vec<(u64, SimulatedSweep, u32)> = simulated
        .into_iter()
        .flat_map(|(number, simulated)| (0..trials).map(move |trial| (number, simulated, trial)))
        .collect();
    if sweeps.is_empty() {
        return None;
    }
    // Each point of each axis has its own random sweeps.
    let axis_number = Axis::ALL.iter().position(|one| *one == axis).map_or(0, |one| one as u64);
    let name = |sensor: u64, trial: u32| {
        u64::from(trial) << 32 | axis_number << 16 | (point as u64) << 8 | sensor
    };
    let one = |&(sensor, simulated, trial): &(u64, SimulatedSweep, u32)| {
        sweep(axis, simulated, Stream::new(seed, name(sensor, trial)))
    };
    let outcomes: Vec<_> = sweeps.par_iter().map(one).collect();
    let mut counts = [Counts::default(); Estimator::ALL.len()];
    for (by_estimator, _) in &outcomes {
        for (counts, outcome) in counts.iter_mut().zip(by_estimator) {
            counts.add(*outcome);
        }
    }
    Some(AxisPoint {
        axis,
        value,
        counts,
        result: outcomes.into_iter().map(|(_, result)| result).collect(),
    })
}

/// Judges every estimator on one sweep.
fn sweep(
    axis: Axis,
    simulated: SimulatedSweep,
    mut random: Stream,
) -> ([Outcome; Estimator::ALL.len()], FitResult) {
    // The resonance is shifted at random within one step of the grid.
    let step_hz = (simulated.window.max_hz - simulated.window.min_hz) / f64::from(simulated.points);
    let moved_hz = match axis {
        // This axis compares both sides of the window's edge.
        Axis::WindowOffset => 0.0,
        _ => step_hz * (random.uniform() - 0.5),
    };
    let simulated = SimulatedSweep { resonance_hz: simulated.resonance_hz + moved_hz, ..simulated };
    let (readings, result) = if axis == Axis::DriveLevelStep {
        with_step(axis, &simulated, random)
    } else {
        let readings = simulated.measure(random);
        let result = production(axis, &simulated, &readings);
        (readings, result)
    };
    let allowed_hz = BOUNDS * bound_hz(&simulated);
    let outcomes = Estimator::ALL.map(|estimator| match estimator {
        Estimator::MaximumLikelihood => result.outcome,
        baseline => {
            let found_hz = baseline.estimate(&readings, simulated.window).ok();
            of_answer(found_hz, &simulated, allowed_hz)
        }
    });
    (outcomes, result)
}

/// Judges the fit of the daemon.
fn production(axis: Axis, simulated: &SimulatedSweep, readings: &[Reading]) -> FitResult {
    let differ = simulated.is_both_ways.then(|| {
        let (up, down) = readings.split_at(readings.len() / 2);
        differ(&verdict(axis, simulated, up), &verdict(axis, simulated, down))
    });
    let verdict = verdict(axis, simulated, readings);
    // The truth is the resonance at the effective time of the result.
    let effective_time_s = verdict
        .accepted()
        .and_then(|found| found.effective_time_s(readings, &options(axis, simulated)));
    let simulated = effective_time_s
        .map_or(*simulated, |effective_time_s| simulated.at(effective_time_s, readings));
    FitResult { differ, ..result(&simulated, &verdict) }
}

/// Sweeps at the full level and at half of it.
fn with_step(
    axis: Axis,
    simulated: &SimulatedSweep,
    mut random: Stream,
) -> (Vec<Reading>, FitResult) {
    let half = SimulatedSweep { softening: 0.25 * simulated.softening, ..*simulated };
    let low = half.measure(random.fork());
    let of_low = verdict(axis, &half, &low);
    let of_high = verdict(axis, simulated, &simulated.measure(random));
    let differ = differ(&of_low, &of_high);
    let verdict = of_low.without_drive(&of_high, 2.0);
    (low, FitResult { differ: Some(differ), ..result(simulated, &verdict) })
}

fn verdict(axis: Axis, simulated: &SimulatedSweep, readings: &[Reading]) -> FitOutcome {
    fit(readings, &options(axis, simulated))
}

fn options(axis: Axis, simulated: &SimulatedSweep) -> FitOptions {
    FitOptions { window: Some(simulated.window), timing: axis.timing(), ..FitOptions::default() }
}

/// Whether two results differ significantly; false if one is refused.
fn differ(one: &FitOutcome, other: &FitOutcome) -> bool {
    let both = one.accepted().zip(other.accepted());
    both.is_some_and(|(one, other)| one.is_apart_from(other))
}

fn result(simulated: &SimulatedSweep, verdict: &FitOutcome) -> FitResult {
    match verdict {
        FitOutcome::Accepted(found) => {
            let allowed_hz = OWN_SIGMAS * found.sigma_hz;
            let error_hz =
                simulated.truth_hz().map(|truth_hz| (found.resonance_hz - truth_hz).abs());
            FitResult {
                outcome: of_answer(Some(found.resonance_hz), simulated, allowed_hz),
                reason: None,
                model_order: Some(found.model_order),
                sigmas: error_hz.map(|error_hz| error_hz / found.sigma_hz),
                differ: None,
            }
        }
        FitOutcome::Refused(refusal) => FitResult {
            outcome: Outcome::Refused,
            reason: Some(refusal.reason),
            model_order: None,
            sigmas: None,
            differ: None,
        },
    }
}

fn of_answer(found_hz: Option<f64>, simulated: &SimulatedSweep, allowed_hz: f64) -> Outcome {
    match (found_hz, simulated.truth_hz()) {
        (None, _) => Outcome::Refused,
        (Some(found), Some(truth)) if (found - truth).abs() <= allowed_hz => Outcome::Right,
        (Some(_), _) => Outcome::SilentlyWrong,
    }
}

/// The Cramér–Rao bound of the undisturbed sweep, Hz.
fn bound_hz(simulated: &SimulatedSweep) -> f64 {
    let information = Information::settled(&simulated.circuit(), &simulated.points());
    simulated.noise * simulated.resonance_hz * information.relative_bound()
}
