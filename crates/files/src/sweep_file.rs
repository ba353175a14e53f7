//! Sweep files: CSV of this program, of LCR meters and of spreadsheets, and Touchstone of network
//! analyzers.
//!
//! The reader reports all faults of a file, each with its line and column. An ambiguous value (a phase
//! without a unit, two kinds of decimal mark) is a fault, because a wrong number gives a wrong
//! resonance. `rig-resonance` fits the readings.

mod cells;
mod collector;
mod column_head;
mod csv;
mod fault;
mod header;
mod impedance;
mod number;
mod quantity;
mod touchstone;

#[cfg(test)]
mod tests;

use std::{fmt, ops::RangeInclusive};

use num_complex::Complex64;
use rig_model::{Reading, Window};
use rig_resonance::{Bench, Circuit, FitOptions, NoisePrior, Timing};

use crate::{Faults, Location};
use collector::FaultCollector;
use fault::SweepFileFault;
use quantity::Quantity;

/// One sweep of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct FileSweep {
    /// Number of the sweep, in a file that numbers its sweeps.
    pub number: Option<u64>,
    /// Readings in the order of their times, or of the file if it has no times.
    pub readings: Vec<Reading>,
    /// Whether the file has the settling and the integration time of each reading.
    pub has_dwell: bool,
    /// Whether the file has the time of each reading.
    pub has_time: bool,
    /// Time of the first reading by the clock of the file, s. The times of the readings start there.
    pub begins_s: f64,
    /// Settings of the fit in the file.
    pub fit: FitSettings,
    /// Reason for which rigd gave the sweep up, which makes its readings useless.
    pub given_up: Option<rig_resonance::Refusal>,
    /// Rows that are not readings, in the order of the file.
    pub left_out: Vec<LeftOut>,
}

/// A row that was left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LeftOut {
    /// Number of the line, from 1.
    pub line: usize,
    /// Why it was left out.
    pub reason: LeftOutReason,
}

/// Why a row was left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LeftOutReason {
    /// The file has a word for no number in place of a value.
    NoNumber {
        /// The word: `NaN`, `N/A`, `#N/A` or `---`.
        word: &'static str,
    },
    /// The row repeats another one in every value. To count it twice would make the uncertainty too
    /// small.
    Repeated {
        /// Number of the line of the other row.
        first_line: usize,
    },
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {} was left out: ", self.line)?;
        match self.reason {
            LeftOutReason::NoNumber { word } => write!(f, "it has `{word}` in place of a number"),
            LeftOutReason::Repeated { first_line } => {
                write!(f, "it repeats line {first_line} in every value")
            }
        }
    }
}

/// Settings of the fit in a file that `rigd` wrote.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FitSettings {
    /// Frequency range of the sweep.
    pub window: Option<Window>,
    /// Noise of the readings, if it was known.
    pub noise: Option<NoisePrior>,
    /// Meaning of the times.
    pub timing: Option<Timing>,
    /// Whether the dielectric loss is always a free parameter.
    pub always_loss: bool,
    /// Largest accepted standard deviation of the resonance, Hz.
    pub target_hz: Option<f64>,
    /// Circuit that gives the weights of readings that have not settled.
    pub near: Option<Circuit>,
    /// What a survey found on the bench.
    pub bench: Option<Bench>,
}

/// A sweep file.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepFile {
    /// Its sweeps in the order of their numbers; at least one.
    pub sweeps: Vec<FileSweep>,
}

/// Largest number of readings in a sweep. The longest sweeps of network analyzers have about as many, and a fit of
/// more takes minutes.
const READINGS_MAX: usize = 101_000;

const FREQUENCY_HZ: RangeInclusive<f64> = 1e-6..=1e12;
const IMPEDANCE_OHM: RangeInclusive<f64> = -1e15..=1e15;

