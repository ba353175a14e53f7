//! What differs between instruments that speak the same grammar.

use crate::{scan::Terminators, value::RealFormat};

/// How an instrument behaves where the standards leave a choice, or where it breaks them.
#[derive(Debug, Clone, PartialEq)]
pub struct Dialect {
    /// The answer to `*IDN?`: manufacturer, model, serial number, firmware.
    pub identity: String,
    /// Which bytes end a message that comes in.
    pub terminators: Terminators,
    /// What ends an answer.
    pub ending: Ending,
    /// Most bytes of messages that wait to be carried out. More is −363.
    pub input_limit_bytes: usize,
    /// Entries of the error queue; `None` for an instrument that has no `SYSTem:ERRor?`.
    pub error_queue: Option<usize>,
    /// Whether `SYSTem:ERRor?` writes `+0` where others write `0`.
    pub has_signed_errors: bool,
    /// Whether an error report carries what the device knows beyond the text.
    pub has_error_info: bool,
    /// Whether there is `STATus:OPERation`, `STATus:QUEStionable` and `STATus:PRESet`.
    pub has_status_registers: bool,
    /// The answer to `SYSTem:VERSion?`; `None` for an instrument that has none.
    pub scpi_version: Option<&'static str>,
    /// What happens to the rest of a message after an error in it.
    pub after_error: AfterError,
    /// What happens to an answer that was not read when the next message comes.
    pub unread: Unread,
    /// Most bytes of an answer that was not read. More is −430.
    pub output_limit_bytes: usize,
    /// For instruments with `:HEADer ON|OFF`: whether answers begin with their header at power-on.
    pub headers: Option<bool>,
    /// How real numbers are answered.
    pub real_format: RealFormat,
}

/// What ends an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Ending {
    /// Line feed.
    #[default]
    Lf,
    /// Carriage return and line feed.
    CrLf,
    /// Carriage return.
    Cr,
}

impl Ending {
    /// The bytes.
    pub const fn bytes(self) -> &'static [u8] {
        match self {
            Self::Lf => b"\n",
            Self::CrLf => b"\r\n",
            Self::Cr => b"\r",
        }
    }
}

/// What happens to the rest of a message after an error in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AfterError {
    /// The next unit is carried out.
    #[default]
    Continue,
    /// The rest is ignored, as the bench instruments of HIOKI do.
    SkipMessage,
}

/// What happens to an answer that was not read when the next message comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Unread {
    /// It stays: on a serial line or a socket it is on its way already.
    #[default]
    Keep,
    /// It is lost without a word.
    Drop,
    /// It is lost, and the errors −410, −420, −430 and −440 report what went wrong, as
    /// IEEE 488.2, 6.3 has it for a bus on which answers are fetched.
    Report,
}

impl Dialect {
    /// SCPI-99 on a serial line or a socket, with the line feed as terminator.
    pub fn standard(identity: impl Into<String>) -> Self {
        Self {
            identity: identity.into(),
            terminators: Terminators::LineFeed,
            ending: Ending::Lf,
            input_limit_bytes: 64 * 1024,
            error_queue: Some(20),
            has_signed_errors: false,
            has_error_info: true,
            has_status_registers: true,
            scpi_version: Some("1999.0"),
            after_error: AfterError::Continue,
            unread: Unread::Keep,
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
