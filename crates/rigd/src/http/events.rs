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
use schemars::JsonSchema;
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
    /// The last event before the stream was opened, until the client has been told that it has all of
    /// them.
    live_from: Option<u64>,
    /// Only events of these topics; all if it is empty.
    topics: Vec<Topic>,
    /// One of the streams that may be open at a time.
    _place: OwnedSemaphorePermit,
}

/// Options of the event stream.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct StreamOptions {
    /// The rig whenever it changes, and the readings of the sweep under way.
    #[serde(default)]
    live: bool,
    /// Without an id: how many of the last records of this session come first.
    #[serde(default)]
    back: u16,
    /// Only events of these topics, separated by commas: `run`, `step`, `person`, `motion`, `measurement`,
    /// `fault`, `state`. Without it, all.
    #[serde(default)]
    topics: String,
}

/// A topic of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Topic {
    Run,
    Step,
    Person,
    Motion,
    Measurement,
    Fault,
    State,
}

impl Topic {
    const ALL: [(&str, Self); 7] = [
        ("run", Self::Run),
        ("step", Self::Step),
        ("person", Self::Person),
        ("motion", Self::Motion),
        ("measurement", Self::Measurement),
        ("fault", Self::Fault),
        ("state", Self::State),
    ];

    /// The topics in a list.
    fn read(list: &str) -> Result<Vec<Self>, Problem> {
        let names = list.split(',').map(str::trim).filter(|name| !name.is_empty());
        let topic = |name: &str| {
            let known = Self::ALL.into_iter().find(|(known, _)| *known == name);
            known.map(|(_, topic)| topic).ok_or_else(|| {
                let all = Self::ALL.map(|(known, _)| known).join(", ");
                Problem::bad_request(format!("`{name}` is not a topic; the topics are {all}"))
            })
        };
        names.map(topic).collect()
    }

    /// The topic of a kind of record.
    fn of(kind: &str) -> Self {
        match kind {
            "step_started" => Self::Step,
            "prompt_asked" | "prompt_answered" | "refusal_asked" | "refusal_answered"
            | "operator" => Self::Person,
            "intent" | "moved" => Self::Motion,
            "surface_found" | "surface_not_found" | "surface_checked" | "sweep"
            | "touch_result" | "touch_refused" => Self::Measurement,
            "fault" | "retract_tried" | "black_box" | "stalled" | "clock_jumped" => Self::Fault,
            "state_changed" => Self::State,
            _ => Self::Run,
        }
    }
}

/// What a stream sends next.
enum Next {
    Record(Box<StoredRecord>),
    /// Everything from before the stream was opened has been sent.
    Live {
        last_event: u64,
    },
}

pub(super) async fn stream(
    State(shared): State<Shared>,
    options: Result<Query<StreamOptions>, QueryRejection>,
    headers: HeaderMap,
) -> Result<impl IntoResponse, Problem> {
    let Query(StreamOptions { live, back, topics }) = options?;
    let topics = Topic::read(&topics)?;
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
    let live_from = Some(status.borrow().last_event);
    let live = live.then(|| live::stream(shared.clone()));
    let cursor =
        Cursor { shared, status, last, page: VecDeque::new(), live_from, topics, _place: place };
    let live = stream::iter(live).flatten();
    let events = stream::select(live, events(cursor)).take_until(closing.cancelled_owned());
    Ok(Sse::new(events).keep_alive(KeepAlive::default()))
}

fn events(cursor: Cursor) -> impl Stream<Item = Result<Event, Infallible>> {
    stream::unfold(cursor, |mut cursor| async move {
        let event = match cursor.next().await? {
            Next::Record(record) => {
                let text = format!(
                    r#"{{"run":"{}","seq":{},"rig_us":{},"record":{}}}"#,
                    record.run, record.seq, record.rig_us, record.payload
                );
                Event::default().id(record.event.to_string()).event(record.kind).data(text)
            }
            Next::Live { last_event } => {
                Event::default().event("now_live").data(format!(r#"{{"last_event":{last_event}}}"#))
            }
        };
        Some((Ok(event), cursor))
    })
}

impl Cursor {
    /// The next record, as soon as there is one; none when the rig or its journal has gone.
    async fn next(&mut self) -> Option<Next> {
        loop {
            while let Some(record) = self.page.pop_front() {
                self.last = record.event;
                if self.topics.is_empty() || self.topics.contains(&Topic::of(&record.kind)) {
                    return Some(Next::Record(Box::new(record)));
                }
            }
            if let Some(last_event) = self.live_from.take_if(|before| self.last >= *before) {
                return Some(Next::Live { last_event });
            }
            // The wait below notices later commits.
            self.status.mark_unchanged();
            let last = self.last;
            let page = self.shared.read(move |reader| Ok(reader.events_after(last, PAGE)?)).await;
            self.page = page.ok()?.into();
            if self.page.is_empty() {
                // Nothing is missing: an id beyond the journal, or a journal without records.
                if let Some(last_event) = self.live_from.take() {
                    return Some(Next::Live { last_event });
                }
                self.status.changed().await.ok()?;
            }
        }
    }
}
