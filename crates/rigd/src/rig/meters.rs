//! What the rig thread measures about itself, for the monitoring of the service.

use std::{
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use rig_link::Durations;

/// Durations of the rig thread since it was started. Clones show the same ones.
#[derive(Debug, Clone, Default)]
pub(crate) struct Meters {
    durations: Arc<Mutex<Measured>>,
}

/// What was measured.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Measured {
    /// Until the disk had everything that was noted.
    pub(crate) commits: Durations,
    /// By which the loop woke after its time.
    pub(crate) late: Durations,
}

impl Meters {
    /// The durations now.
    pub(crate) fn read(&self) -> Measured {
        *self.lock()
    }

    pub(super) fn committed(&self, took: Duration) {
        self.lock().commits.note(took);
    }

    pub(super) fn woke_late(&self, by: Duration) {
        self.lock().late.note(by);
    }

    fn lock(&self) -> MutexGuard<'_, Measured> {
        // Counts hold also after a panic.
        self.durations.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
