//! The program on ports: simulated devices behind real connections, with faults.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[expect(dead_code, reason = "other tests use more of it")]
#[path = "support/bench.rs"]
mod bench;

use std::process::Output;

use rig_model::DriveMake;
use rig_sim::{
    PortId,
    faults::{DeviceFault, FaultKind, RequestFault},
};
use rig_store::{Reader, Record};
use serde_json::Value;
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpListener,
    task::JoinSet,
};

use bench::{Bench, json, shipped, stderr};

/// The level of each finding, and its advice.
fn levels(doctor: &Output) -> Vec<(String, String)> {
    let view = json(doctor);
    let row = |finding: &Value| {
        let word = |key: &str| finding[key].as_str().unwrap_or_default().to_owned();
        (format!("{}, {}: {}", word("part"), word("check"), word("level")), word("advice"))
    };
    view["findings"].as_array().unwrap().iter().map(row).collect()
}

#[track_caller]
fn check_finding(doctor: &Output, finding: &str, advice: &str) {
    let found = levels(doctor);
    let is_there = |(text, given): &(String, String)| text == finding && given.contains(advice);
    assert!(found.iter().any(is_there), "no `{finding}` with `{advice}` in {found:#?}");
}

/// The function codes of the requests to the drives since the bench listens in. Each arrives in one piece.
fn functions(bench: &Bench) -> Vec<u8> {
    bench.sim.with(|_, rig| {
        let heard = rig.overheard().iter().filter(|heard| heard.port == PortId::Bus);
        heard.map(|heard| heard.bytes[7]).collect()
    })
}

/// Codes 1 to 4 read.
fn are_reads(functions: &[u8]) -> bool {
    functions.iter().all(|function| (1..=4).contains(function))
}

