//! A grid search of resonance and quality factor over a window.
//!
//! With both given, all other unknowns are linear, so that a trial costs one small linear system. The
//! grid finds the right minimum if there is no better start value;
//! [`Trace::solve_with`](crate::circuit::trace::Trace::solve_with) then refines it.

use std::f64::consts::TAU;

use num_complex::Complex64;
use rig_model::Window;

use crate::{
    circuit::residual_transient::ResidualTransient,
    circuit::ringup::{Motion, Response, plain},
    circuit::trace::{CIRCUIT, ExtraTerm, ModelEstimate, Past, Sample, Timing},
    numeric::dense::Cholesky,
    numeric::descent::Normal,
};

/// Linear unknowns of a reading: C0, C1, C0·tan δ, and the past motion.
const LINEAR: usize = 5;

/// The prior of a circuit. It excludes absurd circuits while there are few readings, and is negligible
/// against a dozen of them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CircuitPrior {
    /// (ln resonance, ln Q, C0, C1, C0·tan δ), capacitances in the unit of the readings.
    pub(crate) mean: [f64; CIRCUIT],
    pub(crate) spread: [f64; CIRCUIT],
}

pub(crate) const Q_TYPICAL: f64 = 30.0;
const LN_Q_SPREAD: f64 = 1.0;
/// Spread of an unknown past motion in units of C0.
const PAST_SPREAD: f64 = 3.0;
/// Typical C1 in units of C0, used if only the size of an error depends on it.
pub(crate) const C1_TYPICAL: f64 = 0.07;

/// Relative spacing of the trial frequencies: one linewidth at a quality factor of 150.
const STEP: f64 = 0.007;
/// Largest number of steps over a window: from 4 Hz to 8 MHz, more than the range of any impedance
/// analyzer. For wider windows the steps get longer.
const STEPS_MAX: u32 = 2100;
pub(crate) const QUALITIES: [f64; 7] = [6.0, 10.0, 17.0, 30.0, 52.0, 90.0, 150.0];

/// Number of steps of a grid over a window.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "it is from one to `STEPS_MAX`"
)]
pub(crate) fn steps(window: Window) -> u32 {
    let Window { min_hz, max_hz } = window;
    ((max_hz / min_hz).ln() / STEP).ceil().clamp(1.0, f64::from(STEPS_MAX)) as u32
}

/// All trials of a grid.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    timing: Timing,
    variance: Option<f64>,
    cells: Vec<GridTrial>,
}

/// One trial resonance and quality factor.
#[derive(Debug, Clone)]
struct GridTrial {
    resonance_hz: f64,
    q: f64,
    motion: Motion<Complex64>,
    past: Complex64,
    residual: ResidualTransient,
    ln_determinant: f64,
    normal: Normal<LINEAR>,
}

impl Grid {
    /// Creates a grid. Unsettled readings are down-weighted if the noise variance at ten cycles is
    /// given.
    pub(crate) fn new(window: Window, timing: Timing, variance: Option<f64>) -> Self {
        let Window { min_hz, max_hz } = window;
        let steps = f64::from(steps(window));
        let mut cells = Vec::new();
        let mut step = 0.0;
        while step <= steps {
            let resonance_hz = min_hz * (max_hz / min_hz).powf(step / steps);
            cells.extend(QUALITIES.iter().map(|&q| GridTrial::new(resonance_hz, q)));
            step += 1.0;
        }
        Self { timing, variance, cells }
    }

    /// Adds a reading.
    pub(crate) fn add(&mut self, sample: &Sample) {
        for cell in &mut self.cells {
            cell.add(sample, self.timing, self.variance);
        }
    }

    /// Continues the drive for some time after the last reading, s.
    pub(crate) fn rest(&mut self, seconds: f64) {
        if seconds > 0.0 {
            for cell in &mut self.cells {
                cell.motion.rest(seconds, &mut cell.past);
                cell.residual.rest(seconds);
            }
        }
    }

    /// The best circuit of every trial with its cost, sorted from the best, for this noise variance at
    /// ten cycles.
    pub(crate) fn ranked(
        &self,
        expected: CircuitPrior,
        variance: f64,
    ) -> Vec<(f64, ModelEstimate)> {
        let mut ranked: Vec<_> = self
            .cells
            .iter()
            .filter_map(|cell| cell.best(expected, variance, self.timing))
            .collect();
        ranked.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        ranked
    }
}

impl GridTrial {
    fn new(resonance_hz: f64, q: f64) -> Self {
        Self {
            resonance_hz,
            q,
            motion: Motion::at_rest(plain(resonance_hz, q)),
            past: Complex64::ONE,
            residual: ResidualTransient::new(resonance_hz, q),
            ln_determinant: 0.0,
            normal: Normal::default(),
        }
    }

