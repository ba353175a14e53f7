//! `rigd commission` on simulated benches that are not put together as their rig file says.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::{
    fs,
    path::PathBuf,
    process::{Command, Output},
};

use rig_files::rig_file::RigFile;
use rig_model::random::Stream;
use rig_store::{CitedCalibration, Digest, Reader, Record};
use sha2::{Digest as _, Sha256};
use tempfile::TempDir;

#[path = "support/commissioned.rs"]
mod commissioned;

/// What a bench is in truth.
#[derive(Debug, Clone, Copy)]
struct Truth {
    mm_per_step: f64,
    zero_mm: f64,
    deg_per_step: f64,
    zero_deg: f64,
}

/// A bench with a rig file of its own, which a person changes as `rigd commission` says.
struct Bench {
    folder: TempDir,
}

fn config(path: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config").join(path)
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

impl Bench {
    fn new(truth: Truth, seed: u64, wrong_answers: f64) -> Self {
        let folder = TempDir::new().unwrap();
        let mut scene = fs::read_to_string(config("scenes/new-bench.toml")).unwrap();
        for (old, new) in [
            ("seed = 2020", format!("seed = {seed}")),
            ("mm_per_step = 0.00102", format!("mm_per_step = {:?}", truth.mm_per_step)),
            ("\nzero_mm = 0", format!("\nzero_mm = {:?}", truth.zero_mm)),
            ("deg_per_step = -0.01", format!("deg_per_step = {:?}", truth.deg_per_step)),
            ("zero_deg = 0.8", format!("zero_deg = {:?}", truth.zero_deg)),
            ("wrong_answers = 0.1", format!("wrong_answers = {wrong_answers:?}")),
        ] {
            assert!(scene.contains(old), "{old}");
            scene = scene.replacen(old, &new, 1);
        }
        fs::write(folder.path().join("scene.toml"), scene).unwrap();
        let rig = fs::read_to_string(config("rigs/simulated.toml")).unwrap();
        let rig = rig.replacen("../scenes/paper.toml", "scene.toml", 1);
        fs::write(folder.path().join("rig.toml"), rig).unwrap();
        Self { folder }
    }

    fn rigd(&self, args: &[&str]) -> Output {
        let path = |name| self.folder.path().join(name);
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command.args(args).arg("--rig").arg(path("rig.toml")).arg("--data").arg(path("data"));
        command.output().unwrap()
    }

    fn rig(&self) -> RigFile {
        let text = fs::read_to_string(self.folder.path().join("rig.toml")).unwrap();
        RigFile::read("rig.toml", &text).unwrap()
    }

    /// Puts the values into the rig file that `rigd commission` names.
    fn change_rig_file(&self, said: &str) {
        let path = self.folder.path().join("rig.toml");
        let mut text = fs::read_to_string(&path).unwrap();
        let (_, changes) = said.split_once("as the rig file says: ").unwrap();
        for change in changes.lines().next().unwrap().split("; ") {
            let (key, rest) = change.split_once(" = ").unwrap();
            let (_, value) = rest.split_once(" must be changed to ").unwrap();
            let (which, key) = key.split_once(' ').unwrap_or(("", key));
            let (section, key) = key.split_once('.').unwrap();
            let begin = text.find(&format!("\n[{section}]\n")).unwrap() + 1;
            let end = text[begin..].find("\n[").map_or(text.len(), |length| begin + length);
            let body = &text[begin..end];
            let is_key = |line: &&str| line.starts_with(&format!("{key} = "));
            let new = match body.lines().find(is_key) {
                Some(line) if !which.is_empty() => {
                    let (_, both) = line.split_once('[').unwrap();
                    let (low, high) = both.split_once(']').unwrap().0.split_once(", ").unwrap();
                    let (low, high) = if which == "lower" { (value, high) } else { (low, value) };
                    body.replacen(line, &format!("{key} = [{low}, {high}]"), 1)
                }
                Some(line) => body.replacen(line, &format!("{key} = {value}"), 1),
                None => format!("{body}\n{key} = {value}\n"),
            };
            text.replace_range(begin..end, &new);
        }
        fs::write(path, text).unwrap();
    }

    /// Commissions the bench as a person does: changes the rig file as told, and begins again after a step that
    /// failed. Gives the number of times that the command was called, and the failures among them.
    fn commission(&self) -> (usize, usize) {
        let mut failures = 0;
        for round in 1..=20 {
            let output = self.rigd(&["commission"]);
            match output.status.code() {
                Some(0) => return (round, failures),
                Some(2) => self.change_rig_file(&stderr(&output)),
                Some(1) if stderr(&output).contains("rigd: step ") => failures += 1,
                code => panic!("{code:?}: {}", stderr(&output)),
            }
        }
        panic!("not commissioned after 20 times");
    }

    fn assert_last_run_cites_its_calibrations(&self) {
        let data = self.folder.path().join("data");
        let reader = Reader::open(&data).unwrap();
        let run = reader.find("latest").unwrap();
        let first = reader.records(run.id).unwrap().remove(0).record().unwrap();
        let Record::RunStarted(started) = first else { panic!("{first:?}") };
        let kinds: Vec<_> = started.calibrations.iter().map(|cited| &*cited.kind).collect();
        assert_eq!(kinds, ["stop", "signs", "geometry", "scale", "limits", "homing"]);
        for CitedCalibration { kind, person, file, sha256, .. } in started.calibrations {
            let text = fs::read(data.join("calibrations").join(file)).unwrap();
            assert_eq!(Digest::from_bytes(Sha256::digest(text).into()).to_string(), sha256);
            assert_eq!(person, "simulated person", "{kind}");
        }
    }

    fn records(&self) -> usize {
        fs::read_dir(self.folder.path().join("data/calibrations")).map_or(0, Iterator::count)
    }
}

/// A bench with an error of each kind.
const WRONG: Truth =
    Truth { mm_per_step: 0.00102, zero_mm: 0.0, deg_per_step: -0.01, zero_deg: 0.8 };

#[test]
fn nothing_moves_on_a_bench_that_nobody_has_commissioned() {
    let bench = Bench::new(WRONG, 1, 0.0);
    for args in [
        &["home"][..],
        &["home", "--nothing-below-probe"],
        &["move", "linear", "30"],
        &["move", "rotary", "10"],
        &["measure", "--min-hz", "125", "--max-hz", "160"],
        &["run", config("protocols/smoke.toml").to_str().unwrap()],
    ] {
        let output = bench.rigd(args);
        assert_eq!(output.status.code(), Some(4), "{args:?}: {}", stderr(&output));
        let said = stderr(&output);
        let missing =
            "not commissioned: stop (never made), signs (never made), geometry (never made)";
        assert!(said.contains(missing) && said.contains("`rigd commission`"), "{said}");
    }
    // The way out of contact stops both axes, and does not lift in a direction that nobody knows.
    let safe = bench.rigd(&["safe"]);
    assert_eq!(safe.status.code(), Some(4));
    assert!(stderr(&safe).contains("not commissioned"), "{}", stderr(&safe));
    // A short step is made, a long one is not.
    let jog = |by| bench.rigd(&["commission", "jog", "linear", by, "--yes"]);
    let made = jog("0.2");
    assert!(made.status.success(), "{}", stderr(&made));
    let long = jog("0.3");
    assert_eq!(long.status.code(), Some(2));
    assert!(stderr(&long).contains("0.300 mm is more than the 0.200 mm"), "{}", stderr(&long));
}

#[test]
fn a_change_of_the_bench_holds_also_after_the_clock_was_set_back() {
    let bench = Bench::new(DESCRIBED, 1, 0.0);
    let data = bench.folder.path().join("data");
    let rig = fs::read_to_string(bench.folder.path().join("rig.toml")).unwrap();
    commissioned::commission(&rig, &data);
    let said = |args: &[&str]| String::from_utf8(bench.rigd(args).stdout).unwrap();
    let show = ["commission", "show", "--json"];
    assert!(!said(&show).contains("why"));
    // The clock was an hour ahead when they were made.
    for entry in fs::read_dir(data.join("calibrations")).unwrap() {
        let path = entry.unwrap().path();
        let text = fs::read_to_string(&path).unwrap();
        let later = |line: &str| match line.strip_prefix("made_unix_s = ") {
            Some(made) => format!("made_unix_s = {}", made.parse::<i64>().unwrap() + 3600),
            None => line.to_owned(),
        };
        let text: Vec<_> = text.lines().map(later).collect();
        fs::write(&path, text.join("\n")).unwrap();
    }
    let shown = said(&show);
    let why = "its record is dated later than the clock of this computer says now";
    assert_eq!(shown.matches(why).count(), 6, "{shown}");
    let home = bench.rigd(&["home"]);
    assert_eq!(home.status.code(), Some(4), "{}", stderr(&home));
    assert!(bench.rigd(&["commission", "changed", "stop"]).status.success());
    let shown = said(&show);
    assert!(shown.contains("the bench was changed since"), "{shown}");
}

#[test]
fn benches_of_any_sign_scale_and_zero_are_found_out_also_with_a_person_who_errs() {
    let mut chance = Stream::new(18, 0);
    for seed in 0..12 {
        let sense = |chance: &mut Stream| if chance.uniform() < 0.5 { -1.0 } else { 1.0 };
        // From a third of the described step to three times it, and some close to it.
        let stretch = |chance: &mut Stream| {
            let wide = if chance.uniform() < 0.5 { 1.1 } else { 0.02 };
            (wide * (2.0 * chance.uniform() - 1.0)).exp()
        };
        let truth = Truth {
            mm_per_step: 0.001 * sense(&mut chance) * stretch(&mut chance),
            zero_mm: 60.0 * chance.uniform() - 10.0,
            deg_per_step: 0.01 * sense(&mut chance) * stretch(&mut chance),
            zero_deg: 6.0 * chance.uniform() - 3.0,
        };
        let bench = Bench::new(truth, seed, 0.05);
        let (rounds, _) = bench.commission();
        let (linear, rotary) = (bench.rig().linear.scale, bench.rig().rotary.scale);
        let of = format!("seed {seed}, {rounds} rounds: {truth:?}, {linear:?}, {rotary:?}");
        // The limit of acceptance, and three standard deviations.
        assert!((linear.per_count / truth.mm_per_step - 1.0).abs() < 0.003 + 0.004, "{of}");
        assert!((rotary.per_count / truth.deg_per_step - 1.0).abs() < 0.01 + 0.01, "{of}");
        assert!((rotary.zero.value() - truth.zero_deg).abs() < 0.3 + 0.3, "{of}");
        let home = bench.rigd(&["home"]);
        assert!(home.status.success(), "{of}: {}", stderr(&home));
    }
}

#[test]
fn a_change_of_the_rig_file_asks_for_the_steps_that_rest_on_it_and_an_interruption_for_the_rest() {
    let bench = Bench::new(
        Truth { mm_per_step: 0.001, zero_mm: 0.0, deg_per_step: 0.01, zero_deg: 0.05 },
        3,
        0.0,
    );
    // The answers of a person who does not press the stop, however often that is asked for.
    let path = bench.folder.path().join("rig.toml");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replacen("person = \"answers\"", "person = \"waits\"", 1)).unwrap();
    let answers = ["yes", "no", "no", "no", "no", "no"].map(|answer| ["--answer", answer]);
    let left = bench.rigd(&[&["commission", "--yes"], answers.as_flattened()].concat());
    assert_eq!(left.status.code(), Some(1), "{}", stderr(&left));
    assert_eq!(bench.records(), 1);
    let nonsense = bench.rigd(&["commission", "--answer", "perhaps"]);
    assert_eq!(nonsense.status.code(), Some(2), "{}", stderr(&nonsense));
    fs::write(&path, &text).unwrap();
    assert_eq!(bench.commission(), (1, 0));
    let held = |expected: [bool; 6]| {
        let shown = bench.rigd(&["commission", "show", "--json"]);
        let steps: Vec<serde_json::Value> = serde_json::from_slice(&shown.stdout).unwrap();
        let held: Vec<_> = steps.iter().map(|step| step["is_held"] == true).collect();
        assert_eq!(held, expected, "{steps:?}");
    };
    held([true; 6]);
    // What no step rests on may change.
    let faster = text.replacen("max_speed_mm_per_s = 20", "max_speed_mm_per_s = 15", 1);
    let faster = faster.replacen("travel_speed_mm_per_s = 20", "travel_speed_mm_per_s = 15", 1);
    fs::write(&path, format!("# Another comment.\n{faster}")).unwrap();
    held([true; 6]);
    fs::write(&path, text.replacen("surface_above_pivot_mm = 4", "surface_above_pivot_mm = 5", 1))
        .unwrap();
    held([true, true, false, true, true, true]);
    let moved = bench.rigd(&["move", "linear", "30"]);
    let why = "not commissioned: geometry (made with other values in the rig file)";
    assert!(stderr(&moved).contains(why), "{}", stderr(&moved));
    fs::write(&path, text.replacen("unit_id = 2", "unit_id = 3", 1)).unwrap();
    held([false; 6]);
    // The records themselves were left as they were.
    fs::write(&path, &text).unwrap();
    held([true; 6]);
}

