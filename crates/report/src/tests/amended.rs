//! Runs that were resumed or amended.

use rig_record::{Action, Amended, Amendment, Record, Resumed, RunId, StepStarted, Touch};
use uuid::Uuid;

use super::{
    check_markup,
    sample::{SampleRun, Story, chain},
};
use crate::{TouchRow, TouchStatus, units::with_sigma};

/// The records of an amendment of the first touch: of this kind, with these records behind it.
fn amend(sample: &mut SampleRun, what: Amendment, mut behind: Vec<Record>) {
    let amended = Amended {
        run: sample.run.id.to_string(),
        head: String::new(),
        step: "main/1/front/0/1".to_owned(),
        what,
        who: "Ada".to_owned(),
        why: "the sample had slipped".to_owned(),
        software: String::new(),
        devices: Vec::new(),
        changes: Vec::new(),
    };
    behind.insert(0, Record::Amended(amended));
    let records: Vec<_> = behind.into_iter().map(|record| (5_000_000, record)).collect();
    for mut stored in chain(&records).records {
        stored.run = RunId::new(Uuid::from_u128(7));
        stored.epoch = 3;
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

#[test]
fn a_resumed_run_counts_the_time_of_its_parts_and_not_the_time_between_them() {
    let mut sample = SampleRun::new(Story::Faulted);
    let last_us = sample.chain.records.last().unwrap().run_us;
    let resumed = Resumed {
        epoch: 2,
        who: "Ada".to_owned(),
        next: Some("main/1/back/45/1".to_owned()),
        touches_done: 7,
        touches_left: 103,
        changes: Vec::new(),
        software: String::new(),
        rig: None,
        scene: None,
        devices: Vec::new(),
    };
    let mut touch = first_touch(&sample);
    touch.touch.step = "main/1/back/45/1".to_owned();
    let begun = StepStarted {
        step: touch.touch.step.clone(),
        index: 1,
        count: 1,
        action: Action::NoLoad { pose: touch.touch.pose },
    };
    let records = [
        (2_000_000, Record::Resumed(resumed)),
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
