//! Whether the parts of an uncertainty budget are as large as each cause alone makes them.

use rayon::prelude::*;
use rig_analysis::{
    budget::Part,
    model::{MainTouches, ModelSource, RunModel},
};

use super::{
    Args,
    trial::Analysis,
    truth::{Bench, NUISANCES, RunOfTruth, SURFACE_MM, Truth},
};
use crate::simulate::Nuisances;

/// A part of the budget of the blind touches beside what its cause alone makes.
#[derive(Debug, Clone, Copy)]
pub(super) struct PartRuns {
    pub(super) part: &'static str,
    /// Root mean square of the part over all blind touches.
    pub(super) predicted_rel: f64,
    /// Root mean square of the change of the logarithm of the stiffness by this cause, when nothing else errs.
    pub(super) found_rel: f64,
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
    let of_cause = |(name, parts, nuisances, surface_mm): (_, &[Part], Nuisances, f64)| {
        let bench = Truth::with_only(nuisances, surface_mm).bench();
        let squares = |run: u64| of_run(&analysis, [&bench, &quiet], parts, (seed, run));
        let all: Vec<(f64, f64, usize)> = (0..runs).into_par_iter().map(squares).collect();
        let touches = all.iter().map(|one| one.2).sum::<usize>() as f64;
        let rms =
            |of: fn(&(f64, f64, usize)) -> f64| (all.iter().map(of).sum::<f64>() / touches).sqrt();
        PartRuns { part: name, predicted_rel: rms(|one| one.0), found_rel: rms(|one| one.1) }
    };
    CAUSES.into_iter().map(of_cause).collect()
}

/// The squares of the part and of the errors of the blind touches of a run, and their number.
fn of_run(
    analysis: &Analysis,
    [bench, quiet]: [&Bench; 2],
    parts: &[Part],
    (seed, run): (u64, u64),
) -> (f64, f64, usize) {
    let RunOfTruth { main, blind, .. } = bench.run(seed, 0, run).at_one_depth();
    let undisturbed = quiet.run(seed, 0, run).blind;
    let known_mpa = [None; crate::paper_bench::SAMPLES_MPA.len()];
    let main =
        MainTouches { touches: &main, known_mpa: &known_mpa, sample_rel: NUISANCES.young_rel };
    let model = RunModel::of(analysis.described(), &main, ModelSource::Described);
    let mut sums = (0.0, 0.0, 0);
    for (touch, undisturbed) in blind.iter().zip(&undisturbed) {
        let (Ok(found), Ok(without)) = (model.of_touch(touch), model.of_touch(undisturbed)) else {
            continue;
        };
        sums.0 += parts.iter().map(|part| found.budget.of(*part).powi(2)).sum::<f64>();
        sums.1 += (found.young.mpa / without.young.mpa).ln().powi(2);
        sums.2 += 1;
    }
    sums
}
