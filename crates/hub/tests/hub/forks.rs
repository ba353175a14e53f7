//! Journals that were restored or copied.

use std::path::Path;

use rig_hub::{Inlet, InletError, admin};
use rig_store::{Ending, Reader, RunKind, Store, back_up};
use tempfile::TempDir;

use crate::support::{
    Hub, append, assert_same, command, contents_of, finished, journal, sealed_run,
};

/// A copy of a journal as it is now.
fn copy(data: &Path) -> TempDir {
    let copied = TempDir::new().unwrap();
    back_up(data, copied.path(), &[]).unwrap();
    copied
}

#[tokio::test]
async fn a_restored_journal_is_sent_again_and_loses_nothing() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let (data, store, mut session) = journal();
    append(&mut session, &[finished(Ending::Completed)]);
    let backup = copy(data.path());
    sealed_run(&store, "lost with the disk", 5);
    hub.ship(&role, data.path()).await.unwrap();
    drop((session, store));
    let mut everything = contents_of(data.path());

    let store = Store::open(backup.path()).unwrap();
    sealed_run(&store, "on the new disk", 50);
    hub.ship(&role, backup.path()).await.unwrap();
    everything.extend(contents_of(backup.path()));
    assert_same(&hub.contents().await, &everything);
    assert_eq!(hub.alarms().await, ["rewound"]);
    assert_eq!(hub.count("hub.clash").await, 0);
    // It is begun again once.
    sealed_run(&store, "later", 2);
    hub.ship(&role, backup.path()).await.unwrap();
    everything.extend(contents_of(backup.path()));
    assert_same(&hub.contents().await, &everything);
    assert_eq!(hub.count("hub.journal WHERE rewinds = 1").await, 1);
}

#[tokio::test]
async fn a_shorter_journal_than_the_hub_knows_is_sent_again() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let (data, store, _session) = journal();
    let backup = copy(data.path());
    sealed_run(&store, "lost with the disk", 5);
    let last = hub.ship(&role, data.path()).await.unwrap();
    let shorter = hub.ship(&role, backup.path()).await.unwrap();
    assert!(shorter < last);
    assert_eq!(hub.alarms().await, ["rewound"]);
    assert_same(&hub.contents().await, &contents_of(data.path()));
}

#[tokio::test]
async fn two_copies_of_a_journal_are_quarantined_until_a_person_decides() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let (data, store, mut session) = journal();
    let copied = copy(data.path());
    let other = Store::open(copied.path()).unwrap();
    append(&mut session, &[command("here"), command("here again")]);
    sealed_run(&store, "here", 3);
    sealed_run(&other, "there", 3);
    hub.ship(&role, data.path()).await.unwrap();
    hub.ship(&role, copied.path()).await.unwrap();
    // The copy has ended the session; here it goes on.
    assert_eq!(hub.alarms().await, ["rewound", "clash"]);
    assert!(hub.count("hub.clash").await > 0);
    sealed_run(&store, "here", 4);
    let refused = hub.ship(&role, data.path()).await;
    assert!(matches!(refused, Err(InletError::Refused { .. })), "{refused:?}");
    assert_eq!(hub.alarms().await, ["rewound", "clash", "quarantine"]);
    for data in [data.path(), copied.path()] {
        let refused = hub.ship(&role, data).await;
        assert!(matches!(refused, Err(InletError::Refused { .. })), "{refused:?}");
    }
    // What both had before the decision is there, and of the session what was there first.
    let contents = hub.contents().await;
    let mine = contents_of(data.path());
    let id = session.id().to_string();
    assert_eq!(contents[&id], mine[&id]);
    for (run, lines) in contents_of(copied.path()) {
        assert!(run == id || contents[&run] == lines, "{run}");
    }

    let journal: String =
        hub.admin.query_one("SELECT id::text FROM hub.journal", &[]).await.unwrap().get(0);
    let (mut admin, _task) =
        rig_hub::connect(&crate::support::server().admin(&hub.database), None).await.unwrap();
    admin::release_journal(&mut admin, &journal).await.unwrap();
    assert!(admin::release_journal(&mut admin, &journal).await.is_err(), "it is not quarantined");
    hub.ship(&role, data.path()).await.unwrap();
    let contents = hub.contents().await;
    for (run, lines) in contents_of(data.path()) {
        assert_eq!(contents[&run], lines, "{run}");
    }
    for alarm in rig_hub::state(&admin).await.unwrap().alarms {
        admin::acknowledge(&admin, alarm.id, "ada").await.unwrap();
        assert!(admin::acknowledge(&admin, alarm.id, "ada").await.is_err(), "it was looked at");
    }
    assert_eq!(hub.alarms().await, [""; 0]);
}