#[test]
fn touches_on_a_hard_block_find_the_geometry_within_its_stated_uncertainty() {
    let truth = Truth { mm_per_step: 0.001, zero_mm: 0.0, deg_per_step: 0.01, zero_deg: 0.05 };
    let bench = Bench::new(truth, 7, 0.0);
    let path = bench.folder.path().join("scene.toml");
    let mut scene = fs::read_to_string(&path).unwrap();
    // A block lies flat, and is not another one at each tilt.
    for (old, new) in [
        ("mounting_mm = 0.06", "mounting_mm = 0"),
        ("slope_deg = 1", "slope_deg = 0"),
        ("stiffness_rel = 0.03", "stiffness_rel = 0"),
        (
            "[place]",
            "[[samples]]\nname = \"block\"\nstiffness_mpa = 100\nmax_indentation_mm = 0.5\n\n[place]",
        ),
    ] {
        assert!(scene.contains(old), "{old}");
        scene = scene.replacen(old, new, 1);
    }
    fs::write(&path, scene).unwrap();
    let protocol = fs::read_to_string(config("protocols/block.toml")).unwrap();
    let once = bench.folder.path().join("block.toml");
    fs::write(&once, protocol.replacen("repeats = 3", "repeats = 1", 1)).unwrap();
    assert_eq!(bench.commission(), (1, 0));
    let home = bench.rigd(&["home"]);
    assert!(home.status.success(), "{}", stderr(&home));
    let run = bench.rigd(&["run", once.to_str().unwrap()]);
    assert!(matches!(run.status.code(), Some(0 | 6)), "{}", stderr(&run));
    bench.assert_last_run_cites_its_calibrations();
    let found = bench.rigd(&["commission", "blocks", "latest"]);
    assert!(matches!(found.status.code(), Some(0 | 2)), "{}", stderr(&found));
    let folder = bench.folder.path().join("data/calibrations");
    let mut records = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let is_of_blocks = |path: &PathBuf| path.to_str().unwrap().contains("/blocks-");
    let record = records.find(is_of_blocks).unwrap();
    let record: toml::Table = fs::read_to_string(record).unwrap().parse().unwrap();
    assert_eq!(record["kind"].as_str(), Some("blocks"));
    assert!(record["screw_mm"].as_array().unwrap().len() > 5);
    // From the scene.
    let truths = [10.03, 4.02, 0.32, 0.05];
    for (value, truth) in record["values"].as_array().unwrap().iter().zip(truths) {
        let (found, sigma) =
            (value["value"].as_float().unwrap(), value["standard_uncertainty"].as_float().unwrap());
        assert!((found - truth).abs() < 4.0 * sigma && sigma < 1.0, "{value}, {truth} in truth");
    }
    // A change of the bench voids what rests on it, and nothing else.
    let changed = bench.rigd(&["commission", "changed", "stop"]);
    assert!(changed.status.success(), "{}", stderr(&changed));
    let shown = bench.rigd(&["commission", "show"]);
    let said = String::from_utf8(shown.stdout).unwrap();
    assert!(said.contains("missing: the bench was changed since"), "{said}");
    bench.assert_its_run_shows_this_bench_until_it_changes(&record, found.status.code());
    // What a run says of one zero of an axis is not added to another.
    bench.change_rig_file("as the rig file says: rotary.zero_deg = 0 must be changed to 0.05");
    let again = bench.rigd(&["commission", "blocks", "latest"]);
    assert_eq!(again.status.code(), Some(2));
    let why =
        "block-1 was made with other values of [linear] or [rotary] than the rig file has now";
    assert!(stderr(&again).contains(why), "{}", stderr(&again));
}

