//! A rotary drive that loses count while it stands still, and does not say so.

use std::fs;

use rig_engine::{Command, RigState};
use rig_model::Position;
use rig_sim::control;
use rig_store::MemoryDisk;
use rig_tests::{TestRig, changed, text};
use rigd::{
    loaded_rig::LoadedRig,
    rig::{self, RigHandle, Status},
};
use tempfile::TempDir;

/// A drive with an absolute encoder would go to the zero that it remembers (decision 184).
const LOOKS_FOR_ITS_ZERO: [(&str, &str); 2] = [
    ("register_map = \"oriental-az\"\n", "register_map = \"leadshine-pr\"\n"),
    ("register_map = \"oriental-az\" # As", "register_map = \"leadshine-pr\" # As"),
];

/// Turns, loses count, is stopped by an abort or by nothing, and turns again, which is refused; a person acknowledges. Gives the
/// true tilt then and after the next turn.
async fn tilts_after(by_deg: f64, next_deg: f64, is_aborted: bool) -> [f64; 2] {
    let rig = TestRig::open_changed(&LOOKS_FOR_ITS_ZERO).await;
    let is_idle = |state: RigState| state == RigState::Idle;
    rig.wait_for("service", |status| is_idle(status.snapshot.state)).await;
    let turned = |to: f64| {
        let at = move |at: Option<Position<_>>| at.is_some_and(|at| (at.value() - to).abs() < 0.5);
        rig.wait_for("the turn", move |status| {
            is_idle(status.snapshot.state) && at(status.snapshot.rotary)
        })
    };
    rig.command(Command::MoveRotary(Position::new(30.0))).await.unwrap();
    turned(30.0).await;
    rig.fault(&format!("fault bus miscount unit=2 by={by_deg}"));
    // Meanwhile the time passes after which a drive is read again before it turns.
    rig.command(Command::MoveLinear(Position::new(28.0))).await.unwrap();
    let is_up = |at: Position<_>| (at.value() - 28.0).abs() < 0.1;
    rig.wait_for("the way up", move |status| {
        is_idle(status.snapshot.state) && status.snapshot.linear.is_some_and(is_up)
    })
    .await;
    if is_aborted {
        // The abort waits behind the move, and comes before its end.
        let way_down = rig.command(Command::MoveLinear(Position::new(25.0)));
        let (begun, aborted) = tokio::join!(biased; way_down, rig.command(Command::Abort));
        begun.and(aborted).unwrap();
        rig.wait_for("the end", |status| is_idle(status.snapshot.state)).await;
    }
    rig.command(Command::MoveRotary(Position::new(next_deg))).await.unwrap();
    let latched = |status: &Status| status.snapshot.state == RigState::Latched;
    let status = rig.wait_for("the latch", latched).await;
    let cause = status.snapshot.fault.unwrap().to_string();
    assert!(cause.contains("came to rest at"), "{cause}");
    rig.command(Command::Acknowledge).await.unwrap();
    let again = rig.wait_for("service again", |status| is_idle(status.snapshot.state)).await;
    let tilt = |status: &Status| {
        let simulation = rig.handle.simulation().expect("the rig is simulated");
        simulation.with(|_, rig| rig.world().truth(status.now).tilt_deg)
    };
    let level = tilt(&again);
    rig.command(Command::MoveRotary(Position::new(next_deg))).await.unwrap();
    let tilts = [level, tilt(&turned(next_deg).await)];
    rig.close().await;
    tilts
}

#[tokio::test]
async fn a_rotary_stage_that_has_lost_count_is_homed_anew_before_it_is_believed() {
    for (by_deg, is_aborted) in [(5.0, false), (-3.0, false), (5.0, true), (-3.0, true)] {
        let [level, next] = tilts_after(by_deg, 15.0, is_aborted).await;
        let told = format!("{by_deg}, {is_aborted}: {level}° {next}°");
        assert!(level.abs() < 0.5 && (next - 15.0).abs() < 0.5, "{told}");
    }
}

/// The refusal may be followed by the end of the program, before anybody homes the drive.
#[tokio::test(start_paused = true)]
async fn a_rotary_stage_that_has_lost_count_is_homed_anew_by_the_next_program_too() {
    let folder = TempDir::new().unwrap();
    let scene = text("config/scenes/paper.toml");
    fs::write(folder.path().join("scene.toml"), scene).unwrap();
    let file = changed(&text("config/rigs/simulated.toml"), &LOOKS_FOR_ITS_ZERO);
    let file = changed(&file, &[("../scenes/paper.toml", "scene.toml")]);
    let path = folder.path().join("rig.toml");
    fs::write(&path, file).unwrap();
    let (disk, mut bench) = (MemoryDisk::new().unwrap(), None);
    for is_next in [false, true] {
        let rig = LoadedRig::load(&path).unwrap();
        let (handle, rig) = rig::open_in_memory(rig, &disk, bench.take()).await.unwrap();
        bench = handle.simulation().cloned();
        let life =
            async { if is_next { acknowledge(&handle).await } else { lose_count(&handle).await } };
        // To drop it is to kill it.
        tokio::select! {
            biased;
            () = rig.serve() => panic!("the rig ended"),
            () = life => {}
        }
    }
    let tilt_deg = bench.unwrap().with(|now, rig| rig.world().truth(now).tilt_deg);
    assert!(tilt_deg.abs() < 0.5, "{tilt_deg}°");
}

async fn reach(handle: &RigHandle, condition: impl Fn(&Status) -> bool) {
    handle.status().wait_for(|status| condition(status)).await.unwrap();
}

fn is_idle(status: &Status) -> bool {
    status.snapshot.state == RigState::Idle
}

fn is_latched(status: &Status) -> bool {
    status.snapshot.state == RigState::Latched
}

async fn lose_count(handle: &RigHandle) {
    reach(handle, is_idle).await;
    let turn = |to: f64| handle.command(Command::MoveRotary(Position::new(to)), None, "test");
    turn(30.0).await.unwrap();
    let at = |status: &Status| status.snapshot.rotary.is_some_and(|at| at.value() > 29.5);
    reach(handle, |status| is_idle(status) && at(status)).await;
    let bench = handle.simulation().unwrap();
    bench.with(|now, rig| control::execute(now, rig, "fault bus miscount unit=2 by=5").unwrap());
    // Meanwhile the time passes after which a drive is read again before it turns.
    tokio::time::sleep(std::time::Duration::from_secs(5)).await;
    turn(15.0).await.unwrap();
    reach(handle, is_latched).await;
}

async fn acknowledge(handle: &RigHandle) {
    assert!(is_latched(&handle.status().borrow()), "a simulated rig is latched by a kill");
    handle.command(Command::Acknowledge, None, "test").await.unwrap();
    reach(handle, is_idle).await;
}
