//! The effective time of a resonance.
//!
//! The result of a sweep is a mean over its duration, in which each reading is weighted by its
//! information on the resonance. If the resonance drifts linearly, that mean equals the resonance at
//! one effective time, independent of the drift rate: in a rising sweep the time of passing the
//! resonance, in a sweep up and down the middle. A sweep in one direction cannot detect a drift, but
//! its effective time is known.
//!
//! A resonance that deviates by δ·(t − m) at each reading shifts the result by δ times
//!
//! ```text
//!   (JᵀWJ)⁻¹ Jᵀ W J_f (t − m),   in the row of the resonance f,
//! ```
//!
//! which is zero if m is the effective time.

use std::f64::consts::TAU;

use num_complex::Complex64;
use rig_model::Reading;

use crate::{
    Circuit, FitOptions, ModelOrder, Resonance, Timing,
    circuit::trace::{CIRCUIT, ExtraTerm, ModelEstimate, Trace, UNKNOWNS, middle_s},
    fit,
    numeric::dense::Cholesky,
    numeric::descent::Normal,
};

impl Resonance {
    /// Effective time of `resonance_hz`, s on the clock of the readings, to first order in the drift of
    /// the resonance during the sweep. `readings` and `options` are those of the fit.
    ///
    /// `None` if the clock stood still between the readings or if they do not determine a resonance.
    pub fn effective_time_s(&self, readings: &[Reading], options: &FitOptions) -> Option<f64> {
        let (first, last) = (readings.first()?, readings.last()?);
        if first.started >= last.started {
            return None;
        }
        if options.timing == Timing::AnyPhase {
            let begin_s = first.started.as_seconds() + first.settle_s;
            return Some(begin_s + fit::decay::judge::effective_time_s(readings, options)?);
        }
        let mut trace = Trace::of(readings, options.timing, self.c0_farad);
        let circuit = self.circuit();
        let at = ModelEstimate::of(&circuit, self.c0_farad);
        let extra_term = if self.model_order == ModelOrder::Drift {
            ExtraTerm::Drift
        } else {
            trace.extra_term()
        };
        let at = ModelEstimate { extra_term, ..at };
        if let (Timing::Waited, Some(noise)) = (options.timing, options.noise) {
            trace.weigh_settling(&at, noise.at_ten_cycles.powi(2));
        }
        // Extra terms come after the loss.
        let is_lossless = self.loss_tangent_sigma().is_none() && extra_term == ExtraTerm::Nothing;
        let free = if is_lossless { CIRCUIT - 1 } else { CIRCUIT + extra_term.count() };
        let (mut normal, mut times) = (Normal::<UNKNOWNS>::default(), readings.iter());
        trace.rows(&at, |sample, row| {
            let middle_s = times.next().map_or(0.0, |reading| middle_s(reading, first));
            let heard_s = middle_s - lag_s(&circuit, sample.visit.frequency_hz);
            normal.add(row.slopes[0] * heard_s, &row.slopes, sample.weight);
        });
        let passed_s = Cholesky::new(&normal.matrix, free, 0.0)?.solve(&normal.gradient)[0];
        Some(first.started.as_seconds() + passed_s)
    }
}

/// Delay with which a steady reading follows a moving resonance, s. With the decay rate γ and the
/// detuning Δ, rad/s, the phasor x of the motion obeys x' = −(γ + jΔ)x + drive, so that a reading shows
/// Δ at a time 1/(γ + jΔ) ago, to first order in Δ'.
fn lag_s(circuit: &Circuit, frequency_hz: f64) -> Complex64 {
    let decay = 1.0 / circuit.time_constant_s();
    let detuning = TAU * (frequency_hz - circuit.resonance_hz);
    1.0 / Complex64::new(decay, detuning)
}
