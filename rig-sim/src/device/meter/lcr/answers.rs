//! The answers of the family.

use num_complex::Complex64;
use rig_scpi::{Call, Limits, ScpiError, Unit, Value};

use super::{
    super::{FinishedPoint, binary},
    BIAS_CURRENT, Lcr, Level, RANGES_OHM, SOURCE_OHM,
    commands::{APERTURES, FUNCTIONS, LcrCommand, Monitor, SOURCES},
    make::Make,
    range_below, scientific,
};

/// Replaces a missing value, as the status says.
const NO_VALUE: f64 = 9.9e37;

/// One number of an answer.
#[derive(Debug, Clone, Copy)]
enum Field {
    Value(f64),
    Status(i32),
}

impl<M: Make> Lcr<M> {
    /// The answer to a command that fetches.
    pub(super) fn answer_with(
        &self,
        command: LcrCommand,
        readings: &[FinishedPoint],
    ) -> Vec<Value> {
        match command {
            LcrCommand::FetchMonitor(monitor) => vec![self.real(self.monitored(monitor, readings))],
            LcrCommand::FetchImpedance => {
                let pair = |z: Complex64| [z.re, z.im];
                let fields = readings.iter().flat_map(|reading| {
                    reading.impedance_ohm.map_or([NO_VALUE; 2], pair).map(|value| self.real(value))
                });
                fields.collect()
            }
            _ => self.in_format(readings.iter().flat_map(|reading| self.fields(reading))),
        }
    }

    /// The value of a monitor beside the last reading. The sensor blocks a bias: no current flows.
    fn monitored(&self, monitor: Monitor, readings: &[FinishedPoint]) -> f64 {
        let impedance_ohm = readings.last().and_then(|reading| reading.impedance_ohm);
        let ampere = impedance_ohm.map(|z| self.open_v() / (z + SOURCE_OHM).norm());
        let shown = match (monitor, self.bias) {
            _ if !self.monitors[monitor as usize] => None,
            (Monitor::Iac, _) => ampere,
            (Monitor::Vac, _) => ampere.zip(impedance_ohm).map(|(ampere, z)| ampere * z.norm()),
            (Monitor::Vdc, Level::Volt(volt)) if self.has_bias => Some(volt),
            (Monitor::Vdc | Monitor::Idc, _) => Some(0.0),
        };
        shown.unwrap_or(NO_VALUE)
    }

    /// The range in use, which follows the impedance unless it is held.
    fn range_ohm(&self, readings: &[FinishedPoint]) -> f64 {
        let last = readings.last().and_then(|reading| reading.impedance_ohm);
        match last.filter(|_| self.is_range_auto) {
            Some(z) => range_below(z.norm()),
            None => self.range_ohm,
        }
    }

    /// Two values and a status, and the bin of the comparator, which a list always has.
    fn fields(&self, reading: &FinishedPoint) -> impl Iterator<Item = Field> + use<M> {
        let (a, b) = FUNCTIONS[self.function].1;
        let pair = [a, b].map(|quantity| {
            let found = reading.impedance_ohm.map(|z| quantity.of(z, reading.frequency_hz));
            Field::Value(found.unwrap_or(NO_VALUE))
        });
        let status = i32::from(reading.impedance_ohm.is_none());
        let bin = (self.shows_list() || self.has_comparator).then_some(Field::Status(0));
        pair.into_iter().chain([Field::Status(status)]).chain(bin)
    }

    /// The answer to a command that fetches while there is no reading.
    pub(super) fn not_yet(&self, command: LcrCommand) -> Vec<Value> {
        let value = Field::Value(NO_VALUE);
        match command {
            LcrCommand::FetchMonitor(_) => vec![self.real(NO_VALUE)],
            LcrCommand::FetchImpedance => vec![self.real(NO_VALUE), self.real(NO_VALUE)],
            _ => self.in_format([value, value, Field::Status(-1)].into_iter()),
        }
    }

    /// The fields as text, or as one block.
    fn in_format(&self, fields: impl Iterator<Item = Field>) -> Vec<Value> {
        if self.is_binary {
            let numbers = fields.map(|field| match field {
                Field::Value(value) => value,
                Field::Status(status) => status.into(),
            });
            return vec![binary(numbers, self.is_swapped)];
        }
        let text = fields.map(|field| match field {
            Field::Value(value) => self.real(value),
            Field::Status(status) => Value::Verbatim(format!("{status:+}").into()),
        });
        text.collect()
    }

