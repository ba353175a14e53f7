//! The page: its frame, its head and the order of its parts.

mod aim;
mod budget;
mod document;
mod element;
mod figures;
mod model;
mod overview;
mod paper;
mod provenance;
mod stiffness;
mod sweeps;
mod tables;
pub mod trend;

use maud::{Markup, html};
use rig_analysis::sensitivity::Sensitivity;
use rig_record::{ChainCheck, Ending, Phase, Run, RunStatus};

use crate::{
    data::RunData,
    results::{
        RunResults, SensitivityAt,
        cost::SweepCost,
        status::Tally,
        touches::{TouchRow, sentence},
    },
    units::{duration, fixed, percent, percent_range, value_and_sigma, with_sigma},
};
pub use document::document;
use element::note;
use provenance::provenance;

impl RunResults {
    /// The report as one HTML file. Of a damaged journal it shows the records before the damage, and
    /// says so: `check` is the result of the check of its chain, and `verdict` that of its contents. `began` is
    /// the beginning in local time.
    pub fn html(&self, check: &ChainCheck, verdict: &RunVerdict, began: &str) -> String {
        page(self, check, verdict, began).into_string()
    }
}

/// The result of the check of a journal by a program that shares no code with the one that wrote it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunVerdict {
    /// The result in a sentence.
    pub sentence: String,
    /// What was found, each in a sentence; empty for a sound journal.
    pub findings: Vec<String>,
}

impl RunVerdict {
    /// Whether nothing was found.
    pub fn is_sound(&self) -> bool {
        self.findings.is_empty()
    }
}

fn page(results: &RunResults, check: &ChainCheck, verdict: &RunVerdict, began: &str) -> Markup {
    let RunResults { run, data, .. } = results;
    let simulated = if data.is_simulated() { " (simulated)" } else { "" };
    let has_shifts = !results.direction_means.is_empty();
    let has_stiffness = results.stiffness.as_ref().is_ok_and(|found| !found.samples.is_empty());
    // A run that ended early tells its story; parts without content would only be in its way.
    let is_early = overview::ended_early(results);
    let has_blind = results.classification.is_some();
    let body = html! {
        main {
            (head(results, check, verdict, began))
            @if is_early { (section("What happened", &overview::story(results))) }
            @if has_stiffness || !is_early { (section("Stiffness", &stiffness(results))) }
            @if !results.touches.is_empty() {
                (section("Planned, measured and refused", &overview::matrix(results)))
            }
            @if let Some(aim) = &results.aim { (section("Aim", &aim::section(results, aim))) }
            @if has_shifts || !is_early { (section("Frequency shift", &shifts(results))) }
            @if has_blind || !is_early { (section("Recognition", &recognition(results))) }
            @if has_shifts || has_blind { (section("Beside the paper", &paper::beside(results))) }
            @if !results.references.is_empty() || !is_early {
                (section("The free sensor", &free_sensor(results)))
            }
            @if has_shifts || !is_early { (section("One touch in detail", &detail(results))) }
            @if !data.sweeps.is_empty() {
                (section("Every sweep", &every_sweep(data)))
            }
            (section("Touches", &touches(results)))
            (section("Log", &log(data)))
            (section("Provenance", &provenance(run, check, verdict, data)))
        }
    };
    let title = html! { (run.short_name()) (simulated) " – report" };
    let foot = page_foot(run, simulated);
    let styles = [include_str!("html/style.css"), rig_chart::STYLE, &foot];
    document(&title, &styles, None, &body)
}

/// The foot of each printed page: the run and the number of the page.
fn page_foot(run: &Run, simulated: &str) -> String {
    // A string of CSS, in which the name of a protocol must not end it.
    let is_plain = |letter: &char| letter.is_alphanumeric() || " -_.()".contains(*letter);
    let name: String = run.short_name().chars().filter(is_plain).collect();
    format!(
        "@page {{ @bottom-left {{ content: \"{name}{simulated} · {id}\"; }} \
         @bottom-right {{ content: counter(page) \" / \" counter(pages); }} }}",
        id = run.id,
    )
}

fn every_sweep(data: &RunData) -> Markup {
    html! { (sweeps::small_multiples(data)) (figures::refused(data)) }
}

