//! The estimate of the circuit during its ring-up.

use std::{cell::Cell, f64::consts::TAU};

use rig_model::{Reading, SweepRequest, Window};

use super::prior::Prior;
use crate::{
    Circuit,
    circuit::trace::{CIRCUIT, ModelEstimate, Timing, Trace, UNKNOWNS},
    fit::grid::{self, CircuitPrior, Grid, Q_TYPICAL},
    noise::PooledVariance,
    numeric::dense::Cholesky,
    numeric::descent::{End, Normal},
};

/// Follows the readings with a grid of trials until one circuit stands out, and with that circuit
/// from then on.
#[derive(Debug, Clone)]
pub(super) struct Tracker {
    timing: Timing,
    expected: CircuitPrior,
    /// `None` once one circuit stands out.
    grid: Option<Grid>,
    trace: Option<Trace>,
    best: Option<ModelEstimate>,
    /// Whether a circuit with a clearly different resonance explains the readings nearly as well.
    has_rival: bool,
    /// The prior of the noise, updated by the readings.
    noise: PooledVariance,
    seen: PooledVariance,
    /// Rows computed so far: readings as the model sees them, with their slopes.
    work: u64,
}

/// Rows after which no further valley is followed for one reading: about a millisecond. Sweeps that reach
/// their target hardly ever need more; without a resonance in the window, valleys are long and flat.
pub(super) const WORK_MAX: u64 = 12_000;
/// Rows that a trial of the grid is counted for.
pub(super) const ROWS_PER_TRIAL: u64 = 2;
/// Trials followed to the best circuit near them.
const STARTS: usize = 4;
const START_STEPS: f64 = 1.5;
/// Twice the log-likelihood by which the best circuit must beat every other.
const LEAD: f64 = 30.0;
/// Rounds in which a circuit and the weights made with it are brought to agree, and the part of the way
/// that each goes: all the way, some swing to and fro.
const CONSISTENT_ROUNDS: usize = 12;
const CONSISTENT_PART: f64 = 0.4;
/// By what factor another quality is tried.
const Q_AWAY: f64 = 1.4;
/// Readings that have not settled lead astray until the standard deviation is this part of the
/// linewidth: other circuits are then no longer looked for.
const CERTAIN: f64 = 0.03;
/// A circuit that explains the readings nearly as well does not matter when its resonance is within
/// so many standard deviations.
const RIVAL_SIGMAS: f64 = 3.0;

/// A window of so many linewidths leaves little doubt of the resonance. A ring-up finds its circuit at
/// once, and is led astray by one that is a little wrong.
const NARROW_LINEWIDTHS: f64 = 2.0;
const NARROW_LINEWIDTHS_RINGING: f64 = 0.7;

impl Tracker {
    /// Starts with the window, and with an earlier circuit whose resonance was in or near it, if there
    /// is one.
    pub(super) fn new(
        request: &SweepRequest,
        prior: Option<&Prior>,
        timing: Timing,
        noise: PooledVariance,
    ) -> Self {
        let window = prior.map_or(request.window, |prior| prior.within);
        let circuit = prior.and_then(|prior| prior.circuit);
        let grid = Some(Grid::new(window, timing, Some(noise.variance())));
        let q = circuit.map_or(Q_TYPICAL, |last| last.q);
        let any = CircuitPrior::any(q);
        // Readings that have not settled hardly say where it is.
        let expected = if timing == Timing::Waited { any.within(window) } else { any };
        let (trace, best) = (None, None);
        let tracker = Self {
            timing,
            expected,
            grid,
            trace,
            best,
            has_rival: false,
            noise,
            seen: noise,
            work: 0,
        };
        match circuit {
            Some(circuit) => tracker.near(circuit, window),
            None => tracker,
        }
    }

    /// Begins with a circuit where the window is so narrow that it is nearly the same.
    fn near(self, circuit: Circuit, window: Window) -> Self {
        let Window { min_hz, max_hz } = window;
        let linewidths = (max_hz - min_hz) / circuit.linewidth_hz();
        let narrow = match self.timing {
            Timing::Exact(_) => NARROW_LINEWIDTHS_RINGING,
            Timing::Waited | Timing::Unknown | Timing::AnyPhase => NARROW_LINEWIDTHS,
        };
        if linewidths > narrow || min_hz > max_hz {
            return self;
        }
        let resonance_hz = circuit.resonance_hz.clamp(min_hz, max_hz);
        let trace = Trace::new(self.timing, circuit.c0_farad);
        let circuit = Circuit { resonance_hz, ..circuit };
        let best = ModelEstimate {
            extra_term: trace.extra_term(),
            ..ModelEstimate::of(&circuit, trace.unit_farad)
        };
        let expected = CircuitPrior::nearly(&circuit, window);
        Self { expected, trace: Some(trace), best: Some(best), ..self }
    }

