//! Keysight's E4990A impedance analyzer, which sweeps a trace and drives at most 1 V.
//!
//! # Source
//! Keysight, E4990A Help, Programming: command reference.

#[cfg(test)]
mod tests;

use std::sync::LazyLock;

use rig_scpi::{
    Call, Dialect, ErrorFormat, Limits, Node, RealFormat, ScpiError, Tree, Unit, Value, command,
    query, setting,
};

use super::{
    Drive, FinishedPoint, Job, Memory, Model, Outcome, Point, Quantity, binary,
    setting_store::{self, SettingStore, StoredSetting, action, number, switch, word},
};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum E4990aCommand {
    Abort,
    Alc,
    Aperture,
    Average,
    AverageCount,
    ByteOrder,
    Center,
    Continuous,
    Define,
    FormattedData,
    Frequencies,
    Init,
    Format,
    /// A row of [`KEPT`].
    StoredSetting(usize),
    Mode,
    Options,
    ParameterCount,
    PointDelay,
    Points,
    RawData,
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

const COMMANDS: &[Node<E4990aCommand>] = &[
    query("*OPT", E4990aCommand::Options),
    command("*RST", E4990aCommand::Reset),
    command("*TRG", E4990aCommand::Trigger),
    command(":ABORt", E4990aCommand::Abort),
    query(":CALCulate#[:SELected]:DATA:FDATa", E4990aCommand::FormattedData),
    query(":CALCulate#[:SELected]:DATA:RDATa", E4990aCommand::RawData),
    query(":CALCulate#[:SELected]:DATA:XAXis", E4990aCommand::Frequencies),
    setting(":CALCulate#:PARameter:COUNt", E4990aCommand::ParameterCount).asks(0, 0),
    setting(":CALCulate#:PARameter#:DEFine", E4990aCommand::Define).asks(0, 0),
    command(":CALCulate#:PARameter#:SELect", E4990aCommand::Select),
    setting(":FORMat:BORDer", E4990aCommand::ByteOrder).asks(0, 0),
    setting(":FORMat:DATA", E4990aCommand::Format).asks(0, 0),
    command(":INITiate#[:IMMediate]", E4990aCommand::Init),
    setting(":INITiate#:CONTinuous", E4990aCommand::Continuous).asks(0, 0),
    setting(":SENSe#:APERture[:TIME]", E4990aCommand::Aperture).asks(0, 0),
    setting(":SENSe#:AVERage[:STATe]", E4990aCommand::Average).asks(0, 0),
    setting(":SENSe#:AVERage:COUNt", E4990aCommand::AverageCount).asks(0, 0),
    setting(":SENSe#:FREQuency:CENTer", E4990aCommand::Center),
    query(":SENSe#:FREQuency:DATA", E4990aCommand::Frequencies),
    setting(":SENSe#:FREQuency:SPAN", E4990aCommand::Span),
    setting(":SENSe#:FREQuency:STARt", E4990aCommand::Start),
    setting(":SENSe#:FREQuency:STOP", E4990aCommand::Stop),
    setting(":SENSe#:SWEep:DELay", E4990aCommand::PointDelay),
    setting(":SENSe#:SWEep:POINts", E4990aCommand::Points),
    setting(":SENSe#:SWEep:TYPE", E4990aCommand::SweepType).asks(0, 0),
    setting(":SOURce#:ALC[:STATe]", E4990aCommand::Alc).asks(0, 0),
    setting(":SOURce#:MODE", E4990aCommand::Mode).asks(0, 0),
    setting(":SOURce#:VOLTage[:LEVel]", E4990aCommand::Volt),
    command(":SYSTem:PRESet", E4990aCommand::Reset),
    setting(":TRIGger[:SEQuence]:SOURce", E4990aCommand::Source).asks(0, 0),
    command(":TRIGger[:SEQuence]:SINGle", E4990aCommand::Trigger),
    command(":TRIGger[:SEQuence][:IMMediate]", E4990aCommand::Trigger),
];

/// Stored settings without effect: the display, the bias and corrections of ideal terminals. One
/// sweep is measured for a trigger, so that averaging over sweeps stays off.
///
/// # Source
/// Commands that public drivers and scripts send to the E4990A when they connect.
const KEPT: &[StoredSetting] = &[
    action(":CALCulate#:AVERage:CLEar"),
    word(":CALCulate#:AVERage[:STATe]", &["OFF"]),
    switch(":CALCulate#:MARKer#[:STATe]", false),
    action(":CALCulate#:MARKer#:FUNCtion:EXECute"),
    word(":CALCulate#:MARKer#:FUNCtion:TYPE", &["MAXimum", "MINimum", "PEAK", "TARGet"]),
    switch(":DISPlay:ENABle", true),
    action(":DISPlay:WINDow#:ACTivate"),
    word(":DISPlay:WINDow#:SPLit", &["D1", "D1_2", "D1_1_2", "D12_34", "D1_2_3_4"]),
    switch(":DISPlay:WINDow#:TRACe#:STATe", true),
    action(":DISPlay:WINDow#:TRACe#:Y[:SCALe]:AUTO"),
    word(":DISPlay:WINDow#:TRACe#:Y:SPACing", &["LINear", "LOGarithmic"]),
    word(":DISPlay:WINDow#:X:SPACing", &["LINear", "OBASe"]),
    action(":SENSe#:DC:MEASure:CLEar"),
    switch(":SENSe#:DC:MEASure:ENABle", false),
    word(":SENSe#:FIXTure:SELect", &["NONE"]),
    number(":SENSe#:FREQuency[:CW]", Unit::HERTZ, Limits { default: 1e6, ..FREQUENCY }),
    word(":SENSe#:SWEep:DIRection", &["UP"]),
    switch(":SOURce#:BIAS[:STATe]", false),
    word(":SOURce#:BIAS:MODE", &["VOLTage", "CURRent"]),
    number(":SOURce#:BIAS:VOLTage[:LEVel]", Unit::VOLT, BIAS),
];

const BIAS: Limits = Limits { min: -40.0, max: 40.0, default: 0.0 };

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
    is_binary: bool,
    is_swapped: bool,
    setting_store: SettingStore,
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
            is_binary: false,
            is_swapped: false,
            setting_store: SettingStore::default(),
        }
    }
}

