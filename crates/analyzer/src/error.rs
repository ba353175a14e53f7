//! Errors of an analyzer: a refusal, a failure of the line, or an answer that does not fit the
//! query.

use std::{
    fmt::{self, Write},
    sync::Arc,
    time::Duration,
};

use rig_link::{Holder, LineError, OpenError};
use rig_scpi::{ErrorReport, FrameError};

use crate::Identity;

/// The standard event status register, as the instrument answered `*ESR?`.
///
/// # Source
/// IEEE 488.2, 11.5.1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EventStatus(pub u8);

impl EventStatus {
    const NAMES: [(u8, &'static str); 4] = [
        (1 << 2, "query error"),
        (1 << 3, "device error"),
        (1 << 4, "execution error"),
        (1 << 5, "command error"),
    ];

    /// Whether it reports that something was not understood or not done.
    pub(crate) const fn is_error(self) -> bool {
        self.0 & 0b0011_1100 != 0
    }

    /// Whether the instrument was switched on since it was last asked.
    pub(crate) const fn is_power_on(self) -> bool {
        self.0 & 0b1000_0000 != 0
    }
}

impl fmt::Display for EventStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = Self::NAMES.iter().filter(|(bit, _)| self.0 & bit != 0).map(|(_, name)| *name);
        write!(f, "{} (event status {})", names.collect::<Vec<_>>().join(", "), self.0)
    }
}

/// An operation of an analyzer failed. The caller knows which analyzer.
#[derive(Debug, Clone, thiserror::Error)]
pub enum AnalyzerError {
    /// The line failed: it is unknown whether the instrument received or did anything.
    #[error("asked `{asked}`{}{}", in_parentheses(*unexpected_terminator), also(intruders))]
    Line {
        /// The message that was sent.
        asked: Box<str>,
        /// The terminator that arrived instead of the expected one.
        unexpected_terminator: Option<UnexpectedTerminator>,
        /// Programs that have the port open too, where the answer stayed lost.
        intruders: Vec<Holder>,
        /// The error of the line.
        #[source]
        source: LineError,
    },
    /// The line did not become silent in time.
    #[error("the line does not become silent")]
    Unquiet {
        /// The error of the line.
        #[source]
        source: LineError,
    },
    /// A port that was lost cannot be opened again.
    #[error("the port was lost")]
    Reopen {
        /// The error of opening the port.
        #[source]
        source: Arc<OpenError>,
    },
    /// The bytes that arrived are not an answer.
    #[error("{port}: asked `{asked}`, found `{found}`")]
    Frame {
        /// Name of the port.
        port: Arc<str>,
        /// The message that was sent.
        asked: Box<str>,
        /// The bytes that arrived.
        found: Box<str>,
        /// The fault of the frame.
        #[source]
        source: FrameError,
    },
    /// The instrument understood and refused, or did not understand.
    #[error("{port}: refused `{asked}`: {status}{}", in_words(reports))]
    Refused {
        /// Name of the port.
        port: Arc<str>,
        /// The message that was sent.
        asked: Box<str>,
        /// Event status, with its error bits.
        status: EventStatus,
        /// Its reason in words, from those that have an error queue.
        reports: Vec<ErrorReport>,
    },
    /// The instrument was switched off and on, and has lost its settings.
    #[error("{port}: says that it was switched on again, so that its settings are lost")]
    Restarted {
        /// Name of the port.
        port: Arc<str>,
    },
    /// The computer was held up while a message left, so that the time of its measurement is not known.
    #[error(
        "{port}: rigd was held up for {:.4} s while it sent `{asked}`, so that the time of the \
         measurement is unknown; at most {:.4} s are allowed",
        took.as_secs_f64(),
        noted_within.as_secs_f64()
    )]
    HeldUp {
        /// Name of the port.
        port: Arc<str>,
        /// The message that was sent.
        asked: Box<str>,
        /// Time between the last character of the message and the note of it.
        took: Duration,
        /// Longest such time.
        noted_within: Duration,
    },
    /// Bytes arrived without a query.
    #[error("{port}: {bytes} unexpected bytes arrived before a query")]
    Strays {
        /// Name of the port.
        port: Arc<str>,
        /// Number of unexpected bytes.
        bytes: usize,
    },
    /// The answer is not one to this question.
    #[error("{port}: asked `{asked}`, expected {expected}, found `{found}`")]
    Answer {
        /// Name of the port.
        port: Arc<str>,
        /// The message that was sent.
        asked: Box<str>,
        /// The expected form of an answer.
        expected: &'static str,
        /// The bytes that arrived.
        found: Box<str>,
    },
    /// A setting that the instrument took is not the one it was given.
    #[error("{port}: {what}: asked for {wanted}, found {found}")]
    NotTaken {
        /// Name of the port.
        port: Arc<str>,
        /// The setting, with its unit.
        what: &'static str,
        /// The message that was sent.
        wanted: f64,
        /// The value that the instrument reports.
        found: f64,
    },
    /// Something outside the range of the instrument. It was not sent.
    #[error("{dialect}: {what} {asked} is outside [{min}, {max}]")]
    OutOfRange {
        /// Name of the dialect.
        dialect: &'static str,
        /// The quantity, with its unit.
        what: &'static str,
        /// The message that was sent.
        asked: f64,
        /// Smallest possible value.
        min: f64,
        /// The most it can do.
        max: f64,
    },
    /// Another instrument than the dialect is for.
    #[error("{port}: expected {expected}, found {found}")]
    WrongInstrument {
        /// Name of the port.
        port: Arc<str>,
        /// The models that the dialect is for.
        expected: &'static str,
        /// Identity in the answer.
        found: Box<Identity>,
    },
    /// Another instrument than before answers.
    #[error("{port}: expected {known}, found {found}")]
    Swapped {
        /// Name of the port.
        port: Arc<str>,
        /// Identity at the identification.
        known: Box<Identity>,
        /// Identity now.
        found: Box<Identity>,
    },
    /// Measured before [`Analyzer::configure`](crate::Analyzer::configure).
    #[error("{port}: not configured yet")]
    NotConfigured {
        /// Name of the port.
        port: Arc<str>,
    },
    /// A requested stop. No measurement is in progress.
    #[error("measurement stopped after {done} of {points} points")]
    Stopped {
        /// Number of points measured before the stop.
        done: usize,
        /// Number of requested points.
        points: usize,
    },
}

