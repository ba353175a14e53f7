//! HIOKI's IM3536 LCR meter.
//!
//! One message after the other, and while it measures it listens but does nothing. Errors are told
//! in `*ESR?` only, and after an error the rest of the line is ignored. Frequency and level are
//! rounded to the steps of the front panel.
//!
//! # Source
//! HIOKI, IM3536 Communication Instruction Manual and Instruction Manual (specifications).

use rig_scpi::{
    AfterError, Call, Dialect, Ending, Limits, Node, Param, RealFormat, ScpiError, Tree, Unit,
    Value, command, query, setting,
};

use super::{Drive, Job, Memory, Model, Outcome, Point, Quantity, Reading, round_step};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Command {
    Averaging,
    DcBias,
    DelayTime,
    Frequency,
    Format,
    Item,
    Level,
    LevelVolt,
    Mode,
    OutputAuto,
    Parameter,
    Preset,
    Range,
    RangeAuto,
    Read,
    Reset,
    Speed,
    Trigger,
    TriggerSource,
    Valid,
}

const COMMANDS: &[Node<Command>] = &[
    command("*RST", Command::Reset),
    command("*TRG", Command::Trigger),
    setting(":AVERaging", Command::Averaging).asks(0, 0),
    setting(":DCBias", Command::DcBias).asks(0, 0),
    setting(":FORMat:DATA", Command::Format).asks(0, 0),
    setting(":FREQuency", Command::Frequency).asks(0, 0),
    setting(":LEVel", Command::Level).asks(0, 0),
    setting(":LEVel:VOLTage", Command::LevelVolt).asks(0, 0),
    query(":MEASure", Command::Read),
    setting(":MEASure:ITEM", Command::Item).takes(1, 3).asks(0, 0),
    setting(":MEASure:OUTPut:AUTO", Command::OutputAuto).asks(0, 0),
    setting(":MEASure:VALid", Command::Valid).asks(0, 0),
    setting(":MODE", Command::Mode).asks(0, 0),
    setting(":PARameter#", Command::Parameter).asks(0, 0),
    command(":PRESet", Command::Preset),
    setting(":RANGe", Command::Range).asks(0, 0),
    setting(":RANGe:AUTO", Command::RangeAuto).asks(0, 0),
    setting(":SPEEd", Command::Speed).asks(0, 0),
    setting(":TRIGger", Command::TriggerSource).asks(0, 0),
    setting(":TRIGger:DELay", Command::DelayTime).asks(0, 0),
];

/// What a parameter of the display may show.
const QUANTITIES: &[(&str, Quantity)] = &[
    ("OFF", Quantity::Off),
    ("Z", Quantity::Z),
    ("Y", Quantity::Y),
    ("PHASE", Quantity::PhaseDeg),
    ("RS", Quantity::Rs),
    ("RP", Quantity::Rp),
    ("X", Quantity::X),
    ("G", Quantity::G),
    ("B", Quantity::B),
    ("CS", Quantity::Cs),
    ("CP", Quantity::Cp),
    ("LS", Quantity::Ls),
    ("LP", Quantity::Lp),
    ("D", Quantity::D),
    ("Q", Quantity::Q),
];

/// The speeds, and how many cycles an average of one takes at each.
const SPEEDS: &[(&str, u32)] = &[("FAST", 1), ("MEDium", 5), ("SLOW", 20), ("SLOW2", 50)];

/// An IM3536, which is its settings.
#[derive(Debug, Clone)]
pub(crate) struct Hioki {
    frequency_hz: f64,
    level_v: f64,
    speed: usize,
    averages: u32,
    delay_s: f64,
    is_external: bool,
    is_output_auto: bool,
    valid: i64,
    item: [i64; 3],
    parameters: [Quantity; 4],
    range: i64,
    is_range_auto: bool,
}

impl Default for Hioki {
    fn default() -> Self {
        Self {
            frequency_hz: 1000.0,
            level_v: 1.0,
            speed: 1,
            averages: 1,
            delay_s: 0.0,
            is_external: false,
            is_output_auto: false,
            valid: 1,
            item: [0; 3],
            parameters: [Quantity::Z, Quantity::Off, Quantity::PhaseDeg, Quantity::Off],
            range: 1,
            is_range_auto: true,
        }
    }
}

/// The status of a measurement whose input was overloaded.
const OVERLOADED: i64 = 2;

const FREQUENCY: Limits = Limits { min: 4.0, max: 8e6, default: 1000.0 };
const LEVEL: Limits = Limits { min: 0.01, max: 5.0, default: 1.0 };
const DELAY: Limits = Limits { min: 0.0, max: 9.9999, default: 0.0 };
const RANGES: std::ops::RangeInclusive<i64> = 1..=10;

