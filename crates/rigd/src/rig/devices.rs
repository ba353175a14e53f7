//! Carries an operation of the engine out on the drivers.

use rig_analyzer::{Analyzer, AnalyzerError};
use rig_engine::{Device, Failure, FailureKind, Operation, Report};
use rig_interlock::Outcome;
use rig_link::StopSignal;
use rig_model::{Deg, DriveLevel, Mm, Position, Reading, SweepPoint, Unit, with_causes};
use rig_stage::{AxisStatus, BusError, HaltFrames, LineFault, Stage, StageError};
use tokio::sync::mpsc;

use super::{
    DeviceError,
    gate::Gate,
    slot::{Ended, Perform},
};

/// The drivers of both axes, which share a bus.
#[derive(Debug)]
pub(super) struct Axes {
    pub(super) linear: Stage<Mm>,
    pub(super) rotary: Stage<Deg>,
    /// Whether the linear stage is known to home upwards, away from the sample.
    pub(super) is_homing_up: bool,
    /// Whether the rotary stage is homed anew before it is used, although its drive may say that it is homed: the program
    /// before noted a fault of it and did not bring the rig into service again, and the drive may have lost count.
    pub(super) is_rotary_doubtful: bool,
    pub(super) gate: Gate,
}

/// The analyzer behind the interlock.
#[derive(Debug)]
pub(super) struct GatedAnalyzer {
    pub(super) analyzer: Analyzer,
    pub(super) gate: Gate,
    /// Readings of a descent.
    pub(super) readings: mpsc::UnboundedSender<Reading>,
}

impl Axes {
    /// The frames that stop both axes.
    pub(super) fn halt_frames(&self) -> Result<HaltFrames, DeviceError> {
        // The probe first: it is what presses.
        Ok(HaltFrames::of([self.linear.halt_frames()?, self.rotary.halt_frames()?]))
    }
}

impl Perform for Axes {
    async fn perform(&mut self, operation: &Operation, stop: &StopSignal) -> Ended {
        let linear = |error| stage_failure(Device::LinearStage, &error);
        if stop.is_raised() && matches!(operation, Operation::Descend { .. }) {
            // It is ended before it has begun: a descent without a way, after which the search goes on.
            let at = self.read_linear().await.map_err(linear)?;
            return Ok(Report::Descended { at, way: Vec::new() });
        }
        not_after_a_stop(Device::LinearStage, stop)?;
        if self.gate.needs_reading(operation) {
            self.read_linear().await.map_err(linear)?;
        }
        if self.gate.needs_tilt(operation) {
            let rotary = |error| stage_failure(Device::RotaryStage, &error);
            self.read_rotary().await.map_err(rotary)?;
        }
        self.gate.admit(operation)?;
        let ended = self.carry_out(operation, stop).await;
        self.gate.ended(operation, &ended, stop.is_raised());
        ended
    }
}

impl Axes {
    /// Reads the linear stage back, where nothing moves it.
    async fn read_linear(&mut self) -> Result<Position<Mm>, StageError<Mm>> {
        let (at, is_at_rest) = read_back(&mut self.linear).await?;
        if is_at_rest {
            self.gate.read(Outcome::LinearAt(at));
        }
        Ok(at)
    }

    /// Reads the rotary stage back, where nothing turns it.
    async fn read_rotary(&mut self) -> Result<(), StageError<Deg>> {
        let (at, is_at_rest) = read_back(&mut self.rotary).await?;
        self.rotary.refuse_jump()?;
        if is_at_rest {
            self.gate.read(Outcome::RotaryAt(at));
        }
        Ok(())
    }

    /// Tells the interlock where the rotary stage has stopped, if its drive knows where it is, and is believed.
    fn rotary_at_rest(&mut self, at: Position<Deg>) -> Option<Position<Deg>> {
        let is_known = self.rotary.trusted_position().is_ok() && !self.rotary.has_jumped();
        if is_known {
            self.gate.read(Outcome::RotaryAt(at));
        }
        is_known.then_some(at)
    }

