//! That no message says anything twice.

use std::{
    error::Error,
    fs, io,
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

use rig_model::{Mm, PortKind, with_causes};
use rig_store::{Reader, Store, StoreError};
use rig_tests::shipped;
use tempfile::TempDir;

/// The Rust files of the repository.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() && !path.ends_with("target") {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Each text of an `#[error(…)]`, with the fields that follow it.
fn variants(text: &str) -> Vec<(&str, &str)> {
    let mut variants = Vec::new();
    for (at, _) in text.match_indices("#[error(") {
        let rest = &text[at + "#[error(".len()..];
        let Some((message, rest)) = rest.split_once(")]\n") else { continue };
        let mut depth = 0_i32;
        let end = rest.find(|character: char| {
            depth += match character {
                '{' | '(' => 1,
                '}' | ')' => -1,
                _ => 0,
            };
            depth < 0 || depth == 0 && matches!(character, ',' | ';')
        });
        variants.push((message, &rest[..end.unwrap_or(rest.len())]));
    }
    variants
}

#[test]
fn no_error_has_its_source_in_its_message() {
    let mut files = Vec::new();
    for folder in ["crates", "rig-sim/src"] {
        sources(&shipped(folder), &mut files);
    }
    let (mut n_variants, mut n_with_source) = (0, 0);
    for file in files {
        let text = fs::read_to_string(&file).unwrap();
        for (message, fields) in variants(&text) {
            n_variants += 1;
            assert!(!message.contains(":?"), "{}: {message:?}", file.display());
            let is_tuple = fields.contains("(#[source]") || fields.contains("(#[from]");
            if !(is_tuple || fields.contains(" source: ")) {
                continue;
            }
            n_with_source += 1;
            let says_it = message.contains("source") || is_tuple && message.contains("{0");
            let is_transparent = message == "transparent";
            assert!(!says_it || is_transparent, "{}: {message:?} {fields}", file.display());
        }
    }
    assert!(n_variants > 150 && n_with_source > 25, "{n_variants} {n_with_source}");
}

/// An error in one line says everything once.
#[track_caller]
fn check(error: &(dyn Error + 'static), expected: &str) {
    let text = with_causes(error);
    let mut parts: Vec<_> = text.split(": ").collect();
    let n = parts.len();
    parts.sort_unstable();
    parts.dedup();
    assert_eq!(parts.len(), n, "{text}");
    assert!(text.contains(expected), "{text}");
}

fn refused() -> io::Error {
    io::Error::new(io::ErrorKind::ConnectionRefused, "connection refused")
}

#[test]
fn an_error_is_told_once_with_all_its_causes() {
    let port: Arc<str> = "line 1".into();
    let lost = || rig_link::OpenError::Io { port: port.clone(), source: refused() };
    let late = || rig_link::LineError::Io { port: port.clone(), source: Arc::new(refused()) };
    check(&lost(), "line 1: cannot be opened: connection refused");
    check(&late(), "line 1: input or output failed: connection refused");

    let reopen = rig_analyzer::AnalyzerError::Reopen { source: Arc::new(lost()) };
    check(&reopen, "the port was lost: line 1: cannot be opened");
    let asked = rig_analyzer::AnalyzerError::Line {
        asked: "*IDN?".into(),
        unexpected_terminator: None,
        intruders: Vec::new(),
        source: late(),
    };
    check(&asked, "asked `*IDN?`: line 1: input or output failed");

    let fault = rig_stage::LineFault::Reopen { source: Arc::new(lost()) };
    let stage = || rig_stage::StageError::<Mm>::from(rig_stage::BusError::from(fault.clone()));
    check(&stage(), "the port was lost: line 1: cannot be opened");
    let kind = PortKind::Serial;
    let (role, source) = ("linear stage", Box::new(stage().into()));
    let device = rigd::rig::OpenError::Device { role, kind, source };
    check(&device, "linear stage: the port was lost: line 1");
    let (role, source) = ("analyzer", Box::new(asked.into()));
    let device = rigd::rig::OpenError::Device { role, kind, source };
    check(&device, "analyzer: asked `*IDN?`: line 1");
    check(&rigd::rig::OpenError::Port { role: "bus", source: lost() }, "bus: line 1");

    let scratch = TempDir::new().unwrap();
    let data = scratch.path().to_path_buf();
    fs::write(data.join("rigd.db"), "not a database, but long enough to be one").unwrap();
    let damaged = Reader::open(&data).unwrap_err();
    check(&damaged, "the database is damaged: file is not a database");
    check(&rigd::rig::OpenError::Data { data, source: damaged }, "data directory");
    let store = Store::open(&scratch.path().join("file")).unwrap();
    check(&Store::open(&scratch.path().join("file")).unwrap_err(), "in use by another rigd");
    drop(store);
    fs::write(scratch.path().join("plain"), "").unwrap();
    let blocked: StoreError = Store::open(&scratch.path().join("plain")).unwrap_err();
    check(&blocked, "is a file; a journal needs a directory");
    let below: StoreError = Store::open(&scratch.path().join("plain/below")).unwrap_err();
    check(&below, "plain/below cannot be made: Not a directory");

    let missing = rigd::loaded_rig::LoadedRig::load(&scratch.path().join("none.toml")).unwrap_err();
    check(&missing, "none.toml");
    let waited = Duration::from_secs(3);
    check(&rig_link::OpenError::TimedOut { port, waited }, "no connection within 3000 ms");
}
