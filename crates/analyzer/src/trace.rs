//! The commands of the E4990A, which measures a trace of evenly spaced frequencies at a time.

use rig_model::{DriveLevel, PointResult, SweepPoint};
use rig_scpi::{DataError, Datum};

use crate::{message::Message, point::measured};

/// The longest delay before each point, s.
pub(crate) const DELAY_MAX_S: f64 = 30.0;

/// The most measurements that are averaged at each point.
pub(crate) const AVERAGES_MAX: u32 = 999;

/// The most points of a trace.
const POINTS_MAX: usize = 1601;

/// A trace is not interrupted, so that it must not take longer than a stop may wait, s.
const TRACE_MAX_S: f64 = 2.0;

pub(crate) const LEVEL: &str = ":SOURce1:VOLTage";

/// The settings of measurements at a level.
pub(crate) fn setup(level: DriveLevel) -> Vec<Message> {
    vec![
        Message::new().command(":SYSTem:PRESet"),
        Message::new()
            .choose(":SOURce1:MODE", "VOLT")
            .set(LEVEL, level.volt)
            .choose(":SOURce1:ALC", "OFF"),
        Message::new()
            .set(":CALCulate1:PARameter:COUNt", 2.0)
            .choose(":CALCulate1:PARameter1:DEFine", "R")
            .choose(":CALCulate1:PARameter2:DEFine", "X"),
        Message::new()
            .choose(":SENSe1:SWEep:TYPE", "LINear")
            // The shortest aperture: about one cycle at these frequencies.
            .set(":SENSe1:APERture", 1.0)
            .choose(":SENSe1:AVERage", "ON"),
        Message::new()
            .choose(":FORMat:DATA", "ASCii")
            .choose(":TRIGger:SOURce", "BUS")
            .choose(":INITiate1:CONTinuous", "ON"),
    ]
}

/// A trace: evenly spaced frequencies, each measured in the same way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Trace {
    pub(crate) start_hz: f64,
    pub(crate) stop_hz: f64,
    pub(crate) points: usize,
    pub(crate) delay_s: f64,
    pub(crate) averages: u32,
    /// Whether the last of its points alone is asked for.
    pub(crate) is_last_alone: bool,
}

impl Trace {
    /// The longest trace that can be made of the first points, and how many these are. A single
    /// point is a trace of two points at the same frequency. If it waits for longer than a measurement, the first of them
    /// is a part of this wait.
    pub(crate) fn first_of(points: &[SweepPoint], resolution_hz: f64) -> (Self, usize) {
        let first = points[0];
        let is_alike =
            |point: &SweepPoint| point.settle_s == first.settle_s && point.cycles == first.cycles;
        let step_hz = points.get(1).map_or(0.0, |second| second.frequency_hz - first.frequency_hz);
        let is_even = |(n, point): &(usize, &SweepPoint)| {
            let expected_hz = first.frequency_hz + *n as f64 * step_hz;
            is_alike(point) && (point.frequency_hz - expected_hz).abs() <= 0.5 * resolution_hz
        };
        let fits = |(n, point): &(usize, &SweepPoint)| {
            *n < POINTS_MAX && (*n + 1) as f64 * point.duration_s() <= TRACE_MAX_S
        };
        let run = points.iter().enumerate().take_while(is_even).take_while(fits).count().max(1);
        let averages = first.cycles.max(1);
        let rest_s = first.settle_s - f64::from(averages) / first.frequency_hz;
        let is_last_alone = run == 1 && 0.0 < rest_s;
        let trace = Self {
            start_hz: first.frequency_hz,
            stop_hz: points[run - 1].frequency_hz,
            points: run.max(2),
            delay_s: if is_last_alone { 0.5 * rest_s } else { first.settle_s },
            averages,
            is_last_alone,
        };
        (trace, run)
    }

    /// The frequencies, Hz.
    pub(crate) fn frequencies_hz(&self) -> impl Iterator<Item = f64> {
        let step_hz = (self.stop_hz - self.start_hz) / (self.points - 1) as f64;
        (0..self.points).map(move |n| self.start_hz + n as f64 * step_hz)
    }

    /// The delays and the cycles of all points, s.
    pub(crate) fn duration_s(&self) -> f64 {
        self.frequencies_hz().map(|hz| self.delay_s + f64::from(self.averages) / hz).sum()
    }

