//! The daemon is killed as it begins an entry.

use std::{
    fs,
    os::unix::process::ExitStatusExt,
    path::Path,
    sync::atomic::{AtomicU32, Ordering::Relaxed},
    time::Instant,
};

use tempfile::TempDir;

use super::{
    PATIENCE, Program, add, answered, end, names, post, preload, program::at_once, queue, request,
    runs, serve, serve_with, start, wait_for,
};

/// What a kill left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Left {
    /// The entry, and no run.
    Entry,
    /// The entry, and its run.
    Both,
    /// The run alone.
    Run,
}

/// A copy of a data directory with one entry in its queue.
fn copied(prepared: &Path) -> TempDir {
    let folder = TempDir::new().unwrap();
    fs::create_dir(folder.path().join("data")).unwrap();
    for file in fs::read_dir(prepared.join("data")).unwrap().map(Result::unwrap) {
        if file.file_type().unwrap().is_file() {
            fs::copy(file.path(), folder.path().join("data").join(file.file_name())).unwrap();
        }
    }
    folder
}

/// The number of calls that change files from the start of a daemon until its queue has the run of the entry.
fn count(prepared: &Path, library: &str) -> u32 {
    let folder = copied(prepared);
    let count = folder.path().join("count");
    let variables = [("LD_PRELOAD", library), ("RIGD_KILL_COUNT", count.to_str().unwrap())];
    let (daemon, _) = serve_with(folder.path(), true, &["--release-queue"], &variables);
    let file = daemon.data.join("queue.json");
    let began = Instant::now();
    let has_run = || fs::read_to_string(&file).is_ok_and(|text| !text.contains("\"run\": null"));
    // The file with the count is empty while it is written.
    let counted = || fs::read_to_string(&count).ok()?.parse().ok().filter(|_| has_run());
    let calls = loop {
        if let Some(calls) = counted() {
            break calls;
        }
        assert!(began.elapsed() < PATIENCE, "the entry does not begin");
    };
    end(daemon);
    calls
}

/// Kills a daemon before this call, and goes on with another one.
fn check(prepared: &Path, library: &str, call: u32) -> Left {
    let folder = copied(prepared);
    let at = call.to_string();
    let variables = [("LD_PRELOAD", library), ("RIGD_KILL_AT", at.as_str())];
    let mut killed = start(folder.path(), true, &["--release-queue"], &variables);
    assert_eq!(killed.child.wait().unwrap().signal(), Some(9), "call {call}");
    let (daemon, address) = serve(folder.path(), false, &[]);
    let seen = queue(&address);
    let left = match (names(&seen).len(), runs(&daemon.data).len()) {
        (1, 0) => Left::Entry,
        (1, 1) => Left::Both,
        (0, 1) => Left::Run,
        other => panic!("call {call}: entries and runs are {other:?}"),
    };
    assert!(!seen["hold"].is_null(), "call {call}: {seen}");
    acknowledge(&daemon, &address);
    if left != Left::Run {
        answered(&post(&address, "queue/release", ""), 200);
    }
    let settled = wait_for(&address, |queue| {
        !queue["hold"].is_null() && names(queue).is_empty() && queue.get("run").is_none()
    });
    assert_eq!(runs(&daemon.data).len(), 1, "call {call}: {settled}");
    end(daemon);
    left
}

/// A person looks at the rig, and it is idle then.
fn acknowledge(daemon: &Program, address: &str) {
    let began = Instant::now();
    loop {
        let rig = answered(&request(address, "GET /api/v1/rig", ""), 200);
        match rig["state"].as_str().unwrap() {
            "idle" => return,
            "latched" => drop(request(address, "POST /api/v1/acknowledge", "")),
            _ => {}
        }
        assert!(began.elapsed() < PATIENCE, "{}: {rig}", daemon.data.display());
    }
}

/// Before every call that changes a file, from the start of the daemon until the file of the queue has the run.
#[test]
fn an_entry_begins_once_and_is_not_lost_wherever_the_daemon_is_killed() {
    let prepared = TempDir::new().unwrap();
    let (daemon, address) = serve(prepared.path(), false, &[]);
    add(&address, "one");
    end(daemon);
    let library = preload::library("disk/kill.c", prepared.path());
    let library = library.to_str().unwrap();
    let calls = count(prepared.path(), library);
    let of = [Left::Entry, Left::Both, Left::Run];
    let counts = [const { AtomicU32::new(0) }; 3];
    at_once(1..=calls, |call| {
        let left = check(prepared.path(), library, call);
        let at = of.iter().position(|of| *of == left).unwrap();
        counts[at].fetch_add(1, Relaxed);
    });
    let [entry, both, run] = counts.map(AtomicU32::into_inner);
    println!(
        "killed before {calls} calls: {entry} left the entry, {both} it and its run, {run} the run"
    );
    assert!(entry > 0 && both > 0, "{entry}, {both}, {run}");
}
