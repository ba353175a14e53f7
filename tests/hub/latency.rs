//! How long after it is in the journal of a rig a record is seen by others: in the hub, and by a viewer of live messages.

use std::{
    collections::BTreeMap,
    path::Path,
    sync::mpsc,
    thread,
    time::{Duration, Instant},
};

use rig_hub::live::{Scope, Watch};
use rig_store::{Reader, RunKind, Store};
use serde::Deserialize;
use tempfile::TempDir;
use tokio::{sync::watch, time::sleep};

use crate::{
    figures::Spread,
    support::{Hub, append, frames, server},
    telling::Nats,
    worker::{HubArgs, ship_on_thread, tell_on_thread},
};

/// Time between two looks at the hub.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// Time in which the last record must be seen.
const LAST_WITHIN: Duration = Duration::from_secs(60);

/// When each event was written or seen.
type Times = BTreeMap<u64, Instant>;

/// Lets a rig record at these times, µs, and prints when its records are seen. It ships and tells as rigd does.
pub(crate) async fn print(
    hub: &Hub,
    nats: &Nats,
    name: &str,
    times_us: &[u64],
    duration: Duration,
) {
    let role = hub.bench(name).await;
    let files = server().certify(&role).unwrap();
    let _server = nats.start(hub).await;
    let data = TempDir::new().unwrap();
    let address = ([127, 0, 0, 1], server().port()).into();
    let args = HubArgs::new(address, &hub.database, &role, &files);

    let (news, of_rig) = watch::channel(0);
    let (end, ended) = watch::channel(None);
    let (begin, may_begin) = mpsc::channel();
    let (all_seen, may_end) = mpsc::channel();
    let writer = {
        let (data, times_us) = (data.path().to_owned(), times_us.to_owned());
        let may = [may_begin, may_end];
        thread::spawn(move || write(&data, &times_us, duration, &may, &news, &end))
    };
    // The rig has made its journal.
    of_rig.clone().changed().await.unwrap();
    let journal = Reader::open(data.path()).unwrap().identity().unwrap().0;
    let _shipping = ship_on_thread(&args, data.path(), of_rig.clone());
    let state = |event: &u64| format!("{{\"event\":{event}}}");
    let (_telling, mut standing) = tell_on_thread(nats.port(), &args, data.path(), of_rig, state);
    let mut heard = Watch::open(&nats.viewer(), &Scope::All).await.unwrap();
    standing.wait_for(|standing| standing.is_connected).await.unwrap();
    begin.send(()).unwrap();
    let (in_hub, by_viewer) =
        tokio::join!(look(hub, &journal, ended.clone()), listen(&mut heard, ended));
    all_seen.send(()).unwrap();
    let written = writer.join().unwrap();
    told("in PostgreSQL, where the page reads it", &written, &in_hub);
    told("at a viewer, by NATS", &written, &by_viewer);
}

/// Records at these times until the duration is over, once it may begin, and closes the journal when it may end. `news` has
/// the last event, and `end` the last of all.
fn write(
    data: &Path,
    times_us: &[u64],
    duration: Duration,
    [may_begin, may_end]: &[mpsc::Receiver<()>; 2],
    news: &watch::Sender<u64>,
    end: &watch::Sender<Option<u64>>,
) -> Times {
    let store = Store::open(data).unwrap();
    let mut session = store.begin(RunKind::Session, "session").unwrap();
    append(&mut session, &[frames()]);
    let reader = Reader::open(data).unwrap();
    let mut event = reader.last_event().unwrap();
    news.send_replace(event);
    may_begin.recv().unwrap();
    let (began, mut written) = (Instant::now(), Times::new());
    for due in times_us.iter().map(|time| Duration::from_micros(*time)) {
        if due >= duration {
            break;
        }
        thread::sleep(due.saturating_sub(began.elapsed()));
        append(&mut session, &[frames()]);
        event += 1;
        written.insert(event, Instant::now());
        news.send_replace(event);
    }
    assert_eq!(reader.last_event().unwrap(), event);
    end.send_replace(Some(event));
    may_end.recv().unwrap();
    written
}

/// When each event was committed in the hub.
async fn look(hub: &Hub, journal: &str, ended: watch::Receiver<Option<u64>>) -> Times {
    let client = hub.another().await;
    let select = "SELECT cursor_event FROM hub.journal WHERE id = $1::text::uuid";
    let select = client.prepare(select).await.unwrap();
    let mut seen = Times::new();
    let mut last = 0;
    let mut until = None;
    loop {
        let row = client.query_opt(&select, &[&journal]).await.unwrap();
        let event = row.map_or(0, |row| row.get::<_, i64>(0).cast_unsigned());
        let now = Instant::now();
        seen.extend((last + 1..=event).map(|event| (event, now)));
        last = last.max(event);
        if let Some(end) = *ended.borrow() {
            if last >= end {
                return seen;
            }
            let until = *until.get_or_insert(now + LAST_WITHIN);
            assert!(now < until, "the hub has event {last} of {end}");
        }
        sleep(LOOK_EVERY).await;
    }
}

/// When a viewer has heard of each event.
async fn listen(watch: &mut Watch, mut ended: watch::Receiver<Option<u64>>) -> Times {
    #[derive(Deserialize)]
    struct Document {
        event: u64,
    }
    let mut seen = Times::new();
    let mut end = None;
    let mut until = tokio::time::Instant::now() + LAST_WITHIN;
    loop {
        if end.is_some_and(|end| seen.contains_key(&end)) {
            return seen;
        }
        let next = tokio::time::timeout_at(until, watch.next());
        let heard = tokio::select! {
            heard = next => heard.expect("a viewer hears nothing").unwrap(),
            Ok(()) = ended.changed() => {
                end = *ended.borrow();
                until = tokio::time::Instant::now() + LAST_WITHIN;
                continue;
            }
        };
        if heard.kind.is_some() {
            let Document { event } = serde_json::from_str(&heard.document).unwrap();
            seen.entry(event).or_insert_with(Instant::now);
            if end.is_none() {
                until = tokio::time::Instant::now() + LAST_WITHIN;
            }
        }
    }
}

fn told(where_seen: &str, written: &Times, seen: &Times) {
    let since = |(event, written): (&u64, &Instant)| {
        let seen = seen.get(event)?.saturating_duration_since(*written);
        Some(seen.as_secs_f32() * 1e3)
    };
    let ms: Vec<f32> = written.iter().filter_map(since).collect();
    let missing = written.len() - ms.len();
    println!("  {where_seen}: {} of {} records, {missing} not seen", Spread::of(ms), written.len());
}
