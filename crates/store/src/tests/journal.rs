//! Contents, visibility and refusals of the journal.

use super::sample::{Directory, append, records, run_started, sweep};
use crate::{
    Axis, ChainCheck, Ending, FORMAT, MemoryDisk, Move, Reader, Record, RunFinished, RunId,
    RunKind, RunStatus, Store, StoreError, SweepPurpose,
};

fn write_run(store: &Store) -> RunId {
    let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
    for (second, record) in (0..).zip(records()) {
        append(&mut journal, second, &record);
    }
    journal.commit().unwrap();
    journal.id()
}

#[test]
fn records_are_read_back_as_they_were_written() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let id = write_run(&store);

    let reader = Reader::open(directory.path()).unwrap();
    let stored = reader.records(id).unwrap();
    let read: Vec<Record> = stored.iter().map(|stored| stored.record().unwrap()).collect();
    assert_eq!(read, records());
    for ((seq, stored), record) in (1..).zip(&stored).zip(records()) {
        assert_eq!((stored.seq, stored.rig_us), (seq, (seq - 1) * 1_000_000));
        assert_eq!(stored.kind, record.kind());
        // The word in the column and the word in the text are made apart.
        assert!(stored.payload.starts_with(&format!("{{\"kind\":\"{}\"", stored.kind)));
    }

    let run = reader.run(id).unwrap();
    assert_eq!(run.status, RunStatus::Ended(Ending::Faulted));
    assert_eq!((run.name.as_str(), run.kind), ("one touch", RunKind::Run));
    assert_eq!(run.records, records().len() as u64);
    let wall_ms = run.wall_s.unwrap() * 1000.0;
    assert!(
        (0.0..60_000.0).contains(&wall_ms) && (wall_ms - wall_ms.round()).abs() < 1e-6,
        "{run:?}"
    );
    assert!(run.started_at.len() == 24 && run.started_at.ends_with('Z'), "{run:?}");
    assert_eq!(reader.runs().unwrap(), [run]);
}

#[test]
fn runs_that_begin_in_one_millisecond_have_ids_in_their_order() {
    let store = Store::open_in_memory(&MemoryDisk::new().unwrap()).unwrap();
    let begun: Vec<RunId> =
        (0..200).map(|_| store.begin(RunKind::Run, "short").unwrap().id()).collect();
    assert!(begun.is_sorted(), "{begun:?}");
}

#[test]
fn the_endings_behind_an_event_are_those_of_runs_and_amendments() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let reader = store.reader().unwrap();
    let end = Record::RunFinished(RunFinished { status: Ending::Completed });
    let begin = |kind, name: &str| {
        let mut journal = store.begin(kind, name).unwrap();
        append(&mut journal, 0, &run_started());
        journal
    };
    let (mut first, mut session) = (begin(RunKind::Run, "a"), begin(RunKind::Session, "bench"));
    let mut second = begin(RunKind::Run, "a");
    second.commit().unwrap();
    assert_eq!(reader.ended_after(0).unwrap(), []);
    let mut amendment = begin(RunKind::Amendment, &first.id().to_string());
    let ended = [&mut second, &mut session, &mut first, &mut amendment]
        .map(|journal| (append(journal, 1, &end), journal.id()));
    first.commit().unwrap();
    let [second, _, first, amendment] = ended;
    assert_eq!(reader.ended_after(0).unwrap(), [second, first, amendment]);
    assert_eq!(reader.ended_after(second.0).unwrap(), [first, amendment]);
    assert_eq!(reader.ended_after(u64::MAX).unwrap(), []);
}

