//! From touches to results: shift tables, sensitivity, classification.
//!
//! Everything here works on plain numbers: what a touch is and where it is kept is left to others.
//! Samples, directions and classes are indices into lists of the caller.

#![deny(clippy::disallowed_methods)]

pub mod classes;
pub mod classify;
pub mod cluster;
pub mod no_load;
pub mod recognition;
pub mod scale;
pub mod score;
pub mod sensitivity;
pub mod shift;
pub mod stiffness;
