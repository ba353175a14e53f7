//! The page: its frame, its head and the order of its parts.

mod element;
mod figures;
mod provenance;
mod stiffness;
mod tables;

use rig_analysis::sensitivity::Sensitivity;
use rig_chart::Escaped;
use rig_record::{ChainCheck, Ending, Phase, Run, RunStatus};

use crate::{
    RunResults, TouchRow,
    data::RunData,
    results::{cost::SweepCost, status::Tally, touches::sentence},
    units::{duration, fixed, percent, percent_range, value_and_sigma, with_sigma},
};
use element::add;
use provenance::provenance;

impl RunResults {
    /// The report as one HTML file. Of a damaged journal it shows the records before the damage, and
    /// says so: `check` is the check of its chain.
    pub fn html(&self, check: &ChainCheck) -> String {
        page(self, check)
    }
}

fn page(results: &RunResults, check: &ChainCheck) -> String {
    let RunResults { run, data, touches: rows, .. } = results;
    let title = Escaped(&run.name);
    let simulated = if data.is_simulated() { " (simulated)" } else { "" };
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <meta http-equiv=\"Content-Security-Policy\" \
         content=\"default-src 'none'; style-src 'unsafe-inline'\">\n\
         <title>{title}{simulated} – report</title>\n<style>\n{}{}</style>\n</head>\n<body>\n<main>\n",
        include_str!("html/style.css"),
        rig_chart::STYLE,
    );
    html += &head(run, check, data, results, rows);
    section(&mut html, "Frequency shift", &shifts(data, results));
    section(&mut html, "Stiffness", &stiffness(data, results));
    section(&mut html, "Recognition", &recognition(data, results));
    section(&mut html, "The free sensor", &free_sensor(data, results));
    section(&mut html, "One touch in detail", &detail(data, results));
    section(&mut html, "Touches", &touches_section(data, rows));
    section(&mut html, "Log", &log(data));
    section(&mut html, "Provenance", &provenance(run, check, data));
    html += "</main>\n</body>\n</html>\n";
    html
}

fn section(html: &mut String, title: &str, content: &str) {
    add(html, format_args!("<section>\n<h2>{title}</h2>\n{content}</section>\n"));
}

/// What the run is, how it ended, and its key numbers.
fn head(
    run: &Run,
    check: &ChainCheck,
    data: &RunData,
    results: &RunResults,
    rows: &[TouchRow],
) -> String {
    let class = match run.status {
        RunStatus::Running => "running",
        RunStatus::Ended(Ending::Completed) => "completed",
        RunStatus::Ended(Ending::CompletedWithRefusals) => "partial",
        RunStatus::Interrupted | RunStatus::Ended(_) => "failed",
    };
    let began = run.started_at.replace('T', " ").chars().take(16).collect::<String>();
    let mut html = format!(
        "<header>\n<p class=\"eyebrow\">Run report{}</p>\n<h1>{}</h1>\n\
         <p class=\"meta\"><span class=\"status {class}\">{}</span> {} UTC</p>\n</header>\n",
        if data.is_simulated() { " <b class=\"simulated\">simulated</b>" } else { "" },
        Escaped(&run.name),
        run.status.describe(),
        Escaped(&began),
    );
    if let ChainCheck::Broken { seq, flaw } = check {
        let flaw = Escaped(&flaw.to_string()).to_string();
        add(
            &mut html,
            format_args!(
                "<p class=\"alarm\"><b>The journal of this run is damaged.</b> Record {seq}: \
                 {flaw}. This report is made from the records before it.</p>\n"
            ),
        );
    }
    for fault in data.faults() {
        let (step, text) = (fault.step.as_deref().unwrap_or("no step"), Escaped(&fault.text));
        let step = Escaped(step);
        add(&mut html, format_args!("<p class=\"alarm\"><b>Fault in {step}.</b> {text}</p>\n"));
    }
    let tally = Tally::of(rows.iter().map(|row| row.status));
    if tally.measured < tally.planned && run.status != RunStatus::Running {
        let sentence = sentence(rows);
        add(&mut html, format_args!("<p class=\"alarm\"><b>{}.</b></p>\n", Escaped(&sentence)));
    }
    html += "<dl class=\"tiles\">\n";
    for KeyNumber { name, value, unit, below } in key_numbers(run, data, results, tally) {
        let (value, below) = (Escaped(&value), Escaped(&below));
        add(
            &mut html,
            format_args!(
                "<div><dt>{name}</dt><dd>{value} <small>{unit}</small></dd>\
                 <dd class=\"below\">{below}</dd></div>\n"
            ),
        );
    }
    html += "</dl>\n";
    html
}

/// A key number.
struct KeyNumber {
    name: &'static str,
    value: String,
    unit: &'static str,
    below: String,
}