/// What five digits of frequency leave: 10 mHz below 1 kHz.
const DIGITS_OF_FREQUENCY: i32 = 5;

impl Model for Hioki {
    type Command = Command;

    fn commands() -> Tree<Command> {
        Tree::new(COMMANDS).expect("the commands are constants, and a test builds them")
    }

    fn dialect() -> Dialect {
        Dialect {
            ending: Ending::CrLf,
            input_limit_bytes: 1024,
            after_error: AfterError::SkipMessage,
            headers: Some(false),
            real_format: RealFormat::Scientific { n_decimals: 5, n_exponent: 2, has_plus: false },
            ..Dialect::common_only("HIOKI,IM3536,190512345,V1.21")
        }
    }

    fn carry_out(
        &mut self,
        call: &Call<Command>,
        memory: Memory<'_>,
    ) -> Result<Outcome, ScpiError> {
        match call.command {
            Command::Trigger if self.is_external => Ok(self.measure(self.is_output_auto)),
            // Ignored while the instrument triggers itself.
            Command::Trigger => Err(ScpiError::new(-211)),
            Command::Read if !self.is_external => Ok(self.measure(true)),
            Command::Read if memory.readings.is_empty() => Err(ScpiError::new(-230)),
            Command::Read => Ok(Outcome::Done(self.answer(memory.readings))),
            Command::Reset | Command::Preset => {
                *self = Self::default();
                Ok(Outcome::Done(Vec::new()))
            }
            _ if call.is_query => self.ask(call).map(|value| Outcome::Done(vec![value])),
            _ => self.set(call).map(|()| Outcome::Done(Vec::new())),
        }
    }

    fn drive(&self) -> Drive {
        Drive { frequency_hz: self.frequency_hz, level_v: self.level_v }
    }

    /// The status first, unless it was switched off, and then what the display shows.
    fn answer(&self, readings: &[Reading]) -> Vec<Value> {
        let Some(reading) = readings.first() else { return Vec::new() };
        let status = if reading.impedance_ohm.is_none() { OVERLOADED } else { 0 };
        let status = (self.valid != 0).then_some(Value::Integer(status));
        let shown = self.parameters.iter().filter(|shown| **shown != Quantity::Off);
        status.into_iter().chain(shown.map(|shown| field(*shown, reading))).collect()
    }
}

/// A value with the digits of the display.
fn field(shown: Quantity, reading: &Reading) -> Value {
    let Some(impedance_ohm) = reading.impedance_ohm else {
        return Value::Verbatim("**********".into());
    };
    let value = shown.of(impedance_ohm, reading.frequency_hz);
    match shown {
        Quantity::PhaseDeg => Value::Formatted(value, RealFormat::Fixed { n_decimals: 3 }),
        _ => Value::Real(value),
    }
}

impl Hioki {
    fn measure(&self, is_answered: bool) -> Outcome {
        let cycles = SPEEDS[self.speed].1 * self.averages;
        let point = Point { frequency_hz: self.frequency_hz, delay_s: self.delay_s, cycles };
        Outcome::Measure(Job { points: [point].into(), is_blocking: true, is_answered })
    }

    fn set(&mut self, call: &Call<Command>) -> Result<(), ScpiError> {
        let s = self;
        let value = call.param(0)?;
        match call.command {
            Command::Frequency => {
                s.frequency_hz = round_digits(value.real(Unit::HERTZ, FREQUENCY)?);
            }
            Command::LevelVolt => s.level_v = round_step(value.real(Unit::VOLT, LEVEL)?, 1e-3),
            Command::DelayTime => s.delay_s = round_step(value.real(Unit::SECOND, DELAY)?, 1e-4),
            Command::Averaging => s.averages = averages(value)?,
            Command::Speed => {
                let words: [(&str, usize); 4] = std::array::from_fn(|i| (SPEEDS[i].0, i));
                s.speed = value.choice(&words)?;
            }
            Command::TriggerSource => {
                s.is_external = value.choice(&[("INTernal", false), ("EXTernal", true)])?;
            }
            Command::Parameter => {
                let shown = value.choice(QUANTITIES)?;
                *parameter(s, call)? = shown;
            }
            Command::OutputAuto => s.is_output_auto = value.boolean()?,
            Command::Valid => s.valid = value.integer(0..=255)?,
            Command::Item => {
                for (index, item) in s.item.iter_mut().enumerate().take(call.params.len()) {
                    *item = call.param(index)?.integer(0..=255)?;
                }
            }
            Command::Range => {
                s.range = value.integer(RANGES)?;
                s.is_range_auto = false;
            }
            Command::RangeAuto => s.is_range_auto = value.boolean()?,
            // The simulated terminals are driven by voltage, without bias, and text is answered.
            Command::Level => value.choice(&[("V", ())])?,
            Command::Mode => value.choice(&[("LCR", ())])?,
            Command::Format => value.choice(&[("ASCii", ())])?,
            Command::DcBias if !value.boolean()? => {}
            Command::DcBias => return Err(ScpiError::new(-221)),
            Command::Preset | Command::Read | Command::Reset | Command::Trigger => {}
        }
        Ok(())
    }

