//! Measured touches that are marked, because something that could speak against them was not measured.

use rig_record::{Ending, Record, RunFinished, RunStatus};

use super::{
    inside,
    sample::{SampleRun, Story},
};
use crate::TouchStatus;

#[test]
fn the_last_touch_of_a_run_that_ended_early_is_not_confirmed() {
    let complete = SampleRun::new(Story::Complete).results();
    assert!(complete.touches().iter().all(|row| row.is_confirmed == Some(true)));
    assert_eq!(complete.shortfall(), None);

    let mut sample = SampleRun::new(Story::Faulted);
    let faulted = sample.results();
    let measured = || faulted.touches().iter().filter(|row| row.status == TouchStatus::Measured);
    let last = measured().next_back().unwrap();
    assert_eq!(last.is_confirmed, Some(false));
    assert!(
        measured().filter(|row| row.step != last.step).all(|row| row.is_confirmed == Some(true))
    );
    let sentence = format!("1 of them not confirmed: {}", last.step);
    assert!(faulted.shortfall().unwrap().contains(&sentence), "{:?}", faulted.shortfall());
    assert!(sample.html().contains("measured, not confirmed"));

    // A run that goes on may still confirm its last touch.
    sample.run.status = RunStatus::Running;
    sample.chain.records.retain(|stored| stored.kind != "run_finished");
    let row = sample.results().touches().iter().find(|row| row.step == last.step).cloned();
    assert_eq!(row.unwrap().is_confirmed, None);
}

#[test]
fn a_run_that_was_aborted_after_its_last_touch_says_that_nothing_confirms_it() {
    let mut sample = SampleRun::new(Story::Complete);
    let end = sample.chain.records.last_mut().unwrap();
    assert_eq!(end.kind, "run_finished");
    let aborted = Record::RunFinished(RunFinished { status: Ending::Aborted });
    end.payload = serde_json::to_string(&aborted).unwrap();
    sample.run.status = RunStatus::Ended(Ending::Aborted);
    let said = sample.results().shortfall().unwrap();
    assert!(said.starts_with("110 of 110 touches measured; 1 of them not confirmed: "), "{said}");
}

#[test]
fn touches_without_a_check_of_slip_are_marked_wherever_their_values_are() {
    let note = "none in 110 of 110 touches; steps lost there would not show";
    let checked = SampleRun::new(Story::Complete);
    assert!(checked.results().touches().iter().all(|row| row.is_slip_checked == Some(true)));
    for text in [checked.html(), checked.results().text()] {
        assert!(!text.contains("steps lost there"), "{text}");
    }

    // Nor does a journal say it that is older than the mark; the sample has no record of a check.
    for mark in [Some(false), None] {
        check_marks(mark, note);
    }
}

#[track_caller]
fn check_marks(mark: Option<bool>, note: &str) {
    let mut sample = SampleRun::new(Story::Complete);
    sample.change_touches(|touch| touch.is_slip_checked = mark);
    let results = sample.results();
    assert!(results.touches().iter().all(|row| row.is_slip_checked == Some(false)));
    let said = results.shortfall().unwrap();
    let expected = "110 of 110 touches measured; 110 of them not checked for slip: ";
    assert!(said.starts_with(expected), "{said}");
    assert!(results.text().contains(note), "{}", results.text());
    let html = sample.html();
    for table in ["Frequency shifts with", "Young's modulus of the samples"] {
        let caption = inside(&html, table, "</caption>");
        assert!(caption.contains(note), "{caption}");
    }
    assert_eq!(html.matches("measured, slip not checked").count(), 110);
    assert!(html.contains("110 of them not checked for slip"));
}
