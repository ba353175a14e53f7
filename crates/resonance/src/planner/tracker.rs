//! What is believed of the circuit while its ring-up is being read.

use std::f64::consts::TAU;

use rig_model::{Reading, Window};

use crate::{
    Circuit,
    dense::Cholesky,
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
    /// What is known of the noise beforehand, and what the readings tell besides.
    noise: Pool,
    seen: Pool,
}

/// Trials followed to the best circuit near them.
const STARTS: usize = 4;
const START_STEPS: f64 = 1.5;
/// Twice the log-likelihood by which the best circuit must beat every other.
const LEAD: f64 = 30.0;

impl Tracker {
    pub(super) fn new(window: Window, timing: Timing, expected: Expected, noise: Pool) -> Self {
        let grid = Some(Grid::new(window, timing, Some(noise.variance())));
        Self { timing, expected, grid, trace: None, best: None, noise, seen: noise }
    }

    /// Takes in one more reading.
    pub(super) fn add(&mut self, reading: &Reading) {
        let (timing, ohm) = (self.timing, reading.resistance_ohm.hypot(reading.reactance_ohm));
        let unit_farad = 1.0 / (TAU * reading.frequency_hz * ohm);
        let trace = self.trace.get_or_insert_with(|| Trace::new(timing, unit_farad));
        trace.push(reading);
        if let (Some(grid), [earlier @ .., last]) = (&mut self.grid, &trace.samples[..]) {
            grid.rest(earlier.last().map_or(0.0, |previous| previous.visit.rest_s));
            grid.add(last);
        }
        self.follow();
    }

    /// The readings and the circuit that explains them best.
    pub(super) fn best(&self) -> Option<(&Trace, &Believed)> {
        Some((self.trace.as_ref()?, self.best.as_ref()?))
    }

    /// The circuit that explains the readings best.
    pub(super) fn circuit(&self) -> Option<Circuit> {
        self.best().map(|(trace, at)| at.circuit(trace.unit_farad))
    }

    /// The standard deviation of the noise at ten cycles, as far as it is known.
    pub(super) fn noise(&self) -> f64 {
        self.seen.deviation()
    }

    /// The standard deviation of the resonance that the readings so far should give, Hz.
    pub(super) fn sigma_hz(&self) -> f64 {
        let Some((trace, at)) = self.best() else { return f64::INFINITY };
        let free = CIRCUIT + trace.besides().count();
        variance(&self.normal(trace, at), free).sqrt() * at.resonance_hz * self.noise()
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
                if starts.iter().all(|other| grid::are_apart(other, &start, START_STEPS)) {
                    starts.push(start);
                }
            }
        }
        let free = CIRCUIT + trace.besides().count();
        let mut ends: Vec<Valley> = starts
            .into_iter()
            .map(|start| self.valley(trace, start, free))
            .filter(|valley| valley.at.c1 > 0.0 && valley.rank.is_finite())
            .collect();
        ends.sort_by(|a, b| a.rank.total_cmp(&b.rank));
        let Some(&best) = ends.first() else { return };
        let (readings, _) = trace.used();
        let degrees = (2 * readings).saturating_sub(free) as f64;
        let scatter = self.noise.with(best.cost, degrees);
        let has_rival = ends
            .iter()
            .filter(|other| grid::are_apart(&other.at, &best.at, 1.0))
            .any(|other| other.rank - best.rank < LEAD * scatter.variance());
        if !has_rival && degrees >= MIN_DEGREES {
            self.seen = scatter;
            if self.timing != Timing::Waited {
                self.grid = None;
            }
        }
        self.best = Some(best.at);
        if let (Timing::Waited, Some(trace)) = (self.timing, &mut self.trace) {
            trace.weigh_settling(&best.at, self.noise.variance());
        }
    }

    /// The bottom of the valley in which a trial lies.
    fn valley(&self, trace: &Trace, start: Believed, free: usize) -> Valley {
        let variance = self.noise.variance();
        let add = |at: &Believed, normal: &mut Normal<UNKNOWNS>| {
            self.expected.add_to(normal, at, variance);
        };
        let bottom = |trace: &Trace, start| {
            let (at, normal, end) = trace.solve_with(start, free, add);
            let rank = if end == End::OutOfSteps { f64::INFINITY } else { normal.cost };
            Valley { rank, cost: normal.cost, at }
        };
        if self.timing != Timing::Waited {
            return bottom(trace, start);
        }
        // The weights depend on the circuit, and the circuit on the weights: every step on the way
        // may be the best.
        let mut weighed = trace.clone();
        let mut best = Valley { rank: f64::INFINITY, cost: f64::INFINITY, at: start };
        let mut at = start;
        for _ in 0..WEIGHINGS {
            let ln_determinant = weighed.weigh_settling(&at, variance);
            let mut normal = weighed.normal(&at);
            add(&at, &mut normal);
            let rank = normal.cost + variance * ln_determinant;
            if rank < best.rank && at.c1 > 0.0 {
                best = Valley { rank, cost: normal.cost, at };
            }
            at = bottom(&weighed, at).at;
        }
        best
    }
}

/// Rounds of weighing.
const WEIGHINGS: usize = 4;

/// A circuit near which no other explains the readings better.
#[derive(Debug, Clone, Copy)]
struct Valley {
    /// The cost by which it is compared with others.
    rank: f64,
    cost: f64,
    at: Believed,
}

/// Degrees of freedom below which the noise may still hide that the circuit is wrong.
const MIN_DEGREES: f64 = 3.0;

/// Variance of the logarithm of the resonance for noise of variance 1.
pub(super) fn variance(normal: &Normal<UNKNOWNS>, free: usize) -> f64 {
    let mut unit = [0.0; UNKNOWNS];
    unit[0] = 1.0;
    Cholesky::new(&normal.matrix, free, 0.0).map_or(f64::INFINITY, |factor| factor.solve(&unit)[0])
}
