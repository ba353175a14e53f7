//! The HP 4284A and the LCR meters that follow it: Keysight's E4980A and Tonghui's `TH283x`.
//!
//! A trigger measures once, or once at every frequency of the list when the list page is shown. The
//! answer is two values and a status, in fixed widths; a list adds a fourth field to each point.
//!
//! # Source
//! Keysight, E4980A/AL User's Guide: `FETCh?` and its data format (p. 183, 261, 265); measurement
//! times and frequency resolution as in the E4980A data sheet. HP, 4284A Operation Manual.

mod make;
#[cfg(test)]
mod tests;

use std::marker::PhantomData;

use rig_scpi::{
    Call, Dialect, ErrorFormat, Limits, Node, Param, RealFormat, ScpiError, Tree, Unit, Value,
    command, query, setting,
};

use self::make::Make;
pub(crate) use self::make::{E4980a, Hp4284a, Th2832};
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
