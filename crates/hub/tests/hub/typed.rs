//! Typed tables are made of records.

use rig_hub::{
    Batch, Inlet, InletError, admin,
    doctor::{self, Finding},
};
use rig_store::{
    Amended, Amendment, Digest, Direction, Ending, Phase, PlanSize, Pose, Reader, Record,
    RefusedTouch, RunId, RunKind, RunStarted, Sample, Source, Store, Touch, TouchSettings,
};
use tempfile::TempDir;
use tokio_postgres::error::SqlState;

use crate::support::{Hub, append, assert_same, command, contents_of, fault, finished};

fn settings(sample: &str) -> TouchSettings {
    TouchSettings {
        step: format!("main/{sample}/front/15/1"),
        phase: Phase::Main,
        sample: sample.to_owned(),
        pose: Pose { direction: Direction::Front, angle_deg: 15.0 },
        repeat: 1,
    }
}

pub(crate) fn started() -> Record {
    let source = |name: &str| Source { name: name.to_owned(), toml: String::new() };
    Record::RunStarted(RunStarted {
        software: "rigd 0.1.0".to_owned(),
        seed: u64::MAX,
        protocol: source("smoke"),
        rig: source("bench"),
        is_simulated: true,
        scene: None,
        devices: Vec::new(),
        calibrations: Vec::new(),
        samples: vec![
            Sample { name: "agar".to_owned(), stiffness_mpa: Some(0.104) },
            Sample { name: "gel".to_owned(), stiffness_mpa: None },
        ],
        plan: PlanSize { steps: 4, touches: 2, prompts: 0 },
        touches: vec![settings("agar"), settings("gel")],
        classes: None,
        expected: None,
        aim: None,
        idempotency_key: None,
    })
}

pub(crate) fn touched() -> Record {
    Record::TouchResult(Touch {
        touch: settings("agar"),
        no_load_sweep: 1,
        no_load_hz: 140.4,
        no_load_sigma_hz: 0.01,
        drift_sigma_hz: 0.003,
        sweep: 2,
        resonance_hz: 158.3,
        sigma_hz: 0.02,
        shift_hz: 17.9,
        shift_sigma_hz: 0.0225,
        surface_mm: 10.1,
        surface_sigma_mm: 0.003,
        indentation_mm: 0.5,
        linear_mm: 9.6,
        rotary_deg: 15.0,
        is_slip_checked: Some(true),
        halfway: None,
    })
}

pub(crate) fn refused() -> Record {
    Record::TouchRefused(RefusedTouch {
        touch: settings("gel"),
        reason: "the readings had not settled".to_owned(),
        no_load_sweep: 1,
        no_load_hz: 140.4,
        no_load_sigma_hz: 0.01,
        rotary_deg: 15.0,
        indented: None,
    })
}

/// The rows of all typed tables, as text.
pub(crate) async fn rows(hub: &Hub) -> Vec<String> {
    let mut rows = Vec::new();
    for table in ["run_fact", "sample", "command", "touch", "fault", "amendment", "unread"] {
        let select = format!("SELECT t::text FROM hub.{table} AS t ORDER BY 1");
        let found = hub.admin.query(&select, &[]).await.unwrap();
        rows.extend(found.iter().map(|row| format!("{table} {}", row.get::<_, &str>(0))));
    }
    rows
}

/// An amendment that skips a step of the run that ends with this digest.
pub(crate) fn skipped(store: &Store, run: RunId, head: Digest) {
    let mut amendment = store.begin(RunKind::Amendment, &run.to_string()).unwrap();
    let amended = Record::Amended(Amended {
        run: run.to_string(),
        head: head.to_string(),
        step: settings("gel").step,
        what: Amendment::Skip,
        who: "ada".to_owned(),
        why: "it was dry".to_owned(),
        software: "rigd 0.1.0".to_owned(),
        rig: None,
        calibrations: None,
        devices: Vec::new(),
        changes: Vec::new(),
    });
    append(&mut amendment, &[amended, finished(Ending::Completed)]);
}

