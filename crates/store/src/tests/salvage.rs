//! Salvage of damaged journals, and read-only journals.

use std::{fs, path::Path};

use rusqlite::Connection;

use super::sample::{Directory, append, names, records, sweep};
use crate::{
    Axis, ChainCheck, Ending, Flaw, Move, ProbeWord, Reader, Record, RunFinished, RunId, RunKind,
    Store, StoreError, StoredRecord, SweepPurpose, back_up, salvage,
};

/// Size of a page of the database, bytes.
const PAGE: usize = 4096;

/// Runs of many pages, completed, faulted and cut short, and a session.
fn journal() -> (Directory, Vec<(RunId, Vec<StoredRecord>)>) {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let mut ids = Vec::new();
    for ending in [Some(Ending::Completed), Some(Ending::Faulted), None, Some(Ending::Completed)] {
        let mut journal = store.begin(RunKind::Run, "many pages").unwrap();
        append(&mut journal, 0, &records()[0]);
        for number in 1..20 {
            append(&mut journal, number, &sweep(number, SweepPurpose::Touch, 150.0));
        }
        if let Some(status) = ending {
            append(&mut journal, 30, &Record::RunFinished(RunFinished { status }));
        }
        journal.commit().unwrap();
        ids.push(journal.id());
    }
    drop(store);
    let reader = Reader::open(directory.path()).unwrap();
    let runs = ids.into_iter().map(|id| (id, reader.records(id).unwrap())).collect();
    (directory, runs)
}

fn payloads(records: &[StoredRecord]) -> Vec<&str> {
    records.iter().map(|record| record.payload.as_str()).collect()
}

#[test]
fn a_sound_journal_is_copied_as_it_is() {
    let (directory, runs) = journal();
    let target = Directory::new();
    let salvaged = salvage(directory.path(), target.path(), &[]).unwrap();
    assert!(salvaged.iter().all(|run| run.flaw.is_none()) && salvaged.len() == 4, "{salvaged:?}");
    let (old, new) = (directory.path(), target.path());
    let (old, new) = (Reader::open(old).unwrap(), Reader::open(new).unwrap());
    assert_eq!(old.runs().unwrap(), new.runs().unwrap());
    for (id, expected) in &runs {
        assert_eq!(&new.records(*id).unwrap(), expected);
    }
    assert_eq!(new.broken_link().unwrap(), None);
    let refusal = salvage(directory.path(), target.path(), &[]).unwrap_err();
    assert!(matches!(refusal, StoreError::NotEmpty), "{refusal}");
    drop(new);
    // The copy can be written, and the run without an end can be resumed.
    let store = Store::open(target.path()).unwrap();
    assert_eq!(store.interrupted(), [runs[2].0]);
    store.reopen(runs[2].0).unwrap();
}

/// A page of the index that was not written hides records that are in the table.
#[test]
fn records_that_an_index_does_not_show_are_copied() {
    let (directory, runs) = journal();
    let old = Connection::open(directory.path().join("rigd.db")).unwrap();
    let schema: String = old
        .query_row(
            "SELECT sql FROM sqlite_schema WHERE name = 'records' AND type = 'table'",
            [],
            |row| row.get(0),
        )
        .unwrap();
    let kept = "CREATE TABLE kept AS SELECT * FROM records WHERE run = 3 AND seq > 5";
    old.execute_batch(kept).unwrap();
    assert!(schema.contains("UNIQUE (run, seq)"), "{schema}");
    // The table without its index gets records that the index has not.
    old.execute("DELETE FROM records WHERE run = 3 AND seq > 5", []).unwrap();
    old.pragma_update(None, "writable_schema", true).unwrap();
    let without = schema.replace("UNIQUE (run, seq)", "CHECK (seq > 0)");
    let set = "UPDATE sqlite_schema SET sql = ?1 WHERE name = 'records' AND type = 'table'";
    let index = "SELECT name, tbl_name, rootpage FROM sqlite_schema
                 WHERE type = 'index' AND tbl_name = 'records' AND sql IS NULL";
    let hidden: (String, String, i64) =
        old.query_row(index, [], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?))).unwrap();
    old.execute("DELETE FROM sqlite_schema WHERE type = 'index' AND name = ?1", [&hidden.0])
        .unwrap();
    old.execute(set, [&without]).unwrap();
    drop(old);
    let old = Connection::open(directory.path().join("rigd.db")).unwrap();
    old.pragma_update(None, "foreign_keys", false).unwrap();
    old.execute_batch("INSERT INTO records SELECT * FROM kept; DROP TABLE kept;").unwrap();
    old.pragma_update(None, "writable_schema", true).unwrap();
    old.execute(
        "INSERT INTO sqlite_schema (type, name, tbl_name, rootpage) VALUES ('index', ?1, ?2, ?3)",
        rusqlite::params![hidden.0, hidden.1, hidden.2],
    )
    .unwrap();
    old.execute(set, [&schema]).unwrap();
    drop(old);

    let shown = Reader::open(directory.path()).unwrap().records(runs[2].0).unwrap();
    assert_eq!(shown.len(), 5, "the index shows them");
    let target = Directory::new();
    let salvaged = salvage(directory.path(), target.path(), &[]).unwrap();
    assert!(salvaged.iter().all(|run| run.flaw.is_none()), "{salvaged:?}");
    assert_eq!(&Reader::open(target.path()).unwrap().records(runs[2].0).unwrap(), &runs[2].1);
}

