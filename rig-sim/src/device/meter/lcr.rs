//! The HP 4284A and the LCR meters that follow it: Keysight's E4980A and Tonghui's `TH283x`.
//!
//! A trigger measures once, or once at every frequency of the list when the list page is shown. The
//! answer is two values and a status, in fixed widths; a list adds a fourth field to each point. A trigger is taken
//! while triggers are continuous, as after power-on and a preset, or after `INITiate`; `*RST` leaves the trigger system
//! idle.
//!
//! # Source
//! Keysight, E4980A/AL User's Guide: `FETCh?` and its data format (p. 183, 261, 265); measurement
//! times and frequency resolution as in the E4980A data sheet. HP, 4284A Operation Manual.

mod answers;
mod commands;
mod make;
#[cfg(test)]
mod tests;

use std::marker::PhantomData;

use rig_scpi::{
    Call, Dialect, ErrorFormat, Limits, Param, RealFormat, ScpiError, Tree, Unit, Value,
};

pub(crate) use self::make::{E4980a, Hp4284a, Th2832};
use self::{
    commands::{APERTURES, FUNCTIONS, KEPT, LcrCommand, Monitor, PAGES, SOURCES, Source},
    make::Make,
};
use super::{
    Drive, FinishedPoint, Job, Memory, Model, Outcome, Point, round_step,
    setting_store::SettingStore,
};

/// The resistance of the source, ohm. A current is set as what flows through it alone.
const SOURCE_OHM: f64 = 100.0;

/// The ranges of impedance, ohm.
const RANGES_OHM: [f64; 10] = [0.1, 1.0, 10.0, 100.0, 300.0, 1e3, 3e3, 1e4, 3e4, 1e5];

/// The quantity that a source holds. The other one cannot be queried.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Level {
    Volt(f64),
    Ampere(f64),
}

/// A meter of the family, which is its settings.
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the front panel")]
#[derive(Debug)]
pub(crate) struct Lcr<M> {
    make: PhantomData<M>,
    frequency_hz: f64,
    level: Level,
    bias: Level,
    has_bias: bool,
    has_high_power: bool,
    has_alc: bool,
    aperture: usize,
    averages: u32,
    function: usize,
    source: Source,
    is_continuous: bool,
    /// One trigger was enabled while they are not continuous.
    is_armed: bool,
    trigger_delay_s: f64,
    step_delay_s: f64,
    has_comparator: bool,
    has_long_digits: bool,
    is_binary: bool,
    is_swapped: bool,
    range_ohm: f64,
    is_range_auto: bool,
    /// Whether each [`Monitor`] is on, in its order.
    monitors: [bool; 4],
    list_hz: Vec<f64>,
    is_stepped: bool,
    page: &'static str,
    setting_store: SettingStore,
    kept_by_make: SettingStore,
}

impl<M> Default for Lcr<M> {
    fn default() -> Self {
        Self {
            make: PhantomData,
            has_high_power: false,
            frequency_hz: 1000.0,
            level: Level::Volt(1.0),
            bias: Level::Volt(0.0),
            has_bias: false,
            has_alc: false,
            aperture: 1,
            averages: 1,
            function: 0,
            source: Source::Internal,
            is_continuous: true,
            is_armed: false,
            trigger_delay_s: 0.0,
            step_delay_s: 0.0,
            has_comparator: false,
            has_long_digits: false,
            is_binary: false,
            is_swapped: false,
            range_ohm: 1e5,
            is_range_auto: true,
            monitors: [true, true, false, false],
            list_hz: Vec::new(),
            is_stepped: false,
            page: "MEAS",
            setting_store: SettingStore::default(),
            kept_by_make: SettingStore::default(),
        }
    }
}

/// Conditions of the operation status: a list, or a measurement, is under way.
const LIST: u16 = 1 << 3;
const MEASUREMENT: u16 = 1 << 4;

impl<M: Make> Model for Lcr<M> {
    type Command = LcrCommand;

    const ENDS_ARE_EVENTS: bool = true;

    fn commands() -> Tree<LcrCommand> {
        M::tree().clone()
    }

    fn dialect() -> Dialect {
        Dialect {
            error_format: ErrorFormat { has_plus: true, has_info: false },
            ..Dialect::standard(M::IDENTITY)
        }
    }

