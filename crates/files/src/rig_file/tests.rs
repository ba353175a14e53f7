//! The shipped rig files, and the faults of changed ones.

use std::path::{Path, PathBuf};

use rig_model::{AnalyzerMake, DriveMake, LineSettings, Parity, StopBits};

use super::{Connection, Named, Pace, PortFile, RigFile};

const SIMULATED: &str = include_str!("../../../../config/rigs/simulated.toml");
const BENCH: &str = include_str!("../../../../config/rigs/bench.toml");

/// The faults of the simulated rig's file after changes of its text. Each old text must be there.
#[track_caller]
fn complaints(changes: &[(&str, &str)]) -> String {
    let mut text = SIMULATED.to_owned();
    for (old, new) in changes {
        assert!(text.contains(old), "{old:?} is not in the file");
        text = text.replacen(old, new, 1);
    }
    RigFile::read("rig.toml", &text).unwrap_err().to_string()
}

#[test]
fn the_shipped_file_names_every_make_that_there_is() {
    let analyzers = AnalyzerMake::ALL.map(AnalyzerMake::name);
    let drives = DriveMake::ALL.map(DriveMake::name);
    for name in analyzers.into_iter().chain(drives) {
        assert!(SIMULATED.contains(&format!("{name:?}")), "{name} is not in the manual");
    }
}

#[test]
fn a_rig_file_has_ports_addresses_and_positions() {
    let rig = RigFile::read("rig.toml", SIMULATED).unwrap();
    let Connection::Simulated(simulation) = &rig.connection else { panic!("{rig:?}") };
    assert_eq!(simulation.pace, Pace::Virtual);
    let scene = rig.scene(Path::new("config/rigs/simulated.toml"));
    assert_eq!(scene, Some(PathBuf::from("config/rigs/../scenes/paper.toml")));
    let path = "/dev/serial/by-id/drives".to_owned();
    assert_eq!(
        rig.bus,
        PortFile::Serial {
            path,
            line: LineSettings { baud: 115_200, parity: Parity::Even, stop_bits: StopBits::One }
        }
    );
    assert_eq!((rig.linear.unit_id, rig.rotary.unit_id), (1, 2));
    assert_eq!(rig.limits.linear.rest_target().position().value(), 24.5);
    assert_eq!(rig.linear.instrument, Named::Shipped(DriveMake::OrientalAz));
}

#[test]
fn a_real_rig_is_rehearsed_by_changing_one_word() {
    let real = RigFile::read("rig.toml", BENCH).unwrap();
    assert_eq!(real.connection, Connection::Ports);
    assert_eq!(real.scene(Path::new("bench.toml")), None);
    let text = BENCH.replacen("connection = \"ports\"", "connection = \"simulated\"", 1);
    let rehearsal = RigFile::read("rig.toml", &text).unwrap();
    assert!(matches!(rehearsal.connection, Connection::Simulated(_)));
    assert_eq!(rehearsal.limits, real.limits);
    assert_eq!(rehearsal.samples, real.samples);
}

#[test]
fn a_port_takes_the_settings_of_its_device() {
    #[track_caller]
    fn check(port: &str, expected: Result<PortFile, &str>) {
        let text =
            SIMULATED.replacen("{ serial = \"/dev/serial/by-id/drives\", baud = 115200 }", port, 1);
        let found = RigFile::read("rig.toml", &text).map(|rig| rig.bus);
        let found = found.map_err(|faults| {
            faults.iter().map(|fault| fault.message.clone()).collect::<Vec<_>>().join("; ")
        });
        assert_eq!(found, expected.map_err(str::to_owned));
    }
    let line = LineSettings { parity: Parity::Odd, baud: 9600, stop_bits: StopBits::One };
    let serial = PortFile::Serial { path: "/dev/ttyS0".into(), line };
    check("{ serial = \"/dev/ttyS0\", baud = 9600, parity = \"odd\" }", Ok(serial));
    for path in ["COM3", "COM10", r"\\.\COM10", "/dev/cu.usbserial-1410", "/dev/cu.SLAB_USBtoUART"]
    {
        let serial = PortFile::Serial { path: path.into(), line };
        check(&format!("{{ serial = '{path}', baud = 9600, parity = \"odd\" }}"), Ok(serial));
    }
    let tcp = PortFile::Tcp { address: "[::1]:502".into() };
    check("{ tcp = \"[::1]:502\" }", Ok(tcp));
    check("{}", Err("a port is serial or tcp"));
    check(
        "{ serial = \"a\", tcp = \"b:1\", baud = 9600 }",
        Err("a port is serial or tcp, not several of them"),
    );
    check(
        "{ usbtmc = \"/dev/usbtmc0\" }",
        Err("usbtmc is for the analyzer: the drives are on a line for Modbus"),
    );
    check("{ serial = \"a\" }", Err("a serial port needs the key baud"));
    check("{ tcp = \"a\" }", Err("tcp = \"a\" is not of the form host:port"));
    check("{ tcp = \"a:99999\" }", Err("tcp = \"a:99999\": the port 99999 does not exist"));
    check("{ tcp = \"a:0\" }", Err("tcp = \"a:0\": the port 0 does not exist"));
    check("{ tcp = \"a:1\", baud = 9600 }", Err("baud is for a serial port"));
}

