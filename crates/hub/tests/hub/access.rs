//! A bench ships for itself alone, by its certificate and by three functions.

use std::{fs, os::unix::fs::PermissionsExt};

use rig_hub::{
    Batch, Catalogue, Identity, Inlet, InletError, TlsError, Wanted, admin, connect, doctor,
};
use rig_store::{Reader, Shipment, Store};
use tempfile::TempDir;
use tokio::time::timeout;

use crate::support::{
    Hub, PATIENCE, append, assert_same, command, contents_of, journal, sealed_run, server,
};

#[tokio::test]
async fn a_stranger_sees_and_changes_nothing_of_another_bench() {
    let hub = Hub::new().await;
    let (left, stranger) = (hub.bench("left").await, hub.bench("stranger").await);
    let (data, _store, _session) = journal();
    hub.ship(&left, data.path()).await.unwrap();
    let whole = hub.contents().await;

    let client = hub.as_role(&stranger).await;
    for table in ["bench WHERE name <> 'stranger'", "journal", "run", "stretch", "record", "clash"]
    {
        let seen: i64 = client
            .query_one(&format!("SELECT count(*) FROM hub.{table}"), &[])
            .await
            .unwrap()
            .get(0);
        assert_eq!(seen, 0, "{table}");
    }
    let own = hub.as_role(&left).await;
    let seen: i64 = own.query_one("SELECT count(*) FROM hub.record", &[]).await.unwrap().get(0);
    assert_eq!(seen, hub.count("hub.record").await, "it sees its own");

    for statement in [
        "INSERT INTO hub.record SELECT * FROM hub.record",
        "UPDATE hub.record SET payload = ''",
        "DELETE FROM hub.record",
        "TRUNCATE hub.record",
        "DELETE FROM hub.clash",
        "UPDATE hub.journal SET cursor_event = 0",
        "SELECT * FROM hub.touch",
        "SELECT * FROM hub.alarm",
        "SELECT * FROM hub.record_other",
        "SELECT hub.rebuild()",
        "SELECT hub.alert(1, '', '', '')",
        "CREATE TABLE hub.mine (n integer)",
        "CREATE TABLE public.mine (n integer)",
        "SET ROLE rigd_hub",
        "SET SESSION AUTHORIZATION postgres",
        "CREATE ROLE friend",
        "COPY hub.run TO PROGRAM 'cat'",
    ] {
        for client in [&client, &own] {
            let refused = client.batch_execute(statement).await.unwrap_err();
            assert_eq!(refused.code().unwrap().code(), "42501", "{statement}");
        }
    }
    let reader = Reader::open(data.path()).unwrap();
    let (id, _) = reader.identity().unwrap();
    let shipment = reader.shipment(0, 10, usize::MAX).unwrap();
    let batch = Batch::new(0, "", &shipment).unwrap();
    for call in
        [format!("SELECT hub.ingest('{id}', 0, '{{}}')"), format!("SELECT hub.rewind('{id}', 1)")]
    {
        let refused = client.batch_execute(&call).await.unwrap_err();
        assert_eq!(refused.code().unwrap().code(), "42501", "{call}");
    }
    let refused = Inlet::open(hub.as_role(&stranger).await, &reader, "rigd 0").await;
    assert!(matches!(refused, Err(InletError::Refused { .. })), "{refused:?}");
    assert_eq!(hub.alarms().await, ["stranger"]);

    // A forged record of a run of the other bench, in a journal of its own.
    let forged = "SELECT hub.greet('00000000-0000-7000-8000-000000000000', 'forged')";
    client.batch_execute(forged).await.unwrap();
    let ingest =
        "SELECT hub.ingest('00000000-0000-7000-8000-000000000000', 0, $1::text::json)::text";
    client.query_one(ingest, &[&batch.json()]).await.unwrap();
    assert_same(&hub.contents().await, &whole);
    assert_eq!(hub.count("hub.clash WHERE reason = 'the run is that of another bench'").await, 10);
    let kinds = hub.alarms().await;
    assert!(kinds.iter().filter(|kind| *kind == "stranger").count() > 1, "{kinds:?}");
    assert_same(&hub.contents().await, &contents_of(data.path()));

    let admin = hub.admin.batch_execute(forged).await.unwrap_err();
    assert_eq!(admin.code().unwrap().code(), "42501", "the superuser is no bench");
}