    fn real(&self, value: f64) -> Value {
        let n_decimals = if self.has_long_digits { 9 } else { 5 };
        Value::Formatted(value, scientific(n_decimals))
    }

    pub(super) fn ask(
        &self,
        call: &Call<LcrCommand>,
        readings: &[FinishedPoint],
    ) -> Result<Vec<Value>, ScpiError> {
        let limited = |present: f64, unit: Unit, limits: Limits| {
            // `FREQ? MAX` asks for the limit instead.
            let value = match call.params.first() {
                Some(word) => word.real(unit, limits)?,
                None => present,
            };
            Ok(vec![Value::Formatted(value, scientific(9))])
        };
        // Of a voltage and a current, only the one that is set is known.
        let known = |level: Option<f64>| {
            let is_limit = !call.params.is_empty();
            level.or(is_limit.then_some(0.0)).ok_or(ScpiError::new(-221))
        };
        let volt = |level: Level| if let Level::Volt(volt) = level { Some(volt) } else { None };
        let ampere = |level: Level| if let Level::Ampere(a) = level { Some(a) } else { None };
        let ranges = Limits { min: RANGES_OHM[0], max: 1e5, default: 1e5 };
        let switch = |is_on: bool| vec![Value::Boolean(is_on)];
        let word = |word: &'static str| vec![Value::Characters(word)];
        Ok(match call.command {
            LcrCommand::Frequency => {
                return limited(self.frequency_hz, Unit::HERTZ, Self::frequency());
            }
            LcrCommand::Volt => return limited(known(volt(self.level))?, Unit::VOLT, self.level()),
            LcrCommand::Current => {
                return limited(known(ampere(self.level))?, Unit::AMPERE, self.current());
            }
            LcrCommand::BiasVolt => {
                return limited(known(volt(self.bias))?, Unit::VOLT, self.bias());
            }
            LcrCommand::BiasCurrent => {
                return limited(known(ampere(self.bias))?, Unit::AMPERE, BIAS_CURRENT);
            }
            LcrCommand::Range => return limited(self.range_ohm(readings), Unit::OHM, ranges),
            LcrCommand::TriggerDelay => {
                return limited(self.trigger_delay_s, Unit::SECOND, Self::delay());
            }
            LcrCommand::StepDelay => {
                return limited(self.step_delay_s, Unit::SECOND, Self::delay());
            }
            LcrCommand::HighPower => switch(self.has_high_power),
            LcrCommand::Alc => switch(self.has_alc),
            LcrCommand::BiasState => switch(self.has_bias),
            LcrCommand::Continuous => switch(self.is_continuous),
            LcrCommand::Comparator => switch(self.has_comparator),
            LcrCommand::LongDigits => switch(self.has_long_digits),
            LcrCommand::RangeAuto => switch(self.is_range_auto),
            LcrCommand::Monitor(monitor) => switch(self.monitors[monitor as usize]),
            LcrCommand::Aperture => {
                let averages = Value::Integer(self.averages.into());
                vec![Value::Characters(APERTURES[self.aperture].0), averages]
            }
            LcrCommand::Function => word(FUNCTIONS[self.function].0),
            LcrCommand::Source => {
                let known = SOURCES.iter().find(|entry| entry.1 == self.source);
                word(known.expect("every source has a name").0)
            }
            LcrCommand::List => {
                self.list_hz.iter().map(|hz| Value::Formatted(*hz, scientific(9))).collect()
            }
            LcrCommand::ListMode => word(if self.is_stepped { "STEP" } else { "SEQ" }),
            LcrCommand::Page => word(self.page),
            LcrCommand::Format if self.is_binary => {
                vec![Value::Characters("REAL"), Value::Integer(64)]
            }
            LcrCommand::Format => word("ASC"),
            LcrCommand::ByteOrder => word(if self.is_swapped { "SWAP" } else { "NORM" }),
            _ => return Err(ScpiError::new(-113)),
        })
    }
}