const REAL_FORMAT: RealFormat =
    RealFormat::Scientific { n_decimals: 11, n_exponent: 3, has_plus: true };
const FREQUENCY: Limits = Limits { min: 20.0, max: 120e6, default: 20.0 };
const LEVEL: Limits = Limits { min: 0.005, max: 1.0, default: 0.5 };
const DELAY: Limits = Limits { min: 0.0, max: 30.0, default: 0.0 };
const POINTS: std::ops::RangeInclusive<i64> = 2..=1601;

/// The value of a point that could not be measured, as the instrument prints it.
const INVALID: &str = "1.#QNB";

impl Model for E4990a {
    type Command = E4990aCommand;

    fn commands() -> Tree<E4990aCommand> {
        static TREE: LazyLock<Tree<E4990aCommand>> = LazyLock::new(|| {
            let rows = setting_store::nodes(KEPT, E4990aCommand::StoredSetting);
            let nodes: Vec<Node<E4990aCommand>> = COMMANDS.iter().copied().chain(rows).collect();
            Tree::new(&nodes).expect("the commands are constants, and a test builds them")
        });
        TREE.clone()
    }

    fn dialect() -> Dialect {
        Dialect {
            error_format: ErrorFormat { has_plus: true, has_info: false },
            real_format: REAL_FORMAT,
            ..Dialect::standard("Keysight Technologies,E4990A,MY54100123,A.02.13")
        }
    }