fn section(title: &str, content: &Markup) -> Markup {
    html! { section { h2 { (title) } (content) } }
}

/// The name of the run, its status, and its key numbers.
fn head(results: &RunResults, check: &ChainCheck, verdict: &RunVerdict, began: &str) -> Markup {
    let RunResults { run, data, touches, .. } = results;
    let class = match run.status {
        RunStatus::Running => "running",
        RunStatus::Ended(Ending::Completed) => "completed",
        RunStatus::Ended(Ending::CompletedWithRefusals) => "partial",
        RunStatus::Interrupted | RunStatus::Ended(_) => "failed",
    };
    let is_short = run.status != RunStatus::Running
        && !touches.iter().all(TouchRow::is_measured_without_doubt);
    html! {
        header {
            p.eyebrow { "Run report" @if data.is_simulated() { " " b.simulated { "simulated" } } }
            h1 { (run.short_name()) }
            p.meta {
                span.status.(class) { (run.status.describe()) } " " (began)
                @if let Some(operator) = data.operator() { " · " (operator) }
            }
        }
        @if let ChainCheck::Broken { seq, flaw } = check {
            p.alarm {
                b { "The journal of this run is damaged." }
                " Record " (seq) ": " (flaw.to_string())
                ". This report is made from the records before it."
            }
        }
        @if !verdict.is_sound() {
            div.alarm {
                b { "The journal of this run is not sound." }
                " The checker found what is listed here; do not use the results before it is explained."
                ul { @for finding in &verdict.findings { li { (finding) } } }
            }
        }
        @if let Some(check) = data.daily_check()
            && let Some(verdict) = check.verdict.as_deref().filter(|verdict| *verdict != "accepted") {
            p.alarm {
                b { "The daily check of the bench before this run says: " (verdict) "." }
                " It was made " (check.made) " by " (check.person) "; `checks.html` in the data directory has its charts."
            }
        }
        @for fault in data.faults() {
            p.alarm {
                b { "Fault in " (fault.step.as_deref().unwrap_or("no step")) "." } " " (fault.text)
            }
        }
        @if is_short { p.alarm { b { (sentence(touches)) "." } } }
        dl.tiles {
            @for KeyNumber { name, value, unit, below } in key_numbers(results) {
                div { dt { (name) } dd { (value) " " small { (unit) } } dd.below { (below) } }
            }
        }
    }
}

/// A key number.
struct KeyNumber {
    name: &'static str,
    value: String,
    unit: &'static str,
    below: String,
}

fn key_numbers(results: &RunResults) -> Vec<KeyNumber> {
    let RunResults { run, data, .. } = results;
    let mut numbers = Vec::new();
    if let Some(no_load) = results.no_load {
        let span = fixed(no_load.max_hz - no_load.min_hz, 3);
        let below = match no_load.count {
            1 => "one reference".to_owned(),
            count => format!("mean of {count} references over a range of {span}\u{a0}Hz"),
        };
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
        let missing = match results.blind_without_shift() {
            0 => String::new(),
            missing => format!("; {missing} without a shift"),
        };
        let below = format!("{correct} of {trials}; 95\u{a0}% interval {range}{missing}");
        numbers.push(KeyNumber { name: "Blind recognition", value, unit: "", below });
    }
    let prompts = counted(data.prompts, "prompt");
    let faults = counted(u32::try_from(data.faults().count()).unwrap_or(u32::MAX), "fault");
    let statuses = results.touches.iter().map(|row| row.status);
    let Tally { planned, measured, refused, skipped, not_reached } = Tally::of(statuses);
    let missing = [(refused, "refused"), (skipped, "skipped"), (not_reached, "not reached")];
    let missing = missing.into_iter().filter(|(count, _)| *count > 0);
    let counts = missing.map(|(count, status)| format!("{count} {status}"));
    let counts = counts.chain([prompts, faults]).collect::<Vec<_>>().join(", ");
    let below = format!("measured of {planned} planned; {counts}");
    let value = measured.to_string();
    numbers.push(KeyNumber { name: "Touches", value, unit: "", below });
    let below = run
        .wall_s
        .map_or("still running".to_owned(), |wall_s| format!("{} of wall time", duration(wall_s)));
    numbers.push(KeyNumber { name: "Rig time", value: duration(data.rig_s()), unit: "", below });
    numbers
}

