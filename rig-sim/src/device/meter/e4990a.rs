//! Keysight's E4990A impedance analyzer, which sweeps a trace and drives at most 1 V.
//!
//! # Source
//! Keysight, E4990A Help, Programming: command reference.

use rig_scpi::{
    Call, Dialect, ErrorFormat, Limits, Node, RealFormat, ScpiError, Tree, Unit, Value, command,
    query, setting,
};

use super::{Drive, Job, Memory, Model, Outcome, Point, Quantity, Reading};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Command {
    Abort,
    Alc,
    Aperture,
    Average,
    AverageCount,
    Center,
    Continuous,
    Define,
    FormattedData,
    Frequencies,
    Init,
    Format,
    Mode,
    ParameterCount,
    PointDelay,
    Points,
    Reset,
    Select,
    Source,
    Span,
    Start,
    Stop,
    SweepType,
    Trigger,
    Volt,
}

const COMMANDS: &[Node<Command>] = &[
    command("*RST", Command::Reset),
    command("*TRG", Command::Trigger),
    command(":ABORt", Command::Abort),
    query(":CALCulate#[:SELected]:DATA:FDATa", Command::FormattedData),
    setting(":CALCulate#:PARameter:COUNt", Command::ParameterCount).asks(0, 0),
    setting(":CALCulate#:PARameter#:DEFine", Command::Define).asks(0, 0),
    command(":CALCulate#:PARameter#:SELect", Command::Select),
    setting(":FORMat:DATA", Command::Format).asks(0, 0),
    command(":INITiate#[:IMMediate]", Command::Init),
    setting(":INITiate#:CONTinuous", Command::Continuous).asks(0, 0),
    setting(":SENSe#:APERture[:TIME]", Command::Aperture).asks(0, 0),
    setting(":SENSe#:AVERage[:STATe]", Command::Average).asks(0, 0),
    setting(":SENSe#:AVERage:COUNt", Command::AverageCount).asks(0, 0),
    setting(":SENSe#:FREQuency:CENTer", Command::Center),
    query(":SENSe#:FREQuency:DATA", Command::Frequencies),
    setting(":SENSe#:FREQuency:SPAN", Command::Span),
    setting(":SENSe#:FREQuency:STARt", Command::Start),
    setting(":SENSe#:FREQuency:STOP", Command::Stop),
    setting(":SENSe#:SWEep:DELay", Command::PointDelay),
    setting(":SENSe#:SWEep:POINts", Command::Points),
    setting(":SENSe#:SWEep:TYPE", Command::SweepType).asks(0, 0),
    setting(":SOURce#:ALC[:STATe]", Command::Alc).asks(0, 0),
    setting(":SOURce#:MODE", Command::Mode).asks(0, 0),
    setting(":SOURce#:VOLTage[:LEVel]", Command::Volt),
    command(":SYSTem:PRESet", Command::Reset),
    setting(":TRIGger[:SEQuence]:SOURce", Command::Source).asks(0, 0),
    command(":TRIGger[:SEQuence]:SINGle", Command::Trigger),
    command(":TRIGger[:SEQuence][:IMMediate]", Command::Trigger),
];

const QUANTITIES: &[(&str, Quantity)] = &[
    ("Z", Quantity::Z),
    ("Y", Quantity::Y),
    ("R", Quantity::Rs),
    ("X", Quantity::X),
    ("G", Quantity::G),
    ("B", Quantity::B),
    ("LS", Quantity::Ls),
    ("LP", Quantity::Lp),
    ("CS", Quantity::Cs),
    ("CP", Quantity::Cp),
    ("RS", Quantity::Rs),
    ("RP", Quantity::Rp),
    ("Q", Quantity::Q),
    ("D", Quantity::D),
    ("TZ", Quantity::PhaseDeg),
    ("TY", Quantity::AdmittancePhaseDeg),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    Internal,
    External,
    Manual,
    Bus,
}

const SOURCES: &[(&str, Source)] = &[
    ("INTernal", Source::Internal),
    ("EXTernal", Source::External),
    ("MANual", Source::Manual),
    ("BUS", Source::Bus),
];

/// Whole cycles integrated at each of the five apertures. The manual gives times for some
/// frequencies only; these double from one to the next as those do.
const CYCLES: [u32; 5] = [1, 2, 4, 8, 16];

