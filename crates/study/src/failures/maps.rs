//! The maps, and the table behind them.

use rig_chart::{Category, HeatMap, Tone};
use rig_resonance::Estimator;

use super::{
    axis::Axis,
    judge::{Counts, Place},
};
use crate::files::Csv;

/// What a cell of a map is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Cell {
    Right,
    Flagged,
    SometimesWrong,
    MostlyWrong,
}

impl Cell {
    const ALL: [Self; 4] = [Self::Right, Self::Flagged, Self::SometimesWrong, Self::MostlyWrong];

    fn of(counts: &Counts) -> Self {
        let wrong = counts.share(counts.wrong);
        if wrong > 0.5 {
            Self::MostlyWrong
        } else if counts.wrong > 0 {
            Self::SometimesWrong
        } else if counts.flagged > 0 {
            Self::Flagged
        } else {
            Self::Right
        }
    }

    fn category(self) -> Category {
        let (name, tone, symbol) = match self {
            Self::Right => ("all right", Tone::Good, ""),
            Self::Flagged => ("right or flagged", Tone::Fair, "–"),
            Self::SometimesWrong => ("some silently wrong", Tone::Bad, "×"),
            Self::MostlyWrong => ("most silently wrong", Tone::Bad, "××"),
        };
        Category { name: name.to_owned(), tone, symbol: symbol.to_owned() }
    }
}

/// The map of an axis: estimators by values.
pub(super) fn map(axis: Axis, places: &[Place]) -> HeatMap {
    let places: Vec<&Place> = places.iter().filter(|place| place.axis == axis).collect();
    let cell = |estimator: usize, place: &Place| {
        let cell = Cell::of(&place.counts[estimator]);
        Cell::ALL.iter().position(|one| *one == cell).expect("every cell is listed")
    };
    HeatMap {
        title: format!("Where estimators fail: {}", axis.label()),
        description: "Each cell says whether all sweeps at the column's value were read right, or \
                      flagged, or some of them silently wrong, by the row's estimator; the last \
                      row is the production fit."
            .to_owned(),
        x_label: axis.label().to_owned(),
        y_label: "estimator".to_owned(),
        columns: places.iter().map(|place| place.value.to_string()).collect(),
        rows: Estimator::ALL.map(|estimator| estimator.name().to_owned()).to_vec(),
        categories: Cell::ALL.map(Cell::category).to_vec(),
        cells: (0..Estimator::ALL.len())
            .flat_map(|row| places.iter().map(move |place| cell(row, place)))
            .collect(),
    }
}

/// Every count.
pub(super) fn table(places: &[Place]) -> String {
    let mut table =
        Csv::new(&["axis", "value", "estimator", "sweeps", "right", "flagged", "silently_wrong"]);
    for place in places {
        for (estimator, counts) in Estimator::ALL.into_iter().zip(&place.counts) {
            table.row([
                place.axis.file().to_owned(),
                place.value.to_string(),
                estimator.name().to_owned(),
                counts.sweeps().to_string(),
                counts.right.to_string(),
                counts.flagged.to_string(),
                counts.wrong.to_string(),
            ]);
        }
    }
    table.text().to_owned()
}
