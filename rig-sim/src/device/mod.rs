//! The instruments, with their bytes on the wire and their actions on the world.
//!
//! Each is a state machine without I/O: bytes go in with their time of arrival, bytes come out when
//! they are due, and a deadline says when that will be.

pub(crate) mod bus;
pub(crate) mod cable;
mod corruption;
pub(crate) mod drive;
pub(crate) mod meter;
mod output_queue;
