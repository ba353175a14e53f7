//! Records leave PostgreSQL when their run is typed, judged, old, and in a sound object; then they are no gap.

use std::{fs, path::Path};

use rig_hub::{BenchState, Inlet, Pruned, admin, judge, prune, state};
use rig_ship::{Address, ObjectStore, Outcome, Shipper};
use rig_store::{Ending, Reader, RunId, RunKind, Store};
use tempfile::TempDir;
use tokio::time::timeout;

use crate::{
    support::{Hub, PATIENCE, append, command, contents_of, finished, sealed_run},
    typed::{rows, skipped, started, touched},
};

const KEEP_DAYS: i32 = 90;

fn store(folder: &Path) -> ObjectStore {
    ObjectStore::at(Address::Folder(folder.to_owned())).unwrap()
}

/// Puts runs in a folder, and returns the names of their objects.
fn put(data: &Path, folder: &Path, wanted: impl Fn(RunId) -> bool) -> Vec<String> {
    let shipper = Shipper::new(store(folder), "lab".parse().unwrap(), None, None);
    let reader = Reader::open(data).unwrap();
    let runs = reader.runs().unwrap().into_iter().filter(|run| run.is_sealed && wanted(run.id));
    let put = runs.map(|run| match shipper.ship(&reader, &run).unwrap() {
        Outcome::Shipped { object } | Outcome::Present { object } => object,
        Outcome::Clash { object } => panic!("{object}"),
    });
    put.collect()
}

/// A hub that has taken a journal, with all of its records taken so many days ago.
struct Old {
    hub: Hub,
    role: String,
    data: TempDir,
    folder: TempDir,
    runs: Vec<RunId>,
}

async fn old(days: i32) -> Old {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let data = TempDir::new().unwrap();
    let journal = Store::open(data.path()).unwrap();
    let mut run = journal.begin(RunKind::Run, "smoke").unwrap();
    let first = run.id();
    append(&mut run, &[started(), command("start"), touched(), finished(Ending::Completed)]);
    sealed_run(&journal, "other", 20);
    let mut open = journal.begin(RunKind::Run, "open").unwrap();
    append(&mut open, &[started(), touched()]);
    hub.ship(&role, data.path()).await.unwrap();
    age(&hub, days).await;
    let runs = Reader::open(data.path()).unwrap().runs().unwrap();
    let second = runs.iter().find(|run| run.name == "other").unwrap().id;
    let runs = vec![first, second, open.id()];
    Old { hub, role, data, folder: TempDir::new().unwrap(), runs }
}

/// Has taken everything so many days ago.
async fn age(hub: &Hub, days: i32) {
    for table in ["record", "run"] {
        let ago = format!("UPDATE hub.{table} SET received_at = now() - make_interval(days => $1)");
        hub.admin.execute(&ago, &[&days]).await.unwrap();
    }
}

impl Old {
    async fn prune(&self) -> Pruned {
        prune(&self.hub.admin, store(self.folder.path()), KEEP_DAYS).await.unwrap()
    }

    async fn judge(&self) -> usize {
        judge(&mut self.hub.another().await).await.unwrap()
    }

    async fn bench(&self) -> BenchState {
        state(&self.hub.admin).await.unwrap().benches.remove(0)
    }

    async fn records_of(&self, run: usize) -> i64 {
        self.hub.count(&format!("hub.record WHERE run = '{}'", self.runs[run])).await
    }

    /// Has the bench send its journal from the beginning.
    async fn ship_again(&self) {
        let rewind = "UPDATE hub.journal SET cursor_event = 0, cursor_digest = ''";
        self.hub.admin.batch_execute(rewind).await.unwrap();
        self.hub.ship(&self.role, self.data.path()).await.unwrap();
    }
}