impl Bench {
    /// The last run, on a block, has this record.
    fn assert_its_run_shows_this_bench_until_it_changes(
        &self,
        record: &toml::Table,
        code: Option<i32>,
    ) {
        // The record is of the end of its run, from when on it holds, and the same run judged again is another record.
        let reader = Reader::open(&self.folder.path().join("data")).unwrap();
        let ended = reader.find("latest").unwrap().finished_at.unwrap();
        assert_eq!(record["made"].as_str().unwrap(), format!("{}Z", &ended[..19]));
        let before = self.records();
        let judge = || self.rigd(&["commission", "blocks", "latest"]);
        assert_eq!(judge().status.code(), code);
        assert_eq!(self.records(), before + 1);
        // A run of another bench is none of this one.
        let refused = |why: &str| {
            let (code, said) = (judge().status.code(), stderr(&judge()));
            assert!(code == Some(2) && said.contains(why), "{said}");
        };
        let rig = fs::read_to_string(self.folder.path().join("rig.toml")).unwrap();
        let was = "block-1 was made on the rig \"simulated bench\" (simulated), and not on the rig";
        let simulated = "connection = \"simulated\"";
        for (old, new, is) in [
            (simulated, "connection = \"ports\"", "\"simulated bench\" (real)"),
            ("name = \"simulated bench\"", "name = \"another\"", "\"another\" (simulated)"),
        ] {
            self.edit("rig.toml", &[(old, new)]);
            refused(&format!("{was} {is}"));
            fs::write(self.folder.path().join("rig.toml"), &rig).unwrap();
        }
        // Nor does one from before a change show the bench as it is since.
        assert!(self.rigd(&["commission", "changed", "place"]).status.success());
        refused("before the bench was changed");
    }

