//! The drivers against instruments made of bytes, on a paused clock, and against one on USB in real time.
#![expect(clippy::unwrap_used, reason = "all of it is a test")]

mod held_up;
mod im3536;
mod measurements;
mod peer;
mod relatives;
mod simulated;
#[cfg(target_os = "linux")]
mod usbtmc;
mod user;
