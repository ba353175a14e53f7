//! The maps and their data.

use rig_chart::{Category, HeatMap, Tone};
use rig_resonance::Estimator;

use super::{
    axis::Axis,
    judge::{AxisPoint, Counts},
};
use crate::files::Csv;

/// The rating of a cell of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Rating {
    Right,
    Refused,
    SometimesWrong,
    MostlyWrong,
}

impl Rating {
    const ALL: [Self; 4] = [Self::Right, Self::Refused, Self::SometimesWrong, Self::MostlyWrong];

    fn of(counts: &Counts) -> Self {
        let wrong = counts.share(counts.wrong);
        if wrong > 0.5 {
            Self::MostlyWrong
        } else if counts.wrong > 0 {
            Self::SometimesWrong
        } else if counts.refused > 0 {
            Self::Refused
        } else {
            Self::Right
        }
    }

    fn category(self) -> Category {
        let (name, tone, symbol) = match self {
            Self::Right => ("all right", Tone::Good, ""),
            Self::Refused => ("right or refused", Tone::Fair, "–"),
            Self::SometimesWrong => ("some silently wrong", Tone::Bad, "×"),
            Self::MostlyWrong => ("most silently wrong", Tone::Bad, "××"),
        };
        Category { name: name.to_owned(), tone, symbol: symbol.to_owned() }
    }
}

/// The map of an axis: estimators over values.
pub(super) fn map(axis: Axis, points: &[AxisPoint]) -> HeatMap {
    let points: Vec<&AxisPoint> = points.iter().filter(|point| point.axis == axis).collect();
    let cell = |estimator: usize, point: &AxisPoint| {
        let cell = Rating::of(&point.counts[estimator]);
        Rating::ALL.iter().position(|one| *one == cell).expect("every cell is listed")
    };
    HeatMap {
        title: format!("Where estimators fail: {}", axis.label()),
        description:
            "Each cell shows whether the row's estimator was right in all sweeps at the column's \
            value, refused some, or was silently wrong in some; the last row is the production \
            fit."
                .to_owned(),
        x_label: axis.label().to_owned(),
        y_label: "estimator".to_owned(),
        columns: points.iter().map(|point| point.value.to_string()).collect(),
        rows: Estimator::ALL.map(|estimator| estimator.name().to_owned()).to_vec(),
        categories: Rating::ALL.map(Rating::category).to_vec(),
        cells: (0..Estimator::ALL.len())
            .flat_map(|row| points.iter().map(move |point| cell(row, point)))
            .collect(),
    }
}

/// The table of all counts.
pub(super) fn table(points: &[AxisPoint]) -> String {
    let mut table =
        Csv::new(&["axis", "value", "estimator", "sweeps", "right", "refused", "silently_wrong"]);
    for point in points {
        for (estimator, counts) in Estimator::ALL.into_iter().zip(&point.counts) {
            table.row([
                point.axis.file().to_owned(),
                point.value.to_string(),
                estimator.name().to_owned(),
                counts.sweeps().to_string(),
                counts.right.to_string(),
                counts.refused.to_string(),
                counts.wrong.to_string(),
            ]);
        }
    }
    table.text().to_owned()
}
