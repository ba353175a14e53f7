//! A rotary stage that turns and does not answer its stop gets it again, as soon as its drive answers.

use rig_engine::{Command, RigState};
use rig_model::Position;
use rig_tests::TestRig;

/// At this speed, °/s, the turn takes three quarters of a minute, longer than any stop below.
const SLOW: [(&str, &str); 1] = [("rotary_speed_deg_per_s = 40", "rotary_speed_deg_per_s = 1")];
const TARGET_DEG: f64 = 45.0;

/// Turns, and the rotary drive misses this many requests after some. Returns its true tilts when the rig has latched and a
/// minute later, and the tilt that the rig states.
async fn missed(requests: u32) -> Option<([f64; 2], Option<f64>)> {
    let rig = TestRig::open_changed(&SLOW).await;
    rig.wait_for("service", |status| status.snapshot.state == RigState::Idle).await;
    for nth in 20..20 + requests {
        rig.fault(&format!("fault bus drop-request unit=2 nth={nth}"));
    }
    rig.command(Command::MoveRotary(Position::new(TARGET_DEG))).await.unwrap();
    let status = rig
        .wait_for("the end", |status| {
            let snapshot = &status.snapshot;
            let is_over = snapshot.state == RigState::Latched && snapshot.attempts.is_none();
            is_over
                || snapshot.state == RigState::Idle
                    && snapshot.rotary.is_some_and(|at| at.value() > 1.0)
        })
        .await;
    let now = status.now;
    let simulation = rig.handle.simulation().expect("the rig is simulated");
    let tilts = simulation.with(|_, rig| {
        let later = now + std::time::Duration::from_secs(60);
        [now, later].map(|at| rig.world().truth(at).tilt_deg)
    });
    let (state, stated) = (status.snapshot.state, status.snapshot.rotary);
    rig.close().await;
    (state == RigState::Latched).then_some((tilts, stated.map(Position::value)))
}

#[tokio::test]
async fn a_rotary_stage_that_misses_its_stop_is_stopped_as_soon_as_it_answers() {
    let mut latched = 0;
    for requests in [2, 4, 8, 12, 16, 20, 24, 28] {
        let Some(([then, later], stated)) = missed(requests).await else { continue };
        let told = format!("{requests} requests: {then}°, a minute later {later}°");
        assert!((later - then).abs() < 1e-3, "{told}");
        assert!(later < 0.9 * TARGET_DEG, "{told}");
        assert!(stated.is_none_or(|stated| (stated - then).abs() < 0.1), "{told}, {stated:?}");
        latched += 1;
    }
    assert!(latched >= 3, "{latched}");
}
