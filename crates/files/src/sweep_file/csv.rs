//! Sweeps as rows of cells below a header.

use std::{collections::HashMap, f64::consts::PI, time::Duration};

use num_complex::Complex64;
use rig_model::{AnalyzerMake, Impedance, PointResult, Reading, ReadingFlag, RigTime, Window};
use rig_resonance::{Bench, Circuit, NoisePrior, Past, Timing, flagged};

use crate::instrument::Dialect;

use super::{
    FaultCollector, FileSweep, FitSettings, LeftOut, LeftOutReason,
    cells::{Separator, cells},
    fault::SweepFileFault,
    header::{Column, Header, is_comment},
    impedance::impedance_ohm,
    lines, location,
    number::{Numbers, Value, excerpt},
    quantity::Quantity,
};
use crate::Location;

/// The values of a row.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// Values by quantity, in the units of the keys.
    values: [Option<f64>; Quantity::COUNT],
    /// Impedance; zero for an overload.
    impedance_ohm: Complex64,
    flag: Option<ReadingFlag>,
    is_used: bool,
    /// The word that the row has in place of a number.
    no_number: Option<&'static str>,
    sweep: u64,
    timing: Option<Timing>,
    has_loss: Option<bool>,
    line: usize,
}

/// Reads a file of rows: all sweeps, or the selected one.
pub(super) fn read(text: &str, sweep: Option<u64>, faults: &mut FaultCollector) -> Vec<FileSweep> {
    let Some(header) = Header::find(text, faults) else { return Vec::new() };
    let mut rows = rows(&header, text, faults);
    match (header.column(Quantity::Sweep), sweep) {
        (Some(column), Some(asked)) => choose(&mut rows, asked, column.location, faults),
        (None, Some(_)) => faults.refuse(header.columns[0].location, SweepFileFault::NoNumbers),
        (_, None) => {}
    }
    rows.sort_by_key(|row| row.sweep);
    rows.chunk_by(|a, b| a.sweep == b.sweep).map(|rows| one(&header, rows, faults)).collect()
}

/// The rows of one sweep.
fn one(header: &Header<'_>, rows: &[Row], faults: &mut FaultCollector) -> FileSweep {
    let has = |quantity| header.column(quantity).is_some();
    let fit = fit_settings(rows, faults);
    let number = header.column(Quantity::Sweep).and(rows.first()).map(|row| row.sweep);
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
    let mut first_lines = HashMap::new();
    for row in rows {
        let first_line = *first_lines.entry(row.bits()).or_insert(row.line);
        // Overloads have no values to compare.
        let is_repeated = first_line != row.line && row.flag != Some(ReadingFlag::Overload);
        let line = row.line;
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

/// The rows below the header.
fn rows(header: &Header<'_>, text: &str, faults: &mut FaultCollector) -> Vec<Row> {
    let mut numbers = Numbers::new(header.separator == Separator::Comma);
    let mut rows = Vec::new();
    for (line, text) in lines(text).skip(header.line) {
        let begins_empty =
            header.separator == Separator::Semicolon && text.trim_start().starts_with(';');
        let is_comment = is_comment(text) && !begins_empty;
        if is_comment || text.trim().is_empty() || text == header.text {
            continue;
        }
        // The end of a block of Keysight and Agilent.
        if faults.is_full() || text.trim() == "END" {
            break;
        }
        rows.extend(row(header, line, text, &mut numbers, faults));
    }
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
    rows
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
        values: [None; Quantity::COUNT],
        impedance_ohm: Complex64::ZERO,
        flag: None,
        is_used: true,
        no_number: None,
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
                    self.values[quantity as usize] = Some(found);
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
    fn bits(&self) -> ([Option<u64>; Quantity::COUNT], bool, bool) {
        let bits = self.values.map(|value| value.map(f64::to_bits));
        (bits, self.flag.is_some(), self.is_used)
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
    const fn value(&self, quantity: Quantity) -> Option<f64> {
        self.values[quantity as usize]
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

/// Keeps the rows of one sweep.
fn choose(rows: &mut Vec<Row>, asked: u64, location: Location, faults: &mut FaultCollector) {
    let mut numbers: Vec<u64> = rows.iter().map(|row| row.sweep).collect();
    numbers.sort_unstable();
    numbers.dedup();
    if let ([first, ..], [.., last]) = (numbers.as_slice(), numbers.as_slice())
        && !numbers.contains(&asked)
    {
        let (count, first, last) = (numbers.len(), *first, *last);
        faults.refuse(location, SweepFileFault::NoSuchSweep { asked, count, first, last });
    }
    rows.retain(|row| row.sweep == asked);
}

/// Sorts the rows by time, and counts the time from the first row. Returns the time of the first row.
fn sort_by_time(rows: &mut [Row]) -> f64 {
    rows.sort_by(|a, b| a.of(Quantity::Time).total_cmp(&b.of(Quantity::Time)));
    let first_s = rows.first().map_or(0.0, |row| row.of(Quantity::Time));
    for row in rows {
        row.values[Quantity::Time as usize] = Some(row.of(Quantity::Time) - first_s);
    }
    first_s
}
