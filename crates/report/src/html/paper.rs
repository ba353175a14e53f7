//! The results beside those of the paper whose experiment the shipped protocol replays.
//!
//! # Source
//! Sensors 2020, 20, 6607, <https://doi.org/10.3390/s20226607>: sections 3.1 and 3.2.

use maud::{Markup, html};

use super::element::{table, text};
use crate::{
    results::RunResults,
    units::{fixed, percent, percent_range, with_sigma},
};

/// Rows of what both have: this run, and the paper.
pub(super) fn beside(results: &RunResults) -> Markup {
    let mut rows: Vec<Vec<Markup>> = Vec::new();
    if let Some(no_load) = &results.no_load {
        let here = format!("{} Hz", fixed(no_load.mean_hz, 2));
        rows.push(vec![
            text("free resonance"),
            text(here),
            text("137.6 Hz measured, 140.4 Hz simulated"),
        ]);
    }
    if let Some(found) = &results.sensitivity {
        let chord = found.sensitivity.chord;
        let here = format!("{} Hz/MPa", with_sigma(chord.hz_per_mpa, chord.sigma_hz_per_mpa));
        let paper = "134.11 Hz/MPa simulated, from 0.045 MPa to 0.649 MPa";
        rows.push(vec![text("sensitivity (Figure 12)"), text(here), text(paper)]);
    }
    if let Some(largest) = largest_spread(results) {
        let here = format!("{} between directions at most", percent(largest));
        let paper = "no significant influence of the direction; no number";
        rows.push(vec![text("directions (Figure 11)"), text(here), text(paper)]);
    }
    if let Some(classification) = &results.classification {
        let score = &classification.score;
        let (rate, range) =
            (percent(score.rate().unwrap_or_default()), percent_range(score.interval()));
        let here = format!("{} of {}: {rate} ({range})", score.correct, score.trials);
        rows.push(vec![text("k-means (Figure 13)"), text(here), text("46 of 50: 92 %")]);
    }
    if rows.is_empty() {
        return html! {};
    }
    let caption = "This run beside the paper (Sensors 2020, 20, 6607). The paper prints no shift: its figures 11 \
                   and 12 are pictures. Its frequencies and its sensitivity hold for its own sensor.";
    html! { div.words { (table(caption, &["", "this run", "the paper"], &rows)) } }
}

/// The largest standard deviation between the directions, as a share of the shift.
fn largest_spread(results: &RunResults) -> Option<f64> {
    let shares = results
        .angle_means
        .iter()
        .filter_map(|mean| Some(mean.mean.spread_hz? / mean.mean.shift_hz));
    shares.filter(|share| share.is_finite()).max_by(f64::total_cmp)
}
