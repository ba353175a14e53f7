//! The section about stiffness: its calibration, the samples against known values, the blind touches.

use maud::{Markup, html};
use rig_analysis::run::{RunCalibration, RunSample, ScaleSource};
use rig_chart::{Axis, Chart, Marker, Point, Rule, Series};
use rig_contact::inverse::Interval;

use super::{
    budget::{bars, parts},
    element::{dash, drawn, fault, figure_row, table, text},
    figures::HALF_PX,
    model::model,
    tables::with_notes,
};
use crate::{
    data::RunData,
    results::{
        RunResults,
        recognition::{Method, Recognition},
        stiffness::{SETS_SCALE, Site, Stiffness, TouchStiffness},
    },
    units::{decimals_for, fixed, percent, percent_range, with_sigma},
};

/// The content of the section.
pub(super) fn section(results: &RunResults, stiffness: &Stiffness) -> Markup {
    let data = &results.data;
    let by_stiffness = |found: &&Recognition| found.method == Method::CalibratedStiffness;
    let recognition = results.recognitions.iter().find(by_stiffness);
    let is_known = stiffness.measured().any(|sample| sample.known_mpa.is_some());
    let is_measured = stiffness.measured().next().is_some();
    let charts = html! {
        @if is_known { (against_known(data, stiffness)) }
        @if let Some(recognition) = recognition { (blind(data, stiffness, recognition)) }
        @if is_measured { (bars(data, stiffness)) }
    };
    let caption = "Deviation of the samples from their known stiffness, and the stiffness of each blind \
                   touch. A ring marks a touch taken for another sample or for none. Error bars show \
                   the standard deviation, for the samples with that of the calibration. The budget has a bar \
                   for each sample: its height is the relative standard deviation, its parts have the \
                   proportions of their variances.";
    let angle = match &stiffness.sites {
        None => "and the known contact angle of each touch",
        Some(_) => "and without the contact angles",
    };
    html! {
        (samples(results, stiffness))
        (model(results, stiffness))
        (calibration(&stiffness.calibration, angle))
        @if is_measured || recognition.is_some() { (figure_row(&charts, caption)) }
        @if is_measured { (parts(data, stiffness)) }
        @if let Some(found) = &stiffness.sites { (sites(data, stiffness, found)) }
    }
}

/// The calibration and its uncertainty.
fn calibration(calibration: &RunCalibration, angle: &str) -> Markup {
    let RunCalibration { resonance_ratio, factor, sigma_rel, source, .. } = *calibration;
    let ratio = fixed(resonance_ratio, 4);
    let adds = percent(sigma_rel);
    let scale = match source {
        ScaleSource::Known { samples, angle_deg } => {
            let at = angle_deg.map_or_else(String::new, |angle| format!(" at {angle}°"));
            let factor = with_sigma(factor, sigma_rel * factor);
            format!(
                "The touches{at} of {samples} samples of known stiffness give {factor} times the \
                 known values. Every stiffness was divided by this one factor of the run. Its \
                 uncertainty is {adds}. It is part of every standard deviation of a sample below, as far \
                 as the other samples give the factor. A sample whose touches alone give it has its known value again \
                 and no uncertainty of its own. Only the ratios between samples and between angles \
                 are a test against known values."
            )
        }
        ScaleSource::Described => format!(
            "No sample is known: the scale rests on the description of the sensor alone. Its assumed \
             uncertainty of {adds} is part of every standard deviation of a sample below."
        ),
    };
    html! {
        p {
            "Young's modulus of each sample from its main touches, with the sensor of the rig file \
             " (angle) ". The free resonance measured was " (ratio) " times the one \
             described, and each shift was scaled by that. " (scale)
        }
        @if let Some(sigmas) = calibration.beyond_description() {
            p {
                (fault("This factor is not that of the description")) ": by the rig file it is 1 within "
                (percent(calibration.described_rel)) ", from which it differs by " (fixed(sigmas, 1))
                " standard deviations. A stiffness is right for samples that are like the known ones. What all of these \
                 share can make a factor, which the residuals of one depth need not show: the rigidity of the sensor, the \
                 radius of its ball, the depth, the law of the contact, the thickness of the samples."
            }
        }
    }
}

/// The deviation of each sample from its known stiffness. In a chart of one against the other, the
/// error bars would be too small to see.
fn against_known(data: &RunData, stiffness: &Stiffness) -> Markup {
    let mut chart = Chart::new(
        "Samples",
        "Deviation of each sample's stiffness from the known one, against the known one.",
        Axis::log("known stiffness (MPa)"),
        Axis::linear("found less known (%)").including(0.0),
    );
    chart.size_px = HALF_PX;
    let known = stiffness.measured().filter_map(|sample| Some((sample, sample.known_mpa?)));
    for (sample, known_mpa) in known {
        let name = format!("sample {}", data.samples()[sample.sample].name);
        let found = with_sigma(sample.young_mpa, sample.sigma_mpa);
        let point = Point {
            x: known_mpa,
            y: 100.0 * (sample.young_mpa / known_mpa - 1.0),
            error: Some(100.0 * sample.sigma_mpa / known_mpa),
            note: Some(format!("{name}: {found} MPa, known {known_mpa} MPa")),
        };
        chart.series.push(Series::scatter(&name, sample.sample, [point]));
    }
    chart.rules.push(Rule::AtY { value: 0.0, label: String::new() });
    drawn(&chart, "fig-stiffness")
}

