//! Where the fit begins, and its first circuit, for which the readings are weighted.

use rig_model::Window;

use crate::{
    FitOptions, Reason,
    circuit::trace::{Minimum, ModelEstimate, Timing, Trace},
    diagnose::doubts::GAIN_MIN,
    diagnose::outliers,
    fit::grid::{CircuitPrior, Grid, Q_TYPICAL, are_apart},
    numeric::descent::End,
};

/// Number of grid minima that are refined.
const STARTS: usize = 4;
/// Noise variance for ranking the trials of a grid; it only affects the weight of the prior.
const GRID_VARIANCE: f64 = 0.005 * 0.005;
/// Number of times that the readings are reweighted with the latest circuit.
const WEIGHINGS: usize = 3;

/// The most likely circuit. If the noise is known, unsettled readings are down-weighted, with their
/// residual motion as an additional error: that of the robust circuit, if some reading is far from it.
/// The most likely circuit of all readings may then be of any quality, and nothing has settled for it.
pub(super) fn weighed(
    mut trace: Trace,
    (start, robust): (ModelEstimate, Option<ModelEstimate>),
    free: usize,
    options: &FitOptions,
) -> (Trace, Minimum) {
    let Some(noise) = options.noise.filter(|_| options.timing == Timing::Waited) else {
        let found = trace.minimum(start, free);
        return (trace, found);
    };
    let variance = noise.at_ten_cycles.powi(2);
    if options.near.is_some() {
        trace.weigh_settling(&start, variance);
        let found = trace.minimum(start, free);
        return (trace, found);
    }
    if let Some(at) = robust {
        let found = Minimum { at, normal: trace.normal(&at), end: End::Converged, free };
        if outliers::count(&trace, &found) > 0 {
            trace.weigh_settling(&at, variance);
            let found = trace.minimum(start, free);
            return (trace, found);
        }
    }
    let mut found = trace.minimum(start, free);
    for _ in 0..WEIGHINGS {
        trace.weigh_settling(&found.at, variance);
        found = trace.minimum(found.at, free);
    }
    (trace, found)
}

/// A start value from a grid over the window and its surroundings.
pub(super) fn from_nothing(
    trace: &Trace,
    window: Window,
    free: usize,
) -> Result<ModelEstimate, Reason> {
    let wider = Window { min_hz: window.min_hz * 0.8, max_hz: window.max_hz * 1.25 };
    let mut grid = Grid::new(wider, trace.timing, None);
    for sample in &trace.samples {
        grid.add(sample);
        grid.rest(sample.visit.rest_s);
    }
    let mut starts: Vec<ModelEstimate> = Vec::new();
    for (_, start) in grid.ranked(CircuitPrior::any(Q_TYPICAL), GRID_VARIANCE) {
        if starts.iter().all(|other| are_apart(other, &start, 2.5)) {
            starts.push(start);
        }
        if starts.len() == STARTS {
            break;
        }
    }
    starts
        .into_iter()
        .map(|start| trace.minimum(start, free))
        .filter(|found| found.at.c1 > 0.0)
        .min_by(|a, b| a.normal.cost.total_cmp(&b.normal.cost))
        .map(|found| found.at)
        .ok_or(Reason::NoResonance { found: 0.0, needed: GAIN_MIN })
}
