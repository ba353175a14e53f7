//! PostgreSQL and an object store on disks that are full, and then have space again.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::Write,
    path::{Path, PathBuf},
    thread,
    time::{Duration, Instant},
};

use clap::Args;
use rig_hub::{Destination, Standing, Trial, admin, connect, ship};
use rig_ship::Outcome;
use rig_store::Reader;
use tempfile::TempDir;
use tokio::{sync::watch, time::timeout};

use crate::{
    objects,
    support::{Hub, assert_same, contents_of},
    worker,
};

const DATABASE: &str = "rigd_hub";
const BENCH: &str = "lab/left";
/// Bytes that stay free: a part of what a run needs as an object, and in PostgreSQL.
const LEFT_FOR_OBJECTS: u64 = 128 << 10;
const LEFT_FOR_RECORDS: u64 = 1 << 20;
/// All comes to its end within this time.
const PATIENCE: Duration = Duration::from_secs(60);

#[derive(Debug, Args)]
pub(crate) struct FullDiskArgs {
    /// A directory on a small file system of its own, for PostgreSQL
    database: PathBuf,
    /// Another one, for objects
    objects: PathBuf,
}

impl FullDiskArgs {
    /// Plays both disks, and compares every byte.
    pub(crate) async fn play(&self) {
        let data = TempDir::new().unwrap();
        worker::measure_paper(data.path()).await;
        let journal = contents_of(data.path());
        put_objects(&self.objects, data.path(), &journal);
        ship_records(&self.database, data.path(), &journal).await;
    }
}

/// A file that takes all space of its disk, but for a small part.
struct Ballast(PathBuf);

impl Ballast {
    fn fill(disk: &Path, left: u64) -> Self {
        let path = disk.join("ballast");
        let mut file = File::create(&path).unwrap();
        let block = vec![0; 64 << 10];
        while file.write_all(&block).is_ok() {}
        let length = file.metadata().unwrap().len();
        file.set_len(length.saturating_sub(left)).unwrap();
        Self(path)
    }

    fn remove(self) {
        fs::remove_file(&self.0).unwrap();
    }
}

fn put_objects(disk: &Path, data: &Path, journal: &BTreeMap<String, Vec<String>>) {
    let wanted: BTreeMap<_, _> =
        journal.iter().map(|(run, lines)| (run.clone(), objects::of_journal(lines))).collect();
    let store = disk.join("objects");
    let ballast = Ballast::fill(disk, LEFT_FOR_OBJECTS);
    let began = Instant::now();
    let failed =
        worker::objects(data, &store).unwrap().into_iter().filter_map(|(_, put)| put.err());
    let failed: Vec<_> = failed.map(|error| rig_model::with_causes(&error)).collect();
    assert!(failed.iter().any(|error| error.contains("No space left")), "{failed:?}");
    let found = objects::contents(&store);
    assert!(found.iter().all(|(run, lines)| wanted[run] == *lines), "an object has other bytes");
    let before = found.len();
    ballast.remove();
    for (run, put) in worker::objects(data, &store).unwrap() {
        let put = put.unwrap();
        assert!(matches!(put, Outcome::Shipped { .. } | Outcome::Present { .. }), "{run}: {put:?}");
    }
    assert_same(&objects::contents(&store), &wanted);
    println!(
        "objects: {} of {} runs were put on a disk with {} kB, the others when it had space, in {:.1} s: every byte is there \
         ({})",
        before,
        wanted.len(),
        LEFT_FOR_OBJECTS >> 10,
        began.elapsed().as_secs_f64(),
        failed[0]
    );
}

async fn ship_records(disk: &Path, data: &Path, journal: &BTreeMap<String, Vec<String>>) {
    let directory = disk.join("hub");
    fs::create_dir(&directory).unwrap();
    let server = Trial::start(&directory, false).unwrap();
    let config = server.admin(DATABASE);
    admin::init(&config).await.unwrap();
    let (client, _task) = connect(&config, None).await.unwrap();
    admin::add_bench(&client, &BENCH.parse().unwrap()).await.unwrap();
    let ballast = Ballast::fill(disk, LEFT_FOR_RECORDS);

    let mut of_bench = config.clone();
    of_bench.user(BENCH);
    let (journal_data, last_event) =
        (data.to_owned(), Reader::open(data).unwrap().last_event().unwrap());
    let (news, heard) = watch::channel(());
    let (sender, mut standing) = watch::channel(Standing::default());
    let shipping = thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let to = Destination::local(of_bench);
        runtime.block_on(ship(&to, &journal_data, "rigd 0", heard, &sender));
    });
    let began = Instant::now();
    let is_refused = |standing: &Standing| standing.error.is_some();
    let refused = timeout(PATIENCE, standing.wait_for(is_refused)).await.unwrap().unwrap().clone();
    let error = refused.error.unwrap();
    assert!(error.contains("No space left"), "{error}");
    assert!(refused.event < last_event, "there was space for all");
    // What is committed is a beginning of the journal. Then the server ends as in a crash, still without space.
    let mut hub = Hub { database: DATABASE.to_owned(), admin: client };
    for (run, lines) in hub.contents().await {
        assert!(journal[&run].starts_with(&lines), "run {run} is no prefix");
    }
    server.stop().unwrap();
    ballast.remove();
    server.go_on().unwrap();
    let is_there = |standing: &Standing| standing.event == last_event;
    let shipped = timeout(PATIENCE, standing.wait_for(is_there)).await.unwrap().unwrap().clone();
    drop(news);
    tokio::task::spawn_blocking(|| shipping.join().unwrap()).await.unwrap();
    hub.admin = connect(&config, None).await.unwrap().0;
    assert_same(&hub.contents().await, journal);
    let state = rig_hub::state(&hub.admin).await.unwrap();
    assert!(state.alarms.is_empty(), "{:?}", state.alarms);
    println!(
        "PostgreSQL: {} of {last_event} events were committed on a disk with {} kB, attempts failed {} times, and {:.1} s after the \
         first one, with space again, every byte is there ({error})",
        refused.event,
        LEFT_FOR_RECORDS >> 10,
        shipped.failures,
        began.elapsed().as_secs_f64(),
    );
}
