//! Where the program finds its files, and what it says about its settings.

// Signals and modes of files are of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use program::Program;
use rustix::process::Signal;
use serde_json::{Value, json};
use tempfile::TempDir;

fn shipped(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(file).canonicalize().unwrap()
}

/// A computer with directories of its own: none of the real ones is looked at.
struct Computer {
    root: TempDir,
}

impl Computer {
    fn new() -> Self {
        let root = TempDir::new().unwrap();
        fs::create_dir(root.path().join("here")).unwrap();
        Self { root }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.root.path().join(name)
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command
            .args(args)
            .env("CONFIGURATION_DIRECTORY", self.path("system"))
            .env("STATE_DIRECTORY", self.path("state"))
            .env("HOME", self.path("home"))
            .env("LOGNAME", "ada")
            .env_remove("XDG_CONFIG_HOME")
            .env_remove("XDG_DATA_HOME")
            .env_remove("RUST_LOG")
            .current_dir(self.path("here"));
        command
    }

    fn rigd(&self, args: &[&str]) -> Output {
        self.command(args).output().unwrap()
    }

    fn write(&self, file: &str, text: &str) {
        let path = self.path(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    /// Puts a simulated rig of this name at a path.
    fn put_rig(&self, file: &str) {
        let text = fs::read_to_string(shipped("rigs/simulated.toml")).unwrap();
        let scene = shipped("scenes/paper.toml");
        let text = text.replace("../scenes/paper.toml", scene.to_str().unwrap());
        self.write(file, &text);
    }

    /// What `config show` prints as JSON.
    #[track_caller]
    fn shown(&self, args: &[&str]) -> Value {
        let output = self.rigd(&[&["config", "show", "--json"], args].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_slice(&output.stdout).unwrap()
    }
}

fn stderr(output: &Output) -> &str {
    std::str::from_utf8(&output.stderr).unwrap()
}

/// A value of a part, and where it comes from.
#[track_caller]
fn value<'a>(shown: &'a Value, part: &str, name: &str) -> (&'a Value, &'a Value) {
    let values = shown["values"].as_array().unwrap();
    let found = values.iter().find(|value| value["part"] == part && value["name"] == name);
    let found = found.unwrap_or_else(|| panic!("{part} has no {name}: {shown:#}"));
    (&found["value"], &found["from"])
}

#[test]
fn rig_settings_and_data_come_from_the_first_place_with_a_rig_file() {
    let computer = Computer::new();
    let at = |name: &str| computer.path(name).display().to_string();
    let home = "home/.config/rigd/rig.toml";
    // From the last place to the first one: each takes precedence over those before.
    let places = [
        (
            "checkout",
            "here/config/rigs/simulated.toml",
            "config/rigs/simulated.toml".into(),
            "data".into(),
        ),
        ("user", home, at(home), at("home/.local/share/rigd")),
        ("system", "system/rig.toml", at("system/rig.toml"), at("state")),
    ];
    for (place, file, rig, data) in places {
        computer.put_rig(file);
        let shown = computer.shown(&[]);
        let from = json!({ "kind": "search", "place": place });
        assert_eq!(value(&shown, "directories", "rig"), (&json!(rig), &from));
        assert_eq!(value(&shown, "directories", "data"), (&json!(data), &from));
        assert_eq!(value(&shown, "directories", "service").0, &Value::Null);
        let searched = shown["searched"].as_array().unwrap();
        let order: Vec<_> = searched.iter().map(|searched| &searched["place"]).collect();
        assert_eq!(order, ["system", "user", "checkout"]);
        let used = searched.iter().find(|searched| searched["has_rig"] == true).unwrap();
        assert_eq!(used["place"], place);
        // A command that loads the rig says a file that nobody has named, except the shipped one.
        let checked = computer.rigd(&["check", shipped("protocols/smoke.toml").to_str().unwrap()]);
        assert!(checked.status.success(), "{}", stderr(&checked));
        let says = stderr(&checked).contains(&format!("rig file: {rig}, found without --rig"));
        assert_eq!(says, place != "checkout", "{}", stderr(&checked));
    }
}

#[test]
fn the_daemon_uses_the_place_says_so_and_is_found_there_by_other_commands() {
    let computer = Computer::new();
    computer.put_rig("system/rig.toml");
    computer.write("system/service.toml", "listen = \"127.0.0.1:0\"\n");
    let data = computer.path("state");
    fs::create_dir(&data).unwrap();
    let mut daemon = Program::spawn(&mut computer.command(&["serve"]), data.clone());
    let said = daemon.wait_for_line("rig file");
    let found = "(found in the directories of the system)";
    for (what, path) in [
        ("rig file", "system/rig.toml"),
        ("data", "state"),
        ("service file", "system/service.toml"),
    ] {
        let part = format!("{what} {} {found}", computer.path(path).display());
        assert!(said.contains(&part), "{part}: {said}");
    }
    let address = daemon.wait_for_address();
    assert!(!address.ends_with(":8137"), "{address}");
    let status = computer.rigd(&["status", "--json"]);
    assert!(status.status.success(), "{}", stderr(&status));
    assert!(data.join("rigd.db").exists() && !computer.path("here/data").exists());
    daemon.signal(Signal::TERM);
    assert!(daemon.end().0.success());
}

#[test]
fn a_flag_precedes_the_service_file_and_that_precedes_the_default() {
    let computer = Computer::new();
    computer.put_rig("system/rig.toml");
    let text = "# ours\nlisten = \"127.0.0.1:9000\"\nallow_hosts = [\"bench.lab.example\"]\n\
                token_file = \"token\"\n\n[tls]\nself_signed = true\n";
    computer.write("system/service.toml", text);
    let file = computer.path("system/service.toml").display().to_string();
    let line = |line: u32| json!({ "kind": "file", "file": file, "line": line });
    let (of_flag, default) =
        (|flag: &str| json!({ "kind": "flag", "flag": flag }), json!({ "kind": "default" }));
    let shown = computer.shown(&[]);
    let token = computer.path("system/token").display().to_string();
    for (name, text, from) in [
        ("listen", json!("127.0.0.1:9000"), line(2)),
        ("allow_hosts", json!("bench.lab.example"), line(3)),
        ("token_file", json!(token), line(4)),
        ("release_queue", json!("false"), default.clone()),
        ("tls", json!("a certificate of its own"), line(6)),
        ("operator", json!("ada"), json!({ "kind": "variable", "variable": "LOGNAME" })),
    ] {
        assert_eq!(value(&shown, "service", name), (&text, &from), "{name}");
    }
    let shown = computer.shown(&[
        "--listen=127.0.0.1:1",
        "--allow-host=a.example",
        "--token-file=t",
        "--release-queue",
        "--tls-certificate=c.pem",
        "--tls-key=k.pem",
        "--operator=Grace",
        "--data=elsewhere",
    ]);
    for (part, name, text, flag) in [
        ("service", "listen", "127.0.0.1:1", "--listen"),
        ("service", "allow_hosts", "a.example", "--allow-host"),
        ("service", "token_file", "t", "--token-file"),
        ("service", "release_queue", "true", "--release-queue"),
        ("service", "tls", "c.pem, k.pem", "--tls-certificate"),
        ("service", "operator", "Grace", "--operator"),
        ("directories", "data", "elsewhere", "--data"),
    ] {
        assert_eq!(value(&shown, part, name), (&json!(text), &of_flag(flag)), "{name}");
    }
    computer.write("here/other.toml", "");
    let shown = computer.shown(&["--config=other.toml"]);
    let from = of_flag("--config");
    assert_eq!(value(&shown, "directories", "service"), (&json!("other.toml"), &from));
    assert_eq!(value(&shown, "service", "listen"), (&json!("127.0.0.1:8137"), &default));
}

#[test]
fn every_value_of_the_rig_file_has_its_line_and_every_variable_its_value() {
    let computer = Computer::new();
    computer.put_rig("system/rig.toml");
    let shown = computer.shown(&[]);
    let file = computer.path("system/rig.toml");
    let text = fs::read_to_string(&file).unwrap();
    let of_rig = |value: &&Value| value["part"] == "rig";
    let mut given = 0;
    for value in shown["values"].as_array().unwrap().iter().filter(of_rig) {
        let name = value["name"].as_str().unwrap();
        let key = name.rsplit('.').next().unwrap();
        let Some(line) = value["from"]["line"].as_u64() else {
            assert_eq!(value["from"]["kind"], "default", "{name}");
            continue;
        };
        assert_eq!(value["from"]["file"], file.to_str().unwrap());
        let line = text.lines().nth(usize::try_from(line).unwrap() - 1).unwrap();
        let written = value["value"].as_str().unwrap();
        assert!(line.contains(&format!("{key} = {written}")), "{name} = {written}: {line}");
        given += 1;
    }
    assert!(given > 50, "{given}");
    let default = json!({ "kind": "default" });
    assert_eq!(value(&shown, "rig", "analyzer.terminator"), (&Value::Null, &default));
    let variable = |name: &str| json!({ "kind": "variable", "variable": name });
    let home = computer.path("home").display().to_string();
    assert_eq!(value(&shown, "environment", "HOME"), (&json!(home), &variable("HOME")));
    assert_eq!(value(&shown, "environment", "RUST_LOG"), (&Value::Null, &default));
    // The same for a person.
    let text = String::from_utf8(computer.rigd(&["config", "show"]).stdout).unwrap();
    let line = text.lines().find(|line| line.trim_start().starts_with("listen ")).unwrap();
    assert!(line.contains("127.0.0.1:8137") && line.ends_with("default"), "{line}");
    let line = text.lines().find(|line| line.contains("analyzer.dialect")).unwrap();
    assert!(line.contains(&format!("{}:", file.display())), "{line}");
}

#[test]
fn a_faulty_file_is_refused_with_its_line_and_a_missing_rig_file_is_said_below_the_search() {
    let computer = Computer::new();
    computer.put_rig("system/rig.toml");
    for (text, fault) in [
        (
            "listen = \"no-such-host.invalid:1\"",
            ":1:10: listen: the name `no-such-host.invalid` has no",
        ),
        ("allow_hosts = [\"http://a\"]", ":1:15: allow_hosts: expected the name"),
        ("\nlisten = 8137", ":2:10: listen = 8137 must be text"),
        ("[analyzer]\n[bus]\n", "this looks like a rig file, not like a service file"),
    ] {
        computer.write("system/service.toml", text);
        for command in [&["config", "show"][..], &["serve"]] {
            let output = computer.rigd(command);
            assert_eq!(output.status.code(), Some(2), "{text}");
            assert!(stderr(&output).contains(fault), "{text}: {}", stderr(&output));
        }
    }
    fs::remove_file(computer.path("system/service.toml")).unwrap();
    fs::remove_file(computer.path("system/rig.toml")).unwrap();
    let output = computer.rigd(&["config", "show"]);
    assert_eq!(output.status.code(), Some(2));
    let text = String::from_utf8(output.stdout).unwrap();
    let searched = format!("{}: not there", computer.path("system/rig.toml").display());
    assert!(text.contains(&searched), "{text}");
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("config/rigs/simulated.toml: no such file"), "{said}");
}