    fn ask(&mut self, call: &Call<Command>) -> Result<Value, ScpiError> {
        let word = |word: &str| Value::Verbatim(word.to_ascii_uppercase().into());
        let switch = |is_on: bool| word(if is_on { "ON" } else { "OFF" });
        let scientific = |value, n_decimals| {
            let format = RealFormat::Scientific { n_decimals, n_exponent: 2, has_plus: false };
            Value::Formatted(value, format)
        };
        let s = self;
        Ok(match call.command {
            Command::Frequency => scientific(s.frequency_hz, 4),
            Command::LevelVolt => Value::Formatted(s.level_v, RealFormat::Fixed { n_decimals: 3 }),
            Command::DelayTime => Value::Formatted(s.delay_s, RealFormat::Fixed { n_decimals: 4 }),
            Command::Averaging => Value::Integer(s.averages.into()),
            Command::Speed => word(SPEEDS[s.speed].0),
            Command::TriggerSource => word(if s.is_external { "EXTERNAL" } else { "INTERNAL" }),
            Command::Parameter => {
                let shown = *parameter(s, call)?;
                let known = QUANTITIES.iter().find(|entry| entry.1 == shown);
                word(known.expect("every quantity has a word").0)
            }
            Command::OutputAuto => switch(s.is_output_auto),
            Command::Valid => Value::Integer(s.valid),
            Command::Item => {
                let [a, b, c] = s.item;
                Value::Verbatim(format!("{a},{b},{c}").into())
            }
            Command::Range => Value::Integer(s.range),
            Command::RangeAuto => switch(s.is_range_auto),
            Command::Level => word("V"),
            Command::Mode => word("LCR"),
            Command::Format => word("ASCII"),
            Command::DcBias => switch(false),
            Command::Preset | Command::Read | Command::Reset | Command::Trigger => {
                return Err(ScpiError::new(-113));
            }
        })
    }
}

/// `:AVERaging OFF` is an average of one.
fn averages(value: &Param) -> Result<u32, ScpiError> {
    if let Ok(()) = value.choice(&[("OFF", ())]) {
        return Ok(1);
    }
    let averages = value.integer(1..=256)?;
    Ok(u32::try_from(averages).expect("it is at most 256"))
}

fn parameter<'a>(
    settings: &'a mut Hioki,
    call: &Call<Command>,
) -> Result<&'a mut Quantity, ScpiError> {
    let index = usize::try_from(call.suffix(0)).unwrap_or(usize::MAX).wrapping_sub(1);
    settings.parameters.get_mut(index).ok_or(ScpiError::new(-114))
}

