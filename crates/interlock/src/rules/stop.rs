//! A stop reaches the drives in time.

use std::time::Duration;

use rig_model::RigTime;

/// The longest time from the request of a stop to its frames.
const WITHIN: Duration = Duration::from_millis(100);

/// The time of a stop that is not sent yet, and how long it had waited then.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct StopClock {
    asked: Option<(RigTime, Duration)>,
}

impl StopClock {
    /// A stop was requested, and has waited this long.
    pub(crate) fn asked(&mut self, now: RigTime, waited: Duration) {
        self.asked.get_or_insert((now, waited));
    }

    /// The frames of the stop have left; how long it took if that was too long.
    pub(crate) fn sent(&mut self, now: RigTime) -> Option<Duration> {
        let (asked, waited) = self.asked.take()?;
        let took = waited + now.since(asked);
        (WITHIN < took).then_some(took)
    }
}
