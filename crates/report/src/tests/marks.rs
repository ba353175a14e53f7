//! Measured touches that are marked, because something that could speak against them was not measured.

use rig_record::{Amendment, Ending, Record, ReferenceJumped, RunFinished, RunStatus};

use super::{
    amended::amend,
    by_drift, inside,
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

/// A skip ends with a record of an end, which is not that of the run.
#[test]
fn a_touch_that_is_left_out_confirms_no_other() {
    let mut sample = SampleRun::new(Story::Faulted);
    let last =
        sample.results().touches().iter().rfind(|row| row.is_confirmed == Some(false)).cloned();
    let last = last.unwrap().step;
    // The run was killed.
    sample.chain.records.retain(|stored| stored.kind != "run_finished");
    let end = Record::RunFinished(RunFinished { status: Ending::Completed });
    amend(&mut sample, Amendment::Skip, vec![end]);
    let results = sample.results();
    let row = results.touches().iter().find(|row| row.step == last).unwrap();
    assert_ne!(row.is_confirmed, Some(true));
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

#[test]
fn touches_before_a_jump_of_the_resonance_are_marked_and_keep_their_reference() {
    let mut steady = SampleRun::new(Story::Complete);
    steady.change_start(by_drift);
    let before: Vec<_> = steady.results().touches().to_vec();
    assert!(before.iter().all(|row| row.is_reference_steady == Some(true)));
    assert!(!steady.results().text().contains("it jumped"));

    let jumped = &before[3];
    let (first, next) = (jumped.no_load_sweep.unwrap(), jumped.next_no_load_sweep.unwrap());
    let mut sample = SampleRun::new(Story::Complete);
    sample.change_start(by_drift);
    let record = Record::ReferenceJumped(ReferenceJumped {
        no_load_sweep: first,
        next_no_load_sweep: next,
        off_hz: 0.4,
        sigma_hz: 0.03,
        touches: vec![jumped.step.clone()],
    });
    let is_next = |record: Record| matches!(record, Record::Sweep(sweep) if sweep.number == next);
    let place = sample.chain.records.iter().position(|stored| is_next(stored.record().unwrap()));
    let place = place.unwrap();
    let mut stored = sample.chain.records[place].clone();
    (stored.kind, stored.payload) =
        (record.kind().to_owned(), serde_json::to_string(&record).unwrap());
    sample.chain.records.insert(place + 1, stored);
    let results = sample.results();
    let marked: Vec<_> =
        results.touches().iter().filter(|row| row.is_reference_unsteady()).collect();
    let [row] = marked[..] else { panic!("{marked:?}") };
    assert_eq!((&row.step, row.next_no_load_sweep), (&jumped.step, None));
    let said = results.shortfall().unwrap();
    let expected = format!("1 of them before a jump of the no-load resonance: {}", row.step);
    assert!(said.contains(&expected), "{said}");
    let note =
        "it jumped before the next reference of 1 of 110 touches; their shifts may be wrong by it";
    assert!(results.text().contains(note), "{}", results.text());
    let html = sample.html();
    assert!(html.contains("measured, resonance jumped"));
    assert!(inside(&html, "Frequency shifts with", "</caption>").contains(note));
    assert!(html.contains("0.400 Hz from where its drift lets it be expected"));
}

/// A rate says of how many touches it is, and paper has the reasons that its narrow table leaves out.
#[test]
fn refused_touches_are_counted_beside_the_recognition_and_have_their_reasons_on_paper() {
    let html = SampleRun::new(Story::Refused).html();
    let tile = inside(&html, "Blind recognition", "</div>");
    assert!(tile.contains("; 1 without a shift"), "{tile}");
    let paper = inside(&html, "<div class=\"paper\">", "</div>");
    let reason = "the analyzer flagged &lt;overload&gt; at 152.3 Hz in 3 of 3 tries";
    assert!(paper.contains(&format!("<li>main/2/left/45/1, blind/3: {reason}</li>")), "{paper}");
    let complete = SampleRun::new(Story::Complete).html();
    assert!(!complete.contains("without a shift") && !complete.contains("<div class=\"paper\">"));
}
