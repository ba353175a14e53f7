//! Faults of the list in `docs/faults.md` that no other test shows, and the list itself.

use std::{collections::BTreeMap, fs};

use rig_engine::{CommandRefusal, RunStatus};
use rig_store::Record;
use rig_tests::{TestRig, shipped, text};
use rigd::{faults, rig::RequestRefusal};

#[test]
fn the_page_of_faults_is_the_one_that_the_code_prints() {
    let page = fs::read_to_string(shipped("docs/faults.md")).unwrap_or_default();
    assert!(page == faults::page(), "write docs/faults.md again with `rigd faults`");
}

#[test]
fn every_fault_has_a_reaction_and_a_test_that_exists_or_says_that_it_has_none() {
    let mut sources = BTreeMap::new();
    assert!(faults::all().map(|fault| fault.number).eq(1..=40));
    for fault in faults::all() {
        let has_none = fault.reaction.starts_with("**none");
        assert_eq!(fault.seen.is_none(), has_none, "{}", fault.what);
        assert_eq!(fault.tests.is_empty(), has_none, "{}", fault.what);
        if let Some(seen) = fault.seen {
            assert!(!seen().message.is_empty(), "{}", fault.what);
        }
        for (file, name) in fault.tests {
            let source = sources
                .entry(*file)
                .or_insert_with(|| fs::read_to_string(shipped(file)).expect("the file exists"));
            assert!(source.contains(&format!("fn {name}(")), "{file} has no {name}");
        }
    }
}

/// A reading after a restart or a lost answer must not carry the motion that the fault has left: the
/// checker would find its resonance wrong.
#[tokio::test]
async fn an_analyzer_that_restarts_or_falls_silent_spoils_no_reading() {
    let protocol = text("config/protocols/smoke.toml");
    let shifts = |rig: &TestRig, run| -> Vec<f64> {
        let shift = |stored: rig_store::StoredRecord| match stored.record() {
            Ok(Record::TouchResult(touch)) => Some(touch.shift_hz / touch.shift_sigma_hz),
            _ => None,
        };
        rig.records(run).into_iter().filter_map(shift).collect()
    };
    let (mut completed, mut faulted) = (0, 0);
    let faults = ["reboot", "drop-reply", "delay ms=3000"];
    for (nth, fault) in (1..400).step_by(37).flat_map(|nth| faults.map(|fault| (nth, fault))) {
        let rig = TestRig::open().await;
        rig.fault(&format!("fault analyzer {fault} nth={nth}"));
        let (run, status) = rig.run(rig.protocol(&protocol)).await;
        match status {
            RunStatus::Completed => completed += 1,
            RunStatus::Faulted => faulted += 1,
            other => panic!("{other:?}"),
        }
        assert!(shifts(&rig, run).iter().all(|shift| shift.is_finite()));
        let verdict = rig_verify::verify(rig.data(), &run.to_string()).expect("a journal");
        assert!(verdict.is_sound, "{fault} at message {nth}: {:?}", verdict.findings);
        rig.close().await;
    }
    assert!(
        completed + faulted == 33 && completed > 20,
        "{completed} completed, {faulted} faulted"
    );
}

#[tokio::test]
async fn of_many_starts_at_once_one_begins_a_run() {
    let rig = TestRig::open().await;
    let protocol = rig.protocol(&text("config/protocols/smoke.toml"));
    let starts = (0..8).map(|_| {
        let (handle, protocol) = (rig.handle.clone(), protocol.clone());
        tokio::spawn(async move { handle.run(protocol, "Ada").await })
    });
    let starts: Vec<_> = starts.collect();
    let (mut begun, mut refused) = (Vec::new(), 0);
    for start in starts {
        match start.await.expect("no panic") {
            Ok(run) => begun.push(run),
            Err(RequestRefusal::Command(CommandRefusal::State { .. })) => refused += 1,
            Err(other) => panic!("{other}"),
        }
    }
    assert_eq!((begun.len(), refused), (1, 7));
    assert_eq!(rig.ended(begun[0]).await, RunStatus::Completed);
    rig.close().await;
}
