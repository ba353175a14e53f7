//! The priority of the rig thread: before all other programs of the computer, where the system allows it.

use rig_system::priority::{self, COMES_FIRST_WITH};

/// Asks the system to run the calling thread as soon as it has something to do. Threads that it begins from then
/// on may inherit that.
pub(super) fn come_first() {
    match priority::come_first() {
        Ok(()) => tracing::debug!("the rig thread has real-time priority"),
        Err(error) => tracing::debug!(
            error = ?error,
            "the rig thread has no real-time priority: {COMES_FIRST_WITH}"
        ),
    }
}

/// Gives back what [`come_first`] has taken: for a thread that inherited it.
pub(super) fn come_after() {
    if let Err(error) = priority::come_after() {
        tracing::warn!(error = ?error, "a thread that waits for files has the priority of the rig thread");
    }
}
