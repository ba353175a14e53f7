//! A bench that clients of a daemon commission.

// Signals and modes of files are of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/program.rs"]
mod program;

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
    time::Instant,
};

use program::{PATIENCE, Program, ask, post, request};
use rig_store::{Reader, Record, StoredRecord};
use rustix::process::Signal;
use serde_json::Value;
use tempfile::TempDir;

fn config(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(path)
}

/// A daemon with a bench that its rig file describes but for a small zero of the table, which the rig does not know.
struct Daemon {
    folder: TempDir,
    program: Program,
    address: String,
}

impl Daemon {
    fn start(person: &str) -> Self {
        let folder = TempDir::new().unwrap();
        let path = |name: &str| folder.path().join(name);
        let mut scene = fs::read_to_string(config("scenes/new-bench.toml")).unwrap();
        for (old, new) in [
            ("mm_per_step = 0.00102", "mm_per_step = 0.001"),
            ("deg_per_step = -0.01", "deg_per_step = 0.01"),
            ("zero_deg = 0.8", "zero_deg = 0.05"),
            ("wrong_answers = 0.1", "wrong_answers = 0"),
        ] {
            assert!(scene.contains(old), "{old}");
            scene = scene.replacen(old, new, 1);
        }
        fs::write(path("scene.toml"), scene).unwrap();
        let rig = fs::read_to_string(config("rigs/simulated.toml")).unwrap();
        let rig = rig.replacen("../scenes/paper.toml", "scene.toml", 1);
        let rig = rig.replacen("person = \"answers\"", &format!("person = \"{person}\""), 1);
        fs::write(path("rig.toml"), rig).unwrap();
        Self::serve(folder, "smoke.toml")
    }

    /// A daemon with the bench of a folder, and a shipped protocol.
    fn serve(folder: TempDir, protocol: &str) -> Self {
        let path = |name: &str| folder.path().join(name);
        let protocol = config("protocols").join(protocol);
        let mut command = Command::new(env!("CARGO_BIN_EXE_rigd"));
        command
            .args(["serve", protocol.to_str().unwrap()])
            .args(["--listen", "127.0.0.1:0", "--operator", "Ada"])
            .args(["--rig", path("rig.toml").to_str().unwrap()])
            .args(["--data", path("data").to_str().unwrap()]);
        let mut program = Program::spawn(&mut command, path("data"));
        let address = program.wait_for_address();
        Self { folder, program, address }
    }

    fn post(&self, path: &str, body: &str) -> (u16, Value) {
        parts(&post(&self.address, path, body))
    }

    /// A command of a person; `post` is of Ada, the operator of the daemon.
    fn post_by(&self, person: &str, path: &str, body: &str) -> (u16, Value) {
        let length = body.len();
        let headers = format!(
            "content-type: application/json\r\ncontent-length: {length}\r\nx-operator: {person}\r\n"
        );
        parts(&ask(&self.address, &format!("POST /api/v1/{path}"), &headers, body))
    }

    /// Who gave the commands that begin with these words, in the order of the journal.
    fn who(&self, command: &str) -> Vec<String> {
        let reader = Reader::open(&self.folder.path().join("data")).unwrap();
        let who = |stored: &StoredRecord| match stored.record().unwrap() {
            Record::Operator(operator) if operator.action.starts_with(command) => {
                Some(operator.who)
            }
            _ => None,
        };
        reader.events_after(0, 10_000).unwrap().iter().filter_map(who).collect()
    }

    fn show(&self) -> Value {
        parts(&request(&self.address, "GET /api/v1/commission", "")).1
    }

    /// Waits until the commissioning is as wanted.
    fn wait(&self, what: &str, is_wanted: impl Fn(&Value) -> bool) -> Value {
        let began = Instant::now();
        let mut view = self.show();
        while !is_wanted(&view) {
            assert!(began.elapsed() < PATIENCE, "gave up waiting for {what}: {view}");
            view = self.show();
        }
        view
    }

