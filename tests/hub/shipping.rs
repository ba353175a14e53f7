//! Ships a journal while the shipper, the line or PostgreSQL fails.

use std::{
    process::{Child, Stdio},
    time::Duration,
};

use rig_hub::{Batch, Identity, Inlet, InletError, connect};
use rig_store::Reader;
use tokio::time::{sleep, timeout};

use crate::{
    bench::{Bench, Counts, kill, port_of_hub, worker},
    deed::Deed,
    line::{Fault, Line},
    support::{Hub, server},
};

/// The version that the hub is told.
const SOFTWARE: &str = "rigd 0";
/// A batch has at most this many records here, so that a run takes several.
const RECORDS_MAX: u32 = 200;
/// Batches of a passage.
const BATCHES: usize = 4;
/// A program has shipped everything within this time, µs.
const LIFE_US: u32 = 60_000;
/// An answer that does not come within this time is lost.
const PATIENCE: Duration = Duration::from_secs(30);

/// Has the hub or the shipper fail around a batch of drawn size, and says whether there was a journal.
pub(crate) async fn meet(
    bench: &mut Bench,
    deed: Deed,
    hub: &mut Hub,
    older: &mut Option<Batch>,
) -> bool {
    let reader = Reader::open(bench.data.path()).unwrap();
    let client = hub.as_role(&bench.role).await;
    let mut inlet = Inlet::open(client, &reader, SOFTWARE).await.unwrap();
    let batch = next(bench, &inlet, &reader);
    match deed {
        Deed::Kill => return true,
        Deed::KillInFlight => {
            let wait = Duration::from_micros(u64::from(bench.up_to(8000)));
            _ = timeout(wait, inlet.send(&batch)).await;
        }
        Deed::EndInside => end_inside(bench, hub, &mut inlet, &batch).await,
        Deed::FullHub => full_hub(hub, &mut inlet, &batch).await,
        Deed::LoseAnswer => {
            inlet.send(&batch).await.unwrap();
            let client = hub.as_role(&bench.role).await;
            let mut again = Inlet::open(client, &reader, SOFTWARE).await.unwrap();
            again.send(&batch).await.unwrap();
        }
        Deed::Repeat => {
            let Some(older) = older.as_ref() else { return false };
            let after = inlet.cursor().event;
            match inlet.send(older).await {
                Ok(cursor) => assert!(cursor.event >= after, "the cursor went back"),
                Err(error) => assert!(matches!(error, InletError::Hub(_)), "{error:?}"),
            }
        }
        Deed::CrashHub => {
            let crash = tokio::task::spawn_blocking(|| server().crash().unwrap());
            let (_, crashed) = tokio::join!(inlet.send(&batch), crash);
            crashed.unwrap();
            hub.reconnect().await;
        }
        _ => {
            for _ in 0..BATCHES {
                let batch = next(bench, &inlet, &reader);
                inlet.send(&batch).await.unwrap();
            }
        }
    }
    *older = Some(batch);
    true
}

/// The next batch, of a drawn size.
fn next(bench: &mut Bench, inlet: &Inlet, reader: &Reader) -> Batch {
    let (cursor, records) = (inlet.cursor(), 1 + bench.up_to(RECORDS_MAX));
    let shipment = reader.shipment(cursor.event, records, usize::MAX).unwrap();
    Batch::new(cursor.event, &cursor.digest, &shipment).unwrap()
}

/// PostgreSQL ends the connection while it is at work on the batch.
async fn end_inside(bench: &Bench, hub: &Hub, inlet: &mut Inlet, batch: &Batch) {
    let end = "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity
               WHERE usename = $1::text::name AND state = 'active'";
    let ended = async {
        while hub.admin.query_one(end, &[&bench.role]).await.unwrap().get::<_, i64>(0) == 0 {}
    };
    let mut sent = std::pin::pin!(inlet.send(batch));
    tokio::select! {
        // It was committed before its connection was seen at work.
        _ = &mut sent => {}
        () = ended => drop(sent.await),
    }
}

/// PostgreSQL says of a record in the middle of the batch that there is no space for it.
async fn full_hub(hub: &Hub, inlet: &mut Inlet, batch: &Batch) {
    let full = "CREATE OR REPLACE FUNCTION hub.full() RETURNS trigger LANGUAGE plpgsql AS
                $$ BEGIN RAISE 'could not extend file' USING ERRCODE = 'disk_full'; END $$;
                GRANT EXECUTE ON FUNCTION hub.full() TO PUBLIC;
                CREATE TRIGGER full_disk BEFORE INSERT ON hub.record FOR EACH ROW
                WHEN (NEW.seq % 16 = 15) EXECUTE FUNCTION hub.full()";
    hub.admin.batch_execute(full).await.unwrap();
    let after = inlet.cursor().event;
    let sent = inlet.send(batch).await.map(|cursor| cursor.event);
    hub.admin.batch_execute("DROP TRIGGER full_disk ON hub.record").await.unwrap();
    match sent {
        Ok(event) => assert!(event >= after),
        Err(InletError::Hub(error)) => assert_eq!(error.code().unwrap().code(), "53100"),
        Err(error) => panic!("{error:?}"),
    }
}

/// Kills the program that ships at a drawn moment of its life.
pub(crate) async fn kill_shipper(bench: &mut Bench) {
    let mut command = worker("ship", bench.data.path());
    bench.ship_to(&mut command, port_of_hub());
    let mut program = command.stdout(Stdio::null()).spawn().unwrap();
    kill_later(bench, &mut program).await;
}

/// Kills a program after a drawn time, which may be longer than its life.
pub(crate) async fn kill_later(bench: &mut Bench, program: &mut Child) {
    sleep(Duration::from_micros(u64::from(bench.up_to(LIFE_US)))).await;
    kill(program);
}

/// Ships by a line that is slow or cut, under TLS.
pub(crate) async fn by_bad_line(bench: &mut Bench, deed: Deed, counts: &mut Counts) {
    let mut fault =
        Fault { cut_up: usize::MAX, cut_down: usize::MAX, delay: Duration::ZERO, part: 1 << 14 };
    match (deed, bench.below(2)) {
        (Deed::Slow, _) => {
            fault.part = 512 + bench.up_to(1 << 14) as usize;
            fault.delay = Duration::from_micros(u64::from(bench.up_to(2000)));
        }
        (_, 0) => fault.cut_up = bench.up_to(1 << 18) as usize,
        _ => fault.cut_down = bench.up_to(1 << 13) as usize,
    }
    let line = Line::to(server().port(), fault).await;
    let ended = timeout(PATIENCE, passage(bench, line.port)).await.unwrap();
    if let Err(error) = &ended {
        assert!(deed == Deed::Cut, "a slow line: {error}");
        *counts.entry("passages that were cut".to_owned()).or_default() += 1;
    }
}

async fn passage(bench: &mut Bench, port: u16) -> Result<(), Box<dyn std::error::Error>> {
    let reader = Reader::open(bench.data.path()).unwrap();
    let [certificate, key, authority] = &bench.files;
    let identity = Identity::read(certificate, key, authority).unwrap();
    let mut config = tokio_postgres::Config::new();
    config.host("localhost").port(port).user(&bench.role).dbname(&bench.database);
    let (client, _task) = connect(&config, Some(&identity)).await?;
    let mut inlet = Inlet::open(client, &reader, SOFTWARE).await?;
    for _ in 0..BATCHES {
        let batch = next(bench, &inlet, &reader);
        inlet.send(&batch).await?;
    }
    Ok(())
}
