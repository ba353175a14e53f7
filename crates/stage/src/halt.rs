//! Stops without a wait: they reach the drives between any two frames of a busy line.

use std::time::Duration;

use tokio::{
    sync::{mpsc, oneshot},
    time::{Instant, sleep_until},
};

use crate::Request;

/// Remaining wait for an answer after a stop, beside the time of its frames on the wire. Drives answer within some
/// milliseconds and USB adapters add up to 16.
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

    /// Waits until an answer is too late: at its deadline, which is `reply_within` after the end of both frames on the
    /// wire, or soon after a stop has come. A stop that is sent into a frame is lost with it.
    pub(crate) async fn too_late(&mut self, deadline: Instant, reply_within: Duration) {
        tokio::select! {
            biased;
            () = sleep_until(deadline) => {}
            () = self.come() => sleep_until(Self::answer_by(deadline, reply_within)).await,
        }
    }

    /// When the answer to a stop, or to a request before which a stop waits, is too late.
    pub(crate) fn answer_by(deadline: Instant, reply_within: Duration) -> Instant {
        let on_wire = deadline.checked_sub(reply_within).unwrap_or(deadline);
        deadline.min(on_wire.max(Instant::now()) + ANSWER_WITHIN)
    }
}
