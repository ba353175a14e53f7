//! One axis: its commands and their confirmation by the drive.

use std::time::Duration;

use rig_files::instrument::drive::{EmergencyStop, Step};
use rig_link::{HealthMeter, StopSignal};
use rig_model::{Axis, Position, RigTime, Scale, Target, Unit};
use tokio::time::{Instant, sleep, sleep_until};

use crate::{
    Alarm, AxisStatus, BusError, BusHandle, HaltFrames, LineFault, RegisterMap, Reply, Request,
    StageError,
    drive_reading::{DriveReading, alarm, number, read_request},
    line::CheckRegisters,
    order::{Order, StepAction},
};

/// The shortest and the longest time between two readings of a moving axis. An alarm during a move
/// is seen after the longest at the latest.
const READ_INTERVAL_MIN: Duration = Duration::from_millis(10);
const READ_INTERVAL_MAX: Duration = Duration::from_secs(1);

/// The time between two readings of an axis that homes: the duration of homing is unknown.
const READ_INTERVAL_HOMING: Duration = Duration::from_millis(250);

/// The time between two readings of an axis that goes down evenly: a dozen of them know its way to a micrometre.
const READ_INTERVAL_DESCENT: Duration = Duration::from_millis(25);

/// A move is stopped after twice the computed time plus this time.
const MOVE_SLACK: Duration = Duration::from_secs(2);

/// Longest time for a measured position to settle into the tolerance after the end of the motion.
const SETTLE_WITHIN: Duration = Duration::from_millis(500);

/// Time limit of a stop.
const STOP_WITHIN: Duration = Duration::from_secs(3);

/// Time limit of homing.
const HOME_WITHIN: Duration = Duration::from_secs(120);

/// Time limit for clearing an alarm.
const RESET_WITHIN: Duration = Duration::from_secs(2);

/// Relative difference of two resolutions that are the same: a gear ratio is of two whole numbers, and a
/// rig file has some digits.
const RESOLUTION_REL: f64 = 1e-6;

/// What a drive shows without being written to.
#[derive(Debug, Clone, PartialEq)]
pub struct Look<U> {
    /// Its status.
    pub status: AxisStatus<U>,
    /// Whether its settings are those that [`Stage::identify`] gives it.
    pub has_settings: bool,
}

/// One axis on a bus.
#[derive(Debug)]
pub struct Stage<U: Unit> {
    bus: BusHandle,
    map: &'static RegisterMap,
    unit: u8,
    scale: Scale<U>,
    axis: Axis<U>,
    /// The last reading of the drive. `None` until it is identified.
    seen: Option<DriveReading>,
    /// When its position was read: in the middle between question and answer.
    seen_at: RigTime,
}

impl<U: Unit> Stage<U> {
    /// An axis that is driven by a device with this map, at this address of the bus.
    pub fn new(
        bus: BusHandle,
        map: &'static RegisterMap,
        unit: u8,
        scale: Scale<U>,
        axis: Axis<U>,
    ) -> Self {
        Self { bus, map, unit, scale, axis, seen: None, seen_at: RigTime::ZERO }
    }

    /// The counts of the drive.
    pub fn health(&self) -> HealthMeter {
        self.bus.health(self.unit)
    }

    /// The axis with its limits.
    pub const fn axis(&self) -> &Axis<U> {
        &self.axis
    }

