//! The tables of the report.

use maud::{Markup, html};
use rig_analysis::shift::{DirectionMean, Mean};

use super::element::{dash, fault, table, text};
use crate::{
    data::{DIRECTIONS, LogEntry, LogKind, RunData},
    results::{
        RunResults,
        classification::Classification,
        grid::GridRow,
        status::{Tally, TouchStatus},
        touches::TouchRow,
    },
    units::{clock, decimals_for, fixed, with_sigma},
};

/// Every shift with its uncertainties, or the status of the touches without one.
pub(super) fn shifts(results: &RunResults) -> Markup {
    let directions = results.directions();
    let mut heads = vec!["sample".to_owned(), "angle".to_owned()];
    heads.extend(directions.iter().map(|&d| format!("{} (Hz)", DIRECTIONS[d].name())));
    heads.extend(["mean (Hz)".to_owned(), "between directions (Hz)".to_owned()]);
    let row = |planned: &GridRow| {
        let GridRow { sample, angle_deg, .. } = *planned;
        let name = &results.data.samples()[sample].name;
        let mut row = vec![text(name), text(format!("{angle_deg}°"))];
        for &direction in &directions {
            let mean = results.direction_mean(sample, angle_deg, direction);
            row.push(of_some(planned.directions[direction], mean.map(shift)));
        }
        let mean = results.angle_mean(sample, angle_deg).map(|mean| mean.mean);
        let with_error = |mean: Mean| with_sigma(mean.shift_hz, mean.standard_error_hz());
        let bold = mean.map(|mean| html! { b { (with_error(mean)) } });
        row.push(of_some(planned.over_directions(), bold));
        let spread = |spread| text(fixed(spread, decimals_for(spread).min(3)));
        row.push(mean.and_then(|mean| mean.spread_hz).map_or_else(dash, spread));
        row
    };
    let rows: Vec<_> = results.grid.iter().map(row).collect();
    let caption = "Frequency shifts with the standard deviation of their fits; their mean with \
                   its standard error, the larger of that from the fits and that from the scatter \
                   between the directions; and this scatter, as a standard deviation.";
    table(&with_notes(caption, results), &heads, &rows)
}

/// A caption, and what speaks against touches.
pub(super) fn with_notes(caption: &str, results: &RunResults) -> String {
    let slip = results.slip_note().map(|note| format!(" Check of slip: {note}."));
    let jump = results.jump_note().map(|note| format!(" No-load resonance: {note}."));
    let screw = results.screw_note().map(|note| format!(" Depths: {note}."));
    [slip, jump, screw].into_iter().flatten().fold(caption.to_owned(), |text, note| text + &note)
}

/// A value, with the count of its touches when some are missing, or the status of the touches.
fn of_some(tally: Tally, value: Option<Markup>) -> Markup {
    match (value, tally.shortfall()) {
        (Some(value), Some(shortfall)) => html! { (value) br; small.fault { (shortfall) } },
        (Some(value), None) => value,
        (None, _) => fault(tally.missing()),
    }
}

/// The mean shift in a direction, with the spread of its repeats.
fn shift(of: &DirectionMean) -> Markup {
    let Mean { shift_hz, sigma_hz, spread_hz, count, .. } = of.mean;
    html! {
        (with_sigma(shift_hz, sigma_hz))
        @if let Some(spread) = spread_hz {
            br;
            small { (count) " touches, spread " (fixed(spread, decimals_for(spread).min(3))) }
        }
    }
}

/// The counts of blind touches by sample and cluster.
pub(super) fn confusion(data: &RunData, classification: &Classification) -> Markup {
    let score = &classification.score;
    let mut heads = vec!["sample".to_owned()];
    for (cluster, centre_hz) in classification.centres_hz.iter().enumerate() {
        heads.push(format!("cluster {} ({} Hz)", cluster + 1, fixed(*centre_hz, 1)));
    }
    let row = |(sample, counts): (usize, &Vec<u32>)| {
        let mut row = vec![text(&data.samples()[sample].name)];
        for (cluster, &count) in counts.iter().enumerate() {
            let is_own = score.label_of[cluster] == Some(sample);
            row.push(match (is_own, count) {
                (true, count) => html! { b.own { (count) } },
                (false, 0) => text("·"),
                (false, count) => html! { b.wrong { (count) } },
            });
        }
        row
    };
    let touched =
        score.counts.iter().enumerate().filter(|(_, counts)| counts.iter().any(|&c| c > 0));
    let rows: Vec<_> = touched.map(row).collect();
    let caption = "Blind touches by sample and cluster, with the mean shift of each cluster. \
                   Boxed: the sample that a cluster represents.";
    table(caption, &heads, &rows)
}