/// The rig file may be wrong: its limits and its scale are not given to a drive before a person opens the
/// rig for work.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nothing_is_written_into_a_drive_that_is_only_looked_at() {
    for make in DriveMake::ALL {
        let bench = Bench::with_linear_drive(make, 0.01).await;
        let name = format!("register_map = \"{}\"", make.name());
        let changes = [
            ("register_map = \"oriental-az\"", &*name),
            ("mm_per_step = 0.001", "mm_per_step = 0.01"),
            ("tolerance_mm = 0.002", "tolerance_mm = 0.02"),
        ];
        for command in ["doctor", "identify"] {
            bench.sim.with(|_, rig| rig.listen_in());
            let looked = bench.rigd_with(&bench.analyzer, &bench.bus, &changes, &[command]);
            let asked = functions(&bench);
            assert!(asked.len() > 10 && are_reads(&asked), "{make:?} {command}: {asked:?}");
            let told = String::from_utf8_lossy(&looked.stdout);
            assert!(told.contains(&format!("{} at unit 1", make.name())), "{told}");
        }
        bench.sim.with(|_, rig| rig.listen_in());
        bench.rigd_with(&bench.analyzer, &bench.bus, &changes, &["home"]);
        assert!(!are_reads(&functions(&bench)), "{make:?}: `home` writes");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_rig_that_is_well_has_only_good_findings() {
    let bench = Bench::start().await;
    let identity = bench.rigd(&["identify", "--json"]);
    assert!(identity.status.success(), "{}", stderr(&identity));
    let devices = json(&identity);
    assert_eq!(devices[0]["identity"], "HIOKI IM3536, serial number 190512345");
    assert_eq!(devices[0]["firmware"], "V1.21");
    assert_eq!(devices[0]["port"], Value::from(bench.analyzer.as_str()));
    assert_eq!(devices[2]["identity"], "oriental-az at unit 2");

    let doctor = bench.rigd(&["doctor", "--json"]);
    assert!(doctor.status.success(), "{}", stderr(&doctor));
    let found = levels(&doctor);
    assert!(found.iter().all(|(text, _)| text.ends_with(": ok")), "{found:#?}");
    for part in
        ["data directory, space", "bus, latency", "analyzer, settings", "rotary stage, state"]
    {
        check_finding(&doctor, &format!("{part}: ok"), "");
    }
}

/// A socket stands for the device file of the driver, and the simulated analyzer for the instrument.
#[cfg(target_os = "linux")]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_analyzer_on_usb_is_identified_and_looked_at() {
    let bench = Bench::start().await;
    let socket = bench.folder.path().join("usbtmc0");
    let mut server = rig_sim::serve::Server::new(bench.sim.clone());
    server.open_usbtmc(&socket).unwrap();
    let tcp = format!("{{ tcp = \"{}\" }}", bench.analyzer);
    let usbtmc = format!("{{ usbtmc = \"{}\" }}", socket.display());
    let changes = [(tcp.as_str(), usbtmc.as_str())];
    let looked = |args: &[&str]| bench.rigd_with(&bench.analyzer, &bench.bus, &changes, args);
    let identity = looked(&["identify", "--json"]);
    assert!(identity.status.success(), "{}", stderr(&identity));
    let devices = json(&identity);
    assert_eq!(devices[0]["identity"], "HIOKI IM3536, serial number 190512345");
    assert_eq!(devices[0]["port"], Value::from(socket.to_str().unwrap()));
    let doctor = looked(&["doctor", "--json"]);
    assert!(doctor.status.success(), "{}", stderr(&doctor));
    for check in ["analyzer port, open", "analyzer port, latency", "analyzer, settings"] {
        check_finding(&doctor, &format!("{check}: ok"), "");
    }

    drop(server);
    while socket.exists() {
        tokio::task::yield_now().await;
    }
    let doctor = looked(&["doctor", "--json"]);
    check_finding(&doctor, "computer, driver of USB instruments: problem", "");
    check_finding(&doctor, "analyzer port, open: problem", "plug it in");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn trouble_with_one_device_does_not_hide_the_others() {
    let bench = Bench::start().await;
    bench.disturb(PortId::Bus, Some(1), FaultKind::Request(RequestFault::Drop));
    bench.disturb(PortId::Bus, Some(2), FaultKind::Device(DeviceFault::Alarm(0x30)));
    // The address of a closed listener.
    let gone = TcpListener::bind("127.0.0.1:0").await.unwrap().local_addr().unwrap().to_string();
    let doctor = bench.rigd_at(&gone, &bench.bus, &["doctor", "--json"]);
    assert_eq!(doctor.status.code(), Some(1));
    check_finding(&doctor, "analyzer port, open: problem", "check address and port number");
    check_finding(&doctor, "analyzer, identity: problem", "solve the problem of the port first");
    check_finding(&doctor, "linear stage, identity: problem", "the unit id");
    check_finding(&doctor, "rotary stage, identity: ok", "");
    check_finding(&doctor, "rotary stage, state: problem", "resets the alarm");
    assert_eq!(json(&doctor)["problems"], 4);
    assert!(stderr(&doctor).contains("4 problems"), "{}", stderr(&doctor));

    let identity = bench.rigd_at(&gone, &bench.bus, &["identify"]);
    let said = String::from_utf8_lossy(&identity.stdout);
    assert!(said.starts_with(&format!("analyzer      not identified: {gone}: ")), "{said}");
    let identity = bench.rigd_at(&gone, &bench.bus, &["identify", "--json"]);
    assert_eq!(identity.status.code(), Some(1));
    let devices = json(&identity);
    let error = devices[0]["error"].as_str().unwrap();
    assert!(error.contains(&gone) && error.contains("refused"), "{error}");
    assert_eq!(devices[2]["identity"], "oriental-az at unit 2");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn after_a_fault_the_last_frames_of_each_port_are_in_the_journal() {
    let bench = Bench::start().await;
    bench.disturb(PortId::Bus, Some(1), FaultKind::Device(DeviceFault::Alarm(0x30)));
    let changes = [("[geometry]", "[recovery]\npatience_s = 1\n\n[geometry]")];
    let home = bench.rigd_with(&bench.analyzer, &bench.bus, &changes, &["home"]);
    assert_eq!(home.status.code(), Some(4), "{}", stderr(&home));
    assert!(stderr(&home).contains("alarm 0x30 (overload)"), "{}", stderr(&home));

    let reader = Reader::open(&bench.folder.path().join("data")).unwrap();
    let session = reader.runs().unwrap().swap_remove(0);
    let records = reader.records(session.id).unwrap();
    let fault = records.iter().position(|stored| stored.kind == "fault").unwrap();
    let boxes = [&records[fault + 1], &records[fault + 2]].map(|stored| match stored.record() {
        Ok(Record::BlackBox(kept)) => kept,
        other => panic!("{other:?}"),
    });
    assert_eq!([&boxes[0].port, &boxes[1].port], [&bench.analyzer, &bench.bus]);
    for kept in &boxes {
        assert!(kept.frames.iter().any(|frame| frame.is_sent), "{kept:?}");
        assert!(kept.frames.iter().any(|frame| !frame.is_sent), "{kept:?}");
        assert!(kept.frames.is_sorted_by_key(|frame| frame.rig_us), "{kept:?}");
    }
    // `*IDN?` was sent, and the last word of the status of the drive has its alarm.
    assert!(boxes[0].frames.iter().any(|frame| frame.hex.contains("2a49444e3f")), "{boxes:?}");
    let is_alarm = |frame: &rig_store::Frame| !frame.is_sent && frame.hex.ends_with("0030");
    assert!(boxes[1].frames.iter().any(is_alarm), "{boxes:?}");
}

/// Answers each piece of a query on every connection to a local port with these bytes.
async fn answering(listening: &mut JoinSet<()>, answer: &'static [u8]) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    listening.spawn(async move {
        while let Ok((mut client, _)) = listener.accept().await {
            tokio::spawn(async move {
                let mut question = [0; 256];
                while client.read(&mut question).await.is_ok_and(|n| n > 0) {
                    _ = client.write_all(answer).await;
                }
            });
        }
    });
    address
}

