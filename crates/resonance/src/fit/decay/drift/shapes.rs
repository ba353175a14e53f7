//! Shapes of a drift: how a resonance may move during a sweep, and what the readings say of each.

use std::f64::consts::PI;

use super::{Drift, Hypothesis, Moving, Stays};
use crate::{
    circuit::trace::{CIRCUIT, ModelEstimate, UNKNOWNS},
    fit::grid::CircuitPrior,
    numeric::dense::Cholesky,
    numeric::descent::Normal,
};

/// Index of the change of the resonance among the unknowns.
const DRIFT: usize = CIRCUIT;

/// Number of shapes that are compared at first.
const SHAPES: usize = 8;
/// Their steepness S/τ, which is 0 for a steady drift, and the largest one that is possible.
const STEEPNESS: [f64; SHAPES - 1] = [0.0, 0.5, 1.0, 2.0, 3.0, 4.5, 7.0];
const STEEPNESS_MAX: f64 = 10.0;
/// Number of unknowns of the circuit and a drift of each shape.
pub(in crate::fit::decay) const WITH_SHAPES: usize = CIRCUIT + SHAPES;
/// A relaxation is looked for if it is slower than the free decay by at least this factor. A faster one looks like a free
/// decay.
const SLOW: f64 = 2.0;
/// The decay of the circuit that is found with a relaxation may be longer by the inverse of this factor.
const SLOW_AFTER: f64 = 0.9;
/// The next smaller shape is at most this part of the largest one: the polynomial needs shapes that differ.
const APART: f64 = 0.95;
/// Further shapes between the likeliest one and both of its neighbours, and how often they are added.
const BETWEEN: u32 = 3;
const REFINEMENTS: usize = 2;

/// φ(t).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shape {
    /// Duration of the sweep, s.
    pub(super) span_s: f64,
    /// The duration over the time constant of a relaxation; 0 for a steady drift.
    pub(super) steepness: f64,
}

impl Shape {
    pub(super) fn is_even(&self) -> bool {
        self.steepness < 1e-6
    }

    pub(super) fn at(&self, s: f64) -> f64 {
        let part = s / self.span_s;
        if self.is_even() {
            return part;
        }
        (-self.steepness * part).exp_m1() / (-self.steepness).exp_m1()
    }

    /// dφ/dt, 1/s.
    fn per_s(&self, s: f64) -> f64 {
        if self.is_even() {
            return 1.0 / self.span_s;
        }
        let per_s = -self.steepness / self.span_s;
        per_s * (per_s * s).exp() / (-self.steepness).exp_m1()
    }

    /// How a change of one moves the resonance in a stay whose readings have their middle at this time, and `middle_s`
    /// after its start.
    pub(super) fn moving(&self, s: f64, middle_s: f64) -> Moving {
        let relaxation_per_s = if self.is_even() { 0.0 } else { self.steepness / self.span_s };
        Moving { per_s: self.per_s(s), middle_s, relaxation_per_s }
    }

    /// Whether it is slow enough to differ from the free decay of this circuit.
    pub(super) fn is_slow(&self, at: &ModelEstimate) -> bool {
        self.is_even() || SLOW_AFTER * self.steepness <= steepest(self.span_s, at)
    }

    /// The time at which it has this value, within the sweep.
    pub(super) fn time_of(&self, value: f64) -> f64 {
        let value = value.clamp(0.0, 1.0);
        if self.is_even() {
            return value * self.span_s;
        }
        -self.span_s / self.steepness * (value * (-self.steepness).exp_m1()).ln_1p()
    }
}

/// The steepness of the fastest relaxation that is looked for beside this circuit.
fn steepest(span_s: f64, at: &ModelEstimate) -> f64 {
    let decay_s = at.q / (PI * at.resonance_hz);
    (span_s / (SLOW * decay_s)).min(STEEPNESS_MAX)
}