    /// Identifies the drive: checks its signature, writes and reads back its settings, makes it take
    /// commands from here, and reads its status. After each fault of the line, the settings identify
    /// it again. Nothing moves.
    ///
    /// # Errors
    /// [`StageError::Bus`] when it does not answer, refuses, or keeps other settings than it was
    /// given; [`StageError::Unrecognised`] when anything else may be there.
    pub async fn identify(&mut self) -> Result<AxisStatus<U>, StageError<U>> {
        let order = Order::at_rest(&self.scale, &self.axis)?;
        let settings = &self.map.settings;
        let request = read_request(settings.read);
        // A drive that was switched off has lost the settings that identified it.
        self.recognise_by(request.clone(), None).await?;
        self.check_signature().await?;
        let expected = Reply::Words(order.words(&settings.expect));
        if self.ask(request.clone()).await? != expected {
            self.take_all(&settings.write, &order).await?;
            if self.ask(request.clone()).await? != expected {
                let (port, unit) = (self.bus.name().clone(), self.unit);
                let fault = LineFault::Changed { port, unit, request };
                return Err(BusError::from(fault).into());
            }
        }
        self.recognise_by(request, Some(expected)).await?;
        self.command(&self.map.prepare).await?;
        self.status().await
    }

    /// Recognises the drive and reads its status, and writes nothing: its settings are read and compared.
    /// It takes no moves after this that it would not have taken before.
    ///
    /// # Errors
    /// As [`identify`](Self::identify), except for settings, whose difference is in the [`Look`].
    pub async fn look(&mut self) -> Result<Look<U>, StageError<U>> {
        let request = read_request(self.map.settings.read);
        self.recognise_by(request, None).await?;
        self.look_again().await
    }

    /// The same look at a drive that was identified, and stays recognised by the settings that it was given.
    ///
    /// # Errors
    /// As [`look`](Self::look).
    pub async fn look_again(&mut self) -> Result<Look<U>, StageError<U>> {
        let order = Order::at_rest(&self.scale, &self.axis)?;
        let settings = &self.map.settings;
        self.check_signature().await?;
        let found = self.ask(read_request(settings.read)).await?;
        let has_settings = found == Reply::Words(order.words(&settings.expect));
        Ok(Look { status: self.status().await?, has_settings })
    }

    /// Checks, before anything is written, that the device is a drive of this make, and that it counts
    /// as the rig file says.
    async fn check_signature(&self) -> Result<(), StageError<U>> {
        let (signature, drives) = (&self.map.signature, self.map.drives.as_str());
        let reply = self.ask(read_request(signature.read)).await?;
        for &(address, width, min, max) in &signature.ranges {
            let (what, found) =
                (signature.what.as_str(), number(signature.read, &reply, address, width));
            if found < min || max < found {
                return Err(StageError::Unrecognised { what, found, min, max, drives });
            }
        }
        let Some(resolution) = self.map.resolution else { return Ok(()) };
        let read = |(address, width)| f64::from(number(signature.read, &reply, address, width));
        let found =
            resolution.factor * read(resolution.dividend) / resolution.divisor.map_or(1.0, read);
        let expected = self.scale.counts_per_revolution;
        // Ratios of settings of a drive need not be whole.
        if (found - expected).abs() > RESOLUTION_REL * expected {
            return Err(StageError::OtherResolution { found, expected });
        }
        Ok(())
    }

    async fn recognise_by(
        &self,
        request: Request,
        expected: Option<Reply>,
    ) -> Result<(), StageError<U>> {
        let registers = Some(CheckRegisters { request, expected });
        Ok(self.bus.set_check_registers(self.unit, registers).await?)
    }

    /// Reads the status of the drive.
    ///
    /// # Errors
    /// [`StageError::Bus`].
    pub async fn status(&mut self) -> Result<AxisStatus<U>, StageError<U>> {
        let reading = self.read_drive().await?;
        let alarm = self.alarm_of(&reading).await?;
        Ok(AxisStatus {
            at: self.bus.now(),
            position: self.scale.position(reading.position.into()),
            target: self.scale.position(reading.target.into()),
            is_moving: reading.is_moving,
            is_ready: reading.is_ready,
            is_homed: reading.is_homed,
            alarm,
            is_emergency_stopped: self.is_emergency_stopped(&reading, alarm),
        })
    }

