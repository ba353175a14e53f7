//! The instruments: what they say on the wire and what they do to the world.
//!
//! Each is a state machine without I/O: bytes go in with the time at which they came, bytes come
//! out when they are due, and a deadline says when that will be.

pub(crate) mod bus;
pub(crate) mod cable;
mod corruption;
pub(crate) mod drive;
pub(crate) mod meter;
mod output_queue;
