//! What Linux does in its own way.

use std::{io, time::Duration};

use rustix::{fd::AsFd, time::ClockId};

/// The clock that goes on while the computer sleeps.
pub(crate) const RUNNING: ClockId = ClockId::Boottime;
/// The middle of the scale of 0 to 99 is the nice value 0, which other programs have.
pub(crate) const OTHER_PROGRAMS: u8 = 50;

/// The number of handles to ask for, with this limit.
pub(crate) const fn handles_of(maximum: Option<u64>) -> Option<u64> {
    maximum
}

pub(crate) fn give_way(by: i32) -> io::Result<()> {
    rustix::process::nice(by)?;
    Ok(())
}

pub(crate) fn limit_silence(stream: &impl AsFd, within: Duration) -> io::Result<()> {
    let unheard_ms = u32::try_from(within.as_millis()).unwrap_or(u32::MAX);
    Ok(rustix::net::sockopt::set_tcp_user_timeout(stream, unheard_ms)?)
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    #[test]
    fn a_thread_that_comes_after_others_is_not_nicer_than_before() {
        let before = rustix::process::nice(0).unwrap();
        let after = thread::spawn(|| {
            crate::priority::come_after().unwrap();
            rustix::process::nice(0).unwrap()
        });
        assert!(after.join().unwrap() <= before.max(0));
    }

    #[test]
    fn giving_way_is_for_one_thread() {
        let before = rustix::process::nice(0).unwrap();
        let other = thread::spawn(|| {
            give_way(3).unwrap();
            rustix::process::nice(0).unwrap()
        });
        assert_eq!(other.join().unwrap(), (before + 3).min(19));
        assert_eq!(rustix::process::nice(0).unwrap(), before);
    }
}
