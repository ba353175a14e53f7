//! What an impedance analyzer must be told, as data.

use rig_model::{AnalyzerMake, Terminator};

use super::template::Template;

/// The messages, ranges and transport rules of a make of analyzers.
#[derive(Debug, Clone, PartialEq)]
pub struct Dialect {
    /// Name in rig files and messages.
    pub name: String,
    /// The models that it is for, as people read them.
    pub models: String,
    /// Beginnings of the model field of the identity.
    pub model_prefixes: Vec<String>,
    /// The make that plays it on a simulated rig; `None` if none does.
    pub simulated_as: Option<AnalyzerMake>,
    /// Lowest and highest frequency, Hz.
    pub frequency_hz: (f64, f64),
    /// Lowest and highest level without options, V.
    pub level_v: (f64, f64),
    /// Resolution of the frequency setting.
    pub resolution: Resolution,
    /// An option that drives more.
    pub high_power: Option<HighPower>,
    /// Longest delay between trigger and measurement, s.
    pub delay_max_s: f64,
    /// Rules of the connection.
    pub transport: TransportRules,
    /// The commands that measure.
    pub commands: CommandSet,
    /// How it corrects for its cables and its fixture; `None` if rigd does not know.
    pub compensation: Option<Compensation>,
}

/// Resolution of a frequency setting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Resolution {
    /// A fixed step, Hz.
    Step(f64),
    /// A number of digits, but no finer than this, Hz.
    Digits(i32, f64),
    /// Its own list of frequencies, of which it takes the nearest; within this share.
    Nearest(f64),
}

impl Resolution {
    /// The frequency, Hz, that the instrument is expected to set for a requested one.
    pub fn round(self, frequency_hz: f64) -> f64 {
        let Some(step) = self.step_hz(frequency_hz) else { return frequency_hz };
        // Rounded to the nearest float.
        let per_hz = 1.0 / step;
        if 1.0 <= per_hz {
            (frequency_hz * per_hz.round()).round() / per_hz.round()
        } else {
            (frequency_hz / step).round() * step
        }
    }

    /// Tolerance of the reported frequency, Hz.
    pub fn tolerance_hz(self, frequency_hz: f64) -> f64 {
        match self {
            Self::Nearest(share) => share * frequency_hz,
            _ => 0.5 * self.step_hz(frequency_hz).unwrap_or(0.0),
        }
    }

    /// The step at a frequency; `None` without a fixed step.
    fn step_hz(self, frequency_hz: f64) -> Option<f64> {
        match self {
            Self::Step(step) => Some(step),
            Self::Digits(digits, finest_hz) => {
                let exponent = frequency_hz.log10().floor() + 1.0;
                Some(10_f64.powf(exponent - f64::from(digits)).max(finest_hz))
            }
            Self::Nearest(_) => None,
        }
    }
}

/// An option that drives more.
#[derive(Debug, Clone, PartialEq)]
pub struct HighPower {
    /// Name of the option in the answer to `*OPT?`.
    pub option: String,
    /// Highest level with it, V.
    pub max_v: f64,
    /// Command that switches it on before the level is set, if it needs one.
    pub switch: Option<Template>,
}

/// Transport of messages, apart from their contents.
#[derive(Debug, Clone, PartialEq)]
pub struct TransportRules {
    /// Terminator of messages to the instrument. Its answers end with a line feed; a carriage
    /// return before it is dropped.
    pub terminator: Terminator,
    /// Sent before anything else, to make the answers readable.
    pub greeting: Option<Template>,
    /// Whether there is an error queue behind the bits of `*ESR?`.
    pub has_error_queue: bool,
    /// The transfer of characters.
    pub handshake: Handshake,
}

/// The transfer of characters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Handshake {
    /// One after the other.
    None,
    /// Each after the instrument has sent the last one back, as those of Tonghui want it on
    /// RS-232.
    EchoEachCharacter,
}

