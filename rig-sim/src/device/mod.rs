//! The instruments, with their bytes on the wire and their actions on the world.
//!
//! Each is a state machine without I/O: bytes go in with the time at which they came, bytes come
//! out when they are due, and a deadline says when that will be.

pub(crate) mod bus;
pub(crate) mod cable;
mod corruption;
pub(crate) mod drive;
pub(crate) mod meter;
mod output_queue;
