//! Sweeps as rows of cells below a header.

use std::{
    collections::{BTreeMap, HashMap},
    f64::consts::PI,
    hash::{BuildHasher, RandomState},
    time::Duration,
};

use num_complex::Complex64;
use rig_model::{AnalyzerMake, Impedance, PointResult, Reading, ReadingFlag, RigTime, Window};
use rig_resonance::{Bench, Circuit, NoisePrior, Past, Timing, flagged};

use crate::instrument::Dialect;

use super::{
    FaultCollector, FileSweep, FitSettings, LeftOut, LeftOutReason, READINGS_MAX,
    cells::{Separator, cells},
    fault::SweepFileFault,
    header::{Column, Header, is_comment},
    impedance::impedance_ohm,
    lines, location,
    number::{Numbers, Value, excerpt},
    quantity::Quantity,
};
use crate::Location;

/// Largest number of rows that are kept: some 200 MB.
const ROWS_MAX: usize = 500_000;

/// The values of a row.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// Values by quantity, in the units of the keys; NaN for none.
    values: [f64; Quantity::COUNT],
    /// Impedance; zero for an overload.
    impedance_ohm: Complex64,
    flag: Option<ReadingFlag>,
    is_used: bool,
    /// The word that the row has in place of a number.
    no_number: Option<&'static str>,
    /// Number of its cells.
    cells: usize,
    /// Number of the sweep in the file; otherwise of the block of rows.
    sweep: u64,
    timing: Option<Timing>,
    has_loss: Option<bool>,
    line: usize,
}

/// Reads a file of rows: all sweeps, or the selected one.
pub(super) fn read(text: &str, sweep: Option<u64>, faults: &mut FaultCollector) -> Vec<FileSweep> {
    let Some(header) = Header::find(text, faults) else { return Vec::new() };
    let Rows { kept: mut all, blocks, numbers, .. } = rows(&header, text, sweep, faults);
    let is_numbered = blocks > 1 || header.column(Quantity::Sweep).is_some();
    if let Some(asked) = sweep {
        let location = header.column(Quantity::Sweep).unwrap_or(&header.columns[0]).location;
        if !is_numbered {
            faults.refuse(location, SweepFileFault::NoNumbers);
        } else if let (Some(first), Some(last)) =
            (numbers.keys().next(), numbers.keys().next_back())
            && !numbers.contains_key(&asked)
        {
            let (count, first, last) = (numbers.len(), *first, *last);
            faults.refuse(location, SweepFileFault::NoSuchSweep { asked, count, first, last });
        }
    }
    all.sort_by_key(|row| row.sweep);
    let sweeps = all.chunk_by(|a, b| a.sweep == b.sweep);
    sweeps.map(|rows| one(&header, rows, is_numbered, faults)).collect()
}

/// The rows of one sweep.
fn one(
    header: &Header<'_>,
    rows: &[Row],
    is_numbered: bool,
    faults: &mut FaultCollector,
) -> FileSweep {
    let has = |quantity| header.column(quantity).is_some();
    let fit = fit_settings(rows, faults);
    let number = rows.first().filter(|_| is_numbered).map(|row| row.sweep);
    let (mut rows, left_out) = leave_out(rows);
    let begins_s = if has(Quantity::Time) { sort_by_time(&mut rows) } else { 0.0 };
    // Only rigd measures again after a flag.
    let is_rigs = fit.timing.is_some();
    let all: Vec<Reading> = rows.iter().map(Row::reading).collect();
    // With a known noise, the fit gives readings that have hardly settled a small weight.
    let is_used = |row: &Row| row.is_used || (fit.noise.is_some() && row.flag.is_none());
    let used = rows.iter().zip(&all).filter(|(row, _)| is_used(row));
    FileSweep {
        number,
        readings: used.map(|(_, reading)| *reading).collect(),
        has_dwell: has(Quantity::Settle) && has(Quantity::Integration),
        has_time: has(Quantity::Time),
        begins_s,
        fit,
        given_up: if is_rigs { flagged(&all) } else { None },
        left_out,
    }
}

