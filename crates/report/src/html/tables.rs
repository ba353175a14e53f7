//! The tables of the report.

use rig_analysis::shift::{DirectionMean, Mean};
use rig_chart::Escaped;

use super::element::{add, table};
use crate::{
    RunResults, TouchRow, TouchStatus,
    data::{DIRECTIONS, LogKind, RunData},
    results::{classification::Classification, grid::GridRow, status::Tally},
    units::{clock, decimals_for, fixed, with_sigma},
};

/// Every shift with its uncertainties, and what stands in the place of those that are missing.
pub(crate) fn shifts(data: &RunData, results: &RunResults) -> String {
    let directions = results.directions();
    let mut heads = vec!["sample".to_owned(), "angle".to_owned()];
    heads.extend(directions.iter().map(|&d| format!("{} (Hz)", DIRECTIONS[d].name())));
    heads.extend(["mean (Hz)".to_owned(), "between directions (Hz)".to_owned()]);
    let row = |planned: &GridRow| {
        let GridRow { sample, angle_deg, .. } = *planned;
        let name = &data.samples()[sample].name;
        let mut row = vec![Escaped(name).to_string(), format!("{angle_deg}°")];
        for &direction in &directions {
            let cell = results.direction_mean(sample, angle_deg, direction);
            row.push(of_some(planned.directions[direction], cell.map(shift)));
        }
        let mean = results.angle_mean(sample, angle_deg).map(|mean| mean.mean);
        let with_error = |mean: Mean| with_sigma(mean.shift_hz, mean.standard_error_hz());
        let bold = mean.map(|mean| format!("<b>{}</b>", with_error(mean)));
        row.push(of_some(planned.over_directions(), bold));
        let spread = |spread| fixed(spread, decimals_for(spread).min(3));
        row.push(mean.and_then(|mean| mean.spread_hz).map_or_else(dash, spread));
        row
    };
    let rows: Vec<_> = results.grid.iter().map(row).collect();
    let caption = "Frequency shifts with the standard deviation of their fits; their mean with that \
                   of a mean, from the fits or from the scatter between the directions, whichever \
                   is larger; and that scatter, as a standard deviation.";
    table(caption, &heads, &rows)
}

/// A value, and of how many it is where some are missing; or why there is none.
fn of_some(tally: Tally, value: Option<String>) -> String {
    match (value, tally.shortfall()) {
        (Some(value), Some(shortfall)) => {
            format!("{value}<br><small class=\"fault\">{shortfall}</small>")
        }
        (Some(value), None) => value,
        (None, _) => format!("<span class=\"fault\">{}</span>", tally.missing()),
    }
}

/// The shift of a cell, with the spread of its repeats where there were several.
fn shift(cell: &DirectionMean) -> String {
    let shift = with_sigma(cell.mean.shift_hz, cell.mean.sigma_hz);
    match cell.mean.spread_hz {
        Some(spread) => {
            let (spread, count) = (fixed(spread, decimals_for(spread).min(3)), cell.mean.count);
            format!("{shift}<br><small>{count} touches, spread {spread}</small>")
        }
        None => shift,
    }
}

/// Which sample fell into which cluster.
pub(crate) fn confusion(data: &RunData, classification: &Classification) -> String {
    let score = &classification.score;
    let mut heads = vec!["sample".to_owned()];
    for (cluster, centre_hz) in classification.centres_hz.iter().enumerate() {
        heads.push(format!("cluster {} ({} Hz)", cluster + 1, fixed(*centre_hz, 1)));
    }
    let row = |(sample, counts): (usize, &Vec<u32>)| {
        let mut row = vec![Escaped(&data.samples()[sample].name).to_string()];
        for (cluster, &count) in counts.iter().enumerate() {
            let is_own = score.label_of[cluster] == Some(sample);
            row.push(match (is_own, count) {
                (true, count) => format!("<b class=\"own\">{count}</b>"),
                (false, 0) => "·".to_owned(),
                (false, count) => format!("<b class=\"wrong\">{count}</b>"),
            });
        }
        row
    };
    let touched =
        score.counts.iter().enumerate().filter(|(_, counts)| counts.iter().any(|&c| c > 0));
    let rows: Vec<_> = touched.map(row).collect();
    let caption = "Blind touches by sample and cluster, with the mean shift of each cluster. Boxed: \
                   the sample for which a cluster stands.";
    table(caption, &heads, &rows)
}

/// Every planned touch with what became of it.
pub(crate) fn touches(rows: &[TouchRow]) -> String {
    let heads = ["touch", "sample", "status", "shift (Hz)", "stiffness (MPa)", "class", "reason"];
    let row = |row: &TouchRow| {
        let pair = |value: Option<f64>, sigma: Option<f64>| {
            value.zip(sigma).map_or_else(dash, |(value, sigma)| with_sigma(value, sigma))
        };
        let status = match row.status {
            TouchStatus::Measured => row.status.describe().to_owned(),
            other => format!("<span class=\"fault\">{}</span>", other.describe()),
        };
        vec![
            Escaped(&row.step).to_string(),
            Escaped(&row.sample).to_string(),
            status,
            pair(row.shift_hz, row.shift_sigma_hz),
            pair(row.stiffness_mpa, row.stiffness_sigma_mpa),
            row.class.as_deref().map_or_else(dash, |class| Escaped(class).to_string()),
            Escaped(row.reason.as_deref().unwrap_or_default()).to_string(),
        ]
    };
    let rows: Vec<_> = rows.iter().map(row).collect();
    let caption = "Every planned touch, in order. The stiffness is that of the touch by itself, with \
                   the uncertainty of the calibration; the class is the sample for whose cluster a \
                   blind touch was taken.";
    let table = table(caption, &heads.map(str::to_owned), &rows);
    format!("<div class=\"log touches\">\n{table}</div>\n")
}

/// What persons were asked and did, and what went wrong.
pub(crate) fn log(data: &RunData) -> String {
    let heads = ["rig time", "kind", "what", "step"].map(str::to_owned);
    let mut rows = Vec::new();
    for entry in &data.log {
        let time = clock((entry.rig_us - data.begin_us) as f64 * 1e-6);
        let class = if entry.kind == LogKind::Fault { " class=\"fault\"" } else { "" };
        let mut kind = String::new();
        add(&mut kind, format_args!("<span{class}>{}</span>", entry.kind.name()));
        let step = Escaped(entry.step.as_deref().unwrap_or_default()).to_string();
        rows.push(vec![time, kind, Escaped(&entry.text).to_string(), step]);
    }
    let table = table("What was asked, done and refused, in order.", &heads, &rows);
    format!("<div class=\"log\">\n{table}</div>\n")
}

/// What stands where there is nothing.
pub(crate) fn dash() -> String {
    "–".to_owned()
}
