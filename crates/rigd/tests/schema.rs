//! The schemas of the files: committed, named by every shipped file, and of one mind with the readers.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use rig_files::{
    instrument::{Dialect, RegisterMap},
    rig_file::RigFile,
    service_file::ServiceFile,
};
use rig_protocol::Protocol;
use serde_json::Value;
use tempfile::TempDir;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn rigd(args: &[&str]) -> (bool, String) {
    let done =
        Command::new(env!("CARGO_BIN_EXE_rigd")).args(args).current_dir(repository()).output();
    let done = done.unwrap();
    let text = [done.stdout, done.stderr].concat();
    (done.status.success(), String::from_utf8(text).unwrap())
}

/// Whether the reader of a kind of file accepts a text.
fn is_read(kind: &str, text: &str) -> bool {
    match kind {
        "protocol" => Protocol::read("file", text).faults().iter().next().is_none(),
        "rig" => RigFile::read("file", text).is_ok(),
        "service" => ServiceFile::read(Path::new("file"), text).is_ok(),
        "analyzer" => Dialect::read("file", text).is_ok(),
        "drive" => RegisterMap::read("file", text).is_ok(),
        _ => rig_sim::scene::read("file", text).is_ok(),
    }
}

const FILES: [(&str, &str); 10] = [
    ("protocol", "protocols/smoke.toml"),
    ("protocol", "protocols/three-direction.toml"),
    ("rig", "rigs/simulated.toml"),
    ("rig", "rigs/bench.toml"),
    ("scene", "scenes/paper.toml"),
    ("scene", "scenes/matched.toml"),
    ("scene", "scenes/new-bench.toml"),
    ("service", "service/service.toml"),
    ("analyzer", "instruments/new-analyzer.toml"),
    ("drive", "instruments/new-drive.toml"),
];

#[test]
fn the_committed_schemas_are_those_of_the_program_and_every_shipped_file_names_one() {
    for kind in ["protocol", "rig", "scene", "service", "analyzer", "drive"] {
        let committed = repository().join(format!("docs/schemas/{kind}.json"));
        let known = fs::read_to_string(&committed).unwrap_or_default();
        let (is_done, text) = rigd(&["schema", kind]);
        assert!(is_done && known == text, "`rigd schema {kind} > docs/schemas/{kind}.json`");
        let page = format!("docs/reference/{kind}.md");
        let known = fs::read_to_string(repository().join(&page)).unwrap_or_default();
        let (is_done, text) = rigd(&["schema", kind, "--markdown"]);
        assert!(is_done && known == text, "`rigd schema {kind} --markdown > {page}`");
        check_reference(&text, &serde_json::from_str(&rigd(&["schema", kind]).1).unwrap());
    }
    for (kind, file) in FILES {
        let path = repository().join("config").join(file);
        let text = fs::read_to_string(&path).unwrap();
        let named = text.lines().find_map(|line| line.strip_prefix("#:schema ")).unwrap();
        let found = path.parent().unwrap().join(named).canonicalize().unwrap();
        assert!(found.ends_with(format!("docs/schemas/{kind}.json")), "{file}: {named}");
    }
}

/// The page has a row for each key of the schema, with a meaning and, if it is required, that word.
#[track_caller]
fn check_reference(page: &str, schema: &Value) {
    let keys = |schema: &Value| schema["properties"].as_object().cloned().unwrap_or_default();
    for (key, value) in keys(schema) {
        let inner = if value["type"] == "array" { &value["items"] } else { &value };
        if keys(inner).is_empty() || page.contains(&format!("\n| `{key}` ")) {
            let row = page.lines().find(|line| line.starts_with(&format!("| `{key}` |")));
            let row = row.unwrap_or_else(|| panic!("{key} is not on the page"));
            let cells: Vec<&str> = row.split(" | ").collect();
            assert!(cells.len() == 5 && cells[4].trim_end_matches(" |").len() > 3, "{row}");
        } else {
            assert!(
                page.contains(&format!("[{key}]")) || page.contains(&format!(".{key}]")),
                "{key}"
            );
            check_reference(page, inner);
        }
    }
}

