//! HIOKI's IM3536 LCR meter.
//!
//! One message after the other, and while it measures it listens but does nothing. Errors are told
//! in `*ESR?` only, and after an error the rest of the line is ignored. Frequency and level are
//! rounded to the steps of the front panel.
//!
//! # Source
//! HIOKI, IM3536 Communication Instruction Manual and Instruction Manual (specifications).

use std::time::Duration;

use num_complex::Complex64;
use rig_model::RigTime;
use rig_scpi::{
    AfterError, Call, Dialect, Ending, Instrument, Limits, Node, RealFormat, ScpiError, Tree, Unit,
    Value, command, query, setting,
};

use super::outbox::Outbox;
use crate::world::World;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Command {
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

/// What a parameter of the display shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Quantity {
    Off,
    Z,
    Y,
    Phase,
    Rs,
    Rp,
    X,
    G,
    B,
    Cs,
    Cp,
    Ls,
    Lp,
    D,
    Q,
}

const QUANTITIES: &[(&str, Quantity)] = &[
    ("OFF", Quantity::Off),
    ("Z", Quantity::Z),
    ("Y", Quantity::Y),
    ("PHASE", Quantity::Phase),
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

impl Quantity {
    /// The value for an impedance at a frequency, in the units of the display.
    fn of(self, impedance_ohm: Complex64, frequency_hz: f64) -> f64 {
        let omega = std::f64::consts::TAU * frequency_hz;
        let admittance = impedance_ohm.inv();
        match self {
            Self::Off => 0.0,
            Self::Z => impedance_ohm.norm(),
            Self::Y => admittance.norm(),
            Self::Phase => impedance_ohm.arg().to_degrees(),
            Self::Rs => impedance_ohm.re,
            Self::Rp => 1.0 / admittance.re,
            Self::X => impedance_ohm.im,
            Self::G => admittance.re,
            Self::B => admittance.im,
            Self::Cs => -1.0 / (omega * impedance_ohm.im),
            Self::Cp => admittance.im / omega,
            Self::Ls => impedance_ohm.im / omega,
            Self::Lp => -1.0 / (omega * admittance.im),
            Self::D => impedance_ohm.re / impedance_ohm.im.abs(),
            Self::Q => impedance_ohm.im.abs() / impedance_ohm.re,
        }
    }

    /// The value with the digits of the instrument.
    fn write(self, reading: &Reading) -> Value {
        let Some(impedance_ohm) = reading.impedance_ohm else {
            return Value::Verbatim("**********".into());
        };
        let value = self.of(impedance_ohm, reading.frequency_hz);
        match self {
            Self::Phase => Value::Formatted(value, RealFormat::Fixed { n_decimals: 3 }),
            _ => Value::Real(value),
        }
    }
}

/// The words of a setting and what they mean, written as the instrument answers them.
const SPEEDS: &[(&str, u32)] = &[("FAST", 1), ("MEDium", 5), ("SLOW", 20), ("SLOW2", 50)];

/// Whole cycles that an average of one takes at each speed are the second entries above.
#[derive(Debug, Clone)]
struct Settings {
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

impl Default for Settings {
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
            parameters: [Quantity::Z, Quantity::Off, Quantity::Phase, Quantity::Off],
            range: 1,
            is_range_auto: true,
        }
    }
}

/// A finished measurement.
#[derive(Debug, Clone, Copy)]
struct Reading {
    frequency_hz: f64,
    /// `None` when the input was overloaded.
    impedance_ohm: Option<Complex64>,
}

#[derive(Debug, Clone, Copy)]
enum State {
    Idle,
    /// Waits out the trigger delay.
    Waiting {
        until: RigTime,
        is_answered: bool,
    },
    /// Integrates.
    Measuring {
        until: RigTime,
        reading: Reading,
        is_answered: bool,
    },
}