    /// Changes a file of the bench.
    fn edit(&self, name: &str, changes: &[(&str, &str)]) {
        let path = self.folder.path().join(name);
        let mut text = fs::read_to_string(&path).unwrap();
        for (old, new) in changes {
            assert!(text.contains(old), "{old}");
            text = text.replace(old, new);
        }
        fs::write(path, text).unwrap();
    }

    /// Values with their standard uncertainties of the last record of a kind.
    fn last_values(&self, kind: &str) -> Vec<(f64, f64)> {
        let folder = self.folder.path().join("data/calibrations");
        let mut paths: Vec<_> =
            fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.retain(|path| path.file_name().unwrap().to_str().unwrap().starts_with(kind));
        paths.sort();
        let record: toml::Table =
            fs::read_to_string(paths.last().unwrap()).unwrap().parse().unwrap();
        let number = |value: &toml::Value, key: &str| value[key].as_float().unwrap();
        let values = record["values"].as_array().unwrap().iter();
        values
            .map(|value| (number(value, "value"), number(value, "standard_uncertainty")))
            .collect()
    }
}

/// A bench as its rig file says, but for a small zero of its table.
const DESCRIBED: Truth =
    Truth { mm_per_step: 0.001, zero_mm: 0.0, deg_per_step: 0.01, zero_deg: 0.05 };

