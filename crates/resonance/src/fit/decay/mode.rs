//! Tests for a second mode.
//!
//! A small branch near the resonance shifts the result before it is visible in the scatter. The normal
//! equations with its size as an additional unknown give its gain in likelihood and the wider
//! uncertainty of the resonance if it may have any size.

use num_complex::Complex64;
use rig_model::Window;

use super::{Hypothesis, Modelled, Stays, model::Branch, variance};
use crate::{
    Bench,
    circuit::trace::{CIRCUIT, ModelEstimate, UNKNOWNS},
    fit::grid::CircuitPrior,
    numeric::dense::Cholesky,
    numeric::descent::Normal,
};

/// Places of possible second modes, in linewidths from the resonance. A mode between two places shows
/// at both.
pub(crate) const PLACES: usize = 12;
const AT: [f64; PLACES] = [-4.0, -3.0, -2.0, -1.5, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0];
/// Distance, in linewidths, from which a possible mode widens the uncertainty. Excluding a nearer one
/// would double the time of a sweep; it is only detected, by a gain lower by this factor.
const WIDENS_FROM: f64 = 1.0;
const NEARER: f64 = 1.4;
/// Twice the log-likelihood that a second mode must gain to be accepted. Chance reaches it at some
/// place in one sweep of thirty; such a sweep is continued.
const GAIN: f64 = 7.0;
/// The gain that a second mode needs where a survey has found none: chance reaches it in one sweep of two thousand.
const GAIN_AFTER_SURVEY: f64 = 16.0;
/// Number of unknowns of the circuit and a second mode at each place.
pub(crate) const WITH_MODES: usize = CIRCUIT + PLACES;

/// Standard deviation of the capacitance of a second mode, relative to that of the first, at which a
/// relevant mode is detected: a mode of a twentieth then gains twenty-five.
pub(crate) const SIZE_SEEN: f64 = 0.01;

/// A second mode with the quality factor of the first.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SecondMode {
    pub(crate) place: usize,
    pub(crate) resonance_hz: f64,
    /// Twice the log-likelihood that it gains, times `NEARER` if it is near; 0 if its capacitance would
    /// be negative.
    pub(crate) gain: f64,
    /// Its capacitance.
    pub(crate) size: f64,
    /// Variance of the logarithm of the first resonance if the second has any size; 0 if a relevant
    /// size would have been detected, or if it is near.
    pub(crate) variance: f64,
    /// Whether the survey of the bench limits its size.
    pub(crate) is_limited: bool,
}

impl SecondMode {
    /// Whether the readings require it.
    pub(crate) fn is_present(&self) -> bool {
        self.is_present_in(1.0)
    }

    /// Whether readings require it whose noise variance is this many times that of their weights.
    fn is_present_in(&self, noise: f64) -> bool {
        self.gain > noise * if self.is_limited { GAIN_AFTER_SURVEY } else { GAIN }
    }

    /// Whether readings require it that scatter about the circuit by this cost. What they scatter about circuit and
    /// mode together is noise.
    pub(crate) fn is_present_beside(&self, cost: f64, degrees: f64) -> bool {
        self.is_present_in(((cost - self.gain) / degrees).max(1.0))
    }
}

/// The evidence of each stay for a second mode at each place.
#[derive(Debug, Clone)]
pub(crate) struct Modes {
    of_stays: Vec<Normal<WITH_MODES>>,
    /// The modes in the last stay.
    last: [Branch; PLACES],
    at: ModelEstimate,
    bench: Option<Bench>,
}

impl Modes {
    pub(crate) fn new(stays: &Stays, best: &Hypothesis) -> Self {
        let at = best.at;
        let hz = AT.map(|place| at.resonance_hz * (1.0 + place / at.q));
        // The motion before the first stay is unknown, but has decayed before it matters.
        let mut before: Option<(Complex64, [Complex64; PLACES])> = None;
        let mut last =
            [Branch::new(at.resonance_hz, at.q, at.resonance_hz, Complex64::ZERO); PLACES];
        let mut of_stays = Vec::with_capacity(stays.all.len());
        let ends_s = stays.all.iter().skip(1).map(|next| next.since_s).chain([0.0]);
        for ((of, state), end_s) in stays.models(&at).zip(&best.states).zip(ends_s) {
            let Modelled { stay, model, .. } = of;
            let begin = model.motion(&at, state.amplitude(), 0.0);
            // At a change of frequency the drive jumps in phase by the same angle for all modes.
            let turn = before.map_or(Complex64::ZERO, |(end, _)| begin / end);
            let turn = if turn.is_normal() { turn / turn.norm() } else { Complex64::ZERO };
            let ends = before.map_or([Complex64::ZERO; PLACES], |(_, ends)| ends);
            last = std::array::from_fn(|i| {
                Branch::new(hz[i], at.q, stay.frequency_hz, ends[i] * turn)
            });
            of_stays.push(model.normal_with_modes(stay, &stays.known, state, &last));
            let end = model.motion(&at, state.amplitude(), end_s);
            before = Some((end, last.map(|mode| mode.motion(end_s))));
        }
        stays.work.update(|work| work + 4 * stays.count() as u64);
        Self { of_stays, last, at, bench: stays.bench }
    }

