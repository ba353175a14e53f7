//! Counts of what a device answered.

use std::{
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use crate::Durations;

/// Counts of a device since its driver was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Health {
    /// Requests carried out or tried.
    pub requests: u64,
    /// Attempts that were repeated.
    pub retries: u64,
    /// Answers that did not come in time.
    pub late: u64,
    /// Answers that could not be read, or answered something else.
    pub corrupt: u64,
    /// Requests that the device refused.
    pub refusals: u64,
    /// Requests that failed in spite of all attempts.
    pub faults: u64,
    /// From the sending of the last answered request to the end of its answer.
    pub last_round_trip: Option<Duration>,
    /// Times of all answered requests.
    pub round_trips: Durations,
}

impl Health {
    /// Counts an answer that took this long.
    pub fn answered(&mut self, took: Duration) {
        self.last_round_trip = Some(took);
        self.round_trips.note(took);
    }
}

/// The counts of one device. Clones show the same counts, so that the daemon can keep one beside the
/// driver that counts.
#[derive(Debug, Clone, Default)]
pub struct HealthMeter {
    health: Arc<Mutex<Health>>,
}

impl HealthMeter {
    /// The counts now.
    pub fn read(&self) -> Health {
        *self.lock()
    }

    /// Changes the counts.
    pub fn note(&self, change: impl FnOnce(&mut Health)) {
        change(&mut self.lock());
    }

    fn lock(&self) -> MutexGuard<'_, Health> {
        // Counts hold also after a panic.
        self.health.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