#[tokio::test]
async fn touches_faults_and_amendments_have_rows_and_are_made_again_alike() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let data = TempDir::new().unwrap();
    let store = Store::open(data.path()).unwrap();
    let mut run = store.begin(RunKind::Run, "smoke").unwrap();
    append(&mut run, &[started(), command("start"), touched(), refused(), fault()]);
    append(&mut run, &[finished(Ending::CompletedWithRefusals)]);
    skipped(&store, run.id(), run.digest());
    hub.ship(&role, data.path()).await.unwrap();

    let touches = hub
        .admin
        .query(
            "SELECT sample, angle_deg, reason, shift_hz, at - r.started_at::timestamptz < interval '1 minute'
             FROM hub.touch AS t JOIN hub.run AS r ON r.id = t.run ORDER BY seq",
            &[],
        )
        .await
        .unwrap();
    assert_eq!(touches.len(), 2);
    let shift = |row: usize| touches[row].get::<_, Option<f64>>(3);
    assert_eq!((touches[0].get::<_, &str>(0), shift(0)), ("agar", Some(17.9)));
    assert_eq!((touches[1].get::<_, &str>(0), shift(1)), ("gel", None));
    assert_eq!(touches[1].get::<_, Option<&str>>(2), Some("the readings had not settled"));
    assert!(touches[0].get::<_, bool>(4));
    let known: f64 = hub
        .admin
        .query_one("SELECT known_mpa FROM hub.sample WHERE name = 'agar'", &[])
        .await
        .unwrap()
        .get(0);
    assert!((known - 0.104).abs() < 1e-12);
    for (table, count) in [
        ("run_fact", 1),
        ("sample", 2),
        ("command", 1),
        ("fault", 1),
        ("amendment", 1),
        ("unread", 0),
    ] {
        assert_eq!(hub.count(&format!("hub.{table}")).await, count, "{table}");
    }

    let before = rows(&hub).await;
    hub.admin
        .batch_execute("DELETE FROM hub.touch; UPDATE hub.fault SET cause = ''")
        .await
        .unwrap();
    let read = admin::rebuild(&hub.admin).await.unwrap();
    assert_eq!(read, 6);
    assert_eq!(rows(&hub).await, before);
    // Rows of a run whose records were removed stay.
    hub.admin.batch_execute("DELETE FROM hub.record").await.unwrap();
    assert_eq!(admin::rebuild(&hub.admin).await.unwrap(), 0);
    assert_eq!(rows(&hub).await, before);
}

#[tokio::test]
async fn records_of_a_newer_format_are_carried_as_they_are() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let data = TempDir::new().unwrap();
    let store = Store::open(data.path()).unwrap();
    let mut run = store.begin(RunKind::Run, "smoke").unwrap();
    append(&mut run, &[command("start"), fault()]);
    let reader = Reader::open(data.path()).unwrap();
    let mut shipment = reader.shipment(0, 10, usize::MAX).unwrap();
    shipment.entries[0].format = 99;
    let mut before = Digest::START;
    for (record, (kind, payload)) in shipment.records.iter_mut().zip([
        ("whistled", "{\"kind\": \"whistled\", \"tone\": 1e400}"),
        ("fault", "{\"kind\": \"fault\", \"reasons\": []}"),
    ]) {
        (record.kind, record.payload) = (kind.to_owned(), payload.to_owned());
        record.digest = before.next(record.seq, record.rig_us, kind, payload);
        before = record.digest;
    }
    let mut inlet = Inlet::open(hub.as_role(&role).await, &reader, "rigd 99").await.unwrap();
    inlet.send(&Batch::new(0, "", &shipment).unwrap()).await.unwrap();
    let payloads =
        hub.admin.query("SELECT payload FROM hub.record ORDER BY seq", &[]).await.unwrap();
    for (row, record) in payloads.iter().zip(&shipment.records) {
        assert_eq!(row.get::<_, &str>(0), record.payload);
    }
    assert_eq!(payloads.len(), 2);
    assert_eq!((hub.count("hub.unread").await, hub.count("hub.fault").await), (1, 0));
    assert_eq!(hub.alarms().await, [""; 0]);
    let findings = doctor::findings(&hub.admin).await.unwrap();
    let unread = findings.iter().find(|finding| finding.check == "records without a typed row");
    let Finding { level, text, .. } = unread.unwrap();
    assert_eq!(*level, doctor::Level::Warning);
    assert!(text.starts_with("1, the first: null value in column \"cause\""), "{text}");
}

