//! Times between attempts to reach a server.

use std::time::{Duration, SystemTime};

use tokio::sync::watch;

/// Time to the second attempt. It doubles with each further one.
const WAIT: Duration = Duration::from_secs(1);

/// Times between attempts: 1 s, 2 s and so on.
#[derive(Debug)]
pub(crate) struct Waits {
    next: Duration,
    longest: Duration,
}

impl Waits {
    /// Times up to the longest one.
    pub(crate) const fn up_to(longest: Duration) -> Self {
        Self { next: WAIT, longest }
    }

    /// The next time is the first one again: the server has answered.
    pub(crate) const fn begin_anew(&mut self) {
        self.next = WAIT;
    }

    /// The next time.
    pub(crate) fn next(&mut self) -> Duration {
        let wait = self.next.min(self.longest);
        self.next = (wait * 2).min(self.longest);
        spread(wait)
    }
}

/// Waits until nobody has news any more.
pub(crate) async fn closed<T>(news: &mut watch::Receiver<T>) {
    while news.changed().await.is_ok() {}
}

/// A time up to a quarter shorter, so that not all benches call at once after a failure of the server.
fn spread(wait: Duration) -> Duration {
    let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    wait.saturating_sub(wait / 4 * (since_1970.subsec_micros() % 1000) / 1000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_double_up_to_the_longest_and_are_spread_over_a_quarter() {
        let mut waits = Waits::up_to(Duration::from_secs(6));
        for wanted_s in [1, 2, 4, 6, 6] {
            let (wanted, wait) = (Duration::from_secs(wanted_s), waits.next());
            assert!(wait <= wanted && wait >= wanted * 3 / 4, "{wait:?} for {wanted:?}");
        }
        waits.begin_anew();
        assert!(waits.next() <= WAIT);
    }
}