    fn carry_out(
        &mut self,
        call: &Call<LcrCommand>,
        memory: Memory<'_>,
    ) -> Result<Outcome, ScpiError> {
        let done = |values| Ok(Outcome::Done(values));
        let Memory { readings, is_measuring } = memory;
        match call.command {
            LcrCommand::Reset | LcrCommand::Preset => {
                // A preset leaves the trigger system on, as at power-on.
                let is_continuous = call.command == LcrCommand::Preset;
                *self = Self { is_continuous, ..Self::default() };
                Ok(Outcome::Reset)
            }
            LcrCommand::Abort => {
                self.is_armed = false;
                Ok(Outcome::Abort)
            }
            LcrCommand::Options => done(vec![Value::Verbatim(M::OPTIONS.into())]),
            // A trigger system that is idle ignores a trigger.
            LcrCommand::Trigger | LcrCommand::TriggerAndRead if !self.takes_trigger() => {
                Err(ScpiError::new(-211))
            }
            LcrCommand::TriggerAndRead if self.source == Source::Bus => {
                Ok(self.triggered(true, is_measuring))
            }
            LcrCommand::Trigger if self.source != Source::Internal => {
                Ok(self.triggered(false, is_measuring))
            }
            LcrCommand::Trigger | LcrCommand::TriggerAndRead => Err(ScpiError::new(-211)),
            LcrCommand::Monitor(Monitor::Vdc | Monitor::Idc)
            | LcrCommand::FetchMonitor(Monitor::Vdc | Monitor::Idc)
                if !M::MONITORS_BIAS =>
            {
                Err(ScpiError::new(-113))
            }
            // While it triggers itself, the next measurement is the one to read.
            LcrCommand::Fetch | LcrCommand::FetchImpedance | LcrCommand::FetchMonitor(_)
                if self.source == Source::Internal && self.takes_trigger() =>
            {
                Ok(self.triggered(true, is_measuring))
            }
            LcrCommand::Fetch if is_measuring && !M::FETCH_WAITS => {
                done(self.not_yet(call.command))
            }
            LcrCommand::Fetch | LcrCommand::FetchImpedance | LcrCommand::FetchMonitor(_)
                if is_measuring =>
            {
                Ok(Outcome::Wait)
            }
            LcrCommand::Fetch | LcrCommand::FetchImpedance | LcrCommand::FetchMonitor(_)
                if readings.is_empty() =>
            {
                done(self.not_yet(call.command))
            }
            LcrCommand::Fetch | LcrCommand::FetchImpedance | LcrCommand::FetchMonitor(_) => {
                done(self.answer(call.command, readings))
            }
            LcrCommand::StoredSetting(row) => {
                self.setting_store.obey(&KEPT[row], row, call, scientific(5)).and_then(done)
            }
            LcrCommand::Own(row) => {
                self.kept_by_make.obey(&M::KEPT[row], row, call, scientific(5)).and_then(done)
            }
            LcrCommand::ListClear => {
                self.list_hz.clear();
                done(Vec::new())
            }
            LcrCommand::Init => {
                self.is_armed = true;
                done(Vec::new())
            }
            _ if call.is_query => self.ask(call, readings).and_then(done),
            _ => self.set(call).map(|()| Outcome::Done(Vec::new())),
        }
    }

    fn drive(&self) -> Drive {
        Drive { frequency_hz: self.frequency_hz, level_v: self.open_v() }
    }

    fn answer(&self, command: LcrCommand, readings: &[FinishedPoint]) -> Vec<Value> {
        self.answer_with(command, readings)
    }

    fn busy_bits(&self) -> u16 {
        if self.shows_list() { LIST | MEASUREMENT } else { MEASUREMENT }
    }

    fn may_interrupt(command: LcrCommand) -> bool {
        matches!(command, LcrCommand::Abort | LcrCommand::Reset | LcrCommand::Preset)
    }
}

impl<M: Make> Lcr<M> {
    fn frequency() -> Limits {
        Limits { min: 20.0, max: M::MAX_HZ, default: 1000.0 }
    }

    /// The limit that holds, of those without high power and with it.
    const fn limit(&self, limits: (f64, f64)) -> f64 {
        if self.has_high_power { limits.1 } else { limits.0 }
    }

    fn level(&self) -> Limits {
        Limits { min: 0.0, max: self.limit(M::MAX_V), default: 1.0 }
    }

    fn current(&self) -> Limits {
        Limits { min: 0.0, max: self.limit(M::MAX_A), default: 0.0 }
    }

    fn bias(&self) -> Limits {
        let max = self.limit(M::MAX_BIAS_V);
        Limits { min: -max, max, default: 0.0 }
    }

    fn shows_list(&self) -> bool {
        self.page == "LIST"
    }

    /// The level of the source without load, V.
    fn open_v(&self) -> f64 {
        match self.level {
            Level::Volt(volt) => volt,
            Level::Ampere(ampere) => ampere * SOURCE_OHM,
        }
    }

    fn delay() -> Limits {
        Limits { min: 0.0, max: M::MAX_DELAY_S, default: 0.0 }
    }

    /// Whether the trigger system waits for a trigger.
    const fn takes_trigger(&self) -> bool {
        self.is_continuous || self.is_armed
    }

