//! Runs that stopped early: resumed, given up, sealed, amended.

use super::sample::{Directory, append, records, run_started, sweep};
use crate::{
    Amended, Amendment, ChainCheck, Ending, Flaw, Journal, Reader, Record, Resumed, RunFinished,
    RunId, RunKind, RunStatus, Store, StoreError, SweepPurpose,
};

pub(super) fn resumed(epoch: u64) -> Record {
    Record::Resumed(Resumed {
        epoch,
        who: "Ada".to_owned(),
        next: Some("main/1/back/30/1".to_owned()),
        touches_done: 0,
        touches_left: 1,
        changes: Vec::new(),
        software: "rigd".to_owned(),
        rig: None,
        scene: None,
        calibrations: None,
        devices: Vec::new(),
    })
}

fn end(status: Ending) -> Record {
    Record::RunFinished(RunFinished { status })
}

/// A run of the first `count` records, whose program has ended.
fn cut_short(directory: &Directory, count: usize) -> RunId {
    let store = Store::open(directory.path()).unwrap();
    let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
    for (second, record) in (1000..).zip(records().into_iter().take(count)) {
        append(&mut journal, second, &record);
    }
    journal.commit().unwrap();
    journal.id()
}

fn resume(store: &Store, run: RunId) -> Journal {
    let mut journal = store.reopen(run).unwrap();
    append(&mut journal, 1, &resumed(store.epoch().unwrap()));
    journal.commit().unwrap();
    journal
}

#[test]
fn a_run_goes_on_behind_any_of_its_records_and_is_sealed_at_its_end() {
    for cut in 1..=records().len() {
        let directory = Directory::new();
        let id = cut_short(&directory, cut);
        let reader = Reader::open(directory.path()).unwrap();
        for part in 0..2 {
            let store = Store::open(directory.path()).unwrap();
            let run = reader.run(id).unwrap();
            assert!(run.is_resumable() && !run.is_sealed, "cut at {cut}, part {part}: {run:?}");
            let mut journal = resume(&store, id);
            assert_eq!(reader.run(id).unwrap().status, RunStatus::Running);
            let refusal = store.reopen(id).unwrap_err();
            assert!(matches!(refusal, StoreError::UnderWay { .. }), "{refusal}");
            append(&mut journal, 2, &sweep(9, SweepPurpose::NoLoad, 140.0));
            journal.commit().unwrap();
        }
        let store = Store::open(directory.path()).unwrap();
        let mut journal = resume(&store, id);
        append(&mut journal, 3, &end(Ending::Completed));
        journal.commit().unwrap();
        let run = reader.run(id).unwrap();
        assert_eq!((run.status, run.is_sealed), (RunStatus::Ended(Ending::Completed), true));
        let refusal = store.reopen(id).unwrap_err().to_string();
        assert!(refusal.contains("one touch-1") && refusal.contains("completed"), "{refusal}");

        let stored = reader.records(id).unwrap();
        assert_eq!(stored.len(), cut + 6);
        let epochs: Vec<_> = stored.iter().map(|stored| stored.epoch).collect();
        assert!(epochs.is_sorted() && (epochs[0], epochs[cut + 5]) == (1, 4), "{epochs:?}");
        // The clock of the rig started again; the times of the run continue.
        assert!(stored[cut].rig_us < stored[cut - 1].rig_us);
        assert!(stored.is_sorted_by_key(|stored| stored.run_us), "cut at {cut}");
        assert!(stored.is_sorted_by_key(|stored| stored.at.clone()), "cut at {cut}");
        assert_eq!(stored[0].run_us, 0);
    }
}

#[test]
fn a_run_that_ended_early_goes_on_in_the_same_epoch_too() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
    append(&mut journal, 5, &run_started());
    for ending in [Ending::Faulted, Ending::Aborted] {
        append(&mut journal, 6, &end(ending));
        journal.commit().unwrap();
        let reader = store.reader().unwrap();
        let run = reader.run(journal.id()).unwrap();
        assert_eq!((run.status, run.is_sealed), (RunStatus::Ended(ending), false));
        journal = store.reopen(run.id).unwrap();
        append(&mut journal, 7, &resumed(store.epoch().unwrap()));
        journal.commit().unwrap();
        assert_eq!(reader.run(run.id).unwrap().status, RunStatus::Running);
    }
    append(&mut journal, 8, &end(Ending::CompletedWithRefusals));
    journal.commit().unwrap();
    let stored = store.reader().unwrap().records(journal.id()).unwrap();
    assert_eq!((stored.len(), stored[5].run_us), (6, 3_000_000));
}

#[test]
fn a_run_that_is_given_up_is_sealed() {
    for cut in [1, records().len()] {
        let directory = Directory::new();
        let id = cut_short(&directory, cut);
        let store = Store::open(directory.path()).unwrap();
        store.give_up(id, 0, "Ada").unwrap();
        let run = store.reader().unwrap().run(id).unwrap();
        let expected = if cut == 1 { Ending::Interrupted } else { Ending::Faulted };
        assert_eq!((run.status, run.is_sealed), (RunStatus::Ended(expected), true));
        assert!(matches!(store.reopen(id).unwrap_err(), StoreError::Sealed { .. }));
        assert!(matches!(store.give_up(id, 0, "Ada").unwrap_err(), StoreError::Sealed { .. }));
        assert_eq!(store.reader().unwrap().records(id).unwrap().len(), cut + 2);
    }
}

