//! The maps and their data.

use rig_chart::{Category, HeatMap, Tone};

use super::{
    axis::Axis,
    judge::{Cell, Counts, others},
    path::Path,
};
use crate::files::Csv;

/// The rating of a cell of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Rating {
    Right,
    Refused,
    SometimesWrong,
    MostlyWrong,
    NotMeasured,
}

impl Rating {
    const ALL: [Self; 5] =
        [Self::Right, Self::Refused, Self::SometimesWrong, Self::MostlyWrong, Self::NotMeasured];

    fn of(counts: &Counts) -> Self {
        let wrong = counts.share(counts.wrong);
        if counts.sweeps() == 0 {
            Self::NotMeasured
        } else if wrong > 0.5 {
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
            Self::NotMeasured => ("not measured", Tone::None, ""),
        };
        Category { name: name.to_owned(), tone, symbol: symbol.to_owned() }
    }
}

/// The outcomes of a method at each value at which the axis was measured.
type Row = (&'static str, Vec<Counts>);

/// The rows of an axis: the other estimators, the production fit, the planner.
fn rows(axis: Axis, cells: &[Cell]) -> (Vec<f64>, Vec<Row>) {
    let of = |path, value: f64| {
        let is = |cell: &&Cell| (cell.axis, cell.path, cell.value) == (axis, path, value);
        cells.iter().find(is)
    };
    let has = |value: &f64| Path::ALL.into_iter().any(|path| of(path, *value).is_some());
    let values: Vec<f64> = axis.values().iter().copied().filter(has).collect();
    let row = |name, counts: &dyn Fn(f64) -> Option<Counts>| {
        (name, values.iter().map(|&value| counts(value).unwrap_or_default()).collect())
    };
    let mut rows: Vec<Row> = others()
        .enumerate()
        .map(|(index, one)| {
            row(one.name(), &|value| of(Path::Fit, value)?.others.get(index).copied())
        })
        .collect();
    for path in Path::ALL {
        rows.push(row(path.name(), &|value| Some(of(path, value)?.counts())));
    }
    rows.retain(|(_, counts)| counts.iter().any(|counts| counts.sweeps() > 0));
    (values, rows)
}

/// The map of an axis: methods over values.
pub(super) fn map(axis: Axis, cells: &[Cell]) -> HeatMap {
    let (values, rows) = rows(axis, cells);
    let cell = |counts: &Counts| {
        let rating = Rating::of(counts);
        Rating::ALL.iter().position(|one| *one == rating).expect("every rating is listed")
    };
    let is_complete = rows.iter().flat_map(|row| &row.1).all(|counts| counts.sweeps() > 0);
    let categories = if is_complete { &Rating::ALL[..4] } else { &Rating::ALL[..] };
    HeatMap {
        title: format!("Where estimators fail: {}", axis.label()),
        description:
            "Each cell shows whether the row's estimator was right in all sweeps at the column's \
            value, refused some, or was silently wrong in some; the last rows are the production \
            fit and the planner."
                .to_owned(),
        x_label: axis.label().to_owned(),
        y_label: "estimator".to_owned(),
        columns: values.iter().map(f64::to_string).collect(),
        rows: rows.iter().map(|(name, _)| (*name).to_owned()).collect(),
        categories: categories.iter().map(|one| one.category()).collect(),
        cells: rows.iter().flat_map(|(_, counts)| counts.iter().map(cell)).collect(),
    }
}

/// The table of all counts.
pub(super) fn table(cells: &[Cell]) -> String {
    let mut table =
        Csv::new(&["axis", "value", "estimator", "sweeps", "right", "refused", "silently_wrong"]);
    for axis in Axis::ALL {
        let (values, rows) = rows(axis, cells);
        for (place, value) in values.iter().enumerate() {
            for (name, counts) in &rows {
                let counts = counts[place];
                if counts.sweeps() > 0 {
                    table.row([
                        axis.file().to_owned(),
                        value.to_string(),
                        (*name).to_owned(),
                        counts.sweeps().to_string(),
                        counts.right.to_string(),
                        counts.refused.to_string(),
                        counts.wrong.to_string(),
                    ]);
                }
            }
        }
    }
    table.text().to_owned()
}
