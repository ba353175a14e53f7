//! Stops without a wait: they reach the drives between any two frames of a busy line.

use std::time::Duration;

use tokio::{
    sync::{mpsc, oneshot},
    time::{Instant, sleep_until},
};

use crate::Request;

/// Remaining wait for an answer after a stop. Drives answer within some milliseconds and USB
/// adapters add up to 16.
const ANSWER_WITHIN: Duration = Duration::from_millis(30);

/// The frames that stop the drives of a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HaltFrames(pub(crate) Vec<(u8, Request)>);

impl HaltFrames {
    /// Those of several drives, in this order.
    pub fn of(drives: impl IntoIterator<Item = Self>) -> Self {
        Self(drives.into_iter().flat_map(|drive| drive.0).collect())
    }
}

/// An order to stop the drives now.
#[derive(Debug)]
pub(crate) struct HaltOrder {
    pub(crate) frames: HaltFrames,
    /// Notified when the frames have left.
    pub(crate) sent: oneshot::Sender<()>,
}

/// The stops that have come and are not sent yet.
#[derive(Debug)]
pub(crate) struct Halts {
    inbox: mpsc::UnboundedReceiver<HaltOrder>,
    come: Vec<HaltOrder>,
    /// Number of stops taken to be sent so far.
    taken: u64,
}

impl Halts {
    pub(crate) const fn new(inbox: mpsc::UnboundedReceiver<HaltOrder>) -> Self {
        Self { inbox, come: Vec::new(), taken: 0 }
    }

    /// Number of stops so far, so that a request detects a stop during its execution.
    pub(crate) const fn taken(&self) -> u64 {
        self.taken
    }

    /// Waits for a stop that is not sent yet; for ever when no more can come. May be dropped at any
    /// time.
    pub(crate) async fn come(&mut self) {
        if self.come.is_empty() {
            match self.inbox.recv().await {
                Some(order) => self.come.push(order),
                None => std::future::pending().await,
            }
        }
    }

    /// The stops that have come, to be sent now.
    pub(crate) fn take(&mut self) -> Vec<HaltOrder> {
        while let Ok(order) = self.inbox.try_recv() {
            self.come.push(order);
        }
        self.taken += self.come.len() as u64;
        std::mem::take(&mut self.come)
    }

    /// Waits until an answer is too late: at its deadline, or soon after a stop has come.
    pub(crate) async fn too_late(&mut self, deadline: Instant) {
        tokio::select! {
            biased;
            () = sleep_until(deadline) => {}
            () = self.come() => sleep_until(deadline.min(Instant::now() + ANSWER_WITHIN)).await,
        }
    }

    /// When the answer to a stop is too late.
    pub(crate) fn answer_by(deadline: Instant) -> Instant {
        deadline.min(Instant::now() + ANSWER_WITHIN)
    }
}
