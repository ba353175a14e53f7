//! Copies out of a damaged journal what verifies.

mod list;

use std::{collections::BTreeMap, fs, path::Path};

use rig_record::{ListEntry, Stretch, seal};
use rig_system::files::{sync_file, sync_folder};
use rusqlite::{Connection, OptionalExtension, params};

use crate::{
    Clearance, Digest, Ending, Fault, Flaw, PathAct, Record, RunId, RunKind, Store, StoreError,
    directory::{copy_all_beside, make_directory},
    journal::{ENTRY, entry_from, insert_entry, insert_stretch, stretches},
    lock::DirectoryLock,
    reader::{has_no_content, parsed},
    schema,
};
use list::List;

/// The folder in which the copy is made.
const STAGE: &str = ".salvage.part";

/// The copied part of a run, a session or an amendment.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SalvagedRun {
    /// Id of the run; empty if its entry in the list of runs and that in the index of the ids cannot be read.
    pub id: String,
    /// Name of the run; empty if its entry in the list of runs cannot be read.
    pub name: String,
    /// Its kind, as in the list of runs; empty if its entry there cannot be read.
    pub kind: String,
    /// Number of records copied, from the first on.
    pub records: u64,
    /// The damage; `None` for a complete copy.
    pub flaw: Option<Flaw>,
}

/// A copied record.
struct Copied {
    event: i64,
    epoch: i64,
    rig_us: i64,
    kind: String,
    payload: String,
    digest: [u8; 32],
}

/// Copies the intact part of the journal in `from` to a new journal in `to`: of each run the
/// records before the first flaw, and its end and its seal if it has no flaw. A run that lost its
/// end can be resumed from the copy. A run whose entry in the list cannot be read is named and not copied. `from`
/// is unchanged.
///
/// If records of the last start of a program are lost, what is left may show the probe clear although it was lowered since. The
/// copy then ends with a session that says that this is not known. The copy gets its name when it is whole, and with it
/// are those of the files and folders `beside` that are beside the journal.
///
/// # Errors
/// [`StoreError::NotEmpty`] if `to` has a journal already; [`StoreError::NoJournal`] or
/// [`StoreError::Damaged`] if the list of runs cannot be read at all; or an error of the system.
pub fn salvage(from: &Path, to: &Path, beside: &[&str]) -> Result<Vec<SalvagedRun>, StoreError> {
    let source = schema::database(from);
    if !source.exists() {
        return Err(StoreError::NoJournal);
    }
    let (old, _copy) = schema::open_to_salvage(&source)?;
    let list = List::read(&old)?;
    let lock = DirectoryLock::take(to)?;
    let target = schema::database(to);
    if target.exists() {
        return Err(StoreError::NotEmpty);
    }
    // A copy that was broken off is made again.
    let stage = to.join(STAGE);
    if stage.exists() {
        fs::remove_dir_all(&stage).map_err(PathAct::Remove.failed(&stage))?;
    }
    make_directory(&stage).map_err(PathAct::Place.failed(&stage))?;
    let built = schema::database(&stage);
    let new = schema::open_to_write(&built)?;
    new.pragma_update(None, "foreign_keys", false)?;
    new.execute_batch("BEGIN IMMEDIATE")?;
    copy_meta(&old, &new)?;
    let (mut salvaged, mut losses) = (Vec::new(), Losses::default());
    let counts = counts(&old);
    for key in 1..=list.last_key {
        match Found::read(&old, key, &list, counts.as_ref()) {
            Ok(run) => {
                let run = run.write(&new, &mut losses)?;
                salvaged.push(run);
            }
            Err(error) => {
                let lost = list.lost(key, &error);
                losses.has_lost_entry |= lost.is_some();
                salvaged.extend(lost);
            }
        }
    }
    // Records name their epoch, and the next opening must have a number of its own.
    new.execute(
        "INSERT OR IGNORE INTO epochs (n, opened_at, software)
         SELECT epoch, strftime('%Y-%m-%dT%H:%M:%fZ', 'now'), 'rigd salvage'
         FROM (SELECT epoch FROM records UNION SELECT epoch FROM stretches)",
        [],
    )?;
    new.execute_batch("COMMIT")?;
    new.close().map_err(|(_, error)| error)?;
    losses.tell(&stage)?;
    // A file beside it that cannot be read keeps no journal from being rescued: it is told afterwards.
    let has_all_beside = copy_all_beside(from, to, beside);
    sync_file(&built).map_err(PathAct::Place.failed(to))?;
    fs::rename(&built, &target).map_err(PathAct::Place.failed(to))?;
    sync_folder(to).map_err(PathAct::Place.failed(to))?;
    fs::remove_dir_all(&stage).map_err(PathAct::Remove.failed(&stage))?;
    drop(lock);
    has_all_beside.map(|()| salvaged)
}

