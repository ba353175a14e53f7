//! What the readings of a measurement say when the analyzer flags some of them.
//!
//! Each point asked for has a value in the end, perhaps behind readings that were flagged and
//! repeated. When its last try is flagged too, the analyzer has given up: the points behind it were
//! not measured.

use rig_model::{Measured, Reading};
use rig_resonance::{Reason, Refusal};

/// Why a measurement gave up, when its last reading is flagged.
pub fn flagged(readings: &[Reading]) -> Option<Refusal> {
    let last = readings.last()?;
    let flag = last.flag()?;
    let tries = readings.iter().rev().take_while(|reading| reading.flag().is_some()).count();
    let reason = Reason::Flagged { flag, frequency_hz: last.frequency_hz, tries };
    Some(Refusal { reason, estimate: None })
}

/// The readings by which the analyzer stands.
pub(crate) fn values(readings: &[Reading]) -> impl Iterator<Item = &Reading> {
    readings.iter().filter(|reading| matches!(reading.measured, Measured::Value(_)))
}
