//! The HP 4284A and the LCR meters that follow it: Keysight's E4980A and Tonghui's `TH283x`.
//!
//! A trigger measures once, or once at every frequency of the list when the list page is shown. The
//! answer is two values and a status, in fixed widths; a list adds a fourth field to each point.
//!
//! # Source
//! Keysight, E4980A/AL User's Guide: `FETCh?` and its data format (p. 183, 261, 265); measurement
//! times and frequency resolution as in the E4980A data sheet. HP, 4284A Operation Manual.

use std::{fmt, marker::PhantomData};

use rig_scpi::{
    Call, Dialect, ErrorFormat, Limits, Node, Param, RealFormat, ScpiError, Tree, Unit, Value,
    command, query, setting,
};

use super::{Drive, Job, Memory, Model, Outcome, Point, Quantity, Reading, round_step};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Command {
    Abort,
    Alc,
    Aperture,
    Bias,
    Comparator,
    Continuous,
    Correction,
    Fetch,
    FetchImpedance,
    FetchVolt,
    Format,
    Frequency,
    Function,
    HighPower,
    Init,
    List,
    ListMode,
    LongDigits,
    Options,
    Page,
    RangeAuto,
    Reset,
    Source,
    StepDelay,
    Trigger,
    TriggerAndRead,
    TriggerDelay,
    Volt,
}

const COMMANDS: &[Node<Command>] = &[
    query("*OPT", Command::Options),
    command("*RST", Command::Reset),
    command("*TRG", Command::TriggerAndRead),
    command(":ABORt", Command::Abort),
    setting(":AMPLitude:ALC", Command::Alc).asks(0, 0),
    setting(":APERture", Command::Aperture).takes(1, 2).asks(0, 0),
    setting(":BIAS:STATe", Command::Bias).asks(0, 0),
    setting(":COMParator[:STATe]", Command::Comparator).asks(0, 0),
    setting(":CORRection:OPEN:STATe", Command::Correction).asks(0, 0),
    setting(":CORRection:SHORt:STATe", Command::Correction).asks(0, 0),
    setting(":DISPlay:PAGE", Command::Page).asks(0, 0),
    query(":FETCh[:IMPedance][:FORMatted]", Command::Fetch),
    query(":FETCh[:IMPedance]:CORRected", Command::FetchImpedance),
    query(":FETCh:SMONitor:VAC", Command::FetchVolt),
    setting(":FORMat[:DATA]", Command::Format).asks(0, 0),
    setting(":FORMat:ASCii:LONG", Command::LongDigits).asks(0, 0),
    setting(":FREQuency[:CW]", Command::Frequency),
    setting(":FUNCtion:IMPedance[:TYPE]", Command::Function).asks(0, 0),
    setting(":FUNCtion:IMPedance:RANGe:AUTO", Command::RangeAuto).asks(0, 0),
    setting(":OUTPut:HPOWer", Command::HighPower).asks(0, 0),
    command(":INITiate[:IMMediate]", Command::Init),
    setting(":INITiate:CONTinuous", Command::Continuous).asks(0, 0),
    setting(":LIST:FREQuency", Command::List).takes(1, MAX_LIST).asks(0, 0),
    setting(":LIST:MODE", Command::ListMode).asks(0, 0),
    command(":TRIGger[:IMMediate]", Command::Trigger),
    setting(":TRIGger:DELay", Command::StepDelay),
    setting(":TRIGger:SOURce", Command::Source).asks(0, 0),
    setting(":TRIGger:TDELay", Command::TriggerDelay),
    setting(":VOLTage[:LEVel]", Command::Volt),
];

/// The longest list.
const MAX_LIST: usize = 201;

