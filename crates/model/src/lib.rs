//! The vocabulary of the rig: quantities with units, axes and soft limits, targets, makes of devices,
//! sweeps, readings, ids.
//!
//! Every other crate speaks in these words. Nothing here does I/O, asks for the time, or can be
//! serialized: HTTP, journal and configuration files have types of their own.

#![deny(clippy::disallowed_methods)]

mod axis;
mod causes;
mod counted;
mod make;
mod pose;
pub mod random;
mod rig_limits;
mod scale;
mod serial;
mod sweep;
mod time;

pub use axis::{Axis, AxisError, AxisLimits, Deg, Mm, Position, Span, Target, Unit};
pub use causes::{panic_message, with_causes};
pub use counted::counted;
pub use make::{AnalyzerMake, DriveMake};
pub use pose::{ContactAngle, ContactAngleError, Direction, Orientation};
pub use rig_limits::{AnalyzerRange, Clearance, Geometry, MotionLimits, ReadingStream, RigLimits};
pub use scale::Scale;
pub use serial::{LineSettings, Parity, PortKind, StopBits, Terminator};
pub use sweep::{
    DriveLevel, Impedance, PointResult, Reading, ReadingFlag, SweepMethod, SweepPoint,
    SweepRequest, SweepRequestError, Window,
};
pub use time::RigTime;
