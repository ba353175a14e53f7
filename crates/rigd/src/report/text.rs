//! The results for a person at a terminal.

use std::fmt::Write as _;

use rig_store::Run;

use super::{
    data::RunData,
    recognition::{Method, Recognition},
    results::{DIRECTIONS, RunResults},
    stiffness::SampleStiffness,
    units::{duration, fixed, percent, percent_range, with_sigma},
};

pub(super) fn text(run: &Run, data: &RunData, results: &RunResults) -> String {
    let mut text = String::new();
    let mut line = |arguments: std::fmt::Arguments<'_>| {
        text.write_fmt(arguments).expect("a string takes all text");
        text.push('\n');
    };
    if !results.means.is_empty() {
        line(format_args!("frequency shift in Hz"));
        for row in table(data, results) {
            line(format_args!("{row}"));
        }
        line(format_args!(""));
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
        fact(
            "blind classification",
            &format!("{correct} of {trials} correct, {rate} (95 % interval {range})"),
        );
    }
    if let Ok(stiffness) = &results.stiffness {
        let sample = |found: &SampleStiffness| {
            let name = &data.samples()[found.sample].name;
            format!("{name}: {}", with_sigma(found.young_mpa, found.sigma_mpa))
        };
        let samples: Vec<String> = stiffness.samples.iter().map(sample).collect();
        fact("stiffness in MPa", &samples.join(", "));
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
    let (status, touches) = (run.status.name(), data.touches.len());
    let rig_time = duration(data.rig_s());
    line(format_args!("{status}: {touches} touches, {rig_time} of rig time{wall}"));
    text
}

/// The rows of the table of shifts, each cell as wide as the widest of its column.
fn table(data: &RunData, results: &RunResults) -> Vec<String> {
    let directions: Vec<usize> = (0..DIRECTIONS.len())
        .filter(|&direction| results.cells.iter().any(|cell| cell.direction == direction))
        .collect();
    let mut rows = vec![vec!["sample".to_owned(), "angle".to_owned()]];
    rows[0].extend(directions.iter().map(|&direction| DIRECTIONS[direction].name().to_owned()));
    rows[0].push("mean".to_owned());
    for mean in &results.means {
        let name = data.samples()[mean.sample].name.clone();
        let mut row = vec![name, format!("{}°", mean.angle_deg)];
        for &direction in &directions {
            let cell = results.cells.iter().find(|cell| {
                (cell.sample, cell.angle_deg, cell.direction)
                    == (mean.sample, mean.angle_deg, direction)
            });
            row.push(cell.map_or_else(String::new, |cell| {
                with_sigma(cell.mean.shift_hz, cell.mean.sigma_hz)
            }));
        }
        row.push(with_sigma(mean.mean.shift_hz, mean.mean.standard_error_hz()));
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
