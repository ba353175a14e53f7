//! Judgement of a result: right, refused, or silently wrong.

use std::{borrow::Cow, ops::Range, time::Duration};

use rayon::prelude::*;
use rig_engine::{Drift, LevelCheck, Levels};
use rig_model::{Reading, RigTime, SweepMethod, Window, random::Stream};
use rig_resonance::{
    Estimator, FitOptions, FitOutcome, NoisePrior, Planner, Prior, Reason, Refusal, fit,
};
use serde::{Deserialize, Serialize};

use super::{
    axis::{Axis, SENSORS},
    cause::claims_a_cause,
    path::Path,
    scene::Scene,
};
use crate::{
    analyzer::ANY_PHASE_STARTS_S,
    bound::Information,
    planned::{self, request},
};

/// The outcome of a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
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
/// Time limit of a planned sweep, s: that of the shipped protocols.
const LIMIT_S: f64 = 30.0;
/// Duration of the survey before a planned sweep, s: that of the shipped protocol of the experiment, and one after which a sensor of
/// a quality below [`POOR_Q`] reaches its target.
pub(super) const SURVEY_S: u32 = 10;
pub(super) const SURVEY_OF_POOR_S: u32 = 60;
const POOR_Q: f64 = 20.0;
/// The resonance of a planned sweep is shifted at random by at most this much, Hz.
const MOVED_HZ: f64 = 5.0;

/// The outcomes at one point of an axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Counts {
    pub(super) right: u32,
    pub(super) refused: u32,
    pub(super) wrong: u32,
}

impl Counts {
    /// The counts of these outcomes.
    pub(super) fn of(outcomes: impl IntoIterator<Item = Outcome>) -> Self {
        let mut counts = Self::default();
        outcomes.into_iter().for_each(|outcome| counts.add(outcome));
        counts
    }

    pub(super) const fn sweeps(&self) -> u32 {
        self.right + self.refused + self.wrong
    }

    pub(super) fn share(&self, of: u32) -> f64 {
        f64::from(of) / f64::from(self.sweeps().max(1))
    }

    pub(super) const fn plus(self, other: Self) -> Self {
        let (right, refused) = (self.right + other.right, self.refused + other.refused);
        Self { right, refused, wrong: self.wrong + other.wrong }
    }

    fn add(&mut self, outcome: Outcome) {
        match outcome {
            Outcome::Right => self.right += 1,
            Outcome::Refused => self.refused += 1,
            Outcome::SilentlyWrong => self.wrong += 1,
        }
    }
}

/// The number of a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SweepId {
    pub(super) seed: u64,
    /// Index of the sensor in [`SENSORS`].
    pub(super) sensor: usize,
    pub(super) trial: u32,
}

/// The result of one sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SweepResult {
    pub(super) id: SweepId,
    pub(super) outcome: Outcome,
    pub(super) reason: Option<StatedReason>,
    /// The accepted resonance with its standard deviation, Hz.
    pub(super) found: Option<Found>,
    /// The true resonance, Hz.
    pub(super) truth_hz: Option<f64>,
    /// Whether two results differ significantly: up and down, or at two levels.
    pub(super) differ: Option<bool>,
    /// Time of a planned sweep on the rig, s; none if its survey was refused.
    pub(super) time_s: Option<f64>,
}

/// The reason of a refusal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StatedReason {
    /// [`Reason::code`].
    pub(super) code: Cow<'static, str>,
    /// Whether it names the cause of the axis.
    pub(super) is_named: bool,
    /// [`claims_a_cause`].
    pub(super) claims_a_cause: bool,
}

impl StatedReason {
    fn of(reason: &Reason, axis: Axis) -> Self {
        Self {
            code: reason.code().into(),
            is_named: axis.is_named_by(reason),
            claims_a_cause: claims_a_cause(reason),
        }
    }
}

/// An accepted resonance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Found {
    pub(super) resonance_hz: f64,
    pub(super) sigma_hz: f64,
    /// The name of the model order.
    pub(super) model_order: Cow<'static, str>,
    /// Whether a model of this order includes the cause of the axis.
    pub(super) is_modelled: bool,
}

impl SweepResult {
    /// The error of an accepted result in its own standard deviations; infinite without a resonance.
    pub(super) fn sigmas(&self) -> Option<f64> {
        let found = self.found.as_ref()?;
        let error_hz = self.truth_hz.map_or(f64::INFINITY, |hz| (found.resonance_hz - hz).abs());
        Some(error_hz / found.sigma_hz)
    }
}

