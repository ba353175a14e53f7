//! Benches beside each other, by their reference samples.

use maud::{Markup, html};

use super::links;
use crate::{BenchChart, Deviation, Reference};

pub(super) fn body(references: &[Reference]) -> Markup {
    html! {
        h1 { "Compare benches" (links([("/", "rigs"), ("/runs", "runs")])) }
        p.quiet {
            "Samples of known stiffness, in the latest runs of each bench whose model is not rejected. s_r is the standard \
             deviation of results of one bench, s_L that of the means of benches, and s_R that of results of any bench \
             (ISO 5725-2); ± is a standard uncertainty."
        }
        @if references.is_empty() {
            p { "No judged run has a sample of known stiffness. " code { "rigd-hub judge" } " makes the results." }
        } @else { (summary(references)) }
        @for (index, reference) in references.iter().enumerate() { (charts(index, reference)) }
    }
}

fn summary(references: &[Reference]) -> Markup {
    html! {
        table {
            thead { tr {
                th { "sample" } th.number { "known" } th.number { "benches" } th.number { "results" }
                th.number { "mean" } th.number { "s_r" } th.number { "s_L" } th.number { "s_R" }
            } }
            tbody {
                @for reference in references {
                    tr {
                        td { (name(reference)) }
                        td.number { (mpa(reference.known_mpa)) }
                        td.number { (reference.charts.len()) }
                        td.number { (reference.charts.iter().map(|chart| chart.points.len()).sum::<usize>()) }
                        @if let Some(found) = &reference.reproducibility {
                            td.number { (mpa(found.mean)) }
                            td.number { (deviation(&found.repeatability)) }
                            td.number { (deviation(&found.between)) }
                            td.number { (deviation(&found.reproducibility)) }
                        } @else {
                            td.quiet colspan="4" { "needs two benches, one of them with two results" }
                        }
                    }
                }
            }
        }
    }
}

fn charts(index: usize, reference: &Reference) -> Markup {
    html! {
        h2 { (name(reference)) " " span.quiet { "known " (mpa(reference.known_mpa)) } }
        div.charts {
            @for (number, chart) in reference.charts.iter().enumerate() {
                figure {
                    (chart.panel(reference.known_mpa).drawn(&format!("fig-{index}-{number}")))
                    figcaption { (caption(chart)) }
                }
            }
        }
    }
}

fn caption(chart: &BenchChart) -> String {
    let alarms = chart.points.iter().filter(|point| point.is_alarm).count();
    match (chart.points.iter().any(|point| point.limits_mpa.is_some()), alarms) {
        (false, _) => format!("{}: too few results for limits", chart.bench),
        (true, 0) => format!("{}: no alarm", chart.bench),
        (true, 1) => format!("{}: 1 alarm", chart.bench),
        (true, alarms) => format!("{}: {alarms} alarms", chart.bench),
    }
}

fn name(reference: &Reference) -> Markup {
    html! { (reference.sample) @if reference.is_simulated { " " span.quiet { "simulated" } } }
}

/// A stiffness to four digits.
fn mpa(value: f64) -> String {
    format!("{value:.4} MPa")
}

fn deviation(found: &Deviation) -> String {
    format!("{:.4} ± {:.4} MPa", found.value, found.sigma)
}
