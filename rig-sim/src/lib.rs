//! Simulated instruments on the wire and the physical world behind them.
//!
//! The devices answer in the bytes of the real ones, so that the same drivers serve a simulated and
//! a real bench. Except for [`SimRig`] and `serve`, the crate has no I/O and takes time as an
//! argument.

mod clock;
pub mod control;
mod device;
pub mod faults;
pub mod modbus;
pub mod person;
pub mod plant;
mod rig;
pub mod scene;
pub mod serve;
mod shell;
mod wiring;
pub mod world;

pub use rig::{Connection, Overheard, Rig};
pub use shell::{SimHandle, SimPort, SimRig, Technician};
pub use wiring::{AxisWiring, HangUp, LineTransport, PortId, Wiring};