fn counted(count: u32, one: &str) -> String {
    if count == 1 { format!("1 {one}") } else { format!("{count} {one}s") }
}

fn shifts(results: &RunResults) -> Markup {
    if results.direction_means.is_empty() {
        return html! {
            (note("No touch of the main phase gave a shift."))
            @if !results.grid.is_empty() { (tables::shifts(results)) }
        };
    }
    html! {
        (figures::by_direction(results))
        (figures::averaged(results))
        @if let Some(found) = &results.sensitivity { (sensitivity(found)) }
        (tables::shifts(results))
    }
}

fn sensitivity(found: &SensitivityAt) -> Markup {
    let Sensitivity { chord, line, max_deviation_hz, .. } = found.sensitivity;
    let (angle, worst) = (found.angle_deg, fixed(max_deviation_hz, 1));
    let chord = with_sigma(chord.hz_per_mpa, chord.sigma_hz_per_mpa);
    let line = with_sigma(line.hz_per_mpa, line.sigma_hz_per_mpa);
    html! {
        p {
            "Sensitivity at " (angle) "°, mean of the directions: " b { (chord) " Hz/MPa" }
            " from the softest to the stiffest sample; " (line) " Hz/MPa by least squares through \
             all samples, from which the worst sample lies " (worst) " Hz away. The uncertainties are \
             those of the means."
        }
    }
}

fn stiffness(results: &RunResults) -> Markup {
    match &results.stiffness {
        Ok(stiffness) => stiffness::section(results, stiffness),
        Err(reason) => note(&format!("No stiffness: {reason}.")),
    }
}

fn recognition(results: &RunResults) -> Markup {
    let RunResults { data, classification: Some(classification), .. } = results else {
        return note("No blind touches were classified.");
    };
    let score = &classification.score;
    let (correct, trials) = (score.correct, score.trials);
    let (rate, range) = (score.rate().unwrap_or_default(), percent_range(score.interval()));
    let planned = data.planned.iter().filter(|touch| touch.settings.phase == Phase::Blind).count();
    let missing = planned.saturating_sub(trials as usize);
    html! {
        p {
            b {
                (correct) " of " (trials) " blind touches are in the cluster of their sample: "
                (percent(rate))
            }
            ", with a 95 % interval from " (range) " (Wilson)."
        }
        @if missing > 0 { (note(&format!("Of {planned} planned, {missing} gave no shift."))) }
        (figures::classification(data, classification))
        (tables::confusion(data, classification))
        (stiffness::recognitions(&results.recognitions))
    }
}

fn free_sensor(results: &RunResults) -> Markup {
    if results.references.is_empty() {
        return note("No reference was measured.");
    }
    figures::no_load(results)
}

fn detail(results: &RunResults) -> Markup {
    let example = figures::example(&results.data)
        .unwrap_or_else(|| note("No touch of the main phase gave a shift."));
    html! { (example) (cost(&results.cost)) }
}

/// The time of the sweeps beside that of common practice.
fn cost(cost: &SweepCost) -> Markup {
    let SweepCost { sweeps, taken_s, practice_s } = *cost;
    if sweeps == 0 || taken_s <= 0.0 {
        return html! {};
    }
    let (taken, practice) = (duration(taken_s), duration(practice_s));
    html! {
        p {
            "The " (sweeps) " sweeps took " b { (taken) } " of rig time. Common practice, 201 points \
             with five time constants of settling and ten cycles of integration at each, would have \
             taken " (practice) " for as many resonances. The two are not equally accurate: a planned \
             sweep ends when its standard deviation reaches the target."
        }
    }
}

/// Every planned touch.
fn touches(results: &RunResults) -> Markup {
    if results.touches.is_empty() {
        return note("No touch was planned.");
    }
    tables::touches(&results.touches)
}

fn log(data: &RunData) -> Markup {
    if data.log.is_empty() {
        return note("No prompts, commands, faults or refused sweeps.");
    }
    tables::log_lines(&data.log, "Prompts, commands, faults and refused sweeps, in order.")
}
