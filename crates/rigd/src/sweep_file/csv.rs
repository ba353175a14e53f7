//! Rows of cells under a header.

use std::{f64::consts::PI, time::Duration};

use num_complex::Complex64;
use rig_model::{Impedance, Measured, Reading, ReadingFlag, RigTime};
use rig_settings::Place;

use super::{
    Notes, SweepFile, behind,
    cells::{Separator, cells},
    head::Quantity,
    header::{Column, Header, is_comment},
    inverse, lines, measured,
    number::{Numbers, Value, excerpt},
    place,
    refusal::Refusal,
};

/// Of the reflections in a table, which do not say their reference.
const REFERENCE_OHM: f64 = 50.0;

/// What a row says.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// By quantity, in the units of their keys.
    values: [f64; Quantity::COUNT],
    /// Zero where it was overloaded.
    impedance_ohm: Complex64,
    flag: Option<ReadingFlag>,
    is_used: bool,
    sweep: u64,
}

/// Reads a file of rows.
pub(super) fn read(text: &str, sweep: Option<u64>, notes: &mut Notes) -> SweepFile {
    let nothing = SweepFile { readings: Vec::new(), has_dwell: false, has_time: false };
    let Some(header) = Header::find(text, notes) else { return nothing };
    let mut rows = rows(&header, text, notes);
    match (header.column(Quantity::Sweep), sweep) {
        (Some(column), _) => choose(&mut rows, sweep, column.place, notes),
        (None, Some(_)) => notes.refuse(header.columns[0].place, &Refusal::NoNumbers),
        (None, None) => {}
    }
    rows.retain(|row| row.is_used);
    let has = |quantity| header.column(quantity).is_some();
    if has(Quantity::Time) {
        put_in_time(&mut rows);
    }
    SweepFile {
        readings: rows.iter().map(Row::reading).collect(),
        has_dwell: has(Quantity::Settle) && has(Quantity::Integration),
        has_time: has(Quantity::Time),
    }
}

/// The rows below the header.
fn rows(header: &Header<'_>, text: &str, notes: &mut Notes) -> Vec<Row> {
    let mut numbers = Numbers::default();
    let mut rows = Vec::new();
    for (line, text) in lines(text).skip(header.line) {
        let begins_empty =
            header.separator == Separator::Semicolon && text.trim_start().starts_with(';');
        let is_comment = is_comment(text) && !begins_empty;
        if is_comment || text.trim().is_empty() || text == header.text {
            continue;
        }
        // As Keysight and Agilent end a block.
        if notes.is_full() || text.trim() == "END" {
            break;
        }
        rows.extend(row(header, line, text, &mut numbers, notes));
    }
    for phase in [Quantity::Phase, Quantity::ReflectionPhase] {
        if let Some(column) = header.column(phase)
            && column.head.unit.is_none()
            && !rows.is_empty()
            && rows.iter().all(|row| row.of(phase).abs() <= PI)
        {
            notes.refuse(column.place, &Refusal::UnitlessPhase { key: phase.key() });
        }
    }
    rows
}

/// One row, if nothing is wrong with it.
fn row(
    header: &Header<'_>,
    line: usize,
    text: &str,
    numbers: &mut Numbers,
    notes: &mut Notes,
) -> Option<Row> {
    let mut cells = match cells(text, header.separator) {
        Ok(cells) => cells,
        Err(at) => {
            notes.refuse(place(text, line, at), &Refusal::OpenQuote);
            return None;
        }
    };
    while cells.len() > header.width && cells.last().is_some_and(|cell| cell.text.is_empty()) {
        cells.pop();
    }
    let needed = header.columns.iter().map(|column| column.index + 1).max().unwrap_or(0);
    if cells.len() < needed || cells.len() > header.width {
        let refusal = Refusal::Cells { found: cells.len(), expected: header.width };
        notes.refuse(Place { line, column: 1 }, &refusal);
        return None;
    }
    let mut row = Row {
        values: [0.0; Quantity::COUNT],
        impedance_ohm: Complex64::ZERO,
        flag: None,
        is_used: true,
        sweep: 0,
    };
    let mut is_complete = true;
    // A row that says it was overloaded needs no impedance.
    let is_flag = |column: &&Column| column.head.quantity == Quantity::Flag;
    let (flags, others): (Vec<_>, Vec<_>) = header.columns.iter().partition(is_flag);
    for column in flags.into_iter().chain(others) {
        let cell = &cells[column.index];
        if let Err(refusal) = row.take(column, &cell.text, numbers) {
            notes.refuse(place(text, line, cell.at), &refusal);
            is_complete = false;
        }
    }
    let [first, _] = header.pair?;
    if is_complete && row.flag != Some(ReadingFlag::Overload) {
        row.impedance_ohm = row
            .impedance_ohm(first)
            .map_err(|refusal| {
                let at = header.column(first).map_or(0, |column| cells[column.index].at);
                notes.refuse(place(text, line, at), &refusal);
            })
            .ok()?;
    }
    is_complete.then_some(row)
}

