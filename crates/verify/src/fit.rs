//! The resonance of a sweep, fitted again: the Butterworth–Van Dyke circuit with dielectric loss, and
//! the free decay after each change of frequency.
//!
//! ```text
//!   Y(t) = jωC0(1 − j tan δ) + jωC1/D(ω) + a·E(t),   D = 1 − u² + ju/Q,  u = f/f_s
//!   E(t) = mean of e^{(s − jω)t} over the reading,   s = 2πf_s(−1/2Q + j√(1 − 1/4Q²))
//! ```
//!
//! The amplitude a of each stay at one frequency has a random phase and a size that the circuit
//! predicts. The time from one reading of a stay to the next has an error of half a millisecond. The
//! free decay that turns against the drive, E at the conjugate of s, adds to the variance. Unknowns are
//! found by the method of Levenberg and Marquardt.

mod beside;
mod motion;
#[cfg(test)]
mod tests;
mod trace;

use std::f64::consts::TAU;

use num_complex::Complex64;

pub(crate) use self::trace::measured;
use self::{
    beside::{Beside, Course},
    trace::{BESIDE, CIRCUIT, Trace, Unknowns, stays},
};
use crate::{
    normal::Normal,
    record::{Circuit, Extra, FitNoise, FitSettings, Flag, Reading},
};

/// Relative noise of a reading of ten cycles where nothing is known of it, and the number of readings
/// that this is worth beside a free decay. Settled readings tell it alone.
const NOISE: FitNoise = FitNoise { at_ten_cycles: 0.005, degrees_of_freedom: 4.0 };
const NOISE_OF_SETTLED: FitNoise = FitNoise { degrees_of_freedom: 0.0, ..NOISE };
/// Smallest relative variance of a reading: the ninth digit.
const VARIANCE_MIN: f64 = 1e-16;
/// Number of times that the sizes of the free decays and the weights are computed again.
const ROUNDS: usize = 4;

/// The result of a fit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fitted {
    pub(crate) resonance_hz: f64,
    pub(crate) circuit: Circuit,
    /// Standard deviations of its values, each relative but that of the loss tangent.
    pub(crate) circuit_sigma: Circuit,
    /// By how much a moving resonance changes during the sweep, Hz.
    pub(crate) moved_hz: f64,
    /// The largest difference of what is beside the circuit from its statement, in standard deviations.
    pub(crate) beside_sigmas: f64,
    /// Standard deviation of the resonance by the noise alone, Hz.
    pub(crate) sigma_hz: f64,
    /// The same, if there may be a second mode of any size; only with a free decay.
    pub(crate) with_mode_hz: f64,
    /// Standard deviation of the capacitance of a second mode, relative to the first, the largest of all
    /// places; only with a free decay.
    pub(crate) mode_sigma: f64,
    /// Sum of squares over its degrees of freedom, against the noise that was known before.
    pub(crate) scatter: f64,
    /// The degrees of freedom.
    pub(crate) degrees: f64,
    /// The time for which the resonance holds, s on the clock of the readings; only with a free decay.
    pub(crate) effective_time_s: Option<f64>,
}

/// Whether a reading has a value that can be used.
pub(crate) fn is_usable(reading: &Reading) -> bool {
    let numbers = [reading.resistance_ohm, reading.reactance_ohm];
    let is_finite = numbers.iter().all(|x| x.is_some_and(f64::is_finite));
    reading.flag == Flag::Normal && is_finite && has_place(reading)
}

/// Whether a reading has a place in its stay. Without a value it still says when the others began: one that was recorded
/// late is known by the next.
pub(crate) fn has_place(reading: &Reading) -> bool {
    reading.frequency_hz * reading.integration_s > 0.0 && reading.begin_s().is_finite()
}

/// A reading of which only the place is left.
pub(crate) const fn without_value(reading: Reading) -> Reading {
    Reading { resistance_ohm: None, reactance_ohm: None, ..reading }
}

/// What is known of the motion of the sensor during the readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Motion {
    /// It has settled.
    Settled,
    /// It rings after each change of frequency. The first gap of every stay is longer than recorded by
    /// this much.
    Ringing { first_gap_s: f64 },
}

impl Motion {
    /// Ringing with the times as recorded.
    #[cfg(test)]
    pub(crate) const RINGING: Self = Self::Ringing { first_gap_s: 0.0 };