#[test]
fn an_analyzer_may_be_on_usb() {
    #[track_caller]
    fn check(port: &str, expected: Result<PortFile, &str>) {
        let text = SIMULATED.replacen(
            "{ serial = \"/dev/serial/by-id/analyzer\", baud = 38400 }",
            port,
            1,
        );
        let found = RigFile::read("rig.toml", &text).map(|rig| rig.analyzer.port);
        let found = found.map_err(|faults| {
            faults.iter().map(|fault| fault.message.clone()).collect::<Vec<_>>().join("; ")
        });
        assert_eq!(found, expected.map_err(str::to_owned));
    }
    let usbtmc = PortFile::Usbtmc { path: "/dev/usbtmc0".into() };
    if cfg!(target_os = "linux") {
        check("{ usbtmc = \"/dev/usbtmc0\" }", Ok(usbtmc));
    }
    check("{}", Err("a port is serial, tcp or usbtmc"));
    check(
        "{ usbtmc = \"/dev/usbtmc0\", tcp = \"a:1\" }",
        Err("a port is serial, tcp or usbtmc, not several of them"),
    );
    check("{ usbtmc = \"usbtmc0\" }", Err("usbtmc = \"usbtmc0\" is not a device file"));
    if cfg!(target_os = "linux") {
        check("{ usbtmc = \"/dev/usbtmc0\", baud = 9600 }", Err("baud is for a serial port"));
    }
}

#[test]
fn a_line_without_a_parity_has_the_factory_setting_of_its_drives() {
    let parity = |linear: &str, rotary: &str, port: &str| {
        let (head, tail) = SIMULATED.split_once("[rotary]").expect("the section");
        let text = [
            head.replace("= \"oriental-az\"", &format!("= \"{linear}\"")),
            tail.replace("= \"oriental-az\"", &format!("= \"{rotary}\"")),
        ]
        .join("[rotary]");
        let text = text.replacen("baud = 115200", port, 1);
        RigFile::read("rig.toml", &text)
            .map_err(|faults| {
                faults.iter().next().map_or(String::new(), |fault| fault.message.clone())
            })
            .map(|rig| {
                let PortFile::Serial { line, .. } = rig.bus else { panic!("it is a serial port") };
                line.parity
            })
    };
    let az = "oriental-az";
    assert_eq!(parity(az, az, "baud = 115200"), Ok(Parity::Even));
    for make in ["iai-rc", "leadshine-pr"] {
        assert_eq!(parity(make, make, "baud = 115200"), Ok(Parity::None));
        let both = "baud = 115200, parity = \"none\"";
        assert_eq!(parity(az, make, both), Ok(Parity::None));
        let needed =
            format!("a line of {az} and {make} needs its parity: their factory settings differ");
        assert_eq!(parity(az, make, "baud = 115200"), Err(needed));
    }
}

