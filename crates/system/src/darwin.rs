//! What macOS does in its own way.

use std::{io, time::Duration};

use rustix::{fd::AsFd, time::ClockId};
use thread_priority::{Error, ThreadPriority};

/// The clock that goes on while the computer sleeps.
///
/// # Source
/// `clock_gettime(3)` of macOS: `CLOCK_MONOTONIC` increments while the system is asleep, `CLOCK_UPTIME_RAW` does not.
pub(crate) const RUNNING: ClockId = ClockId::Monotonic;
/// The priority with which a thread begins, on the scale of 15 to 47 of its normal class.
///
/// # Source
/// XNU `osfmk/kern/sched.h`, `BASEPRI_DEFAULT`.
pub(crate) const OTHER_PROGRAMS: u8 = 31;
/// The lowest priority of that scale.
const LOWEST: u8 = 15;
/// More handles than these are refused, also where the limit says that there is none.
///
/// # Source
/// `setrlimit(2)` of macOS, "Compatibility": the least of `OPEN_MAX` and the limit.
const OPEN_MAX: u64 = 10_240;

/// The number of handles to ask for, with this limit.
#[expect(clippy::unnecessary_wraps, reason = "the same signature as on Linux")]
pub(crate) fn handles_of(maximum: Option<u64>) -> Option<u64> {
    Some(maximum.map_or(OPEN_MAX, |maximum| maximum.min(OPEN_MAX)))
}

pub(crate) fn give_way(by: i32) -> io::Result<()> {
    let by = u8::try_from(by).unwrap_or(0);
    let priority = OTHER_PROGRAMS.saturating_sub(by).max(LOWEST);
    let priority = ThreadPriority::try_from(priority).map_err(Error::Priority);
    priority
        .and_then(|priority| crate::system::set_priority(priority, crate::system::NORMAL))
        .map_err(crate::priority::as_io)
}

pub(crate) fn limit_silence(stream: &impl AsFd, within: Duration) -> io::Result<()> {
    crate::network::ask_whether_it_is_there(stream, within)
}
