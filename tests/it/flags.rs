//! Readings that the analyzer flags: measured again, then refused by name, and never the end of the
//! journal.

use std::fs;

use rig_engine::{Command, RigState, RunStatus};
use rig_model::{DriveLevel, SweepMethod, SweepRequest, Window};
use rig_store::{
    Axis, ChainCheck, ReadingFlag, ReadingRecord, Record, RunId, StoredRecord, SweepOutcome,
};
use rig_tests::{TestRig, forge::Forgery, shipped};
use rig_verify::Finding;

const TCP: (&str, &str) =
    (r#"{ serial = "/dev/serial/by-id/analyzer", baud = 38400 }"#, r#"{ tcp = "127.0.0.1:5025" }"#);
const HIOKI: &str = r#"dialect = "hioki-im3536""#;

/// A family of analyzers: how the shipped rig file is changed for it, and its level, V.
type Family = (&'static [(&'static str, &'static str)], f64);

const FAMILIES: [Family; 3] = [
    (&[], 5.0),
    (
        &[(HIOKI, r#"dialect = "keysight-e4980a""#), ("max_level_v = 5", "max_level_v = 2"), TCP],
        2.0,
    ),
    (
        &[(HIOKI, r#"dialect = "keysight-e4990a""#), ("max_level_v = 5", "max_level_v = 1"), TCP],
        1.0,
    ),
];

/// The short protocol with one sample, upright, and no blind touches: three touches.
fn three_touches(level_v: f64) -> String {
    let text = fs::read_to_string(shipped("config/protocols/smoke.toml")).unwrap();
    let (text, _) = text.split_once("[blind]").unwrap();
    text.replace(r#"["1", "5"]"#, r#"["5"]"#)
        .replace("[0, 45]", "[0]")
        .replace("level_v = 5", &format!("level_v = {level_v}"))
}

fn request(level_v: f64) -> SweepRequest {
    SweepRequest {
        window: Window { min_hz: 120.0, max_hz: 165.0 },
        method: SweepMethod::Adaptive,
        target_sigma_hz: 0.05,
        time_limit_s: 30.0,
        cycles: 10,
        settle_s: 0.0,
        level: DriveLevel { volt: level_v },
    }
}

/// Measures by hand, and returns the readings and the outcome from the journal.
async fn measure(rig: &TestRig, level_v: f64) -> (Vec<ReadingRecord>, SweepOutcome) {
    let number = rig.handle.sweep(request(level_v), "test").await.unwrap();
    let status = rig.wait_for("the sweep", |status| status.sweep.is_none()).await;
    let sweep =
        rig.records(status.session).into_iter().find_map(|stored| match stored.record().unwrap() {
            Record::Sweep(sweep) if sweep.number == number => Some(sweep),
            _ => None,
        });
    let sweep = sweep.expect("the sweep is in the journal");
    (sweep.readings, sweep.outcome)
}

fn flagged(readings: &[ReadingRecord]) -> usize {
    readings.iter().filter(|reading| reading.flag == ReadingFlag::Overload).count()
}

/// Number of measured touches of a run, and the reasons of the refused ones.
fn touches(records: &[StoredRecord]) -> (usize, Vec<String>) {
    let (mut measured, mut refused) = (0, Vec::new());
    for stored in records {
        match stored.record().unwrap() {
            Record::TouchResult(_) => measured += 1,
            Record::TouchRefused(touch) => refused.push(touch.reason),
            _ => {}
        }
    }
    (measured, refused)
}

/// Flagged readings did not close the journal, and its records are intact.
#[track_caller]
fn assert_journal_is_open(rig: &TestRig, run: RunId) {
    assert_eq!(rig.handle.status().borrow().journal_error, None);
    assert!(matches!(rig.reader().verify(run).unwrap(), ChainCheck::Intact { .. }));
}

#[tokio::test]
async fn a_flagged_reading_is_measured_again_and_one_that_stays_is_refused_by_name() {
    for (changes, level_v) in FAMILIES {
        let rig = TestRig::open_changed(changes).await;
        rig.fault("fault analyzer overload");
        let (readings, outcome) = measure(&rig, level_v).await;
        assert!(matches!(outcome, SweepOutcome::Accepted { .. }), "{changes:?}: {outcome:?}");
        assert_eq!(flagged(&readings), 1, "{changes:?}");
        let is_value = |one: &&ReadingRecord| one.impedance_ohm().is_some();
        assert_eq!(readings.iter().filter(is_value).count(), readings.len() - 1);

        rig.fault("fault analyzer overload rate=1");
        let (readings, outcome) = measure(&rig, level_v).await;
        let SweepOutcome::Refused { reason } = outcome else { panic!("{changes:?}: {outcome:?}") };
        let hz = readings[0].frequency_hz;
        let expected = format!("the analyzer flagged overload at {hz} Hz in 3 of 3 tries");
        assert_eq!((reason, flagged(&readings)), (expected, 3), "{changes:?}");

        rig.fault("clear");
        assert_eq!(flagged(&measure(&rig, level_v).await.0), 0);
        assert_eq!(rig.handle.status().borrow().journal_error, None);
        rig.close().await;
    }
}

#[tokio::test]
async fn a_run_with_some_flagged_readings_measures_every_touch() {
    for (changes, level_v) in FAMILIES {
        let rig = TestRig::open_changed(changes).await;
        rig.fault("fault analyzer overload rate=0.02");
        let (run, ending) = rig.run(rig.protocol(&three_touches(level_v))).await;
        let records = rig.records(run);
        let mut seen = 0;
        for stored in &records {
            seen += match stored.record().unwrap() {
                Record::Sweep(sweep) => flagged(&sweep.readings),
                Record::SurfaceFound(found) => {
                    let trail: Vec<_> = found.trail.iter().map(|tried| tried.reading).collect();
                    flagged(&trail)
                }
                _ => 0,
            };
        }
        assert!(seen > 0, "{changes:?}: nothing was flagged");
        assert_eq!(ending, RunStatus::Completed, "{changes:?}");
        assert_eq!(touches(&records), (3, Vec::new()), "{changes:?}");
        assert_journal_is_open(&rig, run);
        rig.close().await;
    }
}

/// The analyzer is asked once for each reading. So the readings of a run without faults say which
/// of its questions belongs to which part of the first touch.
#[tokio::test]
async fn a_touch_whose_readings_stay_flagged_is_refused_and_the_run_goes_on() {
    let rig = TestRig::open().await;
    let (run, _) = rig.run(rig.protocol(&three_touches(5.0))).await;
    let (mut no_load, mut search, mut heights) = (None, None, Vec::new());
    for stored in rig.records(run) {
        match stored.record().unwrap() {
            Record::Sweep(sweep) => _ = no_load.get_or_insert(sweep.readings.len()),
            Record::Moved(moved) if moved.axis == Axis::LinearMm => heights.push(moved.target),
            Record::SurfaceFound(found) if search.is_none() => {
                // On the way down to the search, there is a reading after each step.
                let way = heights.iter().skip(1).filter(|at| found.trail[0].position_mm < **at);
                search = Some((way.count(), found.trail.len()));
            }
            _ => {}
        }
    }
    rig.close().await;
    let (no_load, (way, search)) = (no_load.unwrap(), search.unwrap());
    assert!(way >= 10 && search >= 10, "{way}, {search}");
    // A few more questions set the analyzer up; a sweep in contact is tried twice.
    for (first, frames, is_in_contact) in [
        (no_load + 10, 3, false),
        (no_load + way + 10, 3, false),
        (no_load + way + search + 14, 6, true),
    ] {
        let rig = TestRig::open().await;
        for nth in first..first + frames {
            rig.fault(&format!("fault analyzer overload nth={nth}"));
        }
        let (run, ending) = rig.run(rig.protocol(&three_touches(5.0))).await;
        assert_eq!(ending, RunStatus::CompletedWithRefusals);
        let records = rig.records(run);
        let (measured, refused) = touches(&records);
        assert_eq!((measured, refused.len()), (2, 1), "{refused:?}");
        assert!(refused[0].starts_with("the analyzer flagged overload at 1"), "{refused:?}");
        let is_lost = |stored: &&StoredRecord| stored.kind == "surface_not_found";
        assert_eq!(records.iter().any(|stored| is_lost(&stored)), !is_in_contact);
        assert_journal_is_open(&rig, run);
        rig.close().await;
    }
}

/// Plays three touches on a rig whose analyzer flags this many messages from one on. Returns the no-load sweeps behind the last
/// result, whether each was accepted.
async fn closed_by(rig: &TestRig, first: usize, count: usize) -> (RunId, RunStatus, Vec<bool>) {
    for nth in first..first + count {
        rig.fault(&format!("fault analyzer overload nth={nth}"));
    }
    let (run, ending) = rig.run(rig.protocol(&three_touches(5.0))).await;
    let mut sweeps = Vec::new();
    for stored in rig.records(run) {
        match stored.record().unwrap() {
            Record::TouchResult(_) => sweeps.clear(),
            Record::Sweep(sweep) => {
                sweeps.push(matches!(sweep.outcome, SweepOutcome::Accepted { .. }));
            }
            _ => {}
        }
    }
    (run, ending, sweeps)
}

/// When a run ends whose analyzer flags three messages from this one on, µs.
async fn end_us(first: usize) -> u64 {
    let rig = TestRig::open().await;
    let (run, ..) = closed_by(&rig, first, 3).await;
    let end_us = rig.records(run).last().unwrap().rig_us;
    rig.close().await;
    end_us
}

/// The impedance of the clear probe is read after the last touch of a run, and no record has it.
#[tokio::test]
async fn flagged_readings_confirm_no_last_touch() {
    // Messages behind the end of a run change nothing in it.
    let mut ends = [60, 2000];
    let undisturbed_us = end_us(ends[1]).await;
    while ends[0] + 1 < ends[1] {
        let middle = usize::midpoint(ends[0], ends[1]);
        ends[usize::from(end_us(middle).await == undisturbed_us)] = middle;
    }
    let closing = ends[0];
    let rig = TestRig::open().await;
    let (run, ending, sweeps) = closed_by(&rig, closing, 3).await;
    assert_eq!((ending, &*sweeps), (RunStatus::Completed, &[true][..]), "message {closing}");
    let verdict = rig_verify::verify(rig.data(), &run.to_string()).unwrap();
    assert!(verdict.is_sound, "{:#?}", verdict.findings);
    rig.close().await;

    let rig = TestRig::open().await;
    let (run, ending, sweeps) = closed_by(&rig, closing, 100).await;
    assert_eq!((ending, &*sweeps), (RunStatus::Faulted, &[false; 2][..]));
    let (measured, refused) = touches(&rig.records(run));
    assert_eq!((measured, refused.len()), (3, 1));
    // The sweeps that a doubted touch cites are its own, and not those that cast the doubt.
    let (mut cited, mut doubted) = (None, None);
    for stored in rig.records(run) {
        match stored.record().unwrap() {
            Record::TouchResult(result) => cited = Some((result.no_load_sweep, result.sweep)),
            Record::TouchRefused(refused) => {
                doubted = refused.indented.map(|indented| (refused.no_load_sweep, indented.sweep));
            }
            _ => {}
        }
    }
    assert!(doubted.is_some());
    assert_eq!(doubted, cited);
    assert!(refused[0].contains("the analyzer flagged overload at "), "{refused:?}");
    let mut forged = Forgery::of(rig.data(), &run.to_string());
    assert!(forged.verdict().is_sound, "{:#?}", forged.verdict().findings);
    forged.records.retain(|record| !["fault", "touch_refused"].contains(&&*record.kind));
    let end = forged.nth("run_finished", 0, |_| true);
    forged.records[end].payload["status"] = "completed".into();
    forged.write(true);
    let findings = forged.verdict().findings;
    let is_found = |finding: &Finding| finding.to_string().contains("the last no-load sweep");
    assert!(findings.iter().any(is_found), "{findings:#?}");
    rig.close().await;
}

#[tokio::test]
async fn an_overload_that_stays_latches_the_rig_with_the_device_as_its_first_cause() {
    for (changes, level_v) in FAMILIES {
        let rig = TestRig::open_changed(changes).await;
        rig.fault("fault analyzer overload rate=1");
        let (run, ending) = rig.run(rig.protocol(&three_touches(level_v))).await;
        assert_eq!(ending, RunStatus::Faulted, "{changes:?}");
        let status = rig.wait_for("the latch", |s| s.snapshot.state == RigState::Latched).await;
        let cause = status.snapshot.fault.unwrap().to_string();
        let begins = "the no-load resonance was refused 2 times: the analyzer flagged overload at ";
        assert!(cause.starts_with(begins) && cause.ends_with("in 3 of 3 tries"), "{cause}");
        assert_journal_is_open(&rig, run);
        rig.fault("clear");
        rig.command(Command::Acknowledge).await.unwrap();
        rig.wait_for("service", |status| status.snapshot.state == RigState::Idle).await;
        let (_, ending) = rig.run(rig.protocol(&three_touches(level_v))).await;
        assert_eq!(ending, RunStatus::Completed, "{changes:?}");
        rig.close().await;
    }
}
