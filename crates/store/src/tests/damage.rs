//! The journal after a crash, a cut file, a flipped bit, a full disk.

use std::{
    fs,
    path::Path,
    process::{Command, Stdio},
};

use super::sample::{Directory, append, records, run_started, sweep};
use crate::{
    ChainCheck, Flaw, Reader, Record, RunId, RunKind, RunStatus, Store, StoreError, StoredRecord,
    SweepPurpose,
};

/// Numbers below `bound`, the same for the same seed (Steele, Lea, Flood 2014: `SplitMix64`).
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut word = self.0;
        word = (word ^ (word >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        word = (word ^ (word >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        usize::try_from((word ^ (word >> 31)) % bound as u64).unwrap()
    }
}

fn copied(from: &Path, files: &[&str]) -> Directory {
    let directory = Directory::new();
    for file in files {
        fs::copy(from.join(file), directory.path().join(file)).unwrap();
    }
    directory
}

fn texts(records: &[StoredRecord]) -> Vec<&str> {
    records.iter().map(|record| record.payload.as_str()).collect()
}

/// Five runs, closed, so that everything is in the main file.
fn closed_journal() -> (Directory, Vec<(RunId, Vec<StoredRecord>)>) {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let mut ids = Vec::new();
    for _ in 0..5 {
        let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
        for (second, record) in (0..).zip(records()) {
            append(&mut journal, second, &record);
        }
        journal.commit().unwrap();
        ids.push(journal.id());
    }
    drop(store);
    let reader = Reader::open(directory.path()).unwrap();
    let runs = ids.into_iter().map(|id| (id, reader.records(id).unwrap())).collect();
    (directory, runs)
}

#[test]
fn a_flipped_bit_is_never_read_as_a_record() {
    const SEED: u64 = 20;
    let (directory, runs) = closed_journal();
    let clean = fs::read(directory.path().join("rigd.db")).unwrap();
    let mut random = Random(SEED);
    let (mut intact, mut altered, mut otherwise_broken, mut refused) = (0, 0, 0, 0);
    for _ in 0..600 {
        let (byte, bit) = (random.below(clean.len()), random.below(8));
        let mut bytes = clean.clone();
        bytes[byte] ^= 1 << bit;
        let damaged = Directory::new();
        fs::write(damaged.path().join("rigd.db"), bytes).unwrap();
        let Ok(reader) = Reader::open(damaged.path()) else {
            refused += 1;
            continue;
        };
        for (id, expected) in &runs {
            let Ok(chain) = reader.chain(*id) else {
                refused += 1;
                continue;
            };
            let here = format!("seed {SEED}, bit {bit} of byte {byte}");
            let kept = texts(&chain.records);
            assert_eq!(kept, texts(&expected[..kept.len()]), "{here}");
            match chain.check {
                ChainCheck::Intact { .. } => {
                    assert_eq!(kept.len(), expected.len(), "{here}");
                    intact += 1;
                }
                ChainCheck::Broken { flaw: Flaw::Altered, .. } => altered += 1,
                ChainCheck::Broken { .. } => otherwise_broken += 1,
            }
        }
    }
    let counts = [intact, altered, otherwise_broken, refused];
    assert!(counts.iter().all(|&count| count > 0), "each must happen: {counts:?}");
}

#[test]
fn a_record_that_changes_while_pages_are_read_ends_them() {
    for (change, flaw) in [
        ("UPDATE records SET payload = replace(payload, '158.3', '158.4')", Flaw::Altered),
        ("DELETE FROM records", Flaw::Missing),
    ] {
        let (directory, runs) = closed_journal();
        let reader = Reader::open(directory.path()).unwrap();
        let mut pages = reader.pages(runs[1].0).unwrap();
        let database = rusqlite::Connection::open(directory.path().join("rigd.db")).unwrap();
        database.execute(&format!("{change} WHERE run = 2 AND seq >= 10"), []).unwrap();
        let refusal = reader.next_page(&mut pages).unwrap_err();
        assert!(
            matches!(&refusal, StoreError::Broken { seq: 10, flaw: found, .. } if *found == flaw),
            "{change}: {refusal}"
        );
    }
}

#[test]
fn a_changed_lost_or_added_record_is_pointed_at() {
    #[track_caller]
    fn check(change: &str, expected: (u64, Flaw)) {
        let (directory, runs) = closed_journal();
        let database = rusqlite::Connection::open(directory.path().join("rigd.db")).unwrap();
        let changed = database.execute_batch(&format!("PRAGMA foreign_keys = OFF; {change}"));
        changed.unwrap();
        let reader = Reader::open(directory.path()).unwrap();
        let (seq, flaw) = expected;
        let check = reader.verify(runs[1].0).unwrap();
        assert_eq!(check, ChainCheck::Broken { seq, flaw: flaw.clone() }, "{change}");
        let refusal = reader.records(runs[1].0).unwrap_err();
        assert!(
            matches!(&refusal, StoreError::Broken { seq: at, flaw: what, .. } if *at == seq && *what == flaw),
            "{change}: {refusal}"
        );
        // The damage stays in its run.
        assert!(matches!(reader.verify(runs[0].0).unwrap(), ChainCheck::Intact { .. }), "{change}");
    }
    check(
        "UPDATE records SET payload = replace(payload, '158.3', '158.4') WHERE run = 2 AND seq = 10",
        (10, Flaw::Altered),
    );
    check("UPDATE records SET rig_us = rig_us + 1 WHERE run = 2 AND seq = 3", (3, Flaw::Altered));
    check("UPDATE records SET kind = 'moved' WHERE run = 2 AND seq = 1", (1, Flaw::Altered));
    check("UPDATE records SET digest = zeroblob(32) WHERE run = 2 AND seq = 5", (5, Flaw::Altered));
    check("UPDATE records SET digest = x'00' WHERE run = 2 AND seq = 5", (5, Flaw::Altered));
    check("DELETE FROM records WHERE run = 2 AND seq = 4", (4, Flaw::Missing));
    check("DELETE FROM records WHERE run = 2 AND seq >= 9", (9, Flaw::Missing));
    check("DELETE FROM records WHERE run = 2", (1, Flaw::Missing));
    check(
        "UPDATE records SET seq = -seq WHERE run = 2 AND seq IN (6, 7);
         UPDATE records SET seq = 13 + seq WHERE run = 2 AND seq < 0",
        (6, Flaw::Altered),
    );
    check(
        "INSERT INTO records (run, seq, epoch, rig_us, kind, payload, digest)
         SELECT run, 15, epoch, rig_us, kind, payload, digest FROM records WHERE run = 2 AND seq = 14",
        (15, Flaw::Altered),
    );
    check("UPDATE records SET epoch = 2 WHERE run = 2 AND seq >= 5", (5, Flaw::Altered));
    for column in ["name", "kind", "bench", "journal", "started_at"] {
        let other = if column == "kind" { "session" } else { "another" };
        let change = format!("UPDATE runs SET {column} = '{other}' WHERE key = 2");
        check(&change, (14, Flaw::ListDiffers));
    }
    check("UPDATE runs SET format = 1 WHERE key = 2", (14, Flaw::ListDiffers));
    check("UPDATE stretches SET rig_us = 1 WHERE run = 2", (14, Flaw::ListDiffers));
    check("DELETE FROM stretches WHERE run = 2", (14, Flaw::ListDiffers));
    check("UPDATE runs SET status = 'completed' WHERE key = 2", (14, Flaw::EndDiffers));
    check("UPDATE runs SET status = 'running' WHERE key = 2", (14, Flaw::EndDiffers));
}

#[test]
fn what_was_committed_survives_a_log_cut_at_any_length() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let log = directory.path().join("rigd.db-wal");
    let length = || usize::try_from(fs::metadata(&log).unwrap().len()).unwrap();
    let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
    // Length of the log after each commit, and how many records were committed by then.
    let mut acknowledged = Vec::new();
    for (second, record) in (0..).zip(records()) {
        append(&mut journal, second, &record);
        journal.commit().unwrap();
        acknowledged.push((length(), second + 1));
    }
    let whole = length();
    let (first_commit, _) = acknowledged[0];
    let mut seen = Vec::new();
    for cut in (first_commit..whole).step_by(2039).chain([whole]) {
        let crashed = copied(directory.path(), &["rigd.db", "rigd.db-wal"]);
        let file = fs::File::options().write(true).open(crashed.path().join("rigd.db-wal"));
        file.unwrap().set_len(cut as u64).unwrap();
        let promised = acknowledged.iter().rev().find(|(length, _)| *length <= cut).unwrap().1;
        let reopened = Store::open(crashed.path()).unwrap();
        let reader = reopened.reader().unwrap();
        let ChainCheck::Intact { records, .. } = reader.verify(journal.id()).unwrap() else {
            panic!("the chain is broken after a cut at byte {cut}");
        };
        let is_ended = reader.run(journal.id()).unwrap().status != RunStatus::Running;
        assert!(is_ended, "cut at byte {cut}");
        assert_eq!(records, promised, "cut at byte {cut}");
        seen.push(promised);
    }
    seen.dedup();
    assert_eq!(seen, (1..=14).collect::<Vec<_>>(), "every record must have been the last one once");
}

#[test]
fn a_damaged_log_loses_its_tail_and_nothing_else() {
    const SEED: u64 = 21;
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
    let written = records();
    for (second, record) in (0..).zip(&written) {
        append(&mut journal, second, record);
        journal.commit().unwrap();
    }
    let clean = fs::read(directory.path().join("rigd.db-wal")).unwrap();
    let mut random = Random(SEED);
    let (mut opened, mut shortened) = (0, 0);
    for _ in 0..200 {
        let (byte, bit) = (random.below(clean.len()), random.below(8));
        let damaged = copied(directory.path(), &["rigd.db"]);
        let mut bytes = clean.clone();
        bytes[byte] ^= 1 << bit;
        fs::write(damaged.path().join("rigd.db-wal"), bytes).unwrap();
        // With the first page of the log the tables themselves may be gone.
        let Ok(reader) = Reader::open(damaged.path()) else { continue };
        let Ok(chain) = reader.chain(journal.id()) else { continue };
        let here = format!("seed {SEED}, bit {bit} of byte {byte}");
        let kept: Vec<Record> = chain.records.iter().map(|kept| kept.record().unwrap()).collect();
        assert_eq!(kept, written[..kept.len()], "{here}");
        assert!(matches!(chain.check, ChainCheck::Intact { .. }), "{here}: {:?}", chain.check);
        opened += 1;
        shortened += u32::from(kept.len() < written.len());
    }
    assert!(opened > 100 && shortened > 50, "{opened} opened, {shortened} of them shortened");
}

/// Not a test: the program that the next test starts. It commits the given number of records,
/// appends one more, and dies.
#[test]
fn crash_when_told_to() {
    let Ok(directory) = std::env::var("RIG_STORE_CRASH_IN") else { return };
    let commits: usize = std::env::var("RIG_STORE_CRASH_AFTER").unwrap().parse().unwrap();
    let store = Store::open(Path::new(&directory)).unwrap();
    let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
    for (second, record) in (0..).zip(records().into_iter().take(commits)) {
        append(&mut journal, second, &record);
        journal.commit().unwrap();
    }
    append(&mut journal, 99, &run_started());
    std::process::abort();
}

#[test]
fn a_program_that_dies_at_any_record_loses_none_that_was_committed() {
    // The last record ends the run, so that nothing can be appended behind it.
    for commits in 0..records().len() {
        let directory = Directory::new();
        let died = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "tests::damage::crash_when_told_to", "--test-threads=1"])
            .env("RIG_STORE_CRASH_IN", directory.path())
            .env("RIG_STORE_CRASH_AFTER", commits.to_string())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .unwrap();
        assert!(!died.success());
        // The lock died with the program.
        let store = Store::open(directory.path()).unwrap();
        let runs = store.reader().unwrap().runs().unwrap();
        if commits == 0 {
            assert_eq!(runs, []);
            continue;
        }
        assert_eq!(store.interrupted(), [runs[0].id]);
        let stored = store.reader().unwrap().records(runs[0].id).unwrap();
        assert_eq!(stored.len(), commits);
        for (stored, written) in stored.iter().zip(records().into_iter().take(commits)) {
            assert_eq!(stored.record().unwrap(), written);
        }
    }
}

#[test]
fn a_full_disk_closes_the_journal_and_keeps_what_was_committed() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
    append(&mut journal, 0, &run_started());
    journal.commit().unwrap();
    store.limit_pages(20);
    let refusal = (1..1000)
        .map(|number| journal.append(number, &sweep(number, SweepPurpose::Touch, 150.0)))
        .find_map(Result::err)
        .expect("20 pages do not hold 1000 sweeps");
    assert!(matches!(refusal, StoreError::DiskFull), "{refusal}");
    // The next failure is not taken for a full disk again, and nothing slips in between.
    let refusals = [
        journal.append(1, &run_started()).unwrap_err(),
        journal.commit().unwrap_err(),
        store.begin(RunKind::Run, "another").unwrap_err(),
    ];
    assert!(refusals.iter().all(|refusal| matches!(refusal, StoreError::Closed)), "{refusals:?}");
    let id = journal.id();
    drop((store, journal));
    let store = Store::open(directory.path()).unwrap();
    let stored = store.reader().unwrap().records(id).unwrap();
    assert_eq!(stored.len(), 1);
    assert_eq!(stored[0].record().unwrap(), run_started());
}
