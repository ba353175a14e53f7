//! The interlock: each rule alone, and all of them under random streams of commands.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

mod bench;
mod commission;
mod rules;
mod streams;
