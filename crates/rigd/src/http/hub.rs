//! The events of the journal, read and encoded once for all streams.
//!
//! The streams share each event, so that a thousand of them need no more reading than one. A stream that takes
//! its events more slowly than they come has missed some when it asks again, and reads those from the journal.
//!
//! The streams also watch the rig through here: the rig thread wakes one task for them, and this task gives them
//! moments of the rig that they share.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use axum::body::Bytes;
use tokio::{
    sync::{
        broadcast::{self, Receiver, Sender},
        watch,
    },
    time::{sleep, timeout},
};

use super::{
    Shared,
    events::{Topic, of_record},
    live::{HEARTBEAT, INTERVAL, Moment},
};
use crate::rig::Status;

/// Records read at a time.
const PAGE: u32 = 64;
/// Events that are kept for streams that have not taken them yet. The largest, of long sweeps, have some 30 kB.
const KEPT: usize = 256;

/// An event of the journal.
#[derive(Debug, Clone)]
pub(super) struct News {
    pub(super) event: u64,
    pub(super) topic: Topic,
    pub(super) bytes: Bytes,
}

/// Where streams get the events from.
#[derive(Debug)]
pub(super) struct Hub {
    news: Sender<News>,
    moments: watch::Sender<Arc<Moment>>,
    is_running: AtomicBool,
}

/// What a stream listens to.
pub(super) struct Heard {
    /// The events from now on. Those that are in the journal when the stream begins may be left out.
    pub(super) news: Receiver<News>,
    /// The rig, a moment later than others see it, and at least once a second.
    pub(super) moments: watch::Receiver<Arc<Moment>>,
}

impl Hub {
    /// A hub for the streams of a rig.
    pub(super) fn new(rig: &Status) -> Self {
        let moments = watch::channel(Arc::new(Moment::new(rig.clone()))).0;
        Self { news: broadcast::channel(KEPT).0, moments, is_running: AtomicBool::new(false) }
    }

    /// Begins to listen.
    pub(super) fn listen(&self, shared: &Shared) -> Heard {
        let heard = Heard { news: self.news.subscribe(), moments: self.moments.subscribe() };
        if !self.is_running.swap(true, Ordering::AcqRel) {
            let status = shared.inner.rig.status();
            let last = status.borrow().last_event;
            self.moments.send_replace(Arc::new(Moment::new(status.borrow().clone())));
            tokio::spawn(relay(shared.clone(), shared.inner.rig.status()));
            tokio::spawn(run(shared.clone(), status, last));
        }
        heard
    }
}

/// Gives the streams a moment of the rig when it has changed and at each heartbeat, until the daemon closes.
async fn relay(shared: Shared, mut status: watch::Receiver<Status>) {
    let relaying = async {
        loop {
            let present = status.borrow_and_update().clone();
            shared.inner.hub.moments.send_replace(Arc::new(Moment::new(present)));
            sleep(INTERVAL).await;
            if matches!(
                timeout(HEARTBEAT.saturating_sub(INTERVAL), status.changed()).await,
                Ok(Err(_))
            ) {
                return;
            }
        }
    };
    tokio::select! {
        () = relaying => {}
        () = shared.inner.closing.cancelled() => {}
    }
}

/// Gives the streams what the journal has behind `last`, until the daemon closes.
async fn run(shared: Shared, mut status: watch::Receiver<Status>, mut last: u64) {
    let hub = &shared.inner.hub;
    loop {
        let newest = status.borrow_and_update().last_event;
        if hub.news.receiver_count() == 0 {
            // A stream that is opened later reads these from the journal.
            last = newest;
        }
        while last < newest {
            let page = shared.read(move |reader| Ok(reader.events_after(last, PAGE)?)).await;
            // The problem was noted where it arose; the next change is another attempt.
            let Ok(page) = page else { break };
            let Some(newest) = page.last() else { break };
            last = newest.event;
            for record in &page {
                let topic = Topic::of(&record.kind);
                let news = News { event: record.event, topic, bytes: of_record(record) };
                // Nobody may listen any more.
                _ = hub.news.send(news);
            }
        }
        let is_over = tokio::select! {
            changed = status.changed() => changed.is_err(),
            () = shared.inner.closing.cancelled() => true,
        };
        if is_over {
            return;
        }
    }
}