/// What the copy has not of what was written.
#[derive(Default)]
struct Losses {
    /// The last epoch of each run that lost records.
    epochs: Vec<u64>,
    has_lost_entry: bool,
    /// Name and epoch of the last session.
    session: Option<(String, u64)>,
}

impl Losses {
    /// Takes in a run, in the order of the list.
    fn add(&mut self, found: &Found) {
        let later = found.stretches.iter().map(|stretch| stretch.epoch);
        let epoch = later.fold(found.entry.epoch, u64::max);
        let cut =
            |flaw: &Flaw| matches!(flaw, Flaw::Missing | Flaw::Altered | Flaw::Unreadable { .. });
        if found.flaw.as_ref().is_some_and(cut) {
            self.epochs.push(epoch);
        }
        if found.entry.kind == RunKind::Session.name() {
            self.session = Some((found.entry.name.clone(), epoch));
        }
    }

    /// Adds a session to the copy if what it shows of the probe may be out of date.
    fn tell(self, to: &Path) -> Result<(), StoreError> {
        let Some((rig, last)) = self.session.or_else(|| {
            // It may have been that of the only session. A real rig looks at what was left under other names too.
            self.has_lost_entry.then(|| ("unknown".to_owned(), 0))
        }) else {
            return Ok(());
        };
        if !self.has_lost_entry && self.epochs.iter().all(|epoch| *epoch < last) {
            return Ok(());
        }
        let mut session = Store::open(to)?.begin(RunKind::Session, &rig)?;
        let lost = Fault {
            step: None,
            cause: "records are lost, and where the probe was at last is not known".to_owned(),
            probe: Clearance::Unknown,
            hint: "check by eye where the probe is".to_owned(),
            last_moves_mm: None,
        };
        session.append(0, &Record::Fault(lost))?;
        session.commit()
    }
}

/// The number of records of each run in the table, which its index may not show; `None` if the table is damaged.
fn counts(old: &Connection) -> Option<BTreeMap<i64, usize>> {
    let mut statement =
        old.prepare("SELECT run, count(*) FROM records NOT INDEXED GROUP BY run").ok()?;
    let counts = statement.query_map([], |row| Ok((row.get(0)?, row.get::<_, i64>(1)?))).ok()?;
    let count = |row: rusqlite::Result<(i64, i64)>| {
        let (run, count) = row.ok()?;
        Some((run, usize::try_from(count).ok()?))
    };
    counts.map(count).collect()
}

/// A row of the epochs.
type Epoch = (i64, String, Option<String>, String, Option<i64>);

/// The bench stays the same, and the epochs keep their numbers. One that cannot be read is left out here.
fn copy_meta(old: &Connection, new: &Connection) -> Result<(), StoreError> {
    let bench = old.query_row("SELECT bench FROM meta", [], |row| row.get::<_, String>(0));
    if let Ok(bench) = bench {
        new.execute("UPDATE meta SET bench = ?1", [bench])?;
    }
    let mut epochs =
        old.prepare("SELECT n, opened_at, boot_id, software, is_clock_synced FROM epochs")?;
    let mut rows = epochs.query([])?;
    while let Ok(Some(row)) = rows.next() {
        let epoch = || -> rusqlite::Result<Epoch> {
            Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?, row.get(4)?))
        };
        if let Ok(epoch) = epoch() {
            new.execute("INSERT OR IGNORE INTO epochs VALUES (?1, ?2, ?3, ?4, ?5)", epoch)?;
        }
    }
    Ok(())
}

/// A run as far as it can be read.
struct Found {
    entry: ListEntry,
    is_entry_right: bool,
    finished_at: Option<String>,
    status: String,
    stretches: Vec<Stretch>,
    seal: Option<[u8; 32]>,
    records: Vec<Copied>,
    head: Digest,
    flaw: Option<Flaw>,
}