impl AnalyzerError {
    /// Whether the line failed, so that it is unknown whether the instrument received anything. The
    /// other errors are refusals of the instrument, or messages that were never sent.
    pub const fn is_line_failure(&self) -> bool {
        matches!(
            self,
            Self::Line { .. }
                | Self::Unquiet { .. }
                | Self::Reopen { .. }
                | Self::Frame { .. }
                | Self::Strays { .. }
                | Self::Answer { .. }
        )
    }
}

/// An answer that ends otherwise than is expected of this instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UnexpectedTerminator {
    /// In a carriage return, where a line feed was expected.
    CrForLf,
    /// In a line feed, where a carriage return was expected.
    LfForCr,
}

impl fmt::Display for UnexpectedTerminator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::CrForLf => "the answer ended in CR where LF was expected",
            Self::LfForCr => "the answer ended in LF where CR was expected",
        })
    }
}

fn in_parentheses(unexpected_terminator: Option<UnexpectedTerminator>) -> String {
    unexpected_terminator.map(|end| format!(" ({end})")).unwrap_or_default()
}

fn also(intruders: &[Holder]) -> String {
    let mut text = String::new();
    for holder in intruders {
        _ = write!(text, "; {holder} has the port open too");
    }
    text
}

fn in_words(reports: &[ErrorReport]) -> String {
    let mut text = String::new();
    for ErrorReport { number, text: words, .. } in reports {
        _ = write!(text, "; {number} {words}");
    }
    text
}