/// The pairs of values that can be asked for.
const FUNCTIONS: &[(&str, (Quantity, Quantity))] = &[
    ("CPD", (Quantity::Cp, Quantity::D)),
    ("CPQ", (Quantity::Cp, Quantity::Q)),
    ("CPG", (Quantity::Cp, Quantity::G)),
    ("CPRP", (Quantity::Cp, Quantity::Rp)),
    ("CSD", (Quantity::Cs, Quantity::D)),
    ("CSQ", (Quantity::Cs, Quantity::Q)),
    ("CSRS", (Quantity::Cs, Quantity::Rs)),
    ("LPD", (Quantity::Lp, Quantity::D)),
    ("LPQ", (Quantity::Lp, Quantity::Q)),
    ("LPG", (Quantity::Lp, Quantity::G)),
    ("LPRP", (Quantity::Lp, Quantity::Rp)),
    ("LSD", (Quantity::Ls, Quantity::D)),
    ("LSQ", (Quantity::Ls, Quantity::Q)),
    ("LSRS", (Quantity::Ls, Quantity::Rs)),
    ("RX", (Quantity::Rs, Quantity::X)),
    ("ZTD", (Quantity::Z, Quantity::PhaseDeg)),
    ("ZTR", (Quantity::Z, Quantity::PhaseRad)),
    ("GB", (Quantity::G, Quantity::B)),
    ("YTD", (Quantity::Y, Quantity::AdmittancePhaseDeg)),
    ("YTR", (Quantity::Y, Quantity::AdmittancePhaseRad)),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    Internal,
    Hold,
    External,
    Bus,
}

const SOURCES: &[(&str, Source)] = &[
    ("INTernal", Source::Internal),
    ("HOLD", Source::Hold),
    ("EXTernal", Source::External),
    ("BUS", Source::Bus),
];

/// What differs from make to make.
pub(crate) trait Make: fmt::Debug + Send + Sync + 'static {
    /// The answer to `*IDN?`.
    const IDENTITY: &'static str;
    /// The answer to `*OPT?`.
    const OPTIONS: &'static str;
    /// The highest frequency, Hz.
    const MAX_HZ: f64;
    /// How long one measurement takes, in s, at 20 Hz, 100 Hz, 1 kHz, 10 kHz and above, at each
    /// aperture.
    const TIMES: [[f64; 4]; 3];
    /// The highest level, V, and with high power switched on.
    const MAX_V: (f64, f64);
    /// The longest delay, s.
    const MAX_DELAY_S: f64;
    /// Whether the delay of a trigger is told apart from that of a step.
    const HAS_TRIGGER_DELAY: bool;
    /// Whether a reading is waited for. Otherwise its status says that there is none yet.
    const FETCH_WAITS: bool;

    /// The frequency that is set when this one is asked for.
    fn nearest_hz(frequency_hz: f64) -> f64;
}

/// Keysight E4980A with option 001, which drives 20 V.
#[derive(Debug)]
pub(crate) struct E4980a;

impl Make for E4980a {
    const IDENTITY: &'static str = "Keysight Technologies,E4980A,MY46516789,A.06.16";
    const OPTIONS: &'static str = "001";
    const MAX_HZ: f64 = 2e6;
    const TIMES: [[f64; 4]; 3] =
        [[0.330, 0.100, 0.020, 0.0077], [0.380, 0.180, 0.110, 0.092], [0.480, 0.300, 0.240, 0.230]];
    const MAX_V: (f64, f64) = (20.0, 20.0);
    const MAX_DELAY_S: f64 = 999.0;
    const HAS_TRIGGER_DELAY: bool = true;
    const FETCH_WAITS: bool = true;

    fn nearest_hz(frequency_hz: f64) -> f64 {
        four_digits(frequency_hz)
    }
}

/// HP 4284A with option 001, which drives 20 V once high power is switched on.
#[derive(Debug)]
pub(crate) struct Hp4284a;

impl Make for Hp4284a {
    const IDENTITY: &'static str = "HEWLETT-PACKARD,4284A,2940J01234,REV01.20";
    const OPTIONS: &'static str = "001,0,0,0,0";
    const MAX_HZ: f64 = 1e6;
    const TIMES: [[f64; 4]; 3] =
        [[0.350, 0.270, 0.040, 0.030], [0.400, 0.400, 0.190, 0.180], [0.800, 0.800, 0.830, 0.820]];
    const MAX_V: (f64, f64) = (2.0, 20.0);
    const MAX_DELAY_S: f64 = 60.0;
    const HAS_TRIGGER_DELAY: bool = false;
    const FETCH_WAITS: bool = true;