/// A file that is changed in one place.
struct Changed {
    what: String,
    file: toml::Table,
}

/// The file with an unknown key in each table, without each required key, and with each limit passed.
fn changes(file: &toml::Table, schema: &Value, path: &str) -> Vec<Changed> {
    let mut all = Vec::new();
    let mut change = |what: String, edit: &dyn Fn(&mut toml::Table)| {
        let mut file = file.clone();
        edit(&mut file);
        all.push(Changed { what: format!("{path}: {what}"), file });
    };
    change("an unknown key".to_owned(), &|file| {
        file.insert("unheard_of".to_owned(), 1.into());
    });
    for key in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        change(format!("without {key}"), &|file| {
            file.remove(key);
        });
    }
    for (key, schema) in schema["properties"].as_object().unwrap() {
        // A value beside the limit, of the kind that it has.
        let beyond = |limit: &str, step: i32| -> Option<toml::Value> {
            let value = schema.get(limit)?;
            if schema["type"] == "integer" {
                // No TOML file has a number beyond 64 bits with a sign.
                let whole = i64::try_from(value.as_u64()?).ok()?;
                return Some(whole.checked_add(step.into())?.into());
            }
            Some((value.as_f64()? + f64::from(step)).into())
        };
        let mut wrong = vec![toml::Value::Boolean(true), toml::Value::String(String::new())];
        if schema["type"] == "boolean" {
            wrong.remove(0);
        }
        wrong.extend(beyond("maximum", 1));
        wrong.extend(beyond("minimum", -1));
        wrong.extend(beyond("exclusiveMinimum", 0));
        for value in wrong {
            change(format!("{key} = {value}"), &|file| {
                file.insert(key.clone(), value.clone());
            });
        }
    }
    for (key, value) in file {
        let Some(schema) = schema["properties"].get(key) else { continue };
        if let toml::Value::Table(inner) = value {
            for Changed { what, file: inner } in changes(inner, schema, &format!("{path}.{key}")) {
                let mut file = file.clone();
                file.insert(key.clone(), toml::Value::Table(inner));
                all.push(Changed { what, file });
            }
        }
    }
    all
}

#[test]
fn schema_and_reader_accept_every_shipped_file_and_refuse_the_same_changes() {
    let mut count = 0;
    for (kind, name) in FILES {
        let text = fs::read_to_string(repository().join("config").join(name)).unwrap();
        let schema: Value = serde_json::from_str(&rigd(&["schema", kind]).1).unwrap();
        let validator = jsonschema::validator_for(&schema).unwrap();
        let file: toml::Table = text.parse().unwrap();
        let whole = serde_json::to_value(&file).unwrap();
        let faults: Vec<_> = validator.iter_errors(&whole).map(|error| error.to_string()).collect();
        assert!(faults.is_empty() && is_read(kind, &text), "{name}: {faults:?}");
        for Changed { what, file } in changes(&file, &schema, name) {
            let text = toml::to_string(&file).unwrap();
            let value = serde_json::to_value(&file).unwrap();
            assert!(!validator.is_valid(&value), "the schema accepts {what}");
            assert!(!is_read(kind, &text), "the reader accepts {what}");
            count += 1;
        }
    }
    assert!(count > 500, "{count} changes");
}

#[test]
fn a_new_protocol_is_accepted_and_no_file_is_replaced() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("soft \"gels\".toml");
    let path = path.to_str().unwrap();
    let (is_done, said) = rigd(&["new", "protocol", path]);
    assert!(is_done, "{said}");
    let (is_done, said) = rigd(&["check", path]);
    assert!(is_done, "{said}");
    let text = fs::read_to_string(path).unwrap();
    assert!(
        text.contains("name = \"soft \\\"gels\\\"\"") && !text.contains("three-direction"),
        "{text}"
    );
    assert!(text.lines().filter(|line| line.starts_with('#')).count() > 40, "{text}");
    assert!(!rigd(&["new", "protocol", path]).0, "the file exists");
    assert_eq!(fs::read_to_string(path).unwrap(), text);
    assert!(rigd(&["new", "protocol"]).1.contains("name = \"new\""));
}
