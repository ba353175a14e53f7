//! The faults of a sweep file.

use crate::Complaint;

use super::{cells::Separator, quantity::Quantity};

/// A fault of a sweep file, without its place.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum SweepFileFault {
    #[error("the file holds no readings")]
    Empty,
    #[error("a sweep has more than {max} readings")]
    TooManyReadings { max: usize },
    #[error("the file has more than {max} rows")]
    TooManyRows { max: usize },
    #[error("all {readings} readings are at {frequency_hz} Hz")]
    OneFrequency { readings: usize, frequency_hz: f64 },
    #[error("the file is not text: it has a zero byte in this line")]
    NotText,
    #[error("the file has more faults than the {shown} above")]
    More { shown: usize },

    // The header.
    #[error("no line names the columns")]
    NoHeader,
    #[error("no column is a frequency")]
    NoFrequency,
    #[error("no columns make an impedance")]
    NoImpedance,
    #[error("`{header}` is a second column for the {}", quantity.name())]
    RepeatedColumn { header: String, quantity: Quantity },
    #[error("`{unit}` is not a unit of the {}", quantity.name())]
    UnknownUnit { unit: String, quantity: Quantity },
    #[error("the phase beside |Y| may be that of the impedance or that of the admittance")]
    PhaseOfWhat,
    #[error(
        "the frequency has no unit, and all values are below {min_hz}, the lowest of any analyzer in Hz"
    )]
    UnitlessFrequency { min_hz: f64 },
    #[error("the phase has no unit, and within ±π it may be in degrees or in radians")]
    UnitlessPhase { key: &'static str },

    // A row.
    #[error("{found} cells where the header has {expected}")]
    Cells { found: usize, expected: usize, separator: Separator },
    #[error(
        "{found} cells where line {first_line} has {expected}: between blanks, none can be empty"
    )]
    OtherCells { found: usize, expected: usize, first_line: usize },
    #[error("the quotation mark is not closed")]
    OpenQuote,
    #[error("the {} is missing", quantity.name())]
    EmptyCell { quantity: Quantity },
    #[error("`{text}` is not a number")]
    NotANumber { text: String },
    #[error("`{text}` has a different decimal mark from the numbers before")]
    MixedMarks { text: String },
    #[error("the comma of `{text}` may be a decimal mark or one for thousands")]
    Thousands { text: String },
    #[error("{} = {found} is outside [{min:e}, {max:e}]", quantity.key())]
    OutOfRange { quantity: Quantity, found: f64, min: f64, max: f64 },
    #[error("an impedance of zero was not measured")]
    ZeroImpedance,
    #[error("an admittance of zero was not measured")]
    ZeroAdmittance,
    #[error("`{text}` is not one of normal, low_signal, overload")]
    UnknownFlag { text: String },
    #[error("`{text}` is neither true nor false")]
    NotABool { text: String },
    #[error("`{text}` is not the number of a sweep")]
    NotASweep { text: String },
    #[error("`{text}` is not one of unknown, waited, exact, exact-from-rest, any-phase")]
    UnknownTiming { text: String },
    #[error("the {} differs from that of the first row of the sweep", quantity.name())]
    UnequalSetting { quantity: Quantity },
    #[error("fit_max_hz = {max_hz} is not above fit_min_hz = {min_hz}")]
    FitWindow { min_hz: f64, max_hz: f64 },

    // Which sweep.
    #[error("the file has {count} sweeps, from {first} to {last}, but no sweep {asked}")]
    NoSuchSweep { asked: u64, count: usize, first: u64, last: u64 },
    #[error("the file does not number its sweeps")]
    NoNumbers,
    #[error("sweep {sweep} is also above the header that is repeated in line {header_line}")]
    SweepTwice { sweep: u64, header_line: usize },
    #[error("this line names the columns of another table")]
    AnotherTable,

    // Touchstone.
    #[error("`{text}` is not an option of an option line")]
    UnknownOption { text: String },
    #[error("{name}-parameters do not exist for one port")]
    NotOnePort { name: char },
    #[error("the reference resistance `{text}` is not a positive number")]
    NoReference { text: String },
    #[error("this is neither version 1 nor version 2 of the format")]
    LaterVersion,
    #[error("`{text}` is not a keyword for one port")]
    UnknownKeyword { text: String },
    #[error("the file has {text} ports")]
    Ports { text: String },
    #[error("{found} numbers in a row; one port has 3")]
    Numbers { found: usize },
    #[error("the reflection of an open circuit: no impedance follows from it")]
    OpenCircuit,
}

