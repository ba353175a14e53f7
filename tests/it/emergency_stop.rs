//! The emergency stop of the drives, pressed and released at every few requests of a touch: the rig latches and says
//! so where the drive tells it, the release moves nothing, and the acknowledgement takes the probe out.

use rig_engine::{Command, RigState, RunStatus};
use rig_sim::world::AxisId;
use rig_store::{Clearance, Record};
use rig_tests::{TestRig, touches_of_smoke};

/// The height of the tip in truth, mm; how many violations there were; whether an axis moves.
fn truth(rig: &TestRig) -> (f64, usize, bool) {
    let simulation = rig.handle.simulation().expect("the rig is simulated");
    let now = rig.handle.status().borrow().now;
    simulation.with(|_, rig| {
        let world = rig.world();
        let is_moving =
            [AxisId::Linear, AxisId::Rotary].map(|axis| world.stage(axis).is_moving(now));
        let violations = world.violations(now).len();
        (world.truth(now).tip_mm, violations, is_moving.contains(&true))
    })
}

/// Presses it at the n-th request to the linear drive. `None` if the run was over before; otherwise whether the
/// probe was down.
async fn pressed_at(nth: u32, rig_file: &[(&str, &str)]) -> Option<bool> {
    let rig = TestRig::open_changed(rig_file).await;
    let clear_mm = rig.facts.limits.linear.rest_target().position().value();
    rig.fault(&format!("fault bus emergency-stop unit=1 nth={nth}"));
    let (run, status) = rig.run(rig.protocol(&touches_of_smoke("[30]"))).await;
    if status != RunStatus::Faulted {
        rig.close().await;
        return None;
    }
    let faults = rig.records(run).into_iter().filter_map(|stored| match stored.record() {
        Ok(Record::Fault(fault)) => Some(fault),
        _ => None,
    });
    let first = faults.into_iter().next().expect("a faulted run has its fault");
    assert!(first.cause.contains("its emergency stop is pressed"), "at request {nth}: {first:?}");
    assert!(first.hint.contains("before the emergency stop is released"), "{first:?}");
    let (pressed_mm, _, is_moving) = truth(&rig);
    assert!(!is_moving, "at request {nth}");

    rig.fault("clear");
    rig.wait_for("the latch", |status| status.snapshot.state == RigState::Latched).await;
    let (released_mm, violations, is_moving) = truth(&rig);
    assert_eq!((released_mm, violations, is_moving), (pressed_mm, 0, false), "at request {nth}");

    rig.command(Command::Acknowledge).await.unwrap();
    rig.wait_for("service", |status| status.snapshot.state == RigState::Idle).await;
    let (tip_mm, violations, _) = truth(&rig);
    assert!((tip_mm - clear_mm).abs() < 0.1, "at request {nth}: {tip_mm} mm");
    assert_eq!(violations, 0, "at request {nth}");
    rig.close().await;
    Some(first.probe != Clearance::Clear)
}

async fn check(rig_file: &[(&str, &str)]) {
    let mut down = 0;
    for nth in (1..200).step_by(5) {
        down += u32::from(pressed_at(nth, rig_file).await == Some(true));
    }
    assert!(down >= 5, "it was pressed with the probe down {down} times");
}

#[tokio::test]
async fn an_emergency_stop_that_an_alarm_tells_latches_and_its_release_moves_nothing() {
    check(&[]).await;
}

#[tokio::test]
async fn an_emergency_stop_that_a_flag_tells_latches_and_its_release_moves_nothing() {
    check(&[
        (r#"register_map = "oriental-az""#, r#"register_map = "iai-rc""#),
        ("mm_per_step = 0.001", "mm_per_step = 0.01"),
        ("tolerance_mm = 0.002", "tolerance_mm = 0.01"),
    ])
    .await;
}
