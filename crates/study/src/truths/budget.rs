//! Whether the parts of an uncertainty budget are as large as each cause alone makes them.

use rayon::prelude::*;
use rig_analysis::{
    budget::Part,
    model::{MainTouches, ModelSource, RunModel},
    run::{RunStiffness, RunTouches, RunYoung, at_known_angles},
    stiffness::PosedTouch,
};
use rig_contact::ContactLaw;

use super::{
    Args,
    trial::Analysis,
    truth::{Bench, NUISANCES, RunOfTruth, SURFACE_MM, Truth},
};
use crate::{paper_bench::SAMPLES_MPA, simulate::Nuisances};

/// A part of a budget beside what its cause alone makes.
#[derive(Debug, Clone, Copy)]
pub(super) struct PartRuns {
    pub(super) part: &'static str,
    /// What the budget is of, [`OF_OTHER_LAW`] at the end.
    pub(super) of: &'static str,
    /// Root mean square of the part over all results.
    pub(super) predicted_rel: f64,
    /// Root mean square of the change of the logarithm of the stiffness by this cause, when nothing else errs.
    pub(super) found_rel: f64,
}

/// The results of samples whose contact law is another one than that of the analysis.
pub(super) const OF_OTHER_LAW: &str = "touch of a neo-Hookean sample";

/// Sums over results: the squares of the parts, those of the errors, and the number.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    stated: f64,
    found: f64,
    results: usize,
}

impl Sums {
    fn add(&mut self, stated_rel: f64, error: f64) {
        self.stated += stated_rel * stated_rel;
        self.found += error * error;
        self.results += 1;
    }

    fn plus(self, other: Self) -> Self {
        Self {
            stated: self.stated + other.stated,
            found: self.found + other.found,
            results: self.results + other.results,
        }
    }

    fn part(self, part: &'static str, of: &'static str) -> PartRuns {
        let rms = |sum: f64| (sum / self.results as f64).sqrt();
        PartRuns { part, of, predicted_rel: rms(self.stated), found_rel: rms(self.found) }
    }
}

/// Half of the variance of the depth is that of the place: with the surface alone the depth is certain.
const CAUSES: [(&str, &[Part], Nuisances, f64); 4] = [
    (
        "sweep and reference",
        &[Part::Sweep, Part::Reference],
        Nuisances { shift_hz: NUISANCES.shift_hz, ..Nuisances::NONE },
        0.0,
    ),
    ("surface", &[Part::Surface], Nuisances::NONE, SURFACE_MM),
    ("depth", &[Part::Depth], Nuisances { depth_mm: NUISANCES.depth_mm, ..Nuisances::NONE }, 0.0),
    ("angle", &[Part::Angle], Nuisances { angle_deg: NUISANCES.angle_deg, ..Nuisances::NONE }, 0.0),
];

pub(super) fn try_all(args: &Args) -> Vec<PartRuns> {
    validate(args.seed, u64::from(args.runs))
}

/// Simulates this many runs with each cause alone.
pub(super) fn validate(seed: u64, runs: u64) -> Vec<PartRuns> {
    let analysis = Analysis::new();
    // What a cause changes is seen against the same touches without it: the model of the analysis is not
    // the reference.
    let quiet = Truth::with_only(Nuisances::NONE, 0.0).bench();
    let all = |of_run: &(dyn Fn(u64) -> Sums + Sync)| {
        let all: Vec<Sums> = (0..runs).into_par_iter().map(of_run).collect();
        all.into_iter().fold(Sums::default(), Sums::plus)
    };
    let of_causes = |law: ContactLaw, of: &'static str| {
        let bench =
            |nuisances, surface_mm| Truth::with_only(nuisances, surface_mm).of_law(law).bench();
        let quiet = bench(Nuisances::NONE, 0.0);
        CAUSES.map(|(name, parts, nuisances, surface_mm)| {
            let bench = bench(nuisances, surface_mm);
            all(&|run| of_cause(&analysis, [&bench, &quiet], parts, (seed, run))).part(name, of)
        })
    };
    let mut found = of_causes(ContactLaw::Sneddon, "touch").to_vec();
    let described = Truth::with_only(NUISANCES, SURFACE_MM).bench();
    let of_main =
        |source| all(&|run| of_main_touches(&analysis, [&described, &quiet], source, (seed, run)));
    found.push(of_main(ModelSource::Described).part("sensor", "touch"));
    found.push(of_main(ModelSource::Learnt).part("sensor and model", "touch"));
    let points = Nuisances { young_rel: NUISANCES.young_rel, ..Nuisances::NONE };
    let points = Truth::with_only(points, 0.0).bench();
    let of_points = |run| of_samples(&analysis, [&points, &quiet], Some(Part::Sample), (seed, run));
    found.push(all(&of_points).part("sample", "sample"));
    let of_all = |run| of_samples(&analysis, [&described, &quiet], None, (seed, run));
    found.push(all(&of_all).part("all together", "sample"));
    found.extend(of_causes(ContactLaw::NeoHookean, OF_OTHER_LAW));
    found
}