#[test]
fn a_rig_that_contradicts_itself_is_refused() {
    insta::assert_snapshot!(complaints(&[
        ("frequency_hz = [20, 2000]", "frequency_hz = [1, 2000]"),
        ("max_level_v = 5", "max_level_v = 20"),
        ("serial/by-id/drives", "serial/by-id/analyzer"),
        ("mm_per_step = 0.001", "mm_per_step = -0.005"),
        ("deg_per_step = 0.01", "deg_per_step = 0"),
        ("travel_mm = [0, 50]", "travel_mm = [0, 40]"),
        ("clear_mm = 24.5", "clear_mm = 23"),
        ("unit_id = 2", "unit_id = 1"),
        ("soft_limits_deg = [-50, 50]", "soft_limits_deg = [10, 50]"),
        ("surface_mm = 10", "surface_mm = 9"),
        ("contact_speed_mm_per_s = 1", "contact_speed_mm_per_s = 25"),
        ("rotary_speed_deg_per_s = 40", "rotary_speed_deg_per_s = 50"),
    ]));
}

/// Which options an instrument has is asked when it is connected.
#[test]
fn a_level_that_needs_an_option_is_allowed() {
    let read = |level: &str| {
        let text = SIMULATED.replace("dialect = \"hioki-im3536\"", "dialect = \"keysight-e4980a\"");
        let text = text.replace("max_level_v = 5", &format!("max_level_v = {level}"));
        RigFile::read("rig.toml", &text).map_err(|faults| faults.to_string())
    };
    assert!(read("20").is_ok(), "{:?}", read("20"));
    let refused = read("20.5").unwrap_err();
    assert!(refused.contains("max_level_v = 20.5 is above the 20 V"), "{refused}");
}

#[test]
fn advice_about_the_clear_position_can_be_followed() {
    let said = |changes: &[(&str, &str)]| {
        let text = changes.iter().fold(SIMULATED.to_owned(), |text, (from, to)| {
            assert!(text.contains(from), "{from}");
            text.replacen(from, to, 1)
        });
        RigFile::read("rig.toml", &text).unwrap_err().to_string()
    };
    let high = said(&[("surface_mm = 10", "surface_mm = 44")]);
    let advice =
        "the soft limits of the linear stage end at 45 mm, which is too low: check surface_mm";
    assert!(high.contains(advice) && !high.contains("use more than"), "{high}");
    let outside = said(&[("clear_mm = 24.5", "clear_mm = 47")]);
    assert!(
        outside.contains(
            "clear_mm = 47 is outside the soft limits [8.000 mm, 45.000 mm] of the linear stage"
        ),
        "{outside}"
    );
}

#[test]
fn a_number_in_another_unit_gets_a_hint() {
    insta::assert_snapshot!(complaints(&[
        ("mm_per_step = 0.001", "mm_per_step = -0.000001"),
        ("travel_mm = [0, 50]", "travel_mm = [0, 0.05]"),
        ("tolerance_mm = 0.002", "tolerance_mm = 2"),
        ("max_speed_mm_per_s = 20", "max_speed_mm_per_s = 0.02"),
        ("soft_limits_deg = [-50, 50]", "soft_limits_deg = [-0.4, 0.4]"),
        ("surface_mm = 10", "surface_mm = 0.01"),
        ("probe_radius_mm = 0.5", "probe_radius_mm = 500"),
        ("contact_speed_mm_per_s = 1", "contact_speed_mm_per_s = 0.001"),
        ("beam_loss = 0.015", "beam_loss = 1.6"),
        ("sample_rel = 0.03", "sample_rel = 3"),
        ("depth_mm = 0.02", "depth_mm = 20"),
    ]));
    insta::assert_snapshot!(complaints(&[
        ("clear_mm = 24.5", "clear_mm = 0.03"),
        ("length_mm = 35", "length_mm = 0.035")
    ]));
}

#[test]
fn a_device_file_and_an_address_are_distinguished() {
    insta::assert_snapshot!(complaints(&[
        (
            "{ serial = \"/dev/serial/by-id/analyzer\", baud = 38400 }",
            "{ serial = \"meter:5025\" }"
        ),
        ("{ serial = \"/dev/serial/by-id/drives\", baud = 115200 }", "{ tcp = \"/dev/ttyUSB0\" }"),
    ]));
}

#[test]
fn each_missing_or_misspelt_key_is_one_fault() {
    insta::assert_snapshot!(complaints(&[
        ("connection = \"simulated\"", "connection = \"simulate\""),
        ("dialect = \"hioki-im3536\"", "dialect = \"hioki-3536\""),
        ("[geometry]", "[geometri]"),
        ("[bus]\nport", "[bus]\nports"),
        ("unit_id = 2\n", ""),
        ("# [[samples]]\n# name = \"1\"", "[[samples]]\nname = \"1\""),
    ]));
}

