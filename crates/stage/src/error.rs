//! Errors of an axis: a refusal of the device, a failure of the line, or a wrong position.

use std::{fmt, sync::Arc};

use rig_link::{Holder, LineError, OpenError};
use rig_model::{AxisError, Position, Span, Unit};

use crate::{Alarm, Request, Symptom};

/// Why a device refused, by its own account.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exception {
    /// 1: it does not know the function.
    IllegalFunction,
    /// 2: it has no such address.
    IllegalAddress,
    /// 3: it does not accept the value.
    IllegalValue,
    /// 4: it failed while it tried.
    DeviceFailure,
    /// 5: it has begun, and needs long.
    Acknowledge,
    /// 6: it is busy and has done nothing.
    Busy,
    /// An exception code outside the specification.
    Other(u8),
}

impl Exception {
    pub(crate) fn from_code(code: u8) -> Self {
        match code {
            1 => Self::IllegalFunction,
            2 => Self::IllegalAddress,
            3 => Self::IllegalValue,
            4 => Self::DeviceFailure,
            5 => Self::Acknowledge,
            6 => Self::Busy,
            other => Self::Other(other),
        }
    }
}

impl fmt::Display for Exception {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::IllegalFunction => f.write_str("illegal function (1)"),
            Self::IllegalAddress => f.write_str("illegal address (2)"),
            Self::IllegalValue => f.write_str("illegal value (3)"),
            Self::DeviceFailure => f.write_str("device failure (4)"),
            Self::Acknowledge => f.write_str("still busy (5)"),
            Self::Busy => f.write_str("busy (6)"),
            Self::Other(code) => write!(f, "exception {code}"),
        }
    }
}

/// A refusal of the device.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{port}: unit {unit} refused to {request}: {exception}")]
pub struct DeviceRefusal {
    /// Name of the port.
    pub port: Arc<str>,
    /// Unit id of the device.
    pub unit: u8,
    /// The refused request.
    pub request: Request,
    /// Exception of the device.
    pub exception: Exception,
}

/// The line failed: it is unknown whether the device has received or done anything.
#[derive(Debug, Clone, thiserror::Error)]
pub enum LineFault {
    /// The port itself failed.
    #[error(transparent)]
    Port(#[from] LineError),
    /// No answer could be used, in all attempts.
    #[error(
        "{port}: unit {unit}: {request}: {symptom} ({attempts} attempts){}{}",
        came(received),
        also(intruders)
    )]
    NoAnswer {
        /// Name of the port.
        port: Arc<str>,
        /// Unit id of the device.
        unit: u8,
        /// The request without a usable answer.
        request: Request,
        /// The last symptom.
        symptom: Symptom,
        /// The bytes in which it was seen.
        received: Box<[u8]>,
        /// Number of attempts.
        attempts: u32,
        /// Programs that have the port open too.
        intruders: Vec<Holder>,
    },
    /// A port that was lost cannot be opened again.
    #[error("the port was lost")]
    Reopen {
        /// The error of the line.
        #[source]
        source: Arc<OpenError>,
    },
    /// A register does not have the value that was written to it: the device was changed, or
    /// restarted, or another one answers.
    #[error(
        "{port}: unit {unit}: {request}: the registers do not hold the values that were \
             written"
    )]
    Changed {
        /// Name of the port.
        port: Arc<str>,
        /// Unit id of the device.
        unit: u8,
        /// The request without a usable answer.
        request: Request,
    },
    /// A stop was sent before the write was answered. It was not sent, or not repeated.
    #[error("{port}: unit {unit}: {request}: ended by a stop")]
    Halted {
        /// Name of the port.
        port: Arc<str>,
        /// Unit id of the device.
        unit: u8,
        /// The request without a usable answer.
        request: Request,
    },
    /// The program failed during the exchange; the line is put in order before the next one.
    #[error("{port}: rigd itself failed during an exchange: {what}")]
    Panicked {
        /// Name of the port.
        port: Arc<str>,
        /// Message of the failure.
        what: String,
    },
    /// The task that owns the line has ended.
    #[error("the owner of the line has ended")]
    Closed,
}

/// Bytes of a frame as people write them: `01 03 04`.
fn came(received: &[u8]) -> String {
    /// The length of the longest frame of a drive; the beginning is the most useful part.
    const SHOWN: usize = 32;
    let shown: Vec<_> = received.iter().take(SHOWN).map(|byte| format!("{byte:02X}")).collect();
    let more = if received.len() > SHOWN { " …" } else { "" };
    match received.len() {
        0 => String::new(),
        1 => format!(", 1 byte arrived: {}", shown.join(" ")),
        n => format!(", {n} bytes arrived: {}{more}", shown.join(" ")),
    }
}

fn also(intruders: &[Holder]) -> String {
    let open = |holder: &Holder| format!("; {holder} has the port open too");
    intruders.iter().map(open).collect()
}

