//! Tells what a rig does, for as long as it is open.
//!
//! ```text
//!   connect ─▶ state and new events ─▶ wait for news, or repeat the state every 2 s
//!      ▲                │ any failure
//!      └── wait 1 s, 2 s, … 30 s: what happens meanwhile is not told
//! ```

use std::{path::Path, time::Duration};

use async_nats::PublishErrorKind;
use rig_model::with_causes;
use rig_store::{Reader, StoredRecord};
use tokio::{
    sync::watch,
    time::{sleep, timeout},
};

use super::{Broker, LiveError, Subjects, broker::Line};
use crate::{
    BenchName,
    retry::{Waits, closed},
};

/// A state is repeated after this time, so that a viewer that comes sees all rigs soon, and one that is gone is missed.
pub(super) const REPEAT_EVERY: Duration = Duration::from_secs(2);
/// Time between two states at least; what is recorded within it is sent together.
const TOGETHER: Duration = Duration::from_millis(200);
/// Time in which the line must take what is sent.
const SEND_TIME: Duration = Duration::from_secs(10);
/// Longest time between two attempts: a viewer waits for it.
const WAIT_MAX: Duration = Duration::from_secs(30);
/// Events that are sent together at most. What comes faster is left out: a rig at real pace records some two a second.
const EVENTS_MAX: u32 = 256;

/// How the live messages of a rig stand.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LiveStanding {
    /// Whether the server was there last.
    pub is_connected: bool,
    /// Messages that were sent since the start.
    pub messages: u64,
    /// Events that were left out since the start, because they came too fast, were too large, or came without a connection.
    pub left_out: u64,
    /// Attempts that failed since the start.
    pub failures: u64,
    /// Why the last attempt failed, until one succeeds.
    pub error: Option<String>,
}

/// Sends the state of a rig and the events of its journal in `data` until nobody has `news` any more. `state` makes the
/// document of a state. It never fails for good: `standing` says how it stands.
pub async fn publish<T: Clone>(
    to: &Broker,
    bench: &BenchName,
    data: &Path,
    mut news: watch::Receiver<T>,
    state: impl Fn(&T) -> String,
    standing: &watch::Sender<LiveStanding>,
) {
    let mut waits = Waits::up_to(WAIT_MAX);
    let mut last = None;
    loop {
        let before = standing.borrow().messages;
        let to_bench = Publisher { to, subjects: Subjects::of(bench), data, standing };
        let Err(error) = to_bench.passage(&mut news, &state, &mut last).await else { return };
        standing.send_modify(|standing| {
            standing.is_connected = false;
            standing.failures += 1;
            standing.error = Some(with_causes(&error));
        });
        if standing.borrow().messages > before {
            waits.begin_anew();
        }
        tokio::select! {
            () = sleep(waits.next()) => {}
            () = closed(&mut news) => return,
        }
    }
}

struct Publisher<'a> {
    to: &'a Broker,
    subjects: Subjects,
    data: &'a Path,
    standing: &'a watch::Sender<LiveStanding>,
}

impl Publisher<'_> {
    /// Sends over one connection. `last` is the last event that was sent or left out.
    async fn passage<T: Clone>(
        &self,
        news: &mut watch::Receiver<T>,
        state: &impl Fn(&T) -> String,
        last: &mut Option<u64>,
    ) -> Result<(), LiveError> {
        let reader = Reader::open(self.data)?;
        // What was there before the start is no news.
        let mut sent = match *last {
            Some(last) => last,
            None => *last.insert(reader.last_event()?),
        };
        let mut line = self.to.connect().await?;
        // Nor is what has happened without a connection.
        self.leave_out(&mut sent, reader.last_event()?);
        *last = Some(sent);
        loop {
            let has_closed = news.has_changed().is_err();
            // A copy: a borrowed status holds up the rig thread.
            let present = news.borrow_and_update().clone();
            let send = self.send(&line, &reader, &mut sent, state(&present));
            let messages = timeout(SEND_TIME, send).await??;
            *last = Some(sent);
            self.standing.send_modify(|standing| {
                standing.is_connected = true;
                standing.messages += messages;
                standing.error = None;
            });
            if has_closed {
                return Ok(());
            }
            tokio::select! {
                error = line.trouble() => return Err(error),
                () = sleep(TOGETHER) => {}
            }
            tokio::select! {
                error = line.trouble() => return Err(error),
                _ = news.changed() => {}
                () = sleep(REPEAT_EVERY.saturating_sub(TOGETHER)) => {}
            }
        }
    }

    /// Sends the events behind `sent` and the state, and returns the number of messages.
    async fn send(
        &self,
        line: &Line,
        reader: &Reader,
        sent: &mut u64,
        state: String,
    ) -> Result<u64, LiveError> {
        let newest = reader.last_event()?;
        self.leave_out(sent, newest.saturating_sub(u64::from(EVENTS_MAX)));
        let mut messages = 0;
        for record in reader.events_after(*sent, EVENTS_MAX)? {
            let subject = self.subjects.events(&record.kind);
            match line.client.publish(subject, document(&record).into()).await {
                Ok(()) => messages += 1,
                Err(error) if error.kind() == PublishErrorKind::MaxPayloadExceeded => {
                    self.standing.send_modify(|standing| standing.left_out += 1);
                }
                Err(error) => return Err(error.into()),
            }
            *sent = record.event;
        }
        line.client.publish(self.subjects.state(), state.into()).await?;
        line.client.flush().await?;
        Ok(messages + 1)
    }

    /// Goes on behind an event, if it is not sent yet.
    fn leave_out(&self, sent: &mut u64, event: u64) {
        let left_out = event.saturating_sub(*sent);
        if left_out > 0 {
            self.standing.send_modify(|standing| standing.left_out += left_out);
            *sent = event;
        }
    }
}

/// An event as viewers get it.
fn document(record: &StoredRecord) -> String {
    let StoredRecord { event, run, seq, rig_us, payload, .. } = record;
    format!(r#"{{"event":{event},"run":"{run}","seq":{seq},"rig_us":{rig_us},"record":{payload}}}"#)
}
