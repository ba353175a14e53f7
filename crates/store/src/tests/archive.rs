//! Runs that are copied to an archive, and whose readings are then taken out of the journal.

use std::fs;

use super::sample::{Directory, append, records, run_started, sweep};
use crate::{
    ChainCheck, DiskFailure, Ending, Flaw, MemoryDisk, Reader, Record, RunFinished, RunId, RunKind,
    Store, StoreError, SweepPurpose, back_up, excerpt, salvage,
};

/// A run with a sweep that ends in this way.
fn run(store: &Store, status: Ending) -> RunId {
    let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
    for (second, record) in (1..).zip(&records()[..records().len() - 1]) {
        append(&mut journal, second, record);
    }
    append(&mut journal, 60, &Record::RunFinished(RunFinished { status }));
    journal.commit().unwrap();
    journal.id()
}

/// A session with two runs that were completed.
fn session(store: &Store) -> [RunId; 2] {
    let mut session = store.begin(RunKind::Session, "simulated").unwrap();
    append(&mut session, 0, &records()[7]);
    let runs = [run(store, Ending::Completed), run(store, Ending::Completed)];
    append(&mut session, 61, &Record::RunFinished(RunFinished { status: Ending::Completed }));
    session.commit().unwrap();
    runs
}

fn is_intact(reader: &Reader, run: RunId) -> bool {
    matches!(reader.verify(run).unwrap(), ChainCheck::Intact { .. })
}

/// Executes a statement about the run with this key.
fn tamper(directory: &Directory, statement: &str) {
    let database = rusqlite::Connection::open(directory.path().join("rigd.db")).unwrap();
    assert!(database.execute(statement, []).unwrap() > 0, "{statement}");
}

#[test]
fn an_excerpt_has_the_run_with_its_number_and_is_not_written() {
    let (data, to) = (Directory::new(), Directory::new());
    let store = Store::open(data.path()).unwrap();
    let [first, second] = session(&store);
    let mut amendment = store.begin(RunKind::Amendment, &second.to_string()).unwrap();
    append(&mut amendment, 70, &run_started());
    append(&mut amendment, 71, &Record::RunFinished(RunFinished { status: Ending::Completed }));
    amendment.commit().unwrap();
    let live = store.reader().unwrap();
    let copied = excerpt(data.path(), second, to.path()).unwrap();
    let expected = [second, amendment.id()].map(|id| (id, live.last_digest(id).unwrap().unwrap()));
    assert_eq!(copied, expected);

    let files = || fs::read_dir(to.path()).unwrap().count();
    let archived = Reader::open(to.path()).unwrap();
    assert_eq!(archived.records(second).unwrap(), live.records(second).unwrap());
    assert_eq!(archived.amended(second).unwrap(), live.amended(second).unwrap());
    let [of_archive, of_live] =
        [&archived, &live].map(|reader| reader.find("one touch-2").unwrap());
    assert_eq!(of_archive.short_name(), of_live.short_name());
    assert_eq!((of_archive.records, of_archive.amendments), (of_live.records, 1));
    assert!(archived.broken_link().unwrap().is_none());
    // The run before is only there as far as it moved the axes.
    assert!(matches!(archived.run(first), Err(StoreError::NoSuchRun { .. })));
    assert_eq!(archived.runs().unwrap().len(), 2);
    drop(archived);
    let before = (files(), fs::read(to.path().join("rigd.db")).unwrap());
    assert!(matches!(Store::open(to.path()), Err(StoreError::IsExcerpt)));
    assert_eq!((files(), fs::read(to.path().join("rigd.db")).unwrap()), before);
    assert!(matches!(excerpt(data.path(), first, to.path()), Err(StoreError::NotEmpty)));
}

#[test]
fn what_can_go_on_is_neither_copied_nor_taken_out() {
    let (data, to) = (Directory::new(), Directory::new());
    let store = Store::open(data.path()).unwrap();
    let open = run(&store, Ending::Faulted);
    assert!(matches!(excerpt(data.path(), open, to.path()), Err(StoreError::NotSealed { .. })));
    assert!(matches!(store.archive(open, "there", "me"), Err(StoreError::NotSealed { .. })));
    let sealed = run(&store, Ending::Completed);
    let mut amendment = store.begin(RunKind::Amendment, &sealed.to_string()).unwrap();
    append(&mut amendment, 70, &run_started());
    amendment.commit().unwrap();
    assert!(matches!(excerpt(data.path(), sealed, to.path()), Err(StoreError::UnderWay { .. })));
    assert!(matches!(store.archive(sealed, "there", "me"), Err(StoreError::UnderWay { .. })));
    let reader = store.reader().unwrap();
    assert!(is_intact(&reader, open) && is_intact(&reader, sealed));
    assert!(reader.archive_of(sealed).unwrap().is_none());
}

