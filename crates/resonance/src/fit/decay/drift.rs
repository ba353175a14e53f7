//! A resonance that moves during the sweep: the bench drifts, or the tissue relaxes under the probe.
//!
//! ```text
//!   ln f(t) = ln f(m) + d·(φ(t) − φ(m)),   φ(t) = t/S  or  (1 − e^{−t/τ}) / (1 − e^{−S/τ})
//! ```
//!
//! with S the duration of the sweep, which is short against the seconds of a relaxation or long. All
//! shapes are compared by the likelihood that they gain, to first order in d: the readings of a stay depend on the
//! resonance in its middle, and on how it moves meanwhile ([`Model::by_motion`](super::model::Model::by_motion)).
//!
//! The result holds at the effective time m, at which it is most certain. If the shape is known, that is
//! where the errors of resonance and d are independent, so that the uncertainty of d adds nothing; if
//! it is not, where the likely shapes nearly agree.

pub(super) mod shapes;

use rig_model::Window;

use self::shapes::{Candidate, Shape, Shapes};

use super::{
    Hypothesis, Sample, Stays, mode::Modes, model::Moving, search::Search, start::Trials,
    sums::Column,
};
use crate::{
    Extra,
    circuit::trace::{CIRCUIT, ModelEstimate},
    fit::grid::CircuitPrior,
    noise::PooledVariance,
};

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
const ROUNDS: usize = 6;
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

impl Drift {
    /// The logarithm of the resonance at this time, s after the begin of the first reading, less that
    /// at the effective time.
    pub(super) fn ln_shift(&self, s: f64) -> f64 {
        self.change * (self.shape.at(s) - self.shape.at(self.at_s))
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

    /// Number of unknowns: the change, and the time constant of a relaxation.
    pub(super) fn unknowns(&self) -> usize {
        if self.shape.is_even() { 1 } else { 2 }
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
        let (drift, gain) = Self::likeliest(&self.shapes(best), expected)?;
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
        let trials = &Trials::none();
        let (mut stays, mut found, mut next) = (self.clone(), best.clone(), drift);
        for left in (0..ROUNDS).rev() {
            let (drift, ln_moved) = next;
            stays.drift = Some(drift);
            let resonance_hz = found.at.resonance_hz * ln_moved.exp();
            let start = ModelEstimate { resonance_hz, ..found.at };
            let before = found.normal.cost;
            found = stays.minimum_while(start, found.states, expected, |_, _, _| true)?;
            let saved = before - found.normal.cost;
            // Each round saves less than the one before.
            let at_most = saved.max(0.0) * left as f64;
            let search = Search { stays: &stays, trials, expected, noise };
            if saved.abs() < SAME || search.is_misfit_even_less(&found, at_most) {
                break;
            }
            next = Self::likeliest(&stays.shapes(&found), expected)?.0;
        }
        let search = Search { stays: &stays, trials, expected, noise };
        self.work.set(stays.work.get());
        if !stays.has_slow_drift(&found.at) || search.is_misfit(&found) {
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
        let found = Self::likeliest(&self.shapes_at_rest(best), expected);
        found.map_or(0.0, |(_, gain)| gain)
    }

    /// The most likely drift beside this circuit, by how much the logarithm of the resonance then differs from that of
    /// the circuit, and twice the log-likelihood that it gains over a constant resonance.
    fn likeliest(shapes: &Shapes, expected: &CircuitPrior) -> Option<((Drift, f64), f64)> {
        let span_s = shapes.span_s;
        let all = shapes.candidates(expected);
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

    /// The equations of all shapes at this circuit.
    fn shapes(&self, best: &Hypothesis) -> Shapes {
        let mut states = best.states.clone();
        let mut shapes = Shapes::new(self, best);
        for ((of, state), middle_s) in self.models(&best.at).zip(&mut states).zip(self.middles_s())
        {
            self.computed(&of, of.model.prior(of.square), state);
            let drifts = shapes.all().map(|shape| Column::Drift {
                size: shape.at(middle_s),
                moving: shape.moving(middle_s, of.model.moving.middle_s),
            });
            let drifts: Vec<Column> = drifts.collect();
            shapes.normal.sum(&of.model.normal_with_drifts(of.stay, &self.known, state, &drifts));
        }
        self.work.update(|work| work + self.count() as u64);
        shapes
    }

    /// The same without the motion during a stay, which needs no reading again.
    fn shapes_at_rest(&self, best: &Hypothesis) -> Shapes {
        let mut shapes = Shapes::new(self, best);
        for ((of, state), middle_s) in self.models(&best.at).zip(&best.states).zip(self.middles_s())
        {
            let prior = of.model.prior(of.square);
            let normal = state.moved((&of, prior), &self.known);
            let normal = normal.unwrap_or_else(|| self.computed(&of, prior, &mut state.clone()));
            let sizes: Vec<f64> = shapes.all().map(|shape| shape.at(middle_s)).collect();
            shapes.add_at_rest(&normal, &sizes);
        }
        shapes
    }

    /// Whether a drift, if there is one, is slow enough to differ from the free decay of this circuit.
    pub(super) fn has_slow_drift(&self, at: &ModelEstimate) -> bool {
        self.drift.is_none_or(|drift| drift.shape.is_slow(at))
    }

    /// The change of the logarithm of the resonance during the sweep.
    pub(crate) fn change_by_drift(&self) -> f64 {
        self.drift.map_or(0.0, |drift| drift.change)
    }

    /// Standard deviation of the logarithm of the resonance by a drift that is not fully known.
    pub(crate) fn sigma_by_drift(&self) -> f64 {
        self.drift.map_or(0.0, |drift| drift.more_sigma)
    }

    /// How the resonance moves during a stay whose readings have their middle at this time, and `middle_s` after its
    /// start.
    pub(super) fn moving(&self, s: f64, middle_s: f64) -> Moving {
        let still = Moving { middle_s, ..Moving::STILL };
        self.drift.map_or(still, |drift| {
            let moving = drift.shape.moving(s, middle_s);
            Moving { per_s: drift.change * moving.per_s, ..moving }
        })
    }
}
