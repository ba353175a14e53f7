//! HIOKI's IM3536 LCR meter.
//!
//! It processes one message after the other; during a measurement it receives but does not process.
//! Only `*ESR?` reports errors, and after an error the rest of the line is ignored. Frequency and
//! level are rounded to the steps of the front panel.
//!
//! # Source
//! HIOKI, IM3536 Communication Instruction Manual and Instruction Manual (specifications).

#[cfg(test)]
mod tests;

use std::sync::LazyLock;

use rig_scpi::{
    AfterErrorPolicy, Call, Dialect, Ending, Limits, Node, Param, RealFormat, ScpiError, Tree,
    Unit, Value, command, query, setting,
};

use super::{
    Drive, FinishedPoint, Job, Memory, Model, Outcome, Point, Quantity, round_step,
    setting_store::{self, SettingStore, StoredSetting, number, word},
};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum HiokiCommand {
    Averaging,
    DelayTime,
    Frequency,
    Format,
    Item,
    /// A row of [`KEPT`].
    StoredSetting(usize),
    Level,
    LevelVolt,
    Mode,
    Monitor,
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

const COMMANDS: &[Node<HiokiCommand>] = &[
    command("*RST", HiokiCommand::Reset),
    command("*TRG", HiokiCommand::Trigger),
    setting(":AVERaging", HiokiCommand::Averaging).asks(0, 0),
    setting(":FORMat:DATA", HiokiCommand::Format).asks(0, 0),
    setting(":FREQuency", HiokiCommand::Frequency).asks(0, 0),
    setting(":LEVel", HiokiCommand::Level).asks(0, 0),
    setting(":LEVel:VOLTage", HiokiCommand::LevelVolt).asks(0, 0),
    query(":MEASure", HiokiCommand::Read),
    setting(":MEASure:ITEM", HiokiCommand::Item).takes(1, 3).asks(0, 0),
    setting(":MEASure:OUTPut:AUTO", HiokiCommand::OutputAuto).asks(0, 0),
    setting(":MEASure:VALid", HiokiCommand::Valid).asks(0, 0),
    setting(":MODE", HiokiCommand::Mode).asks(0, 0),
    query(":MONitor", HiokiCommand::Monitor),
    setting(":PARameter#", HiokiCommand::Parameter).asks(0, 0),
    command(":PRESet", HiokiCommand::Preset),
    setting(":RANGe", HiokiCommand::Range).asks(0, 0),
    setting(":RANGe:AUTO", HiokiCommand::RangeAuto).asks(0, 0),
    setting(":SPEEd", HiokiCommand::Speed).asks(0, 0),
    setting(":TRIGger", HiokiCommand::TriggerSource).asks(0, 0),
    setting(":TRIGger:DELay", HiokiCommand::DelayTime).asks(0, 0),
];

/// Stored settings without effect: ideal terminals need no correction, and the comparator is not
/// simulated.
///
/// # Source
/// Commands that public drivers send to the IM3533, IM3536 and IM3570 when they connect.
const KEPT: &[StoredSetting] = &[
    word(":BEEPer:JUDGment", &["OFF", "IN", "NG"]),
    word(":BEEPer:KEY", &["ON", "OFF"]),
    word(":COMParator", &["OFF"]),
    word(":CORRection:LOAD", &["OFF", "ON"]),
    word(":CORRection:OPEN", &["OFF", "ALL", "SPOT"]),
    word(":CORRection:SHORt", &["OFF", "ALL", "SPOT"]),
    // The sensor is linear: a bias changes nothing.
    word(":DCBias", &["OFF", "ON"]),
    number(":DCBias:LEVel", Unit::VOLT, Limits { min: 0.0, max: 2.5, default: 0.0 }),
    word(":DISPlay", &["ON", "OFF"]),
    word(":KEYLock", &["OFF", "ON"]),
];

/// The resistance of the source, ohm.
const SOURCE_OHM: f64 = 100.0;

/// The quantities that a parameter of the display can show.
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

/// Meaning of the bits of the two registers of `:MEASure:ITEM`, from the lowest. If none is set,
/// the answer has the parameters of the display.
///
/// # Source
/// HIOKI 9593-01 Instruction Manual, p. 66; the IM3536 has further bits that are not simulated.
const ITEMS: [&[Quantity]; 2] = [
    &[
        Quantity::Z,
        Quantity::Y,
        Quantity::PhaseDeg,
        Quantity::Cs,
        Quantity::Cp,
        Quantity::D,
        Quantity::Ls,
        Quantity::Lp,
    ],
    &[Quantity::Q, Quantity::Rs, Quantity::G, Quantity::Rp, Quantity::X, Quantity::B],
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
    setting_store: SettingStore,
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
            setting_store: SettingStore::default(),
        }
    }
}

/// Replaces a value that could not be measured.
const NO_VALUE: &str = "**********";

/// The status of a measurement whose input was overloaded.
const OVERLOADED: i64 = 2;

