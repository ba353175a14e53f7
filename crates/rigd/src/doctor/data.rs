//! The data directory: whether it can be written, holds a sound journal, and has room.

use std::{
    fs::{self, File},
    io,
    path::{Path, PathBuf},
};

use rig_model::with_causes;
use rig_store::{Reader, StoreError};

use super::{Finding, Findings, growth};
use crate::interruption::{ADVICE, InterruptedRig, LeftProbe};

/// A run leaves some megabytes; below this, the next one may not fit.
const SPACE_MIN_BYTES: u64 = 100 << 20;
/// A smaller free space gives a warning.
const SPACE_GOOD_BYTES: u64 = 1 << 30;

pub(super) fn findings(data: &Path, rig: (&str, bool)) -> Vec<Finding> {
    let mut findings = Findings::of("data directory");
    // A missing directory will be made at this path.
    let place = existing(data);
    match try_to_write(&place) {
        Ok(()) => findings.ok("writable", data.display().to_string()),
        Err(error) => findings.problem(
            "writable",
            format!("{}: {error}", place.display()),
            "choose another with --data, or let this user write there",
        ),
    }
    match rig_system::disk::free_bytes(&place) {
        Ok(free_bytes) => {
            space(&mut findings, free_bytes);
            growth::finding(&mut findings, data, free_bytes);
        }
        Err(error) => findings.warning(
            "space",
            format!("{}: {error}", place.display()),
            "check the free space there",
        ),
    }
    if let Some(text) = rig_system::files::protection(&place) {
        let advice =
            "look at the access list of the directory: its files decide who may operate the rig";
        findings.warning("access", text, advice);
    }
    journal(&mut findings, data, rig);
    findings.all
}

/// The directory itself, or the nearest above it that exists.
fn existing(data: &Path) -> PathBuf {
    let data = std::path::absolute(data).unwrap_or_else(|_| data.to_path_buf());
    data.ancestors().find(|path| path.exists()).unwrap_or(&data).to_path_buf()
}

/// Permissions alone do not tell: the file system may be full or read-only.
fn try_to_write(place: &Path) -> io::Result<()> {
    let trial = place.join(format!(".rigd-doctor-{}", std::process::id()));
    File::create_new(&trial).and_then(|file| file.sync_all())?;
    fs::remove_file(trial)
}

fn space(findings: &mut Findings, free_bytes: u64) {
    let text = format!("{} MiB free", free_bytes >> 20);
    let advice = "move old runs elsewhere, or choose another directory with --data";
    if free_bytes < SPACE_MIN_BYTES {
        findings.problem("space", text, advice);
    } else if free_bytes < SPACE_GOOD_BYTES {
        findings.warning("space", text, advice);
    } else {
        findings.ok("space", text);
    }
}

/// The journal is only read: interrupted runs stay unchanged.
fn journal(findings: &mut Findings, data: &Path, (rig, is_simulated): (&str, bool)) {
    let left = Reader::open(data).map(|reader| {
        let has_writer = reader.has_writer();
        let left = if has_writer { None } else { InterruptedRig::left(&reader, rig, is_simulated) };
        (has_writer, left)
    });
    match left {
        // A missing journal is created at the next start.
        Err(StoreError::NoJournal) => {}
        Ok((true, _)) => findings.warning(
            "journal",
            StoreError::InUse.to_string(),
            "the other rigd also has the ports open: end it, or use its HTTP interface",
        ),
        Ok((false, left)) => {
            match flaw_of_list(data) {
                Ok(None) => findings.ok("journal", "can be opened; the list of runs is whole"),
                Ok(Some(flaw)) => findings.problem(
                    "journal",
                    flaw,
                    "keep the directory; `rigd salvage NEW --data DIR` copies what verifies",
                ),
                Err(error) => findings.problem(
                    "journal",
                    with_causes(&error),
                    "keep the directory; `rigd salvage NEW --data DIR` copies what verifies",
                ),
            }
            match left {
                Some(left) if left.probe != LeftProbe::Clear && left.is_latched => {
                    findings.problem("probe", left.message, ADVICE);
                }
                Some(left) if left.probe != LeftProbe::Clear => {
                    findings.warning("probe", left.message, ADVICE);
                }
                Some(InterruptedRig { is_interrupted: true, message, .. }) => findings.warning(
                    "last session",
                    message,
                    "all measurements up to then are in the journal: `rigd runs`, `rigd show`",
                ),
                Some(InterruptedRig { is_latched: true, message, .. }) => findings.warning(
                    "last session",
                    message,
                    "a daemon moves nothing before a person acknowledges the cause; the next command at a terminal acknowledges it",
                ),
                Some(InterruptedRig { message, .. }) => findings.ok("probe", message),
                None => {}
            }
        }
        Err(error) => findings.problem(
            "journal",
            with_causes(&error),
            "keep the directory for the maintainer of rigd, and start another one with --data",
        ),
    }
}

/// What is wrong with the list of runs; `None` if it is whole.
fn flaw_of_list(data: &Path) -> Result<Option<String>, StoreError> {
    let reader = Reader::open(data)?;
    let damaged = reader.damaged_entries()?.into_iter();
    let damaged: Vec<_> = damaged.map(|(id, flaw)| format!("{id}: {flaw}")).collect();
    if !damaged.is_empty() {
        return Ok(Some(damaged.join("; ")));
    }
    let changed = reader.broken_link()?;
    Ok(changed.map(|run| format!("the list of runs has been changed at run {run} or before it")))
}

#[cfg(test)]
mod tests {
    use rig_store::Store;

    use super::{super::Level, *};

    #[track_caller]
    fn check(free_bytes: u64, level: Level) {
        let mut findings = Findings::of("data directory");
        space(&mut findings, free_bytes);
        assert_eq!(findings.all[0].level, level, "{free_bytes}");
        assert_eq!(findings.all[0].advice.is_none(), level == Level::Ok);
    }

    #[test]
    fn a_disk_that_fills_up_is_seen_before_it_is_full() {
        check(0, Level::Problem);
        check((100 << 20) - 1, Level::Problem);
        check(100 << 20, Level::Warning);
        check((1 << 30) - 1, Level::Warning);
        check(1 << 30, Level::Ok);
    }

    #[test]
    fn a_directory_that_is_still_to_be_made_is_looked_at_where_it_will_be() {
        let scratch = tempfile::TempDir::new().unwrap();
        let data = scratch.path().join("not/yet");
        assert_eq!(existing(&data), scratch.path());
        let found = findings(&data, ("bench", false));
        assert_eq!(found[0].level, Level::Ok, "{found:?}");
        assert!(!data.exists() && scratch.path().read_dir().unwrap().next().is_none());
        // The path is a file.
        fs::write(data.parent().unwrap(), "").unwrap();
        assert_eq!(findings(&data, ("bench", false))[0].level, Level::Problem);
    }

    #[test]
    fn the_journal_of_another_program_is_left_alone() {
        let scratch = tempfile::TempDir::new().unwrap();
        let journal = |path: &Path| findings(path, ("bench", false)).pop().unwrap();
        let store = Store::open(scratch.path()).unwrap();
        assert_eq!(journal(scratch.path()).level, Level::Warning);
        drop(store);
        assert_eq!(journal(scratch.path()).level, Level::Ok);
        fs::write(scratch.path().join("rigd.db"), "not a database, but long enough").unwrap();
        let damaged = journal(scratch.path());
        assert_eq!((damaged.check, damaged.level), ("journal", Level::Problem));
    }
}
