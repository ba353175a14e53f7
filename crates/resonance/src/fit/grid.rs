//! Trials of resonance and quality over a whole window.
//!
//! With both given, everything else is linear, so that a trial costs one small system. The grid
//! finds the right valley where nothing better is known; what is at its bottom is left to
//! [`Trace::solve_with`](crate::circuit::trace::Trace::solve_with).

use std::f64::consts::TAU;

use num_complex::Complex64;
use rig_model::Window;

use crate::{
    circuit::residual_transient::ResidualTransient,
    circuit::ringup::{Motion, Response, plain},
    circuit::trace::{CIRCUIT, ExtraTerm, ModelEstimate, Past, Sample, Timing, UNKNOWNS},
    numeric::dense::Cholesky,
    numeric::descent::Normal,
};

/// Linear unknowns of a reading: C0, C1, C0·tan δ, and the past motion.
const LINEAR: usize = 5;

/// What is believed of a circuit beforehand. It keeps the first readings from being explained by
/// absurd circuits, and is nothing against a dozen of them.
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
/// C1 in units of C0 where only the size of an error depends on it.
pub(crate) const C1_TYPICAL: f64 = 0.07;

/// Distance of the trial frequencies, relative: at a quality of 150 one linewidth.
pub(crate) const STEP: f64 = 0.007;
/// Most steps over a window: from 4 Hz to 8 MHz, further than any impedance analyzer goes. Beyond it the
/// steps get longer.
const STEPS_MAX: u32 = 2100;
pub(crate) const QUALITIES: [f64; 7] = [6.0, 10.0, 17.0, 30.0, 52.0, 90.0, 150.0];

/// All trials.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    timing: Timing,
    variance: Option<f64>,
    cells: Vec<GridTrial>,
}

/// One trial.
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
    /// Readings that have not settled count for less where the variance of the noise at ten cycles
    /// is given.
    pub(crate) fn new(window: Window, timing: Timing, variance: Option<f64>) -> Self {
        let Window { min_hz, max_hz } = window;
        let steps = ((max_hz / min_hz).ln() / STEP).ceil().clamp(1.0, f64::from(STEPS_MAX));
        let mut cells = Vec::new();
        let mut step = 0.0;
        while step <= steps {
            let resonance_hz = min_hz * (max_hz / min_hz).powf(step / steps);
            cells.extend(QUALITIES.iter().map(|&q| GridTrial::new(resonance_hz, q)));
            step += 1.0;
        }
        Self { timing, variance, cells }
    }

    /// Takes in one more reading.
    pub(crate) fn add(&mut self, sample: &Sample) {
        for cell in &mut self.cells {
            cell.add(sample, self.timing, self.variance);
        }
    }

    /// The drive goes on for some time after the last reading.
    pub(crate) fn rest(&mut self, seconds: f64) {
        if seconds > 0.0 {
            for cell in &mut self.cells {
                cell.motion.rest(seconds, &mut cell.past);
                cell.residual.rest(seconds);
            }
        }
    }

    /// The best circuit of every trial with its cost, the best first, for noise of this variance at
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

    /// The best circuit with this resonance and quality, and its cost.
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
    /// Of any sensor: a resonance anywhere, Q within a factor of e, C0 as the first reading gives it,
    /// and spreads of C1 and of the loss in units of C0.
    pub(crate) fn any(q: f64) -> Self {
        Self {
            mean: [0.0, q.ln(), 1.0, 0.0, 0.0],
            spread: [f64::INFINITY, LN_Q_SPREAD, 1.0, 0.15, 0.03],
        }
    }

    /// With its resonance in this window.
    pub(crate) fn within(mut self, window: Window) -> Self {
        (self.mean[0], self.spread[0]) = logarithms(window);
        self
    }

    /// Adds it to the normal equations, for noise of this variance.
    pub(crate) fn add_to(self, normal: &mut Normal<UNKNOWNS>, at: &ModelEstimate, variance: f64) {
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

/// The middle of a window and half its width, in logarithms; no window is believed more closely than
/// the grid is.
fn logarithms(Window { min_hz, max_hz }: Window) -> (f64, f64) {
    (0.5 * (min_hz * max_hz).ln(), 0.5 * (max_hz / min_hz).ln().max(STEP))
}

/// Whether two resonances are more than `steps` steps of a grid apart.
pub(crate) fn are_apart(a: &ModelEstimate, b: &ModelEstimate, steps: f64) -> bool {
    (a.resonance_hz / b.resonance_hz).ln().abs() > steps * STEP
}
