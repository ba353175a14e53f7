//! Settings and counters of a line.

use std::time::Duration;

/// The framing of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Framing {
    /// Modbus RTU: on a serial line, or through a gateway that passes its bytes on.
    Rtu,
    /// Modbus TCP.
    Tcp,
}

/// Settings of a line.
#[derive(Debug, Clone, Copy)]
pub struct BusSettings {
    /// Framing of Modbus on the line.
    pub framing: Framing,
    /// The silence between two frames, where it is not to be that of the standard: some devices
    /// need more, and a line that ends in this computer needs none.
    pub silence: Option<Duration>,
    /// Longest delay before an answer begins, in addition to the time on the wire.
    pub reply_within: Duration,
    /// Duration of the quarantine after a fault. No answer may be later than this.
    pub quarantine: Duration,
    /// Largest number of attempts of a request.
    pub attempts: u32,
    /// Time limit for a busy device.
    pub busy_within: Duration,
    /// The pause before a busy device is asked again.
    pub busy_pause: Duration,
}

impl BusSettings {
    /// Modbus RTU, with times that suit drives.
    pub const fn rtu() -> Self {
        Self {
            framing: Framing::Rtu,
            silence: None,
            // Drives answer within some milliseconds, USB adapters add up to 16.
            reply_within: Duration::from_millis(100),
            quarantine: Duration::from_millis(500),
            attempts: 3,
            busy_within: Duration::from_secs(2),
            busy_pause: Duration::from_millis(20),
        }
    }

    /// Modbus TCP, with time for a network between.
    pub const fn tcp() -> Self {
        Self { framing: Framing::Tcp, reply_within: Duration::from_millis(500), ..Self::rtu() }
    }
}