    /// The position of the last reading, if it is plausible, so that a move may start from it.
    ///
    /// # Errors
    /// [`StageError::Unhomed`], [`StageError::BeyondTravel`], [`StageError::NotIdentified`].
    pub fn believe_position(&self) -> Result<Position<U>, StageError<U>> {
        let seen = self.seen.ok_or(StageError::NotIdentified)?;
        let (at, travel) = (self.scale.position(seen.position.into()), self.axis.travel());
        if !seen.is_homed {
            return Err(StageError::Unhomed { at });
        }
        if !self.axis.can_be_at(at) {
            return Err(StageError::BeyondTravel { at, travel });
        }
        Ok(at)
    }

    /// Moves to a target and returns where the axis is, measured. Returns only when the drive has
    /// confirmed that it is at rest, at this target, without alarm.
    ///
    /// # Errors
    /// [`StageError::Stopped`] after a requested stop: the stop was sent and the axis is at rest.
    /// [`StageError::Alarmed`], [`StageError::EmergencyStopped`], [`StageError::Ignored`],
    /// [`StageError::NotThere`], [`StageError::Overdue`]. Nothing is sent from a position that is unknown or impossible:
    /// [`StageError::Unhomed`], [`StageError::BeyondTravel`]. After [`StageError::Bus`] it is not
    /// known whether the axis moves.
    pub async fn move_to(
        &mut self,
        target: Target<U>,
        speed_per_s: f64,
        stop: &StopSignal,
    ) -> Result<Position<U>, StageError<U>> {
        self.believe_position()?;
        let from = self.seen.ok_or(StageError::NotIdentified)?.position;
        let wanted = target.position();
        let order = Order::to(wanted, speed_per_s, self.map, &self.scale, &self.axis)?;
        if stop.is_raised() {
            return Err(self.stopped_at(from));
        }
        self.take_all(&self.map.start, &order).await?;
        self.follow(target, &order, from, stop).await
    }

    /// Moves by a step from where the axis stands, and returns where it is, measured. For a drive whose sign and
    /// scale nobody has shown: it gets no settings, its position need not be plausible, and a drive that is not
    /// homed may move.
    ///
    /// # Errors
    /// As [`move_to`](Self::move_to) without those of the position, and [`StageError::Alarmed`] before anything
    /// moves.
    pub async fn jog(
        &mut self,
        by: f64,
        speed_per_s: f64,
        stop: &StopSignal,
    ) -> Result<Position<U>, StageError<U>> {
        let seen = self.read_drive().await?;
        let at = self.scale.position(seen.position.into());
        self.refuse_alarm(&seen, at).await?;
        let target = self.axis.step(at, by)?;
        let order = Order::to(target.position(), speed_per_s, self.map, &self.scale, &self.axis)?;
        if stop.is_raised() {
            return Err(self.stopped_at(seen.position));
        }
        self.command(&self.map.prepare).await?;
        self.take_all(&self.map.start, &order).await?;
        self.follow(target, &order, seen.position, stop).await
    }

    /// Goes down evenly to a target, or until the stop is raised, and reads the position on the way. Returns
    /// where the axis is at rest, and the positions with their times.
    ///
    /// # Errors
    /// As [`move_to`](Self::move_to), apart from [`StageError::Stopped`].
    pub async fn descend_to(
        &mut self,
        target: Target<U>,
        speed_per_s: f64,
        stop: &StopSignal,
    ) -> Result<(Position<U>, Vec<(RigTime, Position<U>)>), StageError<U>> {
        self.believe_position()?;
        let from = self.seen.ok_or(StageError::NotIdentified)?.position;
        let order = Order::to(target.position(), speed_per_s, self.map, &self.scale, &self.axis)?;
        let mut way = Vec::new();
        if stop.is_raised() {
            return Ok((self.scale.position(from.into()), way));
        }
        self.take_all(&self.map.start, &order).await?;
        let started = Instant::now();
        let deadline = started + order.duration_from(from).saturating_mul(2) + MOVE_SLACK;
        loop {
            if !wait(Instant::now() + READ_INTERVAL_DESCENT, stop).await {
                return Ok((self.stop().await?, way));
            }
            let reading = match self.read_drive().await {
                // The frames of a stop have left between the two.
                Err(StageError::Bus(BusError::Failed(LineFault::Halted { .. }))) => {
                    return Ok((self.stop().await?, way));
                }
                reading => reading?,
            };
            let at = self.scale.position(reading.position.into());
            self.refuse_alarm(&reading, at).await?;
            if reading.is_moving {
                way.push((self.seen_at, at));
            } else if self.start_within() < started.elapsed() || self.axis.is_at(at, target) {
                // It has arrived, or is stuck.
                return match self.follow(target, &order, from, stop).await {
                    Err(StageError::Stopped { at }) | Ok(at) => Ok((at, way)),
                    Err(error) => Err(error),
                };
            }
            if deadline <= Instant::now() {
                return Err(self.overdue("descent", started.elapsed()).await?);
            }
        }
    }

