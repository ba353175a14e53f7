//! The error of the production fit over the bound, with noise as the only disturbance.

use rig_chart::{Axis, Chart, Rule, Series};

use super::{
    case::{Case, NOISES},
    method::Method,
    trial::{self, Group},
};
use crate::{analyzer::WINDOW, bound::Information, files::Csv, progress};

/// The sweep for the accuracy.
const SWEEP: Method = Method::Steady { points: 101 };
/// Smallest figure of merit: below it the impedance shows nearly no resonance.
pub(super) const MERIT_MIN: f64 = 0.2;
/// Largest bound in linewidths: above it many sweeps are refused as too noisy.
const SIGMA_MAX_LINEWIDTHS: f64 = 0.08;
/// Smallest share of accepted sweeps for a meaningful error, because refused sweeps are not average
/// ones.
pub(super) const ANSWERS_MIN: f64 = 0.99;

/// The eighteen cases of the charts.
pub(super) fn of_charts(trials: u32, seed: u64) -> Vec<Group> {
    measure(&Case::all(), trials, seed)
}

/// A wider range of cases, from very low to high figures of merit and from very little noise to
/// much.
pub(super) fn of_map(trials: u32, seed: u64) -> Vec<Group> {
    let mut cases = Vec::new();
    for noise in [1e-4, 1e-3, 5e-3, 0.02, 0.05] {
        for q in [5.0, 10.0, 20.0, 50.0, 100.0] {
            for coupling in [0.005, 0.02, 0.05, 0.1, 0.2] {
                let case = Case { q, coupling, noise };
                if counts(&case) {
                    cases.push(case);
                }
            }
        }
    }
    measure(&cases, trials, seed)
}

fn measure(cases: &[Case], trials: u32, seed: u64) -> Vec<Group> {
    let bar = progress::bar(cases.len(), "cases for accuracy");
    let one = |case: &Case| {
        let groups = trial::run(*case, SWEEP, trials, seed);
        bar.inc(1);
        groups
    };
    let groups = cases.iter().flat_map(one).collect();
    bar.finish_and_clear();
    groups
}

/// Error over bound; `None` for too few accepted sweeps.
pub(super) fn ratio(group: &Group) -> Option<f64> {
    let answered = group.answers() as f64 / group.trials.len() as f64;
    (answered >= ANSWERS_MIN).then_some(())?;
    Some(group.rmse_hz()? / group.bound_hz()?)
}

/// Whether the case has enough resonance, and little enough noise for a meaningful bound.
fn counts(case: &Case) -> bool {
    let middle = case.middle();
    let points = WINDOW.evenly(101, 0.0, 10);
    let bound = case.noise * Information::settled(&middle, &points).relative_bound();
    middle.figure_of_merit() >= MERIT_MIN && bound * case.q < SIGMA_MAX_LINEWIDTHS
}

pub(super) fn table(groups: &[Group]) -> String {
    let mut table = Csv::new(&[
        "q",
        "k_eff_squared",
        "figure_of_merit",
        "noise_percent",
        "sweeps",
        "answers",
        "bias_hz",
        "rmse_hz",
        "bound_hz",
        "rmse_over_bound",
        "worst_sigmas",
    ]);
    let number = |value: Option<f64>, places: usize| {
        value.map_or_else(String::new, |value| format!("{value:.places$}"))
    };
    for group in groups {
        let Case { q, coupling, noise } = group.case;
        table.row([
            q.to_string(),
            coupling.to_string(),
            format!("{:.3}", group.case.middle().figure_of_merit()),
            (100.0 * noise).to_string(),
            group.trials.len().to_string(),
            group.answers().to_string(),
            number(group.bias_hz(), 6),
            number(group.rmse_hz(), 6),
            number(group.bound_hz(), 6),
            number(ratio(group), 3),
            number(group.worst_sigmas(), 2),
        ]);
    }
    table.text().to_owned()
}

pub(super) fn chart(groups: &[Group]) -> Chart {
    let mut chart = Chart::new(
        "Error over the Cramér–Rao bound, 101 points",
        "Root mean square error of the maximum likelihood fit over the Cramér–Rao bound in the \
         eighteen cases, against the figure of merit.",
        Axis::log("figure of merit Q·C1/C0"),
        Axis::linear("error over bound").including(0.9).including(1.1),
    );
    chart.rules.push(Rule::AtY { value: 1.05, label: "goal".to_owned() });
    for (colour, noise) in NOISES.into_iter().enumerate() {
        let of_noise = groups.iter().filter(|group| group.case.noise == noise);
        let points: Vec<(f64, f64)> = of_noise
            .filter_map(|group| Some((group.case.middle().figure_of_merit(), ratio(group)?)))
            .collect();
        if !points.is_empty() {
            let name = format!("noise {} %", 100.0 * noise);
            chart.series.push(Series::scatter(&name, colour, points));
        }
    }
    chart
}