#[test]
fn readers_see_what_is_committed_and_nothing_else() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let reader = store.reader().unwrap();
    let mut run = store.begin(RunKind::Run, "one touch").unwrap();
    let mut session = store.begin(RunKind::Session, "bench").unwrap();
    let first = append(&mut run, 0, &run_started());
    let second = append(&mut session, 1, &sweep(1, SweepPurpose::Manual, 140.0));
    assert_eq!(reader.events_after(0, 10).unwrap(), []);
    // The journals of a store share one transaction.
    run.commit().unwrap();
    let third = append(&mut run, 2, &sweep(1, SweepPurpose::NoLoad, 140.0));
    let seen = |after, limit| {
        let events = reader.events_after(after, limit).unwrap();
        events.iter().map(|event| (event.event, event.run, event.seq)).collect::<Vec<_>>()
    };
    assert_eq!(seen(0, 10), [(first, run.id(), 1), (second, session.id(), 1)]);
    assert_eq!(seen(first, 10), [(second, session.id(), 1)]);
    assert_eq!(seen(0, 1), [(first, run.id(), 1)]);
    assert_eq!(seen(second, 10), []);
    session.commit().unwrap();
    assert_eq!(seen(second, 10), [(third, run.id(), 2)]);
    assert_eq!(seen(u64::MAX, 10), []);
}

#[test]
fn a_directory_has_one_writer() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let refusal = Store::open(directory.path()).unwrap_err();
    assert!(matches!(refusal, StoreError::InUse), "{refusal}");
    drop(store);
    Store::open(directory.path()).unwrap();
}

#[test]
fn a_directory_without_a_journal_is_not_given_one_by_a_reader() {
    let directory = Directory::new();
    let refusal = Reader::open(directory.path()).unwrap_err();
    assert!(matches!(refusal, StoreError::NoJournal), "{refusal}");
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
}

#[test]
fn another_format_is_refused_by_writer_and_reader() {
    let directory = Directory::new();
    drop(Store::open(directory.path()).unwrap());
    let database = rusqlite::Connection::open(directory.path().join("rigd.db")).unwrap();
    for other in [FORMAT - 1, FORMAT + 1] {
        database.pragma_update(None, "user_version", other).unwrap();
        for refusal in [
            Store::open(directory.path()).unwrap_err(),
            Reader::open(directory.path()).unwrap_err(),
        ] {
            let is_known = matches!(refusal, StoreError::OtherFormat { found, known: FORMAT } if found == other);
            assert!(is_known, "{refusal}");
        }
    }
}

#[test]
fn nothing_follows_the_end_of_a_run() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
    append(&mut journal, 0, &Record::RunFinished(RunFinished { status: Ending::Completed }));
    let refusal = journal.append(1, &run_started()).unwrap_err();
    assert!(matches!(refusal, StoreError::Ended { kind: "run_started", .. }), "{refusal}");
    journal.commit().unwrap();
    assert_eq!(store.reader().unwrap().records(journal.id()).unwrap().len(), 1);
}

#[test]
fn a_number_that_is_not_finite_is_refused_and_the_journal_goes_on() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let refusal = journal.append(0, &sweep(1, SweepPurpose::Touch, value)).unwrap_err();
        assert!(matches!(refusal, StoreError::Unwritable { kind: "sweep", .. }), "{refusal}");
    }
    append(&mut journal, 1, &sweep(1, SweepPurpose::Touch, f64::MIN_POSITIVE));
    journal.commit().unwrap();
    let stored = store.reader().unwrap().records(journal.id()).unwrap();
    assert_eq!((stored.len(), stored[0].seq), (1, 1));
}

#[test]
fn a_session_without_an_end_is_marked_when_the_journal_is_opened_again() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let ended = write_run(&store);
    let mut journal = store.begin(RunKind::Session, "cut short").unwrap();
    append(&mut journal, 7, &sweep(1, SweepPurpose::Manual, 140.0));
    journal.commit().unwrap();
    // Never committed, so never acknowledged.
    append(&mut journal, 8, &sweep(2, SweepPurpose::Manual, 140.0));
    let (cut, reader) = (journal.id(), store.reader().unwrap());
    assert_eq!(reader.run(cut).unwrap().status, RunStatus::Running);
    drop((store, journal));

    let store = Store::open(directory.path()).unwrap();
    assert_eq!(store.interrupted(), [cut]);
    let run = reader.run(cut).unwrap();
    assert_eq!((run.status, run.is_sealed), (RunStatus::Ended(Ending::Interrupted), true));
    let stored = reader.records(cut).unwrap();
    assert_eq!(stored.len(), 2);
    assert_eq!(stored[1].rig_us, 7_000_000, "the rig's clock says no more than the last record");
    let end = Record::RunFinished(RunFinished { status: Ending::Interrupted });
    assert_eq!(stored[1].record().unwrap(), end);
    assert_eq!(reader.run(ended).unwrap().status, RunStatus::Ended(Ending::Faulted));
    drop(store);
    assert_eq!(Store::open(directory.path()).unwrap().interrupted(), []);
}

