//! Touchstone with one port, as network analyzers export it.
//!
//! # Source
//! Touchstone File Format Specification, EIA/IBIS Open Forum, version 1.1: option line and defaults
//! p. 4–6; that Z and Y are divided by R and 1/R, p. 6. Version 2.0: the keywords, and
//! that Z and Y are not divided.

use std::collections::HashMap;

use num_complex::Complex64;
use rig_model::{Impedance, PointResult, Reading, RigTime};

use super::{
    FREQUENCY_HZ, FaultCollector, IMPEDANCE_OHM, LeftOut, LeftOutReason, READINGS_MAX,
    cells::{CsvCell, Separator, cells},
    fault::SweepFileFault,
    lines, location, measured,
    number::{Numbers, Value, excerpt, missing},
    of_admittance, of_reflection,
    quantity::Quantity,
};
use crate::Location;

/// The option line: the meaning of the numbers of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Options {
    hertz: f64,
    parameter: Parameter,
    format: Format,
    reference_ohm: f64,
    /// Whether Z and Y are in Ω and S, as in version 2, and not relative to the reference.
    is_absolute: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Parameter {
    Scattering,
    Impedance,
    Admittance,
}

/// The two parts of a complex number.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Format {
    RealImaginary,
    MagnitudeDegrees,
    DecibelDegrees,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            hertz: 1e9,
            parameter: Parameter::Scattering,
            format: Format::MagnitudeDegrees,
            reference_ohm: 50.0,
            is_absolute: false,
        }
    }
}

/// Whether a file is Touchstone: it has the name of one, or begins with an option line.
pub(super) fn is_it(name: &str, text: &str) -> bool {
    let name = name.to_ascii_lowercase();
    let is_named = name.rsplit_once(".s").is_some_and(|(_, rest)| {
        let ports = rest.strip_suffix('p').unwrap_or_default();
        !ports.is_empty() && ports.bytes().all(|byte| byte.is_ascii_digit())
    });
    let first = lines(text).map(|(_, line)| bare(line)).find(|line| !line.trim().is_empty());
    let is_option_line = |line: &str| {
        if line.trim_start().to_ascii_lowercase().starts_with("[version]") {
            return true;
        }
        let mut faults = FaultCollector::default();
        let is_bare = line.trim_start_matches([' ', '\t', '#']).is_empty();
        line.trim_start().starts_with('#')
            && !is_bare
            && Options::read(line, 1, &mut faults).is_some()
    };
    is_named || first.is_some_and(is_option_line)
}

/// Reads a file.
pub(super) fn read(text: &str, faults: &mut FaultCollector) -> (Vec<Reading>, Vec<LeftOut>) {
    let mut options = None;
    let mut second = Second::default();
    let mut readings: Vec<Reading> = Vec::new();
    let (mut left_out, mut first_lines) = (Vec::new(), HashMap::new());
    for (line, text) in lines(text) {
        let text = bare(text);
        let start = text.trim_start();
        if start.is_empty() {
            continue;
        }
        if faults.is_full() {
            break;
        }
        if start.starts_with('[') {
            if let Err(refusal) = second.take(start) {
                faults.refuse(Location { line, column: 1 }, refusal);
                break;
            }
            continue;
        }
        if second.is_skipped {
            continue;
        }
        if start.starts_with('#') {
            // Further option lines are ignored.
            if options.is_none() {
                let Some(found) = Options::read(text, line, faults) else { break };
                options = Some(found);
            }
            continue;
        }
        let mut options = *options.get_or_insert_default();
        options.is_absolute = second.is_in_use;
        options.reference_ohm = second.reference_ohm.unwrap_or(options.reference_ohm);
        // Quotation marks are not special here, and are not numbers.
        let cells = cells(text, Separator::Spaces).unwrap_or_default();
        if let Some(word) = cells.iter().find_map(|cell| missing(&cell.text)) {
            left_out.push(LeftOut { line, reason: LeftOutReason::NoNumber { word } });
            continue;
        }
        let Some((values, reading)) = options.row(&cells, line, text, faults) else { continue };
        let first_line = *first_lines.entry(values.map(f64::to_bits)).or_insert(line);
        if first_line == line {
            readings.push(reading);
        } else {
            left_out.push(LeftOut { line, reason: LeftOutReason::Repeated { first_line } });
        }
        if readings.len() > READINGS_MAX {
            let refusal = SweepFileFault::TooManyReadings { max: READINGS_MAX };
            faults.refuse(Location { line, column: 1 }, refusal);
            break;
        }
    }
    (readings, left_out)
}

/// The keywords of version 2.
#[derive(Debug, Default)]
struct Second {
    is_in_use: bool,
    reference_ohm: Option<f64>,
    /// Whether the lines are information, noise data, or behind the end.
    is_skipped: bool,
}