/// All sweeps on one path at one point of an axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Cell {
    pub(super) axis: Axis,
    pub(super) path: Path,
    pub(super) value: f64,
    pub(super) results: Vec<SweepResult>,
    /// The outcomes of the other estimators for the same sweeps; none for planned ones.
    pub(super) others: Vec<Counts>,
}

impl Cell {
    /// The outcomes of the production path.
    pub(super) fn counts(&self) -> Counts {
        Counts::of(self.results.iter().map(|result| result.outcome))
    }
}

/// The estimators in use elsewhere.
pub(super) fn others() -> impl Iterator<Item = Estimator> {
    Estimator::ALL.into_iter().filter(|one| *one != Estimator::MaximumLikelihood)
}

/// Judges `trials` sweeps of each sensor and seed at one point of an axis; `None` if the axis has no
/// effect on the path, or without a sweep.
pub(super) fn judge(
    (axis, path): (Axis, Path),
    point: usize,
    trials: u32,
    seeds: Range<u64>,
) -> Option<Cell> {
    if !path.has(axis) {
        return None;
    }
    let value = axis.values()[point];
    let scenes = SENSORS.into_iter().map(|sensor| axis.scene(sensor, value)).enumerate();
    let sweeps: Vec<(Scene, SweepId)> = scenes
        .filter_map(|(sensor, scene)| Some((sensor, scene?)))
        .flat_map(|(sensor, scene)| {
            let of_seed =
                move |seed| (0..trials).map(move |trial| (scene, SweepId { seed, sensor, trial }));
            seeds.clone().flat_map(of_seed)
        })
        .collect();
    if sweeps.is_empty() {
        return None;
    }
    let one = |&(scene, id): &(Scene, SweepId)| {
        let random = stream(axis, path, point, id);
        // Trials go in pairs of one sign, which differs between neighbouring seeds.
        let is_positive = (u64::from(id.trial / 2) + id.seed).is_multiple_of(2);
        let scene = if is_positive { scene } else { scene.reversed() };
        match path {
            Path::Fit => fitted(axis, scene, id, random),
            Path::Planner | Path::Unsurveyed => {
                (planned((axis, path), scene, id, random), Vec::new())
            }
        }
    };
    let outcomes: Vec<_> = sweeps.par_iter().map(one).collect();
    let mut counts = vec![Counts::default(); outcomes.first().map_or(0, |one| one.1.len())];
    for (_, others) in &outcomes {
        counts.iter_mut().zip(others).for_each(|(counts, outcome)| counts.add(*outcome));
    }
    let results = outcomes.into_iter().map(|(result, _)| result).collect();
    Some(Cell { axis, path, value, results, others: counts })
}

/// The random numbers of a sweep: each one has its own.
fn stream(axis: Axis, path: Path, point: usize, id: SweepId) -> Stream {
    let axis = axis.file().bytes().fold(0, |name: u64, byte| name.rotate_left(5) ^ u64::from(byte));
    let name = axis << 20 | (path as u64) << 16 | (point as u64) << 8;
    Stream::of_trial(id.seed, name | id.sensor as u64, id.trial.into())
}

/// Judges every estimator on one sweep of points chosen in advance.
fn fitted(
    axis: Axis,
    scene: Scene,
    id: SweepId,
    mut random: Stream,
) -> (SweepResult, Vec<Outcome>) {
    // The resonance is shifted at random within one step of the grid.
    let step_hz = (scene.window.max_hz - scene.window.min_hz) / f64::from(scene.points);
    let scene = moved(axis, scene, 0.5 * step_hz, &mut random);
    let (readings, result) = if axis == Axis::DriveLevelStep {
        with_step(axis, &scene, id, random)
    } else {
        let readings = scene.measure(random);
        let result = production(axis, &scene, id, &readings);
        (readings, result)
    };
    let allowed_hz = BOUNDS * bound_hz(&scene);
    let judge = |estimator: Estimator| {
        let found_hz = estimator.estimate(&readings, scene.window).ok();
        of_answer(found_hz, &scene, allowed_hz)
    };
    (result, others().map(judge).collect())
}

/// The scene with its resonance moved at random by up to this much, Hz.
fn moved(axis: Axis, scene: Scene, most_hz: f64, random: &mut Stream) -> Scene {
    let by_hz = match axis {
        // These axes compare both sides of an edge.
        Axis::WindowOffset | Axis::Contact => 0.0,
        _ => most_hz * (2.0 * random.uniform() - 1.0),
    };
    Scene { resonance_hz: scene.resonance_hz + by_hz, ..scene }
}

