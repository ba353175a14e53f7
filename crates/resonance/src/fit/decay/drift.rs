//! A resonance that moves during the sweep: the bench drifts, or the tissue relaxes under the probe.
//!
//! ```text
//!   ln f(t) = ln f(m) + d·(φ(t) − φ(m)),   φ(t) = t/S  or  (1 − e^{−t/τ}) / (1 − e^{−S/τ})
//! ```
//!
//! with S the duration of the sweep, which is short against the seconds of a relaxation or long. All
//! shapes are compared by the likelihood that they gain. During a stay the resonance goes on evenly, and moves
//! slowly against its own decay, so that the equations of the stays say everything of d: how the readings
//! depend on the resonance in the middle of the stay, and on its rate there
//! ([`Model::by_motion`](super::model::Model::by_motion)).
//!
//! The result holds at the effective time m, at which it is most certain. If the shape is known, that is
//! where the errors of resonance and d are independent, so that the uncertainty of d adds nothing; if
//! it is not, where the likely shapes nearly agree.

use std::f64::consts::PI;

use rig_model::Window;

use super::{
    Hypothesis, Modelled, Sample, Stays, mode::Modes, search::Search, start::Trials, stay::State,
};
use crate::{
    Extra,
    circuit::trace::{CIRCUIT, ModelEstimate, UNKNOWNS},
    fit::grid::CircuitPrior,
    noise::PooledVariance,
    numeric::dense::Cholesky,
    numeric::descent::Normal,
};

/// Index of the change of the resonance among the unknowns.
const DRIFT: usize = CIRCUIT;
/// Index of the rate of the resonance in the equations of a stay.
const RATE: usize = CIRCUIT;

/// Steepness S/τ of the shapes that are compared at first. That of a steady drift is 0.
const STEEPNESS: [f64; 8] = [0.0, 0.5, 1.0, 2.0, 3.0, 4.5, 7.0, 10.0];
/// A relaxation is slower than the free decay by at least this factor: a reading shows its resonance to first order
/// only.
const SLOW: f64 = 2.0;
/// Further shapes between the likeliest one and both of its neighbours, and how often they are added.
const BETWEEN: u32 = 3;
const REFINEMENTS: usize = 2;
/// Twice the log-likelihood that a relaxation must gain over a steady drift to be preferred.
const BENDS: f64 = 1.0;
/// The gain, without the motion during a stay, from which a drift is looked at more closely.
const GAIN_AT_FIRST: f64 = 5.0;
/// Twice the log-likelihood that a drift must gain. Chance reaches it in one sweep of two hundred,
/// which does no harm.
const GAIN: f64 = 9.0;
/// The same by which it must beat a second mode, which costs as many unknowns.
const LEAD: f64 = 2.0;
/// Smallest number of stays in which a drift is looked for.
const STAYS_MIN: usize = 4;
/// The effective time is chosen among so many parts of the sweep.
const MOMENTS: u32 = 32;
/// The circuit is fitted again at most this many times for the drift found.
const ROUNDS: usize = 4;
/// Twice the log-likelihood, lost by the change of the drift in the last round, that needs no other.
const SAME: f64 = 0.01;

/// How the resonance moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Drift {
    shape: Shape,
    /// The change of the logarithm of the resonance over the sweep.
    change: f64,
    /// The effective time, s after the begin of the first reading.
    at_s: f64,
    /// Standard deviation of the logarithm of the resonance, at the effective time, by the shape and the
    /// change that are not known.
    more_sigma: f64,
    /// What the uncertainty of the change adds to the covariance of the circuit, as its square root.
    by: [f64; CIRCUIT],
}

/// φ(t).
#[derive(Debug, Clone, Copy, PartialEq)]
struct Shape {
    /// Duration of the sweep, s.
    span_s: f64,
    steepness: f64,
}

impl Shape {
    fn is_even(&self) -> bool {
        self.steepness < 1e-6
    }