    /// Runs its protocol to the end. What sweeps on a block find may be refused.
    fn run(&self) {
        let began = Instant::now();
        let begun = loop {
            let (status, begun) = self.post("runs", "");
            if status == 202 {
                break begun;
            }
            // The rig is still brought into service, or ends the run before.
            assert!(status == 409 && began.elapsed() < PATIENCE, "{status}: {begun}");
        };
        let path = format!("GET /api/v1/runs/{}", begun["id"].as_str().unwrap());
        loop {
            let run = parts(&request(&self.address, &path, "")).1;
            match run["status"].as_str().unwrap() {
                "running" => assert!(began.elapsed() < PATIENCE, "gave up waiting: {run}"),
                status => return assert!(status.starts_with("completed"), "{run}"),
            }
        }
    }

    fn end(self) {
        self.program.signal(Signal::TERM);
        self.program.end();
    }
}

/// Status and body of an answer.
fn parts(answer: &str) -> (u16, Value) {
    let status = answer.split(' ').nth(1).unwrap().parse().unwrap();
    let body = answer.split_once("\r\n\r\n").unwrap().1;
    let json = body.find('{').map(|begin| &body[begin..=body.rfind('}').unwrap()]);
    (status, json.map_or(Value::Null, |json| serde_json::from_str(json).unwrap()))
}