/// What is known before the survey: half of the runs know the noise of the analyzer, as after an earlier
/// run, and the others nothing.
fn before_survey(scene: &Scene, trial: u32) -> Prior {
    let known = NoisePrior { at_ten_cycles: scene.noise, degrees_of_freedom: 1000.0 };
    let noise = scene.stated_noise.or(trial.is_multiple_of(2).then_some(known));
    Prior { noise, ..Prior::anywhere(scene.window, None) }
}

/// Judges the planner of the daemon. It measures as the daemon does: with a drive of any phase, gaps of unknown length, and all
/// readings of a stay at once; after a survey of the sensor without a sample, if there is one, or else, where a contact follows,
/// after a sweep without a sample.
fn planned(
    (axis, path): (Axis, Path),
    scene: Scene,
    id: SweepId,
    mut random: Stream,
) -> SweepResult {
    /// Possible drift since the reference, relative, as in the engine.
    const DRIFT: f64 = 0.01;
    let scene = moved(axis, Scene { is_any_phase: true, ..scene }, MOVED_HZ, &mut random);
    // The bench is at rest when it is surveyed.
    let at_rest = Scene { drift_hz: 0.0, relaxation_hz: 0.0, capacitance_drift: 0.0, ..scene };
    let free =
        scene.reference.map_or(at_rest, |(resonance_hz, q)| Scene { q, resonance_hz, ..at_rest });
    let anywhere = before_survey(&free, id.trial);
    let first = match (path, scene.reference) {
        (Path::Unsurveyed, None) => None,
        (Path::Unsurveyed, Some(_)) => Some(SweepMethod::Adaptive),
        (Path::Fit | Path::Planner, _) => {
            let seconds = if free.q < POOR_Q { SURVEY_OF_POOR_S } else { SURVEY_S };
            Some(SweepMethod::Survey { seconds })
        }
    };
    let mut prior = anywhere;
    if let Some(method) = first {
        let is_survey = method != SweepMethod::Adaptive;
        let is_known = |one: &Measured| match &one.verdict {
            FitOutcome::Accepted(found) if !is_survey || one.planner.bench().is_some() => {
                Some(*found)
            }
            _ => None,
        };
        let mut reference = sweep(&free, method, &anywhere, &mut random);
        if is_known(&reference).is_none() {
            // The daemon repeats a refused one once too.
            reference = sweep(&free, method, &anywhere, &mut random);
        }
        let Some(found) = is_known(&reference) else {
            return result(axis, &scene, id, &reference.verdict);
        };
        let bench = reference.planner.bench();
        prior = match scene.reference {
            // A contact hardly lowers the resonance.
            Some((reference_hz, _)) => {
                let within = Window { min_hz: reference_hz * (1.0 - DRIFT), ..scene.window };
                Prior::moved(&found, within, bench)
            }
            None => Prior { bench, ..anywhere },
        };
    }
    let Measured { planner, verdict, time_s } =
        sweep(&scene, SweepMethod::Adaptive, &prior, &mut random);
    // The truth is the resonance at the effective time of the result.
    let effective_time_s = scene.is_moving().then(|| planner.effective_time_s(&verdict)).flatten();
    let at_s = effective_time_s.map_or(0.0, |clock_s| clock_s - ANY_PHASE_STARTS_S);
    let scene = Scene { resonance_hz: scene.resonance_at(at_s), ..scene };
    SweepResult { time_s: Some(time_s), ..result(axis, &scene, id, &verdict) }
}

/// A planned sweep.
struct Measured {
    planner: Planner,
    verdict: FitOutcome,
    time_s: f64,
}

fn sweep(scene: &Scene, method: SweepMethod, prior: &Prior, random: &mut Stream) -> Measured {
    let request = request(scene.window, method, scene.target_hz, LIMIT_S);
    let mut defects = scene.defects(random.fork());
    let mut analyzer = scene.analyzer(random.fork());
    let (verdict, planner) = planned::sweep(&request, prior, |points| {
        let mut readings: Vec<Reading> = points.iter().map(|point| analyzer.visit(point)).collect();
        for reading in &mut readings {
            defects.apply(reading);
        }
        (readings, analyzer.elapsed_s())
    });
    Measured { planner, verdict, time_s: analyzer.elapsed_s() }
}

/// Judges the fit of the daemon.
fn production(axis: Axis, scene: &Scene, id: SweepId, readings: &[Reading]) -> SweepResult {
    let differ = scene.is_both_ways.then(|| {
        let (up, down) = readings.split_at(readings.len() / 2);
        differ(&verdict(axis, scene, up), &verdict(axis, scene, down))
    });
    let verdict = verdict(axis, scene, readings);
    // The truth is the resonance at the effective time of the result.
    let effective_time_s = verdict
        .accepted()
        .and_then(|found| found.effective_time_s(readings, &options(axis, scene)));
    let scene =
        effective_time_s.map_or(*scene, |effective_time_s| scene.at(effective_time_s, readings));
    SweepResult { differ, ..result(axis, &scene, id, &verdict) }
}

