//! The line that names the columns.

use rig_files::Location;

use super::{
    Notes,
    cells::{Cell, Separator, cells},
    head::{Head, Quantity},
    lines, location,
    number::excerpt,
    refusal::Refusal,
};

/// In the order of preference where a file has more than one.
const PAIRS: [[Quantity; 2]; 6] = [
    [Quantity::Resistance, Quantity::Reactance],
    [Quantity::Magnitude, Quantity::Phase],
    [Quantity::Conductance, Quantity::Susceptance],
    [Quantity::ReflectionReal, Quantity::ReflectionImaginary],
    [Quantity::ReflectionMagnitude, Quantity::ReflectionPhase],
    [Quantity::ReflectionDecibel, Quantity::ReflectionPhase],
];

/// A header.
#[derive(Debug)]
pub(super) struct Header<'a> {
    pub(super) text: &'a str,
    /// Counts from 1.
    pub(super) line: usize,
    pub(super) separator: Separator,
    /// How many cells a row may have.
    pub(super) width: usize,
    /// Those that are known. Of those that make an impedance only one pair is here.
    pub(super) columns: Vec<Column>,
    /// The two columns that make the impedance.
    pub(super) pair: Option<[Quantity; 2]>,
}

/// A column that is known.
#[derive(Debug)]
pub(super) struct Column {
    pub(super) index: usize,
    pub(super) location: Location,
    pub(super) head: Head,
    text: String,
}

impl<'a> Header<'a> {
    /// The first line that names a frequency and an impedance. What stands above it is no data.
    pub(super) fn find(text: &'a str, notes: &mut Notes) -> Option<Self> {
        let mut best: Option<Self> = None;
        for (line, text) in lines(text) {
            for separator in Separator::ALL {
                if separator.is_rare() && !text.contains(|character| separator.is(character)) {
                    continue;
                }
                let Some(header) = Self::of(text, line, separator) else { continue };
                if header.pair.is_some() && header.column(Quantity::Frequency).is_some() {
                    return header.check(notes).then_some(header);
                }
                if header.columns.len() > best.as_ref().map_or(0, |best| best.columns.len()) {
                    best = Some(header);
                }
            }
        }
        match best {
            Some(best) => {
                let location = best.columns[0].location;
                if best.column(Quantity::Frequency).is_none() {
                    notes.refuse(location, &Refusal::NoFrequency);
                }
                if best.pair.is_none() {
                    notes.refuse(location, &Refusal::NoImpedance);
                }
            }
            None => {
                match lines(text).find(|(_, text)| !text.trim().is_empty() && !is_comment(text)) {
                    Some((line, _)) => {
                        notes.refuse(Location { line, column: 1 }, &Refusal::NoHeader);
                    }
                    None => notes.refuse(Location::START, &Refusal::Empty),
                }
            }
        }
        None
    }

    /// The columns that this line names. It may stand in a comment.
    fn of(text: &'a str, line: usize, separator: Separator) -> Option<Self> {
        let bare = text.trim_start().trim_start_matches(['#', '!', ';']);
        let mut all = cells(bare, separator).ok()?;
        while all.last().is_some_and(|cell| cell.text.is_empty()) {
            all.pop();
        }
        let before = text.len() - bare.len();
        let column = |(index, cell): (usize, &Cell<'_>)| {
            let location = location(text, line, before + cell.at);
            let head = Head::of(&cell.text)?;
            Some(Column { index, location, text: excerpt(&cell.text), head })
        };
        let mut columns: Vec<_> = all.iter().enumerate().filter_map(column).collect();
        let is_there = |quantity: &Quantity| columns.iter().any(|it| it.head.quantity == *quantity);
        let pair = PAIRS.into_iter().find(|pair| pair.iter().all(is_there));
        if let Some(pair) = pair {
            let is_spare = |quantity: Quantity| {
                PAIRS.as_flattened().contains(&quantity) && !pair.contains(&quantity)
            };
            columns.retain(|column| !is_spare(column.head.quantity));
        }
        let width = all.len();
        Some(Self { text, line, separator, width, columns, pair })
    }

    pub(super) fn column(&self, quantity: Quantity) -> Option<&Column> {
        self.columns.iter().find(|column| column.head.quantity == quantity)
    }

    /// Whether every column is there once and has a unit that is known.
    fn check(&self, notes: &mut Notes) -> bool {
        for (index, column) in self.columns.iter().enumerate() {
            let Head { quantity, factor, ref unit } = column.head;
            if self.columns[..index].iter().any(|other| other.head.quantity == quantity) {
                let header = column.text.clone();
                notes.refuse(column.location, &Refusal::Twice { header, quantity });
            }
            if factor.is_none() {
                let unit = excerpt(unit.as_deref().unwrap_or_default());
                notes.refuse(column.location, &Refusal::UnknownUnit { unit, quantity });
            }
        }
        notes.faults.is_empty()
    }
}

/// Whether a line above the header is only for people.
pub(super) fn is_comment(line: &str) -> bool {
    line.trim_start().starts_with(['#', '!', ';'])
}