#[test]
fn a_missing_sensor_is_the_reference_with_the_ball_of_the_rig() {
    let described = RigFile::read("rig.toml", SIMULATED).unwrap().sensor;
    assert_eq!(described.sensor, rig_contact::Sensor::reference());
    let (start, end) =
        (SIMULATED.find("[sensor]").unwrap(), SIMULATED.find("# ---- Samples").unwrap());
    let short = format!("{}{}", &SIMULATED[..start], &SIMULATED[end..]);
    assert_eq!(RigFile::read("rig.toml", &short).unwrap().sensor, described);
    let other = short.replacen("probe_radius_mm = 0.5", "probe_radius_mm = 1", 1);
    let other = RigFile::read("rig.toml", &other).unwrap().sensor;
    assert_eq!(other.sensor.design().probe_radius_mm, 1.0);
}

#[test]
fn an_impossible_sensor_is_refused() {
    insta::assert_snapshot!(complaints(&[("length_mm = 35", "length_mm = 5.9")]));
    insta::assert_snapshot!(complaints(&[
        ("length_mm = 35", "length_m = 5.9"),
        ("depth = \"indentation\"", "depth = \"indention\""),
        ("poisson = 0.5", "poisson = 0.6"),
        ("angle_deg = 1", "angle_deg = -1"),
    ]));
}

#[test]
fn two_samples_of_one_name_are_refused() {
    let text = BENCH.replacen("name = \"2\"", "name = \"1\"", 1);
    let faults = RigFile::read("rig.toml", &text).unwrap_err().to_string();
    assert!(faults.ends_with("there are two samples named \"1\"; remove one"), "{faults}");
}

#[test]
fn every_key_of_the_schema_that_is_in_force_is_listed_with_its_line() {
    let values = RigFile::in_force("rig.toml", SIMULATED).unwrap();
    let line = |name: &str| {
        let value = values.iter().find(|value| value.name == name);
        let value = value.unwrap_or_else(|| panic!("{name} is not listed"));
        (value.text.clone(), value.location.map(|at| at.line))
    };
    let (text, at) = line("analyzer.dialect");
    assert_eq!(text.as_deref(), Some("\"hioki-im3536\""));
    let written = SIMULATED.lines().nth(at.unwrap() - 1).unwrap();
    assert!(written.starts_with("dialect = "), "{written}");
    assert_eq!(line("analyzer.terminator"), (None, None));
    assert_eq!(line("analyzer.port.baud").0.as_deref(), Some("38400"));
    let without = SIMULATED.replace("patience_s = 120", "").replace("[recovery]", "");
    let values = RigFile::in_force("rig.toml", &without).unwrap();
    let patience = values.iter().find(|value| value.name == "recovery.patience_s").unwrap();
    assert_eq!((patience.text.as_deref(), patience.location), (Some("120"), None));
}

#[test]
fn an_instrument_with_a_file_is_named_by_its_path() {
    let text = SIMULATED
        .replacen("dialect = \"hioki-im3536\"", "dialect = \"lab/bridge.toml\"", 1)
        .replacen("register_map = \"oriental-az\"", "register_map = \"lab/drive.toml\"", 1);
    let baud = "baud = 115200";
    let rig = RigFile::read("rig.toml", &text.replacen(baud, "baud = 115200, parity = \"odd\"", 1));
    let rig = rig.unwrap();
    let Named::File { path, location } = &rig.analyzer.instrument else { panic!("{rig:?}") };
    assert_eq!((path.as_path(), location.column), (Path::new("lab/bridge.toml"), 11));
    assert!(matches!(rig.linear.instrument, Named::File { .. }));
    assert_eq!(rig.bus.line().map(|line| line.parity), Some(Parity::Odd));
    let refused = RigFile::read("rig.toml", &text).unwrap_err().to_string();
    let expected = "a line with a drive that has a file of its own needs its parity; write the parity \
                    that is set in the drives: parity = \"none\", \"even\" or \"odd\"";
    assert!(refused.ends_with(expected), "{refused}");
}
