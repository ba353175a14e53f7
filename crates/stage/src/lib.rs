//! Drivers of Modbus axis controllers; register maps are the data of instrument files.
//!
//! A [`Bus`](BusHandle) is the one owner of a line; a [`Stage`] is one axis on it. Nothing here
//! decides where an axis goes: a stage takes only a [`Target`](rig_model::Target), and a move is
//! over when the drive itself has confirmed target, position, status and alarm.

mod bus;
mod bus_settings;
mod drive_reading;
mod echo;
mod error;
mod halt;
mod line;
mod order;
mod port_loan;
mod profile;
mod request;
mod stage;
mod symptom;

pub use bus::BusHandle;
pub use bus_settings::{BusSettings, Framing};
pub use drive_reading::{Alarm, AxisStatus};
pub use error::{BusError, DeviceRefusal, Exception, LineFault, StageError};
pub use halt::HaltFrames;
pub use line::CheckRegisters;
pub use request::{Reply, Request};
pub use rig_files::instrument::drive::RegisterMap;
pub use stage::{Look, Stage};
pub use symptom::Symptom;