    fn at(&self, s: f64) -> f64 {
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

    /// The time at which it has this value, within the sweep.
    fn time_of(&self, value: f64) -> f64 {
        let value = value.clamp(0.0, 1.0);
        if self.is_even() {
            return value * self.span_s;
        }
        -self.span_s / self.steepness * (value * (-self.steepness).exp_m1()).ln_1p()
    }
}

impl Drift {
    /// The logarithm of the resonance at this time, s after the begin of the first reading, less that
    /// at the effective time.
    pub(super) fn ln_shift(&self, s: f64) -> f64 {
        self.change * (self.shape.at(s) - self.shape.at(self.at_s))
    }

    /// Change of the logarithm of the resonance per second at this time.
    pub(super) fn ln_rate(&self, s: f64) -> f64 {
        self.change * self.shape.per_s(s)
    }

    /// The effective time, s after the begin of the first reading.
    pub(super) const fn effective_s(&self) -> f64 {
        self.at_s
    }

    /// What the uncertainty of the change adds to the covariance of two unknowns of the circuit. That of the
    /// resonance is in [`Self::more_sigma`].
    pub(super) const fn covariance(&self, i: usize, j: usize) -> f64 {
        if i == 0 || j == 0 { 0.0 } else { self.by[i] * self.by[j] }
    }

    /// What the readings show beside the circuit.
    pub(super) fn extra(&self) -> Extra {
        let Shape { span_s, steepness } = self.shape;
        if self.shape.is_even() {
            // Its change from the middle to the end.
            Extra::Drift { change: 0.5 * self.change }
        } else {
            Extra::Relaxation { change: self.change, time_s: span_s / steepness }
        }
    }
}

/// A drift of one shape, as the equations of the stays give it.
struct Candidate {
    shape: Shape,
    change: f64,
    change_variance: f64,
    /// Covariances with the circuit.
    covariances: [f64; UNKNOWNS],
    /// φ at which the errors of resonance and change are independent.
    independent: f64,
    /// Twice the log-likelihood that it gains over a constant resonance.
    gain: f64,
    /// The logarithm of the resonance at the begin of the first reading, less that of the present
    /// circuit.
    begins: f64,
}

impl Candidate {
    /// The logarithm of the resonance at this time, less that of the present circuit.
    fn at(&self, s: f64) -> f64 {
        self.begins + self.change * self.shape.at(s)
    }
}

/// A stay: the middle of its readings, s after the begin of the first one, its shift and its rate by the
/// present drift, and its equations there with the rate as the unknown after the circuit.
struct Part {
    middle_s: f64,
    ln_shift: f64,
    ln_rate: f64,
    normal: Normal<UNKNOWNS>,
}

impl Stays {
    /// The middle of the readings of each stay, s after the begin of the first reading.
    pub(super) fn middles_s(&self) -> impl Iterator<Item = f64> + '_ {
        let mut begin_s = 0.0;
        self.all.iter().enumerate().map(move |(n, stay)| {
            begin_s += if n == 0 { 0.0 } else { stay.since_s };
            begin_s + stay.middle_s()
        })
    }

    /// Duration of the readings, s.
    fn span_s(&self) -> f64 {
        let begins_s: f64 = self.all.iter().skip(1).map(|stay| stay.since_s).sum();
        begins_s + self.last_stay().map_or(0.0, Sample::end_s)
    }

    fn last_stay(&self) -> Option<&Sample> {
        self.all.last().and_then(|stay| stay.samples.last())
    }