/// An IM3536.
#[derive(Debug)]
pub struct Hioki {
    instrument: Instrument<Command>,
    settings: Settings,
    state: State,
    last: Option<Reading>,
    /// How long the instrument takes over a command.
    per_command: Duration,
    /// When it is done with the last command.
    free_at: RigTime,
    outbox: Outbox,
    overloads: u32,
}

/// The status of a measurement whose input was overloaded.
const OVERLOADED: i64 = 2;

const FREQUENCY: Limits = Limits { min: 4.0, max: 8e6, default: 1000.0 };
const LEVEL: Limits = Limits { min: 0.01, max: 5.0, default: 1.0 };
const DELAY: Limits = Limits { min: 0.0, max: 9.9999, default: 0.0 };
const RANGES: std::ops::RangeInclusive<i64> = 1..=10;

/// What five digits of frequency leave: 10 mHz below 1 kHz.
const DIGITS_OF_FREQUENCY: i32 = 5;

impl Hioki {
    /// An instrument that was just switched on and drives its terminals.
    pub fn new(identity: &str, per_command: Duration) -> Self {
        let dialect = Dialect {
            ending: Ending::CrLf,
            input_limit_bytes: 1024,
            after_error: AfterError::SkipMessage,
            headers: Some(false),
            real_format: RealFormat::Scientific { n_decimals: 5, n_exponent: 2, has_plus: false },
            ..Dialect::common_only(identity)
        };
        Self {
            instrument: Instrument::new(tree(), dialect),
            settings: Settings::default(),
            state: State::Idle,
            last: None,
            per_command,
            free_at: RigTime::ZERO,
            outbox: Outbox::default(),
            overloads: 0,
        }
    }

    /// Takes bytes that came at `now`.
    pub fn push(&mut self, now: RigTime, bytes: &[u8], world: &mut World) {
        self.instrument.push(bytes);
        self.advance(now, world);
    }

    /// When something will happen without further bytes.
    pub fn deadline(&self) -> Option<RigTime> {
        let state = match self.state {
            State::Idle => None,
            State::Waiting { until, .. } | State::Measuring { until, .. } => Some(until),
        };
        [state, self.outbox.deadline()].into_iter().flatten().min()
    }

    /// What has been said by `now`.
    pub fn poll(&mut self, now: RigTime, world: &mut World) -> Vec<u8> {
        self.advance(now, world);
        self.outbox.poll(now)
    }

    /// The next `readings` measurements are overloaded.
    pub fn overload(&mut self, readings: u32) {
        self.overloads = readings;
    }

    /// Switches the instrument off and on again.
    pub fn restart(&mut self, now: RigTime, world: &mut World) {
        let identity = self.instrument.dialect().identity.clone();
        *self = Self { free_at: now, ..Self::new(&identity, self.per_command) };
        self.apply_drive(now, 1.0, world);
    }

    fn advance(&mut self, now: RigTime, world: &mut World) {
        loop {
            match self.state {
                State::Waiting { until, is_answered } if until <= now => {
                    self.begin_integration(until, is_answered, world);
                }
                State::Measuring { until, reading, is_answered } if until <= now => {
                    self.state = State::Idle;
                    self.free_at = until;
                    self.last = Some(reading);
                    let values = if is_answered { self.fields(&reading) } else { Vec::new() };
                    self.answer(until, Ok(values));
                }
                State::Waiting { .. } | State::Measuring { .. } => return,
                State::Idle => {
                    let Some(call) = self.instrument.poll() else {
                        self.collect(now.max(self.free_at));
                        return;
                    };
                    // Within a message the instrument is ahead of the wire by the little time that
                    // its commands take.
                    self.free_at = self.free_at.max(now) + self.per_command;
                    let at = self.free_at;
                    if let Some(answer) = self.carry_out(at, &call, world) {
                        self.answer(at, answer);
                    }
                }
            }
        }
    }

    fn answer(&mut self, at: RigTime, answer: Result<Vec<Value>, ScpiError>) {
        self.instrument.answer(answer);
        self.collect(at);
    }