/// An E4990A, which is its settings.
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the front panel")]
#[derive(Debug, Clone)]
pub(crate) struct E4990a {
    start_hz: f64,
    stop_hz: f64,
    points: u32,
    is_logarithmic: bool,
    point_delay_s: f64,
    level_v: f64,
    has_alc: bool,
    aperture: usize,
    averages: u32,
    has_averaging: bool,
    source: Source,
    is_continuous: bool,
    /// One sweep was armed while sweeps are not continuous.
    is_armed: bool,
    traces: u32,
    parameters: [Quantity; 4],
    selected: usize,
}

impl Default for E4990a {
    fn default() -> Self {
        Self {
            start_hz: 20.0,
            stop_hz: 120e6,
            points: 201,
            is_logarithmic: false,
            point_delay_s: 0.0,
            level_v: 0.5,
            has_alc: false,
            aperture: 1,
            averages: 1,
            has_averaging: false,
            source: Source::Internal,
            is_continuous: true,
            is_armed: false,
            traces: 2,
            parameters: [Quantity::Z, Quantity::PhaseDeg, Quantity::Rs, Quantity::X],
            selected: 0,
        }
    }
}

const FREQUENCY: Limits = Limits { min: 20.0, max: 120e6, default: 20.0 };
const LEVEL: Limits = Limits { min: 0.005, max: 1.0, default: 0.5 };
const DELAY: Limits = Limits { min: 0.0, max: 30.0, default: 0.0 };
const POINTS: std::ops::RangeInclusive<i64> = 2..=1601;

/// The value of a point that could not be measured, as the instrument prints it.
const INVALID: &str = "1.#QNB";

impl Model for E4990a {
    type Command = Command;

    fn commands() -> Tree<Command> {
        Tree::new(COMMANDS).expect("the commands are constants, and a test builds them")
    }

    fn dialect() -> Dialect {
        Dialect {
            error_format: ErrorFormat { has_plus: true, has_info: false },
            real_format: RealFormat::Scientific { n_decimals: 11, n_exponent: 3, has_plus: true },
            ..Dialect::standard("Keysight Technologies,E4990A,MY54100123,A.02.13")
        }
    }

    fn carry_out(
        &mut self,
        call: &Call<Command>,
        memory: Memory<'_>,
    ) -> Result<Outcome, ScpiError> {
        match call.command {
            Command::Reset => {
                *self = Self::default();
                Ok(Outcome::Abort)
            }
            Command::Abort => Ok(Outcome::Abort),
            Command::Init => {
                self.is_armed = true;
                Ok(Outcome::Done(Vec::new()))
            }
            Command::Trigger if !(self.is_continuous || self.is_armed) => Err(ScpiError::new(-211)),
            Command::Trigger if self.source == Source::Internal => Err(ScpiError::new(-211)),
            Command::Trigger => {
                self.is_armed = false;
                let points = self.points();
                Ok(Outcome::Measure(Job { points, is_blocking: false, is_answered: false }))
            }
            Command::FormattedData => Ok(Outcome::Done(self.answer(memory.readings))),
            Command::Select => {
                self.selected = self.parameter(call)?;
                Ok(Outcome::Done(Vec::new()))
            }
            Command::Frequencies => {
                let frequencies = self.points();
                let values = frequencies.iter().map(|point| Value::Real(point.frequency_hz));
                Ok(Outcome::Done(values.collect()))
            }
            // A change of the source ends a sweep that is under way.
            Command::Source if !call.is_query => self.set(call).map(|()| Outcome::Abort),
            _ if call.is_query => self.ask(call).map(|value| Outcome::Done(vec![value])),
            _ => self.set(call).map(|()| Outcome::Done(Vec::new())),
        }
    }

    fn drive(&self) -> Drive {
        Drive { frequency_hz: self.start_hz, level_v: self.level_v }
    }

    /// Two numbers for each point of the selected trace; the second is zero.
    fn answer(&self, readings: &[Reading]) -> Vec<Value> {
        let quantity = self.parameters[self.selected];
        readings
            .iter()
            .flat_map(|reading| {
                let value = reading.impedance_ohm.map_or_else(
                    || Value::Verbatim(INVALID.into()),
                    |z| Value::Real(quantity.of(z, reading.frequency_hz)),
                );
                [value, Value::Real(0.0)]
            })
            .collect()
    }
}

impl E4990a {
    fn points(&self) -> std::collections::VecDeque<Point> {
        let averages = if self.has_averaging { self.averages } else { 1 };
        let cycles = CYCLES[self.aperture] * averages;
        (0..self.points)
            .map(|index| {
                let part = f64::from(index) / f64::from(self.points - 1);
                let frequency_hz = if self.is_logarithmic {
                    self.start_hz * (self.stop_hz / self.start_hz).powf(part)
                } else {
                    self.start_hz + (self.stop_hz - self.start_hz) * part
                };
                Point { frequency_hz, delay_s: self.point_delay_s, cycles }
            })
            .collect()
    }

