//! What a bench ships is in the hub as its journal has it, and nothing else gets there.

use rig_hub::{Batch, Inlet, InletError};
use rig_store::{Ending, Reader, Record, Resumed, RunKind, Shipment, Store};
use tempfile::TempDir;
use tokio_postgres::Client;

use crate::support::{Hub, append, assert_same, command, contents_of, finished, frames, journal};

/// What PostgreSQL calls the error of an ingest.
async fn refusal(client: &Client, journal: &str, batch: &Batch) -> String {
    let ingest = "SELECT hub.ingest($1::text::uuid, $2, $3::text::json)::text";
    let after = batch.after_event.cast_signed();
    match client.query_one(ingest, &[&journal, &after, &batch.json()]).await {
        Ok(row) => format!("taken: {}", row.get::<_, &str>(0)),
        Err(error) => error.code().unwrap().code().to_owned(),
    }
}

#[tokio::test]
async fn every_byte_of_a_journal_arrives() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let (data, store, mut session) = journal();
    hub.ship(&role, data.path()).await.unwrap();
    assert_same(&hub.contents().await, &contents_of(data.path()));
    append(&mut session, &[command("go on"), finished(Ending::Completed)]);
    let mut run = store.begin(RunKind::Run, "aborted").unwrap();
    append(&mut run, &[command("begin"), finished(Ending::Aborted)]);
    let last = hub.ship(&role, data.path()).await.unwrap();
    assert_same(&hub.contents().await, &contents_of(data.path()));
    // The run goes on in another stretch, and is sealed.
    store.give_up(run.id(), 7, "ada").unwrap();
    drop((session, run, store));
    let store = Store::open(data.path()).unwrap();
    assert!(hub.ship(&role, data.path()).await.unwrap() > last);
    assert_same(&hub.contents().await, &contents_of(data.path()));
    assert_eq!(hub.alarms().await, [""; 0]);
    assert_eq!(hub.count("hub.run WHERE seal IS NOT NULL").await, 4);
    drop(store);
}

#[tokio::test]
async fn a_run_that_is_resumed_is_running_again() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let data = TempDir::new().unwrap();
    let store = Store::open(data.path()).unwrap();
    let mut run = store.begin(RunKind::Run, "resumed").unwrap();
    append(&mut run, &[command("begin"), finished(Ending::Aborted)]);
    hub.ship(&role, data.path()).await.unwrap();
    assert_eq!(hub.count("hub.run WHERE status = 'aborted' AND finished_at IS NOT NULL").await, 1);
    let mut run = store.reopen(run.id()).unwrap();
    let resumed = Record::Resumed(Resumed {
        epoch: store.epoch().unwrap(),
        who: "ada".to_owned(),
        next: None,
        touches_done: 0,
        touches_left: 1,
        changes: Vec::new(),
        software: "rigd 0".to_owned(),
        rig: None,
        scene: None,
        calibrations: None,
        devices: Vec::new(),
    });
    append(&mut run, &[resumed]);
    hub.ship(&role, data.path()).await.unwrap();
    assert_eq!(hub.count("hub.run WHERE status = 'running' AND finished_at IS NULL").await, 1);
    assert_same(&hub.contents().await, &contents_of(data.path()));
    append(&mut run, &[finished(Ending::Completed)]);
    hub.ship(&role, data.path()).await.unwrap();
    assert_same(&hub.contents().await, &contents_of(data.path()));
    assert_eq!(hub.count("hub.run WHERE seal IS NOT NULL").await, 1);
    assert_eq!(hub.alarms().await, [""; 0]);
}