/// A request on the bus was not carried out.
#[derive(Debug, Clone, thiserror::Error)]
pub enum BusError {
    /// The device refused.
    #[error(transparent)]
    Refused(#[from] DeviceRefusal),
    /// The line failed.
    #[error(transparent)]
    Failed(#[from] LineFault),
}

/// An operation of an axis failed. The caller knows which axis.
#[derive(Debug, Clone, thiserror::Error)]
pub enum StageError<U: Unit> {
    /// The bus failed or the drive refused.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// A step of no length.
    #[error(transparent)]
    Step(#[from] AxisError<U>),
    /// Moved before [`Stage::identify`](crate::Stage::identify).
    #[error("not identified yet")]
    NotIdentified,
    /// The device reads like no drive of this make. Nothing was written to it.
    #[error("not recognised: {what} reads {found}, outside [{min}, {max}] of {drives}")]
    Unrecognised {
        /// The quantity, with its unit.
        what: &'static str,
        /// Value that was read.
        found: i32,
        /// Smallest valid value.
        min: i32,
        /// Largest valid value.
        max: i32,
        /// The drives of the map.
        drives: &'static str,
    },
    /// The drive counts otherwise than the rig file says, so that every position would be wrong. Nothing
    /// was written to it.
    #[error(
        "the drive is set to {found} steps for a revolution of its motor; the rig file says {expected} \
         (steps_per_revolution)"
    )]
    OtherResolution {
        /// Steps that the drive has.
        found: f64,
        /// Steps of the rig file.
        expected: f64,
    },
    /// The drive says that the axis is where it cannot be, so that no move from there is safe. It
    /// was not sent.
    #[error("is at {at}, outside its travel {travel}")]
    BeyondTravel {
        /// Position that the drive reports.
        at: Position<U>,
        /// Mechanical travel.
        travel: Span<U>,
    },
    /// The axis is elsewhere than where it came to rest, so that no move from there is safe. It was not sent.
    #[error("came to rest at {was}, and is at {at} before its next move")]
    Moved {
        /// Position that the drive reported at rest.
        was: Position<U>,
        /// Position that it reports now.
        at: Position<U>,
    },
    /// The drive does not know where the axis is, so that no move from there is safe. It was not sent, or it ended when
    /// this was seen.
    #[error("not homed: the position {at} that it reports means nothing")]
    Unhomed {
        /// Position that the drive reports.
        at: Position<U>,
    },
    /// A speed that is not allowed.
    #[error("speed {asked} {}/s is outside (0, {max}]", U::SYMBOL)]
    Speed {
        /// Requested speed, in the unit of the axis a second.
        asked: f64,
        /// The fastest allowed.
        max: f64,
    },
    /// A speed below the slowest of the drive.
    #[error("speed {asked} {}/s is below the slowest of the drive, {min:.4}", U::SYMBOL)]
    TooSlow {
        /// Requested speed, in the unit of the axis a second.
        asked: f64,
        /// Slowest speed of the drive.
        min: f64,
    },
    /// A position that the drive cannot count to.
    #[error("{wanted} is beyond the counting range of the drive")]
    Uncountable {
        /// Requested position.
        wanted: Position<U>,
    },
    /// The drive reports an alarm.
    #[error("alarm {alarm}, at {at}")]
    Alarmed {
        /// Alarm code of the drive, with its name.
        alarm: Alarm,
        /// Position read back from the drive.
        at: Position<U>,
    },
    /// The drive says that its emergency stop is pressed. It moves nothing.
    #[error("its emergency stop is pressed, at {at}")]
    EmergencyStopped {
        /// Position read back from the drive.
        at: Position<U>,
    },
    /// The drive is at rest and never accepted the target, without an alarm.
    #[error("did not move to {wanted} and is at {at}, without an alarm; {hint}")]
    Ignored {
        /// Requested position.
        wanted: Position<U>,
        /// Position read back from the drive.
        at: Position<U>,
        /// Usual cause, and what to check.
        hint: &'static str,
    },
    /// The drive accepted the target and is elsewhere.
    #[error("is at {at}, {off:.4} {} from its target {wanted}", U::SYMBOL)]
    NotThere {
        /// Requested position.
        wanted: Position<U>,
        /// Position read back from the drive.
        at: Position<U>,
        /// The deviation, in the unit `U`.
        off: f64,
    },
    /// The requested stop. The axis is at rest.
    #[error("stopped at {at}")]
    Stopped {
        /// Position read back from the drive.
        at: Position<U>,
    },
    /// It took too long and was stopped. The axis is at rest.
    #[error("{doing} not finished after {seconds:.1} s, stopped at {at}")]
    Overdue {
        /// Operation that took too long.
        doing: &'static str,
        /// Waiting time, s.
        seconds: f64,
        /// Position read back from the drive.
        at: Position<U>,
    },
    /// The stop was sent and the axis still reports motion.
    #[error("still moving {seconds:.1} s after the stop, at {at}")]
    WillNotStop {
        /// Waiting time, s.
        seconds: f64,
        /// Position read back from the drive.
        at: Position<U>,
    },
    /// An alarm that a reset did not clear.
    #[error("alarm {alarm} is still there after the reset")]
    AlarmPersists {
        /// Alarm code of the drive, with its name.
        alarm: Alarm,
    },
    /// The drive ended its homing without knowing where it is.
    #[error("homing ended at {at} without success")]
    NotHomed {
        /// Position read back from the drive.
        at: Position<U>,
    },
    /// A drive that was homed neither moved nor homed itself anew.
    #[error("acknowledged a homing, did not move, and is at {at}, without an alarm; {hint}")]
    HomingUnseen {
        /// Position read back from the drive.
        at: Position<U>,
        /// Usual cause, and what to check.
        hint: &'static str,
    },
    /// An axis that should rise while it homes was sinking. It was stopped.
    #[error("was sinking while it homed, stopped at {at}")]
    HomesDownwards {
        /// Position read back from the drive.
        at: Position<U>,
    },
}
