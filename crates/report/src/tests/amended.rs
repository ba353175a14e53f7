//! Runs that were resumed or amended.

use rig_record::{
    Action, Amended, Amendment, Change, CitedCalibration, Clearance, Fault, Record, Resumed, RunId,
    RunStarted, RunStatus, ScrewMap, Source, StepStarted, Touch,
};
use uuid::Uuid;

use super::{
    check_markup,
    sample::{SampleRun, Story, chain},
};
use crate::{TouchRow, TouchStatus, data::Part, units::with_sigma};

/// The records of an amendment of the first touch: of this kind, with these records behind it.
pub(super) fn amend(sample: &mut SampleRun, what: Amendment, behind: Vec<Record>) {
    amend_on(sample, what, (None, None), behind);
}

/// The same, with another rig file and other calibrations than those of the run.
fn amend_on(
    sample: &mut SampleRun,
    what: Amendment,
    (rig, calibrations): (Option<Source>, Option<Vec<CitedCalibration>>),
    mut behind: Vec<Record>,
) {
    let event = sample.chain.records.last().unwrap().event;
    let amended = Amended {
        run: sample.run.id.to_string(),
        head: String::new(),
        step: "main/1/front/0/1".to_owned(),
        what,
        who: "Ada".to_owned(),
        why: "the sample had slipped".to_owned(),
        software: String::new(),
        rig,
        calibrations,
        devices: Vec::new(),
        changes: Vec::new(),
    };
    behind.insert(0, Record::Amended(amended));
    let records: Vec<_> = behind.into_iter().map(|record| (5_000_000, record)).collect();
    for mut stored in chain(&records).records {
        stored.run = RunId::new(Uuid::from_u128(7));
        stored.epoch = 3;
        stored.event += event;
        sample.chain.records.push(stored);
    }
}

/// The first measured touch of a run.
fn first_touch(sample: &SampleRun) -> Touch {
    let mut records = sample.chain.records.iter().map(|stored| stored.record().unwrap());
    records
        .find_map(|record| match record {
            Record::TouchResult(touch) => Some(touch),
            _ => None,
        })
        .unwrap()
}

#[test]
fn an_amended_touch_keeps_its_old_outcome_beside_the_new_one() {
    let mut sample = SampleRun::new(Story::Complete);
    let mut touch = first_touch(&sample);
    assert_eq!(touch.touch.step, "main/1/front/0/1");
    let before = sample.results();
    touch.shift_hz = 99.0;
    amend(&mut sample, Amendment::Redo, vec![Record::TouchResult(touch)]);
    let redone = sample.results();
    let row = &redone.touches()[0];
    assert_eq!((row.status, row.shift_hz), (TouchStatus::Measured, Some(99.0)));
    assert_eq!(row.amended.as_deref(), Some("redo by Ada: the sample had slipped"));
    let shift = with_sigma(
        before.touches()[0].shift_hz.unwrap(),
        before.touches()[0].shift_sigma_hz.unwrap(),
    );
    assert_eq!(row.earlier, Some(format!("shift {shift} Hz")));
    // Every other touch is unchanged.
    assert!(redone.touches()[1..].iter().zip(&before.touches()[1..]).all(|(a, b)| {
        (&a.step, a.shift_hz, a.amended.is_none()) == (&b.step, b.shift_hz, true)
    }));

    amend(&mut sample, Amendment::Skip, Vec::new());
    let skipped = sample.results();
    let row = &skipped.touches()[0];
    assert_eq!((row.status, row.shift_hz), (TouchStatus::Skipped, None));
    assert_eq!(row.earlier, Some(format!("shift {shift} Hz; shift 99.000 ± 0.052 Hz")));
    assert_eq!(skipped.shortfall().unwrap(), "109 of 110 touches measured; 1 skipped");
    let html = sample.html();
    check_markup(&html);
    assert!(html.contains("skipped (skip by Ada: the sample had slipped)"));
}