    /// The motion during a sweep that was fitted with these settings.
    pub(crate) fn of(settings: &FitSettings) -> Self {
        let first_gap_s = settings.bench.map_or(0.0, |bench| bench.first_gap_s);
        if settings.is_ringing() { Self::Ringing { first_gap_s } } else { Self::Settled }
    }
}

/// A stated resonance and its circuit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stated<'a> {
    pub(crate) resonance_hz: f64,
    pub(crate) circuit: &'a Circuit,
    /// What is beside the circuit.
    pub(crate) extra: Option<&'a Extra>,
    /// The time for which the resonance holds, s on the clock of the readings.
    pub(crate) effective_time_s: Option<f64>,
}

impl<'a> Stated<'a> {
    /// A circuit with nothing beside it.
    pub(crate) const fn alone(resonance_hz: f64, circuit: &'a Circuit) -> Self {
        Self { resonance_hz, circuit, extra: None, effective_time_s: None }
    }

    /// What a fit of readings from `begin_s` and for `span_s` has beside the circuit, with its unknowns in units of `unit`.
    fn beside(
        &self,
        (begin_s, span_s): (f64, f64),
        is_ringing: bool,
        unit: f64,
    ) -> Option<(Beside, [f64; BESIDE])> {
        let extra = self.extra?;
        if !is_ringing {
            return Beside::of(extra, self.circuit, unit);
        }
        let stated_s = self.effective_time_s.map_or(0.5 * span_s, |time_s| time_s - begin_s);
        Beside::of_ringing(extra, Course { span_s, time_s: f64::INFINITY, stated_s })
    }
}

/// The capacitance that would have this impedance, F.
fn capacitance_f(reading: &Reading) -> f64 {
    1.0 / (TAU * reading.frequency_hz * measured(reading).norm())
}

/// The median of these capacitances: a free decay can make any impedance large, and with a small unit the expected loss
/// would be small too.
fn unit_f(usable: &[Reading]) -> f64 {
    let mut all: Vec<f64> = usable.iter().map(capacitance_f).collect();
    all.sort_by(f64::total_cmp);
    all[all.len() / 2]
}