    /// These stays with the drift that they require, and the circuit with it; `None` if that is the present one. A
    /// second mode that describes the readings as well is preferred, because it would make the result wrong.
    pub(crate) fn following(
        &self,
        best: &Hypothesis,
        expected: &CircuitPrior,
        (noise, window): (PooledVariance, Window),
    ) -> Option<(Self, Hypothesis)> {
        if self.drift.is_none() && self.gain_by_drift(best, expected) < GAIN_AT_FIRST {
            return None;
        }
        let (drift, gain) = self.likeliest(&self.parts(best), best, expected)?;
        if self.drift.is_none() && gain < GAIN {
            return None;
        }
        let constant = || {
            let mut stays = self.clone();
            stays.drift = None;
            let found = stays.minimum_while(best.at, Vec::new(), expected, |_, _, _| true)?;
            Some((stays, found))
        };
        if gain < GAIN {
            return constant();
        }
        let (mut stays, mut found, mut next) = (self.clone(), best.clone(), drift);
        for _ in 0..ROUNDS {
            let (drift, ln_moved) = next;
            stays.drift = Some(drift);
            let resonance_hz = found.at.resonance_hz * ln_moved.exp();
            let start = ModelEstimate { resonance_hz, ..found.at };
            let before = found.normal.cost;
            found = stays.minimum_while(start, found.states, expected, |_, _, _| true)?;
            if (before - found.normal.cost).abs() < SAME {
                break;
            }
            next = stays.likeliest(&stays.parts(&found), &found, expected)?.0;
        }
        let trials = &Trials::none();
        let search = Search { stays: &stays, trials, expected, noise };
        if search.is_misfit(&found) {
            return self.drift.and_then(|_| constant());
        }
        if self.drift.is_none() {
            let modes = Modes::new(self, best);
            let by_mode = modes.all(expected, window).map(|mode| mode.gain).fold(0.0, f64::max);
            let gained = best.normal.cost - found.normal.cost;
            let scale = (found.normal.cost / stays.degrees()).max(1.0);
            if gained < GAIN * scale || gained < by_mode + LEAD * scale {
                return None;
            }
        }
        Some((stays, found))
    }

    /// Twice the log-likelihood that a drift gains over a resonance that rests, without the motion during a stay.
    pub(crate) fn gain_by_drift(&self, best: &Hypothesis, expected: &CircuitPrior) -> f64 {
        if self.all.len() < STAYS_MIN {
            return 0.0;
        }
        let found = self.likeliest(&self.parts_at_rest(best), best, expected);
        found.map_or(0.0, |(_, gain)| gain)
    }

    /// The most likely drift beside this circuit, by how much the logarithm of the resonance then differs from that of
    /// the circuit, and twice the log-likelihood that it gains over a constant resonance.
    fn likeliest(
        &self,
        parts: &[Part],
        best: &Hypothesis,
        expected: &CircuitPrior,
    ) -> Option<((Drift, f64), f64)> {
        let span_s = self.span_s();
        let all = candidates(parts, span_s, best, expected);
        let highest = all.iter().max_by(|a, b| a.gain.total_cmp(&b.gain))?;
        let steady = all.first().filter(|steady| steady.shape.is_even());
        let likeliest = steady.filter(|steady| highest.gain < steady.gain + BENDS);
        let likeliest = likeliest.unwrap_or(highest);
        let Candidate { shape, change, change_variance, covariances, independent, gain, .. } =
            *likeliest;
        let by = std::array::from_fn(|i| covariances[i] / change_variance.sqrt());
        let more_variance = |at_s: f64| {
            let (mut sum, mut spread) = (0.0, 0.0);
            for (n, one) in all.iter().enumerate() {
                // Each stands for the shapes around it.
                let neighbour = |n: usize| all.get(n).unwrap_or(one).shape.steepness;
                let width = neighbour(n + 1) - neighbour(n.saturating_sub(1));
                // A single one stands for all.
                let weight = width.max(f64::MIN_POSITIVE) * (0.5 * (one.gain - highest.gain)).exp();
                sum += weight;
                spread += weight * (one.at(at_s) - likeliest.at(at_s)).powi(2);
            }
            let beyond = independent - shape.at(at_s);
            spread / sum + beyond * beyond * change_variance
        };
        let times_s = (0..=MOMENTS).map(|n| f64::from(n) / f64::from(MOMENTS) * span_s);
        let moments = times_s.chain([shape.time_of(independent)]).map(|s| (s, more_variance(s)));
        let (at_s, variance) = moments.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let more_sigma = variance.sqrt();
        Some(((Drift { shape, change, at_s, more_sigma, by }, likeliest.at(at_s)), gain))
    }