    fn carry_out(
        &mut self,
        call: &Call<E4990aCommand>,
        memory: Memory<'_>,
    ) -> Result<Outcome, ScpiError> {
        match call.command {
            E4990aCommand::Reset => {
                *self = Self::default();
                Ok(Outcome::Abort)
            }
            E4990aCommand::Abort => Ok(Outcome::Abort),
            E4990aCommand::Init => {
                self.is_armed = true;
                Ok(Outcome::Done(Vec::new()))
            }
            E4990aCommand::Trigger if !(self.is_continuous || self.is_armed) => {
                Err(ScpiError::new(-211))
            }
            E4990aCommand::Trigger if self.source == Source::Internal => Err(ScpiError::new(-211)),
            E4990aCommand::Trigger => {
                self.is_armed = false;
                let points = self.points();
                Ok(Outcome::Measure(Job { points, is_blocking: false, is_answered: false }))
            }
            E4990aCommand::Options => Ok(Outcome::Done(vec![Value::Verbatim("0".into())])),
            E4990aCommand::StoredSetting(row) => {
                self.setting_store.obey(&KEPT[row], row, call, REAL_FORMAT).map(Outcome::Done)
            }
            E4990aCommand::FormattedData | E4990aCommand::RawData => {
                Ok(Outcome::Done(self.answer(call.command, memory.readings)))
            }
            E4990aCommand::Select => {
                self.selected = self.parameter(call)?;
                Ok(Outcome::Done(Vec::new()))
            }
            E4990aCommand::Frequencies => {
                let frequencies: Vec<f64> =
                    self.points().iter().map(|point| point.frequency_hz).collect();
                Ok(Outcome::Done(self.in_format(frequencies.into_iter().map(Some))))
            }
            // A change of the source ends a sweep that is under way.
            E4990aCommand::Source if !call.is_query => self.set(call).map(|()| Outcome::Abort),
            _ if call.is_query => self.ask(call).map(|value| Outcome::Done(vec![value])),
            _ => self.set(call).map(|()| Outcome::Done(Vec::new())),
        }
    }

    /// Bit 4: a sweep is under way.
    fn busy_bits(&self) -> u16 {
        1 << 4
    }

    fn drive(&self) -> Drive {
        Drive { frequency_hz: self.start_hz, level_v: self.level_v }
    }

    /// Two numbers for each point: of the selected trace, where the second is zero, or resistance
    /// and
    /// reactance as they were measured.
    fn answer(&self, command: E4990aCommand, readings: &[FinishedPoint]) -> Vec<Value> {
        let quantity = self.parameters[self.selected];
        self.in_format(readings.iter().flat_map(|reading| match (command, reading.impedance_ohm) {
            (E4990aCommand::RawData, z) => [z.map(|z| z.re), z.map(|z| z.im)],
            (_, z) => [z.map(|z| quantity.of(z, reading.frequency_hz)), Some(0.0)],
        }))
    }
}

impl E4990a {
    /// Numbers as text, or as one block; none for a point that could not be measured.
    fn in_format(&self, numbers: impl Iterator<Item = Option<f64>>) -> Vec<Value> {
        if self.is_binary {
            let numbers = numbers.map(|number| number.unwrap_or(f64::NAN));
            return vec![binary(numbers, self.is_swapped)];
        }
        numbers.map(|number| number.map_or(Value::Verbatim(INVALID.into()), Value::Real)).collect()
    }

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

    fn parameter(&self, call: &Call<E4990aCommand>) -> Result<usize, ScpiError> {
        let index = usize::try_from(call.suffix(1)).unwrap_or(usize::MAX).wrapping_sub(1);
        if index < self.parameters.len() { Ok(index) } else { Err(ScpiError::new(-114)) }
    }

