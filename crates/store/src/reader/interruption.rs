//! Position of the probe after a killed program, from the journal.

use rusqlite::{OptionalExtension, params, types::Value};

use super::{Reader, record_from, select_records};
use crate::{Axis, Clearance, Fault, Record, Run, RunId, RunKind, StoreError};

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

/// The operator's action that homes a linear stage whatever its position.
pub const HOMING: &str = "home with nothing below the probe";

/// The action with which a program brings a rig into service that nobody has latched.
pub const PREPARE: &str = "prepare";

/// Begin of the cause of a fault of the rotary stage.
const OF_ROTARY: &str = "rotary stage: ";

/// A linear stage that was read back elsewhere than its last moves can have led it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jump {
    /// The lowest and the highest position to which they can have led it, mm.
    pub last_moves_mm: [f64; 2],
    /// Whether a homing was asked for since: no move has come after it.
    pub is_homing_open: bool,
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

/// The records of the run `?1`.
const OF_RUN: &str = "records.run = (SELECT key FROM runs WHERE id = ?1)";

/// The records of the epoch `?1`. There is no index of epochs, but what is measured in a later epoch has later events.
/// So they lie between the first record of the last run begun before the epoch, and that of the first run begun after it.
/// A `run_finished` is no bound: an opening of the journal gives it to a session of an earlier epoch.
const OF_EPOCH: &str = "records.epoch = ?1
    AND records.id > coalesce((
        SELECT begun.id FROM records AS begun
        WHERE begun.run = (SELECT max(key) FROM runs WHERE epoch < ?1)
            AND begun.seq = 1 AND begun.epoch < ?1 AND begun.kind <> 'run_finished'), 0)
    AND records.id < coalesce((
        SELECT begun.id FROM records AS begun
        WHERE begun.run = (SELECT min(key) FROM runs WHERE epoch > ?1)
            AND begun.seq = 1 AND begun.epoch > ?1 AND begun.kind <> 'run_finished'),
        9223372036854775807)";

/// Which records tell of a run or session, and their order.
const fn own_records(kind: RunKind) -> (&'static str, &'static str) {
    match kind {
        RunKind::Session => (OF_EPOCH, "records.id"),
        RunKind::Run | RunKind::Amendment | RunKind::Archive => (OF_RUN, "seq"),
    }
}

/// The value of `?1` for the records of a run or session.
fn asked(run: &Run) -> Value {
    match run.kind {
        RunKind::Session => run.epoch.cast_signed().into(),
        RunKind::Run | RunKind::Amendment | RunKind::Archive => run.id.to_string().into(),
    }
}

/// The records of a run or session that tell of its probe, the latest first.
pub(super) fn probe_records(kind: RunKind) -> String {
    let (own, order) = own_records(kind);
    select_records(&format!(
        "WHERE {own} AND records.kind IN ('intent', 'moved', 'fault', 'state_changed', 'resumed')
         ORDER BY {order} DESC"
    ))
}

/// The event of the last record of a run or session.
pub(super) fn last_event(kind: RunKind) -> String {
    let (own, order) = own_records(kind);
    format!("SELECT records.id FROM records WHERE {own} ORDER BY {order} DESC LIMIT 1")
}