/// A calibration with a screw whose error grows by this for each millimetre.
fn map(file: &str, error_per_mm: f64) -> CitedCalibration {
    let text = str::to_owned;
    CitedCalibration {
        kind: text("blocks"),
        made: text("2026-11-28T08:00:00Z"),
        person: text("Ada"),
        file: text(file),
        sha256: text(file),
        verdict: None,
        screw: Some(ScrewMap {
            heights_mm: vec![0.0, 50.0],
            errors_mm: vec![0.0, 50.0 * error_per_mm],
            covariance_um2: vec![vec![1.0], vec![0.0, 1.0]],
        }),
        cable: None,
    }
}

fn started(sample: &SampleRun) -> RunStarted {
    match sample.chain.records[0].record().unwrap() {
        Record::RunStarted(started) => started,
        other => panic!("{other:?}"),
    }
}

/// The stiffness by the first touch, measured again alike on this, over that before; and what is said of the screw.
fn redone_on(on: (Option<Source>, Option<Vec<CitedCalibration>>)) -> (Option<f64>, Option<String>) {
    let mut sample = SampleRun::new(Story::Complete);
    let (before, mut touch) = (sample.results(), first_touch(&sample));
    touch.sweep = 1000;
    amend_on(&mut sample, Amendment::Redo, on, vec![Record::TouchResult(touch)]);
    let after = sample.results();
    for (row, earlier) in after.touches().iter().zip(before.touches()).skip(1) {
        assert!(row.stiffness_mpa.is_some() == earlier.stiffness_mpa.is_some(), "{}", row.step);
    }
    let redone = &after.touches()[0];
    let why = "no stiffness: the rig file of this part of the run describes another sensor";
    assert_eq!(redone.reason.as_deref(), redone.stiffness_mpa.is_none().then_some(why));
    let [was, is] = [&before, &after].map(|results| results.touches()[0].stiffness_mpa);
    (is.map(|is| is / was.unwrap()), after.screw_note())
}

#[test]
fn a_touch_rests_on_the_rig_file_and_the_calibrations_with_which_it_was_measured() {
    let rig = rig();
    let other = |from: &str, to: &str| {
        assert!(rig.toml.contains(from), "{}", rig.toml);
        Some(Source { toml: rig.toml.replacen(from, to, 1), ..rig.clone() })
    };
    let (same, note) = redone_on((None, None));
    assert!((same.unwrap() - 1.0).abs() < 1e-9 && note.is_none(), "{same:?}");

    let renamed = other("name = \"simulated bench\"", "name = \"renamed\"");
    assert!((redone_on((renamed, None)).0.unwrap() - 1.0).abs() < 1e-9);
    // One model does not hold for two sensors.
    let longer = other("length_mm = 35", "length_mm = 36");
    assert_eq!(redone_on((longer, None)).0, None);
    // The true depth is less, so that the sample is stiffer.
    let (mapped, note) = redone_on((None, Some(vec![map("2026-11-28.toml", 0.05)])));
    assert!(mapped.unwrap() > 1.01, "{mapped:?}");
    assert!(note.unwrap().contains("by 2026-11-28.toml is taken out of 1 of 110"));
}

#[test]
fn a_map_that_an_older_journal_does_not_have_corrects_nothing() {
    let change =
        |what: &str| Change { what: what.to_owned(), was: String::new(), is: String::new() };
    let part = Part { rig: Some(rig()), calibrations: vec![map("a", 0.1)] };
    let after = |what: &str| part.after(&[change(what)], None, None);
    assert_eq!(after("software"), part);
    assert_eq!(after("calibration (blocks)"), Part { calibrations: Vec::new(), ..part.clone() });
    assert_eq!(after("rig file"), Part { rig: None, ..part.clone() });
    let named = part.after(&[change("calibration (blocks)")], None, Some(vec![map("b", 0.2)]));
    assert_eq!(named.calibrations, [map("b", 0.2)]);
}

fn rig() -> Source {
    started(&SampleRun::new(Story::Complete)).rig
}

