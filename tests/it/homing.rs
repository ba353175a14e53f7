//! A linear drive that has lost its position and may home downwards, through the real drivers and the
//! wire: nothing moves it before a person has stated that nothing is below the probe.

use rig_engine::{Command, RigState};
use rig_sim::SimHandle;
use rig_store::{MemoryDisk, Record};
use rig_tests::{changed, text};
use rigd::{
    loaded_rig::{LoadedRig, LoadedScene},
    rig::{self, RigHandle, Status},
};

use crate::out_of_contact::INCREMENTAL;

/// The shipped simulated rig with a drive that forgets its position, and a person who waits.
fn load() -> LoadedRig {
    load_at(&text("config/scenes/paper.toml"))
}

/// The same, at a bench of this scene.
fn load_at(scene_toml: &str) -> LoadedRig {
    let waits = [("person = \"answers\"", "person = \"waits\"")];
    let toml = changed(&text("config/rigs/simulated.toml"), &[&INCREMENTAL[..], &waits].concat());
    let scene = rig_sim::scene::read("scene", scene_toml).unwrap();
    let source = |name: &str, toml: String| rig_store::Source { name: name.to_owned(), toml };
    let file = rig_files::rig_file::RigFile::read("rig", &toml).unwrap();
    LoadedRig {
        path: std::path::PathBuf::new(),
        instruments: rigd::loaded_rig::Instruments::shipped(&file).unwrap(),
        file,
        source: source("rig", toml),
        scene: Some(LoadedScene { scene, source: source("scene", scene_toml.to_owned()) }),
    }
}

async fn settled(handle: &RigHandle) -> Status {
    let is_at_rest =
        |status: &Status| matches!(status.snapshot.state, RigState::Idle | RigState::Latched);
    handle.status().wait_for(is_at_rest).await.unwrap().clone()
}

fn tip_mm(bench: &SimHandle) -> f64 {
    bench.with(|now, rig| rig.world().truth(now).tip_mm)
}

/// Asserts that the rig is latched because the position is unknown, and that it has moved nothing.
#[track_caller]
fn waits_for_a_person(status: &Status, bench: &SimHandle, was_mm: f64) {
    let cause = status.snapshot.fault.as_ref().unwrap().to_string();
    assert_eq!(status.snapshot.state, RigState::Latched);
    assert!(cause.contains("not homed"), "{cause}");
    assert!((tip_mm(bench) - was_mm).abs() < 1e-9, "moved from {was_mm} to {} mm", tip_mm(bench));
}

/// Home, on the statement of a person, and retract.
async fn home(handle: &RigHandle, disk: &MemoryDisk) {
    handle.command(Command::HomeLinear, None, "mo").await.unwrap();
    let status = settled(handle).await;
    assert_eq!(status.snapshot.state, RigState::Idle, "{:?}", status.snapshot.fault);
    let reader = rig_store::Reader::open_in_memory(disk).unwrap();
    let is_statement = |stored: &rig_store::StoredRecord| {
        matches!(stored.record(), Ok(Record::Operator(operator))
            if operator.action == "home with nothing below the probe" && operator.who == "mo")
    };
    assert!(reader.records(status.session).unwrap().iter().any(is_statement));
}

#[tokio::test(start_paused = true)]
async fn a_drive_without_a_position_moves_only_after_a_person_has_looked_below_the_probe() {
    let disk = MemoryDisk::new().unwrap();
    // The first start of a bench: its drives were just switched on.
    let (handle, rig) = rig::open_in_memory(load(), &disk, None).await.unwrap();
    let bench = handle.simulation().unwrap().clone();
    let first_mm = tip_mm(&bench);
    let person = async {
        waits_for_a_person(&settled(&handle).await, &bench, first_mm);
        home(&handle, &disk).await;
        bench.technician().place_sample("5").unwrap();
        handle.close().await;
    };
    tokio::join!(person, rig.serve());
    let rest_mm = tip_mm(&bench);
    assert!((rest_mm - 24.5).abs() < 0.1, "the probe rests clear of the sample");
    // The drive loses its power, and another daemon starts beside the bench, in order or after a kill.
    let restart = "fault bus reboot unit=1";
    bench.with(|now, rig| rig_sim::control::execute(now, rig, restart).map(drop)).unwrap();
    tokio::time::advance(std::time::Duration::from_secs(5)).await;
    for is_killed in [false, true, false] {
        let opened = rig::open_in_memory(load(), &disk, Some(bench.clone())).await;
        let (handle, rig) = opened.unwrap();
        let person = async {
            let mut status = settled(&handle).await;
            for _ in 0..2 {
                // An acknowledgement is no statement.
                _ = handle.command(Command::Acknowledge, None, "mo").await;
                status = settled(&handle).await;
            }
            waits_for_a_person(&status, &bench, rest_mm);
            if !is_killed {
                handle.close().await;
            }
        };
        tokio::select! {
            biased;
            () = rig.serve() => {}
            () = person => {}
        }
    }
    let (handle, rig) = rig::open_in_memory(load(), &disk, Some(bench.clone())).await.unwrap();
    let person = async {
        settled(&handle).await;
        bench.technician().take_sample_away();
        home(&handle, &disk).await;
        handle.close().await;
    };
    tokio::join!(person, rig.serve());
    let violations = bench.with(|now, rig| rig.world().violations(now).to_vec());
    assert!(violations.is_empty(), "{violations:?}");
}

/// Its position may be wrong, whatever it says.
#[tokio::test(start_paused = true)]
async fn a_drive_that_says_it_is_homed_is_homed_on_the_statement_of_a_person() {
    let disk = MemoryDisk::new().unwrap();
    // Each homing finds the zero somewhere else.
    let scene = text("config/scenes/paper.toml");
    let loose = changed(&scene, &[("[nuisances]\n", "[nuisances]\nhoming_mm = 0.5\n")]);
    let (handle, rig) = rig::open_in_memory(load_at(&loose), &disk, None).await.unwrap();
    let bench = handle.simulation().unwrap().clone();
    let latched = async || {
        handle.command(Command::Stop, None, "mo").await.unwrap();
        let is_latched = |status: &Status| status.snapshot.state == RigState::Latched;
        handle.status().wait_for(is_latched).await.unwrap();
    };
    let person = async {
        settled(&handle).await;
        home(&handle, &disk).await;
        let homed_mm = tip_mm(&bench);
        latched().await;
        handle.command(Command::Acknowledge, None, "mo").await.unwrap();
        settled(&handle).await;
        assert!((tip_mm(&bench) - homed_mm).abs() < 0.01, "{}", tip_mm(&bench));
        latched().await;
        home(&handle, &disk).await;
        assert!((tip_mm(&bench) - homed_mm).abs() > 0.01, "{}", tip_mm(&bench));
        handle.close().await;
    };
    tokio::join!(person, rig.serve());
}