impl Complaint for SweepFileFault {
    fn suggestion(&self) -> Option<String> {
        match self {
            Self::UnknownUnit { quantity, .. } => Some(format!("write `{}`", quantity.key())),
            Self::UnitlessPhase { key } => {
                Some(format!("name the column `{key}` if they are degrees"))
            }
            other => Some(other.what_to_do().to_owned()),
        }
    }
}

impl SweepFileFault {
    /// The suggestion, where it is the same for all values.
    fn what_to_do(&self) -> &'static str {
        match self {
            Self::Empty | Self::NoHeader => {
                "begin with the line `frequency_hz,resistance_ohm,reactance_ohm`, then one line \
                 for each reading"
            }
            Self::TooManyReadings { .. } => "keep those around the resonance",
            Self::TooManyRows { .. } => "choose one sweep with `--sweep`, or split the file",
            Self::OneFrequency { .. } => "a sweep has readings at several frequencies",
            Self::NotText => "export it as text, in UTF-8, or in UTF-16 with a byte order mark",
            Self::More { .. } => "correct these first",
            Self::NoFrequency => "name one `frequency_hz`",
            Self::NoImpedance => {
                "name two `resistance_ohm` and `reactance_ohm`, or `impedance_magnitude_ohm` and \
                 `phase_deg`, or `conductance_s` and `susceptance_s`, or `s11_real` and `s11_imag`, \
                 or those of an LCR meter such as `cp_f` and `d`, or `cs_f` and `rs_ohm`"
            }
            Self::PhaseOfWhat => {
                "name it `admittance_phase_deg` if it is that of the admittance; otherwise export \
                 |Z| instead of |Y|"
            }
            Self::UnitlessFrequency { .. } => {
                "name the column `Freq(kHz)`, `Freq(MHz)` or `frequency_hz`"
            }
            Self::RepeatedColumn { .. } => "rename or remove one of them",
            Self::Cells { found, expected, separator } if found > expected => match separator {
                Separator::Comma => {
                    "where commas are decimal marks, separate the columns by semicolons"
                }
                _ => "name every column in the header, or remove the further cells",
            },
            Self::Cells { .. } | Self::OtherCells { .. } | Self::EmptyCell { .. } => {
                "complete the line or remove it"
            }
            Self::OpenQuote => "close it on the same line",
            Self::NotANumber { .. } => {
                "write it like 140.25, 1.4025e2 or, between semicolons, 140,25"
            }
            Self::MixedMarks { .. } | Self::Thousands { .. } => {
                "write all numbers with a point, without marks for thousands"
            }
            Self::OutOfRange { .. } => "check the unit in the header",
            Self::ZeroImpedance | Self::ZeroAdmittance => "remove the line",
            Self::UnknownFlag { .. } | Self::NotABool { .. } | Self::UnknownTiming { .. } => {
                "correct it or remove the column"
            }
            Self::UnequalSetting { .. } => {
                "write one value in all rows of a sweep, or number the sweeps"
            }
            Self::FitWindow { .. } => "correct one of them, or remove both columns",
            Self::NotASweep { .. } => "count sweeps from 0, or rename the column",
            Self::NoSuchSweep { .. } => {
                "choose one of them, or leave out `--sweep` to fit them all"
            }
            Self::NoNumbers => "leave out `--sweep`",
            Self::SweepTwice { .. } | Self::AnotherTable => "split the file",
            Self::UnknownOption { .. } => "write it like `# HZ S RI R 50`",
            Self::NotOnePort { .. } => "export S-, Z- or Y-parameters",
            Self::NoReference { .. } => "write it like `R 50`",
            Self::LaterVersion => "export version 1 or 2, or CSV",
            Self::UnknownKeyword { .. } => "export version 1, or CSV",
            Self::Ports { .. } | Self::Numbers { .. } => {
                "export one port: frequency and the two parts of one parameter"
            }
            Self::OpenCircuit => "export more digits, or remove the line",
            Self::UnknownUnit { .. } | Self::UnitlessPhase { .. } => "write the unit",
        }
    }
}
