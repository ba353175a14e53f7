//! The section of the report about stiffness: how it was calibrated, against what is known, and
//! what it says of the blind touches.

use rig_chart::{Axis, Chart, Escaped, Marker, Point, Rule, Series};
use rig_contact::inverse::Interval;

use super::{
    element::table,
    figures::{HALF_PX, drawn, figure},
    tables::dash,
};
use crate::{
    RunResults,
    data::RunData,
    results::{
        recognition::{Method, Recognition},
        stiffness::{Calibration, SampleStiffness, ScaleSource, Site, Stiffness, TouchStiffness},
    },
    units::{fixed, percent, percent_range, with_sigma},
};

/// The content of the section.
pub(crate) fn section(data: &RunData, stiffness: &Stiffness, results: &RunResults) -> String {
    let by_stiffness = |found: &&Recognition| found.method == Method::CalibratedStiffness;
    let recognition = results.recognitions.iter().find(by_stiffness);
    let known = stiffness.samples.iter().any(|sample| sample.known_mpa.is_some());
    let mut charts = String::new();
    if known {
        charts += &against_known(data, stiffness);
    }
    if let Some(recognition) = recognition {
        charts += &blind(data, stiffness, recognition);
    }
    let caption = "Stiffness of the samples against what is known of it; and of each blind touch, \
                   with a ring around those taken for another sample or for none. Bars show the \
                   standard deviation, for the samples with that of the calibration.";
    let figure = if charts.is_empty() {
        String::new()
    } else {
        figure(&format!("<div class=\"row\">\n{charts}</div>\n"), caption)
    };
    let sites = stiffness.sites.as_ref().map(|found| sites(data, stiffness, found));
    let angle = match &stiffness.sites {
        None => "and with the contact angle of each touch known",
        Some(_) => "and without knowing the contact angles",
    };
    calibration(&stiffness.calibration, angle)
        + &figure
        + &samples(data, stiffness, results)
        + &sites.unwrap_or_default()
}

/// Which calibration was used, and what it adds.
fn calibration(calibration: &Calibration, angle: &str) -> String {
    let Calibration { resonance_ratio, factor, sigma_rel, source } = *calibration;
    let ratio = fixed(resonance_ratio, 4);
    let adds = percent(sigma_rel);
    let scale = match source {
        ScaleSource::Known { samples, angle_deg } => {
            let at = angle_deg.map_or_else(String::new, |angle| format!(" at {angle}°"));
            let factor = with_sigma(factor, sigma_rel * factor);
            format!(
                "The touches{at} of {samples} samples of known stiffness say {factor} times what is \
                 known, by which all stiffness was divided: one factor for the run. It is uncertain \
                 by {adds}, which is part of every standard deviation of a sample below. So only \
                 the ratios between samples and between angles are a test against what is known."
            )
        }
        ScaleSource::Described => format!(
            "No sample is known, so that the scale rests on the description of the sensor alone. \
             It is taken as uncertain by {adds}, which is part of every standard deviation of a \
             sample below."
        ),
    };
    format!(
        "<p>Young's modulus of each sample from its main touches, by the sensor that the rig file \
         describes {angle}. The free resonance measured was {ratio} times \
         the one described, and each shift was scaled by that. {scale}</p>\n"
    )
}

/// How far each sample is from what is known of it. On a chart of one against the other nobody
/// would see the error bars.
fn against_known(data: &RunData, stiffness: &Stiffness) -> String {
    let mut chart = Chart::new(
        "Samples",
        "Deviation of each sample's stiffness from the known one, against the known one.",
        Axis::log("known stiffness (MPa)"),
        Axis::linear("found less known (%)").including(0.0),
    );
    chart.size_px = HALF_PX;
    let known = stiffness.samples.iter().filter_map(|sample| Some((sample, sample.known_mpa?)));
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
    drawn(&chart.svg("fig-stiffness"))
}

/// The blind touches by what they were taken for.
fn blind(data: &RunData, stiffness: &Stiffness, recognition: &Recognition) -> String {
    let mut chart = Chart::new(
        "Blind touches",
        "Young's modulus of each blind touch; its shape and colour tell the sample it was taken \
         for, a ring that this is wrong.",
        Axis::linear("blind touch"),
        Axis::log("stiffness (MPa)"),
    );
    chart.size_px = HALF_PX;
    let touches: Vec<(&TouchStiffness, Option<usize>)> =
        stiffness.blind.iter().zip(recognition.taken_for.iter().copied()).collect();
    for (index, sample) in data.samples().iter().enumerate() {
        let taken = touches.iter().filter(|(_, taken)| *taken == Some(index));
        let points: Vec<Point> = taken.filter_map(|(reading, _)| point(data, reading)).collect();
        if !points.is_empty() {
            let series = Series::scatter(&format!("sample {}", sample.name), index, points);
            chart.series.push(series);
        }
    }
    let wrong = touches.iter().filter(|(reading, taken)| *taken != Some(reading.sample));
    let wrong: Vec<Point> = wrong.filter_map(|(reading, _)| point(data, reading)).collect();
    if !wrong.is_empty() {
        let wrong = wrong.into_iter().map(|point| Point { error: None, note: None, ..point });
        let rings = Series::scatter("not recognised", rig_chart::COLOURS - 1, wrong);
        chart.series.push(Series { marker: Some(Marker::Ring), ..rings });
    }
    drawn(&chart.svg("fig-blind-stiffness"))
}