#[tokio::test]
async fn a_run_leaves_when_it_is_sealed_judged_and_in_an_object() {
    let old = old(KEEP_DAYS + 1).await;
    let all = put(old.data.path(), old.folder.path(), |_| true);
    assert_eq!(all.len(), 2);
    // Not judged, and not sealed.
    let pruned = old.prune().await;
    assert_eq!((pruned.runs, pruned.stayed.len()), (0, 2), "{pruned:?}");
    assert_eq!(old.judge().await, 2);
    let before = rows(&old.hub).await;
    let pruned = old.prune().await;
    assert_eq!((pruned.runs, pruned.records), (2, 26), "{pruned:?}");
    assert_eq!(pruned.stayed["it has no seal"], 1);
    assert_eq!(
        [old.records_of(0).await, old.records_of(1).await, old.records_of(2).await],
        [0, 0, 2]
    );
    assert_eq!(rows(&old.hub).await, before, "typed rows stay");
    admin::rebuild(&old.hub.admin).await.unwrap();
    assert_eq!(rows(&old.hub).await, before, "and are not made again of nothing");
    let bench = old.bench().await;
    assert_eq!((bench.runs, bench.sealed, bench.pruned, bench.records), (3, 2, 2, 28));
    assert_eq!(state(&old.hub.admin).await.unwrap().pruning.unwrap().runs, 2);
}

/// Such as records of a later rigd, whose results a later rigd-hub makes.
#[tokio::test]
async fn a_run_whose_results_could_not_be_made_stays_and_is_judged_again() {
    let mut old = old(KEEP_DAYS + 1).await;
    put(old.data.path(), old.folder.path(), |_| true);
    let rename = async |old: &mut Old, from: &str, to: &str| {
        let rename = format!(
            "UPDATE hub.record SET kind = '{to}', payload = replace(payload, '\"{from}\"', '\"{to}\"')
             WHERE kind = '{from}' AND run = '{}'",
            old.runs[0]
        );
        assert_eq!(old.hub.admin.execute(&rename, &[]).await.unwrap(), 1);
    };
    rename(&mut old, "touch_result", "of_tomorrow").await;
    assert_eq!(old.judge().await, 2);
    let pruned = old.prune().await;
    assert_eq!((pruned.runs, pruned.stayed["its results could not be made"]), (1, 1), "{pruned:?}");
    let reason = format!("SELECT reason FROM hub.result WHERE run = '{}'", old.runs[0]);
    let row = old.hub.admin.query_one(&reason, &[]).await.unwrap();
    assert!(row.get::<_, String>(0).contains("of_tomorrow"), "{row:?}");
    let findings = rig_hub::doctor::findings(&old.hub.admin).await.unwrap();
    let finding = findings.iter().find(|one| one.check == "runs whose results could not be made");
    assert!(finding.unwrap().text.starts_with("1, the first: "), "{findings:?}");
    rename(&mut old, "of_tomorrow", "touch_result").await;
    assert_eq!(old.judge().await, 1);
    assert_eq!(old.prune().await.runs, 1);
    assert_eq!(old.judge().await, 0);
}

#[tokio::test]
async fn a_run_whose_values_the_database_refuses_keeps_no_other_from_being_judged() {
    let old = old(KEEP_DAYS + 1).await;
    let first =
        "UPDATE hub.run SET started_at = 'x' WHERE id = (SELECT min(id::text)::uuid FROM hub.run)";
    assert_eq!(old.hub.admin.execute(first, &[]).await.unwrap(), 1);
    assert_eq!(old.judge().await, 2);
    let judged = async |is: &str| old.hub.count(&format!("hub.result WHERE reason IS {is}")).await;
    assert_eq!((judged("NULL").await, judged("NOT NULL").await), (1, 1));
}

