//! The troubles of the linear drive that outlast the operation in which they begin.

use std::time::Duration;

use rig_engine::{Device, Failure, FailureKind, Operation, Report};
use rig_model::{Position, RigTime};

use crate::world::World;

/// A trouble of the linear drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum DriveTrouble {
    /// Nothing on the bus answers for this time, s.
    Silent { seconds: u64 },
    /// It refuses this number of requests.
    Refuses { requests: u32 },
    /// It has an alarm, which this number of resets clears; each brings another alarm, or the same one.
    Alarm { resets: u32, is_another: bool },
    /// Its emergency stop is pressed, and that of the rotary drive.
    EmergencyStop,
    /// It has lost its position; homing is known to lead away from the sample, or is not.
    Unhomed { is_homing_safe: bool },
    /// It has lost its position, homing leads away from the sample, and what it says at the end of that is lost.
    HomedUnheard,
    /// It says that it is this much higher than it is, mm, and its next move fails.
    Jumped { by_mm: f64, then: FailureKind },
}

/// A linear drive in trouble.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Drive {
    trouble: DriveTrouble,
    since: RigTime,
    pub(crate) resets: u32,
    /// Requests that it refused.
    pub(crate) refused: u32,
}

/// Where no linear stage can be: its driver believes no such position.
const TRAVEL_MM: f64 = 90.0;

/// Duration of an attempt on a line without an answer.
const ATTEMPT: Duration = Duration::from_secs(2);

impl Drive {
    pub(crate) const fn new(trouble: DriveTrouble, since: RigTime) -> Self {
        Self { trouble, since, resets: 0, refused: 0 }
    }

    /// How an operation ends on a drive in trouble; `None` if it is as usual.
    pub(crate) fn answer(
        world: &mut World,
        operation: &Operation,
    ) -> Option<Result<Report, Failure>> {
        let drive = world.drive.as_mut()?;
        let is_on_bus = !matches!(operation, Operation::Measure { .. });
        let is_linear = is_on_bus
            && !matches!(operation, Operation::PrepareRotary | Operation::MoveRotary { .. });
        match drive.trouble {
            DriveTrouble::Silent { seconds } if is_on_bus => {
                if drive.since + Duration::from_secs(seconds) <= world.now {
                    return None;
                }
                world.now = world.now + ATTEMPT;
                let is_rotary = !is_linear;
                let device = if is_rotary { Device::RotaryStage } else { Device::LinearStage };
                Some(failed(device, FailureKind::Line))
            }
            DriveTrouble::EmergencyStop if is_on_bus && *operation != Operation::StopMotion => {
                drive.refused += 1;
                let device = if is_linear { Device::LinearStage } else { Device::RotaryStage };
                Some(failed(device, FailureKind::EmergencyStopped))
            }
            DriveTrouble::Refuses { requests } if is_linear => {
                drive.refused += 1;
                (drive.refused <= requests)
                    .then(|| failed(Device::LinearStage, FailureKind::Refused))
            }
            DriveTrouble::Alarm { resets, is_another } if is_linear => {
                let is_reset = matches!(operation, Operation::FindLinear { may_reset_alarm: true });
                drive.resets += u32::from(is_reset);
                let is_stop = *operation == Operation::StopMotion;
                if resets <= drive.resets || is_stop {
                    return None;
                }
                let code =
                    if is_another { u16::try_from(drive.resets).unwrap_or_default() } else { 0 };
                Some(failed(Device::LinearStage, FailureKind::Alarmed { code }))
            }
            DriveTrouble::Unhomed { is_homing_safe } if is_linear => {
                Self::unhomed(world, operation, is_homing_safe)
            }
            DriveTrouble::HomedUnheard if is_linear => {
                let homed = Self::unhomed(world, operation, true);
                let is_homed = matches!(homed, Some(Ok(Report::LinearHomed(_))));
                if is_homed { Some(failed(Device::LinearStage, FailureKind::Line)) } else { homed }
            }
            DriveTrouble::Jumped { by_mm, then } => {
                let at = Position::new(world.linear_mm + by_mm);
                let is_possible = at.value() < TRAVEL_MM;
                let answer = match operation {
                    Operation::FindLinear { .. } if !is_possible => {
                        return Some(failed(Device::LinearStage, FailureKind::Lost));
                    }
                    Operation::FindLinear { .. } => Report::LinearAt(at),
                    Operation::StopMotion => Report::Stopped(is_possible.then_some(at)),
                    Operation::MoveLinear { .. } => return Some(failed(Device::LinearStage, then)),
                    Operation::HomeLinear { .. } | Operation::HomeUpwards => {
                        (world.drive, world.is_lost) = (None, false);
                        return None;
                    }
                    _ => return None,
                };
                // The world refuses every move from here on.
                world.is_lost = true;
                Some(Ok(answer))
            }
            _ => None,
        }
    }

    /// The answer of a drive that has lost its position.
    fn unhomed(
        world: &mut World,
        operation: &Operation,
        is_homing_safe: bool,
    ) -> Option<Result<Report, Failure>> {
        match operation {
            Operation::StopMotion => Some(Ok(Report::Stopped(None))),
            Operation::FindLinear { .. } if is_homing_safe => Some(Ok(Report::Unhomed)),
            Operation::HomeUpwards => {
                // Its position is known again, also after one where it could not be.
                (world.drive, world.is_lost) = (None, false);
                world.linear_mm = 49.0;
                Some(Ok(Report::LinearHomed(Position::new(49.0))))
            }
            // A person has taken the sample away.
            Operation::HomeLinear { .. } => {
                (world.drive, world.is_lost) = (None, false);
                None
            }
            _ => {
                world.is_lost |= matches!(operation, Operation::FindLinear { .. });
                Some(failed(Device::LinearStage, FailureKind::Unhomed))
            }
        }
    }
}

fn failed(device: Device, kind: FailureKind) -> Result<Report, Failure> {
    Err(Failure { device, kind, detail: "as it was told to".to_owned() })
}
