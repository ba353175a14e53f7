//! Fits impedance readings to a resonance frequency with its uncertainty, or refuses with a reason, and
//! plans which frequency to measure next.
//!
//! Resonance means the series resonance 1/(2π√(L1 C1)) of the Butterworth–Van Dyke circuit. It exists
//! even if the phase never crosses zero, which is usual in contact, and damping does not shift it.
//!
//! Readings and the control of the analyzer belong to other crates.

#![deny(clippy::disallowed_methods)]

mod bench;
mod circuit;
mod diagnose;
mod estimators;
mod fit;
mod noise;
mod numeric;
mod onset;
mod outcome;
mod plan;

pub use bench::Bench;
pub use circuit::{
    Circuit,
    trace::{Past, Timing},
};
pub use diagnose::flagged::flagged;
pub use estimators::{Definition, Estimator, NoEstimate};
pub use fit::{FitOptions, Fitter, fit};
pub use noise::NoisePrior;
pub use onset::{ContactWatch, EvenWay, Latency, Onset, OnsetRefusal, Watched};
pub use outcome::{
    Extra, FitOutcome, ModelOrder, Resonance,
    refusal::{Limit, Reason, Refusal, Side},
};
pub use plan::{
    Next, Planner,
    prior::{Estimate, Prior},
};
