//! What was planned and what became of it: the story of a run that ended early, and the matrix of touches.

use maud::{Markup, html};
use rig_record::{Ending, Phase, RunStatus};

use super::{
    element::{fault, table, text},
    tables,
};
use crate::{
    data::DIRECTIONS,
    results::{RunResults, status::Tally},
};

/// Whether the run ended before its last step.
pub(super) const fn ended_early(results: &RunResults) -> bool {
    matches!(
        results.run.status,
        RunStatus::Interrupted
            | RunStatus::Ended(Ending::Aborted | Ending::Faulted | Ending::Interrupted)
    )
}

/// Lines of the log before the first fault that belong to its story.
const LINES_BEFORE: usize = 6;

/// What happened in a run that ended early: the lines of the log about its end.
pub(super) fn story(results: &RunResults) -> Markup {
    let log = &results.data.log;
    let fault = log.iter().position(|entry| Some(entry.run_us) == first_fault_us(results));
    let first = fault.unwrap_or(log.len()).saturating_sub(LINES_BEFORE);
    let last = results.data.planned.iter().rev().find(|touch| touch.attempts > 0);
    html! {
        @if let Some(touch) = last {
            p { "The last touch that was begun is " b { (touch.settings.step) } "." }
        } @else {
            p { "No touch was begun." }
        }
        @if !log.is_empty() {
            (tables::log_lines(&log[first..], "The last events of the run, in order."))
        }
    }
}

fn first_fault_us(results: &RunResults) -> Option<u64> {
    results.data.faults().next().map(|entry| entry.run_us)
}

/// What became of the planned touches, by sample, direction and angle.
pub(super) fn matrix(results: &RunResults) -> Markup {
    if results.touches.is_empty() {
        return html! {};
    }
    let directions = results.directions();
    let angles: Vec<f64> = {
        let mut angles: Vec<f64> = results.grid.iter().map(|row| row.angle_deg).collect();
        angles.sort_by(f64::total_cmp);
        angles.dedup();
        angles
    };
    let mut heads = vec!["sample".to_owned()];
    for &direction in &directions {
        heads.extend(
            angles.iter().map(|angle| format!("{} {angle}°", DIRECTIONS[direction].name())),
        );
    }
    let has_blind = results.data.planned.iter().any(|touch| touch.settings.phase == Phase::Blind);
    heads.extend(has_blind.then(|| "blind".to_owned()));
    let row = |(index, sample): (usize, &rig_record::Sample)| {
        let mut row = vec![text(&sample.name)];
        for &direction in &directions {
            for &angle in &angles {
                let planned =
                    results.grid.iter().find(|row| (row.sample, row.angle_deg) == (index, angle));
                row.push(cell(planned.map(|row| row.directions[direction]).unwrap_or_default()));
            }
        }
        if has_blind {
            let of_sample = results.data.planned.iter().filter(|touch| {
                touch.settings.phase == Phase::Blind && touch.settings.sample == sample.name
            });
            row.push(cell(Tally::of(of_sample.map(crate::data::PlannedTouch::status))));
        }
        row
    };
    let rows: Vec<_> = results.data.samples().iter().enumerate().map(row).collect();
    let caption = "What became of the planned touches: ✓ measured, ✕ refused, ∅ left out, · not reached; with their number \
                   where there are several.";
    html! { div.matrix { (table(caption, &heads, &rows)) } }
}

/// The statuses of the touches of a cell, each as its sign.
fn cell(tally: Tally) -> Markup {
    let Tally { planned, measured, refused, skipped, not_reached } = tally;
    let sign = |count: usize, sign: &str| {
        if planned == 1 { sign.to_owned() } else { format!("{count}\u{a0}{sign}") }
    };
    html! {
        @if measured > 0 { span.good { (sign(measured, "✓")) } " " }
        @if refused > 0 { (fault(&sign(refused, "✕"))) " " }
        @if skipped > 0 { span { (sign(skipped, "∅")) } " " }
        @if not_reached > 0 { span.soft { (sign(not_reached, "·")) } }
    }
}