    /// The equations of the stays at this circuit.
    fn parts(&self, best: &Hypothesis) -> Vec<Part> {
        let mut states = best.states.clone();
        let all = self.models(&best.at).zip(&mut states).zip(self.middles_s());
        let part = |((of, state), middle_s): ((Modelled<'_>, &mut State), f64)| {
            self.computed(&of, of.model.prior(of.square), state);
            let normal = of.model.normal_with_rate(of.stay, &self.known, state);
            self.part(middle_s, &normal)
        };
        let parts = all.map(part).collect();
        self.work.update(|work| work + self.count() as u64);
        parts
    }

    /// The same without the motion during a stay, which needs no reading again.
    fn parts_at_rest(&self, best: &Hypothesis) -> Vec<Part> {
        let all = self.models(&best.at).zip(&best.states).zip(self.middles_s());
        let part = |((of, state), middle_s): ((Modelled<'_>, &State), f64)| {
            let prior = of.model.prior(of.square);
            let normal = state.moved((&of, prior), &self.known);
            let normal = normal.unwrap_or_else(|| self.computed(&of, prior, &mut state.clone()));
            self.part(middle_s, &normal)
        };
        all.map(part).collect()
    }

    fn part(&self, middle_s: f64, normal: &Normal<UNKNOWNS>) -> Part {
        Part {
            middle_s,
            ln_shift: self.ln_shift(middle_s),
            ln_rate: self.ln_rate(middle_s),
            normal: *normal,
        }
    }

    /// The change of the logarithm of the resonance during the sweep.
    pub(crate) fn change_by_drift(&self) -> f64 {
        self.drift.map_or(0.0, |drift| drift.change)
    }

    /// Standard deviation of the logarithm of the resonance by a drift that is not fully known.
    pub(crate) fn sigma_by_drift(&self) -> f64 {
        self.drift.map_or(0.0, |drift| drift.more_sigma)
    }

    /// The logarithm of the resonance at this time less that at the effective time.
    pub(super) fn ln_shift(&self, s: f64) -> f64 {
        self.drift.map_or(0.0, |drift| drift.ln_shift(s))
    }

    /// Change of the logarithm of the resonance per second at this time.
    pub(super) fn ln_rate(&self, s: f64) -> f64 {
        self.drift.map_or(0.0, |drift| drift.ln_rate(s))
    }
}

/// The drifts of all shapes, in the order of their steepness.
fn candidates(
    parts: &[Part],
    span_s: f64,
    best: &Hypothesis,
    expected: &CircuitPrior,
) -> Vec<Candidate> {
    let decay_s = best.at.q / (PI * best.at.resonance_hz);
    let steepest = span_s / (SLOW * decay_s);
    let of = |steepness: f64| candidate(parts, Shape { span_s, steepness }, best, expected);
    let steepness = STEEPNESS.into_iter().filter(|steepness| *steepness <= steepest);
    let mut all: Vec<Candidate> = steepness.filter_map(of).collect();
    for _ in 0..REFINEMENTS {
        let gain = |n: &usize| all[*n].gain;
        let Some(best) = (0..all.len()).max_by(|a, b| gain(a).total_cmp(&gain(b))) else { break };
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

/// The drift of this shape, to first order around the present circuit and drift; `None` if the stays do not
/// determine one.
fn candidate(
    parts: &[Part],
    shape: Shape,
    best: &Hypothesis,
    expected: &CircuitPrior,
) -> Option<Candidate> {
    let mut sum = Normal::<UNKNOWNS>::default();
    for Part { middle_s, ln_shift, ln_rate, normal } in parts {
        // From the present shift and rate of the stay back to none.
        let mut constant = *normal;
        for (element, row) in constant.gradient.iter_mut().zip(&normal.matrix) {
            *element -= row[0] * ln_shift + row[RATE] * ln_rate;
        }
        let (by, per_s) = (shape.at(*middle_s), shape.per_s(*middle_s));
        let column = normal.matrix.map(|row| by * row[0] + per_s * row[RATE]);
        for (i, element) in column.iter().enumerate().take(CIRCUIT) {
            constant.matrix[i][DRIFT] = *element;
            constant.matrix[DRIFT][i] = *element;
        }
        constant.matrix[DRIFT][DRIFT] = by * column[0] + per_s * column[RATE];
        constant.gradient[DRIFT] = by * constant.gradient[0] + per_s * constant.gradient[RATE];
        sum.sum(&constant);
    }
    expected.add_to(&mut sum, &best.at, 1.0);
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
    Some(Candidate { shape, change, change_variance, covariances, independent, gain, begins })
}