    fn add(&mut self, sample: &Sample, timing: Timing, variance: Option<f64>) {
        let mut weight = sample.weight;
        let omega = TAU * sample.visit.frequency_hz;
        let response = match timing {
            Timing::Exact(_) => self.motion.visit(&sample.visit, &mut self.past),
            Timing::Waited | Timing::Unknown | Timing::AnyPhase => {
                let u = sample.visit.frequency_hz / self.resonance_hz;
                let response = 1.0 / Complex64::new(1.0 - u * u, u / self.q);
                let motional = Complex64::new(0.0, omega) * response;
                Response { motional, past: [Complex64::ZERO; 2] }
            }
        };
        if let (Timing::Waited, Some(variance)) = (timing, variance) {
            let motional = self.residual.visit(&sample.visit);
            if weight > 0.0 {
                let relative = C1_TYPICAL * C1_TYPICAL * motional * sample.impedance.norm_sqr();
                weight = 1.0 / (1.0 / sample.length + relative / variance);
                self.ln_determinant -= 2.0 * weight.ln();
            }
        }
        if weight > 0.0 {
            let z = sample.impedance;
            let row = [
                z * Complex64::new(0.0, omega),
                z * response.motional,
                z * omega,
                z * response.past[0],
                z * response.past[1],
            ];
            self.normal.add(Complex64::from(-1.0), &row, weight);
        }
    }

    /// The best circuit with this resonance and quality factor, and its cost.
    fn best(
        &self,
        expected: CircuitPrior,
        variance: f64,
        timing: Timing,
    ) -> Option<(f64, ModelEstimate)> {
        let mut matrix = self.normal.matrix;
        let mut gradient = self.normal.gradient;
        let [ln_resonance, ln_q, c0, c1, loss] = expected.spread;
        let [_, _, mean @ ..] = expected.mean;
        for (i, spread) in [c0, c1, loss, PAST_SPREAD, PAST_SPREAD].into_iter().enumerate() {
            let precision = variance / (spread * spread);
            matrix[i][i] += precision;
            gradient[i] -= precision * mean.get(i).copied().unwrap_or(0.0);
        }
        let extra_term = if timing == Timing::Exact(Past::Unknown) {
            ExtraTerm::Past
        } else {
            ExtraTerm::Nothing
        };
        let free = LINEAR - 2 + extra_term.count();
        let step = Cholesky::new(&matrix, free, 0.0)?.solve(&gradient);
        let saved: f64 = step.iter().zip(gradient).map(|(a, b)| a * b).sum();
        let [c0, c1, g, b1, b2] = step.map(|x| -x);
        let ln_resonance = (self.resonance_hz.ln() - expected.mean[0]) / ln_resonance;
        let ln_q = (self.q.ln() - expected.mean[1]) / ln_q;
        let cost = self.normal.cost - saved
            + variance * (ln_resonance * ln_resonance + ln_q * ln_q + self.ln_determinant);
        let (resonance_hz, q) = (self.resonance_hz, self.q);
        let estimate =
            ModelEstimate { resonance_hz, q, c0, c1, g, extra_term, extra: [b1, b2, 0.0] };
        (c1 > 0.0 && c0 > 0.0).then_some((cost, estimate))
    }
}

impl CircuitPrior {
    /// The prior of any sensor: any resonance, Q within a factor of e, C0 from the unit of capacitance, and
    /// spreads of C1 and of the loss in that unit.
    pub(crate) fn any(q: f64) -> Self {
        Self {
            mean: [0.0, q.ln(), 1.0, 0.0, 0.0],
            spread: [f64::INFINITY, LN_Q_SPREAD, 1.0, 0.15, 0.03],
        }
    }

    /// Restricts the resonance to this window.
    pub(crate) fn within(mut self, window: Window) -> Self {
        (self.mean[0], self.spread[0]) = logarithms(window);
        self
    }

    /// Adds the prior to the normal equations, for this noise variance.
    pub(crate) fn add_to<const N: usize>(
        self,
        normal: &mut Normal<N>,
        at: &ModelEstimate,
        variance: f64,
    ) {
        let mut add = |i: usize, away: f64, spread: f64| {
            let precision = variance / (spread * spread);
            normal.matrix[i][i] += precision;
            normal.gradient[i] += precision * away;
            normal.cost += precision * away * away;
        };
        let values = [at.resonance_hz.ln(), at.q.ln(), at.c0, at.c1, at.g];
        for (i, value) in values.into_iter().enumerate() {
            add(i, value - self.mean[i], self.spread[i]);
        }
        if at.extra_term == ExtraTerm::Past {
            add(CIRCUIT, at.extra[0], PAST_SPREAD);
            add(CIRCUIT + 1, at.extra[1], PAST_SPREAD);
        }
    }
}

/// The middle and half the width of a window, in logarithms; the half-width is at least one grid step.
fn logarithms(Window { min_hz, max_hz }: Window) -> (f64, f64) {
    (0.5 * (min_hz * max_hz).ln(), 0.5 * (max_hz / min_hz).ln().max(STEP))
}

/// Whether two resonances are more than `steps` steps of a grid apart.
pub(crate) fn are_apart(a: &ModelEstimate, b: &ModelEstimate, steps: f64) -> bool {
    (a.resonance_hz / b.resonance_hz).ln().abs() > steps * STEP
}
