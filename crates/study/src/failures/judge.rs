//! Right, flagged, or silently wrong.

use rayon::prelude::*;
use rig_model::{Reading, random::Stream};
use rig_resonance::{Estimator, FitOptions, Reason, Rung, Verdict, fit};

use super::{
    axis::{Axis, SENSORS},
    scene::Scene,
};
use crate::bound::Information;

/// What came of a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// An answer within what can be expected.
    Right,
    /// No answer, and it is said so.
    Flagged,
    /// An answer that is wrong, and nobody is told.
    SilentlyWrong,
}

/// Answers of an estimator that claims an uncertainty may be so many of its own standard deviations
/// off: chance is further off once in two million.
const OWN_SIGMAS: f64 = 5.0;
/// Answers of the others may be so many Cramér–Rao bounds of a good sweep off.
const BOUNDS: f64 = 10.0;

/// The outcomes of one estimator at one value of an axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Counts {
    pub(super) right: u32,
    pub(super) flagged: u32,
    pub(super) wrong: u32,
}

impl Counts {
    pub(super) const fn sweeps(&self) -> u32 {
        self.right + self.flagged + self.wrong
    }

    pub(super) fn share(&self, of: u32) -> f64 {
        f64::from(of) / f64::from(self.sweeps().max(1))
    }

    fn add(&mut self, outcome: Outcome) {
        match outcome {
            Outcome::Right => self.right += 1,
            Outcome::Flagged => self.flagged += 1,
            Outcome::SilentlyWrong => self.wrong += 1,
        }
    }
}

/// What the production fit said of one sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Told {
    pub(super) outcome: Outcome,
    pub(super) reason: Option<Reason>,
    pub(super) rung: Option<Rung>,
    /// Error over claimed standard deviation of an answer.
    pub(super) sigmas: Option<f64>,
    /// Whether two results that should be the same are not, where there are two.
    pub(super) is_apart: Option<bool>,
}

/// All sweeps at one value of an axis.
#[derive(Debug, Clone)]
pub(super) struct Place {
    pub(super) axis: Axis,
    pub(super) value: f64,
    /// In the order of [`Estimator::ALL`], of which the production fit is the last.
    pub(super) counts: [Counts; Estimator::ALL.len()],
    pub(super) told: Vec<Told>,
}

/// Every estimator on so many sweeps of each sensor. Nothing where no sensor has a sweep.
pub(super) fn judge(axis: Axis, place: usize, trials: u32, seed: u64) -> Option<Place> {
    let value = axis.values()[place];
    let scenes: Vec<(u64, Scene)> = SENSORS
        .into_iter()
        .zip(0_u64..)
        .filter_map(|(sensor, number)| Some((number, axis.scene(sensor, value)?)))
        .collect();
    let sweeps: Vec<(u64, Scene, u32)> = scenes
        .into_iter()
        .flat_map(|(number, scene)| (0..trials).map(move |trial| (number, scene, trial)))
        .collect();
    if sweeps.is_empty() {
        return None;
    }
    // Axes and values have sweeps of their own: what is common to all is then no coincidence.
    let axis_number = Axis::ALL.iter().position(|one| *one == axis).map_or(0, |one| one as u64);
    let name = |sensor: u64, trial: u32| {
        u64::from(trial) << 32 | axis_number << 16 | (place as u64) << 8 | sensor
    };
    let one = |&(sensor, scene, trial): &(u64, Scene, u32)| {
        sweep(axis, scene, Stream::new(seed, name(sensor, trial)))
    };
    let outcomes: Vec<_> = sweeps.par_iter().map(one).collect();
    let mut counts = [Counts::default(); Estimator::ALL.len()];
    for (by_estimator, _) in &outcomes {
        for (counts, outcome) in counts.iter_mut().zip(by_estimator) {
            counts.add(*outcome);
        }
    }
    Some(Place { axis, value, counts, told: outcomes.into_iter().map(|(_, told)| told).collect() })
}

