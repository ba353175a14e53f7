//! The cost of a record and of a commit, on the disk of the target directory:
//! `cargo bench -p rig-store`.

use std::{
    error::Error,
    fs,
    io::{Write, stdout},
    path::Path,
    time::{Duration, Instant},
};

use rig_store::{
    Axis, Journal, Move, ReadingFlag, ReadingRecord, Record, RunKind, Store, Sweep, SweepOutcome,
    SweepPurpose,
};

/// Records that are each made durable.
const EACH: usize = 500;

fn main() -> Result<(), Box<dyn Error>> {
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR")).join("record-bench");
    if directory.exists() {
        fs::remove_dir_all(&directory)?;
    }
    let store = Store::open(&directory)?;
    let mut journal = store.begin(RunKind::Session, "cost")?;
    let moved = Move { axis: Axis::LinearMm, target: 10.125, read_back: 10.1249, is_clear: false };
    let moved = Record::Moved(moved);
    let rows = [("move", moved), ("sweep of 40 readings", sweep(40))];
    for (what, record) in rows {
        let append = median(2000, || journal.append(0, &record).map(drop))?;
        journal.commit()?;
        let before = processor_time();
        let both = median(EACH, || durable(&mut journal, &record))?;
        let used = processor_time().saturating_sub(before) / u32::try_from(EACH)?;
        writeln!(
            stdout(),
            "{what}: append {append:.1?}, append and commit {both:.1?}, of which the processor works {used:.1?} in the mean"
        )?;
    }
    let reader = store.reader()?;
    let start = Instant::now();
    let records = reader.records(journal.id())?.len();
    writeln!(stdout(), "read and verified {records} records in {:.1?}", start.elapsed())?;
    Ok(())
}

/// The time for which the processor has worked for this thread, also in the system.
fn processor_time() -> Duration {
    rig_system::clocks::of_thread()
}

fn durable(journal: &mut Journal, record: &Record) -> Result<(), rig_store::StoreError> {
    journal.append(0, record)?;
    journal.commit()
}

fn median<E>(times: usize, mut work: impl FnMut() -> Result<(), E>) -> Result<Duration, E> {
    let mut taken = Vec::new();
    for _ in 0..times {
        let start = Instant::now();
        work()?;
        taken.push(start.elapsed());
    }
    taken.sort();
    Ok(taken[times / 2])
}

fn sweep(readings: u32) -> Record {
    let reading = |index: u32| ReadingRecord {
        frequency_hz: 140.0 + f64::from(index) / 7.0,
        resistance_ohm: Some(1e5 / f64::from(index + 3)),
        reactance_ohm: Some(-4e4 - f64::from(index).sqrt()),
        started_s: f64::from(index) / 3.0,
        settle_s: 0.05,
        integration_s: 0.1,
        flag: ReadingFlag::Normal,
    };
    Record::Sweep(Sweep {
        number: 1,
        purpose: SweepPurpose::Manual,
        step: None,
        pose: None,
        level_v: None,
        readings: (0..readings).map(reading).collect(),
        probe_readings: 0,
        fit: None,
        outcome: SweepOutcome::Accepted {
            resonance_hz: 141.0,
            sigma_hz: 0.01,
            effective_time_s: None,
            circuit: None,
            extra: None,
            left_out: 0,
        },
    })
}