#[tokio::test]
async fn typed_rows_that_are_made_again_while_their_run_is_pruned_stay() {
    let old = old(KEEP_DAYS + 1).await;
    let hub = &old.hub;
    put(old.data.path(), old.folder.path(), |_| true);
    old.judge().await;
    let before = rows(hub).await;
    // The rows have been removed, and the records were not read yet.
    let blocker = hub.another().await;
    blocker.batch_execute("BEGIN; LOCK TABLE hub.unread IN SHARE MODE").await.unwrap();
    let (admin, other) = (hub.another().await, hub.another().await);
    let rebuilding = tokio::spawn(async move { admin::rebuild(&admin).await });
    hub.until("rows are being made again", async || hub.waiting().await == 1).await;
    let objects = store(old.folder.path());
    let pruning = tokio::spawn(async move { prune(&other, objects, KEEP_DAYS).await });
    hub.until("runs are pruned, or waited for", async || {
        pruning.is_finished() || hub.waiting().await == 2
    })
    .await;
    blocker.batch_execute("COMMIT").await.unwrap();
    timeout(PATIENCE, rebuilding).await.unwrap().unwrap().unwrap();
    assert_eq!(timeout(PATIENCE, pruning).await.unwrap().unwrap().unwrap().runs, 2);
    assert_eq!(rows(hub).await, before);
}

#[tokio::test]
async fn a_pruned_run_that_comes_again_is_no_clash_and_no_gap() {
    let old = old(KEEP_DAYS + 1).await;
    put(old.data.path(), old.folder.path(), |_| true);
    old.judge().await;
    assert_eq!(old.prune().await.runs, 2);
    old.ship_again().await;
    assert_eq!(old.hub.count("hub.clash").await, 0);
    assert_eq!(old.hub.alarms().await, [""; 0]);
    assert_eq!((old.records_of(0).await, old.records_of(2).await), (0, 2));
    // The journal goes on.
    let journal = Store::open(old.data.path()).unwrap();
    sealed_run(&journal, "later", 3);
    old.hub.ship(&old.role, old.data.path()).await.unwrap();
    let later = contents_of(old.data.path());
    let held = old.hub.contents().await;
    let is_open = |run: &str| old.runs[..2].iter().all(|pruned| pruned.to_string() != run);
    for (run, lines) in later.iter().filter(|(run, _)| is_open(run)) {
        assert_eq!(&held[run], lines);
    }
}

#[tokio::test]
async fn a_pruned_run_with_another_end_is_put_aside() {
    let old = old(KEEP_DAYS + 1).await;
    put(old.data.path(), old.folder.path(), |_| true);
    old.judge().await;
    assert_eq!(old.prune().await.runs, 2);
    let rewind = "UPDATE hub.journal SET cursor_event = 0, cursor_digest = ''";
    old.hub.admin.batch_execute(rewind).await.unwrap();
    let reader = Reader::open(old.data.path()).unwrap();
    let mut shipment = reader.shipment(0, 4, usize::MAX).unwrap();
    shipment.records[3].digest = shipment.records[2].digest;
    shipment.ends[0].head = shipment.records[2].digest;
    let client = old.hub.as_role(&old.role).await;
    let mut inlet = Inlet::open(client, &reader, "rigd 0").await.unwrap();
    inlet.send(&rig_hub::Batch::new(0, "", &shipment).unwrap()).await.unwrap();
    assert_eq!(old.hub.count("hub.clash").await, 1);
    assert_eq!(old.hub.alarms().await, ["clash"]);
}

#[tokio::test]
async fn a_run_stays_that_is_young_or_whose_object_is_missing_or_damaged() {
    let young = old(KEEP_DAYS - 1).await;
    put(young.data.path(), young.folder.path(), |_| true);
    young.judge().await;
    assert_eq!(young.prune().await, Pruned::default());

    let old = old(KEEP_DAYS + 1).await;
    old.judge().await;
    assert_eq!(old.prune().await.stayed["it has no object"], 2);
    let names = put(old.data.path(), old.folder.path(), |run| run == old.runs[0]);
    let path = old.folder.path().join(&names[0]);
    let sound = fs::read(&path).unwrap();
    fs::remove_file(&path).unwrap();
    for damaged in [sound[..sound.len() / 2].to_vec(), [&sound[..], b"x"].concat(), Vec::new()] {
        fs::write(&path, damaged).unwrap();
        let pruned = old.prune().await;
        assert_eq!((pruned.runs, old.records_of(0).await), (0, 4), "{pruned:?}");
    }
    fs::write(&path, sound).unwrap();
    assert_eq!(old.prune().await.runs, 1);
    assert_eq!((old.records_of(0).await, old.records_of(1).await), (0, 22));
}

