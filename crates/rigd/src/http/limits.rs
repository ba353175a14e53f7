//! The limits of a request body.

use std::time::Duration;

/// The largest protocol shipped has 2 kB; a protocol of a thousand samples has 60 kB.
pub(super) const BODY_MAX: usize = 256 << 10;
/// 256 KiB take two seconds over the slowest link that anybody works on, 1 Mbit/s.
pub(super) const BODY_TIME: Duration = Duration::from_secs(10);
