//! The disk fails: at the n-th write or sync, once or from then on, or it is full. The program
//! reports it, the journal stays readable, and the run can be resumed when the disk works again.

#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[path = "support/preload.rs"]
mod preload;

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
};

use rig_store::{ProbeWord, Reader, Record, RunKind};
use tempfile::TempDir;

/// Numbers of errors on Linux.
const EIO: i32 = 5;
const ENOSPC: i32 = 28;

struct Bench {
    folder: TempDir,
    protocol: PathBuf,
    shim: PathBuf,
}

/// Runs the program to its end.
fn rigd(data: &Path, args: &[&str], environment: &[(&str, String)]) -> Output {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    Command::new(env!("CARGO_BIN_EXE_rigd"))
        .args(args)
        .args(["--data", data.to_str().unwrap()])
        .envs(environment.iter().map(|(name, value)| (name, value)))
        .current_dir(repository)
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

impl Bench {
    fn new() -> Self {
        let folder = TempDir::new().unwrap();
        let shim = preload::library("disk/fail.c", folder.path());
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        let smoke = fs::read_to_string(config.join("protocols/smoke.toml")).unwrap();
        let short = smoke
            .replace("directions = [\"front\", \"back\", \"left\"]", "directions = [\"left\"]")
            .replace("angles_deg = [0, 45]", "angles_deg = [30]")
            .replace("trials = 6", "trials = 2");
        let protocol = folder.path().join("short.toml");
        fs::write(&protocol, short).unwrap();
        Self { folder, protocol, shim }
    }

    /// A run in which calls fail, and the number of calls.
    fn run_failing(&self, data: &Path, failing: &[(&str, String)]) -> (Output, u32) {
        let count = self.folder.path().join("count");
        let mut environment = vec![
            ("LD_PRELOAD", self.shim.to_str().unwrap().to_owned()),
            ("RIGD_FAIL_COUNT", count.to_str().unwrap().to_owned()),
        ];
        environment.extend_from_slice(failing);
        let output = rigd(data, &["run", self.protocol.to_str().unwrap()], &environment);
        let count = fs::read_to_string(count).ok().and_then(|count| count.parse().ok());
        (output, count.unwrap_or(0))
    }
}

#[test]
fn a_disk_that_fails_at_any_call_costs_no_committed_record_and_no_safety() {
    const PLACES: u32 = 10;
    /// The last calls write the end of the run, its files and the end of the session.
    const LAST: u32 = 16;
    let bench = Bench::new();
    let whole = bench.folder.path().join("whole");
    let (output, calls) = bench.run_failing(&whole, &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(calls > 60, "{calls} calls");
    let mut codes = BTreeSet::new();
    let (mut resumed, mut begun_anew) = (0, 0);
    // The first calls make the tables.
    let spread = (0..PLACES).map(|place| 1 + (place * (calls - 2)) / (PLACES - 1));
    let everywhere = spread.flat_map(|at| [(at, EIO, true), (at, EIO, false), (at, ENOSPC, false)]);
    let at_the_end = (calls - LAST..calls).map(|at| (at, ENOSPC, false));
    for (at, error, is_once) in everywhere.chain(at_the_end) {
        let data = bench.folder.path().join(format!("at-{at}-{error}-{is_once}"));
        let mut failing =
            vec![("RIGD_FAIL_AT", at.to_string()), ("RIGD_FAIL_WITH", error.to_string())];
        failing.extend((!is_once).then(|| ("RIGD_FAIL_FROM", String::new())));
        let (output, _) = bench.run_failing(&data, &failing);
        let said = String::from_utf8(output.stderr).unwrap();
        let here = format!("call {at} of {calls}, error {error}, once: {is_once}: {said}");
        let code = output.status.code().unwrap();
        codes.insert(code);
        assert!([0, 1, 4].contains(&code), "{here}");
        assert!(!said.contains("panicked"), "{here}");
        if code != 0 {
            let words = ["disk", "input or output", "database", "journal"];
            assert!(words.iter().any(|word| said.contains(word)), "{here}");
        }
        // The records can be read, and the probe was left clear or counts as in contact.
        let Ok(reader) = Reader::open(&data) else { continue };
        for run in reader.runs().unwrap() {
            reader.records(run.id).unwrap_or_else(|error| panic!("{error}: {here}"));
        }
        let Some(run) = reader.runs().unwrap().into_iter().find(|r| r.kind == RunKind::Run) else {
            begun_anew += 1;
            continue;
        };
        let steps = |reader: &Reader| -> Vec<String> {
            let records = reader.records(run.id).unwrap();
            let touches = records.iter().filter_map(|stored| match stored.record().unwrap() {
                Record::TouchResult(touch) => Some(touch.touch.step),
                _ => None,
            });
            touches.collect()
        };
        let before = steps(&reader);
        if !run.is_sealed && !is_once && code == 1 {
            // It is in the list, and was refused at its first record: nothing has moved for it.
            assert!(said.contains("rigd: the journal cannot be written: "), "{here}");
            assert!(before.is_empty(), "{here}");
        } else if !run.is_sealed && !is_once {
            // A run that cannot write its files either says how it ended and where the probe is.
            assert_eq!(code, 4, "{here}");
            assert!(said.contains("rigd: the rig is latched: journal: "), "{here}");
            assert!(said.contains("\nprobe: clear; the journal could not record that"), "{here}");
        }
        if !run.is_sealed {
            let done = rigd(&data, &["run", "--resume", "latest"], &[]);
            let said = String::from_utf8_lossy(&done.stderr).into_owned();
            assert!(done.status.success(), "{here}, then {said}");
            resumed += 1;
        }
        let after = steps(&reader);
        assert_eq!(after.len(), 4, "{here}");
        assert!(after.starts_with(&before), "{here}");
        let unique: BTreeSet<&String> = after.iter().collect();
        assert_eq!(unique.len(), 4, "{here}");
        let session = reader.latest_session("simulated bench").unwrap().unwrap();
        assert_eq!(reader.probe_word(&session).unwrap(), ProbeWord::Clear, "{here}");
    }
    assert!(resumed > 8 && codes.contains(&4), "{resumed} resumed, {begun_anew} again, {codes:?}");
}
