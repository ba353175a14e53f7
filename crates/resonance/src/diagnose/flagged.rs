//! Measurements that the analyzer aborted.

use rig_model::Reading;

use crate::{Reason, Refusal};

/// The refusal of a measurement whose last reading is flagged, because the analyzer failed at this
/// point in every try.
pub fn flagged(readings: &[Reading]) -> Option<Refusal> {
    let last = readings.last()?;
    let flag = last.flag()?;
    let tries = readings.iter().rev().take_while(|reading| reading.flag().is_some()).count();
    let reason = Reason::Flagged { flag, frequency_hz: last.frequency_hz, tries };
    Some(Refusal { reason, estimate: None })
}
