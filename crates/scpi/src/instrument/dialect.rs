//! The differences between instruments with the same grammar.

use crate::{
    grammar::scan::{Ending, Terminators},
    grammar::value::RealFormat,
};

/// The behaviour of an instrument where the standards leave a choice or the instrument breaks them.
#[derive(Debug, Clone, PartialEq)]
pub struct Dialect {
    /// The answer to `*IDN?`: manufacturer, model, serial number, firmware.
    pub identity: String,
    /// Terminators of incoming messages.
    pub terminators: Terminators,
    /// Whether a terminator inside a string is part of the string, as IEEE 488.2, 7.7.5.2 requires.
    /// Otherwise it ends the message, and a forgotten quote is −151 instead of a long silence.
    pub strings_span_lines: bool,
    /// The terminator of an answer.
    pub ending: Ending,
    /// Most bytes of messages that wait to be carried out. More is −363.
    pub input_limit_bytes: usize,
    /// Entries of the error queue; `None` for an instrument that has no `SYSTem:ERRor?`.
    pub error_queue: Option<usize>,
    /// The format of an error in `SYSTem:ERRor?`.
    pub error_format: ErrorFormat,
    /// Whether there is `STATus:OPERation`, `STATus:QUEStionable` and `STATus:PRESet`.
    pub has_status_registers: bool,
    /// The answer to `SYSTem:VERSion?`; `None` for an instrument that has none.
    pub scpi_version: Option<&'static str>,
    /// Treatment of the rest of a message after an error.
    pub after_error: AfterErrorPolicy,
    /// Treatment of a message after a query.
    pub after_query: AfterQueryPolicy,
    /// Treatment of an unread answer when the next message comes.
    pub unread: UnreadPolicy,
    /// The query errors that are reported. See [`QUERY_ERRORS`].
    pub query_errors: &'static [i16],
    /// Most bytes of answers that were not read. More are lost, which is −430.
    pub output_limit_bytes: usize,
    /// For instruments with `:HEADer ON|OFF`: whether answers begin with their header at power-on.
    /// Only settings have one, not common commands or queries for a reading (HIOKI 3541 Instruction
    /// Manual, p. 101; HIOKI 3174 Instruction Manual, p. 128).
    pub headers: Option<bool>,
    /// The format of real numbers in answers.
    pub real_format: RealFormat,
}

/// Treatment of the rest of a message after an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AfterErrorPolicy {
    /// The next unit is carried out.
    #[default]
    Continue,
    /// The rest is ignored, as the bench instruments of HIOKI do.
    SkipMessage,
}

/// Treatment of a message after a query.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AfterQueryPolicy {
    /// The next unit is carried out.
    #[default]
    Continue,
    /// A further unit is a query error, −400, and ends the message (HIOKI RM3542-50 Instruction
    /// Manual, p. 119).
    Refuse,
}

/// Treatment of an unread answer when the next message comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UnreadPolicy {
    /// It stays: on a serial line or a socket it is on its way already.
    #[default]
    Keep,
    /// It is lost, as on a bus where answers are fetched (IEEE 488.2, 6.3). That is −410.
    Drop,
}

/// The format of an error in `SYSTem:ERRor?`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ErrorFormat {
    /// `+0` where others write `0`.
    pub has_plus: bool,
    /// Whether device-dependent information is written behind a semicolon.
    pub has_info: bool,
}

/// Where the exchange of messages broke its protocol, on a bus where answers are fetched: the answer
/// was not read (−410), there was none to read (−420), it did not fit (−430), or a query followed
/// data that only the end of the message ends (−440).
pub const QUERY_ERRORS: &[i16] = &[-410, -420, -430, -440];

impl Dialect {
    /// SCPI-99 on a serial line or a socket, with the line feed as terminator.
    pub fn standard(identity: impl Into<String>) -> Self {
        Self {
            identity: identity.into(),
            terminators: Terminators::LineFeed,
            strings_span_lines: true,
            ending: Ending::Lf,
            input_limit_bytes: 64 * 1024,
            error_queue: Some(20),
            error_format: ErrorFormat { has_plus: false, has_info: true },
            has_status_registers: true,
            scpi_version: Some("1999.0"),
            after_error: AfterErrorPolicy::Continue,
            after_query: AfterQueryPolicy::Continue,
            unread: UnreadPolicy::Keep,
            query_errors: &[-430],
            output_limit_bytes: 16 * 1024 * 1024,
            headers: None,
            real_format: RealFormat::Shortest,
        }
    }

    /// IEEE 488.2 only: common commands, errors in `*ESR?`, no subsystems of SCPI.
    pub fn common_only(identity: impl Into<String>) -> Self {
        Self {
            error_queue: None,
            has_status_registers: false,
            scpi_version: None,
            ..Self::standard(identity)
        }
    }
}