    /// Takes in one more reading.
    pub(super) fn add(&mut self, reading: &Reading) {
        let timing = self.timing;
        let trace = match (&mut self.trace, reading.impedance()) {
            (Some(trace), _) => trace,
            (empty, Some(impedance)) => {
                let unit_farad = 1.0 / (TAU * reading.frequency_hz * impedance.magnitude_ohm());
                empty.insert(Trace::new(timing, unit_farad))
            }
            // Nothing tells how large impedances are.
            (None, None) => return,
        };
        trace.push(reading);
        if let (Some(grid), [earlier @ .., last]) = (&mut self.grid, &trace.samples[..]) {
            grid.rest(earlier.last().map_or(0.0, |previous| previous.visit.rest_s));
            grid.add(last);
            self.work += ROWS_PER_TRIAL * grid.trials() as u64;
        }
        self.follow();
    }

    /// The readings and the circuit that explains them best.
    pub(super) fn best(&self) -> Option<(&Trace, &ModelEstimate)> {
        Some((self.trace.as_ref()?, self.best.as_ref()?))
    }

    /// The circuit that explains the readings best.
    pub(super) fn circuit(&mut self) -> Option<Circuit> {
        let work = Cell::new(0);
        let consistent = self.consistent(&work);
        self.work += work.get();
        let (trace, _) = self.best()?;
        Some(consistent?.circuit(trace.unit_farad))
    }

    /// Rows computed so far.
    pub(super) fn work(&self) -> u64 {
        self.work
    }

    /// The circuit that explains the readings best when they count for as much as they have settled
    /// if it is the circuit, and nothing that was believed beforehand counts.
    fn consistent(&self, work: &Cell<u64>) -> Option<ModelEstimate> {
        let (trace, &best) = self.best()?;
        if self.timing != Timing::Waited {
            return Some(best);
        }
        let mut trace = trace.clone();
        let mut at = best;
        let rows = trace.samples.len() as u64;
        for _ in 0..CONSISTENT_ROUNDS {
            if work.get() >= WORK_MAX {
                break;
            }
            trace.weigh_settling(&at, self.noise.variance());
            let count =
                |_: &ModelEstimate, _: &mut Normal<UNKNOWNS>| work.update(|done| done + rows);
            let (minimum, ..) = trace.solve_with(at, CIRCUIT, count);
            at = at.towards(&minimum, CONSISTENT_PART);
        }
        Some(at)
    }

    /// The standard deviation of the noise at ten cycles, as far as it is known.
    pub(super) fn noise(&self) -> f64 {
        self.seen.deviation()
    }

    /// Whether a circuit with a clearly different resonance explains the readings nearly as well.
    pub(super) fn has_rival(&self) -> bool {
        self.has_rival
    }

    /// The standard deviation of the resonance that the readings so far should give, Hz.
    pub(super) fn sigma_hz(&self) -> f64 {
        let Some((trace, at)) = self.best() else { return f64::INFINITY };
        let free = CIRCUIT + trace.extra_term().count();
        variance(&trace.normal(at), free).sqrt() * at.resonance_hz * self.noise()
    }

    /// The normal equations there, with what is believed beforehand.
    pub(super) fn normal(&self, trace: &Trace, at: &ModelEstimate) -> Normal<UNKNOWNS> {
        let mut normal = trace.normal(at);
        self.expected.add_to(&mut normal, at, self.noise.variance());
        normal
    }

