//! Every make of analyzer and drive carries a whole run.

use std::fs;

use rig_engine::RunStatus;
use rig_store::Record;
use rig_tests::{TestRig, shipped};

/// Replays the short protocol on a rig of other makes and compares its shifts with those of the
/// shipped one.
async fn check(changes: &[(&str, &str)], level_v: &str) {
    let smoke = fs::read_to_string(shipped("config/protocols/smoke.toml")).unwrap();
    let smoke = smoke.replace("level_v = 5", &format!("level_v = {level_v}"));
    let rig = TestRig::open_changed(changes).await;
    let (run, ending) = rig.run(rig.protocol(&smoke)).await;
    assert_eq!(ending, RunStatus::Completed, "{changes:?}");
    let mut touches = 0;
    for stored in rig.records(run) {
        if let Record::TouchResult(touch) = stored.record().unwrap() {
            touches += 1;
            // Samples 1 and 5 of the scene, from 0° to 45°, with their scatter.
            let (low_hz, high_hz) =
                if touch.touch.sample == "1" { (4.0, 10.0) } else { (55.0, 105.0) };
            assert!(low_hz < touch.shift_hz && touch.shift_hz < high_hz, "{changes:?}: {touch:?}");
            assert!((touch.indentation_mm - 0.5).abs() < 0.02, "{changes:?}: {touch:?}");
        }
    }
    assert_eq!(touches, 18, "{changes:?}");
    rig.close().await;
}

const SERIAL_ANALYZER: &str = r#"{ serial = "/dev/serial/by-id/analyzer", baud = 38400 }"#;
const HIOKI: &str = r#"dialect = "hioki-im3536""#;
const AZ: &str = r#"register_map = "oriental-az""#;

#[tokio::test]
async fn every_make_of_analyzer_carries_a_run() {
    let tcp = (SERIAL_ANALYZER, r#"{ tcp = "127.0.0.1:5025" }"#);
    let level = |volt| ("max_level_v = 5", volt);
    check(&[], "5").await;
    check(&[(HIOKI, r#"dialect = "keysight-e4980a""#), level("max_level_v = 2"), tcp], "2").await;
    check(&[(HIOKI, r#"dialect = "keysight-e4990a""#), level("max_level_v = 1"), tcp], "1").await;
    check(&[(HIOKI, r#"dialect = "hp-4284a""#), level("max_level_v = 2"), tcp], "2").await;
    check(&[(HIOKI, r#"dialect = "tonghui-th283x""#), level("max_level_v = 2")], "2").await;
}

/// The instruments of a user: copies of shipped files under other names, with other spellings of the same messages.
#[tokio::test]
async fn instruments_with_files_of_their_own_carry_a_run() {
    let scratch = tempfile::TempDir::new().unwrap();
    let copy = |shipped_name: &str, name: &str, changes: &[(&str, &str)]| {
        let path = shipped(&format!("config/instruments/{shipped_name}.toml"));
        let mut text = fs::read_to_string(path).unwrap();
        let own_name = (format!("name = {shipped_name:?}"), format!("name = {name:?}"));
        let changes = changes.iter().map(|(old, new)| (old.to_string(), new.to_string()));
        for (old, new) in changes.chain([own_name]) {
            assert!(text.contains(&old), "{old}");
            text = text.replacen(&old, &new, 1);
        }
        let path = scratch.path().join(format!("{name}.toml"));
        fs::write(&path, text).unwrap();
        path
    };
    let analyzer = copy(
        "keysight-e4980a",
        "lab-meter",
        &[
            (":FREQuency {frequency_hz}", ":FREQ {frequency_hz:.3}HZ"),
            ("IMPedance RX", "IMPedance ZTR"),
            ("\"resistance_ohm\", \"reactance_ohm\"", "\"impedance_ohm\", \"phase_rad\""),
        ],
    );
    let drive = copy("oriental-az", "lab-drive", &[]);
    let dialect = format!("dialect = {analyzer:?}");
    let map = format!("register_map = {drive:?}");
    let changes = [
        (HIOKI, &*dialect),
        (AZ, &*map),
        ("max_level_v = 5", "max_level_v = 2"),
        (SERIAL_ANALYZER, r#"{ tcp = "127.0.0.1:5025" }"#),
        ("baud = 115200 }", r#"baud = 115200, parity = "even" }"#),
    ];
    check(&changes, "2").await;
}

#[tokio::test]
async fn every_make_of_drive_carries_a_run() {
    let steps = ("mm_per_step = 0.001", "mm_per_step = 0.01");
    let tolerance = ("tolerance_mm = 0.002", "tolerance_mm = 0.01");
    check(&[(AZ, r#"register_map = "iai-rc""#), steps, tolerance], "5").await;
    check(&[(AZ, r#"register_map = "leadshine-pr""#)], "5").await;
    let bus = r#"{ serial = "/dev/serial/by-id/drives", baud = 115200 }"#;
    check(&[(bus, r#"{ tcp = "127.0.0.1:502" }"#)], "5").await;
}