    /// Normal equations of the first `stays` stays, with the second mode at this place as the unknown
    /// after the circuit.
    pub(crate) fn normal(&self, place: usize, stays: usize) -> Normal<UNKNOWNS> {
        let mut sum = Normal::<UNKNOWNS>::default();
        if let Some(sigma) = self.known_sigma(place) {
            sum.matrix[CIRCUIT][CIRCUIT] = 1.0 / (sigma * sigma);
        }
        let mode = CIRCUIT + place;
        for normal in self.of_stays.iter().take(stays) {
            let Normal { matrix, gradient, cost } = normal;
            for i in 0..CIRCUIT {
                for (element, more) in sum.matrix[i].iter_mut().zip(&matrix[i][..CIRCUIT]) {
                    *element += more;
                }
                sum.matrix[i][CIRCUIT] += matrix[i][mode];
                sum.matrix[CIRCUIT][i] += matrix[mode][i];
                sum.gradient[i] += gradient[i];
            }
            sum.matrix[CIRCUIT][CIRCUIT] += matrix[mode][mode];
            sum.gradient[CIRCUIT] += gradient[mode];
            sum.cost += cost;
        }
        sum
    }

    /// The mode at this place in the last stay.
    pub(crate) fn last(&self, place: usize) -> Branch {
        self.last[place]
    }

    /// The mode at this place in a stay at this frequency, with this initial motion.
    pub(crate) fn branch(&self, place: usize, frequency_hz: f64, motion: Complex64) -> Branch {
        Branch::new(self.hz(place), self.at.q, frequency_hz, motion)
    }

    /// Standard deviation of the capacitance of a mode at this place, if the bench was surveyed there.
    fn known_sigma(&self, place: usize) -> Option<f64> {
        let bench = self.bench.filter(|bench| bench.surveyed.contains(self.hz(place)))?;
        Some(bench.mode_sigma * self.at.c1)
    }

    fn hz(&self, place: usize) -> f64 {
        self.at.resonance_hz * (1.0 + AT[place] / self.at.q)
    }

    /// The evidence of the readings for a second mode at each place of this window.
    pub(crate) fn all(
        &self,
        expected: &CircuitPrior,
        window: Window,
    ) -> impl Iterator<Item = SecondMode> {
        let is_inside = move |place: &usize| window.contains(self.hz(*place));
        (0..PLACES).filter(is_inside).filter_map(move |place| {
            let mut normal = self.normal(place, self.of_stays.len());
            expected.add_to(&mut normal, &self.at, 1.0);
            let with = Cholesky::new(&normal.matrix, CIRCUIT + 1, 0.0)?;
            let without = with.solve_leading(&normal.gradient, CIRCUIT);
            let solved = with.solve(&normal.gradient);
            let saved = |step: &[f64; UNKNOWNS]| -> f64 {
                step.iter().zip(&normal.gradient).map(|(a, b)| a * b).sum()
            };
            let size = -solved[CIRCUIT];
            let gain = if size > 0.0 { saved(&solved) - saved(&without) } else { 0.0 };
            let is_limited = self.known_sigma(place).is_some();
            let is_nearer = AT[place].abs() < WIDENS_FROM && !is_limited;
            let gain = if is_nearer { NEARER * gain } else { gain };
            let mut unit = [0.0; UNKNOWNS];
            unit[CIRCUIT] = 1.0;
            let size_variance = with.solve(&unit)[CIRCUIT];
            let is_seen = !is_limited && size_variance < (SIZE_SEEN * self.at.c1).powi(2);
            let variance = if is_seen || is_nearer { 0.0 } else { variance(&normal, CIRCUIT + 1) };
            let resonance_hz = self.hz(place);
            Some(SecondMode { place, resonance_hz, gain, size, variance, is_limited })
        })
    }
}
