//! The part of the page that the gate computes again.

use std::{fs, io::Write, path::Path as FilePath};

use super::{
    axis::Axis,
    judge::{Cell, Counts},
    judge_all,
};
use crate::{files::Csv, outcome::StudyError};

/// The seeds that are computed again: the first of the page.
const SEEDS: u64 = 1;
/// The sweeps of each sensor, seed and point that are computed again: fitted and planned.
const TRIALS: u32 = 2;
const PLANNED: u32 = 1;

/// The file in the folder of the page.
pub(super) const FILE: &str = "gate.csv";

/// The fits do not give what the page says.
#[derive(Debug, thiserror::Error)]
#[error(
    "{}: {differing} of {rows} rows differ from what the fits give now, the first one \"{first}\": write the \
     page again", path.display()
)]
struct Differs {
    path: std::path::PathBuf,
    differing: usize,
    rows: usize,
    first: String,
}

/// The outcomes of the first sweeps of the first seed.
pub(super) fn table(cells: &[Cell], first_seed: u64) -> String {
    let mut table =
        Csv::new(&["axis", "value", "path", "sweeps", "right", "refused", "silently_wrong"]);
    for cell in cells {
        let trials = match cell.path {
            super::Path::Fit => TRIALS,
            super::Path::Planner | super::Path::Unsurveyed => PLANNED,
        };
        let is_here = |id: &super::judge::SweepId| {
            id.trial < trials && (first_seed..first_seed + SEEDS).contains(&id.seed)
        };
        let here = cell.results.iter().filter(|result| is_here(&result.id));
        let counts = Counts::of(here.map(|result| result.outcome));
        let row =
            [cell.axis.file().to_owned(), cell.value.to_string(), cell.path.name().to_owned()];
        let numbers = [counts.sweeps(), counts.right, counts.refused, counts.wrong];
        table.row(row.into_iter().chain(numbers.map(|number| number.to_string())));
    }
    table.text().to_owned()
}

/// Compares the outcomes with those beside the page.
pub(super) fn check(
    folder: &FilePath,
    first_seed: u64,
    out: &mut impl Write,
) -> Result<(), StudyError> {
    let path = folder.join(FILE);
    let stored = fs::read_to_string(&path)
        .map_err(|source| StudyError::File { path: path.clone(), source })?;
    let cells = judge_all(&Axis::ALL, TRIALS, PLANNED, first_seed..first_seed + SEEDS);
    compare(&path, &stored, &table(&cells, first_seed), out)
}

/// Names every row that differs.
fn compare(
    path: &FilePath,
    stored: &str,
    computed: &str,
    out: &mut impl Write,
) -> Result<(), StudyError> {
    let rows = computed.lines().count().max(stored.lines().count());
    let lines = |text: &str| -> Vec<String> {
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        lines.resize(rows, String::new());
        lines
    };
    let (stored, computed) = (lines(stored), lines(computed));
    let differing: Vec<(&String, &String)> =
        stored.iter().zip(&computed).filter(|(stored, computed)| stored != computed).collect();
    for (stored, computed) in &differing {
        writeln!(out, "{stored} is now {computed}")?;
    }
    match differing.first() {
        None => Ok(writeln!(out, "{}: {rows} rows are as before", path.display())?),
        Some((first, _)) => Err(StudyError::refused(Differs {
            path: path.to_owned(),
            differing: differing.len(),
            rows,
            first: (*first).clone(),
        })),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_that_differs_is_named_with_both_values() {
        let stored = "axis,value\nnoise,1\nnoise,2\n";
        let compare = |computed: &str| {
            let mut out = Vec::new();
            let result = compare(FilePath::new("gate.csv"), stored, computed, &mut out);
            (result.map_err(|error| rig_model::with_causes(&error)), out)
        };
        assert!(compare(stored).0.is_ok());
        let (result, out) = compare("axis,value\nnoise,1\nnoise,3\n");
        let message = result.unwrap_err();
        assert!(message.contains("1 of 3 rows") && message.contains("\"noise,2\""), "{message}");
        assert_eq!(out, b"noise,2 is now noise,3\n");
        assert!(compare("axis,value\nnoise,1\n").0.is_err());
        assert!(compare(&format!("{stored}noise,3\n")).0.is_err());
    }
}