    /// Sends what the instrument has finished saying.
    fn collect(&mut self, at: RigTime) {
        let bytes = self.instrument.take_output();
        if !bytes.is_empty() {
            self.outbox.push(at, bytes);
        }
    }

    /// Does what a command says. `None` when that takes time and is answered later.
    fn carry_out(
        &mut self,
        at: RigTime,
        call: &Call<Command>,
        world: &mut World,
    ) -> Option<Result<Vec<Value>, ScpiError>> {
        match call.command {
            Command::Trigger if self.settings.is_external => {
                self.begin_measurement(at, self.settings.is_output_auto, world);
                return None;
            }
            // Ignored while the instrument triggers itself.
            Command::Trigger => return Some(Err(ScpiError::new(-211))),
            Command::Read if !self.settings.is_external => {
                self.begin_measurement(at, true, world);
                return None;
            }
            Command::Read => {
                let reading = self.last.ok_or(ScpiError::new(-230));
                return Some(reading.map(|reading| self.fields(&reading)));
            }
            Command::Reset | Command::Preset => {
                self.settings = Settings::default();
                self.last = None;
                self.apply_drive(at, self.settings.level_v, world);
                return Some(Ok(Vec::new()));
            }
            _ => {}
        }
        if call.is_query {
            return Some(self.ask(call).map(|value| vec![value]));
        }
        let (frequency_hz, level_v) = (self.settings.frequency_hz, self.settings.level_v);
        let outcome = self.set(call);
        if (frequency_hz, level_v) != (self.settings.frequency_hz, self.settings.level_v) {
            self.apply_drive(at, self.settings.level_v / level_v, world);
        }
        Some(outcome.map(|()| Vec::new()))
    }

    fn apply_drive(&mut self, at: RigTime, factor: f64, world: &mut World) {
        world.set_frequency(at, self.settings.frequency_hz);
        world.scale_drive(at, factor);
    }

    fn begin_measurement(&mut self, at: RigTime, is_answered: bool, world: &mut World) {
        if self.settings.delay_s == 0.0 {
            self.begin_integration(at, is_answered, world);
        } else {
            let until = at + Duration::from_secs_f64(self.settings.delay_s);
            self.state = State::Waiting { until, is_answered };
        }
    }

    fn begin_integration(&mut self, at: RigTime, is_answered: bool, world: &mut World) {
        let cycles = SPEEDS[self.settings.speed].1 * self.settings.averages;
        let (impedance_ohm, until) = world.measure(at, cycles);
        let is_overloaded = self.overloads > 0;
        self.overloads = self.overloads.saturating_sub(1);
        let impedance_ohm = (!is_overloaded).then_some(impedance_ohm);
        let reading = Reading { frequency_hz: self.settings.frequency_hz, impedance_ohm };
        self.state = State::Measuring { until, reading, is_answered };
    }

    /// The fields of a reading: the status first, unless it was switched off.
    fn fields(&self, reading: &Reading) -> Vec<Value> {
        let status = if reading.impedance_ohm.is_none() { OVERLOADED } else { 0 };
        let status = (self.settings.valid != 0).then_some(Value::Integer(status));
        let shown = self.settings.parameters.iter().filter(|shown| **shown != Quantity::Off);
        status.into_iter().chain(shown.map(|shown| shown.write(reading))).collect()
    }

