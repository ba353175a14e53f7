//! Everything that happens, as server-sent events.
//!
//! An event is a record of the journal, and its id is that record's place in the journal. A client
//! that lost its connection sends the last id it saw and misses nothing.

use std::{collections::VecDeque, convert::Infallible, time::Duration};

use axum::{
    Extension,
    body::{Body, Bytes},
    extract::{Query, State, rejection::QueryRejection},
    http::{HeaderMap, header},
    response::{IntoResponse, Response},
};
use futures_util::{Stream, StreamExt, stream};
use rig_store::StoredRecord;
use schemars::JsonSchema;
use serde::Deserialize;
use tokio::{
    sync::{
        broadcast::{self, error::RecvError},
        watch,
    },
    time::timeout,
};

use super::{
    Problem, Shared,
    access::Client,
    hub::{Heard, News},
    live,
    places::Place,
};
use crate::rig::Status;

/// Records read at a time by a stream that is behind, which is the most that a slow client can hold.
const PAGE: u32 = 16;
/// A comment comes after so long a silence.
const SILENCE: Duration = Duration::from_secs(15);
const COMMENT: Bytes = Bytes::from_static(b":\n\n");

/// The position of a stream.
struct Cursor {
    shared: Shared,
    status: watch::Receiver<Status>,
    last: u64,
    page: VecDeque<StoredRecord>,
    /// Events as they come, one copy for all streams.
    news: broadcast::Receiver<News>,
    /// Events are read from the journal, up to those that come.
    is_behind: bool,
    /// The last event before the stream was opened, until the client has been told that it has all of
    /// them.
    live_from: Option<u64>,
    /// Only events of these topics; all if it is empty.
    topics: Vec<Topic>,
    /// One of the streams that may be open at a time.
    _place: Place,
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
pub(super) enum Topic {
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

    /// The topic of a kind of record. A kind of a later version is about its run.
    pub(super) fn of(kind: &str) -> Self {
        Self::of_known(kind).unwrap_or(Self::Run)
    }

