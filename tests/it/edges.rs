//! Which crate may use which: the arrows of `docs/architecture.md`, read from `cargo metadata`.

use std::{collections::BTreeMap, process::Command};

use serde_json::Value;

/// Crates without I/O, clock or runtime.
const PURE: [&str; 13] = [
    "rig-model",
    "rig-files",
    "rig-scpi",
    "rig-contact",
    "rig-resonance",
    "rig-analysis",
    "rig-protocol",
    "rig-engine",
    "rig-commission",
    "rig-interlock",
    "rig-record",
    "rig-chart",
    "rig-report",
];

/// The crates of this workspace that each crate may use. A new arrow needs a decision in
/// docs/decisions.
const ARROWS: [(&str, &[&str]); 26] = [
    ("rig-model", &[]),
    ("rig-files", &["rig-model", "rig-contact", "rig-resonance", "rig-scpi"]),
    ("rig-scpi", &[]),
    ("rig-contact", &["rig-model"]),
    ("rig-resonance", &["rig-model"]),
    ("rig-analysis", &["rig-model", "rig-contact"]),
    ("rig-protocol", &["rig-model", "rig-files"]),
    ("rig-engine", &["rig-model", "rig-protocol", "rig-resonance"]),
    ("rig-commission", &["rig-model", "rig-files", "rig-record"]),
    ("rig-interlock", &["rig-model"]),
    ("rig-usbtmc", &[]),
    // What differs between the operating systems.
    ("rig-system", &[]),
    ("rig-link", &["rig-model", "rig-usbtmc"]),
    ("rig-analyzer", &["rig-model", "rig-files", "rig-link", "rig-scpi"]),
    ("rig-stage", &["rig-model", "rig-files", "rig-link"]),
    ("rig-record", &[]),
    ("rig-store", &["rig-record", "rig-system"]),
    ("rig-chart", &[]),
    // It shares no code with the program whose journals it checks.
    ("rig-verify", &[]),
    (
        "rig-report",
        &[
            "rig-files",
            "rig-contact",
            "rig-resonance",
            "rig-analysis",
            "rig-protocol",
            "rig-record",
            "rig-chart",
        ],
    ),
    ("rig-ship", &["rig-report", "rig-store", "rig-system", "rig-verify"]),
    (
        "rig-hub",
        &[
            "rig-model",
            "rig-store",
            "rig-ship",
            "rig-report",
            "rig-commission",
            "rig-chart",
            "rig-system",
        ],
    ),
    ("rig-workqueue", &[]),
    ("rig-sim", &["rig-model", "rig-files", "rig-scpi", "rig-contact", "rig-system"]),
    (
        "rigd",
        &[
            "rig-model",
            "rig-files",
            "rig-protocol",
            "rig-engine",
            "rig-commission",
            "rig-interlock",
            "rig-contact",
            "rig-analysis",
            "rig-resonance",
            "rig-link",
            "rig-analyzer",
            "rig-stage",
            "rig-record",
            "rig-store",
            "rig-system",
            "rig-report",
            "rig-verify",
            "rig-ship",
            "rig-hub",
            "rig-sim",
        ],
    ),
    (
        "rig-study",
        &[
            "rig-model",
            "rig-contact",
            "rig-protocol",
            "rig-resonance",
            "rig-analysis",
            "rig-engine",
            "rig-chart",
            "rig-report",
            "rig-store",
            "rig-workqueue",
            "rigd",
            "rig-sim",
        ],
    ),
];

/// Crates that bring a runtime, a port, a file or a clock.
const IMPURE: [&str; 7] = [
    "tokio",
    "tokio-serial",
    "tokio-modbus",
    "axum",
    "rusqlite",
    "tracing-subscriber",
    "indicatif",
];

/// The dependencies of each crate of the workspace, without those of its tests.
fn dependencies() -> BTreeMap<String, Vec<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .output()
        .expect("cargo runs, since it runs this test");
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo writes JSON");
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let packages = metadata["packages"].as_array().expect("there are packages");
    let of = |package: &Value| {
        let all = package["dependencies"].as_array().expect("there is a list").iter();
        let used = all.filter(|dependency| dependency["kind"].is_null());
        (text(&package["name"]), used.map(|dependency| text(&dependency["name"])).collect())
    };
    packages.iter().map(of).collect()
}

#[test]
fn no_crate_uses_what_the_architecture_does_not_show() {
    let dependencies = dependencies();
    let is_ours = |name: &str| name == "rigd" || name.starts_with("rig-");
    for (name, used) in &dependencies {
        if name == "rig-tests" {
            continue;
        }
        let allowed = ARROWS.iter().find(|(known, _)| known == name);
        let (_, allowed) = allowed.unwrap_or_else(|| panic!("{name} is not in the architecture"));
        for dependency in used.iter().filter(|dependency| is_ours(dependency)) {
            assert!(allowed.contains(&dependency.as_str()), "{name} must not use {dependency}");
        }
    }
    assert_eq!(dependencies.len(), ARROWS.len() + 1, "a crate is gone, or new");
}

#[test]
fn crates_below_the_line_bring_no_runtime() {
    let dependencies = dependencies();
    for name in PURE {
        for dependency in &dependencies[name] {
            assert!(!IMPURE.contains(&dependency.as_str()), "{name} must not use {dependency}");
        }
    }
}