#[test]
fn a_run_is_found_by_as_much_of_its_id_as_is_needed() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let (first, last) = (write_run(&store), write_run(&store));
    drop(store.begin(RunKind::Session, "bench").unwrap());
    let reader = store.reader().unwrap();
    assert_eq!(reader.find("latest").unwrap().id, last);
    assert_eq!(reader.find(&first.to_string()).unwrap().id, first);
    assert_eq!(reader.find(&first.to_string()[24..]).unwrap().id, first);
    let refusal = reader.find(&first.to_string()[..4]).unwrap_err();
    let StoreError::Ambiguous { candidates, .. } = refusal else { panic!("{refusal}") };
    let ids: Vec<_> = candidates.iter().map(|run| run.id).collect();
    assert_eq!(ids, [last, first]);
    let refusal = reader.find("no such run").unwrap_err();
    assert!(matches!(refusal, StoreError::NoSuchRun { .. }), "{refusal}");
}

#[test]
fn runs_of_a_protocol_are_numbered_and_found_by_name_and_number() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let begin = |kind, name| store.begin(kind, name).map(|journal| journal.id()).unwrap();
    let smoke: Vec<_> = (0..12).map(|_| begin(RunKind::Run, "smoke")).collect();
    let session = begin(RunKind::Session, "bench");
    let once = begin(RunKind::Run, "two words");
    let last = write_run(&store);
    let reader = store.reader().unwrap();
    let name = |id| reader.run(id).unwrap().short_name();
    assert_eq!((name(smoke[6]), name(once)), ("smoke-7".to_owned(), "two words-1".to_owned()));
    let found =
        |wanted: &str| reader.find(wanted).map(|run| run.id).map_err(|error| error.to_string());
    for (wanted, id) in [
        ("smoke-1", smoke[0]),
        ("smoke-12", smoke[11]),
        ("two words-1", once),
        ("two words", once),
        (session.to_string().as_str(), session),
        ("latest", last),
    ] {
        assert_eq!(found(wanted), Ok(id), "{wanted}");
    }
    for wanted in ["smoke-13", "smoke-0", "smoke-", "bench", "bench-1", "Smoke-1"] {
        assert_eq!(found(wanted), Err(format!("no run `{wanted}`")));
    }
    let refusal = found("smoke").unwrap_err();
    let ends = ["`smoke` fits 12 runs: smoke-12 (", "more of an id"];
    assert!(refusal.starts_with(ends[0]) && refusal.ends_with(ends[1]), "{refusal}");
    assert!(refusal.contains(", smoke-8 (") && refusal.contains("and 7 older ones"), "{refusal}");
}

#[test]
fn the_same_records_give_the_same_chain() {
    let written = || {
        let directory = Directory::new();
        let store = Store::open(directory.path()).unwrap();
        let id = write_run(&store);
        store.reader().unwrap().verify(id).unwrap()
    };
    let (first, second) = (written(), written());
    assert_eq!(first, second);
    assert!(matches!(first, ChainCheck::Intact { records: 14, .. }), "{first:?}");
}

#[test]
fn a_record_knows_when_it_was_made() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let mut journal = store.begin(RunKind::Session, "bench").unwrap();
    for seconds in [100, 101, 100 + 86_400] {
        let moved = Move { axis: Axis::LinearMm, target: 1.0, read_back: 1.0, is_clear: false };
        append(&mut journal, seconds, &Record::Moved(moved));
    }
    journal.commit().unwrap();
    let database = rusqlite::Connection::open(directory.path().join("rigd.db")).unwrap();
    database.execute("UPDATE stretches SET started_at = '2026-12-31T23:59:59.250Z'", []).unwrap();
    let events = store.reader().unwrap().events_after(0, 10).unwrap();
    let times: Vec<_> = events.iter().map(|stored| stored.at.as_deref().unwrap()).collect();
    let expected =
        ["2026-12-31T23:59:59.250Z", "2027-01-01T00:00:00.250Z", "2027-01-01T23:59:59.250Z"];
    assert_eq!(times, expected);
}