#[test]
fn ends_of_the_travel_are_found_and_soft_limits_outside_of_them_are_to_be_changed() {
    let mut chance = Stream::new(117, 0);
    for seed in 0..6 {
        let bench = Bench::new(DESCRIBED, seed, 0.05);
        let low = 8.0 * chance.uniform() - 2.0;
        let high = 44.0 + 6.5 * chance.uniform();
        let (clamp, tip) = (-50.0 - 12.0 * chance.uniform(), 50.0 + 12.0 * chance.uniform());
        let linear = format!("travel_mm = [{low}, {high}]");
        let rotary = format!("travel_deg = [{clamp}, {tip}]");
        bench.edit(
            "scene.toml",
            &[("travel_mm = [0, 50]", &linear), ("travel_deg = [-60, 60]", &rotary)],
        );
        let rounds = bench.commission();
        let found = bench.last_values("limits-");
        let truths = [high, low, tip - 0.05, clamp - 0.05];
        for ((value, sigma), truth) in found.into_iter().zip(truths) {
            // The zero of the table is within the limit of the step before.
            let also = if truth.abs() > 48.0 { 0.35 } else { 0.0 };
            assert!(
                (value - truth).abs() < 3.0 * sigma + also,
                "{rounds:?}: {value} {sigma} {truth}"
            );
        }
        let (linear, rotary) = (bench.rig().limits.linear, bench.rig().limits.rotary);
        assert!(linear.soft().max.value() <= high - 1.9 && linear.soft().min.value() >= low + 1.0);
        assert!(rotary.soft().max.value() <= tip - 1.5 && rotary.soft().min.value() >= clamp + 1.5);
        let home = bench.rigd(&["home"]);
        assert!(home.status.success(), "{}", stderr(&home));
    }
}

