//! The figures of the report.

use maud::{Markup, PreEscaped, html};
use rig_chart::{Axis, Chart, Marker, Point, Series, Stroke, legend};
use rig_record::{Direction, Phase, ReadingRecord, Sample, Sweep, SweepOutcome};
use rig_resonance::Circuit;

use super::element::{drawn, figure, figure_row};
use crate::{
    data::{DIRECTIONS, RunData},
    results::{RunResults, classification::Classification},
    units::{fixed, with_sigma},
};

/// Width and height of one of three charts in a row, pixels.
pub(super) const PANEL_PX: (u32, u32) = (290, 310);
/// Width and height of one of two charts in a row, pixels.
pub(super) const HALF_PX: (u32, u32) = (446, 310);
/// Width and height of a chart with a row of its own, pixels.
const WIDE_PX: (u32, u32) = (912, 360);

/// Width and height of a chart on a phone, pixels.
const NARROW_PX: (u32, u32) = (350, 300);

/// A wide chart, and the same for a phone: scaled down, its texts could not be read.
fn drawn_twice(mut chart: Chart, id: &str) -> Markup {
    let wide = drawn(&chart, id);
    chart.size_px = NARROW_PX;
    let narrow = drawn(&chart, &format!("{id}-narrow"));
    html! { div.wide { (wide) } div.narrow aria-hidden="true" { (narrow) } }
}

/// Shift against angle, one chart for each direction: the paper's Figure 11.
pub(super) fn by_direction(results: &RunResults) -> Markup {
    let highest = results
        .direction_means
        .iter()
        .map(|one| one.mean.shift_hz + one.mean.sigma_hz)
        .fold(0.0, f64::max);
    let angles = results.angles_deg();
    let mut charts = Vec::new();
    for (direction, name) in DIRECTIONS.map(Direction::name).into_iter().enumerate() {
        let means = || results.direction_means.iter().filter(move |one| one.direction == direction);
        if means().next().is_none() {
            continue;
        }
        let mut chart = Chart::new(
            name,
            &format!("Frequency shift of each sample against the contact angle, {name}."),
            Axis::linear("contact angle (°)").with_ticks(&angles),
            Axis::linear("frequency shift (Hz)").including(0.0).including(1.05 * highest),
        );
        chart.size_px = PANEL_PX;
        for (index, sample) in touched_samples(results) {
            let points = means().filter(|one| one.sample == index).map(|one| Point {
                x: one.angle_deg,
                y: one.mean.shift_hz,
                error: Some(one.mean.sigma_hz),
                note: Some(note(sample, one.angle_deg, one.mean.shift_hz, one.mean.sigma_hz)),
            });
            let series = Series::joined(&label(sample), index, points);
            chart.series.push(Series { name: None, ..series });
        }
        charts.push(drawn(&chart, &format!("fig-{name}")));
    }
    let touched = touched_samples(results);
    let keys: Vec<Series> =
        touched.map(|(index, sample)| Series::joined::<Point>(&label(sample), index, [])).collect();
    let wide = legend(&keys, "fig-samples", WIDE_PX.0);
    let narrow = legend(&keys, "fig-samples-narrow", NARROW_PX.0);
    let caption = "Figure 11. Shift against contact angle in each direction. Bars show the standard \
                   deviation of the fits; a bar smaller than the mark is not visible.";
    let charts = html! {
        // The legend escapes its texts.
        div.wide { (PreEscaped(wide)) }
        div.narrow aria-hidden="true" { (PreEscaped(narrow)) }
        div.row { @for chart in &charts { (chart) } }
    };
    figure(&charts, caption)
}

/// The samples with a measured main touch, with their indices.
fn touched_samples(results: &RunResults) -> impl Iterator<Item = (usize, &Sample)> {
    let is_touched = |&(index, _): &(usize, &Sample)| {
        results.angle_means.iter().any(|mean| mean.sample == index)
    };
    results.data.samples().iter().enumerate().filter(is_touched)
}

/// Shift against angle, averaged over the directions: the paper's Figure 12.
pub(super) fn averaged(results: &RunResults) -> Markup {
    let mut chart = Chart::new(
        "Mean of the directions",
        "Frequency shift of each sample against the contact angle, averaged over the directions.",
        Axis::linear("contact angle (°)").with_ticks(&results.angles_deg()),
        Axis::linear("frequency shift (Hz)").including(0.0),
    );
    chart.size_px = WIDE_PX;
    for (index, sample) in touched_samples(results) {
        let means = results.angle_means.iter().filter(|mean| mean.sample == index);
        let points = means.map(|mean| Point {
            x: mean.angle_deg,
            y: mean.mean.shift_hz,
            error: mean.mean.spread_hz.or(Some(mean.mean.sigma_hz)),
            note: Some(note(
                sample,
                mean.angle_deg,
                mean.mean.shift_hz,
                mean.mean.standard_error_hz(),
            )),
        });
        chart.series.push(Series::joined(&label(sample), index, points));
    }
    let caption = "Figure 12. Shift against contact angle, averaged over the directions. Bars show the \
                   standard deviation between the directions.";
    figure(&drawn_twice(chart, "fig-mean"), caption)
}

