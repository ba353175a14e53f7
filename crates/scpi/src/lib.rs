//! IEEE 488.2 and SCPI-99 for a controller and for an instrument, without I/O.
//!
//! Ports, clocks and the effects of commands are outside this crate: bytes go in and come out, cut
//! anywhere, and time passes only between two calls.
//!
//! # An instrument
//! declares its commands as a [`Tree`] and runs an [`Instrument`]. The requirements of the
//! standards for every instrument (`*IDN?`, `*ESR?`, `SYSTem:ERRor?`, the status registers) are
//! built in; differences between instruments are in a [`Dialect`].
//!
//! ```
//! use rig_scpi::{Dialect, Instrument, Limits, Tree, Unit, Value, setting};
//!
//! const LIMITS: Limits = Limits { min: 20.0, max: 2e6, default: 1e3 };
//! let tree = Tree::new(&[setting("[:SOURce]:FREQuency[:CW]", ())]).expect("no ambiguity");
//! let mut instrument = Instrument::new(tree, Dialect::standard("ACME,LCR,0,1.0"));
//! let mut frequency_hz = LIMITS.default;
//!
//! instrument.push(b"FREQ 0.2KHZ;FREQ?;*IDN?\n");
//! while let Some(call) = instrument.poll() {
//!     instrument.answer(if call.is_query {
//!         Ok(vec![Value::Real(frequency_hz)])
//!     } else {
//!         let wanted = call.param(0).and_then(|param| param.real(Unit::HERTZ, LIMITS));
//!         wanted.map(|wanted_hz| frequency_hz = wanted_hz).map(|()| vec![])
//!     });
//! }
//! assert_eq!(instrument.take_output(), b"200;ACME,LCR,0,1.0\n");
//! ```
//!
//! # A controller
//! writes messages with [`Program`] and reads answers with [`ResponseDecoder`]. What instruments
//! send in place of a number (9.9E37, 9.91E37, asterisks) becomes a variant of [`Datum`].
//!
//! ```
//! use rig_scpi::{Datum, Ending, Framing, Program, ResponseDecoder};
//!
//! let message = Program::command(":FREQ").number(200.0).then_query(":FETC").finish(Ending::Lf)?;
//! assert_eq!(message, b":FREQ 200;:FETC?\n");
//!
//! let mut decoder = ResponseDecoder::new(Framing::default());
//! decoder.push(b"+9.90000E+37,+1.00000E");
//! assert_eq!(decoder.poll()?, None);
//! decoder.push(b"+00\n");
//! let response = decoder.poll()?.expect("the answer is whole");
//! assert_eq!(response.data()?, [Datum::Overload { is_negative: false }, Datum::Real(1.0)]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Where implementations disagree
//! * A common command between two units leaves the path alone: in `SYST:VERS?;*OPC?;ERR?` the last
//!   unit is `SYST:ERR?`. An optional node that was left out is not part of the path. A unit whose
//!   header means nothing does not change it.
//! * `:*IDN?` is −101. A register takes 0 to 255, so `*ESE 256` is −222, and bit 6 of `*SRE` reads
//!   back as 0.
//! * A unit with an error answers nothing: `*IDN? 12` is −108 only.
//! * `#0` begins a block that the end of the message ends; on a stream that is the next line feed.
//! * A mnemonic without a number has the number 1, in a header and in a pattern: `TRIG` is `TRIG1`,
//!   also where there is only one. Another number is −113 there, and −114 outside its range where
//!   there are several.
//! * An integer of which not every digit is known (a decimal number of 2⁵³ or more) is −222.
//! * A unit without a `;` before it (`*ESE 1:CH1 5`) is −103, and so is a comma behind a header;
//!   other data directly behind a header is −111; white space around a colon is −102.
#![deny(clippy::disallowed_methods)]

mod controller;
mod grammar;
mod instrument;

pub use controller::decoder::{ExpectedResponse, FrameError, Framing, ResponseDecoder};
pub use controller::program::{Program, ProgramError};
pub use controller::report::{ErrorReport, Identity};
pub use controller::response::{DataError, Datum, Response, ResponseUnit};
pub use grammar::error::ScpiError;
pub use grammar::param::{Limits, Param};
pub use grammar::scan::{Ending, Terminators};
pub use grammar::unit::Unit;
pub use grammar::value::{RealFormat, Value, shortest};
pub use instrument::dialect::{
    AfterErrorPolicy, AfterQueryPolicy, Dialect, ErrorFormat, QUERY_ERRORS, UnreadPolicy,
};
pub use instrument::pattern::PatternFault;
pub use instrument::status::{Register, Status};
pub use instrument::tree::{Node, Tree, TreeError, command, query, setting};
pub use instrument::{Call, Instrument, Session};