/// A drift of one shape, as the equations of the stays give it.
pub(super) struct Candidate {
    pub(super) shape: Shape,
    pub(super) change: f64,
    pub(super) change_variance: f64,
    /// Covariances with the circuit.
    pub(super) covariances: [f64; UNKNOWNS],
    /// φ at which the errors of resonance and change are independent.
    pub(super) independent: f64,
    /// Twice the log-likelihood that it gains over a constant resonance.
    pub(super) gain: f64,
    /// The logarithm of the resonance at the begin of the first reading, less that of the present
    /// circuit.
    begins: f64,
}

impl Candidate {
    /// The logarithm of the resonance at this time, less that of the present circuit.
    pub(super) fn at(&self, s: f64) -> f64 {
        self.begins + self.change * self.shape.at(s)
    }
}

/// The equations of the circuit and of the changes by drifts of several shapes, around a circuit and a drift.
pub(super) struct Shapes {
    pub(super) span_s: f64,
    /// Their steepness, rising from 0.
    steepness: Vec<f64>,
    /// The largest one that is possible.
    last: f64,
    pub(super) normal: Normal<WITH_SHAPES>,
    /// The index of the shape of the present drift.
    present: usize,
    /// Its change, and its change until the effective time.
    changes: [f64; 2],
    /// The circuit.
    at: ModelEstimate,
}

impl Shapes {
    pub(super) fn new(stays: &Stays, best: &Hypothesis) -> Self {
        let (span_s, at) = (stays.span_s(), best.at);
        let last = steepest(span_s, &at);
        let bent = (last >= STEEPNESS[1]).then_some(last);
        let mut steepness: Vec<f64> = STEEPNESS
            .into_iter()
            .filter(|steepness| *steepness < APART * last)
            .chain(bent)
            .collect();
        let (mut present, mut changes) = (0, [0.0; 2]);
        if let Some(Drift { shape, change, at_s, .. }) = stays.drift {
            if !shape.is_even() {
                // Its shape takes the place of the nearest relaxation.
                let away = |n: &usize| (steepness[*n] - shape.steepness).abs();
                let nearest = (1..steepness.len()).min_by(|a, b| away(a).total_cmp(&away(b)));
                present = nearest.unwrap_or(steepness.len());
                match nearest {
                    Some(nearest) => steepness[nearest] = shape.steepness,
                    None => steepness.push(shape.steepness),
                }
            }
            changes = [change, change * shape.at(at_s)];
        }
        Self { span_s, steepness, last, normal: Normal::default(), present, changes, at }
    }