    fn set(&mut self, call: &Call<Command>) -> Result<(), ScpiError> {
        let s = &mut self.settings;
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
        let s = &mut self.settings;
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

fn tree() -> Tree<Command> {
    Tree::new(COMMANDS).expect("the commands are constants, and a test builds them")
}

/// `:AVERaging OFF` is an average of one.
fn averages(value: &rig_scpi::Param) -> Result<u32, ScpiError> {
    if let Ok(()) = value.choice(&[("OFF", ())]) {
        return Ok(1);
    }
    let averages = value.integer(1..=256)?;
    Ok(u32::try_from(averages).expect("it is at most 256"))
}

fn parameter<'a>(
    settings: &'a mut Settings,
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

/// Rounds to a multiple of a power of ten, to the float that is nearest to the decimal.
fn round_step(value: f64, step: f64) -> f64 {
    let per_unit = (1.0 / step).round();
    if per_unit >= 1.0 {
        (value * per_unit).round() / per_unit
    } else {
        (value / step).round() * step
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        scene::paper,
        world::{Nuisances, Scene},
    };

    struct Bench {
        meter: Hioki,
        world: World,
        now: RigTime,
    }

    impl Bench {
        fn new() -> Self {
            let scene = Scene { nuisances: Nuisances::NONE, ..paper() };
            let world = World::new(scene, 1).unwrap();
            let meter = Hioki::new("HIOKI,IM3536,0,V1", Duration::ZERO);
            Self { meter, world, now: RigTime::ZERO }
        }

        /// Sends a line and waits until nothing more will happen.
        fn say(&mut self, line: &str) -> String {
            let bytes = format!("{line}\r\n").into_bytes();
            self.meter.push(self.now, &bytes, &mut self.world);
            let mut said = self.meter.poll(self.now, &mut self.world);
            while let Some(deadline) = self.meter.deadline() {
                self.now = deadline;
                said.extend(self.meter.poll(deadline, &mut self.world));
            }
            String::from_utf8(said).unwrap()
        }
    }

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
        let mut world = World::new(bench.world.scene().clone(), 1).unwrap();
        world.set_frequency(RigTime::ZERO, 140.0);
        let expected = world.measure(RigTime::from_micros(10_000_000), 1).0;
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
            ("*IDN?", "HIOKI,IM3536,0,V1\r\n"),
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
        bench.meter.push(bench.now, b"*TRG\r\n:FREQuency 200\r\n:FREQuency?\r\n", &mut bench.world);
        assert!(bench.meter.poll(bench.now, &mut bench.world).is_empty());
        let done = bench.meter.deadline().unwrap();
        assert_eq!(done.since(bench.now).as_micros(), 100_000);
        assert_eq!(bench.meter.poll(done, &mut bench.world), b"2.0000E+02\r\n");
    }

    #[test]
    fn a_trigger_answers_by_itself_when_told_to_and_status_and_overload_show() {
        let mut bench = Bench::new();
        bench.say(SET_UP);
        bench.say(":MEASure:OUTPut:AUTO ON;:MEASure:VALid 1;:FREQuency 140;:TRIGger:DELay 5");
        let answer = bench.say("*TRG");
        assert!(answer.starts_with("0,") && answer.matches(',').count() == 2, "{answer}");
        assert_eq!(bench.say(":MEASure?"), answer);
        bench.meter.overload(1);
        assert_eq!(bench.say("*TRG"), "2,**********,**********\r\n");
        assert_eq!(bench.say("*TRG"), answer);
    }

    #[test]
    fn all_quantities_agree_with_each_other() {
        let impedance = Complex64::new(3.0, -4.0);
        let value = |quantity: Quantity| quantity.of(impedance, 1.0 / std::f64::consts::TAU);
        let rows = [
            (Quantity::Z, 5.0),
            (Quantity::Phase, -53.130_102_354_155_98),
            (Quantity::Y, 0.2),
            (Quantity::Rs, 3.0),
            (Quantity::X, -4.0),
            (Quantity::Cs, 0.25),
            (Quantity::G, 0.12),
            (Quantity::B, 0.16),
            (Quantity::Rp, 25.0 / 3.0),
            (Quantity::Cp, 0.16),
            (Quantity::Ls, -4.0),
            (Quantity::Lp, -6.25),
            (Quantity::D, 0.75),
            (Quantity::Q, 4.0 / 3.0),
        ];
        for (quantity, expected) in rows {
            assert!((value(quantity) - expected).abs() < 1e-12, "{quantity:?}");
        }
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
