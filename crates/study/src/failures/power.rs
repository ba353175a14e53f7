//! The power of what notices that something is wrong: how often, against how wrong it is.

use rig_chart::{Chart, Series};
use rig_resonance::Estimator;

use super::{
    axis::Axis,
    judge::{Place, Told},
};
use crate::files::Csv;

/// How often the production fit sees what is wrong, against how wrong it is.
pub(super) struct Power {
    pub(super) value: f64,
    /// Shares of all sweeps, in percent: what is wrong was named, or taken into the model.
    pub(super) named: f64,
    pub(super) modelled: f64,
    /// Refused for another reason.
    pub(super) refused: f64,
    /// Two results that should be the same were not: up and down, or at two levels.
    pub(super) apart: f64,
    pub(super) wrong: f64,
    /// The largest error of an answer, in its own standard deviations.
    pub(super) worst_sigmas: Option<f64>,
}

impl Power {
    pub(super) fn of(place: &Place) -> Self {
        let axis = place.axis;
        let share = |is: &dyn Fn(&Told) -> bool| {
            let count = place.told.iter().filter(|told| is(told)).count();
            100.0 * count as f64 / place.told.len().max(1) as f64
        };
        let is_named = |told: &Told| told.reason.is_some_and(|reason| axis.is_named_by(&reason));
        let wrong = place.counts[Estimator::ALL.len() - 1];
        Self {
            value: place.value,
            named: share(&is_named),
            modelled: share(&|told| told.rung.is_some_and(|rung| axis.is_modelled_by(rung))),
            refused: share(&|told| told.reason.is_some() && !is_named(told)),
            apart: share(&|told| told.is_apart == Some(true)),
            wrong: 100.0 * wrong.share(wrong.wrong),
            worst_sigmas: place.told.iter().filter_map(|told| told.sigmas).max_by(f64::total_cmp),
        }
    }
}

/// The power of the production fit's detectors.
pub(super) fn table(places: &[Place]) -> String {
    let mut table = Csv::new(&[
        "axis",
        "value",
        "sweeps",
        "named_percent",
        "modelled_percent",
        "refused_otherwise_percent",
        "two_results_apart_percent",
        "silently_wrong_percent",
        "worst_sigmas",
    ]);
    for place in places {
        let power = Power::of(place);
        let Power { named, modelled, refused, apart, wrong, .. } = power;
        let shares = [named, modelled, refused, apart, wrong];
        let worst = power.worst_sigmas.map_or_else(String::new, |sigmas| format!("{sigmas:.2}"));
        table.row(
            [place.axis.file().to_owned(), power.value.to_string(), place.told.len().to_string()]
                .into_iter()
                .chain(shares.map(|share| format!("{share:.2}")))
                .chain([worst]),
        );
    }
    table.text().to_owned()
}

/// One of the shares of a [`Power`].
type Share = fn(&Power) -> f64;

/// The detector's power along an axis; nothing on an axis without one.
pub(super) fn chart(axis: Axis, places: &[Place]) -> Option<Chart> {
    let powers: Vec<Power> =
        places.iter().filter(|place| place.axis == axis).map(Power::of).collect();
    if powers.iter().all(|power| power.named + power.modelled + power.wrong == 0.0) {
        return None;
    }
    let (x, powers) = if axis.is_linear() {
        (rig_chart::Axis::linear(axis.label()), powers)
    } else {
        // Where nothing is wrong has no place on a logarithmic axis.
        let wrong = powers.into_iter().filter(|power| power.value > 0.0).collect();
        (rig_chart::Axis::log(axis.label()), wrong)
    };
    let mut chart = Chart::new(
        &format!("What the production fit sees: {}", axis.label()),
        "Shares of the sweeps in which the cause was named in a refusal, was taken into the model, \
         in which another reason was given, and which were silently wrong.",
        x,
        rig_chart::Axis::linear("share of the sweeps (%)").with_range(0.0, 100.0),
    );
    let curves: [(&str, Share); 5] = [
        ("named", |power| power.named),
        ("in the model", |power| power.modelled),
        ("refused otherwise", |power| power.refused),
        ("silently wrong", |power| power.wrong),
        ("two results apart", |power| power.apart),
    ];
    for (colour, (name, of)) in curves.into_iter().enumerate() {
        if powers.iter().any(|power| of(power) > 0.0) {
            let points = powers.iter().map(|power| (power.value, of(power)));
            chart.series.push(Series::joined(name, colour, points));
        }
    }
    Some(chart)
}