fn point(data: &RunData, reading: &TouchStiffness) -> Option<Point> {
    let young = reading.young.ok()?;
    let name = &data.samples()[reading.sample].name;
    Some(Point {
        x: f64::from(reading.number),
        y: young.mpa,
        error: Some(young.sigma_mpa),
        note: Some(format!(
            "touch {}: sample {name}, {} MPa",
            reading.number,
            with_sigma(young.mpa, young.sigma_mpa)
        )),
    })
}

fn samples(data: &RunData, stiffness: &Stiffness, results: &RunResults) -> String {
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
        let deviation = |found: &SampleStiffness| {
            let deviation = found.young_mpa / found.known_mpa? - 1.0;
            Some(format!("{} %", fixed(100.0 * deviation, 1)))
        };
        let used = basis.used.to_string();
        vec![
            Escaped(&data.samples()[sample].name).to_string(),
            known_mpa.map_or_else(dash, |known| known.to_string()),
            found.map_or_else(
                || "none".to_owned(),
                |found| format!("<b>{}</b>", with_sigma(found.young_mpa, found.sigma_mpa)),
            ),
            found.and_then(deviation).unwrap_or_else(dash),
            basis.shortfall().map_or(used, |short| format!("<span class=\"fault\">{short}</span>")),
            found.and_then(|found| found.spread_mpa).map_or_else(dash, |spread| fixed(spread, 4)),
        ]
    };
    let rows: Vec<_> = results.samples().into_iter().map(row).collect();
    let caption = "Young's modulus of the samples with its standard deviation, and the standard \
                   deviation of single ones about it.";
    table(caption, &heads.map(str::to_owned), &rows)
}

/// What was found at each site without knowing its angle.
fn sites(data: &RunData, stiffness: &Stiffness, sites: &[Site]) -> String {
    let heads =
        ["sample", "angle set", "touches", "stiffness (MPa)", "angle found", "azimuth found"];
    let row = |(site, reading): (&Site, &TouchStiffness)| {
        let name = Escaped(&data.samples()[site.sample].name).to_string();
        let mut row = vec![name, format!("{}°", site.angle_deg), site.touches.to_string()];
        match (reading.young, site.found) {
            (Ok(young), Ok(found)) => {
                let degrees = |of: &Interval, is_identified: bool| {
                    let found = with_sigma(of.value.to_degrees(), of.sigma.to_degrees());
                    if is_identified { format!("{found}°") } else { "not identified".to_owned() }
                };
                row.push(format!("<b>{}</b>", with_sigma(young.mpa, young.sigma_mpa)));
                row.push(degrees(&found.angle_rad, found.is_angle_identified));
                row.push(degrees(&found.azimuth_rad, found.is_azimuth_identified));
            }
            (Err(error), _) | (_, Err(error)) => {
                row.push(format!("<span class=\"fault\">{}</span>", Escaped(&error.to_string())));
                row.extend([dash(), dash()]);
            }
        }
        row
    };
    let rows: Vec<_> = sites.iter().zip(&stiffness.main).map(row).collect();
    let caption = "Stiffness, contact angle and azimuth found together from the touches of each \
                   site, with their standard deviations. An angle or azimuth is not identified \
                   when the touches leave more than half of the uncertainty that there was before \
                   them; the stiffness then holds for all of its values.";
    table(caption, &heads.map(str::to_owned), &rows)
}

/// The methods of recognition side by side.
pub(crate) fn recognitions(recognitions: &[Recognition]) -> String {
    let heads = ["method", "recognised", "of", "rate", "95 % interval"].map(str::to_owned);
    let row = |found: &Recognition| {
        vec![
            found.method.describe().to_owned(),
            found.correct.to_string(),
            found.trials.to_string(),
            percent(found.rate()),
            percent_range(found.interval()),
        ]
    };
    let rows: Vec<_> = recognitions.iter().map(row).collect();
    let caption = "Blind touches recognised by each method, with Wilson's interval. The clusters of \
                   k-means are named afterwards so that most touches agree, which flatters it; the \
                   classes are fixed by the main touches before.";
    table(caption, &heads, &rows)
}
