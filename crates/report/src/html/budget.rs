//! The uncertainty budget of the samples: one bar for each.

use maud::{Markup, html};
use rig_analysis::{budget::Part, run::RunSample};
use rig_chart::{Axis, Band, BandEdge, Chart};

use super::{
    element::{drawn, table, text},
    figures::HALF_PX,
};
use crate::{data::RunData, results::stiffness::Stiffness, units::fixed};

/// Half of the width of a bar; bars are one apart.
const HALF_WIDTH: f64 = 0.35;

/// The parts of a bar: as many as there are colours. Both resonances are known best, and are one.
const BARS: [(&str, &[Part]); rig_chart::COLOURS] = [
    ("sweep and reference", &[Part::Sweep, Part::Reference]),
    ("surface", &[Part::Surface]),
    ("depth", &[Part::Depth]),
    ("angle", &[Part::Angle]),
    ("sensor", &[Part::Sensor]),
    ("model", &[Part::Model]),
    ("sample", &[Part::Sample]),
];

/// A bar for each sample. Its height is the relative standard deviation, its parts have the proportions of
/// their variances.
pub(super) fn bars(data: &RunData, stiffness: &Stiffness) -> Markup {
    let samples: Vec<&RunSample> = stiffness.measured().collect();
    let ticks: Vec<f64> = (1..=samples.len()).map(|number| number as f64).collect();
    let names: Vec<&str> =
        samples.iter().map(|sample| data.samples()[sample.sample].name.as_str()).collect();
    let mut chart = Chart::new(
        "Uncertainty budget",
        "The relative standard deviation of the stiffness of each sample by its causes, one bar for each \
         sample.",
        Axis::linear(&format!("sample: {}", names.join(", "))).with_ticks(&ticks),
        Axis::linear("standard deviation (%)").including(0.0),
    );
    chart.size_px = HALF_PX;
    for (&x, RunSample { budget, .. }) in ticks.iter().zip(&samples) {
        let total = budget.total();
        let mut low = 0.0;
        for (colour, (name, parts)) in BARS.into_iter().enumerate() {
            let variance: f64 = parts.iter().map(|part| budget.of(*part).powi(2)).sum();
            let high = low + 100.0 * variance / total;
            let edge = |x| BandEdge { x, low, high };
            let edges = vec![edge(x - HALF_WIDTH), edge(x + HALF_WIDTH)];
            let name = (x == 1.0).then(|| name.to_owned());
            chart.bands.push(Band { name, edges, colour });
            low = high;
        }
    }
    html! { div.bars { (drawn(&chart, "fig-budget")) } }
}

/// The parts of each sample. They are on the screen only: the print has the bars.
pub(super) fn parts(data: &RunData, stiffness: &Stiffness) -> Markup {
    let mut heads = vec!["sample"];
    heads.extend(Part::ALL.map(Part::name));
    heads.push("together");
    let percent = |relative: f64| text(fixed(100.0 * relative, 2));
    let row = |RunSample { sample, budget, .. }: &RunSample| {
        let mut row = vec![text(&data.samples()[*sample].name)];
        row.extend(Part::ALL.map(|part| percent(budget.of(part))));
        row.push(percent(budget.total()));
        row
    };
    let rows: Vec<_> = stiffness.measured().map(row).collect();
    let caption = "Standard deviations of the stiffness by cause, %. Their squares add up. The sensor stands \
                   for the calibration by known samples, or for its description; the angle for what is not \
                   known of it; the sample for its variation between points.";
    html! { div.screen { (table(caption, &heads, &rows)) } }
}
