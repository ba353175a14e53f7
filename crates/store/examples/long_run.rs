//! Adds a run of a wanted size to a data directory, for measurements with long runs: `long_run DATA RUN MEGABYTES`.
//! It has the records of another run, whose sweeps are repeated. No daemon may serve the directory.
#![expect(clippy::print_stdout, reason = "the id of the run is the output of this program")]

use std::{env, error::Error, path::PathBuf};

use rig_store::{Ending, Record, RunFinished, RunKind, Store};

/// Records in one transaction.
const AT_ONCE: usize = 256;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [data, run, megabytes] = &arguments[..] else {
        return Err("usage: long_run DATA RUN MEGABYTES".into());
    };
    let wanted = 1_000_000 * megabytes.parse::<usize>()?;
    let store = Store::open(&PathBuf::from(data))?;
    let reader = store.reader()?;
    let source = reader.find(run)?;
    let records = reader.records(source.id)?;
    let is_sweep = |kind: &str| kind == "sweep";
    let mut sweeps = Vec::new();
    let mut journal = store.begin(RunKind::Run, &source.name)?;
    for stored in &records {
        match stored.record()? {
            Record::RunFinished(_) => {}
            record => {
                journal.append(stored.rig_us, &record)?;
                if is_sweep(&stored.kind) {
                    sweeps.push((stored.payload.len(), record));
                }
            }
        }
    }
    let at = records.last().map_or(0, |last| last.rig_us);
    let mut number = sweeps.len() as u64;
    let mut size = 0;
    for (index, (bytes, sweep)) in sweeps.iter().cycle().enumerate() {
        let Record::Sweep(sweep) = sweep else { continue };
        number += 1;
        let again = rig_store::Sweep { number, ..sweep.clone() };
        journal.append(at, &Record::Sweep(again))?;
        size += bytes;
        if index % AT_ONCE == 0 {
            journal.commit()?;
        }
        if size >= wanted {
            break;
        }
    }
    journal.append(at, &Record::RunFinished(RunFinished { status: Ending::Completed }))?;
    journal.commit()?;
    println!("{}", journal.id());
    Ok(())
}