#[test]
fn the_seal_of_a_run_that_was_given_up_is_missed() {
    for cut in [1, records().len()] {
        let directory = Directory::new();
        let id = cut_short(&directory, cut);
        Store::open(directory.path()).unwrap().give_up(id, 0, "Ada").unwrap();
        let reader = Reader::open(directory.path()).unwrap();
        assert!(matches!(reader.verify(id).unwrap(), ChainCheck::Intact { .. }), "cut at {cut}");
        let database = rusqlite::Connection::open(directory.path().join("rigd.db")).unwrap();
        assert_eq!(database.execute("DELETE FROM seals", []).unwrap(), 1);
        let (seq, flaw) = (cut as u64 + 2, Flaw::SealDiffers);
        assert_eq!(reader.verify(id).unwrap(), ChainCheck::Broken { seq, flaw }, "cut at {cut}");
    }
}

/// A journal with a completed run between two others.
fn sealed_journal() -> (Directory, RunId) {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let [_, id, _] = [(); 3].map(|()| {
        let mut journal = store.begin(RunKind::Run, "short").unwrap();
        append(&mut journal, 0, &run_started());
        append(&mut journal, 1, &end(Ending::Completed));
        journal.commit().unwrap();
        journal.id()
    });
    (directory, id)
}

#[test]
fn a_changed_list_of_runs_is_noticed() {
    #[track_caller]
    fn check(change: &str, expected: Option<&Flaw>) {
        let (directory, id) = sealed_journal();
        let database = rusqlite::Connection::open(directory.path().join("rigd.db")).unwrap();
        database.execute_batch(&format!("PRAGMA foreign_keys = OFF; {change}")).unwrap();
        let reader = Reader::open(directory.path()).unwrap();
        let found = match reader.verify(id).unwrap() {
            ChainCheck::Broken { flaw, .. } => Some(flaw),
            ChainCheck::Intact { .. } => None,
        };
        assert_eq!(found.as_ref(), expected, "{change}");
    }
    check("", None);
    let seal = || Some(&Flaw::SealDiffers);
    check("DELETE FROM seals WHERE run = 2", seal());
    check("UPDATE seals SET seal = zeroblob(32) WHERE run = 2", seal());
    check("UPDATE seals SET seal = x'00' WHERE run = 2", seal());
    check("UPDATE runs SET finished_at = '2026-01-01T00:00:00.000Z' WHERE key = 2", seal());
    check("UPDATE runs SET finished_at = NULL WHERE key = 2", seal());
    check("UPDATE runs SET name = 'other' WHERE key = 2", Some(&Flaw::ListDiffers));
}

#[test]
fn a_run_that_was_taken_out_of_the_list_is_missed() {
    let (directory, id) = sealed_journal();
    let reader = Reader::open(directory.path()).unwrap();
    assert_eq!(reader.broken_link().unwrap(), None);
    let database = rusqlite::Connection::open(directory.path().join("rigd.db")).unwrap();
    let take_out = "PRAGMA foreign_keys = OFF; DELETE FROM runs WHERE key = 2";
    database.execute_batch(take_out).unwrap();
    let behind = reader.runs().unwrap()[0].id;
    assert_ne!(behind, id);
    assert_eq!(reader.broken_link().unwrap(), Some(behind.to_string()));
}

#[test]
fn amendments_stand_behind_the_records_of_their_run() {
    let (directory, id) = sealed_journal();
    let store = Store::open(directory.path()).unwrap();
    let reader = store.reader().unwrap();
    let before = reader.records(id).unwrap();
    for what in [Amendment::Redo, Amendment::Skip] {
        let mut journal = store.begin(RunKind::Amendment, &id.to_string()).unwrap();
        let amended = Amended {
            run: id.to_string(),
            head: before[1].digest.to_string(),
            step: "main/1/back/30/1".to_owned(),
            what,
            who: "Ada".to_owned(),
            why: "the sample slipped".to_owned(),
            software: "rigd".to_owned(),
            rig: None,
            calibrations: None,
            devices: Vec::new(),
            changes: Vec::new(),
        };
        append(&mut journal, 0, &Record::Amended(amended));
        append(&mut journal, 1, &end(Ending::Completed));
        journal.commit().unwrap();
    }
    let kinds: Vec<_> = reader.amended(id).unwrap().into_iter().map(|stored| stored.kind).collect();
    let expected =
        ["run_started", "run_finished", "amended", "run_finished", "amended", "run_finished"];
    assert_eq!(kinds, expected);
    assert_eq!(reader.records(id).unwrap(), before);
    let mut pages = reader.amended_pages(id).unwrap();
    let mut paged = Vec::new();
    while let Some(page) = Some(reader.next_page(&mut pages).unwrap()).filter(|p| !p.is_empty()) {
        paged.extend(page);
    }
    assert_eq!(paged, reader.amended(id).unwrap());
    assert_eq!(reader.find("latest").unwrap().name, "short");
    assert_eq!(reader.run(id).unwrap().amendments, 2);
}