#[tokio::test]
async fn a_batch_is_taken_once_and_a_gap_is_refused() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let (data, _store, _session) = journal();
    let reader = Reader::open(data.path()).unwrap();
    let (id, _) = reader.identity().unwrap();
    let client = hub.as_role(&role).await;
    let batch = |after: u64, records: u32| {
        let digest = reader.digest_of_event(after).unwrap();
        let digest = digest.map(|digest| digest.to_string()).unwrap_or_default();
        let shipment = reader.shipment(after, records, usize::MAX).unwrap();
        (Batch::new(after, &digest, &shipment).unwrap(), shipment)
    };
    let (first, _) = batch(0, 10);
    assert_eq!(refusal(&client, &id, &first).await, "42501", "nobody has greeted");
    drop(Inlet::open(hub.as_role(&role).await, &reader, "rigd 0").await.unwrap());
    assert_eq!(refusal(&client, &id, &batch(5, 5).0).await, "HB002", "behind the cursor");
    for _ in 0..2 {
        assert!(refusal(&client, &id, &first).await.starts_with("taken: (10,"));
    }
    // The same again, and a part of it with what comes next.
    assert!(refusal(&client, &id, &batch(3, 20).0).await.starts_with("taken: (23,"));
    let whole = hub.contents().await;
    assert!(
        refusal(&client, &id, &first).await.starts_with("taken: (23,"),
        "the cursor never goes back"
    );
    assert_same(&hub.contents().await, &whole);

    let (_, mut shipment) = batch(23, 10);
    shipment.records.remove(4);
    let digest = reader.digest_of_event(23).unwrap().unwrap().to_string();
    let gap = Batch::new(23, &digest, &shipment).unwrap();
    assert_eq!(refusal(&client, &id, &gap).await, "HB002", "a record is missing");
    shipment.records[1].event = shipment.records[0].event;
    let twice = Batch::new(23, &digest, &shipment).unwrap();
    assert_eq!(refusal(&client, &id, &twice).await, "HB004", "two records of one event");
    let other = Batch::new(23, &"00".repeat(32), &Shipment::default()).unwrap();
    assert_eq!(refusal(&client, &id, &other).await, "HB003", "another record at the cursor");
    assert_same(&hub.contents().await, &whole);
    hub.ship(&role, data.path()).await.unwrap();
    assert_same(&hub.contents().await, &contents_of(data.path()));
    assert_eq!(hub.alarms().await, [""; 0]);
}

#[tokio::test]
async fn a_record_that_does_not_fit_is_put_aside_and_other_runs_go_on() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let (data, _store, _session) = journal();
    let reader = Reader::open(data.path()).unwrap();
    let (id, _) = reader.identity().unwrap();
    let mut inlet = Inlet::open(hub.as_role(&role).await, &reader, "rigd 0").await.unwrap();
    let mut shipment = reader.shipment(0, 2000, usize::MAX).unwrap();
    // In the first run, one character of a record is another one.
    let poisoned = shipment.records[2].clone();
    shipment.records[2].payload = poisoned.payload.replace("ada", "eve");
    assert_ne!(shipment.records[2].payload, poisoned.payload);
    inlet.send(&Batch::new(0, "", &shipment).unwrap()).await.unwrap();
    assert_eq!(inlet.cursor().event, reader.last_event().unwrap());
    let kept = format!("hub.record WHERE run = '{}'", poisoned.run);
    assert_eq!(hub.count(&kept).await, 1, "the run stops before the record");
    assert_eq!(hub.count("hub.clash").await, 4, "the record and those behind it are kept");
    assert_eq!(hub.alarms().await, ["clash"]);
    assert_eq!(hub.count("hub.run WHERE seal IS NOT NULL").await, 1, "the other run is whole");

    // The right record heals it.
    let client = hub.as_role(&role).await;
    let right = reader.shipment(0, 2000, usize::MAX).unwrap();
    let again = Batch::new(0, "", &right).unwrap();
    assert!(refusal(&client, &id, &again).await.starts_with("taken: "));
    assert_same(&hub.contents().await, &contents_of(data.path()));
}

#[tokio::test]
async fn a_forged_seal_and_a_record_behind_a_seal_are_not_taken() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let (data, _store, _session) = journal();
    let reader = Reader::open(data.path()).unwrap();
    let mut inlet = Inlet::open(hub.as_role(&role).await, &reader, "rigd 0").await.unwrap();
    let mut shipment = reader.shipment(0, 2000, usize::MAX).unwrap();
    assert_eq!(shipment.ends.len(), 2);
    shipment.ends[0].finished_at = "2020-01-01T00:00:00.000Z".to_owned();
    inlet.send(&Batch::new(0, "", &shipment).unwrap()).await.unwrap();
    assert_eq!(hub.count("hub.run WHERE seal IS NOT NULL").await, 1);
    assert_eq!(hub.alarms().await, ["clash"]);

    let (run, end) = (shipment.ends[1].run, shipment.ends[1].clone());
    let (event, digest) = (inlet.cursor().event, inlet.cursor().digest.clone());
    let mut behind = shipment.records.last().unwrap().clone();
    behind.run = run;
    behind.event = event + 1;
    behind.seq = end.records + 1;
    behind.digest = end.head.next(behind.seq, behind.rig_us, &behind.kind, &behind.payload);
    let entries = shipment.entries.into_iter().filter(|entry| entry.run == run.to_string());
    let shipment =
        Shipment { entries: entries.collect(), records: vec![behind], ..Shipment::default() };
    inlet.send(&Batch::new(event, &digest, &shipment).unwrap()).await.unwrap();
    assert_eq!(hub.count("hub.clash WHERE reason = 'the run is sealed'").await, 1);
    assert_eq!(
        hub.count(&format!("hub.record WHERE run = '{run}'")).await,
        end.records.cast_signed()
    );
}