#[tokio::test]
async fn a_stranger_that_has_not_committed_holds_up_no_other_bench() {
    let hub = Hub::new().await;
    let (left, stranger) = (hub.bench("left").await, hub.bench("stranger").await);
    let (data, store, mut session) = journal();
    hub.ship(&left, data.path()).await.unwrap();
    append(&mut session, &[command("go on")]);
    sealed_run(&store, "later", 3);
    let reader = Reader::open(data.path()).unwrap();
    let (theirs, _) = reader.identity().unwrap();
    let batch = Batch::new(0, "", &reader.shipment(0, 10, usize::MAX).unwrap()).unwrap();

    let client = hub.as_role(&stranger).await;
    let own = "00000000-0000-7000-8000-000000000000";
    let greet = async |journal: &str| {
        let greet = format!("SELECT (hub.greet('{journal}', 'rigd 0')).refusal");
        client.query_one(&greet, &[]).await.unwrap().get::<_, Option<String>>(0)
    };
    assert_eq!(greet(own).await, None);
    client.batch_execute("BEGIN").await.unwrap();
    assert_eq!(greet(&theirs).await.unwrap(), "the journal is that of another bench");
    let ingest = format!("SELECT hub.ingest('{own}', 0, $1::text::json)::text");
    client.query_one(&ingest, &[&batch.json()]).await.unwrap();
    timeout(PATIENCE, hub.ship(&left, data.path())).await.unwrap().unwrap();
    client.batch_execute("COMMIT").await.unwrap();
    assert_same(&hub.contents().await, &contents_of(data.path()));
}

#[tokio::test]
async fn records_that_a_stranger_ships_of_a_run_are_no_clash_of_the_run() {
    let hub = Hub::new().await;
    let (left, stranger) = (hub.bench("left").await, hub.bench("stranger").await);
    let data = TempDir::new().unwrap();
    sealed_run(&Store::open(data.path()).unwrap(), "smoke", 2);
    let reader = Reader::open(data.path()).unwrap();
    let mut inlet = Inlet::open(hub.as_role(&left).await, &reader, "rigd 0").await.unwrap();
    let first = reader.shipment(0, 2, usize::MAX).unwrap();
    inlet.send(&Batch::new(0, "", &first).unwrap()).await.unwrap();

    let client = hub.as_role(&stranger).await;
    let own = "00000000-0000-7000-8000-000000000000";
    client.batch_execute(&format!("SELECT hub.greet('{own}', 'rigd 0')")).await.unwrap();
    let all = Batch::new(0, "", &reader.shipment(0, 4, usize::MAX).unwrap()).unwrap();
    let ingest = format!("SELECT hub.ingest('{own}', 0, $1::text::json)::text");
    client.query_one(&ingest, &[&all.json()]).await.unwrap();
    assert_eq!(hub.count("hub.clash").await, 4);

    // A gap is one, also behind a record that the stranger has shipped.
    let last = reader.shipment(3, 1, usize::MAX).unwrap();
    let end = Shipment { records: Vec::new(), ..last.clone() };
    for gap in [last, end] {
        let gap = Batch::new(2, &inlet.cursor().digest, &gap).unwrap();
        match inlet.send(&gap).await {
            Err(InletError::Hub(error)) => assert_eq!(error.code().unwrap().code(), "HB002"),
            other => panic!("{other:?}"),
        }
    }
    hub.ship(&left, data.path()).await.unwrap();
    assert_same(&hub.contents().await, &contents_of(data.path()));
    let catalogue = Catalogue::new(server().admin(&hub.database));
    let found = catalogue.runs(&Wanted::default()).await.unwrap().remove(0);
    assert!(found.is_sealed && !found.has_clash, "{found:?}");
    let stays = hub.admin.query_one("SELECT hub.must_stay(r) FROM hub.run AS r", &[]).await;
    assert_eq!(stays.unwrap().get::<_, &str>(0), "it is not judged yet");
}

