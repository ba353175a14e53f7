//! Everything that happens, as server-sent events.
//!
//! An event is a record of the journal, and its id is that record's place in the journal. A client
//! that lost its connection sends the last id it saw and misses nothing.

use std::{collections::VecDeque, convert::Infallible, sync::Arc};

use axum::{
    extract::{Query, State, rejection::QueryRejection},
    http::HeaderMap,
    response::{
        IntoResponse, Sse,
        sse::{Event, KeepAlive},
    },
};
use futures_util::{Stream, StreamExt, stream};
use rig_store::StoredRecord;
use serde::Deserialize;
use tokio::sync::{OwnedSemaphorePermit, watch};

use super::{Problem, Shared, live};
use crate::rig::Status;

/// Records read at a time, which is the most that a slow client can hold.
const PAGE: u32 = 16;

/// Each page and each program has one stream; this leaves room for some of both.
pub(super) const STREAMS_MAX: usize = 32;

/// The position of a stream.
struct Cursor {
    shared: Shared,
    status: watch::Receiver<Status>,
    last: u64,
    page: VecDeque<StoredRecord>,
    /// One of the streams that may be open at a time.
    _place: OwnedSemaphorePermit,
}

/// Options of the event stream.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StreamOptions {
    /// The rig whenever it changes, and the readings of the sweep under way.
    #[serde(default)]
    live: bool,
    /// Without an id: how many of the last records of this session come first.
    #[serde(default)]
    back: u16,
}

pub(super) async fn stream(
    State(shared): State<Shared>,
    options: Result<Query<StreamOptions>, QueryRejection>,
    headers: HeaderMap,
) -> Result<impl IntoResponse, Problem> {
    let Query(StreamOptions { live, back }) = options?;
    let place = Arc::clone(&shared.inner.streams).try_acquire_owned().map_err(|_| {
        Problem::busy(format!("{STREAMS_MAX} event streams are open, which is the limit"))
    })?;
    let status = shared.inner.rig.status();
    let last =
        match headers.get("last-event-id") {
            // Without an id the stream begins with what happens from now on.
            None => {
                let status = status.borrow();
                let before = status.first_event.saturating_sub(1);
                status.last_event.saturating_sub(u64::from(back)).max(before)
            }
            Some(id) => id.to_str().ok().and_then(|id| id.parse().ok()).ok_or_else(|| {
                Problem::bad_request(format!("Last-Event-ID {id:?} is not a number"))
            })?,
        };
    let closing = shared.inner.closing.clone();
    let live = live.then(|| live::stream(shared.clone()));
    let cursor = Cursor { shared, status, last, page: VecDeque::new(), _place: place };
    let live = stream::iter(live).flatten();
    let events = stream::select(live, events(cursor)).take_until(closing.cancelled_owned());
    Ok(Sse::new(events).keep_alive(KeepAlive::default()))
}

fn events(cursor: Cursor) -> impl Stream<Item = Result<Event, Infallible>> {
    stream::unfold(cursor, |mut cursor| async move {
        let record = cursor.next().await?;
        let text = format!(
            r#"{{"run":"{}","seq":{},"rig_us":{},"record":{}}}"#,
            record.run, record.seq, record.rig_us, record.payload
        );
        let event = Event::default().id(record.event.to_string()).event(record.kind).data(text);
        Some((Ok(event), cursor))
    })
}

impl Cursor {
    /// The next record, as soon as there is one; none when the rig or its journal has gone.
    async fn next(&mut self) -> Option<StoredRecord> {
        loop {
            if let Some(record) = self.page.pop_front() {
                self.last = record.event;
                return Some(record);
            }
            // The wait below notices later commits.
            self.status.mark_unchanged();
            let last = self.last;
            let page = self.shared.read(move |reader| Ok(reader.events_after(last, PAGE)?)).await;
            self.page = page.ok()?.into();
            if self.page.is_empty() {
                self.status.changed().await.ok()?;
            }
        }
    }
}
