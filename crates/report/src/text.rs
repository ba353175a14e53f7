//! The results for a person at a terminal.

use rig_analysis::{
    model::{ModelCheck, Pattern, Verdict},
    run::RunSample,
};
use rig_record::Expected;

use crate::{
    data::DIRECTIONS,
    results::{
        RunResults,
        grid::GridRow,
        recognition::{Method, Recognition},
        status::{Tally, TouchStatus},
        stiffness::{SETS_SCALE, Stiffness},
        touches::{TouchRow, sentence},
    },
    units::{duration, fixed, percent, percent_range, with_sigma},
};

impl RunResults {
    /// The results for a person at a terminal: the stiffness of the samples, the table of shifts, the
    /// sensitivity and the rate of recognition.
    pub fn text(&self) -> String {
        let mut lines = Vec::new();
        if self.data.is_simulated() {
            lines.extend(["SIMULATED: no real device took part", ""].map(str::to_owned));
        }
        match &self.stiffness {
            Ok(stiffness) => {
                lines.extend(stiffness_table(self, stiffness));
                lines.push(String::new());
            }
            Err(reason) if !self.grid.is_empty() => {
                lines.extend([format!("no stiffness: {reason}"), String::new()]);
            }
            Err(_) => {}
        }
        if !self.grid.is_empty() {
            lines.push("frequency shift in Hz".to_owned());
            lines.extend(table(self));
            lines.push(String::new());
        }
        lines.extend(refused(&self.touches));
        lines.extend(facts(self).into_iter().map(|(name, value)| format!("{name:<23}{value}")));
        let wall = self.run.wall_s;
        let wall = wall.map_or_else(String::new, |wall_s| format!(" in {}", duration(wall_s)));
        let (status, rig_time) = (self.run.status.describe(), duration(self.data.rig_s()));
        let expected = self.data.expected().map_or_else(String::new, |expected| {
            let Expected { least_s, most_s, .. } = expected;
            format!(" (expected {} to {})", duration(least_s), duration(most_s))
        });
        lines.push(format!("{status}: {rig_time} of rig time{expected}{wall}"));
        if let Some(aim) = &self.aim {
            lines.push(format!("aim: {}", aim.sentence(self.run.status)));
        }
        lines.push(sentence(&self.touches));
        lines.join("\n") + "\n"
    }
}

/// The single results, each with its name.
fn facts(results: &RunResults) -> Vec<(String, String)> {
    let mut facts = Vec::new();
    let mut fact = |name: &str, value: String| facts.push((name.to_owned(), value));
    if let Some(check) = results.data.daily_check() {
        let verdict = check.verdict.as_deref().unwrap_or_default();
        fact("daily check", format!("{verdict}, {}", check.made));
    }
    if let Some(no_load) = &results.no_load {
        let (mean, span) = (fixed(no_load.mean_hz, 3), fixed(no_load.max_hz - no_load.min_hz, 3));
        let count = no_load.count;
        let spread = match count {
            1 => "one reference".to_owned(),
            _ => format!("{count} references over a range of {span} Hz"),
        };
        fact("no-load resonance", format!("{mean} Hz, {spread}"));
    }
    if let Some(note) = results.slip_note() {
        fact("check of slip", note);
    }
    if let Some(note) = results.screw_note() {
        fact("depths", note);
    }
    if let Some(note) = results.jump_note() {
        fact("resonance jumps", note);
    }
    if let Some(found) = results.stiffness.as_deref().ok().and_then(Stiffness::check) {
        fact("model", model(results, found));
    }
    let calibration = results.stiffness.as_ref().ok().map(|found| &found.calibration);
    if let Some(found) = calibration.filter(|found| found.beyond_description().is_some()) {
        let factor = with_sigma(found.factor, found.sigma_rel * found.factor);
        let within = percent(found.described_rel);
        fact(
            "factor of stiffness",
            format!("{factor} by the known samples; 1 within {within} by the rig file"),
        );
    }
    if let Some(found) = &results.sensitivity {
        let chord = found.sensitivity.chord;
        let slope = with_sigma(chord.hz_per_mpa, chord.sigma_hz_per_mpa);
        fact(&format!("sensitivity at {}°", found.angle_deg), format!("{slope} Hz/MPa"));
    }
    if let Some(classification) = &results.classification {
        let score = &classification.score;
        let missing = match results.blind_without_shift() {
            0 => String::new(),
            missing => format!("; {missing} without a shift"),
        };
        let rate = score.rate().unwrap_or_default();
        let rate = recognised(score.correct, score.trials, rate, score.interval());
        fact("blind classification", format!("{rate}{missing}"));
    }
    let by_stiffness = |found: &&Recognition| found.method == Method::CalibratedStiffness;
    if let Some(found) = results.recognitions.iter().find(by_stiffness) {
        let rate = recognised(found.correct, found.trials, found.rate(), found.interval());
        fact("blind, by stiffness", rate);
    }
    facts
}

