//! Records are in the partition of their month, and no bench keeps another one from making it.

use std::path::Path;

use rig_hub::{Batch, Inlet, InletError, admin};
use rig_store::{Reader, Shipment, Store};
use tempfile::TempDir;
use tokio::{join, time::timeout};
use tokio_postgres::Client;

use crate::support::{Hub, PATIENCE, sealed_run, server};

/// Times in March, April and May 2026, ms since 1970.
const MARCH: u64 = 1_773_100_800_000;
const APRIL: u64 = MARCH + 31 * 86_400_000;
const MAY: u64 = APRIL + 31 * 86_400_000;

/// An id of this version with a time.
fn id(version: u8, ms: u64) -> String {
    let (high, low) = (ms >> 16, ms & 0xffff);
    format!("{high:08x}-{low:04x}-{version}000-8000-000000000001")
}

/// A journal with one run of four records.
fn journal() -> TempDir {
    let data = TempDir::new().unwrap();
    sealed_run(&Store::open(data.path()).unwrap(), "smoke", 2);
    data
}

/// What a bench would ship of this journal if its run had this id. It has no end, since its seal would be another one.
fn with_id(data: &Path, id: &str) -> Batch {
    let mut shipment = Reader::open(data).unwrap().shipment(0, 10, usize::MAX).unwrap();
    for entry in &mut shipment.entries {
        id.clone_into(&mut entry.run);
    }
    for record in &mut shipment.records {
        record.run = id.parse().unwrap();
    }
    for (run, _) in &mut shipment.stretches {
        id.clone_into(run);
    }
    Batch::new(0, "", &Shipment { ends: Vec::new(), ..shipment }).unwrap()
}

async fn ship(client: Client, data: &Path, id: &str) -> Result<(), InletError> {
    let mut inlet = Inlet::open(client, &Reader::open(data).unwrap(), "rigd 0").await?;
    inlet.send(&with_id(data, id)).await.map(drop)
}

async fn make_partition(hub: &Hub, run: &str) {
    let make = format!("SELECT hub.make_partition('{run}')");
    hub.admin.batch_execute(&make).await.unwrap();
}

#[tokio::test]
async fn an_id_of_another_version_keeps_no_bench_from_the_month_of_its_time() {
    let hub = Hub::new().await;
    let (odd, left) = (hub.bench("odd").await, hub.bench("left").await);
    for (role, id) in [(&odd, id(4, MARCH)), (&left, id(7, MARCH)), (&odd, id(4, 7))] {
        let data = journal();
        ship(hub.as_role(role).await, data.path(), &id).await.unwrap();
    }
    assert_eq!(hub.count("hub.record_2026_03").await, 8);
    assert_eq!(hub.count("hub.record_other").await, 4, "an id with a time of 1970");
}

#[tokio::test]
async fn records_that_kept_a_month_from_being_made_are_moved_to_it() {
    let hub = Hub::new().await;
    let (odd, left) = (hub.bench("odd").await, hub.bench("left").await);
    let data = journal();
    ship(hub.as_role(&odd).await, data.path(), &id(4, APRIL)).await.unwrap();
    let before = "CREATE TEMP TABLE kept AS SELECT * FROM hub.record; DROP TABLE hub.record_2026_04;
                  ALTER TABLE hub.record DISABLE TRIGGER live; INSERT INTO hub.record SELECT * FROM kept;
                  ALTER TABLE hub.record ENABLE TRIGGER live; DELETE FROM hub.live;
                  DELETE FROM hub.migration WHERE version >= 13";
    hub.admin.batch_execute(before).await.unwrap();
    assert_eq!(hub.count("hub.record_other").await, 4);
    assert_eq!(admin::init(&server().admin(&hub.database)).await.unwrap(), 2);
    assert_eq!(
        (hub.count("hub.record_2026_04").await, hub.count("hub.record_other").await),
        (4, 0)
    );
    assert_eq!(hub.count("hub.live").await, 0, "nothing has happened at a rig");
    let other = journal();
    ship(hub.as_role(&left).await, other.path(), &id(7, APRIL)).await.unwrap();
    assert_eq!(hub.count("hub.record_2026_04").await, 8);
    assert_eq!(hub.count("hub.live").await, 1, "what comes is told again");
}

#[tokio::test]
async fn a_partition_is_not_dropped_between_the_entry_and_the_records_of_a_run() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let (data, run) = (journal(), id(7, MARCH));
    make_partition(&hub, &run).await;
    // The bench has shipped the entry, and waits with the stretch.
    let blocker = hub.another().await;
    let lock = "BEGIN; LOCK TABLE hub.stretch IN ACCESS EXCLUSIVE MODE";
    blocker.batch_execute(lock).await.unwrap();
    let (client, admin) = (hub.as_role(&role).await, hub.another().await);
    let shipping = timeout(PATIENCE, ship(client, data.path(), &run));
    let dropping = async {
        hub.until("the bench waits", async || hub.waiting().await == 1).await;
        let drop =
            tokio::spawn(
                async move { admin.batch_execute("SELECT hub.drop_empty_partitions()").await },
            );
        hub.until("the partition is gone, or waited for", async || {
            drop.is_finished() || hub.waiting().await == 2
        })
        .await;
        blocker.batch_execute("COMMIT").await.unwrap();
        timeout(PATIENCE, drop).await.unwrap().unwrap().unwrap();
    };
    let (shipped, ()) = join!(shipping, dropping);
    shipped.unwrap().unwrap();
    assert_eq!(
        (hub.count("hub.record_2026_03").await, hub.count("hub.record_other").await),
        (4, 0)
    );
}

#[tokio::test]
async fn a_bench_that_has_not_committed_does_not_hold_up_the_first_run_of_a_month() {
    let hub = Hub::new().await;
    let (idle, left) = (hub.bench("idle").await, hub.bench("left").await);
    let (data, other) = (journal(), journal());
    make_partition(&hub, &id(7, MARCH)).await;
    let client = hub.as_role(&idle).await;
    let (journal, _) = Reader::open(data.path()).unwrap().identity().unwrap();
    let greet = format!("SELECT hub.greet('{journal}', 'rigd 0')");
    client.batch_execute(&greet).await.unwrap();
    client.batch_execute("BEGIN").await.unwrap();
    let ingest = format!("SELECT hub.ingest('{journal}', 0, $1::text::json)::text");
    let batch = with_id(data.path(), &id(7, MARCH));
    client.query_one(&ingest, &[&batch.json()]).await.unwrap();
    let may = id(7, MAY);
    let shipped = ship(hub.as_role(&left).await, other.path(), &may);
    timeout(PATIENCE, shipped).await.unwrap().unwrap();
    assert_eq!(hub.count("hub.record_2026_05").await, 4);
    client.batch_execute("COMMIT").await.unwrap();
}