    fn parameter(&self, call: &Call<Command>) -> Result<usize, ScpiError> {
        let index = usize::try_from(call.suffix(1)).unwrap_or(usize::MAX).wrapping_sub(1);
        if index < self.parameters.len() { Ok(index) } else { Err(ScpiError::new(-114)) }
    }

    fn set(&mut self, call: &Call<Command>) -> Result<(), ScpiError> {
        let value = call.param(0)?;
        let whole = |range| -> Result<u32, ScpiError> {
            u32::try_from(value.integer(range)?).map_err(|_| ScpiError::new(-222))
        };
        match call.command {
            Command::Start => self.start_hz = value.real(Unit::HERTZ, FREQUENCY)?,
            Command::Stop => self.stop_hz = value.real(Unit::HERTZ, FREQUENCY)?,
            Command::Center => {
                let half_hz = 0.5 * (self.stop_hz - self.start_hz);
                let center_hz = value.real(Unit::HERTZ, FREQUENCY)?;
                self.window(center_hz, half_hz);
            }
            Command::Span => {
                let limits = Limits { min: 0.0, ..FREQUENCY };
                let half_hz = 0.5 * value.real(Unit::HERTZ, limits)?;
                self.window(0.5 * (self.start_hz + self.stop_hz), half_hz);
            }
            Command::Points => self.points = whole(POINTS)?,
            Command::SweepType => {
                self.is_logarithmic = value.choice(&[("LINear", false), ("LOGarithmic", true)])?;
            }
            Command::PointDelay => self.point_delay_s = value.real(Unit::SECOND, DELAY)?,
            Command::Volt => self.level_v = value.real(Unit::VOLT, LEVEL)?,
            Command::Alc => self.has_alc = value.boolean()?,
            Command::Aperture => self.aperture = whole(1..=5)? as usize - 1,
            Command::Average => self.has_averaging = value.boolean()?,
            Command::AverageCount => self.averages = whole(1..=999)?,
            Command::Source => self.source = value.choice(SOURCES)?,
            Command::Continuous => self.is_continuous = value.boolean()?,
            Command::ParameterCount => self.traces = whole(1..=4)?,
            Command::Define => {
                let index = self.parameter(call)?;
                self.parameters[index] = value.choice(QUANTITIES)?;
            }
            Command::Mode => value.choice(&[("VOLTage", ())])?,
            Command::Format => value.choice(&[("ASCii", ())])?,
            _ => return Err(ScpiError::new(-113)),
        }
        Ok(())
    }

    fn window(&mut self, center_hz: f64, half_hz: f64) {
        self.start_hz = (center_hz - half_hz).max(FREQUENCY.min);
        self.stop_hz = (center_hz + half_hz).min(FREQUENCY.max);
    }

