//! A grid search of resonance and quality factor over a window, for unsettled readings.
//!
//! With both given, all other unknowns are linear: capacitances, loss, and the amplitude of the decay
//! of each stay. A trial accumulates one reading after another and costs one small linear system.

use num_complex::Complex64;
use rig_model::Window;

use super::{
    Known, Sample, Stays,
    model::{Amplitude, Integration, Model},
};
use crate::{
    circuit::trace::{ExtraTerm, ModelEstimate},
    fit::grid::{C1_TYPICAL, CircuitPrior, QUALITIES, are_apart, steps},
    numeric::dense::Cholesky,
    numeric::descent::Normal,
};

/// Number of linear unknowns of the circuit: C0, C1 and C0·tan δ.
const LINEAR: usize = 3;

/// All trials of a grid.
#[derive(Debug, Clone)]
pub(crate) struct Trials {
    trials: Vec<Trial>,
}

#[derive(Debug, Clone)]
struct Trial {
    at: ModelEstimate,
    amplitude: Amplitude,
    model: Model,
    integration: Option<Integration>,
    /// Sums of the finished stays.
    done: Normal<LINEAR>,
    /// Sums of the present stay; `with` holds those with the amplitude of its decay.
    now: Normal<LINEAR>,
    with: [Complex64; LINEAR],
    top: Complex64,
    bottom: f64,
    /// `bottom` before the first reading of this stay.
    empty: f64,
    /// The penalty of the finished stays for their amplitudes, as in [`super::stay::State::freedom`].
    freedom: f64,
}

impl Trials {
    /// An empty set of trials.
    pub(crate) const fn none() -> Self {
        Self { trials: Vec::new() }
    }

    /// Adds all readings.
    pub(crate) fn add_all(&mut self, stays: &Stays) {
        for stay in &stays.all {
            for (n, sample) in stay.samples.iter().enumerate() {
                let begins = (n == 0).then_some((stay.frequency_hz, stay.since_s));
                self.add(sample, begins, &stays.known);
            }
        }
    }

    /// Number of trials in a window.
    pub(crate) fn count(window: Window) -> usize {
        (steps(window) as usize + 1) * QUALITIES.len()
    }

    pub(crate) fn new(window: Window) -> Self {
        let Window { min_hz, max_hz } = window;
        let steps = f64::from(steps(window));
        let mut trials = Vec::with_capacity(Self::count(window));
        let mut step = 0.0;
        while step <= steps {
            let resonance_hz = min_hz * (max_hz / min_hz).powf(step / steps);
            trials.extend(QUALITIES.iter().map(|&q| Trial::new(resonance_hz, q)));
            step += 1.0;
        }
        Self { trials }
    }

    /// Adds a reading and, if it starts a stay, the frequency of that stay and the time since the
    /// previous one.
    pub(crate) fn add(&mut self, sample: &Sample, stay: Option<(f64, f64)>, known: &Known) {
        for trial in &mut self.trials {
            if let Some((frequency_hz, since_s)) = stay {
                trial.change(frequency_hz, since_s, known);
            }
            trial.add(sample);
        }
    }

    /// The best trials, without neighbours of a better one.
    pub(crate) fn best(
        &self,
        expected: &CircuitPrior,
        known: &Known,
        most: usize,
    ) -> Vec<ModelEstimate> {
        let mut ranked: Vec<(f64, ModelEstimate)> =
            self.trials.iter().filter_map(|trial| trial.best(expected, known)).collect();
        ranked.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Vec<ModelEstimate> = Vec::new();
        for (_, at) in ranked {
            if best.len() == most {
                break;
            }
            if best.iter().all(|other| are_apart(other, &at, 1.5)) {
                best.push(at);
            }
        }
        best
    }
}

