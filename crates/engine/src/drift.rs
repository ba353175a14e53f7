//! How the free resonance drifts, learnt from the references of a run.
//!
//! The resonance is a value that walks at random, and a rate that changes slowly, as in a warm-up. How strong the
//! walk and how large the rate is, differs from bench to bench. So each pair of both has a Kalman filter of its own,
//! and each reference says how probable the pairs are. What is asked of them is their mixture.

use std::time::Duration;

use rig_model::RigTime;

/// Standard deviations of the walk after an hour, Hz, and how probable each is before the first reference. A good
/// laboratory has 0.1; a sensor beside a heater some hertz.
const WALKS: [(f64, f64); 13] = [
    (0.03, 0.08),
    (0.055, 0.11),
    (0.1, 0.13),
    (0.18, 0.13),
    (0.3, 0.13),
    (0.55, 0.11),
    (1.0, 0.09),
    (1.8, 0.07),
    (3.0, 0.05),
    (5.5, 0.04),
    (10.0, 0.03),
    (18.0, 0.02),
    (30.0, 0.01),
];

/// Standard deviations of the rate, Hz in an hour, and how probable each is before the first reference.
const RATES: [(f64, f64); 3] = [(0.5, 0.70), (5.0, 0.25), (50.0, 0.05)];

/// A rate is forgotten in this time, s: an instrument warms up in half an hour.
const RATE_S: f64 = 1800.0;

/// A person who turns the sensor may change its resonance by this, Hz.
const TURNED_HZ: f64 = 0.5;

/// No pair becomes less probable than this, so that a drift that grows is learnt in time.
const LEAST_WEIGHT: f64 = 1e-6;

/// A reference that is less probable than this is a jump, which no drift explains.
const JUMP: f64 = 1e-4;

/// One that is farther off, in the standard deviations that touches state of the drift, is called a jump too. Before much
/// is known, improbable pairs explain it, and are learnt; the touches before it stated too little all the same.
const JUMP_SIGMAS: f64 = 5.0;

const HOUR_S: f64 = 3600.0;

/// One strength of walk and rate, with the resonance as its filter has it.
#[derive(Debug, Clone, Copy)]
struct Pair {
    weight: f64,
    /// The weight before the first reference.
    prior: f64,
    walk_hz2_per_s: f64,
    rate_hz2_per_s2: f64,
    /// The resonance, Hz, and its rate, Hz/s.
    value_hz: f64,
    rate_hz_per_s: f64,
    /// Their covariance: of the value, of both, and of the rate.
    covariance: [f64; 3],
}

impl Pair {
    /// After this time: the rate decays to its mean of zero while it is disturbed again, and the value gathers it.
    fn after(mut self, seconds: f64) -> Self {
        let left = (-seconds / RATE_S).exp();
        let gathered_s = RATE_S * (1.0 - left);
        let [vv, vr, rr] = self.covariance;
        let rate = self.rate_hz2_per_s2;
        let of_rate = seconds.mul_add(2.0 / RATE_S, left.mul_add(4.0, -3.0) - left * left).max(0.0);
        self.value_hz += gathered_s * self.rate_hz_per_s;
        self.rate_hz_per_s *= left;
        self.covariance = [
            vv + 2.0 * gathered_s * vr
                + gathered_s * gathered_s * rr
                + self.walk_hz2_per_s * seconds
                + rate * RATE_S * RATE_S * of_rate,
            left * (vr + gathered_s * rr) + rate * gathered_s * (1.0 - left),
            left * left * rr + rate * (1.0 - left * left),
        ];
        self
    }

    /// Takes in a resonance. Its density under the filter multiplies the weight.
    fn take(&mut self, hz: f64, sigma_hz: f64) {
        let [vv, vr, rr] = self.covariance;
        let variance = vv + sigma_hz * sigma_hz;
        let off_hz = hz - self.value_hz;
        self.weight *= (-0.5 * off_hz * off_hz / variance).exp() / variance.sqrt();
        let (of_value, of_rate) = (vv / variance, vr / variance);
        self.value_hz += of_value * off_hz;
        self.rate_hz_per_s += of_rate * off_hz;
        self.covariance = [vv * (1.0 - of_value), vr * (1.0 - of_value), rr - of_rate * vr];
    }

