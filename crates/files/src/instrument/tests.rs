//! The shipped instrument files, and the faults of changed ones.

use rig_model::{AnalyzerMake, DriveMake, Parity};

use super::{
    Dialect, RegisterMap,
    dialect::CommandSet,
    drive::{EmergencyStop, RegisterContent, Step},
    shipped_text,
};

const BRIDGE: &str = include_str!("tests/bridge.toml");

fn az() -> String {
    shipped_text("oriental-az").unwrap().replacen(
        "name = \"oriental-az\"",
        "name = \"lab-drive\"",
        1,
    )
}

/// The text after changes; each old text must be there.
#[track_caller]
fn changed(text: &str, changes: &[(&str, &str)]) -> String {
    let mut text = text.to_owned();
    for (old, new) in changes {
        assert!(text.contains(old), "{old:?} is not in the file");
        text = text.replacen(old, new, 1);
    }
    text
}

#[test]
fn every_shipped_file_is_read_under_its_own_name() {
    for make in AnalyzerMake::ALL {
        let dialect = Dialect::of(make);
        assert_eq!((dialect.name.as_str(), dialect.simulated_as), (make.name(), Some(make)));
        assert_eq!(
            Dialect::read("x.toml", shipped_text(make.name()).unwrap()).unwrap_err().len(),
            1
        );
    }
    for make in DriveMake::ALL {
        let map = RegisterMap::of(make);
        assert_eq!((map.name.as_str(), map.simulated_as), (make.name(), Some(make)));
        assert_eq!(map.parity == Parity::Even, make == DriveMake::OrientalAz);
        let text = shipped_text(make.name()).unwrap();
        assert_eq!(RegisterMap::read("x.toml", text).unwrap_err().len(), 1);
    }
    assert_eq!(shipped_text("nothing"), None);
    let points =
        AnalyzerMake::ALL.map(|make| matches!(Dialect::of(make).commands, CommandSet::Points(_)));
    assert_eq!(points, [true, true, true, true, false]);
}

#[test]
fn a_text_is_kept_once() {
    let first = Dialect::read_and_keep("a.toml", BRIDGE).unwrap();
    let second = Dialect::read_and_keep("b.toml", BRIDGE).unwrap();
    assert!(std::ptr::eq(first, second));
    let text = az();
    let first = RegisterMap::read_and_keep("a.toml", &text).unwrap();
    assert!(std::ptr::eq(first, RegisterMap::read_and_keep("b.toml", &text).unwrap()));
}

#[test]
fn a_drive_starts_with_what_its_file_writes() {
    let map = RegisterMap::read("drive.toml", &az()).unwrap();
    let [Step::Registers { address: 0x58, contents }] = &map.start[..] else { panic!("{map:?}") };
    assert_eq!(contents.iter().map(|content| content.registers()).sum::<u16>(), 16);
    assert_eq!(contents[1], RegisterContent::Long(1));
    assert_eq!(map.emergency_stop, Some(EmergencyStop::Alarm(0x68)));
    assert_eq!(map.alarms.iter().find(|(code, _)| *code == 0x66).unwrap().1, "hardware overtravel");
}

/// All faults of a changed file, one a line.
#[track_caller]
fn check(found: Result<String, String>, expected: &[&str]) {
    let found = found.expect_err("the file has faults");
    let lines: Vec<_> = found.lines().collect();
    assert_eq!(lines.len(), expected.len(), "{found}");
    for (line, expected) in lines.iter().zip(expected) {
        assert!(line.contains(expected), "{line}\ndoes not say: {expected}");
    }
}

#[track_caller]
fn bridge(changes: &[(&str, &str)], expected: &[&str]) {
    let read = Dialect::read("bridge.toml", &changed(BRIDGE, changes));
    check(read.map(|dialect| dialect.name).map_err(|faults| faults.to_string()), expected);
}

#[test]
fn an_analyzer_file_is_told_all_of_its_faults_at_once() {
    bridge(
        &[
            ("frequency_hz}", "frequency}"),
            ("digits = 5\n", "digits = 5\nstep_hz = 0.1\n"),
            ("FREQ?", "FREQ"),
            ("AVER {averages}", "AVER 1"),
            ("\"status\"]", "\"state\"]"),
        ],
        &[
            "bridge.toml:14:1: [frequency_steps] needs one of `step_hz`, `digits` and `nearest_rel`",
            "`{frequency}` is not a quantity of this message; quantities are {frequency_hz}",
            "frequency has 0 questions, and needs 1; a question ends in `?`",
            "set_averages does not hold `{averages}`",
            "\"state\" in fields is not one of",
        ],
    );
    bridge(
        &[("name = \"lab-bridge\"", "name = \"hp-4284a\"")],
        &["is the name of a shipped instrument"],
    );
    bridge(&[("VOLT {level_v:.3}", "VOLT 1")], &["no message of setup sets `{level_v}`"]);
    bridge(
        &[("\"phase_deg\"", "\"reactance_ohm\"")],
        &["fields has no impedance, or more than one"],
    );
    bridge(&[("sound = [0]", "sound = [0, 2]")], &["the status 2 has two meanings; remove one"]);
    bridge(&[(", \"status\"]", "]")], &["[answer.status] is given, and fields has no \"status\""]);
    bridge(&[("cycles = 1", "# no cycles")], &["[integration] needs one of `cycles` and `times`"]);
    bridge(&[("mask = 16", "mask = 0")], &["mask = 0 is below the limit of 1"]);
    bridge(
        &[("[answer]\n", "[answers]\n")],
        &["`answers` is not a key at the top of the file", "`fields` is missing in [answer]"],
    );
}