impl Trial {
    fn new(resonance_hz: f64, q: f64) -> Self {
        let extra_term = ExtraTerm::Nothing;
        let at = ModelEstimate {
            resonance_hz,
            q,
            c0: 1.0,
            c1: C1_TYPICAL,
            g: 0.0,
            extra_term,
            extra: [0.0; 3],
        };
        Self {
            at,
            amplitude: Amplitude::new(&at),
            model: Model::new(&at, resonance_hz),
            integration: None,
            done: Normal::default(),
            now: Normal::default(),
            with: [Complex64::ZERO; LINEAR],
            top: Complex64::ZERO,
            bottom: 0.0,
            empty: 0.0,
            freedom: 0.0,
        }
    }

    fn change(&mut self, frequency_hz: f64, since_s: f64, known: &Known) {
        self.freedom = self.freedom();
        self.done = self.sum();
        let square = self.amplitude.change(frequency_hz, since_s);
        self.model = Model::new(&self.at, frequency_hz);
        self.integration = None;
        self.now = Normal::default();
        self.with = [Complex64::ZERO; LINEAR];
        self.top = Complex64::ZERO;
        self.empty = known.variance / self.model.prior(square);
        self.bottom = self.empty;
    }

    fn add(&mut self, sample: &Sample) {
        let Some(z) = sample.impedance else { return };
        let weight = sample.length;
        let Sample { start_s, integration_s, .. } = *sample;
        let e = z * self.model.decayed(start_s, integration_s, &mut self.integration).value;
        let [_, _, c0, c1, g] = self.model.by;
        let columns = [z * c0, z * c1, z * g];
        self.now.add(Complex64::from(-1.0), &columns, weight);
        for (with, column) in self.with.iter_mut().zip(&columns) {
            *with += weight * e.conj() * column;
        }
        self.top -= weight * e.conj();
        self.bottom += weight * e.norm_sqr();
    }

    /// Sums of all readings, with the amplitudes eliminated.
    fn sum(&self) -> Normal<LINEAR> {
        let mut sum = self.done;
        let inverse = if self.bottom > 0.0 { 1.0 / self.bottom } else { 0.0 };
        for i in 0..LINEAR {
            for k in 0..LINEAR {
                let less = (self.with[i].conj() * self.with[k]).re * inverse;
                sum.matrix[i][k] += self.now.matrix[i][k] - less;
            }
            let less = (self.with[i].conj() * self.top).re * inverse;
            sum.gradient[i] += self.now.gradient[i] - less;
        }
        sum.cost += self.now.cost - self.top.norm_sqr() * inverse;
        sum
    }

    fn freedom(&self) -> f64 {
        let here = if self.empty > 0.0 { 2.0 * (self.bottom / self.empty).ln() } else { 0.0 };
        self.freedom + here
    }

    /// The cost, and the most likely linear unknowns for this resonance and quality factor.
    fn best(&self, expected: &CircuitPrior, known: &Known) -> Option<(f64, ModelEstimate)> {
        let mut normal = self.sum();
        for i in 0..LINEAR {
            let (mean, spread) = (expected.mean[i + 2], expected.spread[i + 2]);
            let precision = known.variance / (spread * spread);
            normal.matrix[i][i] += precision;
            normal.gradient[i] -= precision * mean;
            normal.cost += precision * mean * mean;
        }
        let step = Cholesky::new(&normal.matrix, LINEAR, 0.0)?.solve(&normal.gradient);
        let saved: f64 = step.iter().zip(&normal.gradient).map(|(a, b)| a * b).sum();
        let away = |value: f64, i: usize| ((value - expected.mean[i]) / expected.spread[i]).powi(2);
        let beforehand = away(self.at.resonance_hz.ln(), 0) + away(self.at.q.ln(), 1);
        let cost = normal.cost - saved + known.variance * (beforehand + self.freedom());
        let [c0, c1, g] = step.map(|x| -x);
        (c0 > 0.0 && c1 > 0.0).then_some((cost, ModelEstimate { c0, c1, g, ..self.at }))
    }
}