/// What is left of the records may end with the probe clear.
#[test]
fn a_copy_that_has_lost_the_last_records_does_not_show_the_probe_clear() {
    for (damage, is_lost) in [
        ("", false),
        ("UPDATE records SET payload = '{' WHERE run = 2 AND seq = 2", false),
        ("UPDATE records SET payload = '{' WHERE run = 4 AND seq = 3", true),
        ("UPDATE runs SET id = CAST(x'ff' AS TEXT) WHERE key = 4", true),
    ] {
        let directory = Directory::new();
        let clear = |position_mm| {
            Record::Moved(Move {
                axis: Axis::LinearMm,
                target: position_mm,
                read_back: position_mm,
                is_clear: true,
            })
        };
        for _ in 0..2 {
            let store = Store::open(directory.path()).unwrap();
            let mut session = store.begin(RunKind::Session, "the bench").unwrap();
            append(&mut session, 0, &clear(24.5));
            session.commit().unwrap();
            let mut run = store.begin(RunKind::Run, "indents").unwrap();
            append(&mut run, 1, &records()[0]);
            append(&mut run, 2, &clear(24.5));
            append(&mut run, 3, &sweep(1, SweepPurpose::Touch, 150.0));
            run.commit().unwrap();
        }
        let old = Connection::open(directory.path().join("rigd.db")).unwrap();
        old.pragma_update(None, "foreign_keys", false).unwrap();
        old.execute_batch(damage).unwrap();
        drop(old);
        let target = Directory::new();
        salvage(directory.path(), target.path(), &[]).unwrap();
        let reader = Reader::open(target.path()).unwrap();
        let latest = reader.latest_session("the bench").unwrap().unwrap();
        let word = reader.probe_word(&latest).unwrap();
        assert_eq!(word != ProbeWord::Clear, is_lost, "{damage:?}: {word:?}");
    }
}

/// The number of an epoch is in no digest: one that is not that of its neighbours ends the run before it, and costs no other.
#[test]
fn an_altered_epoch_costs_the_rest_of_its_run_and_no_other() {
    for altered in ["epoch = 7 WHERE run = 2 AND seq = 5", "epoch = 7 WHERE run = 2 AND seq >= 5"] {
        let (directory, _) = journal();
        let old = Connection::open(directory.path().join("rigd.db")).unwrap();
        old.pragma_update(None, "foreign_keys", false).unwrap();
        old.execute(&format!("UPDATE records SET {altered}"), []).unwrap();
        old.execute("UPDATE epochs SET opened_at = CAST(x'ff' AS TEXT)", []).unwrap();
        drop(old);
        let target = Directory::new();
        let salvaged = salvage(directory.path(), target.path(), &[]).unwrap();
        let found: Vec<_> = salvaged.iter().map(|run| (run.records, run.flaw.is_some())).collect();
        assert_eq!(found, [(21, false), (4, true), (20, false), (21, false)], "{altered}");
        assert_eq!(Reader::open(target.path()).unwrap().broken_link().unwrap(), None);
    }
}