    fn of_known(kind: &str) -> Option<Self> {
        Some(match kind {
            "run_started" | "run_finished" | "resumed" | "given_up" | "amended" | "archived" => {
                Self::Run
            }
            "step_started" => Self::Step,
            "prompt_asked" | "prompt_answered" | "refusal_asked" | "refusal_answered"
            | "operator" => Self::Person,
            "intent" | "moved" => Self::Motion,
            "descended" | "surface_found" | "surface_not_found" | "surface_checked" | "sweep"
            | "touch_result" | "touch_refused" | "reference_jumped" => Self::Measurement,
            "fault" | "retract_tried" | "black_box" | "stalled" | "clock_jumped" => Self::Fault,
            "state_changed" => Self::State,
            _ => return None,
        })
    }
}

pub(super) async fn stream(
    State(shared): State<Shared>,
    Extension(client): Extension<Client>,
    options: Result<Query<StreamOptions>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Query(StreamOptions { live, back, topics }) = options?;
    let topics = Topic::read(&topics)?;
    let place = shared.inner.streams.take(&client)?;
    let status = shared.inner.rig.status();
    // Before the journal is read: what is written from here on is not missed.
    let Heard { news, moments } = shared.inner.hub.listen(&shared);
    let [first, newest] = {
        let status = status.borrow();
        [status.first_event, status.last_event]
    };
    let last = match headers.get("last-event-id") {
        // Without an id the stream begins with what happens from now on.
        None => {
            let before = if first == 0 { newest } else { first - 1 };
            newest.saturating_sub(u64::from(back)).max(before)
        }
        Some(id) => {
            let seen: Option<u64> = id.to_str().ok().and_then(|id| id.parse().ok());
            let not_a_number =
                || Problem::bad_request(format!("Last-Event-ID {id:?} is not a number"));
            // An id beyond the journal is of a journal that was replaced by a backup: what happens from now on is news.
            seen.ok_or_else(not_a_number)?.min(newest)
        }
    };
    let closing = shared.inner.closing.clone();
    let live = live.then(|| live::stream(shared.clone(), moments));
    let cursor = Cursor {
        shared,
        status,
        last,
        page: VecDeque::new(),
        news,
        is_behind: last < newest,
        live_from: Some(newest),
        topics,
        _place: place,
    };
    let live = stream::iter(live).flatten();
    let events = stream::select(live, events(cursor)).take_until(closing.cancelled_owned());
    let headers =
        [(header::CONTENT_TYPE, "text/event-stream"), (header::CACHE_CONTROL, "no-cache")];
    Ok((headers, Body::from_stream(events.map(Ok::<_, Infallible>))).into_response())
}

/// An event as it is sent. JSON has no line breaks.
pub(super) fn encoded(id: Option<u64>, name: &str, json: &str) -> Bytes {
    let id = id.map(|id| format!("id: {id}\n")).unwrap_or_default();
    format!("{id}event: {name}\ndata: {json}\n\n").into()
}

/// The event of a record.
pub(super) fn of_record(record: &StoredRecord) -> Bytes {
    let StoredRecord { run, seq, rig_us, payload, .. } = record;
    let json = format!(r#"{{"run":"{run}","seq":{seq},"rig_us":{rig_us},"record":{payload}}}"#);
    encoded(Some(record.event), &record.kind, &json)
}

fn events(cursor: Cursor) -> impl Stream<Item = Bytes> {
    stream::unfold(cursor, |mut cursor| async move {
        let event = match timeout(SILENCE, cursor.next()).await {
            Ok(event) => event?,
            Err(_) => COMMENT,
        };
        Some((event, cursor))
    })
}

impl Cursor {
    /// The next event, as soon as there is one; none when the rig or its journal has gone. If this is dropped
    /// while it waits, nothing is lost.
    async fn next(&mut self) -> Option<Bytes> {
        loop {
            while let Some(record) = self.page.pop_front() {
                self.last = record.event;
                if self.wants(Topic::of(&record.kind)) {
                    return Some(of_record(&record));
                }
            }
            if let Some(last_event) =
                self.live_from.take_if(|before| !self.is_behind || self.last >= *before)
            {
                let json = format!(r#"{{"last_event":{last_event}}}"#);
                return Some(encoded(None, "now_live", &json));
            }
            if self.is_behind {
                let last = self.last;
                let page =
                    self.shared.read(move |reader| Ok(reader.events_after(last, PAGE)?)).await;
                self.page = page.ok()?.into();
                self.is_behind = !self.page.is_empty();
                continue;
            }
            // The rig has gone, and no event says so.
            self.status.has_changed().ok()?;
            match self.news.recv().await {
                Ok(news) if news.event > self.last => {
                    self.last = news.event;
                    if self.wants(news.topic) {
                        return Some(news.bytes);
                    }
                }
                Ok(_) => {}
                // The client is slow: the journal has what it missed.
                Err(RecvError::Lagged(_)) => self.is_behind = true,
                Err(RecvError::Closed) => return None,
            }
        }
    }

    fn wants(&self, topic: Topic) -> bool {
        self.topics.is_empty() || self.topics.contains(&topic)
    }
}

#[cfg(test)]
mod tests {
    use rig_store::Record;

    use super::*;

    #[test]
    fn every_kind_of_record_has_a_topic() {
        // The reader of records names all of their kinds.
        let unknown = serde_json::from_str::<Record>(r#"{"kind": "x"}"#).unwrap_err().to_string();
        let (_, kinds) = unknown.split_once("expected one of ").unwrap();
        let kinds: Vec<_> = kinds.split('`').skip(1).step_by(2).collect();
        assert!(kinds.contains(&"run_started") && kinds.contains(&"run_finished"), "{unknown}");
        for kind in kinds {
            assert!(Topic::of_known(kind).is_some(), "{kind}");
        }
        assert_eq!(Topic::of("reference_jumped"), Topic::Measurement);
        assert_eq!(Topic::of("of a later version"), Topic::Run);
    }
}