/// The blind touches by the samples that they were taken for.
fn blind(data: &RunData, stiffness: &Stiffness, recognition: &Recognition) -> Markup {
    let mut chart = Chart::new(
        "Blind touches",
        "Young's modulus of each blind touch; shape and colour show the sample that it was taken \
         for, a ring marks a wrong one.",
        Axis::linear("blind touch"),
        Axis::log("stiffness (MPa)"),
    );
    chart.size_px = HALF_PX;
    let touches: Vec<(&TouchStiffness, Option<usize>)> =
        stiffness.blind.iter().zip(recognition.taken_for.iter().copied()).collect();
    for (index, sample) in data.samples().iter().enumerate() {
        let taken = touches.iter().filter(|(_, taken)| *taken == Some(index));
        let points: Vec<Point> = taken.filter_map(|(touch, _)| point(data, touch)).collect();
        if !points.is_empty() {
            let series = Series::scatter(&format!("sample {}", sample.name), index, points);
            chart.series.push(series);
        }
    }
    let wrong = touches.iter().filter(|(touch, taken)| *taken != Some(touch.sample));
    let wrong: Vec<Point> = wrong.filter_map(|(touch, _)| point(data, touch)).collect();
    if !wrong.is_empty() {
        let wrong = wrong.into_iter().map(|point| Point { error: None, note: None, ..point });
        let rings = Series::scatter("not recognised", rig_chart::COLOURS - 1, wrong);
        chart.series.push(Series { marker: Some(Marker::Ring), ..rings });
    }
    drawn(&chart, "fig-blind-stiffness")
}

fn point(data: &RunData, touch: &TouchStiffness) -> Option<Point> {
    let young = touch.young.ok()?;
    let name = &data.samples()[touch.sample].name;
    Some(Point {
        x: f64::from(touch.number),
        y: young.mpa,
        error: Some(young.sigma_mpa),
        note: Some(format!(
            "touch {}: sample {name}, {} MPa",
            touch.number,
            with_sigma(young.mpa, young.sigma_mpa)
        )),
    })
}

fn samples(results: &RunResults, stiffness: &Stiffness) -> Markup {
    let data = &results.data;
    let heads = [
        "sample",
        "known (MPa)",
        "found (MPa)",
        "deviation",
        if stiffness.sites.is_some() { "sites" } else { "touches" },
        "spread (MPa)",
    ];
    let row = |sample: usize| {
        let (found, basis) = (stiffness.of_sample(sample), stiffness.basis(data, sample));
        let known_mpa = data.samples()[sample].stiffness_mpa;
        let deviation = |found: &RunSample| {
            if found.sets_scale {
                return None;
            }
            let deviation = found.young_mpa / found.known_mpa? - 1.0;
            Some(text(format!("{} %", fixed(100.0 * deviation, 1))))
        };
        let value = |found: &RunSample| {
            if found.sets_scale {
                return text(SETS_SCALE);
            }
            html! { b { (with_sigma(found.young_mpa, found.sigma_mpa)) } }
        };
        let spread = found.and_then(|found| found.spread_mpa);
        vec![
            text(&data.samples()[sample].name),
            known_mpa.map_or_else(dash, text),
            found.map_or_else(|| text("none"), value),
            found.and_then(deviation).unwrap_or_else(dash),
            basis.shortfall().map_or_else(|| text(basis.used), |shortfall| fault(&shortfall)),
            spread.map_or_else(dash, |spread| text(fixed(spread, decimals_for(spread)))),
        ]
    };
    let rows: Vec<_> = results.samples().into_iter().map(row).collect();
    let caption = "Young's modulus of the samples with its standard deviation, and the standard \
                   deviation of single ones about it.";
    table(&with_notes(caption, results), &heads, &rows)
}

/// Stiffness, angle and azimuth of each site, from touches at an unknown angle.
fn sites(data: &RunData, stiffness: &Stiffness, sites: &[Site]) -> Markup {
    let heads =
        ["sample", "angle set", "touches", "stiffness (MPa)", "angle found", "azimuth found"];
    let row = |(site, touch): (&Site, &TouchStiffness)| {
        let name = &data.samples()[site.sample].name;
        let mut row = vec![text(name), text(format!("{}°", site.angle_deg)), text(site.touches)];
        match (touch.young, site.found) {
            (Ok(young), Ok(found)) => {
                let degrees = |of: &Interval, is_identified: bool| {
                    let found = with_sigma(of.value.to_degrees(), of.sigma.to_degrees());
                    if is_identified { format!("{found}°") } else { "not identified".to_owned() }
                };
                row.push(html! { b { (with_sigma(young.mpa, young.sigma_mpa)) } });
                row.push(text(degrees(&found.angle_rad, found.is_angle_identified)));
                row.push(text(degrees(&found.azimuth_rad, found.is_azimuth_identified)));
            }
            (Err(error), _) | (_, Err(error)) => {
                row.push(fault(&error.to_string()));
                row.extend([dash(), dash()]);
            }
        }
        row
    };
    let rows: Vec<_> = sites.iter().zip(&stiffness.main).map(row).collect();
    let caption = "Stiffness, contact angle and azimuth found together from the touches of each \
                   site, with their standard deviations. An angle or azimuth is not identified \
                   when the touches leave more than half of the prior uncertainty; the stiffness then holds \
                   for all of its values.";
    table(caption, &heads, &rows)
}

/// The methods of recognition side by side.
pub(super) fn recognitions(recognitions: &[Recognition]) -> Markup {
    let heads = ["method", "recognised", "of", "rate", "95 % interval"];
    let row = |found: &Recognition| {
        vec![
            text(found.method.describe()),
            text(found.correct),
            text(found.trials),
            text(percent(found.rate())),
            text(percent_range(found.interval())),
        ]
    };
    let rows: Vec<_> = recognitions.iter().map(row).collect();
    let caption = "Blind touches recognised by each method, with Wilson's interval. Clusters of k-means \
                   get their samples afterwards, so that most touches agree, which flatters these \
                   methods. Classes are fixed before, by the main touches.";
    table(caption, &heads, &rows)
}