#[test]
fn an_axis_that_nothing_stops_is_not_accepted() {
    let bench = Bench::new(DESCRIBED, 1, 0.0);
    bench.edit("scene.toml", &[("travel_mm = [0, 50]", "travel_mm = [0, 60]")]);
    let said = bench.rigd(&["commission"]);
    assert_eq!(said.status.code(), Some(1));
    // The encoder jitters about 50.9 mm.
    for why in ["nothing stopped the linear stage up to 50.", "is 0.9 mm beyond its travel"] {
        assert!(stderr(&said).contains(why), "{}", stderr(&said));
    }
}

#[test]
fn a_drive_that_forgets_its_place_is_homed_and_one_that_homes_badly_is_refused() {
    for (seed, homing_mm, homing_deg, refused) in [
        (1, 0.0005, 0.001, None),
        (2, 0.0005, 0.001, None),
        (3, 0.02, 0.001, Some("the indicator at the carriage ranges over")),
        (4, 0.0005, 0.05, Some("the indicator at the table ranges over")),
    ] {
        let bench = Bench::new(DESCRIBED, seed, 0.0);
        bench.edit(
            "rig.toml",
            &[("register_map = \"oriental-az\"", "register_map = \"leadshine-pr\"")],
        );
        let homing = format!("homing_mm = {homing_mm}");
        let of_table = format!("homing_deg = {homing_deg}");
        bench.edit("scene.toml", &[("homing_mm = 0", &homing), ("homing_deg = 0", &of_table)]);
        let said = bench.rigd(&["commission"]);
        match refused {
            None => assert!(said.status.success(), "{}", stderr(&said)),
            Some(why) => {
                assert_eq!(said.status.code(), Some(1), "{}", stderr(&said));
                assert!(stderr(&said).contains(why), "{}", stderr(&said));
            }
        }
        let found = bench.last_values("homing-");
        let truths = [homing_mm, 1.0, homing_deg, 1.0];
        for ((value, sigma), truth) in found.into_iter().zip(truths) {
            // Readings of a scale that has an end do not show how large a large scatter is.
            let is_shown = truth < 0.01;
            assert!(!is_shown || (value - truth).abs() <= 3.5 * sigma, "{value} {sigma} {truth}");
        }
    }
}

#[test]
fn no_homing_is_let_happen_by_yes_alone() {
    let bench = Bench::new(DESCRIBED, 1, 0.0);
    bench.edit(
        "rig.toml",
        &[
            ("register_map = \"oriental-az\"", "register_map = \"leadshine-pr\""),
            ("person = \"answers\"", "person = \"waits\""),
        ],
    );
    let rig = fs::read_to_string(bench.folder.path().join("rig.toml")).unwrap();
    let data = bench.folder.path().join("data");
    commissioned::commission(&rig, &data);
    // Geometry asks for the zeros that the drives have forgotten, and homing follows.
    let remove_records = || {
        for entry in fs::read_dir(data.join("calibrations")).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap();
            if name.starts_with("geometry-") || name.starts_with("homing-") {
                fs::remove_file(&path).unwrap();
            }
        }
    };
    remove_records();
    let lengths = ["yes", "30", "30", "30", "4", "4", "4", "0.3", "0.3", "0.3"];
    let answers = [&lengths[..], &["yes"; 3]].concat();
    let answers: Vec<_> = answers.iter().flat_map(|answer| ["--answer", answer]).collect();
    let again = [&["commission", "--yes"][..], &answers].concat();
    let said = bench.rigd(&again);
    assert_eq!(said.status.code(), Some(1), "{}", stderr(&said));
    let why = "the input ended before this was answered: whether a drive may find its zero, which `--yes` does not answer";
    assert!(stderr(&said).contains(why), "{}", stderr(&said));
    remove_records();
    let said = bench.rigd(&[&again[..], &["--answer", "no"]].concat());
    let why = "rotary stage: its drive was not let find its zero";
    assert!(stderr(&said).contains(why), "{}", stderr(&said));
}