fn key_numbers(run: &Run, data: &RunData, results: &RunResults, tally: Tally) -> Vec<KeyNumber> {
    let mut numbers = Vec::new();
    if let Some(no_load) = results.no_load {
        let span = fixed(no_load.max_hz - no_load.min_hz, 3);
        let below = format!("mean of {} references within {span}\u{a0}Hz", no_load.count);
        let value = fixed(no_load.mean_hz, 3);
        numbers.push(KeyNumber { name: "Free resonance", value, unit: "Hz", below });
    }
    if let Some(found) = &results.sensitivity {
        let Sensitivity { chord, line, .. } = found.sensitivity;
        let (value, sigma) = value_and_sigma(chord.hz_per_mpa, chord.sigma_hz_per_mpa);
        let (line, _) = value_and_sigma(line.hz_per_mpa, line.sigma_hz_per_mpa);
        let below = format!("± {sigma}; chord at {}°, least squares {line}", found.angle_deg);
        numbers.push(KeyNumber { name: "Sensitivity", value, unit: "Hz/MPa", below });
    }
    if let Some(classification) = &results.classification {
        let score = &classification.score;
        let value = percent(score.rate().unwrap_or_default());
        let (correct, trials, range) =
            (score.correct, score.trials, percent_range(score.interval()));
        let below = format!("{correct} of {trials}; 95\u{a0}% interval {range}");
        numbers.push(KeyNumber { name: "Blind recognition", value, unit: "", below });
    }
    let prompts = counted(data.prompts, "prompt");
    let faults = counted(u32::try_from(data.faults().count()).unwrap_or(u32::MAX), "fault");
    let Tally { planned, measured, refused, not_reached } = tally;
    let mut below = format!("measured of {planned} planned; ");
    for (count, what) in [(refused, "refused"), (not_reached, "not reached")] {
        if count > 0 {
            add(&mut below, format_args!("{count} {what}, "));
        }
    }
    add(&mut below, format_args!("{prompts}, {faults}"));
    let value = measured.to_string();
    numbers.push(KeyNumber { name: "Touches", value, unit: "", below });
    let below = run.wall_s.map_or("still running".to_owned(), |wall_s| {
        format!("{} by the clock on the wall", duration(wall_s))
    });
    numbers.push(KeyNumber { name: "Rig time", value: duration(data.rig_s()), unit: "", below });
    numbers
}

fn counted(count: u32, one: &str) -> String {
    if count == 1 { format!("1 {one}") } else { format!("{count} {one}s") }
}

fn shifts(data: &RunData, results: &RunResults) -> String {
    if results.direction_means.is_empty() {
        let nothing = nothing("No touch of the main phase gave a shift.");
        let is_planned = !results.grid.is_empty();
        return if is_planned { nothing + &tables::shifts(data, results) } else { nothing };
    }
    let mut html = figures::by_direction(data, results) + &figures::averaged(data, results);
    if let Some(found) = &results.sensitivity {
        let Sensitivity { chord, line, max_deviation_hz, .. } = found.sensitivity;
        let (angle, worst) = (found.angle_deg, fixed(max_deviation_hz, 1));
        let chord = with_sigma(chord.hz_per_mpa, chord.sigma_hz_per_mpa);
        let line = with_sigma(line.hz_per_mpa, line.sigma_hz_per_mpa);
        add(
            &mut html,
            format_args!(
                "<p>Sensitivity at {angle}°, mean of the directions: <b>{chord} Hz/MPa</b> from the \
                 softest to the stiffest sample; {line} Hz/MPa by least squares through all samples, \
                 from which they lie up to {worst} Hz away. The uncertainties are those of the \
                 means.</p>\n"
            ),
        );
    }
    html + &tables::shifts(data, results)
}

fn stiffness(data: &RunData, results: &RunResults) -> String {
    match &results.stiffness {
        Ok(stiffness) => stiffness::section(data, stiffness, results),
        Err(reason) => nothing(&Escaped(&format!("No stiffness: {reason}.")).to_string()),
    }
}

fn recognition(data: &RunData, results: &RunResults) -> String {
    let Some(classification) = &results.classification else {
        return nothing("No blind touches were classified.");
    };
    let score = &classification.score;
    let (rate, range) = (score.rate().unwrap_or_default(), percent_range(score.interval()));
    let sentence = format!(
        "<p><b>{} of {} blind touches are in the cluster of their sample: {}</b>, with a 95 % \
         interval from {range} (Wilson).</p>\n",
        score.correct,
        score.trials,
        percent(rate),
    );
    let planned = data.planned.iter().filter(|touch| touch.settings.phase == Phase::Blind).count();
    let missing = planned.saturating_sub(score.trials as usize);
    let missing = match missing {
        0 => String::new(),
        missing => nothing(&format!("Of {planned} planned, {missing} gave no shift.")),
    };
    sentence
        + &missing
        + &figures::classification(data, classification)
        + &tables::confusion(data, classification)
        + &stiffness::recognitions(&results.recognitions)
}

fn free_sensor(data: &RunData, results: &RunResults) -> String {
    if results.references.is_empty() {
        return nothing("No reference was measured.");
    }
    figures::no_load(data, results)
}

fn detail(data: &RunData, results: &RunResults) -> String {
    let example = figures::example(data)
        .unwrap_or_else(|| nothing("No touch of the main phase gave a shift."));
    example + &cost(&results.cost)
}

/// What the sweeps cost, beside common practice.
fn cost(cost: &SweepCost) -> String {
    let SweepCost { sweeps, taken_s, practice_s } = *cost;
    if sweeps == 0 || taken_s <= 0.0 {
        return String::new();
    }
    let (taken, practice) = (duration(taken_s), duration(practice_s));
    let times = fixed(practice_s / taken_s, 1);
    format!(
        "<p>The {sweeps} sweeps took <b>{taken}</b> of rig time. Common practice, 201 points with \
         five time constants of settling and ten cycles of integration at each, would have taken \
         {practice} for the same resonances: {times} times as long.</p>\n"
    )
}

/// Every planned touch, and the sweeps that were refused.
fn touches_section(data: &RunData, rows: &[TouchRow]) -> String {
    if rows.is_empty() {
        return nothing("No touch was planned.");
    }
    tables::touches(rows) + &figures::refused(data)
}

fn log(data: &RunData) -> String {
    if data.log.is_empty() {
        return nothing("Nobody was asked for anything, and nothing went wrong.");
    }
    tables::log(data)
}

fn nothing(text: &str) -> String {
    format!("<p class=\"note\">{text}</p>\n")
}