#[tokio::test]
async fn a_record_that_cannot_be_read_stops_nothing() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let data = TempDir::new().unwrap();
    let store = Store::open(data.path()).unwrap();
    let mut run = store.begin(RunKind::Run, "smoke").unwrap();
    append(&mut run, &[started(), command("start"), command("go on"), touched(), command("stop")]);
    let reader = Reader::open(data.path()).unwrap();
    let mut shipment = reader.shipment(0, 10, usize::MAX).unwrap();
    let again = shipment.records[0].clone();
    let huge = shipment.records[3].payload.replace("17.9", "1e400");
    for (record, payload) in
        shipment.records[1..].iter_mut().zip([&again.payload, &"[".repeat(100_000), &huge])
    {
        payload.clone_into(&mut record.payload);
    }
    again.kind.clone_into(&mut shipment.records[1].kind);
    let mut before = Digest::START;
    for record in &mut shipment.records {
        record.digest = before.next(record.seq, record.rig_us, &record.kind, &record.payload);
        before = record.digest;
    }
    let mut inlet = Inlet::open(hub.as_role(&role).await, &reader, "rigd 0").await.unwrap();
    inlet.send(&Batch::new(0, "", &shipment).unwrap()).await.unwrap();
    assert_eq!((hub.count("hub.record").await, hub.count("hub.unread").await), (5, 3));
    assert_eq!((hub.count("hub.run_fact").await, hub.count("hub.command").await), (1, 1));
}

#[tokio::test]
async fn a_failure_of_the_server_is_none_of_a_record_and_the_batch_comes_again() {
    for table in ["command", "live"] {
        let hub = Hub::new().await;
        let role = hub.bench("left").await;
        let data = TempDir::new().unwrap();
        let store = Store::open(data.path()).unwrap();
        let mut run = store.begin(RunKind::Run, "smoke").unwrap();
        append(&mut run, &[started(), command("start"), finished(Ending::Completed)]);
        let fail = format!(
            "CREATE FUNCTION hub.fail() RETURNS trigger LANGUAGE plpgsql AS $$
             BEGIN RAISE EXCEPTION 'no space left on device' USING ERRCODE = 'disk_full'; END $$;
             CREATE TRIGGER fail BEFORE INSERT ON hub.{table} FOR EACH ROW EXECUTE FUNCTION hub.fail()"
        );
        hub.admin.batch_execute(&fail).await.unwrap();
        match hub.ship(&role, data.path()).await {
            Err(InletError::Hub(error)) => assert_eq!(error.code(), Some(&SqlState::DISK_FULL)),
            other => panic!("{table}: {other:?}"),
        }
        let left = (hub.count("hub.record").await, hub.count("hub.unread").await);
        assert_eq!(left, (0, 0), "{table}");
        hub.admin.batch_execute(&format!("DROP TRIGGER fail ON hub.{table}")).await.unwrap();
        hub.ship(&role, data.path()).await.unwrap();
        assert_same(&hub.contents().await, &contents_of(data.path()));
        let made = (hub.count("hub.command").await, hub.count("hub.live").await);
        assert_eq!((made, hub.count("hub.unread").await), ((1, 1), 0), "{table}");
    }
}