impl Second {
    /// Takes a line such as `[Reference] 50`.
    fn take(&mut self, line: &str) -> Result<(), SweepFileFault> {
        let Some((keyword, value)) = line[1..].split_once(']') else {
            return Err(SweepFileFault::UnknownKeyword { text: excerpt(line) });
        };
        let value = value.trim();
        match keyword.trim().to_ascii_lowercase().as_str() {
            "version" if matches!(value, "2.0" | "2.1") => self.is_in_use = true,
            "version" => return Err(SweepFileFault::LaterVersion),
            "number of ports" if value != "1" => {
                return Err(SweepFileFault::Ports { text: excerpt(value) });
            }
            "reference" => match value.parse::<f64>() {
                Ok(ohm) if ohm > 0.0 && IMPEDANCE_OHM.contains(&ohm) => {
                    self.reference_ohm = Some(ohm);
                }
                _ => return Err(SweepFileFault::NoReference { text: excerpt(value) }),
            },
            "begin information" | "noise data" | "end" => self.is_skipped = true,
            "end information" | "network data" => self.is_skipped = false,
            "number of ports"
            | "number of frequencies"
            | "number of noise frequencies"
            | "two-port order"
            | "two-port data order"
            | "matrix format" => {}
            _ => return Err(SweepFileFault::UnknownKeyword { text: excerpt(line) }),
        }
        Ok(())
    }
}

/// A line without its comment.
fn bare(line: &str) -> &str {
    line.split_once('!').map_or(line, |(bare, _)| bare)
}

impl Options {
    fn read(text: &str, line: usize, faults: &mut FaultCollector) -> Option<Self> {
        let mut options = Self::default();
        // A blank may be missing after the mark.
        let blank = text.replacen('#', " ", 1);
        let words = cells(&blank, Separator::Spaces).ok()?;
        let mut words = words.iter();
        let mut is_good = true;
        while let Some(word) = words.next() {
            let mut refuse = |refusal: SweepFileFault| {
                faults.refuse(location(text, line, word.at), refusal);
                is_good = false;
            };
            match word.text.to_ascii_uppercase().as_str() {
                "HZ" => options.hertz = 1.0,
                "KHZ" => options.hertz = 1e3,
                "MHZ" => options.hertz = 1e6,
                "GHZ" => options.hertz = 1e9,
                "S" => options.parameter = Parameter::Scattering,
                "Z" => options.parameter = Parameter::Impedance,
                "Y" => options.parameter = Parameter::Admittance,
                "G" | "H" => {
                    let name = if word.text.eq_ignore_ascii_case("g") { 'G' } else { 'H' };
                    refuse(SweepFileFault::NotOnePort { name });
                }
                "RI" => options.format = Format::RealImaginary,
                "MA" => options.format = Format::MagnitudeDegrees,
                "DB" => options.format = Format::DecibelDegrees,
                "R" => {
                    let text = words.next().map_or("", |word| &*word.text);
                    match text.parse::<f64>() {
                        Ok(ohm) if ohm > 0.0 && IMPEDANCE_OHM.contains(&ohm) => {
                            options.reference_ohm = ohm;
                        }
                        _ => refuse(SweepFileFault::NoReference { text: excerpt(text) }),
                    }
                }
                _ => refuse(SweepFileFault::UnknownOption { text: excerpt(&word.text) }),
            }
        }
        is_good.then_some(options)
    }

    fn row(
        &self,
        cells: &[CsvCell<'_>],
        line: usize,
        text: &str,
        faults: &mut FaultCollector,
    ) -> Option<([f64; 3], Reading)> {
        let [_, first, _] = cells else {
            let refusal = SweepFileFault::Numbers { found: cells.len() };
            faults.refuse(Location { line, column: 1 }, refusal);
            return None;
        };
        let mut numbers = [0.0; 3];
        let mut is_good = true;
        for (number, cell) in numbers.iter_mut().zip(cells) {
            match Numbers::default().read(&cell.text) {
                // A comma is not a decimal mark here.
                Ok(Value::Number(found)) if !cell.text.contains(',') => *number = found,
                _ => {
                    let refusal = SweepFileFault::NotANumber { text: excerpt(&cell.text) };
                    faults.refuse(location(text, line, cell.at), refusal);
                    is_good = false;
                }
            }
        }
        if !is_good {
            return None;
        }
        let [frequency, a, b] = numbers;
        let frequency_hz = frequency * self.hertz;
        if !FREQUENCY_HZ.contains(&frequency_hz) {
            let refusal = SweepFileFault::OutOfRange {
                quantity: Quantity::Frequency,
                found: frequency_hz,
                min: *FREQUENCY_HZ.start(),
                max: *FREQUENCY_HZ.end(),
            };
            faults.refuse(location(text, line, cells[0].at), refusal);
            return None;
        }
        match self.impedance_ohm(a, b) {
            Ok(impedance) => {
                let measured = PointResult::Value(Impedance {
                    resistance_ohm: impedance.re,
                    reactance_ohm: impedance.im,
                });
                let (started, settle_s, integration_s) = (RigTime::ZERO, 0.0, 0.0);
                let reading = Reading { frequency_hz, measured, started, settle_s, integration_s };
                Some((numbers, reading))
            }
            Err(refusal) => {
                faults.refuse(location(text, line, first.at), refusal);
                None
            }
        }
    }

    fn impedance_ohm(&self, a: f64, b: f64) -> Result<Complex64, SweepFileFault> {
        let value = match self.format {
            Format::RealImaginary => Complex64::new(a, b),
            Format::MagnitudeDegrees => Complex64::from_polar(a, b.to_radians()),
            Format::DecibelDegrees => Complex64::from_polar(10_f64.powf(a / 20.0), b.to_radians()),
        };
        let one = match self.parameter {
            Parameter::Scattering => of_reflection(value)?,
            Parameter::Admittance => of_admittance(value)?,
            Parameter::Impedance => value,
        };
        let is_relative = self.parameter == Parameter::Scattering || !self.is_absolute;
        measured(if is_relative { self.reference_ohm * one } else { one })
    }
}
