//! What each Modbus axis controller must be told; register maps are data.
//!
//! A [`Bus`](BusHandle) is the one owner of a line; a [`Stage`] is one axis on it. Nothing here
//! decides where an axis goes: a stage takes only a [`Target`](rig_model::Target), and a move is
//! over when the drive itself has confirmed target, position, status and alarm.

mod bus;
mod bus_settings;
mod echo;
mod error;
mod line;
mod look;
pub mod map;
pub mod maps;
mod order;
mod profile;
mod request;
mod stage;
mod symptom;
mod tap;
mod turn;

pub use bus::BusHandle;
pub use bus_settings::{BusSettings, Framing, Health};
pub use error::{BusError, Exception, LineFault, Refusal, StageError};
pub use line::Canary;
pub use look::{Alarm, AxisStatus};
pub use map::RegisterMap;
pub use request::{Reply, Request};
pub use stage::Stage;
pub use symptom::Symptom;
pub use turn::Turn;