    async fn carry_out(&mut self, operation: &Operation, stop: &StopSignal) -> Ended {
        let linear = |error| stage_failure(Device::LinearStage, &error);
        let rotary = |error| stage_failure(Device::RotaryStage, &error);
        match operation {
            &Operation::HomeLinear { anew } => {
                prepare(&mut self.linear, anew, stop).await.map(Report::LinearAt).map_err(linear)
            }
            &Operation::FindLinear { may_reset_alarm } => {
                find(&mut self.linear, may_reset_alarm, self.is_homing_up).await.map_err(linear)
            }
            Operation::HomeUpwards => {
                let homed = home_upwards(&mut self.linear, self.is_homing_up, stop).await;
                homed.map(Report::LinearHomed).map_err(linear)
            }
            Operation::PrepareRotary => {
                let anew = self.is_rotary_doubtful;
                let at = prepare(&mut self.rotary, anew, stop).await.map_err(rotary)?;
                self.is_rotary_doubtful = false;
                Ok(Report::RotaryAt(at))
            }
            &Operation::MoveLinear { target, speed_mm_per_s } => {
                let moved = self.linear.move_to(target, speed_mm_per_s, stop).await;
                moved.map(Report::LinearAt).map_err(linear)
            }
            &Operation::MoveRotary { target, speed_deg_per_s } => {
                // A stop, which an abort begins with too, has taken the place where it is now for that of its rest.
                self.rotary.refuse_jump().map_err(rotary)?;
                let moved = self.rotary.move_to(target, speed_deg_per_s, stop).await;
                moved.map(Report::RotaryAt).map_err(rotary)
            }
            &Operation::Descend { target, speed_mm_per_s, .. } => {
                let descended = self.linear.descend_to(target, speed_mm_per_s, stop).await;
                descended.map(|(at, way)| Report::Descended { at, way }).map_err(linear)
            }
            Operation::StopMotion => {
                // Both axes get the command, even if the first one fails.
                let stopped_linear = self.linear.stop().await;
                let stopped_rotary = self.rotary.stop().await;
                let at_linear = stopped_linear.map_err(linear)?;
                let at_rotary = stopped_rotary.map_err(rotary)?;
                // A drive that was switched off and on may say that the probe is clear.
                let is_known = self.linear.trusted_position().is_ok();
                if is_known {
                    self.gate.read(Outcome::LinearAt(at_linear));
                }
                self.rotary_at_rest(at_rotary);
                Ok(Report::Stopped(is_known.then_some(at_linear)))
            }
            Operation::StopRotary => {
                let at = self.rotary.stop().await.map_err(rotary)?;
                Ok(Report::RotaryStopped(self.rotary_at_rest(at)))
            }
            Operation::Measure { .. } => unreachable!("the analyzer has an owner of its own"),
        }
    }
}

impl Perform for GatedAnalyzer {
    async fn perform(&mut self, operation: &Operation, stop: &StopSignal) -> Ended {
        not_after_a_stop(Device::Analyzer, stop)?;
        if let Operation::Descend { point, level, .. } = operation {
            return self.stream(point, *level, stop).await;
        }
        self.gate.admit(operation)?;
        let ended = measure(&mut self.analyzer, operation, stop).await;
        self.gate.ended(operation, &ended, stop.is_raised());
        ended
    }
}

impl GatedAnalyzer {
    /// The readings of a descent. A stream that breaks off is no fault for the interlock: the descent ends with
    /// it, and the next measurement finds the analyzer again.
    async fn stream(&mut self, point: &SweepPoint, level: DriveLevel, stop: &StopSignal) -> Ended {
        self.gate.admit_stream()?;
        let readings = &self.readings;
        let streamed = match self.analyzer.configure(level).await {
            // The shell may have gone away.
            Ok(()) => self.analyzer.stream(point, stop, |one| _ = readings.send(one)).await,
            Err(error) => Err(error),
        };
        self.gate.stream_ended();
        streamed.map(|()| Report::Measured(Vec::new())).map_err(analyzer_failure)
    }
}

/// Where a stage is, if its drive has no alarm and knows it, and whether it is at rest.
async fn read_back<U: Unit>(stage: &mut Stage<U>) -> Result<(Position<U>, bool), StageError<U>> {
    let status = stage.status().await?;
    not_under_emergency_stop(&status, false)?;
    if let Some(alarm) = status.alarm {
        return Err(StageError::Alarmed { alarm, at: status.position });
    }
    Ok((stage.trusted_position()?, !status.is_moving))
}

/// An operation does not begin if a stop was requested after it.
fn not_after_a_stop(device: Device, stop: &StopSignal) -> Result<(), Failure> {
    if stop.is_raised() {
        let detail = "a stop came before the operation began".to_owned();
        return Err(Failure { device, kind: FailureKind::Interrupted, detail });
    }
    Ok(())
}

async fn measure(analyzer: &mut Analyzer, operation: &Operation, stop: &StopSignal) -> Ended {
    let Operation::Measure { points, level } = operation else {
        unreachable!("the axes have an owner of their own")
    };
    analyzer.configure(*level).await.map_err(analyzer_failure)?;
    analyzer.measure(points, stop).await.map(Report::Measured).map_err(analyzer_failure)
}

