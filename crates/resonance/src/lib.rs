//! Impedance points in; resonance frequency with uncertainty, or a refusal with its reason, out; and
//! which frequency to measure next.
//!
//! Resonance means the series resonance 1/(2π√(L1 C1)) of the Butterworth–Van Dyke circuit: it
//! exists where the phase never crosses zero, which is the usual case in contact, and a change of
//! damping does not move it.
//!
//! What a reading is, and how the analyzer is told, is left to others.

#![deny(clippy::disallowed_methods)]

mod alternatives;
mod circuit;
mod dense;
mod dual;
mod effective_time;
mod estimators;
mod fit;
mod flagged;
mod full_fit;
mod grid;
mod kernel;
mod mains;
mod outcome;
mod outliers;
mod plan;
mod planner;
mod points;
mod residual_transient;
mod ringup;
mod robust;
mod rounding;
mod scatter;
mod simd;
mod solve;
mod steady_fit;
mod trace;
mod two_level;
mod unknown_dwell;

pub use circuit::Circuit;
pub use estimators::{Definition, Estimator, NoEstimate};
pub use fit::{FitOptions, Fitter, NoisePrior, fit};
pub use flagged::flagged;
pub use outcome::{FitOutcome, ModelOrder, Reason, Refusal, Resonance, Side};
pub use planner::{Estimate, Limit, Next, Planner, Prior};
pub use trace::{Past, Timing};
