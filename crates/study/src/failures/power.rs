//! The detection power of the production paths: the share of detected sweeps over the size of the
//! cause.

use rig_chart::{Chart, Series};

use super::{
    axis::Axis,
    judge::{Cell, SweepResult},
    path::Path,
};
use crate::files::Csv;

/// The detection power at one point of an axis.
pub(super) struct Power {
    pub(super) value: f64,
    /// Share of sweeps whose refusal names the cause, %.
    pub(super) named: f64,
    /// Share of sweeps whose accepted model includes the cause, %.
    pub(super) modelled: f64,
    /// Share of sweeps refused for another reason, %.
    pub(super) refused: f64,
    /// Share of sweeps whose two results, up and down or at two levels, differ, %.
    pub(super) differing: f64,
    /// Share of silently wrong sweeps, %.
    pub(super) wrong: f64,
    /// Largest error of a result in its own standard deviations.
    pub(super) worst_sigmas: Option<f64>,
}

impl Power {
    pub(super) fn of(cell: &Cell) -> Self {
        let share = |is: &dyn Fn(&SweepResult) -> bool| {
            let count = cell.results.iter().filter(|result| is(result)).count();
            100.0 * count as f64 / cell.results.len().max(1) as f64
        };
        let is_named =
            |result: &SweepResult| result.reason.as_ref().is_some_and(|reason| reason.is_named);
        let wrong = cell.counts();
        Self {
            value: cell.value,
            named: share(&is_named),
            modelled: share(&|result| result.found.as_ref().is_some_and(|found| found.is_modelled)),
            refused: share(&|result| result.reason.is_some() && !is_named(result)),
            differing: share(&|result| result.differ == Some(true)),
            wrong: 100.0 * wrong.share(wrong.wrong),
            worst_sigmas: cell
                .results
                .iter()
                .filter_map(SweepResult::sigmas)
                .max_by(f64::total_cmp),
        }
    }
}

/// The table of the detection power.
pub(super) fn table(cells: &[Cell]) -> String {
    let mut table = Csv::new(&[
        "axis",
        "value",
        "path",
        "sweeps",
        "named_percent",
        "modelled_percent",
        "refused_otherwise_percent",
        "two_results_differ_percent",
        "silently_wrong_percent",
        "worst_sigmas",
    ]);
    for cell in cells {
        let power = Power::of(cell);
        let Power { named, modelled, refused, differing, wrong, .. } = power;
        let shares = [named, modelled, refused, differing, wrong];
        let worst = power.worst_sigmas.map_or_else(String::new, |sigmas| format!("{sigmas:.2}"));
        table.row(
            [
                cell.axis.file().to_owned(),
                power.value.to_string(),
                cell.path.name().to_owned(),
                cell.results.len().to_string(),
            ]
            .into_iter()
            .chain(shares.map(|share| format!("{share:.2}")))
            .chain([worst]),
        );
    }
    table.text().to_owned()
}

/// A share of a [`Power`].
type Share = fn(&Power) -> f64;

/// The detection power of a path along an axis; `None` for an axis without detection.
pub(super) fn chart(axis: Axis, path: Path, cells: &[Cell]) -> Option<Chart> {
    // A logarithmic axis cannot show zero.
    let is_shown = |power: &Power| axis.is_linear() || power.value > 0.0;
    let is_of = |cell: &&Cell| (cell.axis, cell.path) == (axis, path);
    let powers: Vec<Power> = cells.iter().filter(is_of).map(Power::of).filter(is_shown).collect();
    if powers.iter().all(|power| power.named + power.modelled + power.wrong == 0.0) {
        return None;
    }
    let scale = if axis.is_linear() { rig_chart::Axis::linear } else { rig_chart::Axis::log };
    let mut chart = Chart::new(
        &format!("Detection by {}: {}", path.name(), axis.label()),
        "Shares of the sweeps whose refusal names the cause, whose model includes it, that are \
         refused for another reason, and that are silently wrong.",
        scale(axis.label()),
        rig_chart::Axis::linear("share of the sweeps (%)").with_range(0.0, 100.0),
    );
    let curves: [(&str, Share); 5] = [
        ("named", |power| power.named),
        ("in the model", |power| power.modelled),
        ("refused otherwise", |power| power.refused),
        ("silently wrong", |power| power.wrong),
        ("two results differ", |power| power.differing),
    ];
    for (colour, (name, of)) in curves.into_iter().enumerate() {
        if powers.iter().any(|power| of(power) > 0.0) {
            let points = powers.iter().map(|power| (power.value, of(power)));
            chart.series.push(Series::joined(name, colour, points));
        }
    }
    Some(chart)
}