    fn set(&mut self, call: &Call<E4990aCommand>) -> Result<(), ScpiError> {
        let value = call.param(0)?;
        let whole = |range| -> Result<u32, ScpiError> {
            u32::try_from(value.integer(range)?).map_err(|_| ScpiError::new(-222))
        };
        match call.command {
            E4990aCommand::Start => self.start_hz = value.real(Unit::HERTZ, FREQUENCY)?,
            E4990aCommand::Stop => self.stop_hz = value.real(Unit::HERTZ, FREQUENCY)?,
            E4990aCommand::Center => {
                let half_hz = 0.5 * (self.stop_hz - self.start_hz);
                let center_hz = value.real(Unit::HERTZ, FREQUENCY)?;
                self.window(center_hz, half_hz);
            }
            E4990aCommand::Span => {
                let limits = Limits { min: 0.0, ..FREQUENCY };
                let half_hz = 0.5 * value.real(Unit::HERTZ, limits)?;
                self.window(0.5 * (self.start_hz + self.stop_hz), half_hz);
            }
            E4990aCommand::Points => self.points = whole(POINTS)?,
            E4990aCommand::SweepType => {
                self.is_logarithmic = value.choice(&[("LINear", false), ("LOGarithmic", true)])?;
            }
            E4990aCommand::PointDelay => self.point_delay_s = value.real(Unit::SECOND, DELAY)?,
            E4990aCommand::Volt => self.level_v = value.real(Unit::VOLT, LEVEL)?,
            E4990aCommand::Alc => self.has_alc = value.boolean()?,
            E4990aCommand::Aperture => self.aperture = whole(1..=5)? as usize - 1,
            E4990aCommand::Average => self.has_averaging = value.boolean()?,
            E4990aCommand::AverageCount => self.averages = whole(1..=999)?,
            E4990aCommand::Source => self.source = value.choice(SOURCES)?,
            E4990aCommand::Continuous => self.is_continuous = value.boolean()?,
            E4990aCommand::ParameterCount => self.traces = whole(1..=4)?,
            E4990aCommand::Define => {
                let index = self.parameter(call)?;
                self.parameters[index] = value.choice(QUANTITIES)?;
            }
            E4990aCommand::Mode => value.choice(&[("VOLTage", ())])?,
            E4990aCommand::Format => {
                self.is_binary = value.choice(&[("ASCii", false), ("REAL", true)])?;
            }
            E4990aCommand::ByteOrder => {
                self.is_swapped = value.choice(&[("NORMal", false), ("SWAPped", true)])?;
            }
            _ => return Err(ScpiError::new(-113)),
        }
        Ok(())
    }

    fn window(&mut self, center_hz: f64, half_hz: f64) {
        self.start_hz = (center_hz - half_hz).max(FREQUENCY.min);
        self.stop_hz = (center_hz + half_hz).min(FREQUENCY.max);
    }

    fn ask(&self, call: &Call<E4990aCommand>) -> Result<Value, ScpiError> {
        let limited = |present: f64, unit: Unit, limits: Limits| {
            let asked = call.params.first().map(|word| word.real(unit, limits)).transpose()?;
            Ok(Value::Real(asked.unwrap_or(present)))
        };
        Ok(match call.command {
            E4990aCommand::Start => return limited(self.start_hz, Unit::HERTZ, FREQUENCY),
            E4990aCommand::Stop => return limited(self.stop_hz, Unit::HERTZ, FREQUENCY),
            E4990aCommand::Center => Value::Real(0.5 * (self.start_hz + self.stop_hz)),
            E4990aCommand::Span => Value::Real(self.stop_hz - self.start_hz),
            E4990aCommand::Points => Value::Integer(self.points.into()),
            E4990aCommand::SweepType => {
                Value::Characters(if self.is_logarithmic { "LOG" } else { "LIN" })
            }
            E4990aCommand::PointDelay => return limited(self.point_delay_s, Unit::SECOND, DELAY),
            E4990aCommand::Volt => return limited(self.level_v, Unit::VOLT, LEVEL),
            E4990aCommand::Alc => Value::Boolean(self.has_alc),
            E4990aCommand::Aperture => {
                Value::Integer(i64::try_from(self.aperture + 1).unwrap_or(1))
            }
            E4990aCommand::Average => Value::Boolean(self.has_averaging),
            E4990aCommand::AverageCount => Value::Integer(self.averages.into()),
            E4990aCommand::Source => {
                let known = SOURCES.iter().find(|entry| entry.1 == self.source);
                Value::Characters(known.expect("every source has a name").0)
            }
            E4990aCommand::Continuous => Value::Boolean(self.is_continuous),
            E4990aCommand::ParameterCount => Value::Integer(self.traces.into()),
            E4990aCommand::Define => {
                let shown = self.parameters[self.parameter(call)?];
                let known = QUANTITIES.iter().find(|entry| entry.1 == shown);
                Value::Characters(known.expect("every quantity has a word").0)
            }
            E4990aCommand::Mode => Value::Characters("VOLT"),
            E4990aCommand::Format => Value::Characters(if self.is_binary { "REAL" } else { "ASC" }),
            E4990aCommand::ByteOrder => {
                Value::Characters(if self.is_swapped { "SWAP" } else { "NORM" })
            }
            _ => return Err(ScpiError::new(-113)),
        })
    }
}
