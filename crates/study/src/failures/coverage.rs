//! Whether accepted results have the errors that they state, and the time that planned ones take.

use super::{
    axis::Axis,
    judge::{Cell, SweepResult},
    path::Path,
};
use rig_analysis::score::wilson_95;

use crate::{files::Csv, page::Table};

/// Half of a 95 % interval in standard deviations.
const INTERVAL_SIGMAS: f64 = 1.96;

/// Statistics of sweeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Statistics {
    pub(super) sweeps: usize,
    pub(super) accepted: usize,
    /// Accepted results with a true resonance: their error in own standard deviations.
    sigmas: Spread,
    /// Number of these results, and of those whose 95 % interval contains the truth.
    errors: u32,
    inside: u32,
    /// Share of the 95 % intervals that contain the truth, %.
    pub(super) coverage: f64,
    /// Time of the accepted sweeps, s.
    accepted_s: Spread,
    /// Time of the sweeps that were refused after a survey, s.
    refused_s: Spread,
    /// Planned sweeps that did not begin because their survey was refused.
    without_survey: usize,
}

/// Mean, median, and the values that 95 and 99 % do not exceed; NaN without values.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Spread {
    mean: f64,
    median: f64,
    at_95: f64,
    at_99: f64,
}

impl Spread {
    fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let at = |share: f64| {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a share of a count of values"
            )]
            let place = (share * values.len() as f64).ceil() as usize;
            values.get(place.max(1) - 1).copied().unwrap_or(f64::NAN)
        };
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        Self { mean, median: at(0.5), at_95: at(0.95), at_99: at(0.99) }
    }
}

impl Statistics {
    /// Of the accepted sweeps mean, median and the time that 95 % do not exceed, and the mean of the refused, s.
    const fn times_s(&self) -> [f64; 4] {
        let Self { accepted_s: Spread { mean, median, at_95, .. }, refused_s, .. } = *self;
        [mean, median, at_95, refused_s.mean]
    }

    pub(super) fn of<'a>(results: impl Iterator<Item = &'a SweepResult>) -> Self {
        let results: Vec<&SweepResult> = results.collect();
        let sigmas: Vec<f64> = results
            .iter()
            .filter_map(|result| result.sigmas().filter(|sigmas| sigmas.is_finite()))
            .collect();
        let count = |of: usize| u32::try_from(of).unwrap_or(u32::MAX);
        let inside = sigmas.iter().filter(|sigmas| **sigmas < INTERVAL_SIGMAS).count();
        let times_s = |is_accepted: bool| {
            let of = results.iter().filter(|result| result.found.is_some() == is_accepted);
            Spread::of(of.filter_map(|result| result.time_s).collect())
        };
        Self {
            sweeps: results.len(),
            accepted: results.iter().filter(|result| result.found.is_some()).count(),
            errors: count(sigmas.len()),
            inside: count(inside),
            coverage: 100.0 * inside as f64 / sigmas.len() as f64,
            sigmas: Spread::of(sigmas),
            accepted_s: times_s(true),
            refused_s: times_s(false),
            without_survey: results.iter().filter(|result| result.time_s.is_none()).count(),
        }
    }
}

/// A number with this many decimals; nothing for NaN.
fn number(value: f64, decimals: usize) -> String {
    if value.is_nan() { String::new() } else { format!("{value:.decimals$}") }
}

/// The statistics of a path on each axis.
pub(super) fn on_page(path: Path, cells: &[Cell]) -> Table {
    let mut columns = vec![
        "axis",
        "sweeps",
        "accepted",
        "silently wrong",
        "error/σ: mean",
        "median",
        "99 %",
        "in the 95 % interval",
        "lowest at one value",
    ];
    if path.is_planned() {
        columns.extend([
            "accepted, s: mean",
            "median",
            "95 %",
            "refused, s: mean",
            "survey refused",
        ]);
    }
    let mut table = Table::new(&columns);
    for axis in Axis::ALL.into_iter().filter(|axis| path.has(*axis)) {
        let of = || cells.iter().filter(|cell| (cell.axis, cell.path) == (axis, path));
        let all = Statistics::of(of().flat_map(|cell| &cell.results));
        if all.sweeps == 0 {
            continue;
        }
        let wrong: u32 = of().map(|cell| cell.counts().wrong).sum();
        let share = |of: usize| format!("{:.1} %", 100.0 * of as f64 / all.sweeps as f64);
        let mut row = vec![
            format!("`{}`", axis.file()),
            all.sweeps.to_string(),
            share(all.accepted),
            wrong.to_string(),
            number(all.sigmas.mean, 2),
            number(all.sigmas.median, 2),
            number(all.sigmas.at_99, 2),
            number(all.coverage, 1),
            least(of()),
        ];
        if path.is_planned() {
            row.extend(all.times_s().map(|seconds| number(seconds, 2)));
            row.push(share(all.without_survey));
        }
        table.row(row);
    }
    table
}

