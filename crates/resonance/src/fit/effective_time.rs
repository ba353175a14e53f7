//! The moment for which a resonance holds.
//!
//! A sweep takes time, and what it finds is a mean over that time in which each reading counts for
//! what it tells of the resonance. If the resonance moves evenly meanwhile, that mean is the resonance
//! of a certain moment, however fast it moves: in a rising sweep the moment of passing it, in a sweep
//! up and down the middle. No sweep in one direction can tell whether the resonance moved, but each
//! can say when it looked.
//!
//! A resonance off by δ·(t − m) at each reading moves the result by δ times
//!
//! ```text
//!   (JᵀWJ)⁻¹ Jᵀ W J_f (t − m),   in the row of the resonance f,
//! ```
//!
//! which is nothing where m is the moment.

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
    /// The moment for which `resonance_hz` holds, s on the clock of the readings, to first order in how
    /// far the resonance moved meanwhile. `readings` and `options` are those of the fit.
    ///
    /// `None` where the clock stood still between the readings, or they determine no resonance.
    pub fn moment_s(&self, readings: &[Reading], options: &FitOptions) -> Option<f64> {
        let (first, last) = (readings.first()?, readings.last()?);
        if first.started >= last.started {
            return None;
        }
        if options.timing == Timing::AnyPhase {
            let begin_s = first.started.as_seconds() + first.settle_s;
            return Some(begin_s + fit::decay::judge::moment_s(readings, options)?);
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

/// How long ago the resonance was as a steady reading shows it, s. The motion takes its time to follow
/// a resonance that moves: with γ the rate of decay and Δ the detuning, rad/s, its phasor x obeys
/// x' = −(γ + jΔ)x + drive, so that Δ of a time 1/(γ + jΔ) ago is what shows, to first order in Δ'.
fn lag_s(circuit: &Circuit, frequency_hz: f64) -> Complex64 {
    let decay = 1.0 / circuit.time_constant_s();
    let detuning = TAU * (frequency_hz - circuit.resonance_hz);
    1.0 / Complex64::new(decay, detuning)
}