impl Found {
    fn read(
        old: &Connection,
        key: i64,
        list: &List,
        counts: Option<&BTreeMap<i64, usize>>,
    ) -> rusqlite::Result<Self> {
        let (entry, finished_at, status, digest) = old.query_row(
            &format!("SELECT {ENTRY}, finished_at, status, digest FROM runs WHERE key = ?1"),
            [key],
            |row| {
                // The list of the copy must be readable.
                parsed(row, 2, |id| id.parse::<RunId>().ok())?;
                parsed(row, 3, RunKind::from_name)?;
                Ok((entry_from(row)?, row.get(8)?, row.get(9)?, row.get::<_, Vec<u8>>(10)?))
            },
        )?;
        let is_archived = list.is_archived(&entry.run);
        let read = |order| read_records(old, key, is_archived, order);
        let (mut records, mut head, mut flaw) = read(BY_NUMBER);
        let is_short = counts
            .is_some_and(|counts| counts.get(&key).is_some_and(|count| *count != records.len()));
        if flaw.is_some() || is_short {
            let (more, head_of_more, flaw_of_more) = read(AS_WRITTEN);
            if more.len() > records.len() {
                (records, head, flaw) = (more, head_of_more, flaw_of_more);
            }
        }
        let seal = old
            .query_row("SELECT seal FROM seals WHERE run = ?1", [key], |row| row.get(0))
            .optional()
            .unwrap_or_default();
        let is_entry_right = entry.digest().as_bytes() == &*digest;
        let stretches = stretches(old, key).unwrap_or_default();
        Ok(Self {
            entry,
            is_entry_right,
            finished_at,
            status,
            stretches,
            seal,
            records,
            head,
            flaw,
        })
    }

    fn write(mut self, new: &Connection, losses: &mut Losses) -> Result<SalvagedRun, StoreError> {
        let count = self.records.len() as u64;
        let seal_of = |found: &Self, stretches: &[Stretch]| {
            let at = found.finished_at.as_deref().unwrap_or(&found.entry.started_at);
            seal(&found.entry, stretches, at, &found.status, count, found.head)
        };
        let end = self.end();
        // Without its end it is a run that was interrupted.
        let status = end.map_or("running", Ending::name);
        let is_final = end.is_some_and(|end| self.must_be_sealed(end));
        let is_sealed =
            self.seal.is_some_and(|found| seal_of(&self, &self.stretches).as_bytes() == &found);
        let flaw = if !self.is_entry_right {
            Some(Flaw::ListDiffers)
        } else if status != self.status {
            Some(if end.is_some() { Flaw::EndDiffers } else { Flaw::Missing })
        } else {
            (!is_sealed && (is_final || self.seal.is_some())).then_some(Flaw::SealDiffers)
        };
        self.flaw = self.flaw.or(flaw);
        losses.add(&self);
        if self.flaw.is_some() {
            // Its entry in the list is incomplete, so that the new journal confirms it.
            self.entry.journal = new.query_row("SELECT journal FROM meta", [], |row| row.get(0))?;
        }
        status.clone_into(&mut self.status);
        let key = insert_entry(new, &self.entry)?;
        self.write_stretches(new, key)?;
        for (record, seq) in self.records.iter().zip(1_i64..) {
            record.write(new, key, seq)?;
        }
        let at = self.finished_at.as_deref().unwrap_or(&self.entry.started_at);
        new.execute(
            "UPDATE runs SET status = ?2, finished_at = ?3 WHERE key = ?1",
            params![key, self.status, at],
        )?;
        if is_final || is_sealed {
            let seal = seal_of(&self, &stretches(new, key)?);
            new.execute(
                "INSERT INTO seals (run, records, head, seal) VALUES (?1, ?2, ?3, ?4)",
                params![key, count.cast_signed(), self.head.as_bytes(), seal.as_bytes()],
            )?;
        }
        let ListEntry { run: id, name, kind, .. } = self.entry;
        Ok(SalvagedRun { id, name, kind, records: count, flaw: self.flaw })
    }

    /// The stretches that fit, and new ones where they are missing: the times are then those of the
    /// beginning of the run.
    fn write_stretches(&self, new: &Connection, key: i64) -> Result<(), StoreError> {
        let mut epochs: Vec<i64> = self.records.iter().map(|record| record.epoch).collect();
        epochs.dedup();
        for epoch in epochs {
            let epoch_number = epoch.cast_unsigned();
            let known = self.stretches.iter().find(|stretch| stretch.epoch == epoch_number);
            let first = self.records.iter().find(|record| record.epoch == epoch);
            let stretch = known.cloned().unwrap_or_else(|| Stretch {
                epoch: epoch_number,
                started_at: self.entry.started_at.clone(),
                rig_us: first.map_or(0, |first| first.rig_us.cast_unsigned()),
            });
            insert_stretch(new, key, &self.entry.run, &stretch)?;
        }
        Ok(())
    }