    /// Waits for the end of a move, with as few readings as its computed duration allows.
    async fn follow(
        &mut self,
        target: Target<U>,
        order: &Order,
        from: i32,
        stop: &StopSignal,
    ) -> Result<Position<U>, StageError<U>> {
        let started = Instant::now();
        let expected = order.duration_from(from);
        let deadline = started + expected.saturating_mul(2) + MOVE_SLACK;
        let mut next_reading_at = started + expected.clamp(READ_INTERVAL_MIN, READ_INTERVAL_MAX);
        // Rest at another position counts only if it lasts.
        let mut still_since = None;
        loop {
            if !wait(next_reading_at, stop).await {
                return Err(self.stop_and_say().await?);
            }
            let reading = self.read_drive().await?;
            let at = self.scale.position(reading.position.into());
            self.refuse_alarm(&reading, at).await?;
            let now = Instant::now();
            if reading.is_moving {
                if deadline <= now {
                    return Err(self.overdue("move", now - started).await?);
                }
                still_since = None;
                next_reading_at = now
                    + order.rest_from(reading.position).clamp(READ_INTERVAL_MIN, READ_INTERVAL_MAX);
                continue;
            }
            let has_target = reading.target == order.target;
            if has_target && self.axis.is_at(at, target) {
                return Ok(at);
            }
            let patience = if has_target { SETTLE_WITHIN } else { self.start_within() };
            if *still_since.get_or_insert(now) + patience <= now {
                return Err(self.not_there(target, order, from, &reading));
            }
            next_reading_at = now + READ_INTERVAL_MIN;
        }
    }

    /// The error of an axis that is at rest but not at its target.
    fn not_there(
        &self,
        target: Target<U>,
        order: &Order,
        from: i32,
        reading: &DriveReading,
    ) -> StageError<U> {
        let wanted = target.position();
        let at = self.scale.position(reading.position.into());
        let moved = self.scale.position(from.into()).value() - at.value();
        if reading.target != order.target || moved.abs() <= self.axis.tolerance() {
            return StageError::Ignored { wanted, at, hint: &self.map.ignored_hint };
        }
        StageError::NotThere { wanted, at, off: (at.value() - wanted.value()).abs() }
    }

    /// Lets the drive find its zero. May move over the whole travel.
    ///
    /// # Errors
    /// As [`move_to`](Self::move_to), and [`StageError::NotHomed`].
    pub async fn home(&mut self, stop: &StopSignal) -> Result<Position<U>, StageError<U>> {
        self.home_within(stop, f64::INFINITY).await
    }

    /// The same, for an axis that may only rise while it homes: as soon as a reading shows that it
    /// sinks, it is stopped.
    ///
    /// # Errors
    /// As [`home`](Self::home), and [`StageError::HomesDownwards`].
    pub async fn home_upwards(&mut self, stop: &StopSignal) -> Result<Position<U>, StageError<U>> {
        self.home_within(stop, self.axis.tolerance()).await
    }