/// The blind touches by cluster: the paper's Figure 13.
pub(super) fn classification(data: &RunData, classification: &Classification) -> Markup {
    let mut chart = Chart::new(
        "Blind touches by cluster",
        "Frequency shift of each blind touch; shape and colour show the cluster, a ring marks a \
         touch \
         in the wrong cluster.",
        Axis::linear("blind touch"),
        Axis::linear("frequency shift (Hz)").including(0.0),
    );
    chart.size_px = WIDE_PX;
    let name = |sample: usize| data.samples()[sample].name.as_str();
    for (cluster, label) in classification.score.label_of.iter().enumerate() {
        let trials = classification.trials.iter().filter(|trial| trial.cluster == cluster);
        let points = trials.map(|trial| Point {
            x: f64::from(trial.number),
            y: trial.shift_hz,
            error: None,
            note: Some(format!(
                "touch {}: sample {}, {} Hz",
                trial.number,
                name(trial.sample),
                with_sigma(trial.shift_hz, trial.sigma_hz)
            )),
        });
        let stands_for =
            label.map_or("no sample".to_owned(), |label| format!("sample {}", name(label)));
        let key = format!("cluster {}: {stands_for}", cluster + 1);
        // The colour of the sample in the other figures.
        let series = Series::scatter(&key, label.unwrap_or(cluster), points);
        chart.series.push(series);
    }
    let wrong = classification.trials.iter().filter(|trial| !classification.is_correct(trial));
    let wrong: Vec<_> = wrong.map(|trial| (f64::from(trial.number), trial.shift_hz)).collect();
    if !wrong.is_empty() {
        let rings = Series::scatter("in the wrong cluster", rig_chart::COLOURS - 1, wrong);
        chart.series.push(Series { marker: Some(Marker::Ring), ..rings });
    }
    let caption = "Figure 13. The blind touches, sorted by k-means on their shifts alone: the partition with \
                   the smallest sum of squares. The labels are used for the score only; each cluster represents one sample, matched so that most touches agree.";
    figure(&drawn_twice(chart, "fig-blind"), caption)
}

/// The no-load resonance over the run.
pub(super) fn no_load(results: &RunResults) -> Markup {
    let minutes = |time_s: f64| time_s / 60.0;
    let mut chart = Chart::new(
        "Resonance with the probe clear",
        "The no-load resonance over the time of the run.",
        Axis::linear("rig time (min)").including(0.0),
        Axis::linear("resonance (Hz)"),
    );
    chart.size_px = (WIDE_PX.0, 270);
    let points = results.references.iter().map(|reference| Point {
        x: minutes(reference.time_s),
        y: reference.frequency_hz,
        error: Some(reference.sigma_hz),
        note: Some(format!("{} Hz", with_sigma(reference.frequency_hz, reference.sigma_hz))),
    });
    chart.series.push(Series::scatter("reference", 0, points));
    let ends = results.references.first().zip(results.references.last());
    let summary = results.no_load.and_then(|no_load| Some((no_load.mean_hz, no_load.drift?)));
    if let (Some((mean_hz, drift)), Some((first, last))) = (summary, ends) {
        let times = results.references.iter().map(|reference| reference.time_s);
        let mean_s = times.sum::<f64>() / results.references.len() as f64;
        let on_line = |time_s: f64| {
            (minutes(time_s), mean_hz + drift.hz_per_hour * (time_s - mean_s) / 3600.0)
        };
        let rate = with_sigma(drift.hz_per_hour, drift.sigma_hz_per_hour);
        let line = Series::line(
            &format!("drift {rate} Hz/h"),
            6,
            [first, last].map(|r| on_line(r.time_s)),
        );
        chart.series.push(Series { stroke: Some(Stroke::Dashed), ..line });
    }
    let is_by_drift = results.touches().iter().any(|row| row.next_no_load_sweep.is_some());
    let what = if is_by_drift {
        "the one before the touch and the one after it"
    } else {
        "the last one before the touch"
    };
    let caption = format!(
        "Every reference of the run, with the standard deviation of its fit. Each shift refers to {what}."
    );
    figure(&drawn_twice(chart, "fig-no-load"), &caption)
}

/// The readings of one touch and of its no-load sweep, with the fitted circuits. It is the main
/// touch
/// with the largest shift: there the tissue damps the resonance most.
pub(super) fn example(data: &RunData) -> Option<Markup> {
    let touch = data
        .touches
        .iter()
        .filter(|touch| touch.touch.phase == Phase::Main)
        .max_by(|a, b| a.shift_hz.total_cmp(&b.shift_hz))?;
    let (clear, contact) = (data.sweep(touch.no_load_sweep)?, data.sweep(touch.sweep)?);
    let charts = impedance("", &[(0, "probe clear", clear), (1, "in contact", contact)]);
    let settings = &touch.touch;
    let caption = format!(
        "The touch with the largest shift (sample {}, {}, {}°) and its reference: readings and the \
         circuits fitted to them. Resonance {} Hz clear and {} Hz in contact, a shift of {} Hz.",
        settings.sample,
        settings.pose.direction.name(),
        settings.pose.angle_deg,
        with_sigma(touch.no_load_hz, touch.no_load_sigma_hz),
        with_sigma(touch.resonance_hz, touch.sigma_hz),
        with_sigma(touch.shift_hz, touch.shift_sigma_hz),
    );
    Some(figure_row(&charts, &caption))
}

