//! Points that are left to settle, for analyzers whose drive between the points is not known.
//!
//! How long a point must be waited for follows from the circuit, which is not known at first. So
//! nothing waits for the worst: every reading counts for as much as it has settled, and what is
//! believed of the circuit after each one says where the next one tells most in the time it takes,
//! waiting included. The first ones are cheap, and show where to wait; the last ones are waited for
//! as long as the asked uncertainty needs and no longer.

use std::f64::consts::PI;

use num_complex::Complex64;
use rig_model::{Reading, SweepPoint, SweepRequest, Window};

use super::{Prior, elapsed_s, tracker::Tracker};
use crate::{
    NoisePrior, Timing,
    dense::Cholesky,
    grid::Expected,
    leftover::Leftover,
    ringup::Visit,
    scatter::Pool,
    trace::{Believed, CIRCUIT, UNKNOWNS, steady_slopes},
};

/// The plan of one sweep.
#[derive(Debug, Clone)]
pub(super) struct Settled {
    tracker: Tracker,
    opening: std::vec::IntoIter<SweepPoint>,
}

/// Places in the window of the first readings, and how each is taken.
const OPENING: [f64; 4] = [0.0, 0.33, 0.67, 1.0];
const OPENING_SETTLE_S: f64 = 0.02;
const OPENING_CYCLES: u32 = 2;
/// Waits considered, in time constants.
const WAITS: [f64; 9] = [0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
/// Lengths considered, in cycles.
const CYCLES: [u32; 8] = [2, 4, 8, 16, 32, 64, 128, 256];
/// Longest time constant believed, s: a quality of 150 at 140 Hz.
const TIME_CONSTANT_MAX_S: f64 = 0.35;
/// A point takes no longer than this part of the time so far, and some time constants: a plan made
/// from little must not.
const LONGEST_SHARE: f64 = 0.3;
/// What is counted for a point besides its time, s: it has to be ordered and answered.
const POINT_COST_S: f64 = 0.005;

impl Settled {
    pub(super) fn new(request: &SweepRequest, prior: Option<&Prior>, noise: &NoisePrior) -> Self {
        let window = prior.map_or(request.window, |prior| prior.within);
        let expected = prior
            .and_then(|prior| prior.circuit)
            .map_or_else(Expected::default, |circuit| Expected { q: circuit.q });
        let tracker = Tracker::new(window, Timing::Waited, expected, Pool::known(noise));
        let ratio = window.max_hz / window.min_hz;
        let opening: Vec<_> = OPENING
            .iter()
            .map(|part| SweepPoint {
                frequency_hz: (window.min_hz * ratio.powf(*part)).min(window.max_hz),
                settle_s: OPENING_SETTLE_S,
                cycles: OPENING_CYCLES,
            })
            .collect();
        Self { tracker, opening: opening.into_iter() }
    }

    pub(super) fn add(&mut self, readings: &[Reading]) {
        for reading in readings {
            self.tracker.add(reading);
        }
    }

    pub(super) fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    /// The next point, or `None` when the readings so far lead nowhere.
    pub(super) fn next(
        &mut self,
        request: &SweepRequest,
        readings: &[Reading],
        aim_hz: f64,
    ) -> Option<SweepPoint> {
        if let Some(point) = self.opening.next() {
            return Some(point);
        }
        Ground::new(&self.tracker, aim_hz)?.best(request.window, elapsed_s(readings))
    }
}

/// Where a point starts from.
#[derive(Debug)]
struct Ground {
    at: Believed,
    /// Inverse of the normal equations.
    spread: [[f64; UNKNOWNS]; UNKNOWNS],
    leftover: Leftover,
    noise_variance: f64,
    /// Variance of the logarithm of the resonance that is wanted, for noise of variance 1.
    wanted: f64,
    time_constant_s: f64,
}

/// A point considered.
#[derive(Debug, Clone, Copy)]
struct Choice {
    is_enough: bool,
    worth: f64,
    point: SweepPoint,
}

impl Ground {
    fn new(tracker: &Tracker, aim_hz: f64) -> Option<Self> {
        let (trace, at) = tracker.best()?;
        let mut leftover = Leftover::new(at.resonance_hz, at.q);
        for sample in &trace.samples {
            leftover.visit(&sample.visit);
        }
        let noise = tracker.noise();
        let spread = Cholesky::new(&tracker.normal(trace, at).matrix, CIRCUIT, 0.0)?.inverse();
        Some(Self {
            at: *at,
            spread,
            leftover,
            noise_variance: noise * noise,
            wanted: (aim_hz / at.resonance_hz / noise).powi(2),
            time_constant_s: (at.q / (PI * at.resonance_hz)).min(TIME_CONSTANT_MAX_S),
        })
    }

    /// The point that reaches what is wanted soonest; where none does, the one that tells most for
    /// its time.
    fn best(&self, window: Window, elapsed_s: f64) -> Option<SweepPoint> {
        let longest_s = (LONGEST_SHARE * elapsed_s).max(self.time_constant_s);
        let mut best: Option<Choice> = None;
        for frequency_hz in candidates(&self.at, window) {
            let told = self.told(frequency_hz);
            for wait in WAITS {
                let settle_s = wait * self.time_constant_s;
                for cycles in CYCLES {
                    let integration_s = f64::from(cycles) / frequency_hz;
                    if integration_s > longest_s && cycles > CYCLES[0] {
                        break;
                    }
                    let point = SweepPoint { frequency_hz, settle_s, cycles };
                    let after = told.after(self.weight(&point));
                    let time_s = settle_s + integration_s + POINT_COST_S;
                    let is_enough = after <= self.wanted;
                    let gain = if is_enough { 1.0 } else { (self.spread[0][0] / after).ln() };
                    let choice = Choice { is_enough, worth: gain / time_s, point };
                    if best.is_none_or(|best| choice.is_better(&best)) {
                        best = Some(choice);
                    }
                }
            }
        }
        best.map(|choice| choice.point)
    }

    /// What a settled reading tells.
    fn told(&self, frequency_hz: f64) -> Told {
        let slopes = steady_slopes(&self.at, frequency_hz);
        let through = |part: fn(&Complex64) -> f64| -> [f64; CIRCUIT] {
            std::array::from_fn(|i| {
                (0..CIRCUIT).map(|j| self.spread[i][j] * part(&slopes[j])).sum()
            })
        };
        let (re, im) = (through(|x| x.re), through(|x| x.im));
        let dot = |a: &[f64; CIRCUIT], part: fn(&Complex64) -> f64| -> f64 {
            a.iter().zip(&slopes).map(|(a, x)| a * part(x)).sum()
        };
        Told {
            before: self.spread[0][0],
            first: [re[0], im[0]],
            own: [dot(&re, |x| x.re), dot(&re, |x| x.im), dot(&im, |x| x.im)],
        }
    }

    /// For how much a reading will count.
    fn weight(&self, point: &SweepPoint) -> f64 {
        let SweepPoint { frequency_hz, settle_s, cycles } = *point;
        let integration_s = f64::from(cycles) / frequency_hz;
        let visit = Visit { frequency_hz, settle_s, integration_s, rest_s: 0.0 };
        let admittance = self.at.circuit(1.0).admittance_siemens(frequency_hz).norm_sqr();
        let motional = self.at.c1 * self.at.c1 * { self.leftover }.visit(&visit);
        1.0 / (10.0 / f64::from(cycles) + motional / (admittance * self.noise_variance))
    }
}

impl Choice {
    fn is_better(&self, other: &Self) -> bool {
        (self.is_enough, self.worth) > (other.is_enough, other.worth)
    }
}

/// How a reading changes the variance of the first unknown.
#[derive(Debug)]
struct Told {
    /// Without it.
    before: f64,
    /// Covariance of the first unknown with the two parts of the reading.
    first: [f64; 2],
    /// Their own covariance: real, mixed, imaginary.
    own: [f64; 3],
}

impl Told {
    /// The variance after it.
    fn after(&self, weight: f64) -> f64 {
        let noise = 1.0 / weight;
        let [re, mixed, im] = [self.own[0] + noise, self.own[1], self.own[2] + noise];
        let [a, b] = self.first;
        self.before - (a * a * im - 2.0 * a * b * mixed + b * b * re) / (re * im - mixed * mixed)
    }
}

/// Frequencies worth a thought: dense where the circuit changes, and the whole window.
fn candidates(at: &Believed, window: Window) -> impl Iterator<Item = f64> {
    let (centre, half) = (at.resonance_hz, 0.5 * at.resonance_hz / at.q);
    let near = (-16..=16).map(move |i| centre + half * (0.22 * f64::from(i)).sinh());
    let far =
        (0..=8).map(move |i| window.min_hz + (window.max_hz - window.min_hz) * f64::from(i) / 8.0);
    near.chain(far).filter(move |&f| window.contains(f))
}