    /// The value was measured without anything known of it before.
    fn begin(&mut self, hz: f64, sigma_hz: f64) {
        self.value_hz = hz;
        self.covariance[0] = sigma_hz * sigma_hz;
        self.covariance[1] = 0.0;
    }
}

/// A normal distribution with a weight.
#[derive(Debug, Clone, Copy)]
struct Part {
    weight: f64,
    mean_hz: f64,
    sigma_hz: f64,
}

/// A reference that no drift explains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Jump {
    /// How far it is from where the drift lets it be expected, Hz.
    pub(crate) off_hz: f64,
    /// How far it may be in 19 of 20 cases, over 1.96, Hz.
    pub(crate) sigma_hz: f64,
}

/// What the references so far say of the drift.
#[derive(Debug, Clone)]
pub struct Drift {
    pairs: Vec<Pair>,
    /// When the last reference was measured.
    at: Option<RigTime>,
}

impl Default for Drift {
    fn default() -> Self {
        let pair = |(walk_hz, of_walk): (f64, f64), (rate_hz, of_rate): (f64, f64)| {
            let rate_hz2_per_s2 = (rate_hz / HOUR_S).powi(2);
            Pair {
                weight: of_walk * of_rate,
                prior: of_walk * of_rate,
                walk_hz2_per_s: walk_hz * walk_hz / HOUR_S,
                rate_hz2_per_s2,
                value_hz: 0.0,
                rate_hz_per_s: 0.0,
                covariance: [0.0, 0.0, rate_hz2_per_s2],
            }
        };
        let pairs = WALKS.iter().flat_map(|walk| RATES.map(|rate| pair(*walk, rate))).collect();
        Self { pairs, at: None }
    }
}

impl Drift {
    /// A resonance was measured. Returns the jump if it is one: no drift that the ones before allow explains it, or none
    /// that touches state.
    /// What was learnt counts half as much after a jump that no drift explains: another one soon is the drift of a bench
    /// that has changed.
    pub(crate) fn measured(&mut self, at: RigTime, hz: f64, sigma_hz: f64) -> Option<Jump> {
        let since_s = self.at.replace(at).map(|before| at.since(before).as_secs_f64());
        for pair in &mut self.pairs {
            *pair = pair.after(since_s.unwrap_or(0.0));
        }
        let parts = self.values(sigma_hz);
        let is_jump = since_s.is_some() && beyond(&parts, hz) < JUMP;
        let jump = since_s
            .map(|_| jump(&parts, hz))
            .filter(|jump| is_jump || jump.off_hz.abs() > JUMP_SIGMAS * jump.sigma_hz);
        for pair in &mut self.pairs {
            if is_jump || since_s.is_none() {
                pair.begin(hz, sigma_hz);
            } else {
                pair.take(hz, sigma_hz);
            }
        }
        let sum: f64 = self.pairs.iter().map(|pair| pair.weight).sum();
        for pair in &mut self.pairs {
            pair.weight = (pair.weight / sum).max(LEAST_WEIGHT);
            if is_jump {
                pair.weight = 0.5 * (pair.weight + pair.prior);
            }
        }
        jump
    }

    /// A person has turned the sensor.
    pub(crate) fn turned(&mut self) {
        for pair in &mut self.pairs {
            pair.covariance[0] += TURNED_HZ * TURNED_HZ;
        }
    }

    /// How far the resonance moves in this time from now on, Hz: in two of three cases at most. Pairs that are improbable
    /// make nothing of it, so that a run that knows little of its drift yet expects that of a good bench.
    pub(crate) fn moves_hz(&self, seconds: f64) -> f64 {
        width(&self.moves(seconds), 0.0, 0.6827)
    }

    /// Standard deviation of what the resonance has moved since the last reference, Hz: twice of it holds 95 %, so that
    /// improbable pairs count.
    pub(crate) fn moved_sigma_hz(&self, now: RigTime) -> f64 {
        let Some(at) = self.at else { return 0.0 };
        width(&self.moves(now.since(at).as_secs_f64()), 0.0, 0.95) / 1.96
    }

