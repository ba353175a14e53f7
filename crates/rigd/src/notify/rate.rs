//! How many attempts a target gets in a minute.

use std::{collections::VecDeque, time::Duration};

use tokio::time::Instant;

const MINUTE: Duration = Duration::from_secs(60);

/// The attempts of one target in the last minute.
#[derive(Debug)]
pub(super) struct Rate {
    most: usize,
    begun: VecDeque<Instant>,
}

impl Rate {
    /// At most so many in a minute.
    pub(super) fn new(per_minute: u32) -> Self {
        let most = usize::try_from(per_minute).unwrap_or(usize::MAX).max(1);
        Self { most, begun: VecDeque::new() }
    }

    /// The time until another attempt may begin; `None` if it may begin now.
    pub(super) fn wait(&mut self, now: Instant) -> Option<Duration> {
        while self.begun.front().is_some_and(|begun| *begun + MINUTE <= now) {
            self.begun.pop_front();
        }
        let oldest = self.begun.front().filter(|_| self.most <= self.begun.len())?;
        Some(*oldest + MINUTE - now)
    }

    /// An attempt begins.
    pub(super) fn begin(&mut self, now: Instant) {
        self.begun.push_back(now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_minute_has_more_attempts_than_allowed() {
        let mut rate = Rate::new(3);
        let start = Instant::now();
        let (mut now, mut begun) = (start, Vec::new());
        while begun.len() < 20 {
            now += rate.wait(now).unwrap_or_default();
            rate.begin(now);
            begun.push(now - start);
            now += Duration::from_secs(7);
        }
        assert_eq!(begun[..4].iter().map(Duration::as_secs).collect::<Vec<_>>(), [0, 7, 14, 60]);
        for window in begun.windows(4) {
            assert!(window[0] + MINUTE <= window[3], "{begun:?}");
        }
    }
}
