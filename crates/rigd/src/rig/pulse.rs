//! Notices that the rig loop has stopped: the loop gives signs of life, and a thread of its own counts
//! the time without one.
//!
//! The time is counted in waits of that thread, so that a computer that sleeps, or a program that is
//! stopped as a whole, is not taken for a loop that has stopped.

use std::{
    fmt,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    thread,
    time::{Duration, SystemTime},
};

use tokio::sync::watch;

use super::Status;

/// Interval of the looks at the loop.
const LOOK: Duration = Duration::from_millis(100);

/// Looks without a sign of life until the loop is silent: 5 s. The longest decision of the planner takes
/// less than 1 s, and a disk that is busy answers within 1 s or 2 s.
const SILENT_AFTER: u32 = if cfg!(test) { 5 } else { 50 };

/// Looks without a sign of life until the loop is given up: 30 s. A disk that answers later than that is
/// not expected to answer.
const GIVEN_UP_AFTER: u32 = if cfg!(test) { 10 } else { 300 };

/// What the rig loop does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Doing {
    /// It waits for the devices, a request, or a time.
    Waiting,
    /// The engine decides.
    Deciding,
    /// The journal is written, or the data directory is used for a request.
    Recording,
}

/// A rig loop that gives no sign of life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Silence {
    /// Time of the last sign of life.
    pub since: SystemTime,
    /// What the loop did then.
    pub doing: Doing,
    /// Whether the loop is given up: after 30 s, or when a stop was requested of it.
    pub is_given_up: bool,
}

/// The signs of life of a rig loop.
#[derive(Debug, Default)]
pub(super) struct Pulse {
    /// A number that changes with each sign, times 4, and what the loop does.
    signs: AtomicU64,
    /// One more than the signs at which a silent loop must not be waited for; 0 at first.
    given_up_at: AtomicU64,
}

impl Pulse {
    /// A sign of life. Only the loop gives it. Returns what it did before.
    pub(super) fn beat(&self, doing: Doing) -> Doing {
        let signs = self.signs.load(Ordering::Relaxed);
        let number = (signs >> 2).wrapping_add(1);
        self.signs.store(number << 2 | doing as u64, Ordering::Release);
        Self::doing(signs)
    }

    /// A loop that is silent must not be waited for, unless it gives another sign.
    pub(super) fn give_up(&self) {
        let signs = self.signs.load(Ordering::Acquire);
        self.given_up_at.store(signs.wrapping_add(1), Ordering::Release);
    }

    fn doing(signs: u64) -> Doing {
        [Doing::Waiting, Doing::Deciding][..]
            .get((signs & 3) as usize)
            .copied()
            .unwrap_or(Doing::Recording)
    }
}

/// Watches over a loop until its pulse is dropped, and publishes its silence.
///
/// # Errors
/// The system has no thread for it.
pub(super) fn watch_over(
    pulse: &Arc<Pulse>,
    watched: watch::Sender<Status>,
    is_virtual_time: bool,
) -> std::io::Result<()> {
    let pulse = Arc::downgrade(pulse);
    let watch = move || {
        let mut look = Look::default();
        while let Some(pulse) = pulse.upgrade() {
            let silence = look.again(&pulse, is_virtual_time);
            drop(pulse);
            watched.send_if_modified(|status| {
                std::mem::replace(&mut status.silence, silence) != silence
            });
            thread::sleep(LOOK);
        }
    };
    thread::Builder::new().name("rig watch".to_owned()).spawn(watch).map(drop)
}

/// The last look at a loop.
#[derive(Debug, Default)]
struct Look {
    signs: u64,
    /// Looks since the last sign of life.
    looks: u32,
    since: Option<SystemTime>,
}

impl Look {
    fn again(&mut self, pulse: &Pulse, is_virtual_time: bool) -> Option<Silence> {
        let signs = pulse.signs.load(Ordering::Acquire);
        let doing = Pulse::doing(signs);
        // In virtual time nothing wakes a loop that has nothing to do.
        let is_at_rest = is_virtual_time && doing == Doing::Waiting;
        let since = match self.since {
            Some(since) if signs == self.signs && !is_at_rest => since,
            _ => {
                *self = Self { signs, looks: 0, since: Some(SystemTime::now()) };
                return None;
            }
        };
        self.looks = self.looks.saturating_add(1);
        let is_given_up = self.looks >= GIVEN_UP_AFTER
            || pulse.given_up_at.load(Ordering::Acquire) == signs.wrapping_add(1);
        (self.looks >= SILENT_AFTER).then_some(Silence { since, doing, is_given_up })
    }
}

impl fmt::Display for Silence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let since = self.since.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let seconds = since.as_secs() % (24 * 3600);
        let [hours, minutes] = [seconds / 3600, seconds / 60 % 60];
        let doing = match self.doing {
            Doing::Waiting => "waited for its devices",
            Doing::Deciding => "decided about the next operation",
            Doing::Recording => "used the data directory",
        };
        write!(
            f,
            "the rig loop has not answered since {hours:02}:{minutes:02}:{:02} UTC, when it {doing}",
            seconds % 60
        )
    }
}

#[cfg(test)]
mod tests;