/// Separates the readings of a sweep from missing and repeated ones.
fn leave_out(rows: &[Row]) -> (Vec<Row>, Vec<LeftOut>) {
    let (mut kept, mut left_out) = (Vec::new(), Vec::new());
    let mut first_rows = HashMap::new();
    let hasher = RandomState::new();
    for row in rows {
        let first = *first_rows.entry(hasher.hash_one(row.bits())).or_insert(row);
        let (line, first_line) = (row.line, first.line);
        // Overloads have no values to compare.
        let is_repeated = first_line != line
            && row.flag != Some(ReadingFlag::Overload)
            && first.bits() == row.bits();
        if let Some(word) = row.no_number {
            left_out.push(LeftOut { line, reason: LeftOutReason::NoNumber { word } });
        } else if is_repeated {
            left_out.push(LeftOut { line, reason: LeftOutReason::Repeated { first_line } });
        } else {
            kept.push(*row);
        }
    }
    (kept, left_out)
}

/// The settings of the fit, which are the same in all rows of a sweep.
fn fit_settings(rows: &[Row], faults: &mut FaultCollector) -> FitSettings {
    let Some(first) = rows.first() else { return FitSettings::default() };
    let numbers = [
        Quantity::FitMin,
        Quantity::FitMax,
        Quantity::FitNoise,
        Quantity::FitNoiseDegrees,
        Quantity::FitTarget,
        Quantity::NearResonance,
        Quantity::NearQuality,
        Quantity::NearCapacitance,
        Quantity::NearRatio,
        Quantity::NearLoss,
        Quantity::BenchPhase,
        Quantity::BenchPhaseSigma,
        Quantity::BenchFirstGap,
        Quantity::BenchDispersion,
        Quantity::BenchDispersionSigma,
        Quantity::BenchMode,
        Quantity::BenchMin,
        Quantity::BenchMax,
    ];
    for row in rows {
        let location = Location { line: row.line, column: 1 };
        let is_other = |quantity: &Quantity| row.value(*quantity) != first.value(*quantity);
        let other = numbers.into_iter().find(is_other);
        let other = other.or((row.timing != first.timing).then_some(Quantity::FitTiming));
        let other = other.or((row.has_loss != first.has_loss).then_some(Quantity::FitLoss));
        if let Some(quantity) = other {
            faults.refuse(location, SweepFileFault::UnequalSetting { quantity });
            break;
        }
    }
    let of = |quantity| first.value(quantity);
    let window = of(Quantity::FitMin).zip(of(Quantity::FitMax));
    let window = window.map(|(min_hz, max_hz)| Window { min_hz, max_hz });
    if let Some(Window { min_hz, max_hz }) = window.filter(|window| window.max_hz <= window.min_hz)
    {
        let location = Location { line: first.line, column: 1 };
        faults.refuse(location, SweepFileFault::FitWindow { min_hz, max_hz });
    }
    let noise = of(Quantity::FitNoise).map(|at_ten_cycles| NoisePrior {
        at_ten_cycles,
        degrees_of_freedom: of(Quantity::FitNoiseDegrees).unwrap_or(NoisePrior::STATED_DEGREES),
    });
    FitSettings {
        window,
        noise,
        timing: first.timing,
        always_loss: first.has_loss == Some(true),
        target_hz: of(Quantity::FitTarget),
        near: near(first),
        bench: bench(first),
    }
}

/// The circuit before the fit, by the cells of this row; all are needed.
fn near(row: &Row) -> Option<Circuit> {
    let of = |quantity| row.value(quantity);
    let c0_farad = of(Quantity::NearCapacitance)?;
    Some(Circuit {
        resonance_hz: of(Quantity::NearResonance)?,
        q: of(Quantity::NearQuality)?,
        c0_farad,
        c1_farad: of(Quantity::NearRatio)? * c0_farad,
        loss_tangent: of(Quantity::NearLoss)?,
    })
}