/// Its connection is that of before. What it writes next would have gone on behind records that it does not have.
#[tokio::test]
async fn an_idle_bench_whose_copy_has_shipped_meanwhile_sends_its_journal_again() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let (data, store, session) = journal();
    let reader = Reader::open(data.path()).unwrap();
    let mut inlet = Inlet::open(hub.as_role(&role).await, &reader, "rigd 0").await.unwrap();
    let send = async |inlet: &mut Inlet| {
        while let Some(batch) = inlet.next(&reader).unwrap() {
            inlet.send(&batch).await.unwrap();
        }
    };
    send(&mut inlet).await;
    let copied = copy(data.path());
    sealed_run(&Store::open(copied.path()).unwrap(), "there", 3);
    hub.ship(&role, copied.path()).await.unwrap();
    sealed_run(&store, "here", 3);
    inlet.greet(&reader, "rigd 0").await.unwrap();
    send(&mut inlet).await;
    let (contents, id) = (hub.contents().await, session.id().to_string());
    for (run, lines) in contents_of(data.path()).into_iter().filter(|(run, _)| *run != id) {
        assert_eq!(contents[&run], lines, "{run}");
    }
    assert!(hub.alarms().await.contains(&"rewound".to_owned()), "{:?}", hub.alarms().await);
}

#[tokio::test]
async fn a_run_that_went_on_in_two_ways_keeps_the_first_and_puts_the_other_aside() {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let data = TempDir::new().unwrap();
    let store = Store::open(data.path()).unwrap();
    let mut run = store.begin(RunKind::Run, "long").unwrap();
    append(&mut run, &[command("begin")]);
    let copied = copy(data.path());
    append(&mut run, &[command("one"), command("two"), finished(Ending::Completed)]);
    hub.ship(&role, data.path()).await.unwrap();
    let other = Store::open(copied.path()).unwrap();
    let mut again = other.reopen(run.id()).unwrap();
    append(&mut again, &[command("other"), finished(Ending::Completed)]);
    hub.ship(&role, copied.path()).await.unwrap();
    assert_same(&hub.contents().await, &contents_of(data.path()));
    assert_eq!(hub.count("hub.clash").await, 2);
    assert_eq!(hub.alarms().await, ["rewound", "clash"]);
    // Again, it is nothing new.
    hub.ship(&role, copied.path()).await.unwrap();
    assert_eq!(hub.count("hub.clash").await, 2);
}

/// A copy has gone on with the run and was refused; then the run goes on where it is, in the same stretch or in the next one.
async fn check_seal_behind_a_refused_fork(is_resumed: bool) {
    let hub = Hub::new().await;
    let role = hub.bench("left").await;
    let data = TempDir::new().unwrap();
    let mut store = Store::open(data.path()).unwrap();
    let mut run = store.begin(RunKind::Run, "long").unwrap();
    append(&mut run, &[command("begin")]);
    let copied = copy(data.path());
    append(&mut run, &[command("one")]);
    hub.ship(&role, data.path()).await.unwrap();
    let mut fork = Store::open(copied.path()).unwrap().reopen(run.id()).unwrap();
    append(&mut fork, &[command("other")]);
    hub.ship(&role, copied.path()).await.unwrap();
    assert_eq!(hub.alarms().await, ["rewound", "clash"]);

    if is_resumed {
        let id = run.id();
        drop((run, store));
        store = Store::open(data.path()).unwrap();
        run = store.reopen(id).unwrap();
    }
    append(&mut run, &[finished(Ending::Completed)]);
    // It is taken, and then there are two copies.
    let refused = hub.ship(&role, data.path()).await;
    assert!(matches!(refused, Err(InletError::Refused { .. })), "{refused:?}");
    assert_same(&hub.contents().await, &contents_of(data.path()));
    assert_eq!(hub.count("hub.run WHERE seal IS NOT NULL").await, 1, "resumed: {is_resumed}");
    assert_eq!(hub.count("hub.alarm WHERE detail LIKE '%another stretch%'").await, 0);
    drop(store);
}

#[tokio::test]
async fn a_run_is_sealed_whose_copy_has_gone_on_and_was_refused() {
    for is_resumed in [false, true] {
        check_seal_behind_a_refused_fork(is_resumed).await;
    }
}
