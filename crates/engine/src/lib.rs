//! Decides what the rig does next, without I/O and without a clock.
#![deny(clippy::disallowed_methods)]