#[test]
fn a_bench_is_commissioned_over_http_and_goes_into_service_without_a_new_start() {
    let daemon = Daemon::start("answers");
    let refused = daemon.post("moves", r#"{"axis": "linear", "to": 30}"#);
    assert_eq!(refused.0, 409, "{}", refused.1);
    let view = daemon.show();
    let steps = view["steps"].as_array().unwrap();
    assert_eq!(steps.len(), 6);
    assert!(steps.iter().all(|step| step["is_held"] == false && step["why"] == "never made"));
    assert!(steps[0]["picture"].as_str().unwrap().contains("stop"));
    let (status, view) = daemon.post("commission", "{}");
    assert_eq!(status, 202, "{view}");
    let view = daemon.wait("the end of the commissioning", |view| view["under_way"].is_null());
    let last = view["said"].as_array().unwrap().last().unwrap();
    assert_eq!(last, "The rig is commissioned, and goes into service.", "{view}");
    assert!(view["steps"].as_array().unwrap().iter().all(|step| step["is_held"] == true));
    assert_eq!(view["steps"][0]["person"], "simulated person");
    let records = fs::read_dir(daemon.folder.path().join("data/calibrations")).unwrap();
    // One for each step, and one of the beginning of the homing.
    assert_eq!(records.count(), steps.len() + 1);
    let began = Instant::now();
    loop {
        let (status, answer) = daemon.post("moves", r#"{"axis": "linear", "to": 30}"#);
        if status == 202 {
            break;
        }
        // The rig is brought into service: it retracts first.
        assert!(began.elapsed() < PATIENCE, "{status}: {answer}");
    }
    let again = daemon.post("commission", "{}");
    assert_eq!(again.0, 409, "{}", again.1);
    daemon.end();
}

/// A daemon on the bench of the daily check, which its rig file describes.
fn daily() -> Daemon {
    daily_with(&[])
}

/// A daemon of the daily bench with these values of its scene.
fn daily_with(nuisances: &[(&str, &str)]) -> Daemon {
    daily_of(nuisances, "touches.toml")
}

/// The same with a protocol.
fn daily_of(nuisances: &[(&str, &str)], protocol: &str) -> Daemon {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut scene = fs::read_to_string(config("scenes/daily.toml")).unwrap();
    for (old, new) in nuisances {
        assert!(scene.contains(old), "{old}");
        scene = scene.replacen(old, new, 1);
    }
    fs::write(path("scene.toml"), scene).unwrap();
    let rig = fs::read_to_string(config("rigs/simulated.toml")).unwrap();
    fs::write(path("rig.toml"), rig.replacen("../scenes/paper.toml", "scene.toml", 1)).unwrap();
    Daemon::serve(folder, protocol)
}

impl Daemon {
    fn sensor(&self) -> Value {
        parts(&request(&self.address, "GET /api/v1/commission/sensor", "")).1
    }

    /// Begins a check of the sensor as soon as the rig is in service.
    fn begin_sensor(&self, form: &str) {
        let began = Instant::now();
        loop {
            let (status, view) = self.post("commission/sensor", form);
            if status == 202 {
                return assert_eq!(view["is_under_way"], true, "{view}");
            }
            assert!(status == 409 && began.elapsed() < PATIENCE, "{status}: {view}");
        }
    }

    /// Waits until the check of the sensor is as wanted.
    fn wait_for_sensor(&self, is_wanted: impl Fn(&Value) -> bool) -> Value {
        let began = Instant::now();
        loop {
            let view = self.sensor();
            if is_wanted(&view) {
                return view;
            }
            assert!(began.elapsed() < PATIENCE, "gave up waiting: {view}");
        }
    }
}

#[test]
fn the_free_sensor_is_checked_over_http_and_its_record_holds_if_it_is_accepted() {
    for (level, verdict, truth) in [("0", "accepted", 0.0), ("-0.02", "failed", -0.495)] {
        let level = format!("[nuisances]\nlevel_hz_per_v2 = {level}");
        let daemon = daily_with(&[("[nuisances]", &level)]);
        assert_eq!(daemon.sensor()["why"], "never made");
        daemon.begin_sensor(r#"{"temperature_c": 21.5}"#);
        let view = daemon.wait_for_sensor(|view| view["is_under_way"] == false);
        let found = &view["found"];
        assert_eq!((&found["verdict"], &view["refused"]), (&verdict.into(), &0.into()), "{view}");
        let shift = &found["values"][2];
        let [value, sigma] =
            ["value", "standard_uncertainty"].map(|key| shift[key].as_f64().unwrap());
        assert_eq!(shift["name"], "sensor.level");
        assert!((value - truth).abs() < 4.0 * sigma, "{value} ± {sigma}, {truth} in truth");
        let file = found["file"].as_str().unwrap();
        let record = daemon.folder.path().join("data/calibrations").join(file);
        let text = fs::read_to_string(record).unwrap();
        assert!(text.contains("person = \"Ada\"") && text.contains("temperature_c = 21.5"));
        match verdict {
            "accepted" => assert_eq!(view["record"]["person"], "Ada", "{view}"),
            _ => assert_eq!(view["why"], "failed", "{view}"),
        }
        daemon.end();
    }
}

#[test]
fn a_check_of_the_sensor_needs_a_clear_probe_and_an_idle_rig_and_an_abort_leaves_no_record() {
    let daemon = daily_with(&[]);
    let form = r#"{"minutes": 1440}"#;
    let (status, why) = daemon.post("commission/sensor", r#"{"minutes": 0}"#);
    assert_eq!(status, 422, "{why}");
    assert_eq!(why["detail"], "minutes = 0: must lie between 1 and 1440 min");
    let (status, why) = daemon.post("commission/sensor", r#"{"min_hz": 160, "max_hz": 120}"#);
    assert_eq!(status, 422, "{why}");
    assert_eq!(daemon.post("commission/sensor/abort", "").0, 409);
    daemon.begin_sensor(form);
    assert_eq!(daemon.post("commission/sensor", form).0, 409);
    daemon.wait_for_sensor(|view| view["sweeps"].as_u64() >= Some(3));
    assert_eq!(daemon.post("commission/sensor/abort", "").0, 202);
    let view = daemon.wait_for_sensor(|view| view["is_under_way"] == false);
    assert_eq!((&view["trouble"], &view["found"]), (&"aborted".into(), &Value::Null), "{view}");
    assert!(!daemon.folder.path().join("data/calibrations").exists());
    // Another command of a client takes the rig: a sweep of it, or the time between two.
    daemon.begin_sensor(form);
    daemon.wait_for_sensor(|view| view["sweeps"].as_u64() >= Some(1));
    assert_eq!(daemon.post("stop", "").0, 200);
    let view = daemon.wait_for_sensor(|view| view["is_under_way"] == false);
    assert!(view["trouble"].is_string() && view["found"].is_null(), "{view}");
    let (status, why) = daemon.post("commission/sensor", form);
    assert_eq!(status, 409, "{why}");
    daemon.end();
}

#[test]
fn touches_on_a_block_are_judged_over_http_and_the_next_run_cites_them() {
    let daemon = daily();
    let early = daemon.post("commission/touches", r#"{"run": "touches-1"}"#);
    assert_eq!(early.0, 404, "{}", early.1);
    daemon.run();
    let (status, made) = daemon.post("commission/touches", r#"{"run": "latest"}"#);
    assert_eq!((status, &made["verdict"]), (201, &Value::from("accepted")), "{made}");
    let value = |index: usize| made["values"][index]["value"].as_f64().unwrap();
    let sigma = |index: usize| made["values"][index]["standard_uncertainty"].as_f64().unwrap();
    // The scene puts the surface there, its screw errs by 2 µm, and no touch finds it better than its fine step of 4 µm.
    assert!((value(0) - 10.03).abs() < 0.01, "{made}");
    assert!(value(1).abs() < 4.0 * sigma(1), "{made}");
    assert!((0.000_2..0.002).contains(&value(2)), "{made}");
    let file = made["file"].as_str().unwrap();
    assert!(daemon.folder.path().join("data/calibrations").join(file).exists());
    for (path, expected) in
        [("blocks", "different tilts"), ("latency", "0 touches found by a descent")]
    {
        let (status, why) = daemon.post(&format!("commission/{path}"), r#"{"run": "latest"}"#);
        assert!(status == 422 && why.to_string().contains(expected), "{status}: {why}");
    }
    daemon.run();
    let records = request(&daemon.address, "GET /api/v1/runs/latest/export?format=jsonl", "");
    assert!(records.contains(file), "the run does not cite {file}");
    let checks = parts(&request(&daemon.address, "GET /api/v1/checks", "")).1;
    assert_eq!(checks, serde_json::json!({"checks": [], "quantities": []}));
    let trend = request(&daemon.address, "GET /api/v1/checks/trend", "");
    assert!(trend.contains("text/html") && trend.contains("simulated bench"), "{trend}");
    daemon.end();
}

#[test]
fn the_radius_of_the_ball_is_found_over_http_by_a_run_on_a_pin_alone() {
    let daemon = daily();
    daemon.run();
    let on_block = daemon.post("commission/pin", r#"{"run": "latest", "pin_radius_mm": 2}"#);
    assert_eq!(on_block.0, 422, "{}", on_block.1);
    let why = on_block.1["detail"].as_str().unwrap();
    assert!(why.contains("without geometry.pin_radius_mm"), "{why}");
    daemon.end();

    let folder = TempDir::new().unwrap();
    let scene = fs::read_to_string(config("scenes/daily.toml")).unwrap();
    let scene = scene.replacen("name = \"block\"", "name = \"pin\"", 1);
    let scene = scene.replacen("[place]", "[place]\npin_mm = 2", 1);
    fs::write(folder.path().join("scene.toml"), scene).unwrap();
    let rig = fs::read_to_string(config("rigs/simulated.toml")).unwrap();
    let rig = rig.replacen("../scenes/paper.toml", "scene.toml", 1);
    let rig = rig.replacen("# pin_radius_mm = 2", "pin_radius_mm = 2", 1);
    fs::write(folder.path().join("rig.toml"), rig).unwrap();
    let daemon = Daemon::serve(folder, "pin.toml");
    daemon.run();
    let form = |radius: &str| format!(r#"{{"run": "pin-1", "pin_radius_mm": {radius}}}"#);
    for radius in ["0", "2.1"] {
        let (status, why) = daemon.post("commission/pin", &form(radius));
        assert_eq!(status, 422, "{why}");
    }
    let (status, made) = daemon.post("commission/pin", &form("2"));
    // The rotary axis is known by a rule alone.
    assert_eq!((status, &made["verdict"]), (201, &Value::from("failed")), "{made}");
    assert_eq!(made["values"][0]["name"], "geometry.probe_radius_mm", "{made}");
    let file = made["file"].as_str().unwrap();
    assert!(daemon.folder.path().join("data/calibrations").join(file).exists());
    daemon.end();
}

#[test]
fn the_geometry_is_found_over_http_by_a_run_on_a_block() {
    let daemon = daily_of(&[], "block.toml");
    daemon.run();
    let (status, made) = daemon.post("commission/blocks", r#"{"run": "latest"}"#);
    assert_eq!(status, 201, "{made}");
    let surface = &made["values"][0];
    assert_eq!(surface["name"], "geometry.surface_mm", "{made}");
    let (value, sigma) =
        (surface["value"].as_f64().unwrap(), surface["standard_uncertainty"].as_f64().unwrap());
    assert!((value - 10.03).abs() < 3.0 * sigma && sigma < 0.05, "{made}");
    // The same block is no second one: its touches say that it is not higher.
    let twice = r#"{"run": "latest", "raised": [{"run": "latest", "by_mm": 10}]}"#;
    let (status, why) = daemon.post("commission/blocks", twice);
    assert_eq!(status, 422, "{why}");
    daemon.end();
}

/// What a person at the bench knows of it: where the axes are, and which way the last step went. A real bench shows it to
/// the eye; this one says it in the words of its drives, which are right.
#[derive(Debug, Default)]
struct Eye {
    /// The last question.
    asked: String,
    /// Place and last step of the linear and of the rotary stage.
    axes: [(f64, f64); 2],
    /// Where they were when the test indicators were set to zero.
    zeros: [f64; 2],
}

const AXES: [&str; 2] = ["linear stage", "rotary stage"];

impl Eye {
    /// Reads what was said since the last question, and then the question.
    fn look(&mut self, view: &Value, question: &str) {
        let said: Vec<&str> =
            view["said"].as_array().unwrap().iter().map(|line| line.as_str().unwrap()).collect();
        let is_last = |line: &&str| !self.asked.is_empty() && line.starts_with(&self.asked);
        let begin = said.iter().rposition(is_last).map_or(0, |last| last + 1);
        for (index, axis) in AXES.into_iter().enumerate() {
            for line in &said[begin..] {
                let Some(way) = line.strip_prefix(&format!("{axis}: ")) else { continue };
                let Some((from, at)) = way.split_once(" → ") else { continue };
                let place = |text: &str| text.split(' ').next().unwrap().parse::<f64>().unwrap();
                self.axes[index] = (place(at), place(at) - place(from));
            }
            if question.contains(&format!("the {axis} moves by ")) {
                self.axes[index].1 = 0.0;
            }
        }
        if question.starts_with("Set a test indicator") {
            self.zeros = self.axes.map(|(at, _)| at);
        }
        question.clone_into(&mut self.asked);
    }

    /// What this person answers. The lengths are those of the scene.
    fn answer(&self) -> String {
        let text = self.asked.as_str();
        let [(height, rose), (tilt, sank)] = self.axes;
        let seen = |step: f64, [up, down, still]: [&str; 3]| {
            let word = if step > 0.0 { up } else { down };
            (if step.abs() < 0.01 { still } else { word }).to_owned()
        };
        match text {
            _ if text.contains("Where did the probe go") => seen(rose, ["up", "down", "nowhere"]),
            _ if text.contains("Which edge") => seen(sank, ["tip", "clamp", "neither"]),
            _ if text.starts_with("Dial gauge") => format!("{rose:.2}"),
            _ if text.starts_with("Angle gauge") => format!("{:.1}", tilt + 0.05),
            _ if text.contains("how far can the carriage") => format!("{height:.1}"),
            _ if text.starts_with("Test indicator at the carriage") => {
                format!("{:.3}", height - self.zeros[0])
            }
            _ if text.starts_with("Test indicator at the edge") => {
                format!("{:.3}", 20.0 * (tilt - self.zeros[1]).to_radians())
            }
            _ if text.contains("the gap") => format!("{:.1}", height - 10.03),
            _ if text.contains("the height of that surface") => "4.0".to_owned(),
            _ if text.contains("the distance of the probe") => "0.3".to_owned(),
            _ => "yes".to_owned(),
        }
    }
}

impl Daemon {
    /// Waits for a question after the one with this number, or for the end.
    fn wait_for_question(&self, answered: u64) -> Value {
        self.wait("a question, or the end", |view| {
            let number = view["question"]["number"].as_u64();
            view["under_way"].is_null() || number.is_some_and(|number| number > answered)
        })
    }

    /// Answers the question of this view as this person. Returns its number and the answer.
    fn answer_by(&self, person: &str, eye: &mut Eye, view: &Value) -> (u64, String) {
        let question = &view["question"];
        eye.look(view, question["text"].as_str().unwrap());
        let (number, answer) = (question["number"].as_u64().unwrap(), eye.answer());
        let body = serde_json::json!({ "question": number, "answer": answer }).to_string();
        let (status, view) = self.post_by(person, "commission/answer", &body);
        assert_eq!(status, 202, "{view}");
        (number, answer)
    }
}

#[test]
fn a_person_commissions_a_bench_over_http_to_the_end() {
    let daemon = Daemon::start("waits");
    let (status, problem) = daemon.post("commission", r#"{"temperature_c": -400}"#);
    assert_eq!(status, 422, "{problem}");
    assert!(problem["detail"].as_str().unwrap().contains("between -50 °C and 100 °C"), "{problem}");
    let (status, view) = daemon.post("commission", r#"{"temperature_c": 21.5}"#);
    assert_eq!(status, 202, "{view}");
    let (mut eye, mut answered, mut still) = (Eye::default(), 0, 0);
    loop {
        let view = daemon.wait_for_question(answered);
        if view["under_way"].is_null() {
            break;
        }
        let (number, answer) = daemon.answer_by("Ada", &mut eye, &view);
        still += usize::from(["nowhere", "neither"].contains(&answer.as_str()));
        answered = number;
    }
    let view = daemon.show();
    let last = view["said"].as_array().unwrap().last().unwrap();
    assert_eq!(last, "The rig is commissioned, and goes into service.", "{view}");
    for step in view["steps"].as_array().unwrap() {
        assert_eq!((&step["is_held"], &step["person"]), (&true.into(), &"Ada".into()), "{step}");
    }
    // Two looks at each axis while the stop was pressed, and two at the probe while its lower switch was.
    assert_eq!(still, 6, "{view}");
    daemon.end();
}

#[test]
fn the_record_of_a_step_names_who_answered_and_not_who_began() {
    let daemon = Daemon::start("waits");
    assert_eq!(daemon.post("commission", "{}").0, 202);
    let (mut eye, mut answered) = (Eye::default(), 0);
    let view = loop {
        let view = daemon.wait_for_question(answered);
        if view["under_way"] == "geometry" {
            break view;
        }
        // Ada begins, and Bob takes over before the first motion.
        let person = if answered < 2 { "Ada" } else { "Bob" };
        (answered, _) = daemon.answer_by(person, &mut eye, &view);
    };
    let persons = |index: usize| (&view["steps"][index]["step"], &view["steps"][index]["person"]);
    assert_eq!(persons(0), (&"stop".into(), &"Ada, Bob".into()), "{view}");
    assert_eq!(persons(1), (&"signs".into(), &"Bob".into()), "{view}");
    // Each motion is of the one who has let it happen.
    let moved = daemon.who("step the ");
    assert!(!moved.is_empty() && moved.iter().all(|who| who == "Bob"), "{moved:?}: {view}");
    daemon.end();
}

#[test]
fn a_stop_while_a_bench_is_commissioned_is_on_record_with_who_stopped() {
    let daemon = Daemon::start("waits");
    assert_eq!(daemon.post("commission", "{}").0, 202);
    daemon.wait_for_question(0);
    assert!(daemon.who("stop").is_empty());
    let (status, view) = daemon.post_by("Bob", "stop", "");
    assert_eq!(status, 200, "{view}");
    assert_eq!(daemon.who("stop"), ["Bob"]);
    // The commissioning goes on with its question.
    assert_eq!(daemon.show()["question"]["number"], 1);
    daemon.end();
}

#[test]
fn a_client_answers_by_number_and_an_abort_leaves_no_record() {
    let daemon = Daemon::start("waits");
    assert_eq!(daemon.post("commission/answer", r#"{"question": 1, "answer": "yes"}"#).0, 409);
    assert_eq!(daemon.post("commission/abort", "").0, 409);
    assert_eq!(daemon.post("commission", "{}").0, 202);
    let asked = |number: u64| {
        daemon.wait("a question", |view| view["question"]["number"].as_u64() == Some(number))
    };
    let first = asked(1);
    assert_eq!(first["under_way"], "stop");
    assert_eq!(first["question"]["choices"], serde_json::json!(["yes", "no"]));
    assert_eq!(daemon.post("commission", "{}").0, 409);
    let (status, why) = daemon.post("commission/answer", r#"{"question": 1, "answer": "perhaps"}"#);
    assert_eq!((status, why["detail"].as_str().unwrap().contains("yes or no")), (422, true));
    assert_eq!(daemon.post("commission/answer", r#"{"question": 1, "answer": "yes"}"#).0, 202);
    asked(2);
    let late = daemon.post("commission/answer", r#"{"question": 1, "answer": "yes"}"#);
    assert_eq!(late.0, 409, "{}", late.1);
    assert_eq!(daemon.post("commission/abort", "").0, 202);
    let view = daemon.wait("the abort", |view| view["under_way"].is_null());
    assert_eq!(view["said"].as_array().unwrap().last().unwrap(), "step stop: aborted");
    assert!(view["question"].is_null());
    assert!(!daemon.folder.path().join("data/calibrations").exists());
    // A second start asks under a new number.
    assert_eq!(daemon.post("commission", "{}").0, 202);
    asked(3);
    daemon.end();
}

#[test]
fn a_motion_that_is_not_let_happen_shows_nothing_of_the_bench() {
    let daemon = Daemon::start("waits");
    assert_eq!(daemon.post("commission", "{}").0, 202);
    for (number, answer) in [(1, "yes"), (2, "yes"), (3, "no")] {
        let view =
            daemon.wait("a question", |view| view["question"]["number"].as_u64() == Some(number));
        let is_motion = view["question"]["text"].as_str().unwrap().ends_with("May it?");
        assert_eq!(is_motion, answer == "no", "{view}");
        let body = format!(r#"{{"question": {number}, "answer": "{answer}"}}"#);
        assert_eq!(daemon.post("commission/answer", &body).0, 202);
    }
    let view = daemon.wait("the end", |view| view["under_way"].is_null());
    let told = "step stop: not let go on, so that nothing was shown and nothing is recorded";
    assert_eq!(view["said"].as_array().unwrap().last().unwrap(), told);
    assert!(!daemon.folder.path().join("data/calibrations").exists());
    daemon.end();
}