/// Servers with wrong answers: the message has the bytes that arrived, and no cause that was not
/// observed.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_a_wrong_server_answered_is_said_with_what_to_look_at() {
    let mut bench = Bench::start().await;
    let hasty = [("reply_timeout_s = 1", "reply_timeout_s = 0.2")];
    let rows: [(&[u8], &str, &str); 4] = [
        (b"", "nothing arrived", "port for commands"),
        (
            b"HIOKI,IM3536,1,V1\r",
            "(the answer ended in CR where LF was expected)",
            "terminator = \"cr\"",
        ),
        (b"HIOKI,IM", "8 bytes arrived, the last after ", "reply_timeout_s"),
        (
            b"SSH-2.0-OpenSSH_9.2\r\n",
            "expected an identity, found `SSH-2.0-OpenSSH_9.2`",
            "dialect",
        ),
    ];
    for (answer, expected, advice) in rows {
        let analyzer = answering(&mut bench.listening, answer).await;
        let ask = || bench.rigd_with(&analyzer, &bench.bus, &hasty, &["doctor", "--json"]);
        // A computer with much to do may hold up a hasty one, which then says so instead.
        let is_held_up = |doctor: &Output| {
            String::from_utf8_lossy(&doctor.stdout).contains("the load of this computer")
        };
        let doctor = (0..9).map(|_| ask()).find(|doctor| !is_held_up(doctor)).unwrap_or_else(ask);
        check_finding(&doctor, "analyzer, identity: problem", advice);
        let text = String::from_utf8_lossy(&doctor.stdout).replace("\\\"", "\"");
        assert!(text.contains(expected), "{expected}: {text}");
        for word in ["speed", "parity", "unplugged", "cable", "no answer"] {
            assert!(!text.contains(word) && !stderr(&doctor).contains(word), "{text}");
        }
    }
    // Retries are logged with their cause.
    let analyzer = answering(&mut bench.listening, b"HIOKI\r").await;
    let home = bench.rigd_with(&analyzer, &bench.bus, &hasty, &["home"]);
    let said = stderr(&home);
    assert_eq!(home.status.code(), Some(1), "{said}");
    assert!(said.contains("WARN") && said.matches("6 bytes arrived").count() == 3, "{said}");
    assert!(said.contains("→ write terminator"), "{said}");
}

/// A Modbus TCP server whose answers announce more bytes of data than they have.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_answer_that_is_too_short_is_not_called_a_lost_connection() {
    let mut bench = Bench::start().await;
    let short = b"\0\0\0\0\0\x07\x01\x03\x0c\0\0\0\x01";
    let bus = answering(&mut bench.listening, short).await;
    let doctor = bench.rigd_at(&bench.analyzer, &bus, &["doctor", "--json"]);
    let text = String::from_utf8_lossy(&doctor.stdout);
    assert!(!text.contains("closed by the other side") && !text.contains("unplugged"), "{text}");
    assert!(text.contains("13 bytes arrived: 00 00 00 00 00 07 01 03 0C"), "{text}");
    check_finding(&doctor, "linear stage, identity: problem", "");
}

