//! The vocabulary of the rig: quantities with units, axes and soft limits, targets, sweeps,
//! readings, ids.
//!
//! Every other crate speaks in these words. Nothing here does I/O, asks for the time, or can be
//! serialized: HTTP, journal and configuration files have types of their own.

#![deny(clippy::disallowed_methods)]

mod axis;
mod bench;
mod pose;
mod sweep;
mod time;

pub use axis::{Axis, AxisError, AxisLimits, Deg, Mm, Position, Span, Target, Unit};
pub use bench::{AnalyzerRange, Bench, Clearance, Geometry, MotionLimits};
pub use pose::{ContactAngle, ContactAngleError, Direction, Orientation};
pub use sweep::{
    DriveLevel, Reading, ReadingFlag, SweepMethod, SweepPoint, SweepRequest, SweepRequestError,
    Window,
};
pub use time::RigTime;
