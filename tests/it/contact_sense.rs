//! A contact sense that lies in the middle of a run: no touch keeps a shift that is not one.

use rig_engine::RunStatus;
use rig_store::Record;
use rig_tests::{TestRig, touches_of_smoke};

/// Plays two touches on the stiffest sample with a fault at the n-th message to the analyzer, and
/// returns the shifts that stand at the end.
async fn shifts_with(fault: &str, nth: u32) -> (Vec<f64>, RunStatus, Option<String>) {
    let rig = TestRig::open().await;
    rig.fault(&format!("fault {fault} nth={nth}"));
    let (run, status) = rig.run(rig.protocol(&touches_of_smoke("[0, 30]"))).await;
    let (mut shifts, mut cause) = (Vec::new(), None);
    for stored in rig.records(run) {
        match stored.record() {
            Ok(Record::TouchResult(touch)) => shifts.push((touch.touch.step, touch.shift_hz)),
            Ok(Record::TouchRefused(refused)) => {
                shifts.retain(|(step, _)| *step != refused.touch.step);
            }
            Ok(Record::Fault(fault)) => cause = cause.or(Some(fault.cause)),
            _ => {}
        }
    }
    rig.close().await;
    (shifts.into_iter().map(|(_, shift_hz)| shift_hz).collect(), status, cause)
}

async fn check_each(fault: &str) {
    let mut noticed = 0;
    for nth in (1..170).step_by(7) {
        let (shifts, status, cause) = shifts_with(fault, nth).await;
        // Sample 5 moves the resonance by 55 Hz to 105 Hz.
        let are_true = shifts.iter().all(|shift_hz| (55.0..105.0).contains(shift_hz));
        assert!(are_true, "{fault} at message {nth}: {shifts:?}, {status:?} {cause:?}");
        noticed += u32::from(status != RunStatus::Completed);
    }
    assert!(noticed > 15, "{fault} was noticed {noticed} times");
}

#[tokio::test]
async fn a_stuck_contact_sense_leaves_no_wrong_shift() {
    check_each("analyzer stuck-contact").await;
}

#[tokio::test]
async fn an_analyzer_that_does_not_follow_the_frequency_leaves_no_wrong_shift() {
    check_each("analyzer stuck-frequency").await;
}

#[tokio::test]
async fn a_blind_contact_sense_leaves_no_wrong_shift() {
    check_each("analyzer blind-contact").await;
}

#[tokio::test]
async fn lost_steps_refuse_the_touch_or_are_noticed_at_the_next_surface() {
    let (mut refused, mut faulted) = (0, 0);
    for nth in (30..180).step_by(15) {
        for by in ["0.3", "-0.3", "-0.1"] {
            let fault = format!("bus lose-steps by={by} unit=1");
            let (shifts, status, cause) = shifts_with(&fault, nth).await;
            // Sample 5 moves the resonance by 55 Hz to 105 Hz.
            let are_true = shifts.iter().all(|shift_hz| (55.0..105.0).contains(shift_hz));
            assert!(are_true, "{fault} at message {nth}: {shifts:?}, {status:?} {cause:?}");
            refused += u32::from(status == RunStatus::CompletedWithRefusals);
            if status == RunStatus::Faulted {
                let cause = cause.unwrap_or_default();
                assert!(cause.contains("touches before on this sample"), "{cause}");
                faulted += 1;
            }
        }
    }
    assert!(refused >= 2 && faulted >= 2, "refused {refused} times, faulted {faulted} times");
}