/// The moves in sessions with the rig `?1` behind the event `?2`. Only sessions that go on behind it are looked at. The
/// plus keeps SQLite from looking at every record behind it.
pub(super) const MOVED_AFTER: &str = "
    WHERE records.run IN (
        SELECT session.key FROM runs AS session
        WHERE session.kind = 'session' AND session.name = ?1 AND ?2 < (
            SELECT last.id FROM records AS last WHERE last.run = session.key
            ORDER BY last.seq DESC LIMIT 1))
      AND records.kind = 'moved' AND +records.id > ?2";

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
        let mut statement = self.connection.prepare_cached(&probe_records(run.kind))?;
        let mut rows = statement.query([asked(run)])?;
        let (mut is_lost, mut is_unknown, mut at_mm) = (false, false, None);
        let mut down_to_mm = None;
        while let Some(row) = rows.next()? {
            match record_from(row)?.record()? {
                Record::Moved(moved) if moved.is_clear && !is_lost && !is_unknown => {
                    return Ok(ProbeWord::Clear);
                }
                Record::Moved(moved) if moved.is_clear => break,
                // A run goes on with the probe clear.
                Record::Resumed(_) if !is_lost && !is_unknown => return Ok(ProbeWord::Clear),
                Record::Resumed(_) => break,
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

    /// The jump of the linear stage of a rig, if the stage has not moved since and the rig was not in service.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite, or [`StoreError::Unreadable`].
    pub fn jump(&self, rig: &str) -> Result<Option<Jump>, StoreError> {
        let of_epoch = select_records(&format!(
            "WHERE {OF_EPOCH} AND records.kind IN ('fault', 'state_changed', 'operator', 'moved')
             ORDER BY records.id DESC"
        ));
        let sessions = "WHERE kind = 'session' AND name = ?1 ORDER BY key DESC";
        let (mut last_moves_mm, mut is_homing_open) = (None, false);
        'service: for session in self.select_runs(sessions, [rig])? {
            let mut statement = self.connection.prepare_cached(&of_epoch)?;
            let mut rows = statement.query([session.epoch.cast_signed()])?;
            while let Some(row) = rows.next()? {
                match record_from(row)?.record()? {
                    // It comes to these after a homing, or where the position agrees with the last moves again.
                    Record::StateChanged(change) if change.state == "idle" => break 'service,
                    Record::Moved(moved) if moved.axis == Axis::LinearMm => break 'service,
                    // One that had ended would have brought it to one of these. The fault may be the first word of its end.
                    Record::Operator(operator) if operator.action == HOMING => {
                        is_homing_open = true;
                    }
                    Record::Fault(Fault { last_moves_mm: Some(span), .. }) => {
                        last_moves_mm.get_or_insert(span);
                    }
                    _ => {}
                }
            }
        }
        Ok(last_moves_mm.map(|last_moves_mm| Jump { last_moves_mm, is_homing_open }))
    }

    /// Whether a program has noted a fault of the rotary stage since the rig was last in service. What a way out of contact notes
    /// is of the program before it; what a salvage notes says that nothing is known.
    ///
    /// # Errors
    /// [`StoreError`] of the system or of SQLite, [`StoreError::Damaged`], or [`StoreError::Unreadable`].
    pub fn is_rotary_faulted_since_service(&self, rig: &str) -> Result<bool, StoreError> {
        let of_epoch = select_records(&format!(
            "WHERE {OF_EPOCH} AND records.kind IN ('fault', 'state_changed', 'operator')
             ORDER BY records.id DESC"
        ));
        let is_own = |run: &Run| run.kind == RunKind::Session && run.name == rig;
        for session in self.every_run()?.into_iter().filter(is_own) {
            let (mut is_of_rotary, mut is_faulted) = (false, false);
            let (mut was_prepared, mut has_state) = (false, false);
            let mut statement = self.connection.prepare_cached(&of_epoch)?;
            let mut rows = statement.query([session.epoch.cast_signed()])?;
            while let Some(row) = rows.next()? {
                match record_from(row)?.record()? {
                    Record::StateChanged(change) if change.state == "idle" => {
                        return Ok(is_of_rotary);
                    }
                    Record::StateChanged(change) => {
                        has_state = true;
                        was_prepared |= change.state == "preparing";
                    }
                    Record::Operator(operator) => was_prepared |= operator.action == PREPARE,
                    Record::Fault(fault) => {
                        is_faulted = true;
                        is_of_rotary |= fault.cause.starts_with(OF_ROTARY);
                    }
                    _ => {}
                }
            }
            if is_of_rotary && was_prepared || is_faulted && !has_state {
                return Ok(true);
            }
        }
        Ok(false)
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
        let mut statement = self.connection.prepare_cached(&last_event(run.kind))?;
        let last: Option<i64> = statement.query_row([asked(run)], |row| row.get(0)).optional()?;
        let mut statement = self.connection.prepare_cached(&select_records(MOVED_AFTER))?;
        let mut rows = statement.query(params![rig, last.unwrap_or(0)])?;
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