/// A Modbus TCP server all of whose registers read zero, and which takes every write.
async fn zeros(listening: &mut JoinSet<()>) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    listening.spawn(async move {
        while let Ok((mut client, _)) = listener.accept().await {
            tokio::spawn(async move {
                let mut header = [0; 6];
                while client.read_exact(&mut header).await.is_ok() {
                    let mut request = vec![0; usize::from(header[5])];
                    _ = client.read_exact(&mut request).await;
                    let mut reply = request[..2].to_vec();
                    if request[1] <= 4 {
                        reply.push(2 * request[5]);
                        reply.resize(3 + 2 * usize::from(request[5]), 0);
                    } else {
                        reply.extend(&request[2..6]);
                    }
                    header[5] = u8::try_from(reply.len()).unwrap();
                    _ = client.write_all(&[&header, &reply[..]].concat()).await;
                }
            });
        }
    });
    address
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_of_zeros_is_not_taken_for_a_drive() {
    let mut bench = Bench::start().await;
    let bus = zeros(&mut bench.listening).await;
    let az = ("oriental-az", "oriental-az");
    for make in [az, ("oriental-az", "iai-rc"), ("oriental-az", "leadshine-pr")] {
        let changes = [make, ("tolerance_mm = 0.002", "tolerance_mm = 0.01")];
        let identify = bench.rigd_with(&bench.analyzer, &bus, &changes, &["identify", "--json"]);
        assert_eq!(identify.status.code(), Some(1), "{make:?}");
        let error = json(&identify)[1]["error"].as_str().unwrap().to_owned();
        assert!(error.starts_with("not recognised: "), "{error}");
        let doctor = bench.rigd_with(&bench.analyzer, &bus, &changes, &["doctor", "--json"]);
        assert_eq!(doctor.status.code(), Some(1), "{make:?}");
        check_finding(&doctor, "linear stage, identity: problem", "register map");
    }
}

/// A rig file that contradicts the position of an axis: no command moves anything, and no advice
/// suggests a move.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nothing_moves_while_an_axis_says_that_it_is_where_it_cannot_be() {
    let bench = Bench::start().await;
    let smoke = shipped("protocols/smoke.toml");
    let before = bench.places();
    let linear = "linear stage, position: problem";
    let rotary = "rotary stage, position: problem";
    for (change, finding, place) in [
        (
            ("mm_per_step = 0.001", "mm_per_step = -0.001"),
            linear,
            "mm, outside its travel [0.000 mm, 50.000 mm]",
        ),
        (
            ("mm_per_step = 0.001", "mm_per_step = 0.002\nzero_mm = 0.5"),
            linear,
            "mm, outside its travel",
        ),
        (
            ("deg_per_step = 0.01", "deg_per_step = 0.01\nzero_deg = 90"),
            rotary,
            "°, outside its travel [-60.000 °, 60.000 °]",
        ),
    ] {
        let rigd = |args: &[&str]| {
            bench.rigd_with(
                &bench.analyzer,
                &bench.bus,
                &[change, ("0.002\nmax", "0.01\nmax")],
                args,
            )
        };
        let doctor = rigd(&["doctor", "--json"]);
        assert_eq!(doctor.status.code(), Some(1), "{}", stderr(&doctor));
        check_finding(&doctor, finding, "move nothing");
        let advice: Vec<_> = levels(&doctor).into_iter().map(|(_, advice)| advice).collect();
        let text = advice.concat();
        assert!(!text.contains("home") && !text.contains("rigd move"), "{text}");
        for args in [
            &["home"] as &[&str],
            &["move", "linear", "35"],
            &["move", "rotary", "10"],
            &["measure", "--min-hz", "120", "--max-hz", "160"],
            &["run", smoke.to_str().unwrap()],
        ] {
            let refused = rigd(args);
            assert_eq!(refused.status.code(), Some(1), "{args:?}: {}", stderr(&refused));
            let said = stderr(&refused);
            assert!(said.contains(place) && said.contains("move nothing"), "{args:?}: {said}");
        }
        assert_eq!(bench.places(), before, "{change:?}");
    }
}

/// A linear drive that forgets its position when it is switched off, and homes downwards.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stage_that_may_home_downwards_is_homed_only_by_a_person_who_has_looked() {
    let bench = Bench::with_linear_drive(DriveMake::IaiRc, 0.01).await;
    let before = bench.places();
    let changes = [
        ("oriental-az", "iai-rc"),
        ("mm_per_step = 0.001", "mm_per_step = 0.01"),
        ("tolerance_mm = 0.002", "tolerance_mm = 0.01"),
    ];
    let rigd = |args: &[&str]| bench.rigd_with(&bench.analyzer, &bench.bus, &changes, args);
    for args in [&["move", "linear", "35"] as &[&str], &["home"], &["home"]] {
        let refused = rigd(args);
        let said = stderr(&refused);
        assert_eq!(refused.status.code(), Some(4), "{args:?}: {said}");
        assert!(said.contains("nothing is below the probe"), "{args:?}: {said}");
        assert!(said.contains("rigd home"), "{args:?}: {said}");
        assert_eq!(bench.places(), before, "{args:?}");
    }
    let homed = rigd(&["home", "--nothing-below-probe"]);
    assert!(homed.status.success(), "{}", stderr(&homed));
    let moved = rigd(&["move", "linear", "35"]);
    assert!(moved.status.success(), "{}", stderr(&moved));
}
