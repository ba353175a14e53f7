//! Trials of resonance and quality over a whole window.
//!
//! With both given, everything else is linear, so that a trial costs one small system. The grid
//! finds the right valley where nothing better is known; what is at its bottom is left to
//! [`Trace::solve_with`](crate::trace::Trace::solve_with).

use std::f64::consts::TAU;

use num_complex::Complex64;
use rig_model::Window;

use crate::{
    dense::Cholesky,
    leftover::Leftover,
    ringup::{Heard, Motion, plain},
    solve::Normal,
    trace::{Believed, Besides, CIRCUIT, Past, Sample, Timing, UNKNOWNS},
};

/// What a reading depends on linearly: C0, C1, C0·tan δ, and the past motion.
const LINEAR: usize = 5;

/// What is believed of any sensor beforehand. It keeps the first readings from being explained by
/// absurd circuits, and is nothing against a dozen of them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Expected {
    /// The quality, within a factor of e more or less.
    pub(crate) q: f64,
}

impl Default for Expected {
    fn default() -> Self {
        Self { q: 30.0 }
    }
}

/// Spread of ln Q.
const LN_Q_SPREAD: f64 = 1.0;
/// Spreads in units of C0: of itself as the first reading gives it, of C1, of the loss, and of an
/// unknown past motion.
const C0_SPREAD: f64 = 1.0;
const C1_SPREAD: f64 = 0.15;
const LOSS_SPREAD: f64 = 0.03;
const PAST_SPREAD: f64 = 3.0;
/// C1 in units of C0 where only the size of an error depends on it.
const C1_TYPICAL: f64 = 0.07;

/// Distance of the trial frequencies, relative: at a quality of 150 one linewidth.
const STEP: f64 = 0.007;
const QUALITIES: [f64; 7] = [6.0, 10.0, 17.0, 30.0, 52.0, 90.0, 150.0];

/// All trials.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    timing: Timing,
    variance: Option<f64>,
    cells: Vec<Cell>,
}

/// One trial.
#[derive(Debug, Clone)]
struct Cell {
    resonance_hz: f64,
    q: f64,
    motion: Motion<Complex64>,
    past: Complex64,
    leftover: Leftover,
    ln_determinant: f64,
    normal: Normal<LINEAR>,
}

impl Grid {
    /// Readings that have not settled count for less where the variance of the noise at ten cycles
    /// is given.
    pub(crate) fn new(window: Window, timing: Timing, variance: Option<f64>) -> Self {
        let Window { min_hz, max_hz } = window;
        let steps = ((max_hz / min_hz).ln() / STEP).ceil().max(1.0);
        let mut cells = Vec::new();
        let mut step = 0.0;
        while step <= steps {
            let resonance_hz = min_hz * (max_hz / min_hz).powf(step / steps);
            cells.extend(QUALITIES.iter().map(|&q| Cell::new(resonance_hz, q)));
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
                cell.leftover.rest(seconds);
            }
        }
    }

    /// The best circuit of every trial with its cost, the best first, for noise of this variance at
    /// ten cycles.
    pub(crate) fn ranked(&self, expected: Expected, variance: f64) -> Vec<(f64, Believed)> {
        let mut ranked: Vec<_> = self
            .cells
            .iter()
            .filter_map(|cell| cell.best(expected, variance, self.timing))
            .collect();
        ranked.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        ranked
    }
}

impl Cell {
    fn new(resonance_hz: f64, q: f64) -> Self {
        Self {
            resonance_hz,
            q,
            motion: Motion::at_rest(plain(resonance_hz, q)),
            past: Complex64::ONE,
            leftover: Leftover::new(resonance_hz, q),
            ln_determinant: 0.0,
            normal: Normal::default(),
        }
    }

    fn add(&mut self, sample: &Sample, timing: Timing, variance: Option<f64>) {
        let mut weight = sample.weight;
        let omega = TAU * sample.visit.frequency_hz;
        let heard = match timing {
            Timing::Exact(_) => self.motion.visit(&sample.visit, &mut self.past),
            Timing::Waited | Timing::Unknown => {
                let u = sample.visit.frequency_hz / self.resonance_hz;
                let response = 1.0 / Complex64::new(1.0 - u * u, u / self.q);
                let motional = Complex64::new(0.0, omega) * response;
                Heard { motional, past: [Complex64::ZERO; 2] }
            }
        };
        if let (Timing::Waited, Some(variance)) = (timing, variance) {
            let motional = self.leftover.visit(&sample.visit);
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
                z * heard.motional,
                z * omega,
                z * heard.past[0],
                z * heard.past[1],
            ];
            self.normal.add(Complex64::from(-1.0), &row, weight);
        }
    }

    /// The best circuit with this resonance and quality, and its cost.
    fn best(&self, expected: Expected, variance: f64, timing: Timing) -> Option<(f64, Believed)> {
        let mut matrix = self.normal.matrix;
        let mut gradient = self.normal.gradient;
        let spreads = [C0_SPREAD, C1_SPREAD, LOSS_SPREAD, PAST_SPREAD, PAST_SPREAD];
        for (i, spread) in spreads.into_iter().enumerate() {
            matrix[i][i] += variance / (spread * spread);
        }
        gradient[0] -= variance / (C0_SPREAD * C0_SPREAD);
        let besides =
            if timing == Timing::Exact(Past::Unknown) { Besides::Past } else { Besides::Nothing };
        let free = LINEAR - 2 + besides.count();
        let step = Cholesky::new(&matrix, free, 0.0)?.solve(&gradient);
        let saved: f64 = step.iter().zip(gradient).map(|(a, b)| a * b).sum();
        let [c0, c1, g, b1, b2] = step.map(|x| -x);
        let ln_q = (self.q / expected.q).ln() / LN_Q_SPREAD;
        let cost = self.normal.cost - saved + variance * (ln_q * ln_q + self.ln_determinant);
        let (resonance_hz, q) = (self.resonance_hz, self.q);
        let believed = Believed { resonance_hz, q, c0, c1, g, besides, extra: [b1, b2, 0.0] };
        (c1 > 0.0 && c0 > 0.0).then_some((cost, believed))
    }
}

impl Expected {
    /// Adds it to the normal equations, for noise of this variance.
    pub(crate) fn add_to(self, normal: &mut Normal<UNKNOWNS>, at: &Believed, variance: f64) {
        let mut add = |i: usize, away: f64, spread: f64| {
            let precision = variance / (spread * spread);
            normal.matrix[i][i] += precision;
            normal.gradient[i] += precision * away;
            normal.cost += precision * away * away;
        };
        add(1, (at.q / self.q).ln(), LN_Q_SPREAD);
        add(2, at.c0 - 1.0, C0_SPREAD);
        add(3, at.c1, C1_SPREAD);
        add(4, at.g, LOSS_SPREAD);
        if at.besides == Besides::Past {
            add(CIRCUIT, at.extra[0], PAST_SPREAD);
            add(CIRCUIT + 1, at.extra[1], PAST_SPREAD);
        }
    }
}

/// Whether two resonances are more than `steps` steps of a grid apart.
pub(crate) fn are_apart(a: &Believed, b: &Believed, steps: f64) -> bool {
    (a.resonance_hz / b.resonance_hz).ln().abs() > steps * STEP
}