/// The parts and the errors of the blind touches of a run.
fn of_cause(
    analysis: &Analysis,
    [bench, quiet]: [&Bench; 2],
    parts: &[Part],
    (seed, run): (u64, u64),
) -> Sums {
    let RunOfTruth { main, blind, .. } = bench.run(seed, 0, run).at_one_depth();
    let undisturbed = quiet.run(seed, 0, run).blind;
    let known_mpa = [None; SAMPLES_MPA.len()];
    let main = MainTouches {
        touches: &main,
        known_mpa: &known_mpa,
        sample_rel: NUISANCES.young_rel,
        depth_correlation: None,
        reference_hz2: None,
    };
    let model = RunModel::of(analysis.described(), &main, ModelSource::Described);
    let mut sums = Sums::default();
    for (touch, undisturbed) in blind.iter().zip(&undisturbed) {
        let (Ok(found), Ok(without)) = (model.of_touch(touch), model.of_touch(undisturbed)) else {
            continue;
        };
        let stated = parts.iter().map(|part| found.budget.of(*part)).fold(0.0, f64::hypot);
        sums.add(stated, (found.young.mpa / without.young.mpa).ln());
    }
    sums
}

/// The results of these touches with these known samples.
fn results(
    analysis: &Analysis,
    main: &[PosedTouch],
    blind: &[PosedTouch],
    known_mpa: [Option<f64>; SAMPLES_MPA.len()],
    source: ModelSource,
) -> RunStiffness {
    let touches = RunTouches {
        main,
        blind,
        known_mpa: &known_mpa,
        sample_rel: NUISANCES.young_rel,
        depth_correlation: None,
        reference_hz2: None,
        resonance_ratio: 1.0,
        scale_rel: 0.0,
    };
    at_known_angles(analysis.described(), &touches, source).0
}

/// What the errors of the main touches alone make of blind touches, by the factor and by what is learnt.
fn of_main_touches(
    analysis: &Analysis,
    [bench, quiet]: [&Bench; 2],
    source: ModelSource,
    (seed, run): (u64, u64),
) -> Sums {
    let main = bench.run(seed, 0, run).at_one_depth().main;
    let quiet = quiet.run(seed, 0, run).at_one_depth();
    let of = |main: &[PosedTouch]| {
        results(analysis, main, &quiet.blind, SAMPLES_MPA.map(Some), source).blind
    };
    let both = of(&main).into_iter().zip(of(&quiet.main));
    let mut sums = Sums::default();
    for (found, without) in both.filter_map(|(found, without)| Some((found.ok()?, without.ok()?))) {
        let RunYoung { own, budget } = found;
        let stated = budget.of(Part::Sensor).hypot(budget.of(Part::Model));
        sums.add(stated, (own.mpa / without.own.mpa).ln());
    }
    sums
}

/// A part of the budgets of the samples of a run, when none is known, or the whole budgets of known samples.
fn of_samples(
    analysis: &Analysis,
    [bench, quiet]: [&Bench; 2],
    part: Option<Part>,
    (seed, run): (u64, u64),
) -> Sums {
    let known_mpa = SAMPLES_MPA.map(|mpa| part.is_none().then_some(mpa));
    let of = |bench: &Bench| {
        let main = bench.run(seed, 0, run).at_one_depth().main;
        let source = if part.is_none() { ModelSource::Learnt } else { ModelSource::Described };
        results(analysis, &main, &[], known_mpa, source).samples
    };
    let mut sums = Sums::default();
    for (found, without) in of(bench).iter().zip(of(quiet)) {
        let stated = part.map_or_else(|| found.budget.total(), |part| found.budget.of(part));
        sums.add(stated, (found.young_mpa / without.young_mpa).ln());
    }
    sums
}
