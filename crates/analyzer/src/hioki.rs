//! The commands of the `IM35xx` series. Everything here is text in and text out.
//!
//! There is no error queue: errors show only as bits of `*ESR?`. A message that contains an error
//! is not carried out beyond it, so that a query behind it stays without an answer.

use rig_model::{DriveLevel, ReadingFlag, SweepPoint};

use crate::answer::{Impedance, real};

/// One trigger averages at most so many measurements, each of one cycle at the speed FAST.
pub(crate) const AVERAGES_MAX: u32 = 256;

/// What a measurement at a level needs, once.
pub(crate) fn setup(level: DriveLevel) -> Vec<String> {
    vec![
        ":MODE LCR".to_owned(),
        ":PARameter1 RS;:PARameter2 X;:PARameter3 OFF;:PARameter4 OFF".to_owned(),
        ":TRIGger EXTernal;:SPEEd FAST;:RANGe:AUTO ON".to_owned(),
        format!(":LEVel V;:LEVel:VOLTage {}", level.volt),
    ]
}

/// Asks for the level.
pub(crate) const LEVEL_QUERY: &str = ":LEVel:VOLTage?";

/// The settings of a point that differ from those before it.
pub(crate) fn settings(point: &SweepPoint, before: Option<&SweepPoint>) -> Vec<String> {
    let mut units = Vec::with_capacity(3);
    let is_new = |same: fn(&SweepPoint, &SweepPoint) -> bool| {
        before.is_none_or(|before| !same(before, point))
    };
    if is_new(|a, b| a.frequency_hz == b.frequency_hz) {
        units.push(format!(":FREQuency {:.2}", point.frequency_hz));
    }
    if is_new(|a, b| a.cycles == b.cycles) {
        units.push(format!(":AVERaging {}", point.cycles));
    }
    if is_new(|a, b| a.settle_s == b.settle_s) {
        units.push(format!(":TRIGger:DELay {:.4}", point.settle_s));
    }
    units
}

/// Measures once, and answers when that is done.
pub(crate) const TRIGGER: &str = "*TRG;:MEASure?";

/// Asks for the frequency.
pub(crate) const FREQUENCY_QUERY: &str = ":FREQuency?";

/// What a good answer to the trigger looks like.
pub(crate) const READING: &str = "status, resistance in ohm, reactance in ohm";

/// Reads the answer to the trigger: a status, series resistance and reactance in ohm. A value that
/// could not be measured is a row of asterisks.
pub(crate) fn reading(answer: &str) -> Option<Impedance> {
    let fields: Vec<&str> = answer.split(',').map(str::trim).collect();
    let [status, resistance, reactance] = fields[..] else { return None };
    let flag = match status.parse::<i32>().ok()? {
        0 => ReadingFlag::Normal,
        1 => ReadingFlag::LowSignal,
        _ => ReadingFlag::Overload,
    };
    if resistance.contains('*') || reactance.contains('*') {
        return Some(Impedance::overloaded());
    }
    let (resistance_ohm, reactance_ohm) = (real(resistance)?, real(reactance)?);
    Some(Impedance { resistance_ohm, reactance_ohm, flag })
}
