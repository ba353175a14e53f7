//! Position of the probe after a killed program, from the journal.

use rusqlite::{OptionalExtension, params};

use super::{Reader, record_from, select_records};
use crate::{Axis, Clearance, Record, Run, RunId, RunKind, StoreError};

/// The last state of the probe in the journal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ProbeWord {
    /// It was shown clear by a read-back, and was not lowered since.
    Clear,
    /// It was about to be lowered, was lowered, or was lost sight of, and was not shown clear
    /// since.
    MayTouch {
        /// Position of the linear axis at its last read-back since then, mm.
        at_mm: Option<f64>,
        /// The lowest position that it was allowed to go to, mm.
        down_to_mm: Option<f64>,
    },
    /// No record about the probe, or the rig was on its way into service.
    Silent,
}

/// The state in which a killed program left a run or session.
#[derive(Debug, Clone, PartialEq)]
pub struct Interruption {
    /// When something was last written: wall clock, UTC, RFC 3339 with milliseconds.
    pub at: String,
    /// The step under way.
    pub step: Option<String>,
    /// Clearance of the probe at that time.
    pub probe: ProbeWord,
    /// Whether a later session of the same rig has shown the probe to be clear.
    pub is_cleared_since: bool,
}

impl Reader {
    /// The latest session with a rig of this name.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite.
    pub fn latest_session(&self, rig: &str) -> Result<Option<Run>, StoreError> {
        let latest = "WHERE kind = 'session' AND name = ?1 ORDER BY key DESC LIMIT 1";
        Ok(self.select_runs(latest, [rig])?.pop())
    }

    /// The state of an interrupted run or session; `None` for any other.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite, or [`StoreError::Unreadable`].
    pub fn interruption(&self, run: &Run) -> Result<Option<Interruption>, StoreError> {
        if !run.status.is_interrupted() {
            return Ok(None);
        }
        let probe = match (self.probe_word(run)?, run.kind) {
            // A run begins with the probe clear.
            (ProbeWord::Silent, RunKind::Run | RunKind::Amendment) => ProbeWord::Clear,
            (word, _) => word,
        };
        let is_cleared_since = self.is_cleared_after(run)?;
        let at = run.finished_at.as_ref().unwrap_or(&run.started_at).clone();
        Ok(Some(Interruption { at, step: self.last_step(run.id)?, probe, is_cleared_since }))
    }

    /// The last state of the probe: in a run by its own records, in a session by all records of its
    /// epoch.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite, or [`StoreError::Unreadable`].
    pub fn probe_word(&self, run: &Run) -> Result<ProbeWord, StoreError> {
        let mut statement = self.connection.prepare_cached(&select_records(
            "JOIN runs AS owner ON owner.key = records.run
             JOIN runs AS asked ON asked.id = ?1
             WHERE records.kind IN ('intent', 'moved', 'fault', 'state_changed')
               AND CASE asked.kind WHEN 'session' THEN records.epoch = asked.epoch
                   ELSE owner.key = asked.key END
             ORDER BY records.id DESC",
        ))?;
        let mut rows = statement.query([run.id.to_string()])?;
        let (mut is_lost, mut is_unknown, mut at_mm) = (false, false, None);
        let mut down_to_mm = None;
        while let Some(row) = rows.next()? {
            match record_from(row)?.record()? {
                Record::Moved(moved) if moved.is_clear && !is_lost && !is_unknown => {
                    return Ok(ProbeWord::Clear);
                }
                Record::Moved(moved) if moved.is_clear => break,
                Record::Moved(moved) if moved.axis == Axis::LinearMm => {
                    is_lost = true;
                    at_mm = at_mm.or(Some(moved.read_back));
                }
                Record::Intent(intent) => {
                    is_lost = true;
                    down_to_mm = Some(intent.to);
                    break;
                }
                Record::Fault(fault) => is_lost |= fault.probe != Clearance::Clear,
                // On the way into service nothing is known, and nothing is lowered.
                Record::StateChanged(change) => is_unknown |= change.state == "preparing",
                _ => {}
            }
        }
        Ok(if is_lost { ProbeWord::MayTouch { at_mm, down_to_mm } } else { ProbeWord::Silent })
    }

    /// The cause of the latch in which a session ended; `None` if it ended otherwise.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite, or [`StoreError::Unreadable`].
    pub fn latched_by(&self, session: &Run) -> Result<Option<String>, StoreError> {
        let mut statement = self.connection.prepare_cached(&select_records(
            "WHERE records.epoch = ?1 AND records.kind IN ('fault', 'state_changed')
             ORDER BY records.id DESC",
        ))?;
        let mut rows = statement.query([session.epoch.cast_signed()])?;
        let (mut is_latched, mut cause) = (false, None);
        while let Some(row) = rows.next()? {
            match record_from(row)?.record()? {
                Record::StateChanged(change) if change.state == "latched" && !is_latched => {
                    is_latched = true;
                }
                // The state before, after the first cause.
                Record::StateChanged(change) if !is_latched || change.state != "retracting" => {
                    break;
                }
                Record::Fault(fault) => cause = Some(fault.cause),
                _ => {}
            }
        }
        Ok(cause.filter(|_| is_latched))
    }

    fn last_step(&self, run: RunId) -> Result<Option<String>, StoreError> {
        let mut statement = self.connection.prepare_cached(&select_records(
            "WHERE run = (SELECT key FROM runs WHERE id = ?1) AND records.kind = 'step_started'
             ORDER BY seq DESC LIMIT 1",
        ))?;
        let found = statement.query_row([run.to_string()], record_from).optional()?;
        Ok(match found.map(|found| found.record()).transpose()? {
            Some(Record::StepStarted(started)) => Some(started.step),
            _ => None,
        })
    }

    /// Whether a session of the same rig has shown the probe to be clear since a run or session was
    /// last written to.
    fn is_cleared_after(&self, run: &Run) -> Result<bool, StoreError> {
        let rig = match run.kind {
            RunKind::Session => run.name.clone(),
            RunKind::Run | RunKind::Amendment => match self.first_record(run.id)? {
                Some(Record::RunStarted(started)) => started.rig.name,
                _ => return Ok(false),
            },
            RunKind::Archive => return Ok(false),
        };
        let mut statement = self.connection.prepare_cached(&select_records(
            "JOIN runs AS owner ON owner.key = records.run
             WHERE owner.kind = 'session' AND owner.name = ?1
               AND records.kind = 'moved' AND records.id > (
                   SELECT coalesce(max(records.id), 0) FROM runs AS asked JOIN records
                   ON CASE asked.kind WHEN 'session' THEN records.epoch = asked.epoch
                      ELSE records.run = asked.key END
                   WHERE asked.id = ?2)",
        ))?;
        let mut rows = statement.query(params![rig, run.id.to_string()])?;
        while let Some(row) = rows.next()? {
            if matches!(record_from(row)?.record()?, Record::Moved(moved) if moved.is_clear) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    pub(super) fn first_record(&self, run: RunId) -> Result<Option<Record>, StoreError> {
        let mut statement = self.connection.prepare_cached(&select_records(
            "WHERE run = (SELECT key FROM runs WHERE id = ?1) AND seq = 1",
        ))?;
        let found = statement.query_row([run.to_string()], record_from).optional()?;
        Ok(found.map(|found| found.record()).transpose()?)
    }
}
