//! One axis: its commands and their confirmation by the drive.

mod descent;
mod homing;
mod recognise;

use std::time::Duration;

use rig_files::instrument::drive::{EmergencyStop, Step};
use rig_link::{HealthMeter, StopSignal};
use rig_model::{Axis, Position, RigTime, Scale, Target, Unit};
use tokio::time::{Instant, sleep, sleep_until};

pub use self::recognise::Look;
use crate::{
    Alarm, AxisStatus, BusHandle, HaltFrames, RegisterMap, Reply, Request, StageError,
    drive_reading::{DriveReading, alarm, alarm_of_code, read_request},
    order::{Order, StepAction},
};

/// The shortest and the longest time between two readings of a moving axis. An alarm during a move
/// is seen after the longest at the latest.
const READ_INTERVAL_MIN: Duration = Duration::from_millis(10);
const READ_INTERVAL_MAX: Duration = Duration::from_secs(1);

/// Longest exchange whose middle says when the position was read. One that was asked again or answered late does not.
const EXCHANGE_MAX: Duration = Duration::from_millis(40);

/// A move is stopped after twice the computed time plus this time.
const MOVE_SLACK: Duration = Duration::from_secs(2);

/// Longest time for a measured position to settle into the tolerance after the end of the motion.
const SETTLE_WITHIN: Duration = Duration::from_millis(500);

/// A reading of a drive is read again before a move if it is older than this: a drive that was switched off and on in
/// between has lost its position, and takes longer to start.
const RECENT: Duration = Duration::from_millis(250);

/// Largest distance of an axis from where it came to rest, in tolerances of its read-back.
const REST_TOLERANCES: f64 = 10.0;

/// Time limit of a stop.
const STOP_WITHIN: Duration = Duration::from_secs(3);

/// A stop is sent again to a drive that still moves after this time.
const STOP_AGAIN: Duration = Duration::from_millis(300);

