//! Arithmetic on the rig's clock.

use rig_model::RigTime;

/// The first tick of the clock that is not before `seconds` after `at`.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a float cast saturates, and no negative time is asked for"
)]
pub(crate) fn after(at: RigTime, seconds: f64) -> RigTime {
    RigTime::from_micros(at.as_micros().saturating_add((seconds * 1e6).ceil() as u64))
}