    fn follow(&mut self) {
        let Some(trace) = &self.trace else { return };
        let mut starts: Vec<ModelEstimate> = self.best.into_iter().collect();
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
        if let (Timing::Waited, Some(best)) = (self.timing, self.best) {
            // The weights pull towards the quality that they were made with.
            starts
                .extend([Q_AWAY, 1.0 / Q_AWAY].map(|by| ModelEstimate { q: best.q * by, ..best }));
        }
        let free = CIRCUIT + trace.extra_term().count();
        let work = Cell::new(0);
        let mut ends: Vec<LocalMinimum> = starts
            .into_iter()
            .map_while(|start| {
                (work.get() < WORK_MAX).then(|| self.valley(trace, start, free, &work))
            })
            .filter(|valley| valley.at.c1 > 0.0 && valley.rank.is_finite())
            .collect();
        self.work += work.get();
        let is_cut = work.get() >= WORK_MAX;
        ends.sort_by(|a, b| a.rank.total_cmp(&b.rank));
        let Some(&best) = ends.first() else { return };
        let (readings, _) = trace.used();
        let degrees = (2 * readings).saturating_sub(free) as f64;
        let scatter = self.noise.with(best.cost, degrees);
        let is_near = |other: &LocalMinimum| other.rank - best.rank < LEAD * scatter.variance();
        let is_alone = !is_cut
            && !ends.iter().filter(|other| grid::are_apart(&other.at, &best.at, 1.0)).any(is_near);
        if is_alone && degrees >= MIN_DEGREES {
            self.seen = scatter;
        }
        self.best = Some(best.at);
        if let (Timing::Waited, Some(trace)) = (self.timing, &mut self.trace) {
            trace.weigh_settling(&best.at, self.noise.variance());
        }
        let sigma_hz = self.sigma_hz();
        let sure_hz = RIVAL_SIGMAS * sigma_hz;
        self.has_rival = ends.iter().any(|other| {
            is_near(other) && (other.at.resonance_hz - best.at.resonance_hz).abs() > sure_hz
        });
        let is_certain = is_alone && degrees >= MIN_DEGREES;
        let linewidth_hz = best.at.resonance_hz / best.at.q;
        if is_certain && (self.timing != Timing::Waited || sigma_hz < CERTAIN * linewidth_hz) {
            self.grid = None;
        }
    }

    /// The bottom of the valley in which a trial lies.
    fn valley(
        &self,
        trace: &Trace,
        start: ModelEstimate,
        free: usize,
        work: &Cell<u64>,
    ) -> LocalMinimum {
        let variance = self.noise.variance();
        let add = |at: &ModelEstimate, normal: &mut Normal<UNKNOWNS>| {
            work.update(|rows| rows + trace.samples.len() as u64);
            self.expected.add_to(normal, at, variance);
        };
        let bottom = |trace: &Trace, start| {
            let (at, normal, end) = trace.solve_with(start, free, add);
            let rank = if end == End::OutOfSteps { f64::INFINITY } else { normal.cost };
            LocalMinimum { rank, cost: normal.cost, at }
        };
        if self.timing != Timing::Waited {
            return bottom(trace, start);
        }
        // The weights depend on the circuit, and the circuit on the weights: the best circuit with the
        // weights of another may be worse with its own.
        let mut weighed = trace.clone();
        let mut weigh = |at: ModelEstimate| {
            let ln_determinant = weighed.weigh_settling(&at, variance);
            let mut normal = weighed.normal(&at);
            add(&at, &mut normal);
            let valley = LocalMinimum {
                rank: normal.cost + variance * ln_determinant,
                cost: normal.cost,
                at,
            };
            (valley, bottom(&weighed, at).at)
        };
        let (mut best, mut goal) = weigh(start);
        let mut part = 1.0;
        for _ in 0..WEIGHINGS {
            if work.get() >= WORK_MAX {
                break;
            }
            let (next, beyond) = weigh(best.at.towards(&goal, part));
            if next.rank < best.rank && next.at.c1 > 0.0 {
                (best, goal, part) = (next, beyond, 1.0);
            } else {
                part *= BACK;
            }
        }
        best
    }
}

/// Rounds of weighing.
const WEIGHINGS: usize = 5;
/// Factor for a step that leads too far.
const BACK: f64 = 0.4;

/// A circuit near which no other explains the readings better.
#[derive(Debug, Clone, Copy)]
struct LocalMinimum {
    /// The cost by which it is compared with others.
    rank: f64,
    cost: f64,
    at: ModelEstimate,
}

/// Degrees of freedom below which the noise may still hide that the circuit is wrong.
const MIN_DEGREES: f64 = 3.0;

/// Variance of the logarithm of the resonance for noise of variance 1.
pub(super) fn variance(normal: &Normal<UNKNOWNS>, free: usize) -> f64 {
    let mut unit = [0.0; UNKNOWNS];
    unit[0] = 1.0;
    Cholesky::new(&normal.matrix, free, 0.0).map_or(f64::INFINITY, |factor| factor.solve(&unit)[0])
}