    pub(super) fn all(&self) -> impl Iterator<Item = Shape> + use<'_> {
        let shape = |&steepness: &f64| Shape { span_s: self.span_s, steepness };
        self.steepness.iter().map(shape)
    }

    /// Adds a stay with these equations of the circuit, whose resonance is shifted by these parts of the changes.
    pub(super) fn add_at_rest(&mut self, of_stay: &Normal<UNKNOWNS>, sizes: &[f64]) {
        let parts = |i: usize| if i < CIRCUIT { (i, 1.0) } else { (0, sizes[i - CIRCUIT]) };
        let count = CIRCUIT + sizes.len();
        for i in 0..count {
            let (row, size) = parts(i);
            self.normal.gradient[i] += size * of_stay.gradient[row];
            for j in 0..count {
                let (column, by) = parts(j);
                self.normal.matrix[i][j] += size * by * of_stay.matrix[row][column];
            }
        }
    }

    /// The drifts of these shapes and of further ones around the likeliest, in the order of their steepness.
    pub(super) fn candidates(&self, expected: &CircuitPrior) -> Vec<Candidate> {
        // The present drift can be faster than the present circuit allows.
        let of = |steepness: f64| {
            (steepness <= self.last).then(|| self.candidate(steepness, expected)).flatten()
        };
        let mut all: Vec<Candidate> = self.steepness.iter().copied().filter_map(of).collect();
        for _ in 0..REFINEMENTS {
            let gain = |n: &usize| all[*n].gain;
            let best = (0..all.len()).max_by(|a, b| gain(a).total_cmp(&gain(b)));
            let Some(best) = best else { break };
            let around = &all[best.saturating_sub(1)..all.len().min(best + 2)];
            let between = |pair: &[Candidate]| {
                let (from, to) = (pair[0].shape.steepness, pair[1].shape.steepness);
                let step = (to - from) / f64::from(BETWEEN + 1);
                (1..=BETWEEN).map(move |n| from + f64::from(n) * step)
            };
            let more: Vec<Candidate> = around.windows(2).flat_map(between).filter_map(of).collect();
            all.extend(more);
            all.sort_by(|a, b| a.shape.steepness.total_cmp(&b.shape.steepness));
        }
        all
    }

    /// The parts of the columns of the shapes of which that of another one consists, by the polynomial through the four
    /// around it.
    fn parts_of(&self, steepness: f64) -> [f64; SHAPES] {
        let count = self.steepness.len();
        let above = self.steepness.partition_point(|one| *one < steepness);
        let first = above.saturating_sub(2).min(count.saturating_sub(4));
        let around = first..count.min(first + 4);
        let mut parts = [0.0; SHAPES];
        for n in around.clone() {
            let others = around.clone().filter(|other| *other != n);
            let factor = |other: usize| {
                (steepness - self.steepness[other]) / (self.steepness[n] - self.steepness[other])
            };
            parts[n] = others.map(factor).product();
        }
        parts
    }

    /// The drift of this shape, to first order around the present circuit and drift; `None` if the stays do not
    /// determine one.
    fn candidate(&self, steepness: f64, expected: &CircuitPrior) -> Option<Candidate> {
        let Normal { matrix, gradient, .. } = &self.normal;
        let parts = self.parts_of(steepness);
        let of_shape =
            |row: &[f64]| -> f64 { row[CIRCUIT..].iter().zip(&parts).map(|(a, b)| a * b).sum() };
        let columns = matrix.map(|row| of_shape(&row));
        // From the present drift back to none.
        let (present, [change, until]) = (CIRCUIT + self.present, self.changes);
        let constant: [f64; WITH_SHAPES] = std::array::from_fn(|i| {
            gradient[i] - change * matrix[i][present] + until * matrix[i][0]
        });
        let mut sum = Normal::<UNKNOWNS>::default();
        for i in 0..CIRCUIT {
            sum.matrix[i][..CIRCUIT].copy_from_slice(&matrix[i][..CIRCUIT]);
            (sum.matrix[i][DRIFT], sum.matrix[DRIFT][i]) = (columns[i], columns[i]);
            sum.gradient[i] = constant[i];
        }
        sum.matrix[DRIFT][DRIFT] = of_shape(&columns);
        sum.gradient[DRIFT] = of_shape(&constant);
        expected.add_to(&mut sum, &self.at, 1.0);
        let factor = Cholesky::new(&sum.matrix, CIRCUIT + 1, 0.0)?;
        let saved = |step: &[f64; UNKNOWNS]| -> f64 {
            step.iter().zip(&sum.gradient).map(|(a, b)| a * b).sum()
        };
        let step = factor.solve(&sum.gradient);
        let gain = saved(&step) - saved(&factor.solve_leading(&sum.gradient, CIRCUIT));
        let mut unit = [0.0; UNKNOWNS];
        unit[DRIFT] = 1.0;
        let covariances = factor.solve(&unit);
        let change_variance = covariances[DRIFT];
        let independent = -covariances[0] / change_variance;
        let (change, begins) = (-step[DRIFT], -step[0]);
        let shape = Shape { span_s: self.span_s, steepness };
        gain.is_finite().then_some(Candidate {
            shape,
            change,
            change_variance,
            covariances,
            independent,
            gain,
            begins,
        })
    }
}