#[test]
fn a_ruined_page_costs_the_runs_that_stand_on_it_and_no_other() {
    let (directory, runs) = journal();
    let clean = fs::read(directory.path().join("rigd.db")).unwrap();
    let (mut whole, mut cut, mut lost, mut resumable) = (0, 0, 0, 0);
    // The first page is the head of the file.
    for page in 1..clean.len() / PAGE {
        let damaged = Directory::new();
        let mut bytes = clean.clone();
        bytes[page * PAGE..(page + 1) * PAGE].fill(0xa5);
        fs::write(damaged.path().join("rigd.db"), bytes).unwrap();
        let target = Directory::new();
        let Ok(salvaged) = salvage(damaged.path(), target.path(), &[]) else {
            lost += 1;
            continue;
        };
        let reader = Reader::open(target.path()).unwrap();
        let mut damaged_here = 0;
        for (id, expected) in &runs {
            let found = salvaged.iter().find(|run| run.id == id.to_string());
            let Some(found) = found else {
                damaged_here += 1;
                continue;
            };
            let chain = reader.chain(*id).unwrap();
            let here = format!("page {page}, {:?}", found.flaw);
            assert!(matches!(chain.check, ChainCheck::Intact { .. }), "{here}: {:?}", chain.check);
            let count = chain.records.len();
            assert_eq!(payloads(&chain.records), payloads(&expected[..count]), "{here}");
            assert_eq!(found.records, count as u64, "{here}");
            match (&found.flaw, count == expected.len()) {
                (None, true) => whole += 1,
                (Some(_), _) => {
                    damaged_here += 1;
                    cut += 1;
                    resumable += u32::from(reader.run(*id).unwrap().is_resumable());
                }
                (None, false) => panic!("{here}: {count} records, and nothing is said"),
            }
        }
        assert!(damaged_here <= 4, "page {page}");
        drop(reader);
        assert_eq!(names(target.path()), ["rigd.db", "rigd.lock"], "page {page}");
        let copy = Connection::open(target.path().join("rigd.db")).unwrap();
        let is_broken = copy.prepare("PRAGMA foreign_key_check").unwrap().exists([]).unwrap();
        assert!(!is_broken, "page {page}: an epoch is missing");
        drop(copy);
        // The salvaged journal can be written.
        drop(Store::open(target.path()).unwrap());
    }
    let counts = [whole, cut, resumable];
    assert!(counts.iter().all(|count| *count > 10) && lost < 6, "{counts:?}, {lost} lost");
    assert!(whole > 2 * cut, "{counts:?}");
}

/// A journal whose list of runs has several pages, and the ids of its runs in their order. Each has a sweep. The first one
/// is archived, and the last one is the note of that.
fn long_list() -> (Directory, Vec<String>) {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let mut first = None;
    for _ in 0..60 {
        let mut journal = store.begin(RunKind::Run, "short").unwrap();
        append(&mut journal, 0, &records()[0]);
        append(&mut journal, 1, &sweep(1, SweepPurpose::NoLoad, 140.4));
        append(&mut journal, 2, &Record::RunFinished(RunFinished { status: Ending::Completed }));
        journal.commit().unwrap();
        _ = first.get_or_insert(journal.id());
    }
    store.archive(first.unwrap(), "there", "me").unwrap();
    drop(store);
    let runs = Reader::open(directory.path()).unwrap().runs().unwrap();
    (directory, runs.iter().rev().map(|run| run.id.to_string()).collect())
}

/// The pages that have the entries of the list of runs, in the order of the entries. The first page of a file is 1.
///
/// # Source
/// SQLite, "Database File Format", section 1.6.
fn pages_of_list(directory: &Path, bytes: &[u8]) -> Vec<usize> {
    let database = rusqlite::Connection::open(directory.join("rigd.db")).unwrap();
    let root = "SELECT rootpage - 1 FROM sqlite_schema WHERE name = 'runs'";
    let root = database.query_row(root, [], |row| row.get::<_, i64>(0)).unwrap();
    let root = &bytes[usize::try_from(root).unwrap() * PAGE..][..PAGE];
    let number = |at: usize, length: usize| {
        root[at..at + length].iter().fold(0_usize, |number, byte| 256 * number + usize::from(*byte))
    };
    assert_eq!(root[0], 5, "the root has entries itself");
    let children = (0..number(3, 2)).map(|cell| number(number(12 + 2 * cell, 2), 4));
    children.chain([number(8, 4)]).collect()
}