    fn ask(&self, call: &Call<Command>) -> Result<Value, ScpiError> {
        let limited = |present: f64, unit: Unit, limits: Limits| {
            let asked = call.params.first().map(|word| word.real(unit, limits)).transpose()?;
            Ok(Value::Real(asked.unwrap_or(present)))
        };
        Ok(match call.command {
            Command::Start => return limited(self.start_hz, Unit::HERTZ, FREQUENCY),
            Command::Stop => return limited(self.stop_hz, Unit::HERTZ, FREQUENCY),
            Command::Center => Value::Real(0.5 * (self.start_hz + self.stop_hz)),
            Command::Span => Value::Real(self.stop_hz - self.start_hz),
            Command::Points => Value::Integer(self.points.into()),
            Command::SweepType => {
                Value::Characters(if self.is_logarithmic { "LOG" } else { "LIN" })
            }
            Command::PointDelay => return limited(self.point_delay_s, Unit::SECOND, DELAY),
            Command::Volt => return limited(self.level_v, Unit::VOLT, LEVEL),
            Command::Alc => Value::Boolean(self.has_alc),
            Command::Aperture => Value::Integer(i64::try_from(self.aperture + 1).unwrap_or(1)),
            Command::Average => Value::Boolean(self.has_averaging),
            Command::AverageCount => Value::Integer(self.averages.into()),
            Command::Source => {
                let known = SOURCES.iter().find(|entry| entry.1 == self.source);
                Value::Characters(known.expect("every source has a word").0)
            }
            Command::Continuous => Value::Boolean(self.is_continuous),
            Command::ParameterCount => Value::Integer(self.traces.into()),
            Command::Define => {
                let shown = self.parameters[self.parameter(call)?];
                let known = QUANTITIES.iter().find(|entry| entry.1 == shown);
                Value::Characters(known.expect("every quantity has a word").0)
            }
            Command::Mode => Value::Characters("VOLT"),
            Command::Format => Value::Characters("ASC"),
            _ => return Err(ScpiError::new(-113)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::meter::bench;

    type Bench = bench::Bench<E4990a>;

    const SET_UP: &str = ":SYST:PRES;:SENS1:FREQ:STAR 120;STOP 160;:SENS1:SWE:POIN 5;DEL 3;\
        :SOUR1:MODE VOLT;VOLT 1;:CALC1:PAR:COUN 2;:CALC1:PAR1:DEF R;:CALC1:PAR2:DEF X;\
        :TRIG:SOUR BUS;:INIT1:CONT ON";

    #[test]
    fn every_command_has_its_place_in_the_tree() {
        assert!(Tree::new(COMMANDS).is_ok());
    }

    #[test]
    fn a_sweep_is_waited_for_and_read_trace_by_trace() {
        let mut bench = Bench::new();
        bench.say(SET_UP);
        bench.send(":TRIG:SING");
        bench.send("*OPC?");
        assert_eq!(bench.heard(), "", "the sweep is under way");
        assert_eq!(bench.say(""), "1\n");
        // Five delays, and two cycles at each of five frequencies.
        let cycles_s: f64 = [120.0, 130.0, 140.0, 150.0, 160.0].iter().map(|hz| 2.0 / hz).sum();
        assert!((bench.now.as_seconds() - 15.0 - cycles_s).abs() < 1e-5, "{}", bench.now);
        let numbers = |line: String| -> Vec<f64> {
            line.trim_end().split(',').map(|field| field.parse().unwrap()).collect()
        };
        assert_eq!(numbers(bench.say(":SENS1:FREQ:DATA?")), [120.0, 130.0, 140.0, 150.0, 160.0]);
        let r = numbers(bench.say(":CALC1:PAR1:SEL;:CALC1:DATA:FDAT?"));
        let x = numbers(bench.say(":CALC1:PAR2:SEL;:CALC1:DATA:FDAT?"));
        let expected = bench.settled_ohm(140.0);
        assert_eq!((r.len(), r[5], x[5]), (10, 0.0, 0.0));
        assert!((r[4] / expected.re - 1.0).abs() < 1e-6 && (x[4] / expected.im - 1.0).abs() < 1e-6);
        assert_eq!(bench.say("SYST:ERR?"), "+0,\"No error\"\n");
    }

    #[test]
    fn a_second_trigger_does_not_disturb_the_sweep() {
        let mut bench = Bench::new();
        bench.say(SET_UP);
        bench.send(":TRIG:SING");
        let until = bench.meter.deadline();
        bench.send(":TRIG:SING;:SYST:ERR?");
        assert!(bench.heard().starts_with("-211"));
        assert_eq!(bench.meter.deadline(), until);
        assert_eq!(bench.say(":CALC1:DATA:FDAT?;*OPC?"), "1\n");
        assert_eq!(bench.say(":CALC1:DATA:FDAT?").split(',').count(), 10);
    }

    #[test]
    fn a_change_of_the_trigger_source_ends_the_sweep() {
        let mut bench = Bench::new();
        bench.say(SET_UP);
        bench.send(":TRIG:SING;:TRIG:SOUR BUS;*OPC?");
        assert_eq!(bench.heard(), "1\n");
        assert_eq!(bench.meter.deadline(), None);
    }

    #[test]
    fn what_cannot_be_is_told_and_a_bad_point_is_no_number() {
        let mut bench = Bench::new();
        bench.say(SET_UP);
        let rows = [
            (":SOUR1:VOLT 5", "-222"),
            (":SENS1:FREQ:STAR 10", "-222"),
            (":INIT1:CONT OFF;:TRIG:SING", "-211"),
            (":CALC1:PAR9:DEF Z", "-114"),
        ];
        for (line, number) in rows {
            assert_eq!(bench.say(line), "", "{line}");
            let told = bench.say("SYST:ERR?");
            assert!(told.starts_with(number), "{line}: {told}");
        }
        bench.meter.overload();
        bench.say(":INIT1;:TRIG:SING");
        let line = bench.say(":CALC1:DATA:FDAT?");
        assert!(line.starts_with("1.#QNB,+0.00000000000E+000,+"), "{line}");
    }
}
