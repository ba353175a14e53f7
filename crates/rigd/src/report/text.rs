//! The results for a person at a terminal.

use std::fmt::Write as _;

use rig_record::{Phase, Run};

use super::{
    data::RunData,
    recognition::{Method, Recognition},
    results::{DIRECTIONS, RunResults},
    stiffness::Stiffness,
    touches::{self, GridRow, Tally, TouchRow, TouchStatus},
    units::{duration, fixed, percent, percent_range, with_sigma},
};

pub(super) fn text(run: &Run, data: &RunData, results: &RunResults) -> String {
    let mut text = String::new();
    let mut line = |arguments: std::fmt::Arguments<'_>| {
        text.write_fmt(arguments).expect("a string takes all text");
        text.push('\n');
    };
    if data.is_simulated() {
        line(format_args!("SIMULATED: no real device took part\n"));
    }
    if !results.grid.is_empty() {
        line(format_args!("frequency shift in Hz"));
        for row in table(data, results) {
            line(format_args!("{row}"));
        }
        line(format_args!(""));
    }
    let rows = touches::rows(run, data, results);
    for row in refused(&rows) {
        line(format_args!("{row}"));
    }
    let mut fact = |name: &str, value: &str| line(format_args!("{name:<23}{value}"));
    if let Some(no_load) = &results.no_load {
        let (mean, span) = (fixed(no_load.mean_hz, 3), fixed(no_load.max_hz - no_load.min_hz, 3));
        let count = no_load.count;
        fact("no-load resonance", &format!("{mean} Hz, {count} references within {span} Hz"));
    }
    if let Some(found) = &results.sensitivity {
        let chord = found.sensitivity.chord;
        let slope = with_sigma(chord.hz_per_mpa, chord.sigma_hz_per_mpa);
        fact(&format!("sensitivity at {}°", found.angle_deg), &format!("{slope} Hz/MPa"));
    }
    if let Some(classification) = &results.classification {
        let score = &classification.score;
        let rate = percent(score.rate().unwrap_or_default());
        let (correct, trials, range) =
            (score.correct, score.trials, percent_range(score.interval()));
        let planned = rows.iter().filter(|row| row.phase == Phase::Blind.name()).count();
        let missing = planned.saturating_sub(trials as usize);
        let missing =
            if missing > 0 { format!("; {missing} without a shift") } else { String::new() };
        fact(
            "blind classification",
            &format!("{correct} of {trials} correct, {rate} (95 % interval {range}){missing}"),
        );
    }
    match &results.stiffness {
        Ok(stiffness) => {
            let samples = results.samples().into_iter();
            let samples: Vec<_> =
                samples.map(|sample| of_sample(data, stiffness, sample)).collect();
            fact("stiffness in MPa", &samples.join(", "));
        }
        Err(reason) if !results.grid.is_empty() => fact("stiffness", &format!("none: {reason}")),
        Err(_) => {}
    }
    let by_stiffness = |found: &&Recognition| found.method == Method::CalibratedStiffness;
    if let Some(found) = results.recognitions.iter().find(by_stiffness) {
        let (correct, trials) = (found.correct, found.trials);
        let (rate, range) = (percent(found.rate()), percent_range(found.interval()));
        fact(
            "blind, by stiffness",
            &format!("{correct} of {trials} correct, {rate} (95 % interval {range})"),
        );
    }
    let wall = run.wall_s.map_or_else(String::new, |wall_s| format!(" in {}", duration(wall_s)));
    let (status, rig_time) = (run.status.describe(), duration(data.rig_s()));
    line(format_args!("{status}: {rig_time} of rig time{wall}"));
    line(format_args!("{}", touches::sentence(&rows)));
    text
}

/// The refused touches with their reasons, under a title.
fn refused(rows: &[TouchRow]) -> Vec<String> {
    let is_refused = |row: &&TouchRow| row.status == TouchStatus::Refused;
    let refused = || rows.iter().filter(is_refused);
    let Some(width) = refused().map(|row| row.step.chars().count()).max() else {
        return Vec::new();
    };
    let row = |row: &TouchRow| {
        format!("{:width$}  {}", row.step, row.reason.as_deref().unwrap_or_default())
    };
    let title = ["refused touches".to_owned()];
    title.into_iter().chain(refused().map(row)).chain([String::new()]).collect()
}

/// The stiffness of a sample, with what it rests on where touches are missing.
fn of_sample(data: &RunData, stiffness: &Stiffness, sample: usize) -> String {
    let name = &data.samples()[sample].name;
    let found = stiffness
        .of_sample(sample)
        .map_or_else(|| "none".to_owned(), |found| with_sigma(found.young_mpa, found.sigma_mpa));
    match stiffness.support(data, sample).shortfall() {
        Some(shortfall) => format!("{name}: {found} ({shortfall})"),
        None => format!("{name}: {found}"),
    }
}

/// The rows of the table of shifts, each cell as wide as the widest of its column.
fn table(data: &RunData, results: &RunResults) -> Vec<String> {
    let directions = results.directions();
    let mut rows = vec![vec!["sample".to_owned(), "angle".to_owned()]];
    rows[0].extend(directions.iter().map(|&direction| DIRECTIONS[direction].name().to_owned()));
    rows[0].push("mean".to_owned());
    for planned in &results.grid {
        let GridRow { sample, angle_deg, .. } = *planned;
        let mut row = vec![data.samples()[sample].name.clone(), format!("{angle_deg}°")];
        for &direction in &directions {
            let cell = results.cell(sample, angle_deg, direction);
            row.push(of_some(
                planned.directions[direction],
                cell.map(|cell| with_sigma(cell.mean.shift_hz, cell.mean.sigma_hz)),
            ));
        }
        let mean = results.mean(sample, angle_deg);
        let mean = mean.map(|mean| with_sigma(mean.mean.shift_hz, mean.mean.standard_error_hz()));
        row.push(of_some(planned.over_directions(), mean));
        rows.push(row);
    }
    let columns = rows[0].len();
    let width = |column: usize| {
        rows.iter().map(|row| row[column].chars().count()).max().unwrap_or_default()
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let padded = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:>width$}"));
        cells.collect::<Vec<_>>().join("  ")
    };
    rows.iter().map(padded).collect()
}

/// A value, and of how many it is where some are missing; or why there is none.
fn of_some(tally: Tally, value: Option<String>) -> String {
    match (value, tally.shortfall()) {
        (Some(value), Some(shortfall)) => format!("{value} ({shortfall})"),
        (Some(value), None) => value,
        (None, _) => tally.missing().to_owned(),
    }
}