/// What a survey found, by the cells of this row. All are needed; older files have no first gap or no dispersion.
fn bench(row: &Row) -> Option<Bench> {
    let of = |quantity| row.value(quantity);
    let dispersion = match (of(Quantity::BenchDispersion), of(Quantity::BenchDispersionSigma)) {
        (None, None) => (0.0, 0.0),
        (found, sigma) => found.zip(sigma)?,
    };
    Some(Bench {
        phase_rad: of(Quantity::BenchPhase)?,
        phase_sigma_rad: of(Quantity::BenchPhaseSigma)?,
        first_gap_s: of(Quantity::BenchFirstGap).unwrap_or(0.0),
        dispersion_farad: dispersion.0,
        dispersion_sigma_farad: dispersion.1,
        mode_sigma: of(Quantity::BenchMode)?,
        surveyed: Window { min_hz: of(Quantity::BenchMin)?, max_hz: of(Quantity::BenchMax)? },
    })
}

/// The rows of a file.
#[derive(Debug, Default)]
struct Rows {
    /// Those of the sweep that is asked for.
    kept: Vec<Row>,
    /// Number of blocks of rows, each with its header.
    blocks: u64,
    /// Number of rows of this block.
    of_block: usize,
    /// The numbers of all sweeps, with the block that each is in.
    numbers: BTreeMap<u64, u64>,
    /// Line of the header of this block.
    header_line: usize,
    /// The number of cells of the first row, and its line.
    first_cells: Option<(usize, usize)>,
    /// The last two frequencies of this block, Hz.
    last_hz: [Option<f64>; 2],
    /// Whether the header has just been repeated.
    is_repeated: bool,
}

impl Rows {
    /// Begins a block if a row does not go on with the frequencies above a repeated header, as it does on the next page of
    /// one table.
    fn begin(&mut self, frequency_hz: f64) {
        let goes_on = match self.last_hz {
            [Some(before_hz), Some(last_hz)] => {
                (last_hz - before_hz) * (frequency_hz - last_hz) > 0.0
            }
            _ => false,
        };
        if std::mem::take(&mut self.is_repeated) && !goes_on && self.last_hz[1].is_some() {
            self.blocks += 1;
            self.of_block = 0;
            self.last_hz = [None; 2];
        }
        self.last_hz = [self.last_hz[1], Some(frequency_hz)];
    }

    /// Whether a row has as many cells as the first one. Between blanks, one that is missing is not to be seen, and the
    /// others would move.
    fn is_complete(&mut self, header: &Header<'_>, row: &Row, faults: &mut FaultCollector) -> bool {
        let Row { cells: found, line, .. } = *row;
        let (expected, first_line) = *self.first_cells.get_or_insert((found, line));
        let is_complete = header.separator != Separator::Spaces || found == expected;
        if !is_complete {
            let refusal = SweepFileFault::OtherCells { found, expected, first_line };
            faults.refuse(Location { line, column: 1 }, refusal);
        }
        is_complete
    }

    /// Takes a row in, if it is of the sweep that is asked for.
    fn push(
        &mut self,
        mut row: Row,
        asked: Option<u64>,
        has_numbers: bool,
    ) -> Result<(), SweepFileFault> {
        // A row without a frequency goes on with nothing, and ends nothing.
        let frequency_hz = row.of(Quantity::Frequency);
        if frequency_hz > 0.0 {
            self.begin(frequency_hz);
        }
        if !has_numbers {
            row.sweep = self.blocks - 1;
        }
        if *self.numbers.entry(row.sweep).or_insert(self.blocks) != self.blocks {
            let header_line = self.header_line;
            return Err(SweepFileFault::SweepTwice { sweep: row.sweep, header_line });
        }
        if asked.is_none_or(|asked| asked == row.sweep) {
            self.kept.push(row);
        }
        self.of_block += 1;
        if !has_numbers && self.of_block > READINGS_MAX {
            return Err(SweepFileFault::TooManyReadings { max: READINGS_MAX });
        }
        if self.kept.len() > ROWS_MAX {
            return Err(SweepFileFault::TooManyRows { max: ROWS_MAX });
        }
        Ok(())
    }
}