const FREQUENCY: Limits = Limits { min: 4.0, max: 8e6, default: 1000.0 };
const LEVEL: Limits = Limits { min: 0.01, max: 5.0, default: 1.0 };
const DELAY: Limits = Limits { min: 0.0, max: 9.9999, default: 0.0 };
const RANGES: std::ops::RangeInclusive<i64> = 1..=10;

/// Resolution of a frequency with five digits: 10 mHz below 1 kHz.
const DIGITS_OF_FREQUENCY: i32 = 5;

impl Model for Hioki {
    type Command = HiokiCommand;

    fn commands() -> Tree<HiokiCommand> {
        static TREE: LazyLock<Tree<HiokiCommand>> = LazyLock::new(|| {
            let rows = setting_store::nodes(KEPT, HiokiCommand::StoredSetting);
            let nodes: Vec<Node<HiokiCommand>> = COMMANDS.iter().copied().chain(rows).collect();
            Tree::new(&nodes).expect("the commands are constants, and a test builds them")
        });
        TREE.clone()
    }

    fn dialect() -> Dialect {
        Dialect {
            ending: Ending::CrLf,
            input_limit_bytes: 1024,
            after_error: AfterErrorPolicy::SkipMessage,
            headers: Some(false),
            real_format: RealFormat::Scientific { n_decimals: 5, n_exponent: 2, has_plus: false },
            ..Dialect::common_only("HIOKI,IM3536,190512345,V1.21")
        }
    }

    fn carry_out(
        &mut self,
        call: &Call<HiokiCommand>,
        memory: Memory<'_>,
    ) -> Result<Outcome, ScpiError> {
        match call.command {
            HiokiCommand::Trigger if self.is_external => Ok(self.measure(self.is_output_auto)),
            // Ignored while the instrument triggers itself.
            HiokiCommand::Trigger => Err(ScpiError::new(-211)),
            HiokiCommand::Read if !self.is_external => Ok(self.measure(true)),
            HiokiCommand::Read if memory.readings.is_empty() => Err(ScpiError::new(-230)),
            HiokiCommand::Read => Ok(Outcome::Done(self.answer(call.command, memory.readings))),
            HiokiCommand::StoredSetting(row) => {
                let format = RealFormat::Fixed { n_decimals: 2 };
                self.setting_store.obey(&KEPT[row], row, call, format).map(Outcome::Done)
            }
            HiokiCommand::Monitor => Ok(Outcome::Done(self.monitored(memory.readings))),
            HiokiCommand::Reset | HiokiCommand::Preset => {
                *self = Self::default();
                Ok(Outcome::Abort)
            }
            _ if call.is_query => self.ask(call).map(|value| Outcome::Done(vec![value])),
            _ => self.set(call).map(|()| Outcome::Done(Vec::new())),
        }
    }

    fn may_interrupt(command: HiokiCommand) -> bool {
        matches!(command, HiokiCommand::Reset | HiokiCommand::Preset)
    }

    fn drive(&self) -> Drive {
        Drive { frequency_hz: self.frequency_hz, level_v: self.level_v }
    }

    /// The status first, unless it is switched off, and then the parameters of the display.
    fn answer(&self, _command: HiokiCommand, readings: &[FinishedPoint]) -> Vec<Value> {
        let Some(reading) = readings.first() else { return Vec::new() };
        let status = if reading.impedance_ohm.is_none() { OVERLOADED } else { 0 };
        let status = (self.valid != 0).then_some(Value::Integer(status));
        let items: Vec<Quantity> = self.items().collect();
        let shown = if items.is_empty() { &self.parameters[..] } else { &items };
        let shown = shown.iter().filter(|shown| **shown != Quantity::Off);
        status.into_iter().chain(shown.map(|shown| field(*shown, reading))).collect()
    }
}

/// A value with the digits of the display.
fn field(shown: Quantity, reading: &FinishedPoint) -> Value {
    let Some(impedance_ohm) = reading.impedance_ohm else {
        return Value::Verbatim(NO_VALUE.into());
    };
    let value = shown.of(impedance_ohm, reading.frequency_hz);
    match shown {
        Quantity::PhaseDeg => Value::Formatted(value, RealFormat::Fixed { n_decimals: 3 }),
        _ => Value::Real(value),
    }
}

impl Hioki {
    /// The items selected by `:MEASure:ITEM`.
    fn items(&self) -> impl Iterator<Item = Quantity> {
        ITEMS.iter().zip(self.item).flat_map(|(quantities, register)| {
            let is_set = move |bit: &usize| register >> bit & 1 == 1;
            (0..quantities.len()).filter(is_set).map(|bit| quantities[bit])
        })
    }

    /// Voltage and current at the terminals with the last reading, V and A.
    fn monitored(&self, readings: &[FinishedPoint]) -> Vec<Value> {
        let impedance_ohm = readings.last().and_then(|reading| reading.impedance_ohm);
        let Some(z) = impedance_ohm else { return vec![Value::Verbatim(NO_VALUE.into()); 2] };
        let ampere = self.level_v / (z + SOURCE_OHM).norm();
        vec![Value::Real(ampere * z.norm()), Value::Real(ampere)]
    }

