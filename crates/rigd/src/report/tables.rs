//! The tables of the report.

use rig_analysis::shift::{AngleMean, Cell};
use rig_chart::Escaped;

use super::{
    data::{LogKind, RunData},
    html::{add, table},
    results::{Classification, DIRECTIONS, RunResults},
    units::{clock, decimals_for, fixed, with_sigma},
};

/// Every shift with its uncertainties.
pub(super) fn shifts(data: &RunData, results: &RunResults) -> String {
    let has = |direction: usize| results.cells.iter().any(|cell| cell.direction == direction);
    let directions: Vec<usize> = (0..DIRECTIONS.len()).filter(|&d| has(d)).collect();
    let mut heads = vec!["sample".to_owned(), "angle".to_owned()];
    heads.extend(directions.iter().map(|&d| format!("{} (Hz)", DIRECTIONS[d].name())));
    heads.extend(["mean (Hz)".to_owned(), "between directions (Hz)".to_owned()]);
    let row = |mean: &AngleMean| {
        let name = &data.samples()[mean.sample].name;
        let mut row = vec![Escaped(name).to_string(), format!("{}°", mean.angle_deg)];
        for &direction in &directions {
            let is_here = |cell: &&Cell| {
                (cell.sample, cell.angle_deg, cell.direction)
                    == (mean.sample, mean.angle_deg, direction)
            };
            row.push(results.cells.iter().find(is_here).map_or_else(dash, shift));
        }
        row.push(format!(
            "<b>{}</b>",
            with_sigma(mean.mean.shift_hz, mean.mean.standard_error_hz())
        ));
        row.push(
            mean.mean
                .spread_hz
                .map_or_else(dash, |spread| fixed(spread, decimals_for(spread).min(3))),
        );
        row
    };
    let rows: Vec<_> = results.means.iter().map(row).collect();
    let caption = "Frequency shifts with the standard deviation of their fits; their mean with that \
                   of a mean, from the fits or from the scatter between the directions, whichever \
                   is larger; and that scatter, as a standard deviation.";
    table(caption, &heads, &rows)
}

/// The shift of a cell, with the spread of its repeats where there were several.
fn shift(cell: &Cell) -> String {
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
pub(super) fn confusion(data: &RunData, classification: &Classification) -> String {
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

/// What persons were asked and did, and what went wrong.
pub(super) fn log(data: &RunData) -> String {
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
pub(super) fn dash() -> String {
    "–".to_owned()
}