/// The rows below the header, of all sweeps or of the one that is asked for.
fn rows(header: &Header<'_>, text: &str, asked: Option<u64>, faults: &mut FaultCollector) -> Rows {
    let mut numbers = Numbers::new(header.separator == Separator::Comma);
    let mut found = Rows { blocks: 1, header_line: header.line, ..Rows::default() };
    let has_numbers = header.column(Quantity::Sweep).is_some();
    let mut is_ended = false;
    for (line, text) in lines(text).skip(header.line) {
        let begins_empty =
            header.separator == Separator::Semicolon && text.trim_start().starts_with(';');
        let is_comment = (is_comment(text) && !begins_empty) || Some(text) == header.units;
        if faults.is_full() {
            break;
        }
        if text == header.text {
            (found.is_repeated, found.header_line, is_ended) = (true, line, false);
        } else if text.trim() == "END" {
            // The end of a block of Keysight and Agilent.
            is_ended = true;
        } else if is_ended && header.is_another(text) {
            faults.refuse(Location { line, column: 1 }, SweepFileFault::AnotherTable);
            break;
        } else if !is_ended
            && !is_comment
            && !text.trim().is_empty()
            // ZPlot ends its head so.
            && text.trim() != "End Comments"
            && let Some(row) = row(header, line, text, &mut numbers, faults)
            && found.is_complete(header, &row, faults)
            && let Err(refusal) = found.push(row, asked, has_numbers)
        {
            faults.refuse(Location { line, column: 1 }, refusal);
            break;
        }
    }
    check_units(header, &found.kept, &numbers, faults);
    found
}

/// Whether the numbers can be read in one way only.
fn check_units(header: &Header<'_>, rows: &[Row], numbers: &Numbers, faults: &mut FaultCollector) {
    if let Some(text) = numbers.ambiguous() {
        let refusal = SweepFileFault::Thousands { text: text.to_owned() };
        faults.refuse(Location { line: header.line + 1, column: 1 }, refusal);
    }
    for column in header.columns.iter().filter(|column| column.head.unit.is_none()) {
        let quantity = column.head.quantity;
        let are_all = |is_small: &dyn Fn(f64) -> bool| {
            !rows.is_empty() && rows.iter().all(|row: &Row| is_small(row.of(quantity)))
        };
        if quantity.is_phase() && are_all(&|value| value.abs() <= PI) {
            let refusal = SweepFileFault::UnitlessPhase { key: quantity.key() };
            faults.refuse(column.location, refusal);
        }
        let min_hz = lowest_frequency_hz();
        if quantity == Quantity::Frequency && are_all(&|value| value < min_hz) {
            faults.refuse(column.location, SweepFileFault::UnitlessFrequency { min_hz });
        }
    }
}

/// The lowest frequency of any known analyzer, Hz.
fn lowest_frequency_hz() -> f64 {
    let lowest = AnalyzerMake::ALL.iter().map(|make| Dialect::of(*make).frequency_hz.0);
    lowest.fold(f64::INFINITY, f64::min)
}

