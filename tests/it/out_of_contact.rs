//! The linear drive in trouble while the probe is in contact, through the real drivers and the wire: the
//! probe gets out, or the rig says that it could not.

use std::ops::Range;

use rig_engine::{RigState, RunStatus};
use rig_store::{Clearance, Record};
use rig_tests::{TestRig, touches_of_smoke};

/// How a run with one fault of the bus ended.
struct End {
    /// Whether the probe was down at the first fault, as the journal tells.
    was_down: bool,
    /// The causes of all faults, in order.
    causes: Vec<String>,
    /// Whether the probe is at its clear position in truth.
    tip_mm: f64,
    is_out: bool,
    violations: usize,
    /// The state of the probe, as the rig reports it.
    clearance: &'static str,
}

/// A fault at the n-th request to the linear drive from the beginning of a run of one touch; `None` if
/// the run was over before.
async fn run_with(fault: &str, nth: u32, rig_file: &[(&str, &str)]) -> Option<End> {
    run_with_each(fault, nth..nth + 1, rig_file).await
}

/// The same, at each of these requests.
async fn run_with_each(fault: &str, at: Range<u32>, rig_file: &[(&str, &str)]) -> Option<End> {
    let rig = TestRig::open_changed(rig_file).await;
    let nth = at.start;
    for nth in at {
        rig.fault(&format!("fault bus {fault} unit=1 nth={nth}"));
    }
    let (run, status) = rig.run(rig.protocol(&touches_of_smoke("[30]"))).await;
    let records = rig.records(run);
    let mut causes = Vec::new();
    let mut was_down = None;
    for stored in records {
        if let Ok(Record::Fault(fault)) = stored.record() {
            was_down.get_or_insert(fault.probe != Clearance::Clear);
            causes.push(fault.cause);
        }
    }
    let clear = rig.facts.limits.linear.rest_target().position().value();
    let simulation = rig.handle.simulation().expect("the rig is simulated");
    // The clock of the rig thread is not that of this one.
    let now = rig.handle.status().borrow().now;
    let (truth, violations) = simulation.with(|_, rig| {
        let violations = rig.world().violations(now).len();
        (rig.world().truth(now), violations)
    });
    let clearance = rig.handle.status().borrow().snapshot.clearance.name();
    rig.close().await;
    if status != RunStatus::Faulted {
        assert!(causes.is_empty(), "{fault} at request {nth}: {causes:?}, and the run went on");
        return None;
    }
    Some(End {
        was_down: was_down.expect("a faulted run has its fault"),
        causes,
        tip_mm: truth.tip_mm,
        // A drive that was homed upwards stays at the top.
        is_out: clear - 0.1 < truth.tip_mm,
        violations,
        clearance,
    })
}

/// The same fault at every third request of a touch.
async fn check_each(fault: &str, rig_file: &[(&str, &str)]) {
    let mut down = 0;
    for nth in (1..).step_by(3).take(200) {
        let Some(end) = run_with(fault, nth, rig_file).await else {
            if nth > 150 {
                break;
            }
            continue;
        };
        let context =
            format!("{fault} at request {nth}: {:#?} {} {}", end.causes, end.clearance, end.tip_mm);
        assert!(end.is_out, "{context}: the probe is still down");
        assert_eq!((end.violations, end.clearance), (0, "clear"), "{context}");
        down += u32::from(end.was_down);
    }
    assert!(down >= 5, "{fault} met the probe down {down} times");
}

#[tokio::test]
async fn an_alarm_of_the_linear_drive_is_reset_once_and_the_probe_gets_out() {
    check_each("alarm code=48", &[]).await;
}

#[tokio::test]
async fn a_linear_drive_that_refuses_a_few_requests_is_asked_again_and_the_probe_gets_out() {
    let mut down = 0;
    for nth in (40..130).step_by(2) {
        let six = nth..nth + 6;
        let Some(end) = run_with_each("exception code=4", six, &[]).await else { continue };
        let context = format!("at request {nth}: {:#?} {} mm", end.causes, end.tip_mm);
        assert!(end.is_out && end.violations == 0, "{context}");
        down += u32::from(end.was_down);
    }
    assert!(down >= 5, "the drive refused with the probe down {down} times");
}

