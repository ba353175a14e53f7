//! Impedance points in; resonance frequency with uncertainty, or a refusal with its reason, out.
#![deny(clippy::disallowed_methods)]
