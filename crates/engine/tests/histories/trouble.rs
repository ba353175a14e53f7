//! What can go wrong on the bench while a run is played.

use crate::drive::DriveTrouble;

/// The disturbances of one operation.
pub(crate) const OF_ONE_OPERATION: [Trouble; 9] = [
    Trouble::Fails,
    Trouble::Loses,
    Trouble::Stalls,
    Trouble::Hangs,
    Trouble::Abort,
    Trouble::Stop,
    Trouble::Flags,
    Trouble::FlagsOnce,
    Trouble::Pause,
];

/// The disturbance of an operation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Trouble {
    /// It fails as if the line had gone dead.
    Fails,
    /// It fails because the linear stage says that it is where it cannot be.
    Loses,
    /// It reports success, but the axis has not moved.
    Stalls,
    /// It never reports.
    Hangs,
    /// A person aborts while it is under way.
    Abort,
    /// A person stops everything while it is under way.
    Stop,
    /// The analyzer gives up on the first point: its readings are flagged.
    Flags,
    /// The analyzer flags its first reading of the first point and repeats it.
    FlagsOnce,
    /// A person pauses the run during it, and resumes when the run is paused.
    Pause,
    /// The host is held up during it, and its readings are nonsense; so are those of this number of
    /// repetitions.
    HoldUp(u32),
    /// The linear drive is in trouble from here on.
    Drive(DriveTrouble),
    /// The analyzer repeats its last reading from here on.
    Freezes,
    /// The linear stage loses steps: from here on the probe is higher than it says by this, mm.
    Slips(f64),
    /// The analyzer keeps its last frequency from here on.
    StaysAtFrequency,
}
