//! The records of a run, followed along their chain.
//!
//! A run may have more records than fit in memory: a check keeps one of them at a time, and [`Pages`] gives a few.

use std::collections::VecDeque;

use rusqlite::params;

use super::{Reader, archive::is_taken_out, intact, record_from, select_records};
use crate::{
    Archived, Chain, ChainCheck, Digest, Ending, Flaw, Record, RunId, RunStatus, StoreError,
    StoredRecord,
};

/// Size of the records of a page, bytes; the last one may go beyond it.
const PAGE_BYTES: usize = 256 << 10;
/// Number of records of a page.
const PAGE_RECORDS: usize = 256;

/// The kind of the last record of an ended run.
const RUN_FINISHED: &str = "run_finished";
/// The kind of the record before it in a run that was given up.
const GIVEN_UP: &str = "given_up";

/// What is left of a chain once its records have been followed.
#[derive(Debug)]
pub(super) struct Followed {
    pub(super) records: u64,
    pub(super) digest: Digest,
    /// The epochs of the records, without repetitions in a row.
    pub(super) epochs: Vec<u64>,
    /// The end in the last record, if it has one.
    end: Option<Ending>,
    /// Number of the last record that gave the run up.
    given_up: Option<u64>,
}

/// The records of a run, or of a run and its amendments, of which a few are read at a time.
///
/// What comes later is not read: the walk ends where the runs ended when it began.
#[derive(Debug)]
pub struct Pages {
    parts: VecDeque<Part>,
    epochs: Vec<u64>,
    is_simulated: bool,
}

/// The records of one run that are still to be read.
#[derive(Debug)]
struct Part {
    run: RunId,
    next: u64,
    last: u64,
    digest: Digest,
}

impl Pages {
    /// The epochs of all records, ascending.
    pub fn epochs(&self) -> &[u64] {
        &self.epochs
    }

    /// Whether no real device took part in the run.
    pub const fn is_simulated(&self) -> bool {
        self.is_simulated
    }
}

impl Reader {
    /// Begins to read a run page by page. All of its records are checked first.
    ///
    /// # Errors
    /// As for [`Reader::records`].
    pub fn pages(&self, id: RunId) -> Result<Pages, StoreError> {
        self.pages_of(id, [id].into())
    }

    /// The records of a run with those of its ended amendments behind them.
    ///
    /// # Errors
    /// As for [`Reader::records`].
    pub fn amended_pages(&self, id: RunId) -> Result<Pages, StoreError> {
        let mut runs = vec![id];
        runs.extend(self.amendments(id)?);
        self.pages_of(id, runs)
    }

    fn pages_of(&self, id: RunId, runs: Vec<RunId>) -> Result<Pages, StoreError> {
        let (mut parts, mut epochs) = (VecDeque::new(), Vec::new());
        for run in runs {
            let _view = self.connection.unchecked_transaction()?;
            if let Some(Archived { place, .. }) = self.archive_of(run)? {
                return Err(StoreError::Archived { run, place });
            }
            let (check, of_run) = self.follow(run, None, &mut drop)?;
            intact(run, &check)?;
            let ChainCheck::Intact { records: last, .. } = check else { continue };
            epochs.extend(of_run);
            parts.push_back(Part { run, next: 1, last, digest: Digest::START });
        }
        epochs.sort_unstable();
        epochs.dedup();
        Ok(Pages { parts, epochs, is_simulated: self.is_simulated(id) })
    }

    /// The next records; none at the end. Each is checked against its digest once more.
    ///
    /// # Errors
    /// [`StoreError::Broken`] where the journal has changed since the walk began, or an error of the system or
    /// of SQLite.
    pub fn next_page(&self, pages: &mut Pages) -> Result<Vec<StoredRecord>, StoreError> {
        while pages.parts.front().is_some_and(|part| part.next > part.last) {
            pages.parts.pop_front();
        }
        let Some(part) = pages.parts.front_mut() else { return Ok(Vec::new()) };
        let mut statement = self.connection.prepare_cached(&select_records(
            "WHERE run = (SELECT key FROM runs WHERE id = ?1) AND seq BETWEEN ?2 AND ?3 ORDER BY seq",
        ))?;
        let wanted =
            params![part.run.to_string(), part.next.cast_signed(), part.last.cast_signed()];
        let mut rows = statement.query(wanted)?;
        let (mut records, mut bytes) = (Vec::new(), 0);
        while bytes < PAGE_BYTES && records.len() < PAGE_RECORDS && part.next <= part.last {
            let broken = |flaw| StoreError::Broken { run: part.run, seq: part.next, flaw };
            let Some(row) = rows.next()? else { return Err(broken(Flaw::Missing)) };
            let record = record_from(row)?;
            if !record.follows(part.next, &part.digest) {
                return Err(broken(Flaw::Altered));
            }
            bytes += record.payload.len();
            (part.next, part.digest) = (part.next + 1, record.digest);
            records.push(record);
        }
        Ok(records)
    }