    /// Whether a touch that takes this long needs a reference before it: at its end the drift would have a larger
    /// standard deviation than this, Hz.
    pub(crate) fn asks_for_reference(&self, now: RigTime, touch: Duration, limit_hz: f64) -> bool {
        self.at.is_none() || limit_hz < self.moved_sigma_hz(now + touch)
    }

    fn moves(&self, seconds: f64) -> Vec<Part> {
        let moved = |pair: &Pair| {
            let from = Pair { value_hz: 0.0, covariance: [0.0, 0.0, pair.covariance[2]], ..*pair };
            part(&from.after(seconds), 0.0)
        };
        self.pairs.iter().map(moved).collect()
    }

    /// Whether a difference is none that the walk makes in this time. `sigma_hz` is what the measurements make of it.
    pub(crate) fn is_beyond_walk(&self, off_hz: f64, sigma_hz: f64, seconds: f64) -> bool {
        let of_walk = |pair: &Pair| {
            let sigma_hz = (pair.walk_hz2_per_s * seconds).sqrt().hypot(sigma_hz);
            Part { weight: pair.weight, mean_hz: 0.0, sigma_hz }
        };
        beyond(&self.pairs.iter().map(of_walk).collect::<Vec<Part>>(), off_hz) < JUMP
    }

    fn values(&self, sigma_hz: f64) -> Vec<Part> {
        self.pairs.iter().map(|pair| part(pair, sigma_hz)).collect()
    }
}

/// The value of a pair, measured with this standard deviation.
fn part(pair: &Pair, sigma_hz: f64) -> Part {
    let sigma_hz = pair.covariance[0].max(0.0).sqrt().hypot(sigma_hz);
    Part { weight: pair.weight, mean_hz: pair.value_hz, sigma_hz }
}

/// Half of the interval around a value that holds this part of a mixture.
fn width(parts: &[Part], hz: f64, held: f64) -> f64 {
    let all: f64 = parts.iter().map(|part| part.weight).sum();
    let outside = |half_hz: f64| {
        let of = |part: &Part| {
            let below = (hz - half_hz - part.mean_hz) / part.sigma_hz;
            let above = (part.mean_hz - hz - half_hz) / part.sigma_hz;
            part.weight * (normal(below) + normal(above))
        };
        parts.iter().map(of).sum::<f64>() / all
    };
    let widest = |most: f64, part: &Part| most.max((part.mean_hz - hz).abs() + 4.0 * part.sigma_hz);
    let (mut low, mut high) = (0.0, parts.iter().fold(0.0, widest));
    // To a millionth of the widest part.
    for _ in 0..20 {
        let middle = 0.5 * (low + high);
        *(if outside(middle) > 1.0 - held { &mut low } else { &mut high }) = middle;
    }
    high
}

/// How far a value is from the mean of a mixture.
fn jump(parts: &[Part], hz: f64) -> Jump {
    let all: f64 = parts.iter().map(|part| part.weight).sum();
    let mean_hz = parts.iter().map(|part| part.weight * part.mean_hz).sum::<f64>() / all;
    Jump { off_hz: hz - mean_hz, sigma_hz: width(parts, mean_hz, 0.95) / 1.96 }
}

/// How probable a value of a mixture is that is as far off the mean of its part, or farther.
fn beyond(parts: &[Part], hz: f64) -> f64 {
    let all: f64 = parts.iter().map(|part| part.weight).sum();
    let of = |part: &Part| part.weight * 2.0 * normal(-((hz - part.mean_hz) / part.sigma_hz).abs());
    parts.iter().map(of).sum::<f64>() / all
}

/// The normal distribution, to 1e-7.
///
/// # Source
/// Abramowitz and Stegun, Handbook of Mathematical Functions, 26.2.17.
fn normal(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let sum = [1.330_274_429, -1.821_255_978, 1.781_477_937, -0.356_563_782, 0.319_381_530]
        .iter()
        .fold(0.0, |sum, factor| (sum + factor) * t);
    let above = (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt() * sum;
    if x < 0.0 { above } else { 1.0 - above }
}

#[cfg(test)]
#[path = "drift/tests.rs"]
mod tests;
