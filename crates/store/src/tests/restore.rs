//! A backup in place of a lost journal.

use std::fs;

use super::sample::{Directory, append, names, records};
use crate::{Flaw, Reader, RunKind, Store, StoreError, back_up, restore};

const BESIDE: [&str; 1] = ["notes.json"];

/// A backup with this many runs of all kinds of records, and notes.
fn backup(runs: usize) -> Directory {
    let (data, to) = (Directory::new(), Directory::new());
    let store = Store::open(data.path()).unwrap();
    for _ in 0..runs {
        let mut run = store.begin(RunKind::Run, "test").unwrap();
        for record in records() {
            append(&mut run, 1, &record);
        }
        run.commit().unwrap();
    }
    back_up(data.path(), to.path(), &[]).unwrap();
    fs::write(to.path().join("notes.json"), "{}").unwrap();
    to
}

fn change(backup: &Directory, statement: &str) {
    let database = rusqlite::Connection::open(backup.path().join("rigd.db")).unwrap();
    assert!(database.execute(statement, []).unwrap() > 0, "{statement}");
}

#[test]
fn a_restored_journal_has_all_runs_and_is_written_on() {
    let backup = backup(3);
    let (parent, empty) = (Directory::new(), Directory::new());
    let absent = parent.path().join("new");
    let original = Reader::open(backup.path()).unwrap();
    for to in [&absent, empty.path()] {
        let restored = restore(backup.path(), to, &BESIDE).unwrap();
        assert_eq!((restored.len(), restored[0].records), (3, records().len() as u64));
        assert_eq!(names(to), ["notes.json", "rigd.db", "rigd.lock"]);
        let reader = Reader::open(to).unwrap();
        for run in original.runs().unwrap() {
            assert_eq!(reader.records(run.id).unwrap(), original.records(run.id).unwrap());
        }
        let store = Store::open(to).unwrap();
        let mut run = store.begin(RunKind::Run, "after").unwrap();
        append(&mut run, 0, &records()[0]);
        run.commit().unwrap();
    }
}

#[test]
fn nothing_is_overwritten_and_no_directory_in_use_is_touched() {
    let backup = backup(1);
    for other in ["rigd.db", "notes.json", "queue.json", "runs"] {
        let to = Directory::new();
        fs::write(to.path().join(other), "mine").unwrap();
        let refused = restore(backup.path(), to.path(), &BESIDE);
        assert!(matches!(refused, Err(StoreError::Occupied { entry }) if entry == other));
        assert_eq!(fs::read_to_string(to.path().join(other)).unwrap(), "mine");
        assert_eq!(names(to.path()).len(), 2, "the file and the lock");
    }
    let to = Directory::new();
    let running = Store::open(to.path()).unwrap();
    assert!(matches!(restore(backup.path(), to.path(), &BESIDE), Err(StoreError::InUse)));
    drop(running);
    let nothing = Directory::new();
    let absent = to.path().join("absent");
    let refused = restore(nothing.path(), &absent, &BESIDE);
    assert!(matches!(refused, Err(StoreError::NoJournal)));
    assert!(!absent.exists());
}

#[test]
fn a_broken_backup_restores_nothing() {
    let to = Directory::new();
    let changed = backup(2);
    change(&changed, "UPDATE records SET payload = replace(payload, '{', '{ ') WHERE seq = 2");
    let found = restore(changed.path(), to.path(), &BESIDE).unwrap();
    assert_eq!(found.iter().filter(|run| run.flaw.is_some()).count(), 2);
    let lost = backup(2);
    change(&lost, "DELETE FROM records WHERE seq = 3 AND run = 1");
    let found = restore(lost.path(), to.path(), &BESIDE).unwrap();
    assert_eq!(found.iter().filter(|run| matches!(run.flaw, Some(Flaw::Missing))).count(), 1);
    let other = backup(1);
    change_version(&other);
    let refused = restore(other.path(), to.path(), &BESIDE);
    assert!(matches!(refused, Err(StoreError::OtherFormat { .. })), "{refused:?}");
    // Cut off at each of its pages, and without its first byte.
    let whole = backup(2);
    let bytes = fs::read(whole.path().join("rigd.db")).unwrap();
    for end in (0..bytes.len()).step_by(4096) {
        fs::write(whole.path().join("rigd.db"), &bytes[..end]).unwrap();
        let found = restore(whole.path(), to.path(), &BESIDE);
        assert!(found.is_err(), "cut off at {end}: {found:?}");
    }
    fs::write(whole.path().join("rigd.db"), &bytes[1..]).unwrap();
    assert!(restore(whole.path(), to.path(), &BESIDE).is_err());
    assert_eq!(names(to.path()), ["rigd.lock"]);
}

fn change_version(backup: &Directory) {
    let database = rusqlite::Connection::open(backup.path().join("rigd.db")).unwrap();
    database.pragma_update(None, "user_version", 9999).unwrap();
}

#[test]
fn a_restoration_that_was_broken_off_is_begun_anew() {
    let (backup, to) = (backup(2), Directory::new());
    // Killed between the notes and the journal.
    fs::create_dir(to.path().join("restore.part")).unwrap();
    fs::write(to.path().join("restore.part/rigd.db"), "half").unwrap();
    fs::write(to.path().join("notes.json"), "half").unwrap();
    assert_eq!(restore(backup.path(), to.path(), &BESIDE).unwrap().len(), 2);
    assert_eq!(names(to.path()), ["notes.json", "rigd.db", "rigd.lock"]);
    assert_eq!(fs::read_to_string(to.path().join("notes.json")).unwrap(), "{}");
}

/// What was put into its place before the error would be in the way.
#[cfg(target_os = "linux")]
#[test]
fn a_restoration_that_failed_while_it_was_placed_is_begun_again() {
    let (backup, to) = (backup(1), Directory::new());
    let beside = ["notes.json", "corrections.json"];
    // A file that cannot be read.
    let unreadable = backup.path().join("corrections.json");
    std::os::unix::fs::symlink("/proc/self/mem", &unreadable).unwrap();
    let failed = restore(backup.path(), to.path(), &beside).unwrap_err();
    assert!(matches!(failed, StoreError::Path { .. }), "{failed:?}");
    assert!(!to.path().join("rigd.db").exists() && to.path().join("notes.json").exists());
    fs::remove_file(&unreadable).unwrap();
    restore(backup.path(), to.path(), &beside).unwrap();
    assert_eq!(names(to.path()), ["notes.json", "rigd.db", "rigd.lock"]);
}