    /// Follows the chain of a run, within one view, and keeps its records. Of one that is archived, the readings
    /// have their digests only.
    pub(super) fn walk(&self, id: RunId, archived: Option<&Archived>) -> Result<Chain, StoreError> {
        let mut records = Vec::new();
        let (check, _) = self.follow(id, archived, &mut |record| records.push(record))?;
        Ok(Chain { records, check })
    }

    /// Gives each record of a run up to the first flaw; the flaw, and the epochs of the records in order.
    pub(super) fn follow(
        &self,
        id: RunId,
        archived: Option<&Archived>,
        take: &mut dyn FnMut(StoredRecord),
    ) -> Result<(ChainCheck, Vec<u64>), StoreError> {
        let run = self.run(id)?;
        let mut statement = self.connection.prepare_cached(&select_records(
            "WHERE run = (SELECT key FROM runs WHERE id = ?1) ORDER BY seq",
        ))?;
        let mut rows = statement.query([id.to_string()])?;
        let mut followed = Followed::default();
        let mut check = loop {
            let seq = followed.records + 1;
            let broken = |flaw| ChainCheck::Broken { seq, flaw };
            match rows.next() {
                Ok(Some(row)) => match record_from(row) {
                    Ok(record) if record.seq > seq => break broken(Flaw::Missing),
                    Ok(record) if followed.is_next(&record, archived.is_some()) => {
                        followed.note(&record);
                        take(record);
                    }
                    _ => break broken(Flaw::Altered),
                },
                Ok(None) => break followed.end(run.status),
                Err(error) => break broken(Flaw::Unreadable { reason: error.to_string() }),
            }
        };
        if let ChainCheck::Intact { records: seq, .. } = check
            && let Some(flaw) = self.flaw_of_entry(&run, &followed)?
        {
            check = ChainCheck::Broken { seq, flaw };
        }
        if let ChainCheck::Intact { records: seq, digest } = check
            && let Some(note) = archived
            && !self.is_note_right(note, seq, digest)?
        {
            check = ChainCheck::Broken { seq, flaw: Flaw::NoteDiffers };
        }
        Ok((check, followed.epochs))
    }
}

impl Default for Followed {
    fn default() -> Self {
        Self { records: 0, digest: Digest::START, epochs: Vec::new(), end: None, given_up: None }
    }
}

impl Followed {
    /// Whether a record is the one behind those that were followed.
    fn is_next(&self, record: &StoredRecord, is_archived: bool) -> bool {
        let seq = self.records + 1;
        if is_archived && record.seq == seq && is_taken_out(record) {
            return true;
        }
        let is_same_epoch = self.epochs.last().is_none_or(|last| record.epoch == *last);
        record.follows(seq, &self.digest) && (is_same_epoch || record.opens_epoch())
    }

    fn note(&mut self, record: &StoredRecord) {
        self.records = record.seq;
        self.digest = record.digest;
        if self.epochs.last() != Some(&record.epoch) {
            self.epochs.push(record.epoch);
        }
        if record.kind == GIVEN_UP {
            self.given_up = Some(record.seq);
        }
        let is_end = record.kind == RUN_FINISHED;
        self.end = match is_end.then(|| record.record()) {
            Some(Ok(Record::RunFinished(finished))) => Some(finished.status),
            _ => None,
        };
    }

    /// Whether the record before the last one gave the run up.
    pub(super) fn is_given_up(&self) -> bool {
        self.given_up.is_some_and(|seq| seq + 1 == self.records)
    }

    /// An ended run has a last record with its end, and the list of runs has the same end.
    fn end(&self, status: RunStatus) -> ChainCheck {
        let (records, digest) = (self.records, self.digest);
        match (self.end, status) {
            (None, RunStatus::Running | RunStatus::Interrupted) => {
                ChainCheck::Intact { records, digest }
            }
            (Some(end), RunStatus::Ended(ending)) if end == ending => {
                ChainCheck::Intact { records, digest }
            }
            (None, RunStatus::Ended(_)) => {
                ChainCheck::Broken { seq: records + 1, flaw: Flaw::Missing }
            }
            (Some(_), _) => ChainCheck::Broken { seq: records, flaw: Flaw::EndDiffers },
        }
    }
}