    /// Homes, and stops if the axis sinks further than `sinks_most`.
    async fn home_within(
        &mut self,
        stop: &StopSignal,
        sinks_most: f64,
    ) -> Result<Position<U>, StageError<U>> {
        let from = self.seen.ok_or(StageError::NotIdentified)?;
        if stop.is_raised() {
            return Err(self.stopped_at(from.position));
        }
        let started_at = self.scale.position(from.position.into()).value();
        self.command(&self.map.home).await?;
        let started = Instant::now();
        let mut next_reading_at = started + self.start_within();
        loop {
            if !wait(next_reading_at, stop).await {
                return Err(self.stop_and_say().await?);
            }
            let reading = self.read_drive().await?;
            let at = self.scale.position(reading.position.into());
            self.refuse_alarm(&reading, at).await?;
            let now = Instant::now();
            if !reading.is_moving {
                return if reading.is_homed { Ok(at) } else { Err(StageError::NotHomed { at }) };
            }
            if at.value() < started_at - sinks_most {
                let at = self.stop().await?;
                return Err(StageError::HomesDownwards { at });
            }
            if started + HOME_WITHIN <= now {
                return Err(self.overdue("homing", now - started).await?);
            }
            next_reading_at =
                now + if sinks_most.is_finite() { READ_INTERVAL_MIN } else { READ_INTERVAL_HOMING };
        }
    }

    /// Stops with deceleration and returns the position of the axis.
    ///
    /// # Errors
    /// [`StageError::WillNotStop`], [`StageError::Bus`].
    pub async fn stop(&mut self) -> Result<Position<U>, StageError<U>> {
        let order = Order::at_rest(&self.scale, &self.axis)?;
        for step in &self.map.stop {
            self.take(step, &order, Priority::Urgent).await?;
        }
        let started = Instant::now();
        let at = loop {
            let reading = self.read_drive().await?;
            let at = self.scale.position(reading.position.into());
            if !reading.is_moving {
                break at;
            }
            let waited = started.elapsed();
            if STOP_WITHIN <= waited {
                let seconds = waited.as_secs_f64();
                return Err(StageError::WillNotStop { seconds, at });
            }
            sleep(READ_INTERVAL_MIN).await;
        };
        self.command(&self.map.release_stop).await?;
        Ok(at)
    }

    /// The frames that stop this axis, for [`BusHandle::halt`]. [`stop`](Self::stop) must follow: it
    /// confirms the standstill, and releases what the frames have set.
    ///
    /// # Errors
    /// [`StageError::Uncountable`] for an axis whose limits its drive cannot count to.
    pub fn halt_frames(&self) -> Result<HaltFrames, StageError<U>> {
        let order = Order::at_rest(&self.scale, &self.axis)?;
        let frames = self.map.stop.iter().filter_map(|step| match order.action(step) {
            StepAction::Ask(request) => Some((self.unit, request)),
            StepAction::Wait(_) => None,
        });
        Ok(HaltFrames(frames.collect()))
    }

    /// Clears an alarm, and makes the drive take commands again. Nothing moves.
    ///
    /// # Errors
    /// [`StageError::AlarmPersists`], [`StageError::Bus`].
    pub async fn reset_alarm(&mut self) -> Result<AxisStatus<U>, StageError<U>> {
        self.command(&self.map.reset).await?;
        self.command(&self.map.prepare).await?;
        let give_up = Instant::now() + RESET_WITHIN;
        loop {
            let status = self.status().await?;
            match status.alarm {
                None => return Ok(status),
                Some(alarm) if give_up <= Instant::now() => {
                    return Err(StageError::AlarmPersists { alarm });
                }
                Some(_) => sleep(READ_INTERVAL_MIN).await,
            }
        }
    }

    /// Stops and returns [`StageError::Stopped`].
    async fn stop_and_say(&mut self) -> Result<StageError<U>, StageError<U>> {
        let at = self.stop().await?;
        Ok(StageError::Stopped { at })
    }

