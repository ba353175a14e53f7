//! The interlock in front of the ports: it refuses a command to the devices that could damage a
//! sample, independent of the reason for the command.
//!
//! ```text
//!   engine ──▶ shell ──▶ Interlock::admit ──▶ driver ──▶ port
//!                             ▲     │ Refusal: nothing is sent; a record and a fault
//!                             │     ▼
//!   reports of the drivers ───┘   stop, retract, latch
//! ```
//!
//! It shares no code and no state with the engine: it sees only the commands themselves, the reports of
//! the drivers, what is durable in the journal, and what a person has acknowledged. Each rule is a small
//! automaton in [`rules`]; [`Interlock`] asks all of them.
//!
//! A stop, the search for the linear drive and the retract are refused only where they cannot be safe.

#![deny(clippy::disallowed_methods)]

mod command;
mod interlock;
mod refusal;
pub mod rules;

pub use command::{Outcome, PortCommand, Word};
pub use interlock::Interlock;
pub use refusal::Refusal;
pub use rules::Proven;