#[tokio::test]
async fn a_limit_switch_stops_the_linear_drive_and_the_probe_gets_out() {
    check_each("limit-switch", &[]).await;
}

#[tokio::test]
async fn a_linear_drive_that_restarts_is_identified_again_and_the_probe_gets_out() {
    check_each("reboot", &[]).await;
}

#[tokio::test]
async fn a_bus_that_is_unplugged_for_a_while_is_opened_again_and_the_probe_gets_out() {
    check_each("unplug ms=20000", &[]).await;
}

/// A drive without an absolute encoder that homes to the upper end of its travel.
pub(crate) const INCREMENTAL: [(&str, &str); 4] = [
    (r#"register_map = "oriental-az""#, r#"register_map = "iai-rc""#),
    ("mm_per_step = 0.001", "mm_per_step = -0.01"),
    ("zero_mm = 0\n", "zero_mm = 45\n"),
    ("tolerance_mm = 0.002", "tolerance_mm = 0.01"),
];

#[tokio::test]
async fn a_drive_that_lost_its_position_is_homed_upwards_and_the_probe_gets_out() {
    let homes = ("# homes = \"up\"", "homes = \"up\"");
    check_each("reboot", &[&INCREMENTAL[..], &[homes]].concat()).await;
}

#[tokio::test]
async fn a_drive_that_lost_its_position_is_not_moved_when_homing_may_lead_into_the_sample() {
    let mut down = 0;
    for nth in (4..).step_by(15).take(10) {
        let Some(end) = run_with("reboot", nth, &INCREMENTAL).await else { continue };
        let context = format!("{nth}: {:#?} {} mm", end.causes, end.tip_mm);
        assert_eq!((end.violations, end.clearance), (0, "unknown"), "{context}");
        // Homing would end beyond the clear position, at an end of the travel.
        let is_homed = end.tip_mm > 24.6 || end.tip_mm < 5.0;
        assert!(!is_homed && end.causes.iter().any(|why| why.contains("not homed")), "{context}");
        down += u32::from(end.was_down && !end.is_out);
    }
    assert!(down >= 3, "the probe was down {down} times");
}

#[tokio::test]
async fn after_the_patience_the_latched_rig_goes_on_trying_and_the_probe_gets_out() {
    let rig = TestRig::open_changed(&[]).await;
    // In the sample, for longer than the patience of two minutes.
    rig.fault("fault bus unplug ms=400000 unit=1 nth=45");
    let (run, status) = rig.run(rig.protocol(&touches_of_smoke("[30]"))).await;
    assert_eq!(status, RunStatus::Faulted);
    let was_down = |stored: &rig_store::StoredRecord| match stored.record() {
        Ok(Record::Fault(fault)) => fault.probe != Clearance::Clear,
        _ => false,
    };
    assert!(rig.records(run).iter().any(was_down));
    let mut status = rig.handle.status();
    let is_clear = |status: &rigd::rig::Status| status.snapshot.clearance.name() == "clear";
    let cleared =
        tokio::time::timeout(std::time::Duration::from_secs(60), status.wait_for(is_clear));
    let end = cleared.await.expect("the probe gets out").expect("the rig lives").clone();
    assert_eq!((end.snapshot.state, end.snapshot.attempts), (RigState::Latched, None));
    let session = rig.records(end.session);
    let tried: Vec<_> = session
        .iter()
        .filter_map(|stored| match stored.record() {
            Ok(Record::RetractTried(tried)) => Some((tried.attempt, tried.cause.is_some())),
            _ => None,
        })
        .collect();
    assert!(
        tried.len() >= 5 && (1..).zip(&tried).all(|(number, one)| one.0 == number),
        "{tried:?}"
    );
    let failed = tried.iter().filter(|(_, has_failed)| *has_failed).count();
    assert_eq!(failed, tried.len() - 1, "{tried:?}");
    let simulation = rig.handle.simulation().expect("the rig is simulated");
    let now = end.now;
    let (tip_mm, violations) = simulation
        .with(|_, rig| (rig.world().truth(now).tip_mm, rig.world().violations(now).len()));
    assert!((tip_mm - 24.5).abs() < 0.1 && violations == 0, "{tip_mm} mm, {violations}");
    rig.close().await;
}