/// Every planned touch with its result.
pub(super) fn touches(rows: &[TouchRow]) -> Markup {
    let heads = ["touch", "sample", "status", "shift (Hz)", "stiffness (MPa)", "class", "reason"];
    let row = |row: &TouchRow| {
        let pair = |value: Option<f64>, sigma: Option<f64>| {
            value.zip(sigma).map_or_else(dash, |(value, sigma)| text(with_sigma(value, sigma)))
        };
        let doubts = doubts(row);
        let status = format!("{}{doubts}", row.status.describe());
        vec![
            text(&row.step),
            text(&row.sample),
            match (row.status, &row.amended) {
                (TouchStatus::Measured, None) if doubts.is_empty() => text(&status),
                (_, None) => fault(&status),
                (_, Some(amended)) => text(format!("{status} ({amended})")),
            },
            pair(row.shift_hz, row.shift_sigma_hz),
            pair(row.stiffness_mpa, row.stiffness_sigma_mpa),
            row.class.as_ref().map_or_else(dash, text),
            text(match (&row.reason, &row.earlier) {
                (reason, None) => reason.clone().unwrap_or_default(),
                (None, Some(earlier)) => format!("before: {earlier}"),
                (Some(reason), Some(earlier)) => format!("{reason}; before: {earlier}"),
            }),
        ]
    };
    let reasons = reasons(rows);
    let rows: Vec<_> = rows.iter().map(row).collect();
    let caption = "Every planned touch, in order. The stiffness is that of the touch alone, with \
                   the uncertainty of the calibration; the class of a blind touch is the sample \
                   that its cluster represents. A touch is not confirmed if the run ended before anything was measured after it. \
                   Steps that the linear stage lost in a touch that was not checked for slip would not show: its \
                   depth may be another. Where the free resonance jumped before the next reference, the shift may be \
                   wrong by it.";
    html! { div.log.touches { (table(caption, &heads, &rows)) } (reasons) }
}

/// The reasons in the table of touches, for paper, where its columns are narrow: each with its touches.
fn reasons(rows: &[TouchRow]) -> Markup {
    let mut all: Vec<(&str, Vec<&str>)> = Vec::new();
    for row in rows {
        let Some(reason) = row.reason.as_deref() else { continue };
        match all.iter_mut().find(|(one, _)| *one == reason) {
            Some((_, steps)) => steps.push(&row.step),
            None => all.push((reason, vec![&row.step])),
        }
    }
    if all.is_empty() {
        return html! {};
    }
    html! {
        div.paper {
            p { "Reasons:" }
            ul { @for (reason, steps) in all { li { (steps.join(", ")) ": " (reason) } } }
        }
    }
}

/// What speaks against trusting a measured touch, after its status.
fn doubts(row: &TouchRow) -> String {
    let unconfirmed = if row.is_unconfirmed() { ", not confirmed" } else { "" };
    let unchecked = if row.is_slip_unchecked() { ", slip not checked" } else { "" };
    let jumped = if row.is_reference_unsteady() { ", resonance jumped" } else { "" };
    format!("{unconfirmed}{unchecked}{jumped}")
}

/// Lines of the log. Prompts are not printed on paper: they are many, and all alike.
pub(super) fn log_lines(log: &[LogEntry], caption: &str) -> Markup {
    let heads = ["rig time", "kind", "event", "step"];
    let mut rows = Vec::new();
    for entry in log {
        let time = clock(entry.run_us as f64 * 1e-6);
        let kind = match entry.kind {
            LogKind::Fault => fault(entry.kind.name()),
            LogKind::Prompt => html! { span.prompt { (entry.kind.name()) } },
            kind => html! { span { (kind.name()) } },
        };
        let step = entry.step.as_deref().unwrap_or_default();
        rows.push(vec![text(time), kind, text(&entry.text), text(step)]);
    }
    html! { div.log { (table(caption, &heads, &rows)) } }
}