/// A row without faults.
fn row(
    header: &Header<'_>,
    line: usize,
    text: &str,
    numbers: &mut Numbers,
    faults: &mut FaultCollector,
) -> Option<Row> {
    let mut cells = match cells(text, header.separator) {
        Ok(cells) => cells,
        Err(at) => {
            faults.refuse(location(text, line, at), SweepFileFault::OpenQuote);
            return None;
        }
    };
    while cells.len() > header.width && cells.last().is_some_and(|cell| cell.text.is_empty()) {
        cells.pop();
    }
    let needed = header.columns.iter().map(|column| column.index + 1).max().unwrap_or(0);
    if cells.len() < needed || cells.len() > header.width {
        let refusal = SweepFileFault::Cells {
            found: cells.len(),
            expected: header.width,
            separator: header.separator,
        };
        faults.refuse(Location { line, column: 1 }, refusal);
        return None;
    }
    let mut row = Row {
        values: [f64::NAN; Quantity::COUNT],
        impedance_ohm: Complex64::ZERO,
        flag: None,
        is_used: true,
        no_number: None,
        cells: cells.len(),
        sweep: 0,
        timing: None,
        has_loss: None,
        line,
    };
    let mut is_complete = true;
    // An overloaded row needs no impedance, so the flag is read first.
    let is_flag = |column: &&Column| column.head.quantity == Quantity::Flag;
    let (flags, others): (Vec<_>, Vec<_>) = header.columns.iter().partition(is_flag);
    for column in flags.into_iter().chain(others) {
        let cell = &cells[column.index];
        if let Err(refusal) = row.take(column, &cell.text, numbers) {
            faults.refuse(location(text, line, cell.at), refusal);
            is_complete = false;
        }
    }
    let pair = header.pair?;
    if is_complete && row.no_number.is_none() && row.flag != Some(ReadingFlag::Overload) {
        let values = pair.map(|quantity| row.of(quantity));
        row.impedance_ohm = impedance_ohm(pair, values, row.of(Quantity::Frequency))
            .map_err(|refusal| {
                let at = header.column(pair[0]).map_or(0, |column| cells[column.index].at);
                faults.refuse(location(text, line, at), refusal);
            })
            .ok()?;
    }
    is_complete.then_some(row)
}

impl Row {
    /// Reads a cell.
    fn take(
        &mut self,
        column: &Column,
        text: &str,
        numbers: &mut Numbers,
    ) -> Result<(), SweepFileFault> {
        let quantity = column.head.quantity;
        if text.is_empty() {
            let is_overloaded = self.flag == Some(ReadingFlag::Overload);
            let may_be_empty =
                quantity.is_fit_setting() || (is_overloaded && quantity.is_impedance());
            return if may_be_empty { Ok(()) } else { Err(SweepFileFault::EmptyCell { quantity }) };
        }
        let flag_of = |text: &str| {
            let refusal = |_| SweepFileFault::NotABool { text: excerpt(text) };
            text.to_ascii_lowercase().parse().map_err(refusal)
        };
        match quantity {
            Quantity::Flag => self.set_flag(flag(text)?),
            Quantity::IsUsed => self.is_used = flag_of(text)?,
            Quantity::FitLoss => self.has_loss = Some(flag_of(text)?),
            Quantity::FitTiming => self.timing = Some(timing(text)?),
            Quantity::Sweep => {
                self.sweep =
                    text.parse().map_err(|_| SweepFileFault::NotASweep { text: excerpt(text) })?;
            }
            _ => match numbers.read(text)? {
                Value::Number(number) => {
                    let found = number * column.head.factor.unwrap_or(1.0);
                    let range = quantity.range();
                    if !range.contains(&found) {
                        let (min, max) = (*range.start(), *range.end());
                        return Err(SweepFileFault::OutOfRange { quantity, found, min, max });
                    }
                    self.values[quantity as usize] = found;
                }
                Value::Overload if quantity.is_impedance() => {
                    self.set_flag(Some(ReadingFlag::Overload));
                }
                Value::Missing(word)
                    if quantity.is_impedance() || quantity == Quantity::Frequency =>
                {
                    if self.flag != Some(ReadingFlag::Overload) {
                        self.no_number.get_or_insert(word);
                    }
                }
                Value::Overload | Value::Missing(_) => {
                    return Err(SweepFileFault::NotANumber { text: excerpt(text) });
                }
            },
        }
        Ok(())
    }

    /// All values of the row, to compare it with others.
    fn bits(&self) -> ([u64; Quantity::COUNT], bool, bool) {
        (self.values.map(f64::to_bits), self.flag.is_some(), self.is_used)
    }

