//! Forges the journal of a run: changes records and, if asked for, all digests, so that only the
//! meaning is wrong.

use std::path::Path;

use rig_verify::Verdict;
use rusqlite::{Connection, params};
use serde_json::Value;
use sha2::{Digest as _, Sha256};
use tempfile::TempDir;

/// A record that can be changed.
#[derive(Debug, Clone)]
pub struct Forged {
    /// Time on the rig's clock, µs.
    pub rig_us: i64,
    /// The kind in the table.
    pub kind: String,
    /// The content.
    pub payload: Value,
}

/// A copy of a journal with one run that can be forged.
#[derive(Debug)]
pub struct Forgery {
    directory: TempDir,
    /// The database.
    pub connection: Connection,
    run: String,
    key: i64,
    epoch: i64,
    /// The records of the run, in order.
    pub records: Vec<Forged>,
}

/// A part of the input of a digest.
enum Part<'a> {
    Bytes(&'a [u8]),
    Number(i64),
    Text(&'a str),
}

fn digest(parts: &[Part<'_>]) -> Vec<u8> {
    let mut hash = Sha256::new();
    for part in parts {
        match part {
            Part::Bytes(bytes) => hash.update(bytes),
            Part::Number(number) => hash.update(number.to_be_bytes()),
            Part::Text(text) => {
                hash.update((text.len() as u64).to_be_bytes());
                hash.update(text);
            }
        }
    }
    hash.finalize().to_vec()
}

impl Forgery {
    /// A copy of the journal in `data` with its run `run`, which has one epoch.
    ///
    /// # Panics
    /// When the journal cannot be copied.
    pub fn of(data: &Path, run: &str) -> Self {
        let directory = TempDir::new().expect("a temporary directory");
        let copy = directory.path().join("rigd.db");
        let source = Connection::open(data.join("rigd.db")).expect("a journal");
        source.execute("VACUUM INTO ?1", [copy.to_string_lossy()]).expect("a copy");
        let connection = Connection::open(copy).expect("the copy");
        connection.pragma_update(None, "foreign_keys", false).expect("a pragma");
        connection.pragma_update(None, "synchronous", "OFF").expect("a pragma");
        let (key, epoch) = connection
            .query_row("SELECT key, epoch FROM runs WHERE id = ?1", [run], |row| {
                Ok((row.get(0)?, row.get(1)?))
            })
            .expect("the run");
        let records = connection
            .prepare("SELECT rig_us, kind, payload FROM records WHERE run = ?1 ORDER BY seq")
            .and_then(|mut statement| {
                let forged = |row: &rusqlite::Row<'_>| {
                    let payload: String = row.get(2)?;
                    let payload = serde_json::from_str(&payload).expect("JSON");
                    Ok(Forged { rig_us: row.get(0)?, kind: row.get(1)?, payload })
                };
                statement.query_map([key], forged)?.collect()
            })
            .expect("records");
        Self { directory, connection, run: run.to_owned(), key, epoch, records }
    }

    /// The place of the `n`-th record of a kind, from 0, for which `is_wanted` holds.
    ///
    /// # Panics
    /// When there are fewer.
    pub fn nth(&self, kind: &str, n: usize, is_wanted: impl Fn(&Value) -> bool) -> usize {
        let is_one =
            |(_, record): &(usize, &Forged)| record.kind == kind && is_wanted(&record.payload);
        let found = self.records.iter().enumerate().filter(is_one).nth(n);
        found.unwrap_or_else(|| panic!("there is no {kind} {n}")).0
    }

    /// Writes the records back. With `is_rechained`, numbers, digests and the seal are made again;
    /// otherwise only the content is changed, and the number of records must be the same.
    ///
    /// # Panics
    /// When the database refuses.
    pub fn write(&mut self, is_rechained: bool) {
        self.connection.execute_batch("BEGIN").expect("a transaction");
        if is_rechained {
            self.rechain();
        } else {
            self.overwrite();
        }
        self.connection.execute_batch("COMMIT").expect("a transaction");
    }

    fn overwrite(&self) {
        for (seq, record) in (1_i64..).zip(&self.records) {
            let values =
                params![self.key, seq, record.rig_us, record.kind, record.payload.to_string()];
            let sql = "UPDATE records SET rig_us = ?3, kind = ?4, payload = ?5
                       WHERE run = ?1 AND seq = ?2";
            self.connection.execute(sql, values).expect("an update");
        }
    }

    fn rechain(&mut self) {
        let Self { connection, key, epoch, records, .. } = self;
        let execute = |sql: &str, id: i64| connection.execute(sql, params![*key, id]).expect("SQL");
        let first: i64 = connection
            .query_row("SELECT min(id) FROM records WHERE run = ?1", [*key], |row| row.get(0))
            .expect("records");
        execute("DELETE FROM records WHERE run = ?1 AND id >= ?2", first);
        execute("UPDATE records SET id = id + 1000000 WHERE ?1 > 0 AND id >= ?2", first);
        let mut head = vec![0; 32];
        for (seq, record) in (1_i64..).zip(records.iter()) {
            let payload = record.payload.to_string();
            head = digest(&[
                Part::Bytes(&head),
                Part::Number(seq),
                Part::Number(record.rig_us),
                Part::Text(&record.kind),
                Part::Text(&payload),
            ]);
            let sql = "INSERT INTO records (id, run, seq, epoch, rig_us, kind, payload, digest)
                       VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)";
            let id = first + seq - 1;
            let values = params![id, *key, seq, *epoch, record.rig_us, record.kind, payload, head];
            connection.execute(sql, values).expect("an insert");
        }
        self.seal(&head);
    }

    /// Makes the seal again, for the status in the list of runs.
    fn seal(&self, head: &[u8]) {
        let texts: Vec<String> = self
            .connection
            .query_row(
                "SELECT bench, journal, runs.id, kind, name, runs.started_at, finished_at, status,
                        stretches.started_at FROM runs JOIN stretches ON run = key WHERE key = ?1",
                [self.key],
                |row| (0..9).map(|column| row.get(column)).collect(),
            )
            .expect("the run");
        let (format, began_us): (i64, i64) = self
            .connection
            .query_row(
                "SELECT format, rig_us FROM runs JOIN stretches ON run = key WHERE key = ?1",
                [self.key],
                |row| Ok((row.get(0)?, row.get(1)?)),
            )
            .expect("the run");
        let count = i64::try_from(self.records.len()).expect("a small number");
        let text = |index: usize| Part::Text(&texts[index]);
        let seal = digest(&[
            text(0),
            text(1),
            text(2),
            text(3),
            text(4),
            Part::Number(format),
            Part::Number(self.epoch),
            text(5),
            Part::Number(self.epoch),
            text(8),
            Part::Number(began_us),
            text(6),
            text(7),
            Part::Number(count),
            Part::Bytes(head),
        ]);
        self.connection
            .execute(
                "UPDATE seals SET records = ?2, head = ?3, seal = ?4 WHERE run = ?1",
                params![self.key, count, head, seal],
            )
            .expect("a seal");
    }

    /// Changes the database itself. `?1` is the key of the run.
    ///
    /// # Panics
    /// When the database refuses.
    pub fn execute(&self, sql: &str) {
        let changed =
            self.connection.execute(sql, [self.key]).unwrap_or_else(|e| panic!("{sql}: {e}"));
        assert!(changed > 0, "{sql} changes nothing");
    }

    /// The verdict of the checker.
    ///
    /// # Panics
    /// When the journal cannot be opened.
    pub fn verdict(&self) -> Verdict {
        rig_verify::verify(self.directory.path(), &self.run).expect("a journal")
    }
}