    /// The instrument divides a clock, so that only some frequencies can be had, at most one
    /// percent apart.
    fn nearest_hz(frequency_hz: f64) -> f64 {
        const CLOCK_HZ: f64 = 60e3;
        if frequency_hz < 1000.0 {
            CLOCK_HZ / (CLOCK_HZ / frequency_hz).round()
        } else {
            four_digits(frequency_hz)
        }
    }
}

/// Tonghui TH2832. It hands characters over one by one, with an echo of each.
#[derive(Debug)]
pub(crate) struct Th2832;

impl Make for Th2832 {
    const IDENTITY: &'static str = "Tonghui,TH2832,V1.0.5,T283210021";
    const OPTIONS: &'static str = "0";
    const MAX_HZ: f64 = 2e5;
    const TIMES: [[f64; 4]; 3] = Hp4284a::TIMES;
    const MAX_V: (f64, f64) = (2.0, 2.0);
    const MAX_DELAY_S: f64 = 60.0;
    const HAS_TRIGGER_DELAY: bool = false;
    const FETCH_WAITS: bool = false;

    fn nearest_hz(frequency_hz: f64) -> f64 {
        four_digits(frequency_hz)
    }
}

/// Rounds to four digits.
fn four_digits(frequency_hz: f64) -> f64 {
    round_step(frequency_hz, 10_f64.powf(frequency_hz.log10().floor() - 3.0))
}

const APERTURES: [(&str, usize); 3] = [("SHORt", 0), ("MEDium", 1), ("LONG", 2)];

/// A meter of the family, which is its settings.
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the front panel")]
#[derive(Debug)]
pub(crate) struct Lcr<M> {
    make: PhantomData<M>,
    frequency_hz: f64,
    level_v: f64,
    has_high_power: bool,
    has_alc: bool,
    aperture: usize,
    averages: u32,
    function: usize,
    source: Source,
    is_continuous: bool,
    trigger_delay_s: f64,
    step_delay_s: f64,
    has_comparator: bool,
    has_long_digits: bool,
    list_hz: Vec<f64>,
    is_stepped: bool,
    shows_list: bool,
}

impl<M> Default for Lcr<M> {
    fn default() -> Self {
        Self {
            make: PhantomData,
            has_high_power: false,
            frequency_hz: 1000.0,
            level_v: 1.0,
            has_alc: false,
            aperture: 1,
            averages: 1,
            function: 0,
            source: Source::Internal,
            is_continuous: false,
            trigger_delay_s: 0.0,
            step_delay_s: 0.0,
            has_comparator: false,
            has_long_digits: false,
            list_hz: Vec::new(),
            is_stepped: false,
            shows_list: false,
        }
    }
}

/// Stands for a value that the status says is none.
const NO_VALUE: f64 = 9.9e37;

/// Event of the operation status: a list, or a measurement, is complete.
const LIST_DONE: u16 = 1 << 3;
const MEASUREMENT_DONE: u16 = 1 << 4;

impl<M: Make> Model for Lcr<M> {
    type Command = Command;

    fn commands() -> Tree<Command> {
        Tree::new(COMMANDS).expect("the commands are constants, and a test builds them")
    }

    fn dialect() -> Dialect {
        Dialect {
            error_format: ErrorFormat { has_plus: true, has_info: false },
            ..Dialect::standard(M::IDENTITY)
        }
    }