impl Row {
    /// Takes in what a cell says.
    fn take(&mut self, column: &Column, text: &str, numbers: &mut Numbers) -> Result<(), Refusal> {
        let quantity = column.head.quantity;
        if text.is_empty() {
            let is_overloaded = self.flag == Some(ReadingFlag::Overload);
            let may_be_empty = is_overloaded && quantity.is_impedance();
            return if may_be_empty { Ok(()) } else { Err(Refusal::EmptyCell { quantity }) };
        }
        match quantity {
            Quantity::Flag => self.flag_up(flag(text)?),
            Quantity::IsUsed => {
                self.is_used = text
                    .to_ascii_lowercase()
                    .parse()
                    .map_err(|_| Refusal::NotABool { text: excerpt(text) })?;
            }
            Quantity::Sweep => {
                self.sweep =
                    text.parse().map_err(|_| Refusal::NotASweep { text: excerpt(text) })?;
            }
            _ => match numbers.read(text)? {
                Value::Number(number) => {
                    let found = number * column.head.factor.unwrap_or(1.0);
                    let range = quantity.range();
                    if !range.contains(&found) {
                        let (min, max) = (*range.start(), *range.end());
                        return Err(Refusal::OutOfRange { quantity, found, min, max });
                    }
                    self.values[quantity as usize] = found;
                }
                Value::Overload if quantity.is_impedance() => {
                    self.flag_up(Some(ReadingFlag::Overload));
                }
                Value::Overload => return Err(Refusal::NotANumber { text: excerpt(text) }),
            },
        }
        Ok(())
    }

    /// An overload stays one, whatever a flag says.
    fn flag_up(&mut self, flag: Option<ReadingFlag>) {
        if self.flag != Some(ReadingFlag::Overload) {
            self.flag = flag;
        }
    }

    const fn of(&self, quantity: Quantity) -> f64 {
        self.values[quantity as usize]
    }

    /// The impedance, when `first` is the first of the columns that make it.
    fn impedance_ohm(&self, first: Quantity) -> Result<Complex64, Refusal> {
        let of = |re, im| Complex64::new(self.of(re), self.of(im));
        measured(match first {
            Quantity::Magnitude => {
                let radians = self.of(Quantity::Phase).to_radians();
                Complex64::from_polar(self.of(Quantity::Magnitude), radians)
            }
            Quantity::Conductance => inverse(of(Quantity::Conductance, Quantity::Susceptance))?,
            Quantity::ReflectionReal => {
                let reflection = of(Quantity::ReflectionReal, Quantity::ReflectionImaginary);
                REFERENCE_OHM * behind(reflection)?
            }
            Quantity::ReflectionMagnitude | Quantity::ReflectionDecibel => {
                let magnitude = if first == Quantity::ReflectionDecibel {
                    10_f64.powf(self.of(first) / 20.0)
                } else {
                    self.of(first)
                };
                let radians = self.of(Quantity::ReflectionPhase).to_radians();
                REFERENCE_OHM * behind(Complex64::from_polar(magnitude, radians))?
            }
            _ => of(Quantity::Resistance, Quantity::Reactance),
        })
    }

    fn reading(&self) -> Reading {
        let Complex64 { re: resistance_ohm, im: reactance_ohm } = self.impedance_ohm;
        let impedance = Impedance { resistance_ohm, reactance_ohm };
        Reading {
            frequency_hz: self.of(Quantity::Frequency),
            measured: match self.flag {
                None => Measured::Value(impedance),
                Some(ReadingFlag::LowSignal) => Measured::LowSignal(impedance),
                Some(ReadingFlag::Overload) => Measured::Overload,
            },
            started: RigTime::ZERO + Duration::from_secs_f64(self.of(Quantity::Time)),
            settle_s: self.of(Quantity::Settle),
            integration_s: self.of(Quantity::Integration),
        }
    }
}

fn flag(text: &str) -> Result<Option<ReadingFlag>, Refusal> {
    match text.to_ascii_lowercase().as_str() {
        "normal" => Ok(None),
        "low_signal" => Ok(Some(ReadingFlag::LowSignal)),
        "overload" => Ok(Some(ReadingFlag::Overload)),
        _ => Err(Refusal::UnknownFlag { text: excerpt(text) }),
    }
}

/// Leaves the rows of one sweep.
fn choose(rows: &mut Vec<Row>, sweep: Option<u64>, place: Place, notes: &mut Notes) {
    let mut numbers: Vec<u64> = rows.iter().map(|row| row.sweep).collect();
    numbers.sort_unstable();
    numbers.dedup();
    match (sweep, numbers.as_slice()) {
        (Some(asked), numbers) if !numbers.contains(&asked) => {
            notes.refuse(place, &Refusal::NoSuchSweep { asked });
        }
        (Some(asked), _) => rows.retain(|row| row.sweep == asked),
        (None, [first, .., last]) => {
            let (count, first, last) = (numbers.len(), *first, *last);
            notes.refuse(place, &Refusal::ManySweeps { count, first, last });
        }
        (None, _) => {}
    }
}

/// Brings the rows into the order in which they were taken, and lets the time begin with the first.
fn put_in_time(rows: &mut [Row]) {
    rows.sort_by(|a, b| a.of(Quantity::Time).total_cmp(&b.of(Quantity::Time)));
    let first_s = rows.first().map_or(0.0, |row| row.of(Quantity::Time));
    for row in rows {
        row.values[Quantity::Time as usize] -= first_s;
    }
}