/// The judgement on the model: `holds: χ²/54 = 0.97`.
fn model(results: &RunResults, check: &ModelCheck) -> String {
    let pattern = match check.pattern {
        Some(Pattern::Sample(sample)) => {
            format!(": sample {}", results.data.samples()[sample].name)
        }
        Some(Pattern::Known(sample)) => {
            format!(": known stiffness, sample {} most", results.data.samples()[sample].name)
        }
        Some(pattern) => format!(": {}", pattern.name()),
        None => String::new(),
    };
    let added = match check.verdict {
        Verdict::Holds => String::new(),
        Verdict::Strained | Verdict::Rejected => {
            format!("; {} are added to every stiffness", percent(check.added_rel))
        }
    };
    let chi2 = fixed(check.chi2_per_dof(), 2);
    format!("{}{pattern}; χ²/{} = {chi2}{added}", check.verdict.name(), check.freedom)
}

fn recognised(correct: u32, trials: u32, rate: f64, interval: (f64, f64)) -> String {
    let (rate, range) = (percent(rate), percent_range(interval));
    format!("{correct} of {trials} correct, {rate} (95 % interval {range})")
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

/// The stiffness of each sample, with the number of its touches.
fn stiffness_table(results: &RunResults, stiffness: &Stiffness) -> Vec<String> {
    let header = ["sample", "stiffness in MPa", "known", "from"].map(str::to_owned);
    let mut rows = vec![header.to_vec()];
    for sample in results.samples() {
        let of_run = &results.data.samples()[sample];
        let found = stiffness.of_sample(sample);
        let basis = stiffness.basis(&results.data, sample);
        rows.push(vec![
            of_run.name.clone(),
            found.map_or_else(|| "none".into(), in_words),
            of_run.stiffness_mpa.map_or_else(String::new, |known| known.to_string()),
            format!("{} of {} {}", basis.used, basis.planned, basis.of),
        ]);
    }
    aligned(&rows)
}

/// The stiffness of a sample in MPa with its standard deviation, or that it only sets the scale.
fn in_words(found: &RunSample) -> String {
    if found.sets_scale { SETS_SCALE.into() } else { with_sigma(found.young_mpa, found.sigma_mpa) }
}

/// The rows of the table of shifts, each cell as wide as the widest of its column.
fn table(results: &RunResults) -> Vec<String> {
    let directions = results.directions();
    let mut rows = vec![vec!["sample".to_owned(), "angle".to_owned()]];
    rows[0].extend(directions.iter().map(|&direction| DIRECTIONS[direction].name().to_owned()));
    rows[0].push("mean".to_owned());
    for planned in &results.grid {
        let GridRow { sample, angle_deg, .. } = *planned;
        let mut row = vec![results.data.samples()[sample].name.clone(), format!("{angle_deg}°")];
        for &direction in &directions {
            let mean = results.direction_mean(sample, angle_deg, direction);
            row.push(of_some(
                planned.directions[direction],
                mean.map(|mean| with_sigma(mean.mean.shift_hz, mean.mean.sigma_hz)),
            ));
        }
        let mean = results.angle_mean(sample, angle_deg);
        let mean = mean.map(|mean| with_sigma(mean.mean.shift_hz, mean.mean.standard_error_hz()));
        row.push(of_some(planned.over_directions(), mean));
        rows.push(row);
    }
    aligned(&rows)
}

/// Rows with every column as wide as its widest cell, aligned to the right.
fn aligned(rows: &[Vec<String>]) -> Vec<String> {
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

/// A value, with the count of its touches when some are missing, or the status of the touches.
fn of_some(tally: Tally, value: Option<String>) -> String {
    match (value, tally.shortfall()) {
        (Some(value), Some(shortfall)) => format!("{value} ({shortfall})"),
        (Some(value), None) => value,
        (None, _) => tally.missing().to_owned(),
    }
}
