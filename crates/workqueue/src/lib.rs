//! A work queue on a NATS server with `JetStream`, for workers on many computers.
//!
//! The work is numbers in a row, such as seeds, which are cut into chunks. What a worker computes of a chunk is its piece, any
//! value of serde. What the numbers mean, and what is made of the pieces, is left to the program ([`Work`]).
//!
//! ```text
//!   fill ─▶ chunks (work queue) ─▶ worker: take, compute ─▶ pieces ─▶ gather
//!                ▲                    │  │                    ▲
//!                └── not acknowledged ┘  └─── store, then ────┘ acknowledge
//! ```
//!
//! A chunk leaves the queue when its piece is stored, and not before. What is computed twice is stored twice.

mod arguments;
mod chunk;
mod error;
mod gather;
mod server;
#[cfg(test)]
mod tests;
mod work;

pub use arguments::{Action, Asked, QueueArguments};
pub use chunk::{CHUNKS_MAX, Chunk, Numbers, Work, cut};
pub use error::QueueError;
pub use server::{Filled, Queue, Redelivery};