#[tokio::test]
async fn a_seal_without_the_time_of_the_end_is_not_taken() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let (data, _store, _session) = journal();
    let reader = Reader::open(data.path()).unwrap();
    let (id, _) = reader.identity().unwrap();
    let shipment = reader.shipment(0, 2000, usize::MAX).unwrap();
    let batch = Batch::new(0, "", &shipment).unwrap();
    let mut document: serde_json::Value = serde_json::from_str(batch.json()).unwrap();
    let end = &mut document["ends"][0];
    end["finished_at"] = serde_json::Value::Null;
    end["seal"] = "00".repeat(32).into();
    drop(Inlet::open(hub.as_role(&role).await, &reader, "rigd 0").await.unwrap());
    let client = hub.as_role(&role).await;
    let ingest = "SELECT hub.ingest($1::text::uuid, 0, $2::text::json)::text";
    client.query_one(ingest, &[&id, &document.to_string()]).await.unwrap();
    assert_eq!(hub.count("hub.run WHERE seal IS NOT NULL").await, 1, "the other run is sealed");
    assert_eq!(hub.alarms().await, ["clash"]);
}

#[tokio::test]
async fn runs_with_the_same_digests_do_not_meet() {
    let hub = Hub::new().await;
    let (left, right) = (hub.bench("left").await, hub.bench("right").await);
    let (mine, _store, _session) = journal();
    let (theirs, _other, _session) = journal();
    let (first, second) =
        tokio::join!(hub.ship(&left, mine.path()), hub.ship(&right, theirs.path()));
    assert_eq!(first.unwrap(), second.unwrap());
    let mut both = contents_of(mine.path());
    both.extend(contents_of(theirs.path()));
    assert_same(&hub.contents().await, &both);
    assert_eq!(hub.alarms().await, [""; 0]);
    let distinct: i64 = hub
        .admin
        .query_one("SELECT count(*) - count(DISTINCT digest) FROM hub.record", &[])
        .await
        .unwrap()
        .get(0);
    assert!(distinct > 1000, "the digests of both are the same: {distinct}");
    let known = hub.ship(&right, mine.path()).await;
    assert!(matches!(known, Err(InletError::Refused { .. })), "{known:?}");
}

#[tokio::test]
async fn a_reading_that_was_archived_is_kept_by_its_digest_and_filled_when_its_content_comes() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let data = TempDir::new().unwrap();
    let store = Store::open(data.path()).unwrap();
    let mut run = store.begin(RunKind::Run, "archived").unwrap();
    append(&mut run, &[command("begin"), frames(), frames(), finished(Ending::Completed)]);
    let reader = Reader::open(data.path()).unwrap();
    let whole = reader.shipment(0, 10, usize::MAX).unwrap();
    let mut without = whole.clone();
    for record in &mut without.records[1..3] {
        record.payload.clear();
    }
    let mut inlet = Inlet::open(hub.as_role(&role).await, &reader, "rigd 0").await.unwrap();
    inlet.send(&Batch::new(0, "", &without).unwrap()).await.unwrap();
    assert_eq!(hub.count("hub.record WHERE payload = ''").await, 2);
    assert_eq!(hub.count("hub.run WHERE seal IS NOT NULL").await, 1, "the chain holds by digests");

    let mut altered = whole.clone();
    altered.records[1].payload = altered.records[1].payload.replace("bus", "bat");
    inlet.send(&Batch::new(0, "", &altered).unwrap()).await.unwrap();
    assert_eq!(hub.count("hub.record WHERE payload = ''").await, 1, "another content is not taken");
    inlet.send(&Batch::new(0, "", &whole).unwrap()).await.unwrap();
    inlet.send(&Batch::new(0, "", &without).unwrap()).await.unwrap();
    assert_same(&hub.contents().await, &contents_of(data.path()));
    assert_eq!(hub.alarms().await, [""; 0]);
}
