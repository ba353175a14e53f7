//! The known analyzers and their abilities.

use rig_model::AnalyzerMake;
use rig_scpi::Ending;

use crate::{hioki, lcr, lcr::LcrVariant, trace};

/// The command set, ranges and transport rules of a make of analyzers.
#[derive(Debug, Clone, Copy)]
pub struct Dialect {
    /// The make, with its name in rig files and its ranges.
    pub make: AnalyzerMake,
    /// The models it is for, as people read them.
    pub models: &'static str,
    /// Beginnings of the model field of the identity.
    pub model_prefixes: &'static [&'static str],
    /// Resolution of the frequency setting.
    pub resolution: Resolution,
    /// An option that drives more.
    pub high_power: Option<HighPower>,
    /// Longest delay between trigger and measurement, s.
    pub delay_max_s: f64,
    /// Rules of the connection: handshake and echo of serial lines.
    pub transport: TransportRules,
    pub(crate) commands: CommandSet,
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
    /// The frequency that the instrument is expected to set for a requested one.
    pub(crate) fn round(self, frequency_hz: f64) -> f64 {
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
    pub(crate) fn tolerance_hz(self, frequency_hz: f64) -> f64 {
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
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HighPower {
    /// Name of the option in the answer to `*OPT?`.
    pub option: &'static str,
    /// Highest level with it, V.
    pub max_v: f64,
    /// Command that switches it on, if it needs one.
    pub(crate) switch: Option<&'static str>,
}

/// Transport of messages, apart from their contents.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TransportRules {
    /// Terminator of messages to the instrument. Its answers end with a line feed; a carriage
    /// return before it is dropped.
    pub ending: Ending,
    /// Whether answers may begin with their header, which has to be switched off first.
    pub has_headers: bool,
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

/// The commands of an analyzer.
#[derive(Debug, Clone, Copy)]
pub(crate) enum CommandSet {
    /// One frequency after the other.
    Points(PointCommands),
    /// A trace at a time.
    Trace,
}

/// Families of commands that measure one frequency.
#[derive(Debug, Clone, Copy)]
pub(crate) enum PointCommands {
    Hioki,
    Lcr(&'static LcrVariant),
}

/// HIOKI IM3536, which gives 5 V at 100–300 Hz.
///
/// # Source
/// HIOKI, IM3536 Instruction Manual, specifications (a frequency has five digits, and 10 mHz at the
/// finest); Communication Instruction Manual.
pub static HIOKI_IM3536: Dialect = Dialect {
    make: AnalyzerMake::HiokiIm3536,
    models: "HIOKI IM3536, IM3533 or IM3570",
    model_prefixes: &["IM3536", "IM3533", "IM3570"],
    resolution: Resolution::Digits(5, 0.01),
    high_power: None,
    delay_max_s: hioki::DELAY_MAX_S,
    transport: TransportRules {
        ending: Ending::CrLf,
        has_headers: true,
        has_error_queue: false,
        handshake: Handshake::None,
    },
    commands: CommandSet::Points(PointCommands::Hioki),
};

const SCPI: TransportRules = TransportRules {
    ending: Ending::Lf,
    has_headers: false,
    has_error_queue: true,
    handshake: Handshake::None,
};

/// Keysight E4980A. Option 001 drives 20 V.
///
/// # Source
/// Keysight, E4980A/AL User's Guide, and data sheet 5989-4235EN.
pub static KEYSIGHT_E4980A: Dialect = Dialect {
    make: AnalyzerMake::KeysightE4980a,
    models: "Keysight E4980A",
    model_prefixes: &["E4980A"],
    resolution: Resolution::Digits(4, 0.0),
    high_power: Some(HighPower { option: "001", max_v: 20.0, switch: None }),
    delay_max_s: lcr::DELAY_MAX_S,
    transport: SCPI,
    commands: CommandSet::Points(PointCommands::Lcr(&lcr::E4980A)),
};

/// HP 4284A, the forerunner of the E4980A. Option 001 drives 20 V when it is switched on.
///
/// # Source
/// HP, 4284A Precision LCR Meter Operation Manual.
pub static HP_4284A: Dialect = Dialect {
    make: AnalyzerMake::Hp4284a,
    models: "HP or Agilent 4284A",
    model_prefixes: &["4284A", "HP4284A"],
    // 8610 frequencies, at most one percent apart.
    resolution: Resolution::Nearest(0.01),
    high_power: Some(HighPower { option: "001", max_v: 20.0, switch: Some(":OUTPut:HPOWer") }),
    delay_max_s: lcr::OLD_DELAY_MAX_S,
    transport: SCPI,
    commands: CommandSet::Points(PointCommands::Lcr(&lcr::HP_4284A)),
};

/// Tonghui `TH283x` on RS-232.
///
/// # Source
/// Tonghui, operation manuals of the TH2830 and TH1953 series, remote control.
pub static TONGHUI_TH283X: Dialect = Dialect {
    make: AnalyzerMake::TonghuiTh283x,
    models: "Tonghui TH2830, TH2831, TH2832 or TH2838",
    model_prefixes: &["TH283"],
    resolution: Resolution::Digits(4, 0.0),
    high_power: None,
    delay_max_s: lcr::OLD_DELAY_MAX_S,
    transport: TransportRules { handshake: Handshake::EchoEachCharacter, ..SCPI },
    commands: CommandSet::Points(PointCommands::Lcr(&lcr::TH283X)),
};

/// Keysight E4990A, which sweeps a trace and drives at most 1 V.
///
/// # Source
/// Keysight, E4990A Help, command reference.
pub static KEYSIGHT_E4990A: Dialect = Dialect {
    make: AnalyzerMake::KeysightE4990a,
    models: "Keysight E4990A",
    model_prefixes: &["E4990A"],
    resolution: Resolution::Step(0.001),
    high_power: None,
    delay_max_s: trace::DELAY_MAX_S,
    transport: SCPI,
    commands: CommandSet::Trace,
};

impl Dialect {
    /// The dialect that analyzers of this make speak.
    pub const fn of(make: AnalyzerMake) -> &'static Self {
        match make {
            AnalyzerMake::HiokiIm3536 => &HIOKI_IM3536,
            AnalyzerMake::KeysightE4980a => &KEYSIGHT_E4980A,
            AnalyzerMake::Hp4284a => &HP_4284A,
            AnalyzerMake::TonghuiTh283x => &TONGHUI_TH283X,
            AnalyzerMake::KeysightE4990a => &KEYSIGHT_E4990A,
        }
    }
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
    fn every_make_has_its_own_dialect() {
        for make in AnalyzerMake::ALL {
            assert_eq!(Dialect::of(make).make, make);
        }
    }
}
