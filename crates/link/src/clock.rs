//! Time since the rig was opened.

use rig_model::RigTime;
use tokio::time::Instant;

/// Turns the runtime's clock, which may be paused, into the rig's own time.
#[derive(Debug, Clone, Copy)]
pub struct Clock {
    opened: Instant,
}

impl Clock {
    /// A clock that starts at zero now.
    pub fn start() -> Self {
        Self { opened: Instant::now() }
    }

    /// The rig's time now.
    pub fn now(&self) -> RigTime {
        self.at(Instant::now())
    }

    /// The rig's time at an instant of the runtime's clock; zero for one before the rig was opened.
    pub fn at(&self, instant: Instant) -> RigTime {
        RigTime::ZERO + instant.saturating_duration_since(self.opened)
    }
}