/// The failure of a measurement.
#[expect(clippy::needless_pass_by_value, reason = "errors are mapped by this")]
pub(crate) fn analyzer_failure(error: AnalyzerError) -> Failure {
    let kind = match &error {
        AnalyzerError::Stopped { .. } => FailureKind::Interrupted,
        AnalyzerError::Restarted { .. } => FailureKind::Restarted,
        AnalyzerError::HeldUp { .. } => FailureKind::HeldUp,
        error if error.is_line_failure() => FailureKind::Line,
        _ => FailureKind::Refused,
    };
    Failure { device: Device::Analyzer, kind, detail: with_causes(&error) }
}

/// Finds the drive again, clears an old alarm, homes the axis if it is not homed, has jumped, or `anew`, and reads back where it
/// is.
/// Does nothing to an axis that says that it is where it cannot be.
async fn prepare<U: Unit>(
    stage: &mut Stage<U>,
    anew: bool,
    stop: &StopSignal,
) -> Result<Position<U>, StageError<U>> {
    // Another device may answer now than before the fault.
    let status = stage.identify().await?;
    if status.is_homed {
        stage.trusted_position()?;
    }
    not_under_emergency_stop(&status, true)?;
    if status.alarm.is_some() {
        stage.reset_alarm().await?;
    }
    if anew || !status.is_homed || stage.has_jumped() {
        stage.home(stop).await?;
    }
    come_to_rest(stage).await?;
    stage.trusted_position()
}

/// Stops an axis that moves although nothing here has told it to: after a stop that it has not answered.
async fn come_to_rest<U: Unit>(stage: &mut Stage<U>) -> Result<(), StageError<U>> {
    if stage.status().await?.is_moving {
        stage.stop().await?;
    }
    Ok(())
}

/// Finds the linear stage again while the probe may be in contact.
async fn find(
    stage: &mut Stage<Mm>,
    may_reset_alarm: bool,
    is_homing_up: bool,
) -> Result<Report, StageError<Mm>> {
    let status = stage.identify().await?;
    if status.is_homed {
        stage.trusted_position()?;
    }
    not_under_emergency_stop(&status, may_reset_alarm)?;
    if let Some(alarm) = status.alarm {
        if !may_reset_alarm {
            return Err(StageError::Alarmed { alarm, at: status.position });
        }
        stage.reset_alarm().await?;
    }
    if !status.is_homed && is_homing_up {
        return Ok(Report::Unhomed);
    }
    come_to_rest(stage).await?;
    stage.trusted_position().map(Report::LinearAt)
}

/// Homes the linear stage; one whose homing is not known to lead away from the sample stays where it is.
async fn home_upwards(
    stage: &mut Stage<Mm>,
    is_homing_up: bool,
    stop: &StopSignal,
) -> Result<Position<Mm>, StageError<Mm>> {
    if is_homing_up {
        stage.home_upwards(stop).await?;
    }
    stage.trusted_position()
}

/// Refuses a drive whose emergency stop is pressed. Where it says so by an alarm, a reset shows whether it still
/// is.
fn not_under_emergency_stop<U: Unit>(
    status: &AxisStatus<U>,
    may_reset_alarm: bool,
) -> Result<(), StageError<U>> {
    let is_old = may_reset_alarm && status.alarm.is_some();
    if status.is_emergency_stopped && !is_old {
        return Err(StageError::EmergencyStopped { at: status.position });
    }
    Ok(())
}

/// The failure of an operation of an axis.
pub(crate) fn stage_failure<U: Unit>(device: Device, error: &StageError<U>) -> Failure {
    let kind = match error {
        StageError::Stopped { .. }
        | StageError::Bus(BusError::Failed(LineFault::Halted { .. })) => FailureKind::Interrupted,
        StageError::Bus(BusError::Failed(_)) => FailureKind::Line,
        StageError::BeyondTravel { .. } | StageError::HomesDownwards { .. } => FailureKind::Lost,
        StageError::Moved { .. } => FailureKind::Moved,
        StageError::HomingUnseen { .. } => FailureKind::Unmoved,
        StageError::Unhomed { .. } => FailureKind::Unhomed,
        StageError::EmergencyStopped { .. } => FailureKind::EmergencyStopped,
        StageError::Alarmed { alarm, .. } | StageError::AlarmPersists { alarm } => {
            FailureKind::Alarmed { code: alarm.code }
        }
        StageError::Ignored { .. }
        | StageError::NotThere { .. }
        | StageError::Overdue { .. }
        | StageError::WillNotStop { .. }
        | StageError::NotHomed { .. } => FailureKind::Blocked,
        _ => FailureKind::Refused,
    };
    Failure { device, kind, detail: with_causes(error) }
}
