//! The rules, each an automaton of its own, with its state and its refusals.
//!
//! A rule refuses in `admit`, which changes nothing, and learns in the methods after it.

mod commission;
mod depth;
mod fault;
mod homing;
mod port;
mod position;
mod stop;
mod turn;

pub use commission::{Commission, Proven};
pub use depth::Depth;
pub use fault::Latch;
pub use homing::Homing;
pub use port::Ports;
pub use position::{Identity, Intent};
pub use stop::StopClock;
pub use turn::Turn;
