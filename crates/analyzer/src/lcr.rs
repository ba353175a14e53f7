//! The commands of the HP 4284A and of those that follow it.

use rig_model::{DriveLevel, PointResult, ReadingFlag};
use rig_scpi::{DataError, Datum};

use crate::{
    message::Message,
    point::{Integration, TriggerSettings, measured},
};

/// The longest trigger delay, s.
pub(crate) const DELAY_MAX_S: f64 = 999.0;

/// The same, of the older ones.
pub(crate) const OLD_DELAY_MAX_S: f64 = 60.0;

const AVERAGES_MAX: u32 = 256;

pub(crate) const LEVEL: &str = ":VOLTage";
pub(crate) const FREQUENCY: &str = ":FREQuency";

/// The differences within the family.
#[derive(Debug)]
pub(crate) struct LcrVariant {
    /// The command for the delay between trigger and measurement.
    delay: &'static str,
    /// Commands that only this one has.
    extra: &'static [(&'static str, &'static str)],
    /// Measurement times of the short aperture, s, by frequency, Hz.
    short_s: &'static [(f64, f64)],
}

/// Keysight, E4980A data sheet, measurement time.
pub(crate) static E4980A: LcrVariant = LcrVariant {
    delay: ":TRIGger:TDELay",
    extra: &[(":FORMat:ASCii:LONG", "ON")],
    short_s: &[(20.0, 0.330), (100.0, 0.100), (1e3, 0.020), (1e4, 0.0077)],
};

/// HP, 4284A Operation Manual, measurement time.
pub(crate) static HP_4284A: LcrVariant = LcrVariant {
    delay: ":TRIGger:DELay",
    extra: &[],
    short_s: &[(20.0, 0.350), (100.0, 0.270), (1e3, 0.040), (1e4, 0.030)],
};

/// The manual gives 13 measurements a second above 1 kHz; below, a few cycles.
pub(crate) static TH283X: LcrVariant = LcrVariant {
    delay: ":TRIGger:DELay",
    extra: &[],
    short_s: &[(20.0, 0.350), (100.0, 0.270), (1e3, 0.040), (1e4, 0.030)],
};

/// The settings of a measurement at a level. `high_power` is the command that switches it on.
pub(crate) fn setup(
    level: DriveLevel,
    variant: &LcrVariant,
    high_power: Option<&'static str>,
) -> Vec<Message> {
    let mut output = Message::new();
    if let Some(switch) = high_power {
        output = output.choose(switch, "ON");
    }
    let format = Message::new().choose(":FORMat", "ASCii");
    let format =
        variant.extra.iter().fold(format, |message, (header, word)| message.choose(header, word));
    vec![
        Message::new()
            .choose(":DISPlay:PAGE", "MEASurement")
            .choose(":FUNCtion:IMPedance", "RX")
            .choose(":FUNCtion:IMPedance:RANGe:AUTO", "ON")
            .choose(":COMParator", "OFF"),
        format,
        Message::new().choose(":TRIGger:SOURce", "BUS").choose(":INITiate:CONTinuous", "ON"),
        output.choose(":BIAS:STATe", "OFF").set(LEVEL, level.volt),
    ]
}

pub(crate) fn integration(cycles: u32, frequency_hz: f64, variant: &LcrVariant) -> Integration {
    Integration::new(cycles, whole_cycles(frequency_hz, variant.short_s), AVERAGES_MAX)
}

/// The whole cycles that fit in the measurement time at this frequency; the manuals print it at
/// some frequencies, and it goes in straight lines between them on logarithmic scales.
fn whole_cycles(frequency_hz: f64, times: &[(f64, f64)]) -> u32 {
    let pairs = || times.windows(2);
    let pair = pairs().find(|pair| frequency_hz <= pair[1].0).or_else(|| pairs().last());
    let Some([(low_hz, low_s), (high_hz, high_s)]) = pair else { return 1 };
    let share = ((frequency_hz / low_hz).ln() / (high_hz / low_hz).ln()).clamp(0.0, 1.0);
    let time_s = low_s.powf(1.0 - share) * high_s.powf(share);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it is positive")]
    let cycles = (time_s * frequency_hz).floor() as u32;
    cycles.max(1)
}

/// Adds the settings of a shot that differ from those before it.
pub(crate) fn settings(
    mut message: Message,
    wanted: &TriggerSettings,
    before: Option<&TriggerSettings>,
    variant: &LcrVariant,
) -> Message {
    if before.is_none_or(|before| before.frequency_hz != wanted.frequency_hz) {
        message = message.set(FREQUENCY, wanted.frequency_hz);
    }
    if before.is_none_or(|before| before.averages != wanted.averages) {
        message = message.choose(":APERture", "SHORt").number(wanted.averages.into());
    }
    if before.is_none_or(|before| before.delay_s != wanted.delay_s) {
        message = message.set(variant.delay, wanted.delay_s);
    }
    message
}

/// Adds the trigger and the query of its measurement.
pub(crate) fn trigger(message: Message) -> Message {
    message.command(":TRIGger").query(FETCH)
}

/// Asks for the last measurement.
pub(crate) const FETCH: &str = ":FETCh";

/// Reads resistance, reactance, status, and the bin where the comparator is on. `None` while the
/// measurement is under way.
pub(crate) fn reading(data: &[Datum]) -> Result<Option<PointResult>, DataError> {
    let ([resistance, reactance, status] | [resistance, reactance, status, _]) = data else {
        return Err(DataError::FieldCount { expected: 3, found: data.len() });
    };
    let flag = match status.integer()? {
        -1 => return Ok(None),
        0 => None,
        1 => Some(ReadingFlag::Overload),
        // The source is overloaded, or the level could not be held: not at the requested level.
        _ => Some(ReadingFlag::LowSignal),
    };
    measured(resistance, reactance, flag).map(Some)
}

#[cfg(test)]
mod tests {
    use rig_model::Impedance;

    use super::*;

    #[test]
    fn whole_cycles_follow_the_measurement_times() {
        let cycles = |frequency_hz| whole_cycles(frequency_hz, E4980A.short_s);
        assert_eq!([cycles(20.0), cycles(100.0), cycles(1000.0)], [6, 10, 20]);
        assert_eq!([cycles(140.0), cycles(300.0)], [11, 13]);
        assert_eq!(cycles(2e6), 15_400);
    }

    #[test]
    fn the_status_says_whether_there_is_a_value() {
        let data = |status| [Datum::Real(1.0), Datum::Real(2.0), Datum::Integer(status)];
        let value = Impedance { resistance_ohm: 1.0, reactance_ohm: 2.0 };
        let read = |status| reading(&data(status)).unwrap();
        assert_eq!(read(-1), None);
        assert_eq!(read(0), Some(PointResult::Value(value)));
        assert_eq!(read(1), Some(PointResult::Overload));
        assert_eq!(read(4), Some(PointResult::LowSignal(value)));
        assert!(reading(&data(0)[..2]).is_err());
    }
}