/// Its program was killed, and nothing has opened the journal to write since.
#[test]
fn a_run_with_an_amendment_without_its_end_is_not_copied() {
    let (data, to) = (Directory::new(), Directory::new());
    let store = Store::open(data.path()).unwrap();
    let sealed = run(&store, Ending::Completed);
    let mut amendment = store.begin(RunKind::Amendment, &sealed.to_string()).unwrap();
    append(&mut amendment, 70, &run_started());
    amendment.commit().unwrap();
    drop((amendment, store));
    let refusal = excerpt(data.path(), sealed, to.path()).unwrap_err();
    assert!(matches!(refusal, StoreError::UnderWay { .. }), "{refusal}");
    assert!(!to.path().join("rigd.db").exists());
    // An opening ends it.
    drop(Store::open(data.path()).unwrap());
    assert_eq!(excerpt(data.path(), sealed, to.path()).unwrap().len(), 2);
}

#[test]
fn a_damaged_run_is_refused_before_its_amendment_is_changed() {
    let data = Directory::new();
    let store = Store::open(data.path()).unwrap();
    let id = run(&store, Ending::Completed);
    let mut amendment = store.begin(RunKind::Amendment, &id.to_string()).unwrap();
    append(&mut amendment, 70, &run_started());
    append(&mut amendment, 71, &Record::RunFinished(RunFinished { status: Ending::Completed }));
    amendment.commit().unwrap();
    tamper(&data, "UPDATE records SET payload = '{}' WHERE run = 1 AND seq = 3");
    let refusal = store.archive(id, "there", "me").unwrap_err();
    assert!(matches!(refusal, StoreError::Broken { .. }), "{refusal}");
    // The commit of another run would put what was changed on disk.
    let other = run(&store, Ending::Completed);
    let reader = store.reader().unwrap();
    assert!(is_intact(&reader, amendment.id()) && is_intact(&reader, other));
    assert!(reader.archive_of(amendment.id()).unwrap().is_none());
    assert!(reader.runs().unwrap().iter().all(|run| run.kind != RunKind::Archive));
}

#[test]
fn an_archived_run_keeps_its_chain_and_loses_its_readings() {
    let data = Directory::new();
    let store = Store::open(data.path()).unwrap();
    let [first, second] = session(&store);
    let before = store.reader().unwrap().records(first).unwrap();
    store.archive(first, "/archive/first", "somebody").unwrap();
    // Again, as after a kill behind the commit.
    store.archive(first, "/archive/first", "somebody").unwrap();
    let reader = store.reader().unwrap();
    let note = reader.archive_of(first).unwrap().unwrap();
    assert_eq!((&*note.place, &*note.who), ("/archive/first", "somebody"));
    assert_eq!((note.records, note.head), (14, before[13].digest.to_string()));
    assert!(is_intact(&reader, first) && is_intact(&reader, second));
    assert!(reader.broken_link().unwrap().is_none());
    let runs = reader.runs().unwrap();
    let notes: Vec<_> = runs.iter().filter(|run| run.kind == RunKind::Archive).collect();
    assert_eq!(notes.len(), 1);
    assert!(is_intact(&reader, notes[0].id) && notes[0].is_sealed);
    let refusal = reader.records(first).unwrap_err();
    assert!(matches!(refusal, StoreError::Archived { .. }), "{refusal}");
    assert_eq!(reader.run(first).unwrap().records, 14);
    assert!(reader.is_simulated(first));
    // What moved the axes is still there, and so is its event number.
    let of_run: Vec<_> = reader
        .events_after(0, 1000)
        .unwrap()
        .into_iter()
        .filter(|record| record.run == first)
        .collect();
    let kept: Vec<_> = before
        .iter()
        .filter(|record| !Record::ARCHIVED_KINDS.contains(&&*record.kind))
        .cloned()
        .collect();
    assert_eq!(of_run, kept);
    assert_eq!(reader.unchecked(first, &["sweep", "moved"]).unwrap().len(), 1);
    assert_eq!(kept.len(), 11, "two sweeps and a surface are gone");
}

/// Each statement is done to a journal whose run 2 was archived.
#[track_caller]
fn check_found(statement: &str, expected: &Flaw) {
    let data = Directory::new();
    let store = Store::open(data.path()).unwrap();
    let [first, _] = session(&store);
    store.archive(first, "/archive/first", "somebody").unwrap();
    drop(store);
    tamper(&data, statement);
    match Reader::open(data.path()).unwrap().verify(first).unwrap() {
        ChainCheck::Broken { flaw, .. } => assert_eq!(&flaw, expected, "{statement}"),
        check @ ChainCheck::Intact { .. } => panic!("{statement}: {check:?}"),
    }
}