/// The readings of every refused sweep, with its reason; not on paper, where the small pictures and the
/// log tell of them.
pub(super) fn refused(data: &RunData) -> Markup {
    html! {
        div.screen {
            @for sweep in &data.sweeps {
                @if let SweepOutcome::Refused { reason } = &sweep.outcome { (refused_sweep(sweep, reason)) }
            }
        }
    }
}

fn refused_sweep(sweep: &Sweep, reason: &str) -> Markup {
    let step = sweep.step.as_deref().unwrap_or("no step");
    let name = sweep.purpose.name().replace('_', "-");
    let caption = format!(
        "Refused sweep {} ({name}, {step}, {} readings): {reason}.",
        sweep.number,
        sweep.readings.len()
    );
    let charts = impedance(&format!("-{}", sweep.number), &[(1, name.as_str(), sweep)]);
    figure_row(&charts, &caption)
}

/// Magnitude and phase of sweeps against frequency, side by side, with the fitted circuits. Each
/// sweep
/// has a colour and a name.
fn impedance(suffix: &str, sweeps: &[(usize, &str, &Sweep)]) -> Markup {
    let axis = || Axis::linear("frequency (Hz)");
    let of = sweeps.iter().map(|&(_, name, _)| name).collect::<Vec<_>>().join(" and ");
    let mut size = Chart::new(
        "Magnitude",
        &format!("Magnitude of the impedance against frequency, {of}."),
        axis(),
        Axis::log("|Z| (Ω)"),
    );
    let mut phase = Chart::new(
        "Phase",
        &format!("Phase of the impedance against frequency, {of}."),
        axis(),
        Axis::linear("phase (°)"),
    );
    for &(colour, name, sweep) in sweeps {
        let value =
            |reading: &ReadingRecord| Some((reading.frequency_hz, reading.impedance_ohm()?));
        let values = || sweep.readings.iter().filter_map(value);
        let magnitude = values().map(|(hz, (r, x))| (hz, r.hypot(x)));
        size.series.push(Series::scatter(name, colour, magnitude));
        let angle = values().map(|(hz, (r, x))| (hz, x.atan2(r).to_degrees()));
        phase.series.push(Series::scatter(name, colour, angle));
        if let Some(circuit) = circuit_of(sweep) {
            let curve = || fitted(sweep, &circuit);
            let fit = Series::line("", colour, curve().map(|(f, size, _)| (f, size)));
            size.series.push(Series { name: None, ..fit });
            let fit = Series::line("", colour, curve().map(|(f, _, phase)| (f, phase)));
            phase.series.push(Series { name: None, ..fit });
        }
    }
    (size.size_px, phase.size_px) = (HALF_PX, HALF_PX);
    html! {
        (drawn(&size, &format!("fig-size{suffix}")))
        (drawn(&phase, &format!("fig-phase{suffix}")))
    }
}

fn circuit_of(sweep: &Sweep) -> Option<Circuit> {
    let SweepOutcome::Accepted { resonance_hz, circuit, .. } = sweep.outcome else { return None };
    let circuit = circuit?;
    Some(Circuit {
        resonance_hz,
        q: circuit.quality_factor,
        c0_farad: circuit.static_capacitance_f,
        c1_farad: circuit.static_capacitance_f * circuit.capacitance_ratio,
        loss_tangent: circuit.loss_tangent,
    })
}

/// Frequency in Hz, magnitude in ohm and phase in degrees of the impedance of the circuit, over the
/// range of the readings.
fn fitted(sweep: &Sweep, circuit: &Circuit) -> impl Iterator<Item = (f64, f64, f64)> {
    const STEPS: u32 = 160;
    let frequencies = || sweep.readings.iter().map(|reading| reading.frequency_hz);
    let low = frequencies().fold(f64::INFINITY, f64::min);
    let high = frequencies().fold(f64::NEG_INFINITY, f64::max);
    (0..=STEPS).map(move |step| {
        let frequency_hz = low + (high - low) * f64::from(step) / f64::from(STEPS);
        let impedance_ohm = circuit.impedance_ohm(frequency_hz);
        (frequency_hz, impedance_ohm.norm(), impedance_ohm.arg().to_degrees())
    })
}

fn label(sample: &Sample) -> String {
    match sample.stiffness_mpa {
        Some(stiffness) => format!("sample {}, {stiffness} MPa", sample.name),
        None => format!("sample {}", sample.name),
    }
}

fn note(sample: &Sample, angle_deg: f64, shift_hz: f64, sigma_hz: f64) -> String {
    format!(
        "sample {}, {}°: {} Hz",
        sample.name,
        fixed(angle_deg, 1),
        with_sigma(shift_hz, sigma_hz)
    )
}