/// Fits the usable ones of these readings, which all have a place, from the neighbourhood of a statement; `None` if that does
/// not converge.
pub(crate) fn fit(
    readings: &[Reading],
    motion: Motion,
    noise: Option<FitNoise>,
    stated: Stated<'_>,
) -> Option<Fitted> {
    let first = readings.first()?;
    let usable: Vec<Reading> = readings.iter().filter(|one| is_usable(one)).copied().collect();
    let first_usable = usable.first()?;
    let (is_ringing, first_gap_s) = match motion {
        Motion::Settled => (false, 0.0),
        Motion::Ringing { first_gap_s } => (true, first_gap_s),
    };
    let is_noise_unknown = noise.is_none() && !is_ringing;
    let noise = noise.unwrap_or(if is_ringing { NOISE } else { NOISE_OF_SETTLED });
    let unit = if is_ringing { unit_f(&usable) } else { capacitance_f(first_usable) };
    let stays = stays(readings, unit, first_gap_s);
    let mut trace = Trace { stays, is_ringing, first_gap_s, beside: None };
    let beside = stated.beside((first.begin_s(), trace.span_s()), is_ringing, unit);
    let (beside, stated_beside) =
        beside.map_or((None, [0.0; BESIDE]), |(kind, at)| (Some(kind), at));
    trace.beside = beside;
    let mut at = Unknowns {
        circuit: near(stated.resonance_hz, stated.circuit, unit),
        beside: stated_beside,
        amplitudes: Vec::new(),
        steps: trace.stays.iter().map(|stay| vec![0.0; stay.samples.len() - 1]).collect(),
    };
    let mut variance = noise.at_ten_cycles.powi(2);
    at.amplitudes = trace.first_amplitudes(&at.circuit, variance);
    let rows = 2 * usable.len() + CIRCUIT - 1;
    let unknowns = CIRCUIT + beside.map_or(0, Beside::count);
    let degrees = rows.saturating_sub(unknowns).max(1) as f64;
    let (mut found, mut widest, mut mode_variance) = (None, 0.0, 0.0);
    let (mut scatter, mut effective_time_s) = (f64::NAN, None);
    for round in 0..ROUNDS {
        let weights = trace.weights(&at, variance);
        let normal = trace.descend(&mut at, &weights);
        if round + 1 == ROUNDS && is_ringing {
            (widest, mode_variance) = trace.widest(&at, &weights);
            let effective_s = trace.effective_s(&at, &weights);
            effective_time_s = effective_s.map(|s| first.begin_s() + s);
        }
        if round + 2 == ROUNDS || is_noise_unknown && round + 2 < ROUNDS {
            // What the readings say of the noise, together with what was known of it.
            scatter = normal.cost / degrees * variance / noise.at_ten_cycles.powi(2);
            let all = noise.degrees_of_freedom + degrees;
            variance *= (noise.degrees_of_freedom + normal.cost) / all;
            variance = variance.max(VARIANCE_MIN);
        }
        found = Some(normal);
    }
    let found = found?;
    let (circuit, circuit_sigma) = circuit(&at.circuit, &found, unit)?;
    let mut beside_sigmas: f64 = 0.0;
    let both = at.beside.into_iter().zip(stated_beside);
    for (k, (value, stated)) in both.enumerate().take(beside.map_or(0, Beside::count)) {
        let sigma = found.variance(CIRCUIT + k)?.sqrt();
        beside_sigmas = beside_sigmas.max((value - stated).abs() / sigma);
    }
    let [ln_resonance, _, _, c1, _] = at.circuit;
    let resonance_hz = ln_resonance.exp();
    let sigma_hz = resonance_hz * found.variance(0)?.sqrt();
    let fitted = Fitted {
        resonance_hz,
        circuit,
        circuit_sigma,
        moved_hz: if is_ringing { resonance_hz * at.beside[0] } else { 0.0 },
        beside_sigmas,
        sigma_hz,
        with_mode_hz: sigma_hz.max(resonance_hz * f64::sqrt(widest)),
        mode_sigma: f64::sqrt(mode_variance) / c1,
        scatter,
        degrees,
        effective_time_s,
    };
    (resonance_hz.is_finite() && sigma_hz.is_finite()).then_some(fitted)
}

/// The impedance of a circuit, ohm.
pub(crate) fn impedance(circuit: &Circuit, resonance_hz: f64, at_hz: f64) -> Complex64 {
    let Circuit { quality_factor, static_capacitance_f, capacitance_ratio, loss_tangent } =
        *circuit;
    let x = at_hz / resonance_hz;
    let motional = capacitance_ratio / Complex64::new(1.0 - x * x, x / quality_factor);
    let capacitance = static_capacitance_f * (Complex64::new(1.0, -loss_tangent) + motional);
    (Complex64::I * TAU * at_hz * capacitance).inv()
}

/// A little beside the stated circuit: a stated value that is no minimum moves away from it.
fn near(resonance_hz: f64, stated: &Circuit, unit: f64) -> [f64; CIRCUIT] {
    let c0 = stated.static_capacitance_f / unit;
    let q = stated.quality_factor * 1.1;
    [
        (resonance_hz + 0.03 * resonance_hz / stated.quality_factor).ln(),
        q.ln(),
        c0,
        c0 * stated.capacitance_ratio,
        c0 * stated.loss_tangent,
    ]
}

/// The values of a circuit in units of the capacitance `unit`, and their standard deviations.
fn circuit(at: &[f64; CIRCUIT], found: &Normal, unit: f64) -> Option<(Circuit, Circuit)> {
    let [_, ln_q, c0, c1, g] = *at;
    let sigma = |unknown: usize| Some(found.variance(unknown)?.sqrt());
    // Readings that say little of it may be fitted best by a negative capacitance.
    let of_c0 = sigma(2)? / c0.abs();
    let circuit = Circuit {
        quality_factor: ln_q.exp(),
        static_capacitance_f: c0 * unit,
        capacitance_ratio: c1 / c0,
        loss_tangent: g / c0,
    };
    let circuit_sigma = Circuit {
        quality_factor: sigma(1)?,
        static_capacitance_f: of_c0,
        capacitance_ratio: of_c0.hypot(sigma(3)? / c1),
        loss_tangent: sigma(4)? / c0.abs(),
    };
    Some((circuit, circuit_sigma))
}
