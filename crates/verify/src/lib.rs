//! Checks the journal of a run: its chain of digests, every move, every label and every result.
//!
//! This crate shares no code with the program that writes journals. It has types of its own for the
//! records (`record`), reads the rig and the protocol from the text in the journal with types of
//! its own (`settings`), follows the axes from record to record (`motion`), holds each label
//! against the pose in which the axes were (`labels`), and fits every accepted sweep again
//! (`fit`). What it cannot confirm is a [`Finding`].
//!
//! ```text
//!  rigd.db ─▶ journal ─▶ chain ─▶ walk ─▶ motion: where the axes were
//!                                   ├───▶ labels: what was measured there
//!                                   └───▶ results: what follows from the readings ─▶ fit
//! ```
//!
//! Of a run whose readings were moved to an archive, what is left is checked (`archived`). Of a sealed run in an
//! object store, records, chain, seal and signature are checked from its file alone (`object`).

mod aim;
mod amendment;
mod archived;
mod between;
mod chain;
mod copies;
mod descent;
mod drift;
mod finding;
mod fit;
mod folder;
mod journal;
mod labels;
mod layout;
mod list;
mod model;
mod motion;
mod normal;
mod object;
mod plan;
mod record;
mod refused;
mod results;
mod screw;
mod screw_map;
mod seam;
mod settings;
mod surface;
mod survey;
mod walk;

use std::path::Path;

use rusqlite::Connection;

pub use finding::{ArchivedPart, Check, Finding, Verdict};
pub use folder::{FileFinding, verify_folder};
pub use journal::JournalError;
use record::Cited;

pub use model::{ModelCheck, StatedModel, verify_model};
pub use object::{ObjectError, ObjectVerdict, verify_object};

/// Checks the run or session with this id in the journal of a data directory. Nothing is written.
///
/// # Errors
/// [`JournalError`] if the journal cannot be opened, has another format, or has no such run. Damage
/// inside the run is a finding.
pub fn verify(data: &Path, run: &str) -> Result<Verdict, JournalError> {
    let connection = journal::open(&data.join("rigd.db"))?;
    let journal = journal::read(&connection, run)?;
    let mut verdict = walk::check(&connection, &journal);
    let mut findings = finding::Findings::default();
    let read = |file: &str| std::fs::read_to_string(data.join("calibrations").join(file)).ok();
    let cited = journal.cited();
    let missing = cited.iter().filter(|one| one.cable.is_none() && read(&one.file).is_none());
    verdict.notes.extend(missing.map(|Cited { file, .. }| {
        format!("the calibration {file} is not here: what is cited of it was not compared with it")
    }));
    let maps = screw::check_files(&cited, read, &mut findings);
    for map in &maps {
        verdict.notes.extend(screw_map::check(&connection, map, &mut findings)?);
    }
    verdict.is_sound &= findings.0.is_empty();
    verdict.findings.extend(findings.0);
    Ok(verdict)
}

/// A journal of this program in memory, which is checked with one connection.
#[derive(Debug)]
pub struct MemoryJournal(Connection);

impl MemoryJournal {
    /// Opens a database by its address for SQLite.
    ///
    /// # Errors
    /// [`JournalError`] of SQLite.
    pub fn open(address: &str) -> Result<Self, JournalError> {
        Ok(Self(journal::open_in_memory(address)?))
    }

    /// Checks these runs and sessions.
    ///
    /// # Errors
    /// As for [`verify`].
    pub fn verify(&self, runs: &[String]) -> Result<Vec<Verdict>, JournalError> {
        runs.iter().map(|run| check(&self.0, run)).collect()
    }
}

fn check(connection: &Connection, run: &str) -> Result<Verdict, JournalError> {
    Ok(walk::check(connection, &journal::read(connection, run)?))
}
