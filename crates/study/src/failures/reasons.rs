//! The reasons that refused sweeps state, so that a wrong cause shows.

use super::{
    axis::Axis,
    judge::{Cell, StatedReason},
    path::Path,
};
use crate::{files::Csv, page::Table};

/// The reasons of the refused sweeps of a path on an axis.
fn refused(axis: Axis, path: Path, cells: &[Cell]) -> impl Iterator<Item = &StatedReason> {
    cells.iter().filter(move |cell| (cell.axis, cell.path) == (axis, path)).flat_map(reasons)
}

/// The reasons of the refused sweeps at a point.
fn reasons(cell: &Cell) -> impl Iterator<Item = &StatedReason> {
    cell.results.iter().filter_map(|result| result.reason.as_ref())
}

/// The codes of all reasons that a path states, the most frequent first.
fn codes(path: Path, cells: &[Cell]) -> Vec<&str> {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for reason in Axis::ALL.into_iter().flat_map(|axis| refused(axis, path, cells)) {
        let code = &*reason.code;
        match counts.iter_mut().find(|(one, _)| *one == code) {
            Some((_, count)) => *count += 1,
            None => counts.push((code, 1)),
        }
    }
    counts.sort_by_key(|&(code, count)| (usize::MAX - count, code));
    counts.into_iter().map(|(code, _)| code).collect()
}

/// Axes over reasons, in percent of the refused sweeps. A reason that names the cause of its axis is bold.
pub(super) fn on_page(path: Path, cells: &[Cell]) -> Table {
    let codes = codes(path, cells);
    let mut columns = vec!["axis", "refused", "another cause"];
    columns.extend(&codes);
    let mut table = Table::new(&columns);
    for axis in Axis::ALL {
        let all = refused(axis, path, cells).count();
        if all == 0 {
            continue;
        }
        let share = |count: usize| 100.0 * count as f64 / all as f64;
        let other = refused(axis, path, cells)
            .filter(|reason| reason.claims_a_cause && !reason.is_named)
            .count();
        let cell = |code: &&str| {
            let mut of =
                refused(axis, path, cells).filter(|reason| reason.code == *code).peekable();
            let Some(reason) = of.peek().copied() else { return String::new() };
            let share = share(of.count());
            if reason.is_named { format!("**{share:.1}**") } else { format!("{share:.1}") }
        };
        let row = [format!("`{}`", axis.file()), all.to_string(), format!("{:.1} %", share(other))];
        table.row(row.into_iter().chain(codes.iter().map(cell)));
    }
    table
}

/// The reasons at each point of each axis, in long form.
pub(super) fn table(cells: &[Cell]) -> String {
    let mut table = Csv::new(&["axis", "value", "path", "reason", "names_the_cause", "sweeps"]);
    for cell in cells {
        for code in codes(cell.path, std::slice::from_ref(cell)) {
            let mut of = reasons(cell).filter(|reason| reason.code == code).peekable();
            let is_named = of.peek().is_some_and(|reason| reason.is_named);
            table.row([
                cell.axis.file().to_owned(),
                cell.value.to_string(),
                cell.path.name().to_owned(),
                code.to_owned(),
                is_named.to_string(),
                of.count().to_string(),
            ]);
        }
    }
    table.text().to_owned()
}
