//! The commands of the `IM35xx` series.
//!
//! There is no error queue: errors show only as bits of `*ESR?`. A message that contains an error
//! is not carried out beyond it, so that a query behind it stays without an answer.

use rig_model::{DriveLevel, PointResult, ReadingFlag};
use rig_scpi::{DataError, Datum};

use crate::{
    message::Message,
    point::{Integration, TriggerSettings, measured},
};

/// The longest trigger delay, s.
pub(crate) const DELAY_MAX_S: f64 = 9.9999;

/// Largest number of measurements that one trigger averages, each of one cycle at the speed FAST.
const AVERAGES_MAX: u32 = 256;

pub(crate) const LEVEL: &str = ":LEVel:VOLTage";
pub(crate) const FREQUENCY: &str = ":FREQuency";

/// The settings of measurements at a level.
pub(crate) fn setup(level: DriveLevel) -> Vec<Message> {
    vec![
        Message::new()
            .choose(":MODE", "LCR")
            .choose(":PARameter1", "RS")
            .choose(":PARameter2", "X")
            .choose(":PARameter3", "OFF")
            .choose(":PARameter4", "OFF"),
        Message::new()
            .set(":MEASure:VALid", 1.0)
            .choose(":TRIGger", "EXTernal")
            .choose(":SPEEd", "FAST")
            .choose(":RANGe:AUTO", "ON"),
        Message::new().choose(":LEVel", "V").set(LEVEL, level.volt),
    ]
}

pub(crate) fn integration(cycles: u32) -> Integration {
    Integration::new(cycles, 1, AVERAGES_MAX)
}

/// Adds the settings of a shot that differ from those before it.
pub(crate) fn settings(
    mut message: Message,
    wanted: &TriggerSettings,
    before: Option<&TriggerSettings>,
) -> Message {
    if before.is_none_or(|before| before.frequency_hz != wanted.frequency_hz) {
        message = message.set(FREQUENCY, wanted.frequency_hz);
    }
    if before.is_none_or(|before| before.averages != wanted.averages) {
        message = message.set(":AVERaging", wanted.averages.into());
    }
    if before.is_none_or(|before| before.delay_s != wanted.delay_s) {
        message = message.set(":TRIGger:DELay", wanted.delay_s);
    }
    message
}

/// Adds the trigger and the query of its measurement.
pub(crate) fn trigger(message: Message) -> Message {
    message.command("*TRG").query(":MEASure")
}

/// Reads a status, resistance and reactance. A value that could not be measured is a row of
/// asterisks.
pub(crate) fn reading(data: &[Datum]) -> Result<PointResult, DataError> {
    let [status, resistance, reactance] = data else {
        return Err(DataError::FieldCount { expected: 3, found: data.len() });
    };
    let flag = match status.integer()? {
        0 => None,
        1 => Some(ReadingFlag::LowSignal),
        _ => Some(ReadingFlag::Overload),
    };
    measured(resistance, reactance, flag)
}
