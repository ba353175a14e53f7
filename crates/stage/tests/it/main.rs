//! The drivers against devices made of bytes, on a paused clock.
#![expect(clippy::unwrap_used, reason = "all of it is a test")]
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "numbers are cut into registers"
)]

mod drive;
mod lines;
mod moves;
mod panics;
mod peer;
mod simulated;
mod stops;
