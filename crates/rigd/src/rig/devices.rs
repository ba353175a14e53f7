//! Carries an operation of the engine out on the drivers.

use rig_analyzer::{Analyzer, AnalyzerError};
use rig_engine::{Device, Failure, FailureKind, Operation, Report};
use rig_link::StopSignal;
use rig_model::{Deg, Mm, Unit, with_causes};
use rig_stage::{BusError, Stage, StageError};

/// The drivers of the three devices.
#[derive(Debug)]
pub(super) struct Devices {
    pub(super) analyzer: Analyzer,
    pub(super) linear: Stage<Mm>,
    pub(super) rotary: Stage<Deg>,
    /// Whether the linear stage is known to home upwards, away from the sample.
    pub(super) is_homing_up: bool,
}

impl Devices {
    /// Does what is asked and says how it ended. Not cancel-safe: a future that is dropped may
    /// leave half a frame on the line. `stop` ends it early.
    pub(super) async fn perform(
        &mut self,
        operation: &Operation,
        stop: &StopSignal,
    ) -> Result<Report, Failure> {
        match operation {
            Operation::PrepareLinear => {
                prepare(&mut self.linear, stop, Device::LinearStage).await.map(Report::LinearAt)
            }
            &Operation::FindLinear { may_reset_alarm } => {
                let found = find(&mut self.linear, may_reset_alarm, self.is_homing_up, stop).await;
                found.map_err(|error| stage_failure(Device::LinearStage, &error))
            }
            Operation::PrepareRotary => {
                prepare(&mut self.rotary, stop, Device::RotaryStage).await.map(Report::RotaryAt)
            }
            &Operation::MoveLinear { target, speed_mm_per_s } => self
                .linear
                .move_to(target, speed_mm_per_s, stop)
                .await
                .map(Report::LinearAt)
                .map_err(|error| stage_failure(Device::LinearStage, &error)),
            &Operation::MoveRotary { target, speed_deg_per_s } => self
                .rotary
                .move_to(target, speed_deg_per_s, stop)
                .await
                .map(Report::RotaryAt)
                .map_err(|error| stage_failure(Device::RotaryStage, &error)),
            Operation::Measure { points, level } => {
                self.measure(points, *level, stop).await.map(Report::Measured)
            }
            Operation::StopMotion => {
                // Both are told, whatever the first one answers.
                let rotary = self.rotary.stop().await;
                let linear = self.linear.stop().await;
                rotary.map_err(|error| stage_failure(Device::RotaryStage, &error))?;
                linear.map_err(|error| stage_failure(Device::LinearStage, &error))?;
                Ok(Report::Stopped)
            }
        }
    }

    async fn measure(
        &mut self,
        points: &[rig_model::SweepPoint],
        level: rig_model::DriveLevel,
        stop: &StopSignal,
    ) -> Result<Vec<rig_model::Reading>, Failure> {
        let failure = |error: AnalyzerError| Failure {
            device: Device::Analyzer,
            kind: match &error {
                AnalyzerError::Stopped { .. } => FailureKind::Interrupted,
                error if error.is_line_failure() => FailureKind::Line,
                _ => FailureKind::Refused,
            },
            detail: with_causes(&error),
        };
        self.analyzer.configure(level).await.map_err(failure)?;
        self.analyzer.measure(points, stop).await.map_err(failure)
    }
}

/// Finds the drive again, clears an old alarm, homes the axis if it is not homed, and reads back
/// where it is. Does nothing to an axis that says that it is where it cannot be.
async fn prepare<U: Unit>(
    stage: &mut Stage<U>,
    stop: &StopSignal,
    device: Device,
) -> Result<rig_model::Position<U>, Failure> {
    let prepared = async {
        // Another device may answer now than before the fault.
        let status = stage.identify().await?;
        if status.is_homed {
            stage.believe_position()?;
        }
        if status.alarm.is_some() {
            stage.reset_alarm().await?;
        }
        if !status.is_homed {
            stage.home(stop).await?;
        }
        stage.status().await?;
        stage.believe_position()
    };
    prepared.await.map_err(|error| stage_failure(device, &error))
}

/// Finds the linear stage again while the probe may be in contact. It is homed only if it has lost its
/// position and homes upwards.
async fn find(
    stage: &mut Stage<Mm>,
    may_reset_alarm: bool,
    is_homing_up: bool,
    stop: &StopSignal,
) -> Result<Report, StageError<Mm>> {
    let status = stage.identify().await?;
    if status.is_homed {
        stage.believe_position()?;
    }
    if let Some(alarm) = status.alarm {
        if !may_reset_alarm {
            return Err(StageError::Alarmed { alarm, at: status.position });
        }
        stage.reset_alarm().await?;
    }
    if !status.is_homed && is_homing_up {
        stage.home_upwards(stop).await?;
        return stage.believe_position().map(Report::LinearHomed);
    }
    stage.status().await?;
    stage.believe_position().map(Report::LinearAt)
}

fn stage_failure<U: Unit>(device: Device, error: &StageError<U>) -> Failure {
    let kind = match error {
        StageError::Stopped { .. } => FailureKind::Interrupted,
        StageError::Bus(BusError::Failed(_)) => FailureKind::Line,
        StageError::BeyondTravel { .. }
        | StageError::Unhomed { .. }
        | StageError::HomesDownwards { .. } => FailureKind::Lost,
        StageError::Alarmed { .. } | StageError::AlarmPersists { .. } => FailureKind::Alarmed,
        _ => FailureKind::Refused,
    };
    Failure { device, kind, detail: with_causes(error) }
}