#[test]
fn what_a_file_cannot_express_is_refused_with_the_reason() {
    bridge(
        &[("delay_max_s", "interlock = false\nloop = 3\ndelay_max_s")],
        &[
            "`interlock` is not for an instrument file: the program decides it for every rig",
            "`loop` is not for an instrument file: it needs a driver in Rust",
        ],
    );
    bridge(
        &[("trigger = \"TRIG\"", "trigger = \"TRIG;READ? \\\"A\\\"\"")],
        &[
            "trigger: `\"A\"` is not one datum of printable ASCII characters without quotation marks",
        ],
    );
    bridge(
        &[("models =", "trace = \"e4990a\"\nmodels =")],
        &["`setup` is of an", "`measure` is of an", "`integration` is of an", "`answer` is of an"],
    );
}

#[track_caller]
fn drive(changes: &[(&str, &str)], expected: &[&str]) {
    let read = RegisterMap::read("drive.toml", &changed(&az(), changes));
    check(read.map(|map| map.name).map_err(|faults| faults.to_string()), expected);
}

#[test]
fn a_drive_file_is_told_all_of_its_faults_at_once() {
    drive(
        &[
            ("position = { address = 0x0120", "position = { address = 0x0123"),
            ("ready = { address = 0x007F, bit = 5 }", "ready = { address = 0x007F, bit = 16 }"),
            ("homed = { address = 0x007F, bit = 4 }", "homed = { address = 0x0077, bit = 4 }"),
            ("\"target i32\", ", ""),
            ("{ register = 0x007D, value = 0x10 }", "{ register = 0x007D, on = true }"),
        ],
        &[
            "position: no block has the 2 registers at 0x0123",
            "ready: bit 16 of the register at 0x007f does not exist",
            "homed: no block has the register at 0x0077",
            "start does not write the target",
            "`value` is missing beside `register`",
            "`on` is not for `coil`",
        ],
    );
    drive(
        &[("{ address = 0x0120, count = 4 }", "{ address = 0x0120, count = 6 }")],
        &["6 registers are read by the block at 0x0120 and by [settings]: answers must differ"],
    );
    drive(
        &[("read = { address = 0x0380, count = 4 }", "read = { address = 0x0380, count = 6 }")],
        &["6 registers are read by [signature] and by [settings]"],
    );
    drive(&[("min = 1,", "min = 0,")], &["min = 0 admits a device that answers zeros"]);
    drive(
        &[("expect = [\"1 i32\", ", "expect = [")],
        &["expect has 4 registers, and read has 6; give as many as are read"],
    );
    drive(
        &[("values = [\"0 i32\"] },", "values = [\"target u16\", \"70000 u16\"] },")],
        &["\"target u16\" is not the content of registers", "\"70000 u16\" is not the content"],
    );
    drive(
        &[("alarm = {", "alarm_flag = { address = 0x007F, bit = 7 }\nalarm = {")],
        &["[status] needs one of `alarm` and `alarm_flag`"],
    );
    // Numbers are in registers, and the code of an alarm is in one.
    drive(
        &[("alarm = {", "alarm = { table = \"coil\",")],
        &["table = \"coil\" is not one of \"holding\", \"input\""],
    );
    drive(
        &[("read = { address = 0x0380, count = 4 }", "read = { address = 0xFFFE, count = 4 }")],
        &[
            "4 addresses from 0xfffe on reach beyond 0xffff, the last one; read fewer",
            "ranges: no block has",
            "ranges: no block has",
            "resolution: no block has",
            "resolution: no block has",
        ],
    );
}

/// Each of these would be read, and hurt on the bench.
#[test]
fn a_drive_file_that_contradicts_itself_is_refused() {
    for (old, new, why) in [
        (
            "values = [\"0 i32\"] },",
            "values = [\"target i32\"] },",
            "reset writes \"target\": only `start` makes a move",
        ),
        (
            "home = [",
            "home = [{ registers = 0x01, values = [\"speed i32\"] }, ",
            "home writes \"speed\": only `start` makes a move",
        ),
        (
            "ready = { address = 0x007F, bit = 5 }",
            "ready = { address = 0x007F, bit = 13 }",
            "moving and ready are one bit",
        ),
        (
            "command_position = { address = 0x0122",
            "command_position = { address = 0x0120",
            "command_position is read where position is",
        ),
        (
            "release_stop = [{ register = 0x007D, value = 0 }]",
            "release_stop = [{ register = 0x007D, value = 0x20 }]",
            "release_stop writes the same as stop",
        ),
        (
            "expect = [\"1 i32\", \"limit_max i32\", \"limit_min i32\"]",
            "expect = [\"1 i32\", \"limit_min i32\", \"limit_max i32\"]",
            "expect has limit_min at 0x0388, where write puts limit_max",
        ),
        (
            "{ code = 0x22,",
            "{ code = 0x21,",
            "the alarm 0x21 has two names, \"main circuit overheat\" and \"overvoltage\"",
        ),
    ] {
        drive(&[(old, new)], &[why]);
    }
    drive(&[("parity =", "recovery = 1\nparity =")], &["`recovery` is not for an instrument file"]);
}
