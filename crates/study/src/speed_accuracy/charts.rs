//! Charts of measuring time against error.

use rig_chart::{Axis, Chart, Marker, Series, Stroke};

use super::{
    case::Case,
    estimator::SweepEstimator,
    method::{LIMIT_S, Method},
    trial::Group,
};
use crate::{analyzer::WINDOW, bound::integration_floor};

/// Smallest share of accepted sweeps for a point on the chart.
const ANSWERS_MIN: f64 = 0.5;

/// Measuring time against error in one case.
pub(super) fn time_against_error(case: &Case, groups: &[Group]) -> Chart {
    let mut chart = Chart::new(
        &format!("Measuring time against error: {case}"),
        "Root mean square error of the resonance, including bias, against the duration of the \
         sweep; dashed in the same colour the Cramér–Rao bound of the same sweeps, and the bound \
         of integration at the best frequencies without waiting. Targets that the planner refuses \
         are marked at their value.",
        Axis::log("measuring time (s)"),
        Axis::log("error (Hz rms)"),
    );
    chart.size_px = (720, 460);
    let of_case = || groups.iter().filter(|group| group.case == *case);
    let is_of = |group: &Group, name: &str, estimator: SweepEstimator| {
        group.method.name() == name && group.estimator == estimator
    };
    for (colour, name) in METHODS.into_iter().enumerate() {
        let of_method = || of_case().filter(|group| is_of(group, name, SweepEstimator::Production));
        let results = of_method().filter_map(|group| point(group, Group::rmse_hz));
        push(&mut chart, Series::joined(name, colour, results));
        let bounds = of_method().filter_map(|group| point(group, Group::bound_hz));
        let bounds = Series::line(&format!("{name}: bound"), colour, bounds);
        push(&mut chart, Series { stroke: Some(Stroke::Dashed), ..bounds });
    }
    let refused = of_case().filter_map(refused_target);
    let refused = Series::scatter("refused target", PLANNER, refused);
    push(&mut chart, Series { marker: Some(Marker::Cross), ..refused });
    for (index, estimator) in SweepEstimator::SHOWN.into_iter().enumerate() {
        let even = of_case().filter(|group| is_of(group, METHODS[0], estimator));
        let results = even.filter_map(|group| point(group, Group::rmse_hz));
        let name = format!("uniform, {}", estimator.name());
        push(&mut chart, Series::scatter(&name, METHODS.len() + index, results));
    }
    let floor = Series::line("integration alone", 6, floor(case));
    push(&mut chart, Series { stroke: Some(Stroke::Dashed), ..floor });
    chart
}

/// The kinds of methods, in the order of their colours.
const METHODS: [&str; 3] = [
    Method::Even { points: 0 }.name(),
    Method::Fast { points: 0, cycles: 0 }.name(),
    Method::Decay { target_hz: 0.0 }.name(),
];

/// Index of the planner among them.
const PLANNER: usize = 2;

/// Adds a series unless it is empty.
fn push(chart: &mut Chart, series: Series) {
    if !series.points.is_empty() {
        chart.series.push(series);
    }
}

/// The time and the target of a planner that refuses most sweeps.
fn refused_target(group: &Group) -> Option<(f64, f64)> {
    match group.method {
        Method::Decay { target_hz } if !is_answered(group) => Some((group.time_s(0.5), target_hz)),
        _ => None,
    }
}

fn is_answered(group: &Group) -> bool {
    group.answers() as f64 >= ANSWERS_MIN * group.trials.len() as f64
}

fn point(group: &Group, error_hz: impl Fn(&Group) -> Option<f64>) -> Option<(f64, f64)> {
    is_answered(group).then_some(())?;
    Some((group.time_s(0.5), error_hz(group)?))
}

/// The bound of integration alone over the planners' times.
fn floor(case: &Case) -> Vec<(f64, f64)> {
    [0.05, LIMIT_S].map(|time_s| (time_s, floor_hz(case, time_s))).to_vec()
}

/// The bound for integration at the best frequencies without waiting, Hz.
fn floor_hz(case: &Case, time_s: f64) -> f64 {
    let frequencies: Vec<f64> = (0..=280).map(|i| WINDOW.min_hz + 0.2 * f64::from(i)).collect();
    case.noise * integration_floor(&case.middle(), &frequencies) / time_s.sqrt()
}
