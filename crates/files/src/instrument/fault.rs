//! The faults of an instrument file whose single values are right.

use super::template::TemplateFault;
use crate::Complaint;

/// A fault of an instrument file.
#[derive(Debug, thiserror::Error)]
pub(super) enum InstrumentFault {
    // Both kinds.
    #[error("{key} = \"{name}\" is the name of a shipped instrument")]
    ShippedName { key: &'static str, name: String },
    #[error("`{key}` is not for an instrument file: {reason}")]
    Inexpressible { key: &'static str, reason: &'static str },

    // Analyzers.
    #[error("{key}: {fault}")]
    Message { key: &'static str, fault: TemplateFault, words: Vec<&'static str> },
    #[error("{key} has {found} questions, and needs {expected}")]
    Questions { key: &'static str, found: usize, expected: usize },
    #[error("{key} does not hold `{{{word}}}`")]
    WithoutQuantity { key: &'static str, word: &'static str },
    #[error("no message of setup sets `{{level_v}}`")]
    NoLevel,
    #[error("`{section}` is missing at the top of the file: the analyzer measures points")]
    NoSection { section: &'static str },
    #[error("`{section}` is of an analyzer that measures points, and trace says that it does not")]
    SectionOfPoints { section: &'static str },
    #[error("[frequency_steps] needs one of `step_hz`, `digits` and `nearest_rel`")]
    Steps,
    #[error("`finest_hz` is for `digits`")]
    FinestAlone,
    #[error("[integration] needs one of `cycles` and `times`")]
    Integration,
    #[error("times has {0} frequencies, or they do not rise")]
    Times(usize),
    #[error("fields has no impedance, or more than one")]
    NoImpedance,
    #[error("fields has \"{0}\" twice")]
    FieldTwice(&'static str),
    #[error("fields has \"status\", and [answer.status] is missing")]
    NoStatusWords,
    #[error("[answer.status] is given, and fields has no \"status\"")]
    NoStatusField,
    #[error("the status {word} has two meanings")]
    TwoMeanings { word: i32 },

    // Drives.
    #[error("{key}: no block has {} at {address:#06x}", registers_of(*registers))]
    OutsideBlock { key: &'static str, address: u16, registers: u16 },
    #[error("{count} addresses from {address:#06x} on reach beyond 0xffff, the last one")]
    BeyondLast { address: u16, count: u16 },
    #[error("{key}: bit {bit} of {what} at {address:#06x} does not exist")]
    NoBit { key: &'static str, bit: u32, what: &'static str, address: u16 },
    #[error("{} read by {first} and by {second}: answers must differ in length", are(*count))]
    EqualLengths { count: u16, first: String, second: String },
    #[error("min = {min} admits a device that answers zeros, or is above max = {max}")]
    Range { min: i32, max: i32 },
    #[error("a step has {0} of `registers`, `register`, `coil` and `hold_ms`")]
    Step(usize),
    #[error("`{key}` is missing beside `{beside}`")]
    Beside { key: &'static str, beside: &'static str },
    #[error("`{key}` is not for `{beside}`")]
    NotBeside { key: &'static str, beside: &'static str },
    #[error("\"{0}\" is not the content of registers")]
    Content(String),
    #[error("{0} registers do not fit in one request")]
    TooManyRegisters(u16),
    #[error("expect has {found} registers, and read has {expected}")]
    ExpectLength { found: u16, expected: u16 },
    #[error("start does not write the target")]
    NoTarget,
    #[error(
        "{command} writes \"{quantity}\": only `start` makes a move, and here its value would be 0"
    )]
    NoMove { command: &'static str, quantity: &'static str },
    #[error("moving and ready are one bit: a drive that moves would be ready for the next move")]
    OneBit,
    #[error(
        "command_position is read where position is: a target that was not reached would not be seen"
    )]
    OnePosition,
    #[error("release_stop writes the same as stop: the axis would be stopped again")]
    StopTwice,
    #[error("expect has {found} at {address:#06x}, where write puts {written}")]
    OtherLimit { address: u16, found: &'static str, written: &'static str },
    #[error("the alarm {code:#04x} has two names, \"{first}\" and \"{second}\"")]
    TwoNames { code: u16, first: String, second: String },
    #[error("[status] needs one of `{0}` and `{1}`")]
    OneOf(&'static str, &'static str),
}

impl Complaint for InstrumentFault {
    fn suggestion(&self) -> Option<String> {
        Some(match self {
            Self::ShippedName { .. } => "give it a name of its own".into(),
            Self::Inexpressible { .. } => {
                "docs/instruments.md says what a file can express, and when Rust is needed".into()
            }
            Self::Message { words, .. } if words.is_empty() => "it holds no quantities".into(),
            Self::Message { words, .. } => format!("quantities are {{{}}}", words.join("}, {")),
            Self::Questions { expected: 0, .. } => "remove the question marks".into(),
            Self::Questions { .. } => "a question ends in `?`".into(),
            Self::WithoutQuantity { word, .. } => format!("write {{{word}}} where the value goes"),
            Self::NoLevel => "write {level_v} where the level goes".into(),
            Self::NoSection { .. } => "`rigd instrument new analyzer` writes all of them".into(),
            Self::SectionOfPoints { .. } => "remove it, or trace".into(),
            Self::Steps | Self::FinestAlone => {
                "the manual gives the resolution of the frequency".into()
            }
            Self::Integration => {
                "give the cycles of one measurement, or its times by frequency".into()
            }
            Self::Times(_) => "give at least two, the lowest first".into(),
            Self::NoImpedance => {
                "give resistance_ohm and reactance_ohm, impedance_ohm and a phase, or \
                                  conductance_s and susceptance_s"
                    .into()
            }
            Self::FieldTwice(_) | Self::TwoMeanings { .. } | Self::TwoNames { .. } => {
                "remove one".into()
            }
            Self::NoMove { .. } => "write a number, or a limit".into(),
            Self::OneBit => "give each the bit that the manual names".into(),
            Self::OnePosition => {
                "give the position that the drive commands, or `target_register` instead of it"
                    .into()
            }
            Self::StopTwice => {
                "write what the manual says, or nothing if a stop needs no release".into()
            }
            Self::OtherLimit { .. } => {
                "expect what was written, in the order of the registers".into()
            }
            Self::NoStatusWords => "say what its numbers mean".into(),
            Self::NoStatusField => "name the field, or remove the section".into(),
            Self::OutsideBlock { .. } => {
                "add it to a block, as each reading asks for blocks only".into()
            }
            Self::BeyondLast { .. } => "read fewer".into(),
            Self::NoBit { .. } => {
                "a register has the bits 0 to 15; coils and inputs have none".into()
            }
            Self::EqualLengths { .. } => {
                "read one register more in one of them, so that no late answer is taken for another"
                    .into()
            }
            Self::Range { .. } => {
                "choose a quantity that is above zero in every drive of the make".into()
            }
            Self::Step(_) => "give one of them".into(),
            Self::Beside { .. } => "add it".into(),
            Self::NotBeside { .. } => "remove it".into(),
            Self::Content(_) => {
                "write a number or target, speed, acceleration, deceleration, limit_min or \
                                 limit_max, and u16 or i32: \"target i32\""
                    .into()
            }
            Self::TooManyRegisters(_) => "a request writes 1 to 123 registers".into(),
            Self::ExpectLength { .. } => "give as many as are read".into(),
            Self::NoTarget => "write \"target i32\" where the target goes".into(),
            Self::OneOf(..) => "give one".into(),
        })
    }
}

/// A number of registers, in words.
fn registers_of(count: u16) -> String {
    if count == 1 { "the register".to_owned() } else { format!("the {count} registers") }
}

fn are(count: u16) -> String {
    if count == 1 { "1 register is".to_owned() } else { format!("{count} registers are") }
}
