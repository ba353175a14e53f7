//! What is believed of the circuit while its ring-up is being read.

use std::f64::consts::TAU;

use rig_model::{Reading, Window};

use crate::{
    grid::{self, Expected, Grid},
    scatter::Pool,
    solve::{End, Normal},
    trace::{Believed, CIRCUIT, Timing, Trace, UNKNOWNS},
};

/// Follows the readings with a grid of trials until one circuit stands out, and with that circuit
/// from then on.
#[derive(Debug, Clone)]
pub(super) struct Tracker {
    timing: Timing,
    expected: Expected,
    /// `None` once one circuit stands out.
    grid: Option<Grid>,
    trace: Option<Trace>,
    best: Option<Believed>,
    noise: Pool,
}

/// Trials followed to the best circuit near them.
const STARTS: usize = 4;
/// Twice the log-likelihood by which the best circuit must beat every other.
const LEAD: f64 = 30.0;

impl Tracker {
    pub(super) fn new(window: Window, timing: Timing, expected: Expected, noise: Pool) -> Self {
        let grid = Some(Grid::new(window, timing));
        Self { timing, expected, grid, trace: None, best: None, noise }
    }

    /// Takes in one more reading.
    pub(super) fn add(&mut self, reading: &Reading) {
        let (timing, ohm) = (self.timing, reading.resistance_ohm.hypot(reading.reactance_ohm));
        let unit_farad = 1.0 / (TAU * reading.frequency_hz * ohm);
        let trace = self.trace.get_or_insert_with(|| Trace::new(timing, unit_farad));
        trace.push(reading);
        if let (Some(grid), Some(sample)) = (&mut self.grid, trace.samples.last()) {
            grid.add(sample);
        }
        self.follow();
    }

    /// The readings and the circuit that explains them best.
    pub(super) fn best(&self) -> Option<(&Trace, &Believed)> {
        Some((self.trace.as_ref()?, self.best.as_ref()?))
    }

    /// The standard deviation of the noise at ten cycles, as far as it is known.
    pub(super) fn noise(&self) -> f64 {
        self.noise.deviation()
    }

    /// The normal equations there, with what is believed beforehand.
    pub(super) fn normal(&self, trace: &Trace, at: &Believed) -> Normal<UNKNOWNS> {
        let mut normal = trace.normal(at);
        self.expected.add_to(&mut normal, at, self.noise.variance());
        normal
    }

    fn follow(&mut self) {
        let Some(trace) = &self.trace else { return };
        let mut starts: Vec<Believed> = self.best.into_iter().collect();
        if let Some(grid) = &self.grid {
            for (_, start) in grid.ranked(self.expected, self.noise.variance()) {
                if starts.len() > STARTS {
                    break;
                }
                if starts.iter().all(|other| grid::are_apart(other, &start, 1.5)) {
                    starts.push(start);
                }
            }
        }
        let free = CIRCUIT + trace.besides().count();
        let variance = self.noise.variance();
        let mut ends: Vec<(f64, Believed)> = starts
            .into_iter()
            .map(|start| {
                let add = |at: &Believed, normal: &mut Normal<UNKNOWNS>| {
                    self.expected.add_to(normal, at, variance);
                };
                let (at, normal, end) = trace.solve_with(start, free, add);
                (if end == End::OutOfSteps { f64::INFINITY } else { normal.cost }, at)
            })
            .filter(|(cost, at)| at.c1 > 0.0 && cost.is_finite())
            .collect();
        ends.sort_by(|a, b| a.0.total_cmp(&b.0));
        let Some(&(cost, best)) = ends.first() else { return };
        self.best = Some(best);
        let count = trace.used().0;
        let degrees = (2 * count).saturating_sub(free) as f64;
        let scatter = self.noise.with(cost, degrees);
        let has_rival = ends
            .iter()
            .filter(|(_, other)| grid::are_apart(other, &best, 1.0))
            .any(|(other, _)| other - cost < LEAD * scatter.variance());
        if !has_rival && degrees >= MIN_DEGREES {
            self.grid = None;
        }
    }
}

/// Degrees of freedom below which the noise may still hide that the circuit is wrong.
const MIN_DEGREES: f64 = 3.0;
