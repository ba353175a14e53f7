//! A run as documents of the event model of bluesky, one JSON object a line: `name` and `doc`.
//!
//! The stream `primary` has one event for each touch that has an outcome, `sweeps` one for each sweep
//! with its readings as arrays. A missing value is null.
//!
//! # Source
//! event-model 1.24, `src/schemas` of <https://github.com/bluesky/event-model>.

use std::io::Write;

use rig_record::{Ending, RunStatus, StoredRecord, Sweep};
use serde_json::{Map, Value, json};

use super::{
    ExportError,
    column::{Column, ColumnKind, READING, TableName},
    records::{self, Ends},
    table::TableValue,
    touches,
};
use crate::{
    results::{RunResults, status::TouchStatus},
    units::unix_ms,
};

/// The documents of a run: start, descriptors and events of both streams, and stop if it has ended.
/// `records` are those of the run with those of its amendments behind them.
///
/// # Errors
/// Errors of the writer, or a record that cannot be understood.
pub fn documents(
    results: &RunResults,
    records: &[StoredRecord],
    out: &mut impl Write,
) -> Result<(), ExportError> {
    let run_uid = results.run.id.to_string();
    let began_s = seconds(Some(&results.run.started_at)).unwrap_or_default();
    line(out, "start", &start(results, &run_uid, began_s))?;

    let arrays = READING.map(|column| array(&column));
    let scalars = TableName::Sweeps.columns();
    let mut sweeps = Stream::new("sweeps", &run_uid, began_s, &["resonance_hz"]);
    let keys = scalars.iter().map(scalar).chain(arrays).collect();
    line(out, "descriptor", &sweeps.descriptor(&keys))?;
    let ends = Ends::of(records);
    records::each_sweep(records, |stored, sweep| {
        let mut data = named(&scalars, &records::of_sweep(sweep, &ends, stored));
        data.extend(readings(sweep));
        let at_s = seconds(stored.at.as_deref()).unwrap_or(began_s);
        line(out, "event", &sweeps.event(at_s, &data))
    })?;

    let columns = TableName::Touches.columns();
    let mut primary = Stream::new("primary", &run_uid, began_s, &["stiffness_mpa", "shift_hz"]);
    line(out, "descriptor", &primary.descriptor(&columns.iter().map(scalar).collect()))?;
    let is_simulated = results.data.is_simulated();
    for row in results.touches.iter().filter(|row| row.status != TouchStatus::NotReached) {
        let at_s = seconds(row.started_at.as_deref()).unwrap_or(began_s);
        let data = named(&columns, &touches::touch(row, &run_uid, is_simulated));
        line(out, "event", &primary.event(at_s, &data))?;
    }

    let status = match results.run.status {
        RunStatus::Running => return Ok(()),
        RunStatus::Ended(Ending::Completed | Ending::CompletedWithRefusals) => "success",
        RunStatus::Ended(Ending::Aborted) => "abort",
        RunStatus::Interrupted | RunStatus::Ended(Ending::Faulted | Ending::Interrupted) => "fail",
    };
    let stop = json!({
        "uid": format!("{run_uid}/stop"),
        "run_start": run_uid,
        "time": seconds(results.run.finished_at.as_deref()).unwrap_or(began_s),
        "exit_status": status,
        "reason": results.data.fault.as_deref().unwrap_or_default(),
        "num_events": { "primary": primary.events, "sweeps": sweeps.events },
    });
    line(out, "stop", &stop)
}

fn start(results: &RunResults, uid: &str, began_s: f64) -> Value {
    let started = results.data.started.as_ref();
    let of = |value: Option<Value>| value.unwrap_or(Value::Null);
    json!({
        "uid": uid,
        "time": began_s,
        "scan_id": results.run.number,
        "plan_name": results.run.name,
        "hints": { "dimensions": [[["angle_deg"], "primary"]] },
        "run_name": results.run.short_name(),
        "is_simulated": results.data.is_simulated(),
        "software": of(started.map(|started| json!(started.software))),
        "seed": of(started.map(|started| json!(started.seed))),
        "samples": of(started.map(|started| json!(started.samples))),
        "devices": of(started.map(|started| json!(started.devices))),
        "calibrations": of(started.map(|started| json!(started.calibrations))),
        "protocol_toml": of(started.map(|started| json!(started.protocol.toml))),
        "rig_toml": of(started.map(|started| json!(started.rig.toml))),
    })
}