    /// Takes a trigger, unless a measurement is under way, which it does not interrupt.
    fn triggered(&mut self, is_answered: bool, is_measuring: bool) -> Outcome {
        self.is_armed &= is_measuring;
        self.measure(is_answered)
    }

    fn measure(&self, is_answered: bool) -> Outcome {
        let is_sweep = self.shows_list() && !self.list_hz.is_empty();
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
        // A status query does not wait for a list; it waits for a single measurement.
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

    fn set(&mut self, call: &Call<LcrCommand>) -> Result<(), ScpiError> {
        let value = call.param(0)?;
        match call.command {
            LcrCommand::Frequency => {
                self.frequency_hz = M::nearest_hz(value.real(Unit::HERTZ, Self::frequency())?);
            }
            LcrCommand::Volt => {
                let volt = value.real(Unit::VOLT, self.level())?;
                self.level = Level::Volt(round_step(volt, 1e-3));
            }
            LcrCommand::Current => {
                self.level = Level::Ampere(value.real(Unit::AMPERE, self.current())?);
            }
            LcrCommand::BiasVolt => self.bias = Level::Volt(value.real(Unit::VOLT, self.bias())?),
            LcrCommand::BiasCurrent => {
                self.bias = Level::Ampere(value.real(Unit::AMPERE, BIAS_CURRENT)?);
            }
            // The sensor is linear: a bias changes nothing.
            LcrCommand::BiasState => self.has_bias = value.boolean()?,
            LcrCommand::HighPower if M::MAX_V.0 == M::MAX_V.1 => return Err(ScpiError::new(-113)),
            LcrCommand::HighPower => self.has_high_power = value.boolean()?,
            LcrCommand::Alc => self.has_alc = value.boolean()?,
            LcrCommand::Aperture => {
                self.aperture = value.choice(&APERTURES)?;
                if let Ok(averages) = call.param(1) {
                    let averages = averages.integer(1..=256)?;
                    self.averages = u32::try_from(averages).expect("it is at most 256");
                }
            }
            LcrCommand::Function => {
                let index = |wanted| FUNCTIONS.iter().position(|entry| entry.1 == wanted);
                self.function = index(value.choice(FUNCTIONS)?).expect("it is one of them");
            }
            LcrCommand::Source => self.source = value.choice(SOURCES)?,
            LcrCommand::Continuous => self.is_continuous = value.boolean()?,
            LcrCommand::TriggerDelay if !M::HAS_TRIGGER_DELAY => return Err(ScpiError::new(-113)),
            LcrCommand::TriggerDelay => {
                self.trigger_delay_s = value.real(Unit::SECOND, Self::delay())?;
            }
            LcrCommand::StepDelay => self.step_delay_s = value.real(Unit::SECOND, Self::delay())?,
            LcrCommand::Comparator => self.has_comparator = value.boolean()?,
            LcrCommand::LongDigits => self.has_long_digits = value.boolean()?,
            LcrCommand::List => {
                let read = |param: &Param| param.real(Unit::HERTZ, Self::frequency());
                let list: Result<Vec<f64>, ScpiError> = call.params.iter().map(read).collect();
                self.list_hz = list?.into_iter().map(M::nearest_hz).collect();
            }
            LcrCommand::ListMode => {
                self.is_stepped = value.choice(&[("SEQuence", false), ("STEPped", true)])?;
            }
            LcrCommand::Page => self.page = value.choice(PAGES)?,
            LcrCommand::RangeAuto => self.is_range_auto = value.boolean()?,
            LcrCommand::Range => {
                let (min, max) = (RANGES_OHM[0], RANGES_OHM[RANGES_OHM.len() - 1]);
                let asked = value.real(Unit::OHM, Limits { min, max, default: max })?;
                self.range_ohm = range_below(asked);
                self.is_range_auto = false;
            }
            LcrCommand::Monitor(monitor) => self.monitors[monitor as usize] = value.boolean()?,
            LcrCommand::Format => {
                self.is_binary = value.choice(&[("ASCii", false), ("REAL", true)])?;
                // The only length there is, in bits.
                call.params.get(1).map(|bits| bits.integer(64..=64)).transpose()?;
            }
            LcrCommand::ByteOrder => {
                self.is_swapped = value.choice(&[("NORMal", false), ("SWAPped", true)])?;
            }
            _ => return Err(ScpiError::new(-113)),
        }
        Ok(())
    }
}

/// Limits of the bias current, A.
const BIAS_CURRENT: Limits = Limits { min: -0.1, max: 0.1, default: 0.0 };

const fn scientific(n_decimals: u8) -> RealFormat {
    RealFormat::Scientific { n_decimals, n_exponent: 2, has_plus: true }
}

/// The widest range that does not exceed an impedance, ohm.
fn range_below(ohm: f64) -> f64 {
    RANGES_OHM.iter().rev().find(|range| **range <= ohm).copied().unwrap_or(RANGES_OHM[0])
}