#[test]
fn what_is_left_of_an_archived_run_is_still_under_its_digests() {
    let moved = "WHERE run = 2 AND kind = 'moved'";
    check_found(&format!("UPDATE records SET payload = '' {moved}"), &Flaw::Altered);
    check_found(
        &format!("UPDATE records SET payload = replace(payload, '10.1249', '10.1248') {moved}"),
        &Flaw::Altered,
    );
    check_found(&format!("DELETE FROM records {moved}"), &Flaw::Missing);
    check_found(
        "UPDATE records SET payload = '{}' WHERE run = 2 AND kind = 'sweep'",
        &Flaw::Altered,
    );
    // The note says something else, or is gone.
    check_found(
        "UPDATE records SET payload = replace(payload, '/archive', '/elsewhere')
         WHERE kind = 'archived'",
        &Flaw::NoteDiffers,
    );
    check_found("UPDATE runs SET name = 'x' WHERE kind = 'archive'", &Flaw::Altered);
    check_found("DELETE FROM seals WHERE run = 4", &Flaw::Altered);
}

#[test]
fn readings_without_content_are_damage_where_no_note_says_so() {
    let data = Directory::new();
    let store = Store::open(data.path()).unwrap();
    let [first, second] = session(&store);
    store.archive(first, "/archive/first", "somebody").unwrap();
    drop(store);
    tamper(&data, "UPDATE records SET payload = '' WHERE run = 3 AND kind = 'sweep'");
    let reader = Reader::open(data.path()).unwrap();
    assert!(is_intact(&reader, first) && !is_intact(&reader, second));
}

#[test]
fn a_backup_and_a_salvage_of_a_journal_with_archived_runs_are_whole() {
    let (data, backup, salvaged) = (Directory::new(), Directory::new(), Directory::new());
    let store = Store::open(data.path()).unwrap();
    let [first, second] = session(&store);
    store.archive(first, "/archive/first", "somebody").unwrap();
    let copied = back_up(data.path(), backup.path(), &[]).unwrap();
    assert!(copied.len() == 4 && copied.iter().all(|run| run.flaw.is_none()), "{copied:?}");
    let found = salvage(data.path(), salvaged.path(), &[]).unwrap();
    assert!(found.len() == 4 && found.iter().all(|run| run.flaw.is_none()), "{found:?}");
    for copy in [backup, salvaged] {
        let reader = Reader::open(copy.path()).unwrap();
        assert!(is_intact(&reader, first) && is_intact(&reader, second));
        assert_eq!(reader.archive_of(first).unwrap().unwrap().place, "/archive/first");
    }
}

/// The disk fails at each call of the writer in turn.
#[test]
fn a_failing_disk_leaves_the_run_whole_or_archived() {
    let (mut whole, mut archived) = (0, 0);
    for nth in 1..20 {
        let disk = MemoryDisk::new().unwrap();
        let store = Store::open_in_memory(&disk).unwrap();
        let id = run(&store, Ending::Completed);
        disk.fail_from(nth, DiskFailure::Io);
        let done = store.archive(id, "there", "me");
        drop(store);
        disk.mend();
        let store = Store::open_in_memory(&disk).unwrap();
        let reader = store.reader().unwrap();
        assert!(is_intact(&reader, id), "call {nth}");
        let is_archived = reader.archive_of(id).unwrap().is_some();
        assert_eq!(done.is_ok(), is_archived, "call {nth}");
        if is_archived {
            archived += 1;
            continue;
        }
        assert_eq!(reader.records(id).unwrap().len(), 14, "call {nth}");
        // It is done when it is asked for again.
        store.archive(id, "there", "me").unwrap();
        assert!(is_intact(&reader, id) && reader.archive_of(id).unwrap().is_some());
        whole += 1;
    }
    assert!(whole >= 4 && archived >= 4, "{whole} {archived}");
}

#[test]
fn space_is_given_back_to_the_journal() {
    let data = Directory::new();
    let store = Store::open(data.path()).unwrap();
    let long = |store: &Store| {
        let mut journal = store.begin(RunKind::Run, "long").unwrap();
        append(&mut journal, 0, &run_started());
        for number in 1..200 {
            append(&mut journal, number, &sweep(number, SweepPurpose::Touch, 150.0));
        }
        let status = Ending::Completed;
        append(&mut journal, 300, &Record::RunFinished(RunFinished { status }));
        journal.commit().unwrap();
        journal.id()
    };
    let first = long(&store);
    let bytes_of = || store.reader().unwrap().bytes_of(first).unwrap();
    let whole = bytes_of();
    store.archive(first, "there", "me").unwrap();
    assert!(bytes_of() * 2 < whole, "{} of {whole}", bytes_of());
    let pages = || -> (i64, i64) {
        let database = rusqlite::Connection::open(data.path().join("rigd.db")).unwrap();
        let pragma = |name| database.pragma_query_value(None, name, |row| row.get(0)).unwrap();
        (pragma("page_count"), pragma("freelist_count"))
    };
    let (all, free) = pages();
    // The size that is told is that of the file, within a fifth.
    let file = u64::try_from(all).unwrap() * 4096;
    assert!(whole * 5 > file * 4 && whole * 4 < file * 5, "{whole} of {file} bytes");
    assert!(2 * free > all, "{free} of {all} pages are free");
    // The next run takes their place.
    long(&store);
    let grown = pages().0 - all;
    assert!(grown * 4 < all, "{grown} more than {all} pages");
}
