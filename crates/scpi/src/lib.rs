//! IEEE 488.2 and SCPI-99 for a controller and for an instrument, without I/O.
//!
//! * An instrument declares its commands as a [`Tree`] and runs an [`Instrument`]: bytes go in,
//!   calls come out, answers go in, bytes come out.
//! * A controller writes messages with [`Program`] and reads answers with [`ResponseDecoder`].
//!
//! Ports, clocks and what the commands do are left to others.
#![deny(clippy::disallowed_methods)]

mod decoder;
mod dialect;
mod error;
mod grammar;
mod instrument;
mod list;
mod mnemonic;
mod param;
mod pattern;
mod program;
mod report;
mod response;
mod scan;
mod splitter;
mod status;
mod tree;
mod unit;
mod value;

pub use decoder::{Expect, FrameError, Framing, ResponseDecoder};
pub use dialect::{AfterError, AfterQuery, Dialect, Ending, ErrorFormat, QUERY_ERRORS, Unread};
pub use error::{ErrorClass, ErrorQueue, ScpiError, standard_text};
pub use instrument::{Call, Instrument};
pub use list::{ChannelRange, NumericRange};
pub use mnemonic::short_form;
pub use param::{Limits, Numeric, Param};
pub use pattern::PatternFault;
pub use program::{Program, ProgramError};
pub use report::{ErrorReport, Identity};
pub use response::{DataError, Datum, Response, ResponseUnit};
pub use scan::Terminators;
pub use splitter::{Arrival, MessageSplitter};
pub use status::{Register, Status};
pub use tree::{Node, Tree, TreeError, command, query, setting};
pub use unit::Unit;
pub use value::{INFINITY, NOT_A_NUMBER, RealFormat, Value};