impl Dialect {
    /// Highest level with every option, V. Whether the instrument has them shows when it is connected.
    pub fn highest_level_v(&self) -> f64 {
        self.high_power.as_ref().map_or(self.level_v.1, |option| option.max_v)
    }

    /// How long a reading integrates at least at this frequency, Hz, in s.
    pub fn shortest_integration_s(&self, frequency_hz: f64) -> f64 {
        let cycles = match &self.commands {
            CommandSet::TraceE4990a => 1,
            CommandSet::Points(commands) => commands.integration.cycles.at(frequency_hz),
        };
        f64::from(cycles) / frequency_hz
    }
}

/// The commands that measure.
#[derive(Debug, Clone, PartialEq)]
pub enum CommandSet {
    /// One frequency after the other, by the messages of the file.
    Points(Box<PointCommands>),
    /// A trace at a time, by the commands of the Keysight E4990A, which are code.
    TraceE4990a,
}

/// The messages that measure one frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct PointCommands {
    /// Settings, once before the measurements; one of them holds the level.
    pub setup: Vec<Template>,
    /// Asks for the level, V.
    pub level: Template,
    /// Sets the frequency.
    pub set_frequency: Template,
    /// Asks for the frequency, Hz.
    pub frequency: Template,
    /// Sets the number of measurements that one trigger averages.
    pub set_averages: Template,
    /// Sets the time between trigger and measurement.
    pub set_delay: Template,
    /// Starts a measurement.
    pub trigger: Template,
    /// Asks whether the measurement is over, if the answer to [`read`](Self::read) does not wait.
    pub poll: Option<Poll>,
    /// Asks for the measurement.
    pub read: Template,
    /// The cycles of one measurement.
    pub integration: IntegrationRule,
    /// The fields of the answer.
    pub answer: AnswerForm,
}

/// A question that is repeated until one of its bits is set.
#[derive(Debug, Clone, PartialEq)]
pub struct Poll {
    /// The question, which is answered by a whole number.
    pub ask: Template,
    /// The measurement is over when one of these bits is set.
    pub mask: u32,
    /// Longest wait beyond the delay and the integration, s.
    pub timeout_s: f64,
}

/// The cycles of one measurement, and the most that one trigger averages.
#[derive(Debug, Clone, PartialEq)]
pub struct IntegrationRule {
    /// The most measurements that one trigger averages.
    pub averages_max: u32,
    /// The cycles of one measurement.
    pub cycles: CyclesRule,
}

/// The cycles of one measurement.
#[derive(Debug, Clone, PartialEq)]
pub enum CyclesRule {
    /// Always as many.
    Fixed(u32),
    /// The whole cycles that fit in the measurement time, s, by frequency, Hz, rising. Between two
    /// frequencies it goes in straight lines on logarithmic scales.
    Times(Vec<(f64, f64)>),
}

impl CyclesRule {
    /// The cycles at this frequency, Hz.
    pub fn at(&self, frequency_hz: f64) -> u32 {
        let times = match self {
            Self::Fixed(cycles) => return *cycles,
            Self::Times(times) => times,
        };
        let pairs = || times.windows(2);
        let pair = pairs().find(|pair| frequency_hz <= pair[1].0).or_else(|| pairs().last());
        let Some([(low_hz, low_s), (high_hz, high_s)]) = pair else { return 1 };
        let share = ((frequency_hz / low_hz).ln() / (high_hz / low_hz).ln()).clamp(0.0, 1.0);
        let time_s = low_s.powf(1.0 - share) * high_s.powf(share);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "it is positive"
        )]
        let cycles = (time_s * frequency_hz).floor() as u32;
        cycles.max(1)
    }
}

/// The fields of an answer.
#[derive(Debug, Clone, PartialEq)]
pub struct AnswerForm {
    /// The fields, in order.
    pub fields: Vec<AnswerField>,
    /// Fields that may come behind them, and are not read.
    pub spare_fields: usize,
    /// The meanings of the status, if it has one.
    pub status: Option<StatusWords>,
}