/// One sweep, by every estimator.
fn sweep(axis: Axis, scene: Scene, mut chance: Stream) -> ([Outcome; Estimator::ALL.len()], Told) {
    // No place on the grid is favoured.
    let step_hz = (scene.window.max_hz - scene.window.min_hz) / f64::from(scene.points);
    let moved_hz = match axis {
        // The sides of the window's edge are what this axis is about.
        Axis::WindowOffset => 0.0,
        _ => step_hz * (chance.uniform() - 0.5),
    };
    let scene = Scene { resonance_hz: scene.resonance_hz + moved_hz, ..scene };
    let (readings, told) = if axis == Axis::DriveLevelStep {
        with_step(axis, &scene, chance)
    } else {
        let readings = scene.measure(chance);
        let told = production(axis, &scene, &readings);
        (readings, told)
    };
    let allowed_hz = BOUNDS * bound_hz(&scene);
    let outcomes = Estimator::ALL.map(|estimator| match estimator {
        Estimator::MaximumLikelihood => told.outcome,
        baseline => {
            let found_hz = baseline.estimate(&readings, scene.window).ok();
            of_answer(found_hz, &scene, allowed_hz)
        }
    });
    (outcomes, told)
}

/// The fit of the daemon.
fn production(axis: Axis, scene: &Scene, readings: &[Reading]) -> Told {
    let is_apart = scene.is_both_ways.then(|| {
        let (up, down) = readings.split_at(readings.len() / 2);
        are_apart(&verdict(axis, scene, up), &verdict(axis, scene, down))
    });
    let verdict = verdict(axis, scene, readings);
    // What it is told for is the resonance of the moment that it names.
    let moment_s =
        verdict.accepted().and_then(|found| found.moment_s(readings, &options(axis, scene)));
    let scene = moment_s.map_or(*scene, |moment_s| scene.at(moment_s, readings));
    Told { is_apart, ..told(&scene, &verdict) }
}

/// The sensor at its level and at half of it.
fn with_step(axis: Axis, scene: &Scene, mut chance: Stream) -> (Vec<Reading>, Told) {
    let half = Scene { softening: 0.25 * scene.softening, ..*scene };
    let low = half.measure(chance.fork());
    let of_low = verdict(axis, &half, &low);
    let of_high = verdict(axis, scene, &scene.measure(chance));
    let is_apart = are_apart(&of_low, &of_high);
    let verdict = of_low.without_drive(&of_high, 2.0);
    (low, Told { is_apart: Some(is_apart), ..told(scene, &verdict) })
}

fn verdict(axis: Axis, scene: &Scene, readings: &[Reading]) -> Verdict {
    fit(readings, &options(axis, scene))
}

fn options(axis: Axis, scene: &Scene) -> FitOptions {
    FitOptions { window: Some(scene.window), timing: axis.timing(), ..FitOptions::default() }
}

/// Whether two results differ by more than chance; not where one of them is none.
fn are_apart(one: &Verdict, other: &Verdict) -> bool {
    let both = one.accepted().zip(other.accepted());
    both.is_some_and(|(one, other)| one.is_apart_from(other))
}

fn told(scene: &Scene, verdict: &Verdict) -> Told {
    match verdict {
        Verdict::Accepted(found) => {
            let allowed_hz = OWN_SIGMAS * found.sigma_hz;
            let error_hz = scene.truth_hz().map(|truth_hz| (found.resonance_hz - truth_hz).abs());
            Told {
                outcome: of_answer(Some(found.resonance_hz), scene, allowed_hz),
                reason: None,
                rung: Some(found.rung),
                sigmas: error_hz.map(|error_hz| error_hz / found.sigma_hz),
                is_apart: None,
            }
        }
        Verdict::Refused(refusal) => Told {
            outcome: Outcome::Flagged,
            reason: Some(refusal.reason),
            rung: None,
            sigmas: None,
            is_apart: None,
        },
    }
}

fn of_answer(found_hz: Option<f64>, scene: &Scene, allowed_hz: f64) -> Outcome {
    match (found_hz, scene.truth_hz()) {
        (None, _) => Outcome::Flagged,
        (Some(found), Some(truth)) if (found - truth).abs() <= allowed_hz => Outcome::Right,
        (Some(_), _) => Outcome::SilentlyWrong,
    }
}

/// The Cramér–Rao bound of the sweep if nothing were wrong with it.
fn bound_hz(scene: &Scene) -> f64 {
    let information = Information::settled(&scene.circuit(), &scene.points());
    scene.noise * scene.resonance_hz * information.relative_bound()
}