    /// The end that the last record tells.
    fn end(&self) -> Option<Ending> {
        match serde_json::from_str(&self.records.last()?.payload) {
            Ok(Record::RunFinished(end)) => Some(end.status),
            _ => None,
        }
    }

    /// Whether a run with this end has a seal.
    fn must_be_sealed(&self, end: Ending) -> bool {
        let before = self.records.len().checked_sub(2).map(|before| &self.records[before].kind);
        let is_given_up = before.is_some_and(|kind| kind == "given_up");
        self.entry.kind != RunKind::Run.name() || end.is_complete() || is_given_up
    }
}

impl Copied {
    /// Whether it may be the first one of another epoch.
    fn opens_epoch(&self) -> bool {
        match serde_json::from_str(&self.payload) {
            Ok(Record::Resumed(resumed)) => resumed.epoch == self.epoch.cast_unsigned(),
            Ok(Record::GivenUp(given_up)) => given_up.epoch == self.epoch.cast_unsigned(),
            _ => false,
        }
    }

    fn write(&self, new: &Connection, run: i64, seq: i64) -> Result<(), StoreError> {
        let Self { event, epoch, rig_us, kind, payload, digest } = self;
        new.prepare_cached(
            "INSERT INTO records (id, run, seq, epoch, rig_us, kind, payload, digest)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)",
        )?
        .execute(params![event, run, seq, epoch, rig_us, kind, payload, digest])?;
        Ok(())
    }
}

/// The records of a run by the index of their numbers.
const BY_NUMBER: &str = "records WHERE run = ?1 ORDER BY seq";

/// The records of a run in the order in which they were written, without the index: its pages may be lost, and those of
/// the records not.
const AS_WRITTEN: &str = "records NOT INDEXED WHERE run = ?1 ORDER BY id";

/// The records before the first flaw, the digest of the last one, and the flaw. Of an archived run, the
/// readings have their digests only. If it is not known whether the run is archived, the first of them is a flaw.
fn read_records(
    old: &Connection,
    key: i64,
    is_archived: Result<bool, &str>,
    order: &str,
) -> (Vec<Copied>, Digest, Option<Flaw>) {
    let (mut records, mut head) = (Vec::new(), Digest::START);
    let unreadable = |error: &rusqlite::Error| Flaw::Unreadable { reason: error.to_string() };
    let prepared = old.prepare_cached(&format!(
        "SELECT id, seq, epoch, rig_us, kind, payload, digest FROM {order}"
    ));
    let mut statement = match prepared {
        Ok(statement) => statement,
        Err(error) => return (records, head, Some(unreadable(&error))),
    };
    let mut rows = match statement.query([key]) {
        Ok(rows) => rows,
        Err(error) => return (records, head, Some(unreadable(&error))),
    };
    loop {
        let row = match rows.next() {
            Ok(Some(row)) => row,
            Ok(None) => return (records, head, None),
            Err(error) => return (records, head, Some(unreadable(&error))),
        };
        let read = || -> rusqlite::Result<(i64, Copied)> {
            let (event, seq, epoch) = (row.get(0)?, row.get(1)?, row.get(2)?);
            let (rig_us, kind, payload) = (row.get(3)?, row.get(4)?, row.get(5)?);
            Ok((seq, Copied { event, epoch, rig_us, kind, payload, digest: row.get(6)? }))
        };
        let Ok((seq, record)) = read() else {
            return (records, head, Some(Flaw::Altered));
        };
        let expected = records.len() as u64 + 1;
        if seq.cast_unsigned() > expected {
            return (records, head, Some(Flaw::Missing));
        }
        let rig_us = record.rig_us.cast_unsigned();
        let next = match is_archived {
            Ok(true) if has_no_content(&record.kind, &record.payload) => {
                Digest::from_bytes(record.digest)
            }
            Err(damage) if has_no_content(&record.kind, &record.payload) => {
                let reason = format!("the note of its archive may be {damage}");
                return (records, head, Some(Flaw::Unreadable { reason }));
            }
            _ => head.next(expected, rig_us, &record.kind, &record.payload),
        };
        let epoch = records.last().map_or(record.epoch, |last: &Copied| last.epoch);
        let is_epoch_right = record.epoch == epoch || record.opens_epoch();
        let is_content_right = next.as_bytes() == &record.digest;
        if seq.cast_unsigned() != expected || !is_content_right || !is_epoch_right {
            return (records, head, Some(Flaw::Altered));
        }
        head = next;
        records.push(record);
    }
}