/// A field of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnswerField {
    /// Resistance, Ω.
    Resistance,
    /// Reactance, Ω.
    Reactance,
    /// Magnitude of the impedance, Ω.
    Impedance,
    /// Phase of the impedance, degrees.
    PhaseDeg,
    /// Phase of the impedance, rad.
    PhaseRad,
    /// Conductance, S.
    Conductance,
    /// Susceptance, S.
    Susceptance,
    /// A whole number that says whether the measurement is good.
    Status,
    /// Not read.
    Ignored,
}

/// The meaning of a status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StatusMeaning {
    /// The measurement is good.
    Sound,
    /// The measurement is under way: it is asked for again.
    Pending,
    /// There is no value.
    Overload,
    /// The value is doubtful, as the level could not be held.
    LowSignal,
}

/// The words of a status.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StatusWords {
    /// Words with their meanings.
    pub words: Vec<(i64, StatusMeaning)>,
    /// The meaning of every other word.
    pub other: StatusMeaning,
}

impl StatusWords {
    /// The meaning of a word.
    pub fn meaning(&self, word: i64) -> StatusMeaning {
        let known = self.words.iter().find(|(known, _)| *known == word);
        known.map_or(self.other, |(_, meaning)| *meaning)
    }
}

/// The corrections for cable and fixture.
#[derive(Debug, Clone, PartialEq)]
pub struct Compensation {
    /// The length of the cable, if it can be set.
    pub cable: Option<CableLength>,
    /// With nothing between the terminals.
    pub open: Correction,
    /// With the terminals connected.
    pub short: Correction,
    /// With a known impedance between the terminals, if the file has it.
    pub load: Option<Correction>,
}

/// The length of the cable, as the analyzer takes it.
#[derive(Debug, Clone, PartialEq)]
pub struct CableLength {
    /// Sets the length.
    pub set: Template,
    /// Asks for the length, m.
    pub ask: Template,
    /// The lengths that it takes, m.
    pub lengths_m: Vec<f64>,
}

/// One correction.
#[derive(Debug, Clone, PartialEq)]
pub struct Correction {
    /// Measures what is to be corrected.
    pub measure: Template,
    /// Longest duration of that, s.
    pub within_s: f64,
    /// Switches the correction on.
    pub switch_on: Template,
    /// Asks whether it is on: 1 or ON.
    pub state: Template,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frequency_is_rounded_as_the_instrument_will() {
        let rows = [
            (Resolution::Step(0.01), 200.123, 200.12),
            (Resolution::Step(0.01), 139.998, 140.0),
            (Resolution::Digits(4, 0.0), 140.04, 140.0),
            (Resolution::Digits(4, 0.0), 140.06, 140.1),
            (Resolution::Digits(4, 0.0), 99.996, 100.0),
            (Resolution::Digits(4, 0.0), 12_345.0, 12_350.0),
            (Resolution::Digits(5, 0.01), 99.996, 100.0),
            (Resolution::Digits(5, 0.01), 4.567, 4.57),
            (Resolution::Digits(5, 0.01), 1487.29, 1487.3),
            (Resolution::Digits(5, 0.01), 123_456.0, 123_460.0),
            (Resolution::Nearest(0.01), 123.4567, 123.4567),
        ];
        for (resolution, asked, expected) in rows {
            assert_eq!(resolution.round(asked), expected, "{resolution:?} {asked}");
            assert!((asked - expected).abs() <= resolution.tolerance_hz(asked) + 1e-9);
        }
    }

    #[test]
    fn whole_cycles_follow_the_measurement_times() {
        let times = [(20.0, 0.330), (100.0, 0.100), (1e3, 0.020), (1e4, 0.0077)];
        let rule = CyclesRule::Times(times.to_vec());
        assert_eq!([20.0, 100.0, 1000.0].map(|hz| rule.at(hz)), [6, 10, 20]);
        assert_eq!([140.0, 300.0].map(|hz| rule.at(hz)), [11, 13]);
        assert_eq!(rule.at(2e6), 15_400);
        assert_eq!(CyclesRule::Fixed(3).at(140.0), 3);
    }
}