/// The run goes on at the touch in which a fault ended it.
fn resumed() -> Record {
    Record::Resumed(Resumed {
        epoch: 2,
        who: "Ada".to_owned(),
        next: Some("main/1/back/45/1".to_owned()),
        touches_done: 7,
        touches_left: 103,
        changes: Vec::new(),
        software: String::new(),
        rig: None,
        scene: None,
        calibrations: None,
        devices: Vec::new(),
    })
}

#[test]
fn a_touch_that_was_begun_before_its_run_went_on_has_not_begun() {
    let mut sample = SampleRun::new(Story::Faulted);
    let reason = |sample: &SampleRun| {
        let results = sample.results();
        let is_it = |row: &&TouchRow| row.step == "main/1/back/45/1";
        results.touches().iter().find(is_it).unwrap().reason.clone().unwrap()
    };
    assert!(reason(&sample).starts_with("a fault ended the run during this touch"));
    sample.chain.records.extend(chain(&[(2_000_000, resumed())]).records);
    for (status, expected) in [
        (RunStatus::Running, "the run is under way"),
        (RunStatus::Interrupted, "rigd ended, before the end of the run"),
    ] {
        sample.run.status = status;
        assert_eq!(reason(&sample), expected);
    }
}

#[test]
fn a_resumed_run_counts_the_time_of_its_parts_and_not_the_time_between_them() {
    let mut sample = SampleRun::new(Story::Faulted);
    let last_us = sample.chain.records.last().unwrap().run_us;
    let mut touch = first_touch(&sample);
    touch.touch.step = "main/1/back/45/1".to_owned();
    let begun = StepStarted {
        step: touch.touch.step.clone(),
        index: 1,
        count: 1,
        action: Action::NoLoad { pose: touch.touch.pose },
    };
    let records = [
        (2_000_000, resumed()),
        (3_000_000, Record::StepStarted(begun)),
        (4_000_000, Record::TouchResult(touch)),
    ];
    for mut stored in chain(&records).records {
        // An hour later by the wall clock, and the clock of the rig began again.
        stored.run_us += last_us + 3_600_000_000;
        stored.epoch = 2;
        sample.chain.records.push(stored);
    }
    let results = sample.results();
    assert_eq!(results.summary().rig_seconds, (last_us + 2_000_000) as f64 / 1e6);
    let is_it = |row: &&TouchRow| row.step == "main/1/back/45/1";
    let row = results.touches().iter().find(is_it).unwrap();
    assert_eq!((row.status, row.attempts, row.clock), (TouchStatus::Measured, 2, Some(2)));
    let first = &results.touches()[0];
    assert_eq!((first.attempts, first.clock), (1, Some(1)));
    assert!(sample.html().contains("resumed by Ada at main/1/back/45/1; 103 touches left"));
}

/// The row, the drift and the times of a run stay what they were, as nothing has replaced them.
#[test]
fn a_measurement_that_is_begun_again_and_fails_leaves_the_one_before() {
    let mut sample = SampleRun::new(Story::Complete);
    let before = sample.results();
    let touch = first_touch(&sample);
    let reference = before.data.sweep(touch.no_load_sweep).unwrap().clone();
    let begun = StepStarted {
        step: touch.touch.step.clone(),
        index: 1,
        count: 1,
        action: Action::NoLoad { pose: touch.touch.pose },
    };
    let fault = Fault {
        step: None,
        cause: "the line has failed".to_owned(),
        probe: Clearance::Clear,
        hint: String::new(),
        last_moves_mm: None,
    };
    let behind = vec![Record::StepStarted(begun), Record::Sweep(reference), Record::Fault(fault)];
    amend(&mut sample, Amendment::Redo, behind);
    let after = sample.results();
    let (was, is) = (&before.touches()[0], &after.touches()[0]);
    assert_eq!((&is.started_at, is.clock), (&was.started_at, was.clock));
    assert_eq!(is.attempts, was.attempts + 1);
    assert_eq!(after.data.fault, None);
    assert_eq!(after.references.len(), before.references.len());
}