#[test]
fn a_ruined_page_of_the_list_of_runs_costs_its_entries_and_each_is_named() {
    let (directory, ids) = long_list();
    let clean = fs::read(directory.path().join("rigd.db")).unwrap();
    let pages = pages_of_list(directory.path(), &clean);
    assert!(pages.len() > 2, "{pages:?}");
    for (page, is_last) in [(pages[1], false), (pages[pages.len() - 1], true)] {
        let (damaged, target) = (Directory::new(), Directory::new());
        let mut bytes = clean.clone();
        bytes[(page - 1) * PAGE..page * PAGE].fill(0xa5);
        fs::write(damaged.path().join("rigd.db"), bytes).unwrap();
        let salvaged = salvage(damaged.path(), target.path(), &[]).unwrap();
        assert!(salvaged.iter().map(|run| &run.id).eq(&ids), "page {page}: {salvaged:?}");
        let reader = Reader::open(target.path()).unwrap();
        let is_kept = |id: &str| reader.run(id.parse().unwrap()).is_ok();
        let (kept, lost): (Vec<_>, Vec<_>) = salvaged.iter().partition(|run| is_kept(&run.id));
        assert!((1..30).contains(&lost.len()), "page {page}: {lost:?}");
        for run in lost {
            assert_eq!((&*run.name, run.records), ("", 0), "page {page}");
            assert!(matches!(run.flaw, Some(Flaw::Unreadable { .. })), "page {page}: {run:?}");
        }
        // The readings of the first run are right if the note of its archive can be read.
        let is_cut = matches!(kept[0].flaw, Some(Flaw::Unreadable { .. })) && kept[0].records == 1;
        assert_eq!(is_cut, is_last, "page {page}: {:?}", kept[0]);
        assert!(kept[1..].iter().all(|run| run.flaw.is_none()), "page {page}: {kept:?}");
        for run in kept {
            let check = reader.verify(run.id.parse().unwrap()).unwrap();
            assert!(matches!(check, ChainCheck::Intact { .. }), "page {page}: {check:?}");
        }
    }
}

#[test]
fn of_a_journal_that_was_cut_the_records_before_the_cut_are_copied() {
    let (directory, runs) = journal();
    let mut clean = fs::read(directory.path().join("rigd.db")).unwrap();
    // The size in pages, and the change at which it was right: a checkpoint writes both.
    let pages = u32::try_from(clean.len() / 4096).unwrap();
    clean[28..32].copy_from_slice(&pages.to_be_bytes());
    clean.copy_within(24..28, 92);
    let all: usize = runs.iter().map(|(_, records)| records.len()).sum();
    let mut copied = Vec::new();
    for percent in [30, 50, 70, 90, 95] {
        let (damaged, target) = (Directory::new(), Directory::new());
        let cut = &clean[..clean.len() * percent / 100];
        fs::write(damaged.path().join("rigd.db"), cut).unwrap();
        let refusal = Reader::open(damaged.path()).unwrap_err();
        assert!(matches!(refusal, StoreError::Damaged(_)), "{percent} %: {refusal}");
        let salvaged = salvage(damaged.path(), target.path(), &[]).unwrap();
        let reader = Reader::open(target.path()).unwrap();
        for found in &salvaged {
            let (id, expected) = runs.iter().find(|(id, _)| id.to_string() == found.id).unwrap();
            let chain = reader.chain(*id).unwrap();
            assert!(matches!(chain.check, ChainCheck::Intact { .. }), "{percent} %");
            let count = chain.records.len();
            assert_eq!(payloads(&chain.records), payloads(&expected[..count]), "{percent} %");
            assert!(found.flaw.is_some() || count == expected.len(), "{percent} %: {found:?}");
        }
        let records = salvaged.iter().map(|run| run.records).sum::<u64>();
        assert_eq!(fs::read(damaged.path().join("rigd.db")).unwrap(), cut, "{percent} %");
        copied.push(records as f64 / all as f64);
    }
    // A part of the file is the index.
    assert!(copied.is_sorted() && copied[1] > 0.25 && copied[3] > 0.6, "{copied:?}");
}

