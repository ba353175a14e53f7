//! The line that names the columns.

use super::{
    FaultCollector,
    cells::{CsvCell, Separator, cells},
    column_head::ColumnHead,
    fault::SweepFileFault,
    impedance::PAIRS,
    lines, location,
    number::excerpt,
    quantity::Quantity,
};
use crate::Location;

/// The header of a CSV file: a quantity for each known column.
#[derive(Debug)]
pub(super) struct Header<'a> {
    pub(super) text: &'a str,
    /// Number of the last line of the header, from 1: the row of units, if there is one.
    pub(super) line: usize,
    pub(super) separator: Separator,
    /// Largest number of cells of a row.
    pub(super) width: usize,
    /// The known columns, with one pair for the impedance.
    pub(super) columns: Vec<Column>,
    /// The two quantities of the impedance.
    pub(super) pair: Option<[Quantity; 2]>,
    /// The row of units, if there is one.
    pub(super) units: Option<&'a str>,
}

/// A known column.
#[derive(Debug)]
pub(super) struct Column {
    pub(super) index: usize,
    pub(super) location: Location,
    pub(super) head: ColumnHead,
    text: String,
}

/// Joins each unit in brackets to the name before it: `R (Ohm)` is one column between blanks too.
fn join_units(cells: &mut Vec<CsvCell<'_>>) {
    let all = std::mem::take(cells);
    for cell in all {
        match cells.last_mut() {
            Some(name) if cell.text.starts_with(['(', '[']) => {
                name.text = format!("{} {}", name.text, cell.text).into();
            }
            _ => cells.push(cell),
        }
    }
}

impl<'a> Header<'a> {
    /// The first line that names a frequency and an impedance. The lines above it are not data.
    pub(super) fn find(text: &'a str, faults: &mut FaultCollector) -> Option<Self> {
        let whole = text;
        let mut best: Option<Self> = None;
        for (line, text) in lines(text) {
            for separator in Separator::ALL {
                if separator.is_rare() && !text.contains(|character| separator.is(character)) {
                    continue;
                }
                let Some(mut header) = Self::of(text, line, separator) else { continue };
                if header.pair.is_some() && header.column(Quantity::Frequency).is_some() {
                    header.take_units(whole);
                    return header.check(faults).then_some(header);
                }
                if header.columns.len() > best.as_ref().map_or(0, |best| best.columns.len()) {
                    best = Some(header);
                }
            }
        }
        match best {
            Some(best) => {
                let location = Location { line: best.line, column: 1 };
                if best.column(Quantity::Frequency).is_none() {
                    faults.refuse(location, SweepFileFault::NoFrequency);
                }
                if best.column(Quantity::AdmittanceMagnitude).is_some()
                    && best.column(Quantity::Phase).is_some()
                {
                    faults.refuse(location, SweepFileFault::PhaseOfWhat);
                } else if best.pair.is_none() {
                    faults.refuse(location, SweepFileFault::NoImpedance);
                }
            }
            None => {
                match lines(text).find(|(_, text)| !text.trim().is_empty() && !is_comment(text)) {
                    Some((line, _)) => {
                        faults.refuse(Location { line, column: 1 }, SweepFileFault::NoHeader);
                    }
                    None => faults.refuse(Location::START, SweepFileFault::Empty),
                }
            }
        }
        None
    }

    /// The columns of this line, which may be a comment.
    fn of(text: &'a str, line: usize, separator: Separator) -> Option<Self> {
        let bare = separator.trim_start(text).trim_start_matches(['#', '!', ';']);
        // Blanks between commas belong to the names.
        if separator == Separator::Spaces && bare.contains([',', ';']) {
            return None;
        }
        let mut all = cells(bare, separator).ok()?;
        while all.last().is_some_and(|cell| cell.text.is_empty()) {
            all.pop();
        }
        if separator == Separator::Spaces {
            join_units(&mut all);
        }
        let before = text.len() - bare.len();
        let column = |(index, cell): (usize, &CsvCell<'_>)| {
            let location = location(text, line, before + cell.at);
            let head = ColumnHead::of(&cell.text)?;
            Some(Column { index, location, text: excerpt(&cell.text), head })
        };
        let mut columns: Vec<_> = all.iter().enumerate().filter_map(column).collect();
        let is_there = |quantity: &Quantity| columns.iter().any(|it| it.head.quantity == *quantity);
        let mut pairs = PAIRS.into_iter().filter(|pair| pair.iter().all(is_there));
        let each = |pair: [Quantity; 2], is: fn(&Column) -> bool| {
            columns.iter().filter(|it| pair.contains(&it.head.quantity)).all(is)
        };
        let is_clear = |it: &Column| it.head.unit.is_some() || it.text.chars().count() > 1;
        let first = pairs.next();
        // `X` without a unit may be a place, if others have units.
        let is_vague = first.is_some_and(|first| !each(first, is_clear));
        let clear = pairs.find(|pair| each(*pair, |it| it.head.unit.is_some()));
        let pair = clear.filter(|_| is_vague).or(first);
        if let Some(pair) = pair {
            let is_spare = |quantity: Quantity| {
                PAIRS.as_flattened().contains(&quantity) && !pair.contains(&quantity)
            };
            columns.retain(|column| !is_spare(column.head.quantity));
        }
        let width = all.len();
        Some(Self { text, line, separator, width, columns, pair, units: None })
    }

    /// Takes the units from the row below the header whose frequency is a unit. Between them are only comments and rules.
    fn take_units(&mut self, text: &'a str) {
        for (line, row) in lines(text).skip(self.line) {
            let bare = self.separator.trim_start(row);
            let bare = if self.separator == Separator::Semicolon {
                bare.trim_start_matches(['#', '!'])
            } else {
                bare.trim_start_matches(['#', '!', ';'])
            };
            let Ok(cells) = cells(bare, self.separator) else { return };
            let cell = |column: &Column| cells.get(column.index).map_or("", |cell| &cell.text);
            let frequency = self.column(Quantity::Frequency);
            if frequency.is_some_and(|column| column.head.is_unit(cell(column))) {
                for column in &mut self.columns {
                    column.head.take_unit(cell(column));
                }
                (self.line, self.units) = (line, Some(row));
                return;
            }
            if !is_comment(row) && row.chars().any(char::is_alphanumeric) {
                return;
            }
        }
    }

    /// Whether this line names the columns of another table with a frequency and an impedance.
    pub(super) fn is_another(&self, text: &'a str) -> bool {
        let other = Self::of(text, 0, self.separator);
        other.is_some_and(|it| it.pair.is_some() && it.column(Quantity::Frequency).is_some())
    }

    pub(super) fn column(&self, quantity: Quantity) -> Option<&Column> {
        self.columns.iter().find(|column| column.head.quantity == quantity)
    }

    /// Whether no column is repeated and every unit is known.
    fn check(&self, faults: &mut FaultCollector) -> bool {
        for (index, column) in self.columns.iter().enumerate() {
            let ColumnHead { quantity, factor, ref unit } = column.head;
            if self.columns[..index].iter().any(|other| other.head.quantity == quantity) {
                let header = column.text.clone();
                faults.refuse(column.location, SweepFileFault::RepeatedColumn { header, quantity });
            }
            if factor.is_none() {
                let unit = excerpt(unit.as_deref().unwrap_or_default());
                faults.refuse(column.location, SweepFileFault::UnknownUnit { unit, quantity });
            }
        }
        faults.is_empty()
    }
}

/// Whether a line is a comment.
pub(super) fn is_comment(line: &str) -> bool {
    line.trim_start().starts_with(['#', '!', ';'])
}
