//! Results from touches: shift tables, sensitivity, stiffness, classification.
//!
//! All functions take plain numbers. Samples, directions and classes are indices into lists of the
//! caller, which also owns the records of the touches.

#![deny(clippy::disallowed_methods)]

pub mod budget;
pub mod calibration;
pub mod classes;
pub mod classify;
pub mod cluster;
pub mod model;
pub mod no_load;
pub mod recognition;
pub mod reference;
pub mod run;
pub mod score;
pub mod screw;
pub mod sensitivity;
pub mod shift;
pub mod stiffness;
