//! Sweeps from files, whoever wrote them: CSV of this program, of LCR meters, of spreadsheets, and
//! Touchstone of network analyzers.
//!
//! A file is read as a whole, and everything that is wrong with it is said at once, each fault with
//! its line and column. What cannot be told for sure (a phase without a unit, two kinds of decimal
//! mark) is a fault too: a number read wrongly would become a wrong resonance.
//!
//! What the readings mean is left to `rig-resonance`.

mod cells;
mod csv;
mod head;
mod header;
mod number;
mod refusal;
mod touchstone;

#[cfg(test)]
mod tests;

use std::ops::RangeInclusive;

use num_complex::Complex64;
use rig_files::{Complaint, Faults, Location};
use rig_model::{Reading, Window};
use rig_resonance::{Circuit, FitOptions, NoisePrior, Timing};

use head::Quantity;
use refusal::Refusal;

/// One sweep of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct FileSweep {
    /// Its number, in a file that numbers its sweeps.
    pub number: Option<u64>,
    /// In the order in which they were taken where the file tells it, else in that of the file.
    pub readings: Vec<Reading>,
    /// Whether the file says how long each point was waited for and integrated.
    pub has_dwell: bool,
    /// Whether the file says when each reading was taken.
    pub has_time: bool,
    /// When the first reading was taken, on the clock of the file, s. The readings count from there.
    pub begins_s: f64,
    /// What the file tells the fit besides the readings.
    pub told: Told,
    /// Why the sweep was given up, where it was: its readings say nothing then.
    pub given_up: Option<rig_resonance::Refusal>,
}

/// What a file tells the fit besides the readings, as `rigd` writes it with its own.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Told {
    /// Where the resonance was sought.
    pub window: Option<Window>,
    /// What was known of the noise.
    pub noise: Option<NoisePrior>,
    /// What is known of the times.
    pub timing: Option<Timing>,
    /// Whether dielectric loss is a free parameter whatever the readings ask for.
    pub always_loss: bool,
    /// The standard deviation without which no resonance is accepted, Hz.
    pub target_hz: Option<f64>,
    /// The circuit for which readings that have not settled are weighed.
    pub near: Option<Circuit>,
}

/// The sweeps of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepFile {
    /// At least one, in the order of their numbers.
    pub sweeps: Vec<FileSweep>,
}

/// After so many faults the rest of the file tells a person nothing new.
const FAULTS_MAX: usize = 20;

const FREQUENCY_HZ: RangeInclusive<f64> = 1e-6..=1e12;
const IMPEDANCE_OHM: RangeInclusive<f64> = -1e15..=1e15;

impl SweepFile {
    /// Reads the text of a file. `name` stands in the faults, and tells Touchstone (`.s1p`) from
    /// CSV where the text does not. `sweep` chooses one of the sweeps of a file that numbers them;
    /// all are read when it is not given.
    ///
    /// # Errors
    /// The faults of the file, at most twenty.
    pub fn read(name: &str, text: &str, sweep: Option<u64>) -> Result<Self, Faults> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut notes = Notes { faults: Faults::new(name) };
        let sweeps = if touchstone::is_it(name, text) {
            vec![FileSweep::untold(touchstone::read(text, &mut notes))]
        } else {
            csv::read(text, sweep, &mut notes)
        };
        let is_empty = sweeps.iter().all(|sweep| sweep.readings.is_empty());
        if is_empty && notes.faults.is_empty() {
            notes.refuse(Location::START, &Refusal::Empty);
        }
        notes.faults.finish(Self { sweeps })
    }

    /// The text of a file: UTF-8, UTF-16 with a mark, or else Latin-1, in which older instruments
    /// write `°` and `µ`.
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
    /// Readings of which nothing else is known.
    fn untold(readings: Vec<Reading>) -> Self {
        let (has_dwell, has_time, begins_s) = (false, false, 0.0);
        let (number, told, given_up) = (None, Told::default(), None);
        Self { number, readings, has_dwell, has_time, begins_s, told, given_up }
    }

    /// What the fit is told of this sweep. Without the dwell it suspects that readings have not
    /// settled.
    pub fn fit_options(&self) -> FitOptions {
        let Told { window, noise, timing, always_loss, near, .. } = self.told;
        let guessed = if self.has_dwell { Timing::Waited } else { Timing::Unknown };
        let timing = timing.unwrap_or(guessed);
        FitOptions { window, noise, timing, always_loss, near }
    }
}

/// What is wrong so far.
struct Notes {
    faults: Faults,
}

impl Notes {
    fn refuse(&mut self, location: Location, refusal: &Refusal) {
        match self.faults.len() {
            0..FAULTS_MAX => self.faults.refuse(location, refusal as &dyn Complaint),
            FAULTS_MAX => self.faults.refuse(location, &Refusal::More { shown: FAULTS_MAX }),
            _ => {}
        }
    }

    fn is_full(&self) -> bool {
        self.faults.len() > FAULTS_MAX
    }
}

/// The lines of a text with their numbers, whatever ends them.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let end = if text.contains('\n') { '\n' } else { '\r' };
    let lines = text.split(end).map(|line| line.strip_suffix('\r').unwrap_or(line));
    lines.enumerate().map(|(index, line)| (index + 1, line))
}

/// The location of a byte of a line.
fn location(text: &str, line: usize, at: usize) -> Location {
    Location { line, column: 1 + text[..at].chars().count() }
}

/// An impedance, if it can have been measured.
fn measured(impedance_ohm: Complex64) -> Result<Complex64, Refusal> {
    let found = impedance_ohm.norm();
    let max = *IMPEDANCE_OHM.end();
    if found == 0.0 {
        Err(Refusal::ZeroImpedance)
    } else if found <= max {
        Ok(impedance_ohm)
    } else {
        Err(Refusal::OutOfRange { quantity: Quantity::Magnitude, found, min: 0.0, max })
    }
}

/// The impedance behind a reflection, in units of the reference.
fn behind(reflection: Complex64) -> Result<Complex64, Refusal> {
    if reflection == Complex64::ONE {
        Err(Refusal::OpenCircuit)
    } else {
        Ok((1.0 + reflection) / (1.0 - reflection))
    }
}

/// The impedance of an admittance.
fn inverse(admittance: Complex64) -> Result<Complex64, Refusal> {
    if admittance == Complex64::ZERO { Err(Refusal::ZeroAdmittance) } else { Ok(1.0 / admittance) }
}