/// Has the bench skip a step of a run that has ended.
fn amend(data: &Path, run: RunId) {
    let digest = Reader::open(data).unwrap().records(run).unwrap().last().unwrap().digest;
    skipped(&Store::open(data).unwrap(), run, digest);
}

#[tokio::test]
async fn an_amendment_stays_and_leaves_with_its_run() {
    let old = old(KEEP_DAYS + 1).await;
    amend(old.data.path(), old.runs[0]);
    old.hub.ship(&old.role, old.data.path()).await.unwrap();
    age(&old.hub, KEEP_DAYS + 1).await;
    old.judge().await;
    let names = put(old.data.path(), old.folder.path(), |run| run != old.runs[1]);
    assert_eq!(names.len(), 2);
    let of_run = names.iter().find(|name| name.contains(&old.runs[0].to_string())).unwrap();
    let aside = old.data.path().join("aside");
    fs::rename(old.folder.path().join(of_run), &aside).unwrap();
    let pruned = old.prune().await;
    assert_eq!((pruned.runs, pruned.stayed["the run that it amends stays"]), (0, 1), "{pruned:?}");
    fs::rename(aside, old.folder.path().join(of_run)).unwrap();
    let pruned = old.prune().await;
    assert_eq!(
        (pruned.runs, pruned.stayed.get("the run that it amends stays")),
        (2, None),
        "{pruned:?}"
    );
}

#[tokio::test]
async fn results_are_withdrawn_when_a_pruned_run_is_amended() {
    let old = old(KEEP_DAYS + 1).await;
    put(old.data.path(), old.folder.path(), |_| true);
    old.judge().await;
    old.hub
        .admin
        .batch_execute("INSERT INTO hub.stiffness SELECT run, 'gel', 5, 0.1, 5 FROM hub.result")
        .await
        .unwrap();
    assert_eq!(old.prune().await.runs, 2);
    amend(old.data.path(), old.runs[0]);
    old.hub.ship(&old.role, old.data.path()).await.unwrap();
    assert_eq!(old.hub.alarms().await, ["amended"]);
    let withdrawn = format!("run = '{}'", old.runs[0]);
    assert_eq!(old.hub.count(&format!("hub.stiffness WHERE {withdrawn}")).await, 0);
    let result = format!(
        "hub.result WHERE {withdrawn} AND model_verdict IS NULL AND amendments = 1
                          AND reason = 'it was amended after its records were removed'"
    );
    assert_eq!(old.hub.count(&result).await, 1);
    assert_eq!(old.hub.count("hub.stiffness").await, 1, "the other run keeps its own");
    assert_eq!(old.judge().await, 0);
}

#[tokio::test]
async fn a_bench_does_not_amend_the_runs_of_another() {
    let old = old(0).await;
    assert_eq!(old.judge().await, 2);
    let role = old.hub.bench("right").await;
    let data = TempDir::new().unwrap();
    let digest =
        Reader::open(old.data.path()).unwrap().records(old.runs[0]).unwrap().last().unwrap().digest;
    skipped(&Store::open(data.path()).unwrap(), old.runs[0], digest);
    old.hub.ship(&role, data.path()).await.unwrap();
    assert_eq!(old.judge().await, 0);
    amend(old.data.path(), old.runs[0]);
    old.hub.ship(&old.role, old.data.path()).await.unwrap();
    assert_eq!(old.judge().await, 1, "of its own bench it counts");
    assert_eq!(old.judge().await, 0);
}
