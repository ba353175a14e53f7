//! A rotary drive that loses count while it stands still, and does not say so.

use rig_engine::{Command, RigState};
use rig_model::Position;
use rig_tests::TestRig;
use rigd::rig::Status;

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
