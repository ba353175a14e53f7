//! The wish to end a long operation.

use tokio::sync::watch;

/// A flag that asks the present operation to end as soon as this is safe.
///
/// It is a level, not an edge: raised before an operation starts, it ends that operation too. All
/// clones share one flag.
#[derive(Debug, Clone)]
pub struct StopSignal {
    raised: watch::Sender<bool>,
}

impl StopSignal {
    /// A flag that is not raised.
    pub fn new() -> Self {
        Self { raised: watch::Sender::new(false) }
    }

    /// Asks for the stop.
    pub fn raise(&self) {
        self.raised.send_replace(true);
    }

    /// Takes the wish back, before the next operation.
    pub fn lower(&self) {
        self.raised.send_replace(false);
    }

    /// Whether a stop is requested.
    pub fn is_raised(&self) -> bool {
        *self.raised.borrow()
    }

    /// Waits until a stop is requested. May be dropped at any time.
    pub async fn raised(&self) {
        // The sender is borrowed for as long as this waits, so the channel cannot close.
        _ = self.raised.subscribe().wait_for(|is_raised| *is_raised).await;
    }
}

impl Default for StopSignal {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_stop_raised_early_is_seen_late_and_by_every_clone() {
        let stop = StopSignal::new();
        let other = stop.clone();
        assert!(!other.is_raised());
        stop.raise();
        other.raised().await;
        assert!(other.is_raised());
        other.lower();
        assert!(!stop.is_raised());
    }

    #[tokio::test]
    async fn every_waiting_task_is_woken() {
        let stop = StopSignal::new();
        let waiting = tokio::spawn({
            let stop = stop.clone();
            async move { stop.raised().await }
        });
        tokio::task::yield_now().await;
        assert!(!waiting.is_finished());
        stop.raise();
        waiting.await.unwrap();
    }
}
