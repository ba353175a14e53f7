//! The work of statements in a journal of years.

use rusqlite::{Connection, Params, StatementStatus, params};

use super::{
    KEYED, KEYS, RUNS,
    interruption::{MOVED_AFTER, last_event, probe_records},
    select_records, select_runs,
};
use crate::{RunKind, schema::TABLES};

/// A journal with so many runs, each with an amendment.
fn journal(runs: i64) -> Connection {
    let connection = Connection::open_in_memory().unwrap();
    connection.execute_batch(TABLES).unwrap();
    connection.execute("INSERT INTO epochs VALUES (1, '', NULL, '', NULL)", []).unwrap();
    let mut add = connection
        .prepare(
            "INSERT INTO runs VALUES (NULL, ?1, ?2, ?3, '', '', 4, 1, '2026-11-26T00:00:00Z', x'', x'', NULL, 'completed')",
        )
        .unwrap();
    for number in 0..runs {
        let id = format!("run {number}");
        add.execute(params![id, "run", "smoke"]).unwrap();
        add.execute(params![format!("amendment {number}"), "amendment", id]).unwrap();
    }
    drop(add);
    connection
}

#[test]
fn a_list_of_ten_times_as_many_runs_takes_ten_times_as_many_steps() {
    let steps = |runs| {
        let connection = journal(runs);
        let mut list = connection.prepare(&select_runs(RUNS, "ORDER BY key DESC")).unwrap();
        let amended = list.query_map([], |row| row.get::<_, i64>(11)).unwrap();
        assert_eq!(amended.map(Result::unwrap).sum::<i64>(), runs);
        list.get_status(StatementStatus::VmStep)
    };
    let (few, many) = (steps(100), steps(1000));
    assert!(many < 15 * few, "{few} steps for 100 runs, {many} for 1000");
}

#[test]
fn a_key_is_looked_for_in_the_first_records_alone() {
    let connection = journal(1);
    let sql = format!("EXPLAIN QUERY PLAN {}", select_records(KEYED));
    let mut plan = connection.prepare(&sql).unwrap();
    let values = params!["key", "\"key\"", KEYS];
    let steps = plan.query_map(values, |row| row.get::<_, String>(3)).unwrap();
    let steps = steps.map(Result::unwrap).collect::<Vec<_>>();
    assert!(
        !steps
            .iter()
            .any(|step| step.starts_with("SCAN first") || step.starts_with("SCAN records")),
        "{steps:?}"
    );
}

#[test]
fn what_a_run_or_session_left_is_looked_for_by_an_index() {
    let connection = journal(1);
    for kind in [RunKind::Run, RunKind::Session] {
        check_plan(&connection, &probe_records(kind), params!["asked"]);
        check_plan(&connection, &last_event(kind), params!["asked"]);
    }
    check_plan(&connection, &select_records(MOVED_AFTER), params!["rig", 1]);
}

/// Checks that a statement looks for records by their event or their run.
#[track_caller]
fn check_plan(connection: &Connection, sql: &str, values: impl Params) {
    let mut plan = connection.prepare(&format!("EXPLAIN QUERY PLAN {sql}")).unwrap();
    let steps = plan.query_map(values, |row| row.get::<_, String>(3)).unwrap();
    let steps = steps.map(Result::unwrap).collect::<Vec<_>>();
    let is_scan = |step: &String| {
        ["records", "begun", "last"].iter().any(|table| step.starts_with(&format!("SCAN {table}")))
    };
    assert!(!steps.iter().any(is_scan), "{sql}: {steps:?}");
    let by_index = "SEARCH records USING ";
    assert!(steps.iter().any(|step| step.starts_with(by_index)), "{sql}: {steps:?}");
}

#[test]
fn the_keys_of_the_latest_runs_are_known_however_many_there_are() {
    let found = |runs: u32, key: &str| {
        let connection = journal(i64::from(runs));
        connection
            .execute_batch(
                "INSERT INTO records
                 SELECT NULL, key, 1, 1, 0, 'run_started', json_object('idempotency_key', id), x'' FROM runs
                 WHERE kind = 'run';
                 INSERT INTO stretches SELECT key, 1, '2026-11-26T00:00:00Z', 0, x'' FROM runs",
            )
            .unwrap();
        let mut keyed = connection.prepare(&select_records(KEYED)).unwrap();
        let in_json = format!("\"{key}\"");
        let is_known = keyed.exists(params![key, in_json, KEYS]).unwrap();
        (is_known, keyed.get_status(StatementStatus::VmStep))
    };
    assert!(found(KEYS, "run 0").0 && !found(KEYS + 1, "run 0").0);
    assert!(found(KEYS + 1, "run 1").0 && found(10 * KEYS, &format!("run {}", 10 * KEYS - 1)).0);
    let (few, many) = (found(KEYS, "other").1, found(10 * KEYS, "other").1);
    assert!(many < 2 * few, "{few} steps for {KEYS} runs, {many} for ten times as many");
}