impl SweepFile {
    /// Reads the text of a file. The faults have its `name`; the ending `.s1p` marks a Touchstone file
    /// whose text is ambiguous. `sweep` selects a sweep by its number; `None` selects all.
    ///
    /// # Errors
    /// The faults of the file: at most twenty different ones, each with the number of its repetitions,
    /// and a last one if there are more.
    pub fn read(name: &str, text: &str, sweep: Option<u64>) -> Result<Self, Faults> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut faults = FaultCollector::default();
        if let Some(at) = text.find('\0') {
            let line = 1 + text[..at].matches('\n').count();
            faults.refuse(Location { line, column: 1 }, SweepFileFault::NotText);
            return Err(faults.into_faults(name));
        }
        let sweeps = if touchstone::is_it(name, text) {
            vec![FileSweep::of(touchstone::read(text, &mut faults))]
        } else {
            csv::read(text, sweep, &mut faults)
        };
        if faults.is_empty() && sweeps.iter().any(|sweep| sweep.readings.len() > READINGS_MAX) {
            let max = READINGS_MAX;
            faults.refuse(Location::START, SweepFileFault::TooManyReadings { max });
        }
        if let Some((readings, frequency_hz)) = sweeps.iter().find_map(FileSweep::only_frequency_hz)
        {
            faults.refuse(Location::START, SweepFileFault::OneFrequency { readings, frequency_hz });
        }
        let is_empty = sweeps.iter().all(|sweep| sweep.readings.is_empty());
        if is_empty && faults.is_empty() {
            faults.refuse(Location::START, SweepFileFault::Empty);
        }
        faults.into_faults(name).finish(Self { sweeps })
    }

    /// The text of a file: UTF-8, UTF-16 with a byte order mark, or otherwise Latin-1, which older
    /// instruments use for `°` and `µ`.
    pub fn decode(bytes: &[u8]) -> String {
        let wide = |rest: &[u8], unit: fn([u8; 2]) -> u16| {
            let units: Vec<u16> =
                rest.chunks_exact(2).map(|pair| unit([pair[0], pair[1]])).collect();
            String::from_utf16_lossy(&units)
        };
        match bytes {
            [0xff, 0xfe, rest @ ..] => wide(rest, u16::from_le_bytes),
            [0xfe, 0xff, rest @ ..] => wide(rest, u16::from_be_bytes),
            _ => match str::from_utf8(bytes) {
                Ok(text) => text.to_owned(),
                Err(_) => bytes.iter().copied().map(char::from).collect(),
            },
        }
    }
}

impl FileSweep {
    /// A sweep of readings without times and settings.
    fn of((readings, left_out): (Vec<Reading>, Vec<LeftOut>)) -> Self {
        let (has_dwell, has_time, begins_s) = (false, false, 0.0);
        let (number, fit, given_up) = (None, FitSettings::default(), None);
        Self { number, readings, has_dwell, has_time, begins_s, fit, given_up, left_out }
    }

    /// The number of readings and their frequency, if all of them have the same one. Of fewer readings the fit says that
    /// they are too few, and a numbered sweep of rigd may have ended early.
    fn only_frequency_hz(&self) -> Option<(usize, f64)> {
        const READINGS_MIN: usize = 7;
        let first = self.readings.first()?.frequency_hz;
        let is_single = self.number.is_none()
            && READINGS_MIN <= self.readings.len()
            && self.readings.iter().all(|reading| reading.frequency_hz == first);
        is_single.then_some((self.readings.len(), first))
    }

    /// The options for the fit of this sweep. An unknown dwell makes the fit allow for readings that
    /// have not settled.
    pub fn fit_options(&self) -> FitOptions {
        let FitSettings { window, noise, timing, always_loss, near, bench, .. } = self.fit;
        let guessed = if self.has_dwell { Timing::Waited } else { Timing::Unknown };
        let timing = timing.unwrap_or(guessed);
        FitOptions { window, noise, timing, always_loss, near, bench }
    }
}

/// The lines of a text with their numbers. Lines end with LF, CR LF or CR, whichever is more frequent.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let count = |end: char| text.matches(end).count();
    let end = if count('\n') >= count('\r') { '\n' } else { '\r' };
    let lines = text.split(end).map(|line| line.trim_matches(['\r', '\n']));
    lines.enumerate().map(|(index, line)| (index + 1, line))
}

/// The location of a byte of a line.
fn location(text: &str, line: usize, at: usize) -> Location {
    Location { line, column: 1 + text[..at].chars().count() }
}

/// Checks that an impedance is measurable: not zero and not too large.
fn measured(impedance_ohm: Complex64) -> Result<Complex64, SweepFileFault> {
    let found = impedance_ohm.norm();
    let max = *IMPEDANCE_OHM.end();
    if found == 0.0 {
        Err(SweepFileFault::ZeroImpedance)
    } else if found <= max {
        Ok(impedance_ohm)
    } else {
        Err(SweepFileFault::OutOfRange { quantity: Quantity::Magnitude, found, min: 0.0, max })
    }
}

/// The impedance of a reflection, as a multiple of the reference.
fn of_reflection(reflection: Complex64) -> Result<Complex64, SweepFileFault> {
    if reflection == Complex64::ONE {
        Err(SweepFileFault::OpenCircuit)
    } else {
        Ok((1.0 + reflection) / (1.0 - reflection))
    }
}

/// The impedance of an admittance.
fn of_admittance(admittance: Complex64) -> Result<Complex64, SweepFileFault> {
    if admittance == Complex64::ZERO {
        Err(SweepFileFault::ZeroAdmittance)
    } else {
        Ok(1.0 / admittance)
    }
}
