//! What is read of a journal in which a session has lasted for months.

use rusqlite::{Connection, params};

use super::{
    ENTRIES, SESSIONS,
    amendments::{AMENDED, DONE_ELSEWHERE, HEAD, SEAMS_BEFORE},
    before::{BEGINS, LAST_MOVE, SINCE, before},
};

/// The columns of `docs/data.md` that the statements use.
const TABLES: &str = "
    CREATE TABLE runs (key INTEGER PRIMARY KEY, id TEXT, kind TEXT, name TEXT, status TEXT, epoch INTEGER);
    CREATE TABLE stretches (run INTEGER, epoch INTEGER, PRIMARY KEY (run, epoch));
    CREATE TABLE records (
        id INTEGER PRIMARY KEY, run INTEGER, seq INTEGER, epoch INTEGER, rig_us INTEGER, kind TEXT, payload TEXT,
        digest BLOB, UNIQUE (run, seq));";

const LINEAR: &str =
    r#"{"kind":"moved","axis":"linear_mm","target":24.5,"read_back":24.5,"is_clear":true}"#;
const ROTARY: &str = r#"{"kind":"moved","axis":"rotary_deg","target":0.0,"read_back":0.0}"#;

/// A session with these runs, each a status and the moves that it has made. The key of the session is 1.
fn session(runs: &[(&str, &[&str])]) -> Connection {
    let connection = Connection::open_in_memory().unwrap();
    connection.execute_batch(TABLES).unwrap();
    let open = |key: i64, kind: &str, status: &str, payloads: &[&str]| {
        let run = "INSERT INTO runs VALUES (?1, ?1, ?2, ?2, ?3, 1)";
        connection.execute(run, params![key, kind, status]).unwrap();
        for (seq, payload) in (1_i64..).zip(payloads) {
            let record = "INSERT INTO records (run, seq, epoch, rig_us, kind, payload, digest)
                VALUES (?1, ?2, 1, 0, 'moved', ?3, x'')";
            connection.execute(record, params![key, seq, payload]).unwrap();
        }
    };
    open(1, "session", "running", &[LINEAR, ROTARY]);
    for (key, (status, payloads)) in (2_i64..).zip(runs) {
        open(key, "run", status, payloads);
    }
    connection
}

/// The run and the number of each record that is read before this run.
fn read_before(connection: &Connection, run: i64) -> Vec<(i64, u64)> {
    let mut read = Vec::new();
    before(connection, run, |entry| read.push((entry.key, entry.seq))).unwrap();
    read
}

#[test]
fn what_came_before_the_last_completed_run_is_not_read() {
    let connection = session(&[
        ("completed", &[LINEAR, ROTARY, LINEAR]),
        ("completed_with_refusals", &[LINEAR, LINEAR]),
        ("faulted", &[LINEAR]),
        ("running", &[LINEAR]),
    ]);
    // The beginning of the session, the last turn and the last move of the stage; the completed run and the one that failed.
    assert_eq!(read_before(&connection, 5), [(1, 1), (2, 2), (2, 3), (3, 1), (3, 2), (4, 1)]);
    assert_eq!(read_before(&connection, 3), [(1, 1), (1, 2), (2, 1), (2, 2), (2, 3)]);
    assert_eq!(read_before(&connection, 2), [(1, 1), (1, 2)]);
    assert_eq!(read_before(&connection, 1), []);
}

#[test]
fn no_statement_walks_through_all_records() {
    let connection = session(&[]);
    for sql in
        [SESSIONS, AMENDED, DONE_ELSEWHERE, HEAD, SEAMS_BEFORE, ENTRIES, BEGINS, LAST_MOVE, SINCE]
    {
        let mut plan = connection.prepare(&format!("EXPLAIN QUERY PLAN {sql}")).unwrap();
        let values = (1..=plan.parameter_count()).map(|_| 1);
        let rows =
            plan.query_map(rusqlite::params_from_iter(values), |row| row.get::<_, String>(3));
        let steps = rows.unwrap().map(Result::unwrap).collect::<Vec<_>>();
        assert!(!steps.iter().any(|step| step.starts_with("SCAN records")), "{sql}: {steps:?}");
    }
}