#[test]
fn a_damaged_run_does_not_hide_the_list_of_runs_nor_the_others() {
    let (directory, runs) = journal();
    let database = rusqlite::Connection::open(directory.path().join("rigd.db")).unwrap();
    database.execute("UPDATE records SET payload = '{' WHERE run = 2 AND seq = 3", []).unwrap();
    drop(database);
    let reader = Reader::open(directory.path()).unwrap();
    assert_eq!(reader.runs().unwrap().len(), 4);
    let target = Directory::new();
    let salvaged = salvage(directory.path(), target.path(), &[]).unwrap();
    let found: Vec<_> = salvaged.iter().map(|run| (run.records, run.flaw.clone())).collect();
    assert_eq!(found, [(21, None), (2, Some(Flaw::Altered)), (20, None), (21, None)]);
    // From the copy, the damaged run can be resumed after its last good record.
    let store = Store::open(target.path()).unwrap();
    assert_eq!(store.reader().unwrap().run(runs[1].0).unwrap().records, 2);
    store.reopen(runs[1].0).unwrap();
}

/// One altered byte in the list of runs costs its run, and no other.
#[test]
fn a_damaged_id_or_kind_hides_no_other_run_and_is_not_copied() {
    for (damage, column) in
        [("kind = 'rux'", "kind"), ("id = 'g' || substr(id, 2)", "id"), ("status = 'enden'", "")]
    {
        let directory = Directory::new();
        let store = Store::open(directory.path()).unwrap();
        let mut ids = Vec::new();
        for status in [Some(Ending::Completed), None, Some(Ending::Completed)] {
            let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
            append(&mut journal, 0, &records()[0]);
            if let Some(status) = status {
                append(&mut journal, 1, &Record::RunFinished(RunFinished { status }));
            }
            journal.commit().unwrap();
            ids.push(journal.id());
        }
        drop(store);
        let database = Connection::open(directory.path().join("rigd.db")).unwrap();
        database.execute(&format!("UPDATE runs SET {damage} WHERE key = 2"), []).unwrap();
        drop(database);

        let others = [ids[2], ids[0]];
        let reader = Reader::open(directory.path()).unwrap();
        let listed = |runs: Vec<crate::Run>| -> Vec<_> {
            let is_run = |run: &crate::Run| run.kind == RunKind::Run;
            runs.into_iter().filter(is_run).map(|run| run.id).collect()
        };
        assert_eq!(listed(reader.runs().unwrap()), others, "{damage}");
        assert_eq!(listed(reader.latest_runs(Some(2), None).unwrap()), others, "{damage}");
        let refusal = reader.every_run().unwrap_err();
        assert!(matches!(refusal, StoreError::Damaged(_)), "{damage}: {refusal}");
        // Another run is not taken for the one that a person means.
        let refusal = reader.find(&ids[1].to_string()[1..]).unwrap_err();
        assert!(matches!(refusal, StoreError::Damaged(_)), "{damage}: {refusal}");
        let [(id, flaw)] = &reader.damaged_entries().unwrap()[..] else { panic!("{damage}") };
        let said = flaw.to_string();
        assert!(id[1..] == ids[1].to_string()[1..] && said.contains("entry 2 of"), "{said}");
        drop(reader);
        // The journal itself can be written on.
        assert!(Store::open(directory.path()).is_ok(), "{damage}");

        // A copy is no backup without flaws.
        let backup = Directory::new();
        let copied = back_up(directory.path(), backup.path(), &[]).unwrap();
        assert_eq!(copied.iter().filter(|run| run.flaw.is_some()).count(), 1, "{copied:?}");
        let target = Directory::new();
        let salvaged = salvage(directory.path(), target.path(), &[]).unwrap();
        let flaws: Vec<_> = salvaged.iter().filter_map(|run| run.flaw.as_ref()).collect();
        assert_eq!((salvaged.len(), flaws.len()), (3, 1), "{salvaged:?}");
        assert!(flaws[0].to_string().ends_with(&*if column.is_empty() {
            Flaw::Missing.to_string()
        } else {
            format!("entry 2 of the list of runs: its {column} is damaged")
        }));
        assert!(Store::open(target.path()).is_ok(), "{damage}");
        let copy = Reader::open(target.path()).unwrap();
        let expected =
            if column.is_empty() { [ids[2], ids[1], ids[0]].to_vec() } else { others.to_vec() };
        assert_eq!(listed(copy.every_run().unwrap()), expected, "{damage}");
        assert!(copy.damaged_entries().unwrap().is_empty(), "{damage}");
        // What the lost entry was about is not known: it may have been the last session.
        let has_session = copy.latest_session("unknown").unwrap().is_some();
        assert_eq!(has_session, !column.is_empty(), "{damage}");
    }
}