    fn measure(&self, is_answered: bool) -> Outcome {
        let cycles = SPEEDS[self.speed].1 * self.averages;
        let point = Point { frequency_hz: self.frequency_hz, delay_s: self.delay_s, cycles };
        Outcome::Measure(Job { points: [point].into(), is_blocking: true, is_answered })
    }

    fn set(&mut self, call: &Call<HiokiCommand>) -> Result<(), ScpiError> {
        let s = self;
        let value = call.param(0)?;
        match call.command {
            HiokiCommand::Frequency => {
                s.frequency_hz = round_digits(value.real(Unit::HERTZ, FREQUENCY)?);
            }
            HiokiCommand::LevelVolt => s.level_v = round_step(value.real(Unit::VOLT, LEVEL)?, 1e-3),
            HiokiCommand::DelayTime => {
                s.delay_s = round_step(value.real(Unit::SECOND, DELAY)?, 1e-4);
            }
            HiokiCommand::Averaging => s.averages = averages(value)?,
            HiokiCommand::Speed => {
                let words: [(&str, usize); 4] = std::array::from_fn(|i| (SPEEDS[i].0, i));
                s.speed = value.choice(&words)?;
            }
            HiokiCommand::TriggerSource => {
                s.is_external = value.choice(&[("INTernal", false), ("EXTernal", true)])?;
            }
            HiokiCommand::Parameter => {
                let shown = value.choice(QUANTITIES)?;
                *parameter(s, call)? = shown;
            }
            HiokiCommand::OutputAuto => s.is_output_auto = value.boolean()?,
            HiokiCommand::Valid => s.valid = value.integer(0..=255)?,
            HiokiCommand::Item => {
                for (index, item) in s.item.iter_mut().enumerate().take(call.params.len()) {
                    *item = call.param(index)?.integer(0..=255)?;
                }
            }
            HiokiCommand::Range => {
                s.range = value.integer(RANGES)?;
                s.is_range_auto = false;
            }
            HiokiCommand::RangeAuto => s.is_range_auto = value.boolean()?,
            // The simulated terminals are driven by voltage, without bias, and text is answered.
            HiokiCommand::Level => value.choice(&[("V", ())])?,
            HiokiCommand::Mode => value.choice(&[("LCR", ())])?,
            HiokiCommand::Format => value.choice(&[("ASCii", ())])?,
            HiokiCommand::StoredSetting(_)
            | HiokiCommand::Monitor
            | HiokiCommand::Preset
            | HiokiCommand::Read
            | HiokiCommand::Reset
            | HiokiCommand::Trigger => {}
        }
        Ok(())
    }

    fn ask(&mut self, call: &Call<HiokiCommand>) -> Result<Value, ScpiError> {
        let word = |word: &str| Value::Verbatim(word.to_ascii_uppercase().into());
        let switch = |is_on: bool| word(if is_on { "ON" } else { "OFF" });
        let scientific = |value, n_decimals| {
            let format = RealFormat::Scientific { n_decimals, n_exponent: 2, has_plus: false };
            Value::Formatted(value, format)
        };
        let s = self;
        Ok(match call.command {
            HiokiCommand::Frequency => scientific(s.frequency_hz, 4),
            HiokiCommand::LevelVolt => {
                Value::Formatted(s.level_v, RealFormat::Fixed { n_decimals: 3 })
            }
            HiokiCommand::DelayTime => {
                Value::Formatted(s.delay_s, RealFormat::Fixed { n_decimals: 4 })
            }
            HiokiCommand::Averaging => Value::Integer(s.averages.into()),
            HiokiCommand::Speed => word(SPEEDS[s.speed].0),
            HiokiCommand::TriggerSource => {
                word(if s.is_external { "EXTERNAL" } else { "INTERNAL" })
            }
            HiokiCommand::Parameter => {
                let shown = *parameter(s, call)?;
                let known = QUANTITIES.iter().find(|entry| entry.1 == shown);
                word(known.expect("every quantity has a word").0)
            }
            HiokiCommand::OutputAuto => switch(s.is_output_auto),
            HiokiCommand::Valid => Value::Integer(s.valid),
            HiokiCommand::Item => {
                let [a, b, c] = s.item;
                Value::Verbatim(format!("{a},{b},{c}").into())
            }
            HiokiCommand::Range => Value::Integer(s.range),
            HiokiCommand::RangeAuto => switch(s.is_range_auto),
            HiokiCommand::Level => word("V"),
            HiokiCommand::Mode => word("LCR"),
            HiokiCommand::Format => word("ASCII"),
            HiokiCommand::StoredSetting(_)
            | HiokiCommand::Monitor
            | HiokiCommand::Preset
            | HiokiCommand::Read
            | HiokiCommand::Reset
            | HiokiCommand::Trigger => {
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
    call: &Call<HiokiCommand>,
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