/// Time limit for clearing an alarm.
const RESET_WITHIN: Duration = Duration::from_secs(2);

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
    /// Where it came to rest at the end of its last motion, or was found, in counts; `None` once it was sent on. Other readings
    /// leave it: a position that is another one then is not where the axis was left.
    rest: Option<i32>,
    /// Where it had come to rest when it was read back elsewhere; `None` after a homing since.
    jumped_from: Option<Position<U>>,
    /// When its position was read, if that is known: in the middle between question and answer.
    seen_at: Option<RigTime>,
    /// When it was read.
    read_at: Instant,
    /// Some of its settings were written, and others perhaps not: also by another program, if they are not all read back.
    are_settings_half: bool,
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
        Self {
            bus,
            map,
            unit,
            scale,
            axis,
            seen: None,
            rest: None,
            jumped_from: None,
            seen_at: None,
            read_at: Instant::now(),
            are_settings_half: !map.settings.are_all_read(),
        }
    }

    /// The counts of the drive.
    pub fn health(&self) -> HealthMeter {
        self.bus.health(self.unit)
    }

    /// The axis with its limits.
    pub const fn axis(&self) -> &Axis<U> {
        &self.axis
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

    /// The position of the last reading, if it is plausible, and where the axis came to rest, so that a move may start from it.
    ///
    /// # Errors
    /// [`StageError::Unhomed`], [`StageError::BeyondTravel`], [`StageError::Moved`], [`StageError::NotIdentified`].
    pub fn trusted_position(&self) -> Result<Position<U>, StageError<U>> {
        let seen = self.seen.ok_or(StageError::NotIdentified)?;
        let (at, travel) = (self.scale.position(seen.position.into()), self.axis.travel());
        if !seen.is_homed {
            return Err(StageError::Unhomed { at });
        }
        if !self.axis.can_be_at(at) {
            return Err(StageError::BeyondTravel { at, travel });
        }
        self.left_its_rest().map_or(Ok(at), |was| Err(StageError::Moved { was, at }))
    }

    /// Where it came to rest, if the last reading has it at rest elsewhere.
    fn left_its_rest(&self) -> Option<Position<U>> {
        let (seen, rest) = (self.seen.filter(|seen| !seen.is_moving)?, self.rest?);
        let [was, at] = [rest, seen.position].map(|counts| self.scale.position(counts.into()));
        let is_elsewhere =
            REST_TOLERANCES * self.axis.tolerance() < (at.value() - was.value()).abs();
        is_elsewhere.then_some(was)
    }

    /// Whether it was read back elsewhere than where it came to rest, and was not homed since: the count of its drive may be
    /// wrong.
    pub const fn has_jumped(&self) -> bool {
        self.jumped_from.is_some()
    }

    /// Refuses an axis that [has jumped](Self::has_jumped).
    ///
    /// # Errors
    /// [`StageError::Moved`]; [`StageError::NotIdentified`].
    pub fn refuse_jump(&self) -> Result<(), StageError<U>> {
        let Some(was) = self.jumped_from else { return Ok(()) };
        let seen = self.seen.ok_or(StageError::NotIdentified)?;
        Err(StageError::Moved { was, at: self.scale.position(seen.position.into()) })
    }

    /// The last reading says where the axis is at rest.
    fn came_to_rest(&mut self) {
        self.jumped_from = self.jumped_from.or(self.left_its_rest());
        self.rest = self.seen.filter(|seen| !seen.is_moving).map(|seen| seen.position);
    }

    /// Sends an axis on. Until it has come to rest, nothing says where it is to be. A stop between two requests keeps the rest of
    /// them back.
    async fn send_on(
        &mut self,
        steps: &[Step],
        order: &Order,
        stop: &StopSignal,
    ) -> Result<(), StageError<U>> {
        self.rest = None;
        for (index, step) in steps.iter().enumerate() {
            if index > 0 && stop.is_raised() {
                return Err(self.stop_and_say().await?);
            }
            self.take(step, order, Priority::None).await?;
        }
        Ok(())
    }

    /// The count from which a move starts now.
    async fn start(&mut self) -> Result<i32, StageError<U>> {
        let known = self.seen.ok_or(StageError::NotIdentified)?;
        if RECENT < self.read_at.elapsed() {
            let now = self.read_drive().await?;
            let [was, at] = [known, now].map(|one| self.scale.position(one.position.into()));
            self.refuse_alarm(&now, at).await?;
            self.trusted_position()?;
            let limit = REST_TOLERANCES * self.axis.tolerance();
            let is_at_rest = !known.is_moving && !now.is_moving;
            if is_at_rest && limit < (at.value() - was.value()).abs() {
                return Err(StageError::Moved { was, at });
            }
            return Ok(now.position);
        }
        self.trusted_position()?;
        Ok(known.position)
    }

    /// Moves to a target and returns where the axis is, measured. Returns only when the drive has
    /// confirmed that it is at rest, at this target, without alarm.
    ///
    /// # Errors
    /// [`StageError::Stopped`] after a requested stop: the stop was sent and the axis is at rest.
    /// [`StageError::Alarmed`], [`StageError::EmergencyStopped`], [`StageError::Ignored`],
    /// [`StageError::NotThere`], [`StageError::Overdue`]. Nothing is sent from a position that is unknown or impossible:
    /// [`StageError::Unhomed`], [`StageError::BeyondTravel`], [`StageError::Moved`]. A move during which the drive loses its
    /// position ends at once: [`StageError::Unhomed`]. After [`StageError::Bus`] it is not known whether the axis moves.
    pub async fn move_to(
        &mut self,
        target: Target<U>,
        speed_per_s: f64,
        stop: &StopSignal,
    ) -> Result<Position<U>, StageError<U>> {
        let from = self.start().await?;
        let wanted = target.position();
        let order = Order::to(wanted, speed_per_s, self.map, &self.scale, &self.axis)?;
        if stop.is_raised() {
            return Err(self.stopped_at(from));
        }
        self.send_on(&self.map.start, &order, stop).await?;
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
        if stop.is_raised() {
            return Err(self.stop_and_say().await?);
        }
        self.send_on(&self.map.start, &order, stop).await?;
        self.follow(target, &order, seen.position, stop).await
    }

    /// Reads a drive that moves, at this moment: where it is, unless it is in alarm or was stopped meanwhile.
    async fn read_moving(
        &mut self,
        at: Instant,
        stop: &StopSignal,
    ) -> Result<(DriveReading, Position<U>), StageError<U>> {
        if !wait(at, stop).await {
            return Err(self.stop_and_say().await?);
        }
        let reading = self.read_drive().await?;
        let position = self.scale.position(reading.position.into());
        self.refuse_alarm(&reading, position).await?;
        Ok((reading, position))
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
        // A jog may begin without.
        let was_homed = self.seen.is_some_and(|seen| seen.is_homed);
        // Rest at another position counts only if it lasts.
        let mut still_since = None;
        loop {
            let (reading, at) = self.read_moving(next_reading_at, stop).await?;
            if was_homed {
                self.refuse_unhomed(&reading).await?;
            }
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
                self.came_to_rest();
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

    /// Stops with deceleration and returns the position of the axis.
    ///
    /// # Errors
    /// [`StageError::WillNotStop`], [`StageError::Bus`].
    pub async fn stop(&mut self) -> Result<Position<U>, StageError<U>> {
        let order = Order::at_rest(&self.scale, &self.axis)?;
        self.take_all_urgently(&order).await?;
        let started = Instant::now();
        let mut sent = started;
        let at = loop {
            let reading = self.read_drive().await?;
            let at = self.scale.position(reading.position.into());
            if !reading.is_moving {
                self.came_to_rest();
                break at;
            }
            let waited = started.elapsed();
            if STOP_WITHIN <= waited {
                let seconds = waited.as_secs_f64();
                return Err(StageError::WillNotStop { seconds, at });
            }
            if STOP_AGAIN <= sent.elapsed() {
                // What an adapter echoes may have been taken for the answer.
                self.take_all_urgently(&order).await?;
                sent = Instant::now();
            }
            sleep(READ_INTERVAL_MIN).await;
        };
        self.command(&self.map.release_stop).await?;
        Ok(at)
    }

    async fn take_all_urgently(&self, order: &Order) -> Result<(), StageError<U>> {
        for step in &self.map.stop {
            self.take(step, order, Priority::Urgent).await?;
        }
        Ok(())
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
                let took = self.bus.now().since(asked);
                self.seen_at = (took <= EXCHANGE_MAX).then(|| asked + took / 2);
            }
        }
        let reading = DriveReading::new(self.map, &replies);
        (self.seen, self.read_at) = (Some(reading), Instant::now());
        Ok(reading)
    }

    async fn alarm_of(&self, reading: &DriveReading) -> Result<Option<Alarm>, StageError<U>> {
        let Some(block) = reading.alarm_block else {
            return Ok(alarm(self.map, reading.alarm_code));
        };
        match self.ask(read_request(block)).await? {
            // The flag is set, also without a code.
            Reply::Words(words) => Ok(Some(alarm_of_code(self.map, words[0]))),
            Reply::Bits(_) | Reply::Written => unreachable!("a read is answered by words"),
        }
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

    /// Ends the move of a drive that has lost its position.
    async fn refuse_unhomed(&mut self, reading: &DriveReading) -> Result<(), StageError<U>> {
        if reading.is_homed {
            return Ok(());
        }
        let at = if reading.is_moving {
            self.stop().await?
        } else {
            self.scale.position(reading.position.into())
        };
        Err(StageError::Unhomed { at })
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
