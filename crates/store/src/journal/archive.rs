//! Takes the readings of an archived run out of the journal.

use rusqlite::{Row, params};

use super::{Store, Writer, locked};
use crate::{Archived, Ending, Record, RunFinished, RunId, RunKind, StoreError};

impl Store {
    /// Takes the readings of a sealed run and of its amendments out of the journal, and notes for each of
    /// them that they are in `place`. All of it is on disk when this returns, or nothing is.
    ///
    /// The records stay, with their digests; those of [`Record::ARCHIVED_KINDS`] lose their content. The
    /// caller has verified the copy in `place`. A run that is archived already is left as it is.
    ///
    /// # Errors
    /// [`StoreError::NotSealed`]; [`StoreError::UnderWay`] for one with an amendment that has not ended;
    /// [`StoreError::Broken`] when its records are damaged; or an error of the system or of SQLite.
    pub fn archive(&self, id: RunId, place: &str, who: &str) -> Result<(), StoreError> {
        let reader = self.reader()?;
        let run = reader.run(id)?;
        if !run.is_sealed {
            let status = run.status.describe();
            return Err(StoreError::NotSealed { run: run.to_string(), status });
        }
        let id_text = id.to_string();
        let is_its_own = |other: &crate::Run| {
            other.id == id || other.kind == RunKind::Amendment && other.name == id_text
        };
        // Everything is checked before the first change: a refusal leaves nothing behind that another run commits.
        let mut notes = Vec::new();
        for part in reader.every_run()?.into_iter().filter(is_its_own) {
            if !part.is_sealed {
                return Err(StoreError::UnderWay { run: part.to_string() });
            }
            if reader.archive_of(part.id)?.is_some() {
                continue;
            }
            let records = reader.records(part.id)?;
            let Some(last) = records.last() else { continue };
            let note = Archived {
                run: part.id.to_string(),
                records: last.seq,
                head: last.digest.to_string(),
                place: place.to_owned(),
                who: who.to_owned(),
            };
            notes.push((part.id, note));
        }
        for (part, note) in notes {
            let mut journal = self.begin(RunKind::Archive, &part.to_string())?;
            journal.append(0, &Record::Archived(note))?;
            journal.append(0, &Record::RunFinished(RunFinished { status: Ending::Completed }))?;
            locked(&self.writer, |writer| writer.take_out(part))?;
        }
        locked(&self.writer, Writer::commit)
    }
}

impl Writer {
    /// Takes the content out of the readings of a run.
    ///
    /// They are removed and added again without it: SQLite makes pages free when rows are removed, and not
    /// when they become shorter.
    fn take_out(&self, run: RunId) -> Result<(), StoreError> {
        struct Kept {
            id: i64,
            run: i64,
            seq: i64,
            epoch: i64,
            rig_us: i64,
            kind: String,
            digest: [u8; 32],
        }
        let mut remove = self.connection.prepare_cached(&format!(
            "DELETE FROM records
             WHERE run = (SELECT key FROM runs WHERE id = ?1) AND kind IN ({})
             RETURNING id, run, seq, epoch, rig_us, kind, digest",
            quoted(&Record::ARCHIVED_KINDS)
        ))?;
        let of_row = |row: &Row<'_>| {
            Ok(Kept {
                id: row.get(0)?,
                run: row.get(1)?,
                seq: row.get(2)?,
                epoch: row.get(3)?,
                rig_us: row.get(4)?,
                kind: row.get(5)?,
                digest: row.get(6)?,
            })
        };
        let removed =
            remove.query_map([run.to_string()], of_row)?.collect::<Result<Vec<_>, _>>()?;
        let mut add = self.connection.prepare_cached(
            "INSERT INTO records (id, run, seq, epoch, rig_us, kind, payload, digest)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, '', ?7)",
        )?;
        for Kept { id, run, seq, epoch, rig_us, kind, digest } in removed {
            add.execute(params![id, run, seq, epoch, rig_us, kind, digest])?;
        }
        Ok(())
    }
}

/// Words as a list of SQL.
pub(crate) fn quoted(words: &[&str]) -> String {
    words.iter().map(|word| format!("'{word}'")).collect::<Vec<_>>().join(", ")
}