/// Takes the right to write away from a directory and its files, or gives it back.
fn set_writable(directory: &Path, is_writable: bool) {
    let paths = fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path());
    for path in paths.chain([directory.to_owned()]).collect::<Vec<_>>() {
        let mut permissions = fs::metadata(&path).unwrap().permissions();
        permissions.set_readonly(!is_writable);
        fs::set_permissions(&path, permissions).unwrap();
    }
}

/// Not a test: the program that the next test starts as a user who may not write.
#[test]
fn read_when_told_to() {
    let Ok(directory) = std::env::var("RIG_STORE_READ_IN") else { return };
    let reader = Reader::open(Path::new(&directory)).unwrap();
    let runs = reader.runs().unwrap();
    assert_eq!(runs.len(), 4);
    for run in runs {
        reader.records(run.id).unwrap();
    }
    Store::open(Path::new(&directory)).unwrap_err();
}

#[test]
fn a_directory_that_cannot_be_written_can_be_read_with_and_without_a_log() {
    use std::os::unix::{fs::MetadataExt, process::CommandExt};
    const NOBODY: u32 = 65_534;
    let (directory, runs) = journal();
    for has_log in [false, true] {
        let place = Directory::new();
        fs::copy(directory.path().join("rigd.db"), place.path().join("rigd.db")).unwrap();
        let log = place.path().join("rigd.db-wal");
        if has_log {
            // A store that is not closed leaves its log.
            let store = Store::open(place.path()).unwrap();
            let logged = Directory::new();
            for file in ["rigd.db", "rigd.db-wal"] {
                fs::copy(place.path().join(file), logged.path().join(file)).unwrap();
            }
            drop(store);
            for file in ["rigd.db", "rigd.db-wal"] {
                fs::copy(logged.path().join(file), place.path().join(file)).unwrap();
            }
        }
        assert_eq!(fs::metadata(&log).is_ok_and(|log| log.len() > 0), has_log);
        _ = fs::remove_file(place.path().join("rigd.db-shm"));
        set_writable(place.path(), false);
        let mut program = std::process::Command::new(std::env::current_exe().unwrap());
        program
            .args(["--exact", "tests::salvage::read_when_told_to", "--test-threads=1"])
            .env("RIG_STORE_READ_IN", place.path());
        // Nothing is forbidden to root.
        if fs::metadata(place.path()).unwrap().uid() == 0 {
            program.uid(NOBODY);
        }
        let read = program.output().unwrap();
        set_writable(place.path(), true);
        assert!(read.status.success(), "log {has_log}: {}", String::from_utf8_lossy(&read.stdout));
        assert_eq!(runs.len(), 4);
    }
}

#[test]
fn a_copy_that_was_broken_off_is_made_again() {
    let (directory, runs) = journal();
    let target = Directory::new();
    let stage = target.path().join(".salvage.part");
    fs::create_dir(&stage).unwrap();
    fs::write(stage.join("rigd.db"), "half").unwrap();
    assert_eq!(salvage(directory.path(), target.path(), &[]).unwrap().len(), runs.len());
    assert_eq!(names(target.path()), ["rigd.db", "rigd.lock"]);
}