    fn carry_out(
        &mut self,
        call: &Call<Command>,
        memory: Memory<'_>,
    ) -> Result<Outcome, ScpiError> {
        let done = |values| Ok(Outcome::Done(values));
        let Memory { readings, is_measuring } = memory;
        match call.command {
            Command::Reset => {
                *self = Self::default();
                Ok(Outcome::Abort)
            }
            Command::Abort => Ok(Outcome::Abort),
            Command::Options => done(vec![Value::Verbatim(M::OPTIONS.into())]),
            Command::TriggerAndRead if self.source == Source::Bus => Ok(self.measure(true)),
            Command::Trigger if self.source != Source::Internal => Ok(self.measure(false)),
            Command::Trigger | Command::TriggerAndRead => Err(ScpiError::new(-211)),
            // While it triggers itself, the next measurement is the one to read.
            Command::Fetch if self.source == Source::Internal => Ok(self.measure(true)),
            Command::Fetch if is_measuring && !M::FETCH_WAITS => done(self.not_yet()),
            Command::Fetch | Command::FetchImpedance if is_measuring || readings.is_empty() => {
                Ok(Outcome::Wait)
            }
            Command::Fetch => done(self.answer(readings)),
            Command::FetchImpedance => {
                let impedance_ohm = readings[0].impedance_ohm;
                let pair = impedance_ohm.map_or([NO_VALUE; 2], |z| [z.re, z.im]);
                done(pair.map(|value| self.real(value)).to_vec())
            }
            Command::FetchVolt => done(vec![self.real(self.level_v)]),
            Command::Init => done(Vec::new()),
            _ if call.is_query => self.ask(call).map(|value| Outcome::Done(vec![value])),
            _ => self.set(call).map(|()| Outcome::Done(Vec::new())),
        }
    }

    fn drive(&self) -> Drive {
        Drive { frequency_hz: self.frequency_hz, level_v: self.level_v }
    }

    fn answer(&self, readings: &[Reading]) -> Vec<Value> {
        let is_list = self.shows_list;
        readings.iter().flat_map(|reading| self.fields(reading, is_list)).collect()
    }

    fn done_bits(&self) -> u16 {
        if self.shows_list { LIST_DONE | MEASUREMENT_DONE } else { MEASUREMENT_DONE }
    }
}

impl<M: Make> Lcr<M> {
    fn frequency() -> Limits {
        Limits { min: 20.0, max: M::MAX_HZ, default: 1000.0 }
    }

    fn level(&self) -> Limits {
        let max = if self.has_high_power { M::MAX_V.1 } else { M::MAX_V.0 };
        Limits { min: 0.0, max, default: 1.0 }
    }

    fn delay() -> Limits {
        Limits { min: 0.0, max: M::MAX_DELAY_S, default: 0.0 }
    }

    fn measure(&self, is_answered: bool) -> Outcome {
        let is_sweep = self.shows_list && !self.list_hz.is_empty();
        let frequencies = if is_sweep { &self.list_hz[..] } else { &[self.frequency_hz][..] };
        let mut delay_s = self.trigger_delay_s;
        let points = frequencies
            .iter()
            .map(|&frequency_hz| {
                let cycles = self.cycles(frequency_hz) * self.averages;
                let first_delay_s = std::mem::take(&mut delay_s);
                Point { frequency_hz, delay_s: first_delay_s + self.step_delay_s, cycles }
            })
            .collect();
        // A list goes on while the status is asked for; a single measurement is waited for.
        let is_blocking = !is_sweep && (M::FETCH_WAITS || is_answered);
        Outcome::Measure(Job { points, is_blocking, is_answered })
    }