/// Rounds to the digits that the front panel has for a frequency.
fn round_digits(frequency_hz: f64) -> f64 {
    // Below 1 kHz the point does not move: 100.00 Hz, but also 4.00 Hz.
    let exponent = frequency_hz.log10().floor().max(2.0);
    let step = 10_f64.powf(exponent - f64::from(DIGITS_OF_FREQUENCY) + 1.0);
    round_step(frequency_hz, step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::meter::bench;

    type Bench = bench::Bench<Hioki>;

    const SET_UP: &str = "*RST;:MODE LCR;:TRIGger EXTernal;:SPEEd FAST;:AVERaging 10;\
        :PARameter1 RS;:PARameter3 X;:MEASure:VALid 0;:LEVel V;:LEVel:VOLTage 5";

    #[test]
    fn every_command_has_its_place_in_the_tree() {
        assert!(Tree::new(COMMANDS).is_ok());
    }

    #[test]
    fn a_settled_measurement_is_the_impedance_of_the_circuit_to_six_digits() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(SET_UP), "");
        let before = bench.now;
        let line = bench.say(":FREQuency 139.998;:TRIGger:DELay 3;*TRG;:MEASure?");
        // 3 s of delay and ten cycles at the 140.00 Hz that the panel makes of it.
        assert_eq!(bench.now.since(before).as_micros(), 3_071_429);
        let fields: Vec<f64> = line.trim_end().split(',').map(|x| x.parse().unwrap()).collect();
        let expected = bench.settled_ohm(140.0);
        assert!((fields[0] / expected.re - 1.0).abs() < 1e-5, "{line} {expected}");
        assert!((fields[1] / expected.im - 1.0).abs() < 1e-5, "{line} {expected}");
        assert_eq!(bench.say("*ESR?"), "128\r\n", "power on, and no error");
    }

    #[test]
    fn a_reading_taken_too_early_remembers_the_frequency_before() {
        let mut bench = Bench::new();
        bench.say(SET_UP);
        bench.say(":AVERaging 1");
        let early = bench.say(":FREQuency 140;*TRG;:MEASure?");
        let late = bench.say(":TRIGger:DELay 2;*TRG;:MEASure?");
        assert_ne!(early, late);
    }

    #[test]
    fn settings_are_answered_in_long_words_and_with_their_headers_when_asked_for() {
        let mut bench = Bench::new();
        bench.say(SET_UP);
        bench.say(":FREQuency 140.406;:LEVel:VOLTage 1.00049");
        let rows = [
            (":FREQuency?", "1.4041E+02\r\n"),
            (":LEVel?;:LEVel:VOLTage?", "V;1.000\r\n"),
            (":SPEEd?;:AVERaging?", "FAST;10\r\n"),
            (":TRIGger?;:TRIGger:DELay?", "EXTERNAL;0.0000\r\n"),
            (":PARameter1?;:PARameter2?;:PAR3?", "RS;OFF;X\r\n"),
            (":HEADer ON;:FREQuency?;:HEADer OFF", ":FREQUENCY 1.4041E+02\r\n"),
            ("*IDN?", "HIOKI,IM3536,190512345,V1.21\r\n"),
            (":MEASure:ITEM 31,31,0;:MEASure:ITEM?", "31,31,0\r\n"),
        ];
        for (line, answer) in rows {
            assert_eq!(bench.say(line), answer, "{line}");
        }
    }

    #[test]
    fn errors_are_told_in_the_event_register_only_and_end_the_line() {
        let mut bench = Bench::new();
        bench.say("*CLS");
        let rows = [
            (":FREQuency 1;:AVERaging 7", "16\r\n"),
            (":LEVel:VOLTage 5.1", "16\r\n"),
            (":FREQency 200", "32\r\n"),
            (":PARameter5 Z", "32\r\n"),
            (":FREQuency", "32\r\n"),
            (":SYSTem:ERRor?", "32\r\n"),
            ("*TRG", "16\r\n"),
            (":AVERaging 256", "0\r\n"),
        ];
        for (line, event) in rows {
            assert_eq!(bench.say(line), "", "{line}");
            assert_eq!(bench.say("*ESR?"), event, "{line}");
        }
        assert_eq!(bench.say(":FREQuency?;:AVERaging?"), "1.0000E+03;256\r\n");
    }

    #[test]
    fn it_listens_while_it_measures_and_answers_afterwards() {
        let mut bench = Bench::new();
        bench.say(SET_UP);
        bench.say(":FREQuency 100");
        let before = bench.now;
        bench.send("*TRG\r\n:FREQuency 200\r\n:FREQuency?");
        assert_eq!(bench.heard(), "");
        assert_eq!(bench.meter.deadline().unwrap().since(before).as_micros(), 100_000);
        assert_eq!(bench.say(""), "2.0000E+02\r\n");
    }

    #[test]
    fn a_trigger_answers_by_itself_when_told_to_and_status_and_overload_show() {
        let mut bench = Bench::new();
        bench.say(SET_UP);
        bench.say(":MEASure:OUTPut:AUTO ON;:MEASure:VALid 1;:FREQuency 140;:TRIGger:DELay 5");
        let answer = bench.say("*TRG");
        assert!(answer.starts_with("0,") && answer.matches(',').count() == 2, "{answer}");
        assert_eq!(bench.say(":MEASure?"), answer);
        bench.meter.overload();
        assert_eq!(bench.say("*TRG"), "2,**********,**********\r\n");
        assert_eq!(bench.say("*TRG"), answer);
    }

    #[test]
    fn a_restart_forgets_the_settings_and_says_so() {
        let mut bench = Bench::new();
        bench.say(SET_UP);
        bench.say("*CLS");
        bench.meter.restart(bench.now, &mut bench.world);
        assert_eq!(bench.say("*ESR?;:AVERaging?"), "128;1\r\n");
    }
}
