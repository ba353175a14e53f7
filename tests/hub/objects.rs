//! What the objects of a folder have, read from Parquet by statements of this program.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    path::{Path, PathBuf},
};

use parquet::{
    file::reader::{FileReader, SerializedFileReader},
    record::{Field, Row},
};
use serde_json::Value;

/// Every object of a folder as lines: entry, stretches, records and end of its run, each byte of them. An object without a
/// receipt is none yet.
pub(crate) fn contents(store: &Path) -> BTreeMap<String, Vec<String>> {
    let mut contents = BTreeMap::new();
    for path in files(store) {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let is_object = name.ends_with(".parquet") && !name.starts_with('.');
        let receipt = format!("_{}", name.replace(".parquet", ".seal.json"));
        if !is_object || !path.with_file_name(receipt).exists() {
            continue;
        }
        let (run, lines) = lines(&path);
        let verdict = rig_verify::verify_object(fs::read(&path).unwrap().into(), None).unwrap();
        assert!(verdict.is_sound, "{name}: {}", verdict.sentence());
        let before = contents.insert(run, lines);
        assert!(before.is_none(), "{name}: a second object of one run");
    }
    contents
}

fn lines(path: &Path) -> (String, Vec<String>) {
    let reader = SerializedFileReader::new(File::open(path).unwrap()).unwrap();
    let metadata = reader.metadata().file_metadata().key_value_metadata().unwrap();
    let seal = metadata.iter().find(|entry| entry.key == "rigd:seal").unwrap();
    let seal: Value = serde_json::from_str(seal.value.as_deref().unwrap()).unwrap();
    let joined = |value: &Value, names: &[&str]| {
        let parts = names.iter().map(|name| match &value[name] {
            Value::String(text) => text.clone(),
            other => other.to_string(),
        });
        parts.collect::<Vec<_>>().join("|")
    };
    let entry = ["bench_id", "journal_id", "kind", "name", "record_format", "epoch", "started_at"];
    let mut lines = vec![joined(&seal, &entry)];
    let stretches = seal["stretches"].as_array().unwrap().iter();
    lines.extend(stretches.map(|stretch| joined(stretch, &["epoch", "started_at", "rig_us"])));
    lines.extend(reader.get_row_iter(None).unwrap().map(|row| record(&row.unwrap())));
    lines.push(joined(&seal, &["finished_at", "status", "records", "head", "seal"]));
    (seal["run_id"].as_str().unwrap().to_owned(), lines)
}

/// A record without its event, which is a number of the journal.
fn record(row: &Row) -> String {
    let columns: BTreeMap<_, _> =
        row.get_column_iter().map(|(name, field)| (name.as_str(), field)).collect();
    let parts =
        ["seq", "epoch", "rig_us", "kind", "payload", "digest"].map(|name| match columns[name] {
            Field::Long(number) => number.to_string(),
            Field::Str(text) => text.clone(),
            other => panic!("column {name} has {other:?}"),
        });
    parts.join("|")
}

/// The same lines of a sealed run of a journal: its records without their events.
pub(crate) fn of_journal(lines: &[String]) -> Vec<String> {
    let is_record = |line: &str| line.split('|').nth(5).is_some_and(|part| part.starts_with('{'));
    lines
        .iter()
        .map(|line| match line.split_once('|') {
            Some((_, rest)) if is_record(line) => rest.to_owned(),
            _ => line.clone(),
        })
        .collect()
}

fn files(directory: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(directory) else { return Vec::new() };
    let mut found = Vec::new();
    for path in entries.map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push(path);
        }
    }
    found
}