    pub(crate) fn settings(&self, message: Message) -> Message {
        message
            .set(":SENSe1:FREQuency:STARt", self.start_hz)
            .set(":SENSe1:FREQuency:STOP", self.stop_hz)
            .set(":SENSe1:SWEep:POINts", self.points as f64)
            .set(":SENSe1:SWEep:DELay", self.delay_s)
            .set(":SENSe1:AVERage:COUNt", self.averages.into())
    }

    /// Adds the trigger, and asks when the sweep is over.
    pub(crate) fn trigger(message: Message) -> Message {
        message.command(":TRIGger:SINGle").query("*OPC")
    }
}

/// Asks for the frequencies.
pub(crate) fn frequencies(message: Message) -> Message {
    message.query(":SENSe1:FREQuency:DATA")
}

/// Asks for the resistances.
pub(crate) fn resistances(message: Message) -> Message {
    message.command(":CALCulate1:PARameter1:SELect").query(":CALCulate1:DATA:FDATa")
}

/// Asks for the reactances.
pub(crate) fn reactances(message: Message) -> Message {
    message.command(":CALCulate1:PARameter2:SELect").query(":CALCulate1:DATA:FDATa")
}

/// Reads both traces: two numbers for each point, of which the second is zero.
pub(crate) fn readings(
    resistances: &[Datum],
    reactances: &[Datum],
    points: usize,
) -> Result<Vec<PointResult>, DataError> {
    for trace in [resistances, reactances] {
        if trace.len() != 2 * points {
            return Err(DataError::FieldCount { expected: 2 * points, found: trace.len() });
        }
    }
    let pairs = resistances.iter().step_by(2).zip(reactances.iter().step_by(2));
    pairs.map(|(r, x)| measured(r, x, None)).collect()
}

#[cfg(test)]
mod tests {
    use rig_model::Impedance;

    use super::*;

    fn points(frequencies_hz: &[f64]) -> Vec<SweepPoint> {
        let point = |&frequency_hz: &f64| SweepPoint { frequency_hz, settle_s: 0.0, cycles: 2 };
        frequencies_hz.iter().map(point).collect()
    }

    #[test]
    fn points_are_taken_together_as_far_as_they_are_evenly_spaced() {
        let check = |frequencies_hz: &[f64], expected: (f64, f64, usize), run: usize| {
            let (trace, found) = Trace::first_of(&points(frequencies_hz), 0.001);
            assert_eq!((trace.start_hz, trace.stop_hz, trace.points), expected);
            assert_eq!(found, run, "{frequencies_hz:?}");
        };
        check(&[100.0], (100.0, 100.0, 2), 1);
        check(&[100.0, 110.0, 120.0, 135.0], (100.0, 120.0, 3), 3);
        check(&[100.0, 90.0, 80.0], (100.0, 80.0, 3), 3);
        check(&[100.0, 100.0, 101.0], (100.0, 100.0, 2), 2);
        check(&[100.0, 110.0, 121.0], (100.0, 110.0, 2), 2);
        let mut mixed = points(&[100.0, 110.0, 120.0]);
        mixed[2].cycles = 3;
        assert_eq!(Trace::first_of(&mixed, 0.001).1, 2);
        // Twenty cycles at 100 Hz take 0.2 s, so that ten points are as many as a stop may wait.
        let mut slow = points(&[100.0; 30]);
        for point in &mut slow {
            point.cycles = 20;
        }
        assert_eq!(Trace::first_of(&slow, 0.001).1, 10);
    }

    #[test]
    fn both_traces_have_two_numbers_a_point() {
        let pair = |value| [Datum::Real(value), Datum::Real(0.0)];
        let resistances = [pair(1.0), pair(2.0)].concat();
        let reactances = [pair(-3.0), [Datum::Missing, Datum::Real(0.0)]].concat();
        let found = readings(&resistances, &reactances, 2).unwrap();
        let value = Impedance { resistance_ohm: 1.0, reactance_ohm: -3.0 };
        assert_eq!(found, [PointResult::Value(value), PointResult::Overload]);
        let error = readings(&resistances[..3], &reactances, 2).unwrap_err();
        assert_eq!(error, DataError::FieldCount { expected: 4, found: 3 });
    }
}