    /// Sets the flag; an overload stays.
    fn set_flag(&mut self, flag: Option<ReadingFlag>) {
        if self.flag != Some(ReadingFlag::Overload) {
            self.flag = flag;
        }
    }

    /// The value, or zero without its column.
    fn of(&self, quantity: Quantity) -> f64 {
        self.value(quantity).unwrap_or(0.0)
    }

    /// The value, if the row has it.
    fn value(&self, quantity: Quantity) -> Option<f64> {
        Some(self.values[quantity as usize]).filter(|value| !value.is_nan())
    }

    fn reading(&self) -> Reading {
        let Complex64 { re: resistance_ohm, im: reactance_ohm } = self.impedance_ohm;
        let impedance = Impedance { resistance_ohm, reactance_ohm };
        Reading {
            frequency_hz: self.of(Quantity::Frequency),
            measured: match self.flag {
                None => PointResult::Value(impedance),
                Some(ReadingFlag::LowSignal) => PointResult::LowSignal(impedance),
                Some(ReadingFlag::Overload) => PointResult::Overload,
            },
            started: RigTime::ZERO + Duration::from_secs_f64(self.of(Quantity::Time)),
            settle_s: self.of(Quantity::Settle),
            integration_s: self.of(Quantity::Integration),
        }
    }
}

fn flag(text: &str) -> Result<Option<ReadingFlag>, SweepFileFault> {
    match text.to_ascii_lowercase().as_str() {
        "normal" => Ok(None),
        "low_signal" => Ok(Some(ReadingFlag::LowSignal)),
        "overload" => Ok(Some(ReadingFlag::Overload)),
        _ => Err(SweepFileFault::UnknownFlag { text: excerpt(text) }),
    }
}

fn timing(text: &str) -> Result<Timing, SweepFileFault> {
    match text.to_ascii_lowercase().as_str() {
        "unknown" => Ok(Timing::Unknown),
        "waited" => Ok(Timing::Waited),
        "exact" => Ok(Timing::Exact(Past::Unknown)),
        "exact-from-rest" => Ok(Timing::Exact(Past::Rest)),
        "any-phase" => Ok(Timing::AnyPhase),
        _ => Err(SweepFileFault::UnknownTiming { text: excerpt(text) }),
    }
}

/// Sorts the rows by time, and counts the time from the first row. Returns the time of the first row.
fn sort_by_time(rows: &mut [Row]) -> f64 {
    rows.sort_by(|a, b| a.of(Quantity::Time).total_cmp(&b.of(Quantity::Time)));
    let first_s = rows.first().map_or(0.0, |row| row.of(Quantity::Time));
    for row in rows {
        row.values[Quantity::Time as usize] = row.of(Quantity::Time) - first_s;
    }
    first_s
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_many_sweeps_has_a_largest_number_of_rows() {
        let header = Header::find("sweep,f,R,X\n", &mut FaultCollector::default()).unwrap();
        let (mut numbers, mut faults) = (Numbers::new(true), FaultCollector::default());
        let row = row(&header, 2, "3,120,900,-47000", &mut numbers, &mut faults).unwrap();
        let mut found = Rows { blocks: 1, ..Rows::default() };
        for _ in 0..ROWS_MAX {
            assert!(found.push(row, None, true).is_ok());
        }
        let refusal = Err(SweepFileFault::TooManyRows { max: ROWS_MAX });
        assert_eq!(found.push(row, None, true), refusal);
        assert!(found.push(Row { sweep: 4, ..row }, Some(3), true).is_err());
        // Those of other sweeps than the one that is asked for are not kept.
        let mut one = Rows { blocks: 1, ..Rows::default() };
        for sweep in 0..10 {
            one.push(Row { sweep, ..row }, Some(3), true).unwrap();
        }
        assert_eq!((one.kept.len(), one.numbers.len()), (1, 10));
    }
}
