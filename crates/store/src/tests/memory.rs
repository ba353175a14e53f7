//! Journals on the disk of a simulated computer.

use crate::{DiskFailure, MemoryDisk, Reader, Record, RunKind, StateChanged, Store, StoreError};

fn state(word: &str) -> Record {
    Record::StateChanged(StateChanged { state: word.to_owned(), reason: None })
}

#[test]
fn a_killed_program_leaves_what_it_had_committed_and_the_next_one_finds_it() {
    let disk = MemoryDisk::new().unwrap();
    let store = Store::open_in_memory(&disk).unwrap();
    assert!(matches!(Store::open_in_memory(&disk), Err(StoreError::InUse)));
    let mut journal = store.begin(RunKind::Run, "smoke").unwrap();
    journal.append(1, &state("running")).unwrap();
    journal.commit().unwrap();
    journal.append(2, &state("paused")).unwrap();
    let run = journal.id();
    drop((journal, store));
    let store = Store::open_in_memory(&disk).unwrap();
    assert_eq!(store.interrupted(), [run]);
    assert!(store.directory().is_none());
    let reader = Reader::open_in_memory(&disk).unwrap();
    assert!(reader.has_writer());
    assert_eq!(reader.records(run).unwrap().len(), 1);
}

#[test]
fn a_disk_fails_from_its_call_on_until_it_is_mended_and_the_journal_stays_closed() {
    for failure in [DiskFailure::Full, DiskFailure::Io, DiskFailure::ReadOnly] {
        let disk = MemoryDisk::new().unwrap();
        let store = Store::open_in_memory(&disk).unwrap();
        let mut journal = store.begin(RunKind::Run, "smoke").unwrap();
        disk.fail_from(3, failure);
        journal.append(1, &state("running")).unwrap();
        journal.commit().unwrap();
        let error = journal.append(2, &state("paused")).unwrap_err();
        match failure {
            DiskFailure::Full => assert!(matches!(error, StoreError::DiskFull), "{error:?}"),
            _ => assert!(matches!(error, StoreError::Io(_)), "{error:?}"),
        }
        let run = journal.id();
        drop((journal, store));
        assert!(Store::open_in_memory(&disk).is_err());
        disk.mend();
        let store = Store::open_in_memory(&disk).unwrap();
        assert_eq!(store.reader().unwrap().records(run).unwrap().len(), 1);
    }
}

#[test]
fn a_wiped_disk_is_like_a_new_one_and_a_reader_of_before_sees_another_journal() {
    let disk = MemoryDisk::new().unwrap();
    disk.wipe().unwrap();
    assert!(Reader::open_in_memory(&disk).is_err());
    let mut events = Vec::new();
    for _ in 0..3 {
        let store = Store::open_in_memory(&disk).unwrap();
        assert!(matches!(disk.wipe(), Err(StoreError::InUse)));
        assert_eq!((store.interrupted(), store.epoch().unwrap()), (&[][..], 1));
        let mut journal = store.begin(RunKind::Run, "smoke").unwrap();
        events.push(journal.append(1, &state("running")).unwrap());
        journal.commit().unwrap();
        // It is lost with its program.
        journal.append(2, &state("paused")).unwrap();
        drop((journal, store));
        let reader = Reader::open_in_memory(&disk).unwrap();
        let runs = reader.runs().unwrap();
        assert_eq!((runs.len(), runs[0].records, reader.broken_link().unwrap()), (1, 1, None));
        disk.wipe().unwrap();
        assert_eq!(reader.runs().unwrap(), []);
    }
    assert_eq!(events, [1; 3]);
}