/// A bench that needs no step of commissioning, with these values of its scene.
fn described(seed: u64, nuisances: &[(&str, &str)]) -> Bench {
    let truth = Truth { mm_per_step: 0.001, zero_mm: 0.0, deg_per_step: 0.01, zero_deg: 0.0 };
    let bench = Bench::new(truth, seed, 0.0);
    bench.edit("scene.toml", nuisances);
    bench
}

#[test]
fn a_sensor_that_drifts_or_softens_is_refused_and_one_that_has_changed_too() {
    let soft = [("level_hz_per_v2 = 0", "level_hz_per_v2 = -0.02")];
    let warm = [("warm_up_hz = 0.3", "warm_up_hz = 6")];
    for (seed, nuisances, refused) in
        [(2, &soft[..], "sensor.level is -"), (3, &warm[..], "sensor.drift is ")]
    {
        let bench = described(seed, nuisances);
        let said = bench.rigd(&["commission", "sensor"]);
        assert_eq!(said.status.code(), Some(1), "{}", stderr(&said));
        assert!(stderr(&said).contains(refused), "{}", stderr(&said));
        let found = bench.last_values("sensor-");
        // The level from a half to five volts, by the scene.
        let truth = if refused.contains("level") { -0.495 } else { 0.0 };
        let (level, sigma) = found[2];
        assert!((level - truth).abs() < 4.0 * sigma, "{level} ± {sigma}, {truth} in truth");
    }
    // Another sensor is not the one of the record before.
    let bench = described(1, &[]);
    let said = bench.rigd(&["commission", "sensor"]);
    assert!(said.status.success(), "{}", stderr(&said));
    bench.edit("scene.toml", &[("length_mm = 35", "length_mm = 34.8")]);
    let said = bench.rigd(&["commission", "sensor"]);
    assert_eq!(said.status.code(), Some(1));
    assert!(stderr(&said).contains("sensor.resonance was 140."), "{}", stderr(&said));
    // Nor is it when it is asked for again.
    let said = bench.rigd(&["commission", "sensor"]);
    assert_eq!(said.status.code(), Some(1));
    assert!(stderr(&said).contains("sensor.resonance was 140."), "{}", stderr(&said));
}

#[test]
fn play_of_the_screw_is_not_taken_for_its_scale() {
    let bench = described(5, &[("linear_backlash_mm = 0.002", "linear_backlash_mm = 0.1")]);
    bench.rigd(&["commission"]);
    let (scale, sigma) = bench.last_values("scale-")[0];
    assert!((scale - 1.0).abs() < 3.5 * sigma, "{scale} ± {sigma}");
}

#[test]
fn a_selftest_moves_a_bench_in_service_alone_and_says_what_its_records_show() {
    let bench = Bench::new(DESCRIBED, 5, 0.0);
    let text = |args: &[&str]| {
        let output = bench.rigd(args);
        (output.status.code(), String::from_utf8(output.stdout).unwrap())
    };
    let (code, said) = text(&["selftest", "--level", "motion"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("problem  bench, in service: "), "{said}");
    assert!(said.contains("not commissioned") && !said.contains("rest beside"), "{said}");
    assert!(said.contains("problem  calibrations, limits: no record that holds: never made"));
    assert_eq!(bench.commission(), (1, 0));
    assert!(bench.rigd(&["home"]).status.success());
    let (code, said) = text(&["selftest", "--level", "motion"]);
    assert_eq!(code, Some(0), "{said}");
    for line in [
        "ok       linear stage, rest beside the target, 10 moves: 0.00",
        "ok       rotary stage, rest beside the target, 15 moves: ",
        "ok       calibrations, limits: accepted ",
        "ok       calibrations, linear stage after its power was off: 0.000",
    ] {
        assert!(said.contains(line), "{said}\ndoes not say: {line}");
    }
    let (code, said) = text(&["selftest", "--level", "metrology"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("problem  calibrations, sensor: no record that holds"), "{said}");
    assert!(said.contains("`rigd commission sensor`"), "{said}");
}