#[test]
fn the_chain_can_be_recomputed_by_anyone() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let mut journal = store.begin(RunKind::Session, "bench").unwrap();
    let moved = Move { axis: Axis::LinearMm, target: 10.125, read_back: 10.1249, is_clear: false };
    journal.append(1_500_000, &Record::Moved(moved)).unwrap();
    let end = RunFinished { status: Ending::Completed };
    journal.append(2_500_001, &Record::RunFinished(end)).unwrap();
    journal.commit().unwrap();
    let records = store.reader().unwrap().records(journal.id()).unwrap();
    let found: Vec<_> =
        records.iter().map(|one| (one.rig_us, one.digest.to_string(), &*one.payload)).collect();
    // The digests were computed by another program from the rule in the documentation of `Digest`.
    let expected = [
        (
            1_500_000,
            "356baef8ef823f6f8174cd6ce8de1e0a1fac2bdd4a8351086503a14055439b78".to_owned(),
            r#"{"kind":"moved","axis":"linear_mm","target":10.125,"read_back":10.1249}"#,
        ),
        (
            2_500_001,
            "c032fd07a52341cffab1c40f598edf561796be68e628927ba35fd44f79f98fc8".to_owned(),
            r#"{"kind":"run_finished","status":"completed"}"#,
        ),
    ];
    assert_eq!(found, expected);
}

#[test]
fn a_directory_that_cannot_be_used_is_refused_for_what_it_is() {
    let directory = Directory::new();
    let file = directory.path().join("a file");
    std::fs::write(&file, "not a directory").unwrap();
    let refusal = Store::open(&file).unwrap_err();
    assert!(matches!(refusal, StoreError::NotADirectory), "{refusal}");
    std::fs::write(directory.path().join("rigd.db"), "not a database, but long enough".repeat(99))
        .unwrap();
    let refusal = Store::open(directory.path()).unwrap_err();
    assert!(matches!(refusal, StoreError::Damaged(_)), "{refusal}");
    let refusal = Reader::open(directory.path()).unwrap_err();
    assert!(matches!(refusal, StoreError::Damaged(_)), "{refusal}");
}

#[test]
fn a_run_that_ends_while_it_is_read_is_not_taken_for_a_broken_one() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let reader = store.reader().unwrap();
    let writer = std::thread::spawn(move || {
        for _ in 0..50 {
            let mut journal = store.begin(RunKind::Run, "short").unwrap();
            append(&mut journal, 0, &run_started());
            journal.commit().unwrap();
            let end = RunFinished { status: Ending::Completed };
            append(&mut journal, 1, &Record::RunFinished(end));
            journal.commit().unwrap();
        }
    });
    let (mut running, mut ended) = (0, 0);
    while !writer.is_finished() {
        let Some(latest) = reader.runs().unwrap().first().map(|run| run.id) else { continue };
        match reader.verify(latest).unwrap() {
            ChainCheck::Intact { records: 1, .. } => running += 1,
            ChainCheck::Intact { .. } => ended += 1,
            broken @ ChainCheck::Broken { .. } => panic!("{broken:?}"),
        }
    }
    writer.join().unwrap();
    assert!(running > 0 && ended > 0, "{running} seen running, {ended} ended");
}

#[test]
fn a_file_system_without_shared_memory_holds_no_journal() {
    let directory = Directory::new();
    let path = crate::schema::database(directory.path());
    // This file system of SQLite has no shared memory, as some of networks.
    let flags = rusqlite::OpenFlags::default();
    let connection = rusqlite::Connection::open_with_flags_and_vfs(path, flags, "unix-dotfile");
    let refused =
        crate::schema::set_up(connection.unwrap()).and_then(crate::schema::with_log).err();
    assert!(
        matches!(&refused, Some(StoreError::NoLog { mode }) if mode == "delete"),
        "{refused:?}"
    );
}
