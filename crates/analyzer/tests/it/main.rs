//! The drivers against instruments made of bytes, on a paused clock.
#![expect(clippy::unwrap_used, reason = "all of it is a test")]

mod held_up;
mod im3536;
mod measurements;
mod peer;
mod relatives;
mod simulated;
mod user;