/// The share of 95 % intervals with the truth at the value at which it is certainly lowest: that with the lowest upper end of
/// its own 95 % interval.
fn least<'a>(cells: impl Iterator<Item = &'a Cell>) -> String {
    let of = |cell: &Cell| {
        let Statistics { inside, errors, .. } = Statistics::of(cell.results.iter());
        (errors > 0).then(|| (cell.value, inside, errors, wilson_95(inside, errors)))
    };
    let least = cells.filter_map(of).min_by(|one, other| one.3.1.total_cmp(&other.3.1));
    least.map_or_else(String::new, |(value, inside, errors, (low, high))| {
        let [low, high] = [low, high].map(|share| 100.0 * share);
        format!("{inside} of {errors} ({low:.0} to {high:.0} %; at {value})")
    })
}

/// The statistics at each point of each axis.
pub(super) fn table(cells: &[Cell]) -> String {
    let mut table = Csv::new(&[
        "axis",
        "value",
        "path",
        "sweeps",
        "accepted",
        "silently_wrong",
        "mean_sigmas",
        "median_sigmas",
        "99_percent_sigmas",
        "coverage_percent",
        "accepted_mean_s",
        "accepted_median_s",
        "accepted_95_percent_s",
        "refused_mean_s",
        "survey_refused",
    ]);
    for cell in cells {
        let all = Statistics::of(cell.results.iter());
        let of_plan = |text: String| if cell.path.is_planned() { text } else { String::new() };
        let times = all.times_s().map(|seconds| of_plan(number(seconds, 3)));
        let counts = [all.sweeps, all.accepted, cell.counts().wrong as usize];
        let row =
            [cell.axis.file().to_owned(), cell.value.to_string(), cell.path.name().to_owned()];
        let sigmas =
            [all.sigmas.mean, all.sigmas.median, all.sigmas.at_99].map(|value| number(value, 3));
        let coverage = [number(all.coverage, 2)];
        let row = row.into_iter().chain(counts.map(|count| count.to_string()));
        let without_survey = of_plan(all.without_survey.to_string());
        table.row(row.chain(sigmas).chain(coverage).chain(times).chain([without_survey]));
    }
    table.text().to_owned()
}

/// Every silently wrong sweep.
pub(super) fn wrong(cells: &[Cell]) -> String {
    let mut table = Csv::new(&[
        "axis",
        "value",
        "path",
        "q",
        "k_eff_squared",
        "seed",
        "trial",
        "resonance_hz",
        "sigma_hz",
        "true_hz",
        "sigmas",
        "model_order",
    ]);
    for cell in cells {
        for result in &cell.results {
            let (super::judge::Outcome::SilentlyWrong, Some(found)) =
                (result.outcome, &result.found)
            else {
                continue;
            };
            let (q, coupling) = super::axis::SENSORS[result.id.sensor];
            table.row([
                cell.axis.file().to_owned(),
                cell.value.to_string(),
                cell.path.name().to_owned(),
                q.to_string(),
                coupling.to_string(),
                result.id.seed.to_string(),
                result.id.trial.to_string(),
                format!("{:.5}", found.resonance_hz),
                format!("{:.5}", found.sigma_hz),
                result.truth_hz.map_or_else(String::new, |hz| format!("{hz:.5}")),
                result.sigmas().map_or_else(String::new, |sigmas| format!("{sigmas:.1}")),
                found.model_order.to_string(),
            ]);
        }
    }
    table.text().to_owned()
}