    async fn overdue(
        &mut self,
        doing: &'static str,
        waited: Duration,
    ) -> Result<StageError<U>, StageError<U>> {
        let at = self.stop().await?;
        Ok(StageError::Overdue { doing, seconds: waited.as_secs_f64(), at })
    }

    fn stopped_at(&self, counts: i32) -> StageError<U> {
        StageError::Stopped { at: self.scale.position(counts.into()) }
    }

    fn start_within(&self) -> Duration {
        Duration::from_millis(self.map.start_within_ms.into())
    }

    /// Carries out a command that is not a move.
    async fn command(&self, steps: &[Step]) -> Result<(), StageError<U>> {
        self.take_all(steps, &Order::at_rest(&self.scale, &self.axis)?).await
    }

    async fn take_all(&self, steps: &[Step], order: &Order) -> Result<(), StageError<U>> {
        for step in steps {
            self.take(step, order, Priority::None).await?;
        }
        Ok(())
    }

    async fn take(
        &self,
        step: &Step,
        order: &Order,
        priority: Priority,
    ) -> Result<(), StageError<U>> {
        match order.action(step) {
            StepAction::Ask(request) => match priority {
                Priority::None => self.ask(request).await.map(drop),
                Priority::Urgent => Ok(self.bus.urge(self.unit, request).await.map(drop)?),
            },
            StepAction::Wait(duration) => {
                sleep(duration).await;
                Ok(())
            }
        }
    }

    async fn read_drive(&mut self) -> Result<DriveReading, StageError<U>> {
        let mut replies = Vec::with_capacity(self.map.status.len());
        for (index, &block) in self.map.status.iter().enumerate() {
            let asked = self.bus.now();
            replies.push(self.ask(read_request(block)).await?);
            if index == self.map.position.block {
                self.seen_at = asked + self.bus.now().since(asked) / 2;
            }
        }
        let reading = DriveReading::new(self.map, &replies);
        self.seen = Some(reading);
        Ok(reading)
    }

    async fn alarm_of(&self, reading: &DriveReading) -> Result<Option<Alarm>, StageError<U>> {
        let code = match reading.alarm_block {
            None => reading.alarm_code,
            Some(block) => match self.ask(read_request(block)).await? {
                Reply::Words(words) => words[0],
                Reply::Bits(_) | Reply::Written => unreachable!("a read is answered by words"),
            },
        };
        Ok(alarm(self.map, code))
    }

    async fn refuse_alarm(
        &self,
        reading: &DriveReading,
        at: Position<U>,
    ) -> Result<(), StageError<U>> {
        match self.alarm_of(reading).await? {
            alarm if self.is_emergency_stopped(reading, alarm) => {
                Err(StageError::EmergencyStopped { at })
            }
            None => Ok(()),
            Some(alarm) => Err(StageError::Alarmed { alarm, at }),
        }
    }

    /// Whether the drive says, by a flag or by this alarm, that its emergency stop is pressed.
    fn is_emergency_stopped(&self, reading: &DriveReading, alarm: Option<Alarm>) -> bool {
        match self.map.emergency_stop {
            Some(EmergencyStop::Alarm(code)) => alarm.is_some_and(|alarm| alarm.code == code),
            Some(EmergencyStop::Flag(_)) => reading.has_stop_flag,
            None => false,
        }
    }

    async fn ask(&self, request: Request) -> Result<Reply, StageError<U>> {
        Ok(self.bus.request(self.unit, request).await?)
    }
}

/// Whether a request may wait for a line to be in order.
#[derive(Debug, Clone, Copy)]
enum Priority {
    None,
    Urgent,
}

/// Waits until an instant and returns whether it was before the stop.
async fn wait(until: Instant, stop: &StopSignal) -> bool {
    tokio::select! {
        biased;
        () = stop.raised() => false,
        () = sleep_until(until) => true,
    }
}
