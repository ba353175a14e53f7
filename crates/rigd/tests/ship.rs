//! `rigd ship`: an object in the store is whole or not there, also when the program is killed.

#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[path = "support/preload.rs"]
mod preload;
#[path = "support/short_runs.rs"]
mod short_runs;

use std::{fs, os::unix::process::ExitStatusExt, path::Path};

use serde_json::Value;
use short_runs::{json, rigd, with_runs};

/// Every file below a directory that does not begin with a dot, as other programs see it.
fn visible(directory: &Path) -> Vec<String> {
    let Ok(entries) = fs::read_dir(directory) else { return Vec::new() };
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(visible(&path));
        } else if !path.file_name().unwrap().to_str().unwrap().starts_with('.') {
            files.push(path.to_str().unwrap().to_owned());
        }
    }
    files.sort();
    files
}

fn outcomes(view: &Value) -> Vec<&str> {
    view.as_array().unwrap().iter().map(|run| run["outcome"].as_str().unwrap()).collect()
}

#[test]
fn sealed_runs_are_shipped_signed_and_verified_without_the_journal() {
    let folder = with_runs(2);
    let (data, store) = (folder.path().join("data"), folder.path().join("objects"));
    let (key, to) = (folder.path().join("bench.key"), format!("folder:{}", store.display()));
    let made = rigd_alone(&["bench-key", "new", key.to_str().unwrap()]);
    let shown = rigd_alone(&["bench-key", "show", key.to_str().unwrap()]);
    assert_eq!(made, shown);
    let ship = ["ship", &to, "--lab", "a", "--bench", "b", "--sign", key.to_str().unwrap()];
    let first = json(&data, &ship);
    // Two runs, each behind the session in which it was made.
    assert_eq!(outcomes(&first), ["shipped"; 4], "{first}");
    assert_eq!(outcomes(&json(&data, &ship)), ["present"; 4]);
    assert_eq!(
        outcomes(&json(&data, &["ship", &to, "smoke-1", "--lab", "a", "--bench", "b"])),
        ["present"]
    );
    let before = json(&data, &["verify", "smoke-1"]);
    fs::remove_dir_all(&data).unwrap();

    let all = json(&data, &["verify", &to, "--signed-by", made.trim()]);
    assert!(all.as_array().unwrap().iter().all(|object| object["is_sound"] == true), "{all}");
    let of_run =
        all.as_array().unwrap().iter().find(|object| object["run"] == before["run"]).unwrap();
    assert_eq!((&of_run["digest"], &of_run["records"]), (&before["digest"], &before["records"]));
    let path = store.join(of_run["object"].as_str().unwrap());
    let one = json(&data, &["verify", path.to_str().unwrap()]);
    assert_eq!(one[0]["seal"], of_run["seal"]);

    let wrong = rigd(&data, &["verify", &to, "--signed-by", &"0".repeat(64)], &[]);
    assert_eq!(wrong.status.code(), Some(7));
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::remove_file(&path).unwrap();
    fs::write(&path, bytes).unwrap();
    assert_eq!(rigd(&data, &["verify", path.to_str().unwrap()], &[]).status.code(), Some(7));
    let nothing = format!("folder:{}", folder.path().join("nothing").display());
    assert_eq!(rigd(&data, &["verify", &nothing], &[]).status.code(), Some(3));
}

/// What a command that needs no data directory prints.
fn rigd_alone(args: &[&str]) -> String {
    let output =
        std::process::Command::new(env!("CARGO_BIN_EXE_rigd")).args(args).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn a_run_of_an_archive_is_shipped_from_there() {
    let folder = with_runs(2);
    let (data, archive) = (folder.path().join("data"), folder.path().join("archive"));
    let to = format!("folder:{}", folder.path().join("objects").display());
    json(&data, &["archive", archive.to_str().unwrap(), "smoke-1"]);
    let kept = json(&data, &["ship", &to]);
    let of_run = kept.as_array().unwrap().iter().find(|run| run["name"] == "smoke-1").unwrap();
    assert!(
        of_run["outcome"] == "kept" && of_run["reason"].as_str().unwrap().contains("is archived"),
        "{of_run}"
    );
    assert_eq!(outcomes(&json(&archive, &["ship", &to])), ["shipped"]);
    assert_eq!(outcomes(&json(&archive, &["ship", &to])), ["present"]);
}

#[test]
fn a_kill_at_any_call_leaves_whole_objects_and_the_next_call_ships_the_rest() {
    let folder = with_runs(1);
    let shim = preload::library("disk/kill.c", folder.path());
    let data = folder.path().join("data");
    let shipped = |store: &Path, at: Option<u32>| {
        let count = folder.path().join("count");
        let mut environment = vec![
            ("LD_PRELOAD", shim.to_str().unwrap().to_owned()),
            ("RIGD_KILL_COUNT", count.to_str().unwrap().to_owned()),
        ];
        environment.extend(at.map(|at| ("RIGD_KILL_AT", at.to_string())));
        let to = format!("folder:{}", store.display());
        let output = rigd(&data, &["ship", &to, "--json"], &environment);
        (output, fs::read_to_string(count).unwrap().parse::<u32>().unwrap())
    };
    let whole = folder.path().join("whole");
    let (output, calls) = shipped(&whole, None);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let expected: Vec<_> = visible(&whole).iter().map(|file| fs::read(file).unwrap()).collect();
    assert!(expected.len() == 4 && calls > 20, "{} files, {calls} calls", expected.len());
    let mut seen = [0; 5];
    for at in 1..=calls {
        let store = folder.path().join(format!("at-{at}"));
        assert_eq!(shipped(&store, Some(at)).0.status.signal(), Some(9), "call {at}");
        let files = visible(&store);
        seen[files.len()] += 1;
        // Whatever can be seen is one of the files that a program which is not killed writes.
        assert!(files.iter().all(|file| expected.contains(&fs::read(file).unwrap())), "call {at}");
        let again = shipped(&store, None).0;
        assert!(again.status.success(), "call {at}: {}", String::from_utf8_lossy(&again.stderr));
        let now: Vec<_> = visible(&store).iter().map(|file| fs::read(file).unwrap()).collect();
        assert_eq!(now, expected, "call {at}");
        fs::remove_dir_all(&store).unwrap();
    }
    assert!(seen[..4].iter().all(|count| *count > 0), "kills at each stage: {seen:?}");
}