/// The daemon's check of the level, and a sweep at the full one behind it. Sweeps at half and at full level follow in turn, a
/// second each, until the check ends.
fn with_step(
    axis: Axis,
    scene: &Scene,
    id: SweepId,
    mut random: Stream,
) -> (Vec<Reading>, SweepResult) {
    let half = Scene { softening: 0.25 * scene.softening, ..*scene };
    let (mut check, drift) = (None::<LevelCheck>, Drift::default());
    let (mut levels, mut refused) = (Levels::Open, None);
    while levels == Levels::Open && refused.is_none() {
        let is_half = check.as_ref().is_some_and(LevelCheck::is_half_next);
        let level = if is_half { &half } else { scene };
        match (verdict(axis, level, &level.measure(random.fork())), &mut check) {
            (FitOutcome::Accepted(found), Some(check)) => {
                let at = RigTime::ZERO + Duration::from_secs(check.sweeps() as u64);
                levels = check.take(&(at, found), &drift);
            }
            (FitOutcome::Accepted(survey), None) => {
                check = Some(LevelCheck::new(None, &(RigTime::ZERO, survey)));
            }
            (outcome @ FitOutcome::Refused(_), _) => refused = Some(outcome),
        }
    }
    let readings = scene.measure(random);
    let is_different = levels == Levels::Differ;
    if is_different {
        let refusal = Refusal { reason: Reason::Nonlinear, estimate: None };
        refused = Some(FitOutcome::Refused(refusal));
    }
    let verdict = refused.unwrap_or_else(|| verdict(axis, scene, &readings));
    (readings, SweepResult { differ: Some(is_different), ..result(axis, scene, id, &verdict) })
}

fn verdict(axis: Axis, scene: &Scene, readings: &[Reading]) -> FitOutcome {
    fit(readings, &options(axis, scene))
}

fn options(axis: Axis, scene: &Scene) -> FitOptions {
    FitOptions {
        window: Some(scene.window),
        timing: axis.timing(),
        noise: scene.stated_noise,
        ..FitOptions::default()
    }
}

/// Whether two results differ by more than chance makes in one of ten thousand; false if one is refused.
fn differ(one: &FitOutcome, other: &FitOutcome) -> bool {
    const APART_SIGMAS: f64 = 4.0;
    one.accepted().zip(other.accepted()).is_some_and(|(one, other)| {
        let apart_hz = (one.resonance_hz - other.resonance_hz).abs();
        apart_hz > APART_SIGMAS * one.sigma_hz.hypot(other.sigma_hz)
    })
}

fn result(axis: Axis, scene: &Scene, id: SweepId, verdict: &FitOutcome) -> SweepResult {
    let truth_hz = scene.truth_hz();
    let refused = SweepResult {
        id,
        outcome: Outcome::Refused,
        reason: None,
        found: None,
        truth_hz,
        differ: None,
        time_s: None,
    };
    match verdict {
        FitOutcome::Accepted(found) => {
            let allowed_hz = OWN_SIGMAS * found.sigma_hz;
            let outcome = of_answer(Some(found.resonance_hz), scene, allowed_hz);
            let found = Found {
                resonance_hz: found.resonance_hz,
                sigma_hz: found.sigma_hz,
                model_order: found.model_order.name().into(),
                is_modelled: axis.is_modelled_by(found.model_order),
            };
            SweepResult { outcome, found: Some(found), ..refused }
        }
        FitOutcome::Refused(refusal) => {
            SweepResult { reason: Some(StatedReason::of(&refusal.reason, axis)), ..refused }
        }
    }
}

fn of_answer(found_hz: Option<f64>, scene: &Scene, allowed_hz: f64) -> Outcome {
    match (found_hz, scene.truth_hz()) {
        (None, _) => Outcome::Refused,
        (Some(found), Some(truth)) if (found - truth).abs() <= allowed_hz => Outcome::Right,
        (Some(_), _) => Outcome::SilentlyWrong,
    }
}

/// The Cramér–Rao bound of the undisturbed sweep, Hz.
fn bound_hz(scene: &Scene) -> f64 {
    let information = Information::settled(&scene.circuit(), &scene.points());
    scene.noise * scene.resonance_hz * information.relative_bound()
}