#[tokio::test]
async fn a_bench_is_its_certificate() {
    let hub = Hub::new().await;
    let (left, right) = (hub.bench("left").await, hub.bench("right").await);
    let identity = server().identity(&left).unwrap();
    let (data, _store, _session) = journal();
    let reader = Reader::open(data.path()).unwrap();
    let config = server().bench(&left, &hub.database);
    let (client, _task) = connect(&config, Some(&identity)).await.unwrap();
    let mut inlet = Inlet::open(client, &reader, "rigd 0").await.unwrap();
    while let Some(batch) = inlet.next(&reader).unwrap() {
        inlet.send(&batch).await.unwrap();
    }
    assert_same(&hub.contents().await, &contents_of(data.path()));

    let as_other = server().bench(&right, &hub.database);
    assert!(
        connect(&as_other, Some(&identity)).await.is_err(),
        "the certificate is of another bench"
    );
    assert!(connect(&config, None).await.is_err(), "no certificate");
    let as_admin = server().bench("postgres", &hub.database);
    assert!(connect(&as_admin, Some(&identity)).await.is_err(), "the superuser is not let in");
    let mut elsewhere = config.clone();
    elsewhere.dbname("postgres");
    let (client, _task) = connect(&elsewhere, Some(&identity)).await.unwrap();
    assert!(
        client.batch_execute("SELECT * FROM hub.run").await.is_err(),
        "another database has no hub"
    );

    admin::revoke_bench(&hub.admin, &left.parse().unwrap()).await.unwrap();
    assert!(inlet.greet(&reader, "rigd 0").await.is_err(), "its connection has ended");
    assert!(connect(&config, Some(&identity)).await.is_err(), "it is not let in again");
    admin::add_bench(&hub.admin, &left.parse().unwrap()).await.unwrap();
    assert!(connect(&config, Some(&identity)).await.is_ok(), "it is let in again");
}

#[test]
fn a_key_that_others_can_read_is_refused() {
    let [certificate, key, authority] = server().certify("nobody/careless").unwrap();
    fs::set_permissions(&key, fs::Permissions::from_mode(0o644)).unwrap();
    let refused = Identity::read(&certificate, &key, &authority);
    assert!(matches!(refused, Err(TlsError::Open { mode: 0o644, .. })), "{refused:?}");
    fs::set_permissions(&key, fs::Permissions::from_mode(0o640)).unwrap();
    Identity::read(&certificate, &key, &authority).unwrap();
    assert!(matches!(Identity::read(&key, &key, &authority), Err(TlsError::Pem { .. })));
    let other = Identity::read(&authority, &key, &authority);
    assert!(matches!(other, Err(TlsError::Unusable { .. })), "{other:?}");
}

#[tokio::test]
async fn the_doctor_finds_a_hub_well_and_names_what_is_not() {
    let hub = Hub::new().await;
    hub.bench("left").await;
    let findings = doctor::findings(&hub.admin).await.unwrap();
    let level = |check: &str| findings.iter().find(|finding| finding.check == check).unwrap().level;
    for check in [
        "schema",
        "durability",
        "TLS",
        "benches by certificate",
        "other ways for benches",
        "alarms",
    ] {
        assert_eq!(level(check), doctor::Level::Ok, "{check}: {findings:?}");
    }
    assert_eq!(level("benches"), doctor::Level::Warning, "it has never called");
    assert!(
        findings
            .iter()
            .all(|finding| { (finding.level == doctor::Level::Ok) == finding.advice.is_none() })
    );
    hub.admin.batch_execute("SET synchronous_commit = off").await.unwrap();
    let findings = doctor::findings(&hub.admin).await.unwrap();
    let durability = findings.iter().find(|finding| finding.check == "durability").unwrap();
    assert_eq!(durability.level, doctor::Level::Problem);
    assert_eq!(durability.text, "off in PostgreSQL: synchronous_commit");
}