/// The events of one kind.
struct Stream<'a> {
    name: &'static str,
    run_uid: &'a str,
    began_s: f64,
    /// Keys worth a plot.
    hints: &'static [&'static str],
    events: u64,
}

impl<'a> Stream<'a> {
    const fn new(
        name: &'static str,
        run_uid: &'a str,
        began_s: f64,
        hints: &'static [&'static str],
    ) -> Self {
        Self { name, run_uid, began_s, hints, events: 0 }
    }

    fn uid(&self) -> String {
        format!("{}/{}", self.run_uid, self.name)
    }

    fn descriptor(&self, data_keys: &Map<String, Value>) -> Value {
        let keys: Vec<&String> = data_keys.keys().collect();
        json!({
            "uid": self.uid(),
            "run_start": self.run_uid,
            "time": self.began_s,
            "name": self.name,
            "object_keys": { "rigd": keys },
            "hints": { "rigd": { "fields": self.hints } },
            "configuration": {},
            "data_keys": data_keys,
        })
    }

    fn event(&mut self, at_s: f64, data: &Map<String, Value>) -> Value {
        self.events += 1;
        let timestamps: Map<_, _> = data.keys().map(|key| (key.clone(), at_s.into())).collect();
        json!({
            "uid": format!("{}/{}", self.uid(), self.events),
            "descriptor": self.uid(),
            "seq_num": self.events,
            "time": at_s,
            "data": data,
            "timestamps": timestamps,
            "filled": {},
        })
    }
}

fn line(out: &mut impl Write, name: &str, doc: &Value) -> Result<(), ExportError> {
    Ok(writeln!(out, "{}", json!({ "name": name, "doc": doc }))?)
}

/// The key of a column with one value in each event.
fn scalar(column: &Column) -> (String, Value) {
    key(column, dtype(column.kind), &json!([]))
}

/// The key of a column with one value for each reading in each event.
fn array(column: &Column) -> (String, Value) {
    let (name, mut key) = key(column, "array", &json!([null]));
    key["dtype_numpy"] = if column.kind == ColumnKind::Text { "<U10" } else { "<f8" }.into();
    (name, key)
}

fn key(column: &Column, dtype: &str, shape: &Value) -> (String, Value) {
    let Column { name, unit, description, .. } = *column;
    let mut key = json!({ "source": format!("rigd:{name}"), "dtype": dtype, "shape": shape });
    key["description"] = description.into();
    if !unit.is_empty() {
        key["units"] = unit.into();
    }
    (name.to_owned(), key)
}

const fn dtype(kind: ColumnKind) -> &'static str {
    match kind {
        ColumnKind::Text => "string",
        ColumnKind::Whole => "integer",
        ColumnKind::Number | ColumnKind::Time => "number",
        ColumnKind::Flag => "boolean",
    }
}

fn named(columns: &[Column], values: &[TableValue<'_>]) -> Map<String, Value> {
    columns
        .iter()
        .zip(values)
        .map(|(column, value)| (column.name.to_owned(), value.json()))
        .collect()
}

/// The columns of the readings of a sweep as arrays.
fn readings(sweep: &Sweep) -> impl Iterator<Item = (String, Value)> {
    let rows: Vec<_> = sweep.readings.iter().map(records::reading).collect();
    READING.into_iter().enumerate().map(move |(index, column)| {
        let values: Vec<Value> = rows.iter().map(|row| row[index].json()).collect();
        (column.name.to_owned(), values.into())
    })
}

/// A time, s since 1970.
fn seconds(text: Option<&str>) -> Option<f64> {
    Some(unix_ms(text?)? as f64 / 1e3)
}