    /// The whole cycles that fit in the measurement time, which is read from the table on
    /// logarithmic scales.
    fn cycles(&self, frequency_hz: f64) -> u32 {
        let times = M::TIMES[self.aperture];
        let decade = (frequency_hz / 20.0).ln() / 5.0_f64.ln();
        // 20 Hz to 100 Hz is one step of the table, and each decade from there on another.
        let place = if decade <= 1.0 { decade } else { 1.0 + (frequency_hz / 100.0).log10() };
        let place = place.clamp(0.0, 3.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 2")]
        let index = place.min(2.0) as usize;
        let part = place - index as f64;
        let time_s = times[index].powf(1.0 - part) * times[index + 1].powf(part);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it is small")]
        let cycles = (time_s * frequency_hz).floor() as u32;
        cycles.max(1)
    }

    fn fields(&self, reading: &Reading, is_list: bool) -> Vec<Value> {
        let (a, b) = FUNCTIONS[self.function].1;
        let value = |quantity: Quantity| {
            let found = reading.impedance_ohm.map(|z| quantity.of(z, reading.frequency_hz));
            self.real(found.unwrap_or(NO_VALUE))
        };
        let status = if reading.impedance_ohm.is_none() { "+1" } else { "+0" };
        let mut fields = vec![value(a), value(b), Value::Verbatim(status.into())];
        if is_list || self.has_comparator {
            fields.push(Value::Verbatim("+0".into()));
        }
        fields
    }

    /// What is answered while there is no reading.
    fn not_yet(&self) -> Vec<Value> {
        vec![self.real(NO_VALUE), self.real(NO_VALUE), Value::Verbatim("-1".into())]
    }

    fn real(&self, value: f64) -> Value {
        let n_decimals = if self.has_long_digits { 9 } else { 5 };
        Value::Formatted(value, scientific(n_decimals))
    }

    fn set(&mut self, call: &Call<Command>) -> Result<(), ScpiError> {
        let value = call.param(0)?;
        match call.command {
            Command::Frequency => {
                self.frequency_hz = M::nearest_hz(value.real(Unit::HERTZ, Self::frequency())?);
            }
            Command::Volt => {
                self.level_v = round_step(value.real(Unit::VOLT, self.level())?, 1e-3);
            }
            Command::HighPower if M::MAX_V.0 == M::MAX_V.1 => return Err(ScpiError::new(-113)),
            Command::HighPower => self.has_high_power = value.boolean()?,
            Command::Alc => self.has_alc = value.boolean()?,
            Command::Aperture => {
                self.aperture = value.choice(&APERTURES)?;
                if let Ok(averages) = call.param(1) {
                    let averages = averages.integer(1..=256)?;
                    self.averages = u32::try_from(averages).expect("it is at most 256");
                }
            }
            Command::Function => {
                let index = |wanted| FUNCTIONS.iter().position(|entry| entry.1 == wanted);
                self.function = index(value.choice(FUNCTIONS)?).expect("it is one of them");
            }
            Command::Source => self.source = value.choice(SOURCES)?,
            Command::Continuous => self.is_continuous = value.boolean()?,
            Command::TriggerDelay if !M::HAS_TRIGGER_DELAY => return Err(ScpiError::new(-113)),
            Command::TriggerDelay => {
                self.trigger_delay_s = value.real(Unit::SECOND, Self::delay())?;
            }
            Command::StepDelay => self.step_delay_s = value.real(Unit::SECOND, Self::delay())?,
            Command::Comparator => self.has_comparator = value.boolean()?,
            Command::LongDigits => self.has_long_digits = value.boolean()?,
            Command::List => {
                let read = |param: &Param| param.real(Unit::HERTZ, Self::frequency());
                let list: Result<Vec<f64>, ScpiError> = call.params.iter().map(read).collect();
                self.list_hz = list?.into_iter().map(M::nearest_hz).collect();
            }
            Command::ListMode => {
                self.is_stepped = value.choice(&[("SEQuence", false), ("STEPped", true)])?;
            }
            Command::Page => {
                let pages = [("MEASurement", false), ("LIST", true), ("MSETup", false)];
                self.shows_list = value.choice(&pages)?;
            }
            Command::RangeAuto | Command::Correction => _ = value.boolean()?,
            Command::Bias if !value.boolean()? => {}
            Command::Bias => return Err(ScpiError::new(-221)),
            Command::Format => value.choice(&[("ASCii", ())])?,
            _ => return Err(ScpiError::new(-113)),
        }
        Ok(())
    }

    fn ask(&self, call: &Call<Command>) -> Result<Value, ScpiError> {
        let limited = |present: f64, unit: Unit, limits: Limits| {
            // `FREQ? MAX` asks for the limit instead.
            let value = match call.params.first() {
                Some(word) => word.real(unit, limits)?,
                None => present,
            };
            Ok(Value::Formatted(value, scientific(9)))
        };
        Ok(match call.command {
            Command::Frequency => {
                return limited(self.frequency_hz, Unit::HERTZ, Self::frequency());
            }
            Command::Volt => return limited(self.level_v, Unit::VOLT, self.level()),
            Command::TriggerDelay => {
                return limited(self.trigger_delay_s, Unit::SECOND, Self::delay());
            }
            Command::StepDelay => return limited(self.step_delay_s, Unit::SECOND, Self::delay()),
            Command::HighPower => Value::Boolean(self.has_high_power),
            Command::Alc => Value::Boolean(self.has_alc),
            Command::Aperture => {
                let word = rig_scpi::short_form(APERTURES[self.aperture].0);
                Value::Verbatim(format!("{word},{}", self.averages).into())
            }
            Command::Function => Value::Characters(FUNCTIONS[self.function].0),
            Command::Source => {
                let known = SOURCES.iter().find(|entry| entry.1 == self.source);
                Value::Characters(known.expect("every source has a word").0)
            }
            Command::Continuous => Value::Boolean(self.is_continuous),
            Command::Comparator => Value::Boolean(self.has_comparator),
            Command::LongDigits => Value::Boolean(self.has_long_digits),
            Command::List => {
                let list: Vec<String> = self.list_hz.iter().map(|hz| format!("{hz:+E}")).collect();
                Value::Verbatim(list.join(",").into())
            }
            Command::ListMode => Value::Characters(if self.is_stepped { "STEP" } else { "SEQ" }),
            Command::Page => Value::Characters(if self.shows_list { "LIST" } else { "MEAS" }),
            Command::RangeAuto => Value::Boolean(true),
            Command::Correction | Command::Bias => Value::Boolean(false),
            Command::Format => Value::Characters("ASC"),
            _ => return Err(ScpiError::new(-113)),
        })
    }
}

const fn scientific(n_decimals: u8) -> RealFormat {
    RealFormat::Scientific { n_decimals, n_exponent: 2, has_plus: true }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::meter::bench;

    type Bench = bench::Bench<Lcr<E4980a>>;

    #[test]
    fn every_command_has_its_place_in_the_tree() {
        assert!(Tree::new(COMMANDS).is_ok());
    }

    #[test]
    fn a_bus_trigger_measures_and_the_answer_has_fixed_widths() {
        let mut bench = Bench::new();
        bench.say("*RST;:FUNC:IMP RX;:TRIG:SOUR BUS;:FREQ 140.04;:VOLT 5;:TRIG:TDEL 3");
        assert_eq!(bench.say("FREQ?;VOLT?"), "+1.400000000E+02;+5.000000000E+00\n");
        let line = bench.say("*TRG");
        let fields: Vec<&str> = line.trim_end().split(',').collect();
        assert_eq!(fields.iter().map(|field| field.len()).collect::<Vec<_>>(), [12, 12, 2]);
        let expected = bench.settled_ohm(140.0);
        let found: Vec<f64> = fields.iter().map(|field| field.parse().unwrap()).collect();
        assert!((found[0] / expected.re - 1.0).abs() < 1e-5, "{line} {expected}");
        assert!((found[1] / expected.im - 1.0).abs() < 1e-5, "{line} {expected}");
        bench.say(":FORM:ASC:LONG ON;:TRIG");
        assert_eq!(bench.say("FETC?").find(','), Some(16));
        assert_eq!(bench.say("SYST:ERR?"), "+0,\"No error\"\n");
    }

    #[test]
    fn a_measurement_takes_the_time_of_its_aperture() {
        let mut bench = Bench::new();
        for (aperture, cycles) in [("SHOR", 10_u128), ("SHOR,4", 40), ("MED", 18), ("LONG", 30)] {
            bench.say(&format!("APER {aperture};FREQ 100;:TRIG:SOUR BUS"));
            let before = bench.now;
            bench.say("*TRG");
            assert_eq!(bench.now.since(before).as_micros(), 10_000 * cycles);
            bench.say("APER SHOR,1");
        }
    }

    #[test]
    fn a_list_runs_while_the_status_is_asked_for_and_has_four_fields_a_point() {
        let mut bench = Bench::new();
        bench.say("DISP:PAGE LIST;:LIST:MODE SEQ;:LIST:FREQ 130,140,150;:TRIG:SOUR BUS");
        bench.say("STAT:OPER?");
        bench.send("TRIG");
        bench.send("STAT:OPER?");
        assert_eq!(bench.heard(), "0\n");
        assert_eq!(bench.say("FETC?").split(',').count(), 12);
        let first = bench.say("FETC?");
        bench.send("TRIG");
        bench.send("FETC?");
        assert_eq!(bench.heard(), "", "a new measurement is waited for");
        assert_ne!(bench.say(""), first);
        assert_eq!(bench.say("STAT:OPER?"), "24\n");
    }

    #[test]
    fn what_is_not_there_yet_and_what_cannot_be_is_told() {
        let mut bench = Bench::new();
        let rows = [
            (":TRIG:SOUR BUS;:FETC?", "-230"),
            ("VOLT 21", "-222"),
            ("FREQ 10", "-222"),
            ("TRIG:SOUR INT;:TRIG", "-211"),
            ("BIAS:STAT ON", "-221"),
            ("FUNC:IMP XX", "-224"),
            ("MEAS?", "-113"),
        ];
        for (line, number) in rows {
            assert_eq!(bench.say(line), "", "{line}");
            let told = bench.say("SYST:ERR?");
            assert!(told.starts_with(number), "{line}: {told}");
        }
        assert_eq!(bench.say("*OPT?;FREQ? MAX;:APER?"), "001;+2.000000000E+06;MED,1\n");
    }

    #[test]
    fn a_level_of_zero_is_survived() {
        let mut bench = Bench::new();
        bench.say("FUNC:IMP ZTD;:TRIG:SOUR BUS;:FREQ 140;:TRIG:TDEL 5");
        let before = bench.say("*TRG");
        bench.say("VOLT 0");
        bench.say("*TRG");
        assert_eq!(bench.say("VOLT 5;*TRG"), before);
    }

    #[test]
    fn overload_is_a_status_and_no_value() {
        let mut bench = Bench::new();
        bench.say("FUNC:IMP ZTD;:TRIG:SOUR BUS");
        bench.meter.overload();
        assert_eq!(bench.say("*TRG"), "+9.90000E+37,+9.90000E+37,+1\n");
    }

    #[test]
    fn the_forerunner_needs_its_high_power_switched_on_and_divides_a_clock() {
        let mut bench = bench::Bench::<Lcr<Hp4284a>>::new();
        bench.say("VOLT 5");
        assert!(bench.say("SYST:ERR?").starts_with("-222"));
        bench.say(":OUTP:HPOW ON;:VOLT 5;:FREQ 140;:TRIG:DEL 2");
        assert_eq!(bench.say("VOLT?;*OPT?"), "+5.000000000E+00;001,0,0,0,0\n");
        let frequency_hz: f64 = bench.say("FREQ?").trim().parse().unwrap();
        assert!(frequency_hz != 140.0 && (frequency_hz / 140.0 - 1.0).abs() < 0.01);
        assert_eq!(bench.say("SYST:ERR?"), "+0,\"No error\"\n");
        bench.say(":TRIG:TDEL 1");
        assert!(bench.say("SYST:ERR?").starts_with("-113"));
    }

    #[test]
    fn one_make_answers_before_it_has_measured_and_says_so() {
        let mut bench = bench::Bench::<Lcr<Th2832>>::new();
        bench.say("FUNC:IMP RX;:TRIG:SOUR BUS;:FREQ 140HZ");
        bench.send(":TRIG;:FETC?");
        assert_eq!(bench.heard(), "+9.90000E+37,+9.90000E+37,-1\n");
        bench.say("");
        assert!(bench.say("FETC?").ends_with(",+0\n"));
    }
}
