//! One axis: what it is asked, and what the drive confirms.

use std::time::Duration;

use rig_link::StopSignal;
use rig_model::{Axis, Position, Target, Unit};
use tokio::time::{Instant, sleep, sleep_until};

use crate::{
    AxisStatus, BusError, BusHandle, LineFault, RegisterMap, Reply, Request, Scale, StageError,
    line::Canary,
    look::{Look, read_request},
    map::Step,
    order::{Deed, Order},
};

/// The least and the longest pause between two looks at a moving axis.
const POLL_MIN: Duration = Duration::from_millis(10);
const POLL_MAX: Duration = Duration::from_millis(250);

/// A move may take twice as long as computed, and this much on top, before it is stopped.
const MOVE_SLACK: Duration = Duration::from_secs(2);

/// How long a measured position may take to settle into the tolerance after the motion has ended.
const SETTLE_WITHIN: Duration = Duration::from_millis(500);

/// How long a stop may take.
const STOP_WITHIN: Duration = Duration::from_secs(3);

/// How long homing may take.
const HOME_WITHIN: Duration = Duration::from_secs(120);

/// How long a drive may take to clear its alarm.
const RESET_WITHIN: Duration = Duration::from_secs(2);

/// One axis on a bus.
#[derive(Debug)]
pub struct Stage<U: Unit> {
    bus: BusHandle,
    map: &'static RegisterMap,
    unit: u8,
    scale: Scale<U>,
    axis: Axis<U>,
    /// The position read last, in counts. None until the drive was identified.
    counts: Option<i32>,
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
        Self { bus, map, unit, scale, axis, counts: None }
    }

    /// The axis.
    pub const fn axis(&self) -> &Axis<U> {
        &self.axis
    }

    /// Finds the drive, puts the soft limits of the axis into it, reads them back, and looks at
    /// it. From then on it is recognised by these limits after each fault of the line.
    ///
    /// # Errors
    /// [`StageError::Bus`] when it does not answer, refuses, or keeps other limits than it was
    /// given.
    pub async fn identify(&mut self) -> Result<AxisStatus<U>, StageError<U>> {
        let order = Order::at_rest(&self.scale, &self.axis)?;
        // A drive that was switched off has forgotten by what it was recognised.
        self.bus.set_canary(self.unit, None).await.map_err(|error| self.bus_error(error))?;
        let limits = self.map.limits;
        let request = read_request(limits.read);
        let expected = Reply::Words(order.words(limits.slots));
        if self.ask(request.clone()).await? != expected {
            let (address, slots) = (limits.read.address, limits.slots);
            self.take(Step::Registers { address, slots }, &order).await?;
            if self.ask(request.clone()).await? != expected {
                let (port, unit) = (self.bus.name().clone(), self.unit);
                let fault = LineFault::Changed { port, unit, request };
                return Err(self.bus_error(fault.into()));
            }
        }
        let canary = Some(Canary { request, expected });
        self.bus.set_canary(self.unit, canary).await.map_err(|error| self.bus_error(error))?;
        self.status().await
    }

    /// Looks at the drive.
    ///
    /// # Errors
    /// [`StageError::Bus`].
    pub async fn status(&mut self) -> Result<AxisStatus<U>, StageError<U>> {
        let look = self.look().await?;
        Ok(AxisStatus {
            at: self.bus.now(),
            position: self.scale.position(look.position),
            target: self.scale.position(look.target),
            is_moving: look.is_moving,
            is_ready: look.is_ready,
            is_homed: look.is_homed,
            alarm: look.alarm,
        })
    }

    /// Moves to a target and returns where the axis is, measured. Returns only when the drive has
    /// confirmed that it stands still, at this target, without alarm.
    ///
    /// # Errors
    /// [`StageError::Stopped`] when a stop was asked for: the stop was sent and the axis stands.
    /// [`StageError::Alarmed`], [`StageError::Ignored`], [`StageError::NotThere`],
    /// [`StageError::Overdue`]. After [`StageError::Bus`] it is not known whether the axis moves.
    pub async fn move_to(
        &mut self,
        target: Target<U>,
        speed_per_s: f64,
        stop: &StopSignal,
    ) -> Result<Position<U>, StageError<U>> {
        let from = self.counts.ok_or(StageError::NotIdentified { axis: self.axis.name() })?;
        let wanted = target.position();
        let order = Order::to(wanted, speed_per_s, self.map, &self.scale, &self.axis)?;
        if stop.is_raised() {
            return Err(self.stopped_at(from));
        }
        self.take_all(self.map.start, &order).await?;
        self.follow(target, &order, order.duration_from(from), stop).await
    }

    /// Waits for the end of a move, with as few looks as its computed duration allows.
    async fn follow(
        &mut self,
        target: Target<U>,
        order: &Order,
        expected: Duration,
        stop: &StopSignal,
    ) -> Result<Position<U>, StageError<U>> {
        let started = Instant::now();
        let shows_by = started + self.start_within();
        let deadline = started + expected.saturating_mul(2) + MOVE_SLACK;
        let mut next_look = started + expected.max(POLL_MIN);
        let mut settled_by = None;
        loop {
            if !wait(next_look, stop).await {
                return Err(self.stop_and_say().await?);
            }
            let look = self.look().await?;
            let (axis, at) = (self.axis.name(), self.scale.position(look.position));
            if let Some(alarm) = look.alarm {
                return Err(StageError::Alarmed { axis, alarm, at });
            }
            let now = Instant::now();
            let wanted = target.position();
            if look.is_moving {
                if deadline <= now {
                    return Err(self.overdue("move", now - started).await?);
                }
                next_look = now + order.rest_from(look.position).clamp(POLL_MIN, POLL_MAX);
            } else if look.target != order.target {
                if shows_by <= now {
                    let hint = self.map.ignored_hint;
                    return Err(StageError::Ignored { axis, wanted, at, hint });
                }
                next_look = now + POLL_MIN;
            } else if self.axis.is_at(at, target) {
                return Ok(at);
            } else {
                if *settled_by.get_or_insert(now + SETTLE_WITHIN) <= now {
                    let off = (at.value() - wanted.value()).abs();
                    return Err(StageError::NotThere { axis, wanted, at, off });
                }
                next_look = now + POLL_MIN;
            }
        }
    }

    /// Lets the drive find its zero. May move over the whole travel.
    ///
    /// # Errors
    /// As [`move_to`](Self::move_to), and [`StageError::NotHomed`].
    pub async fn home(&mut self, stop: &StopSignal) -> Result<Position<U>, StageError<U>> {
        let from = self.counts.ok_or(StageError::NotIdentified { axis: self.axis.name() })?;
        if stop.is_raised() {
            return Err(self.stopped_at(from));
        }
        self.command(self.map.home).await?;
        let started = Instant::now();
        let shows_by = started + self.start_within();
        let mut next_look = shows_by;
        loop {
            if !wait(next_look, stop).await {
                return Err(self.stop_and_say().await?);
            }
            let look = self.look().await?;
            let (axis, at) = (self.axis.name(), self.scale.position(look.position));
            if let Some(alarm) = look.alarm {
                return Err(StageError::Alarmed { axis, alarm, at });
            }
            let now = Instant::now();
            if !look.is_moving {
                return if look.is_homed { Ok(at) } else { Err(StageError::NotHomed { axis, at }) };
            }
            if started + HOME_WITHIN <= now {
                return Err(self.overdue("homing", now - started).await?);
            }
            next_look = now + POLL_MAX;
        }
    }

    /// Stops with deceleration and returns where the axis then stands.
    ///
    /// # Errors
    /// [`StageError::WillNotStop`], [`StageError::Bus`].
    pub async fn stop(&mut self) -> Result<Position<U>, StageError<U>> {
        self.command(self.map.stop).await?;
        let started = Instant::now();
        let at = loop {
            let look = self.look().await?;
            let at = self.scale.position(look.position);
            if !look.is_moving {
                break at;
            }
            let waited = started.elapsed();
            if STOP_WITHIN <= waited {
                let (axis, seconds) = (self.axis.name(), waited.as_secs_f64());
                return Err(StageError::WillNotStop { axis, seconds, at });
            }
            sleep(POLL_MIN).await;
        };
        self.command(self.map.release_stop).await?;
        Ok(at)
    }

    /// Clears an alarm. Clearing does not move anything.
    ///
    /// # Errors
    /// [`StageError::AlarmPersists`], [`StageError::Bus`].
    pub async fn reset_alarm(&mut self) -> Result<AxisStatus<U>, StageError<U>> {
        self.command(self.map.reset).await?;
        let give_up = Instant::now() + RESET_WITHIN;
        loop {
            let status = self.status().await?;
            match status.alarm {
                None => return Ok(status),
                Some(alarm) if give_up <= Instant::now() => {
                    return Err(StageError::AlarmPersists { axis: self.axis.name(), alarm });
                }
                Some(_) => sleep(POLL_MIN).await,
            }
        }
    }

    /// Stops and returns the error that says so.
    async fn stop_and_say(&mut self) -> Result<StageError<U>, StageError<U>> {
        let at = self.stop().await?;
        Ok(StageError::Stopped { axis: self.axis.name(), at })
    }

    async fn overdue(
        &mut self,
        doing: &'static str,
        waited: Duration,
    ) -> Result<StageError<U>, StageError<U>> {
        let at = self.stop().await?;
        let (axis, seconds) = (self.axis.name(), waited.as_secs_f64());
        Ok(StageError::Overdue { axis, doing, seconds, at })
    }

    fn stopped_at(&self, counts: i32) -> StageError<U> {
        StageError::Stopped { axis: self.axis.name(), at: self.scale.position(counts) }
    }

    fn start_within(&self) -> Duration {
        Duration::from_millis(self.map.start_within_ms.into())
    }

    /// Carries out a command that is not a move.
    async fn command(&self, steps: &[Step]) -> Result<(), StageError<U>> {
        self.take_all(steps, &Order::at_rest(&self.scale, &self.axis)?).await
    }

    async fn take_all(&self, steps: &[Step], order: &Order) -> Result<(), StageError<U>> {
        for &step in steps {
            self.take(step, order).await?;
        }
        Ok(())
    }

    async fn take(&self, step: Step, order: &Order) -> Result<(), StageError<U>> {
        match order.deed(step) {
            Deed::Ask(request) => self.ask(request).await.map(drop),
            Deed::Wait(duration) => {
                sleep(duration).await;
                Ok(())
            }
        }
    }

    async fn look(&mut self) -> Result<Look, StageError<U>> {
        let mut replies = Vec::with_capacity(self.map.status.len());
        for &block in self.map.status {
            replies.push(self.ask(read_request(block)).await?);
        }
        let look = Look::new(self.map, &replies);
        self.counts = Some(look.position);
        Ok(look)
    }

    async fn ask(&self, request: Request) -> Result<Reply, StageError<U>> {
        self.bus.request(self.unit, request).await.map_err(|error| self.bus_error(error))
    }

    fn bus_error(&self, source: BusError) -> StageError<U> {
        StageError::Bus { axis: self.axis.name(), source }
    }
}

/// Waits until an instant and returns whether it came before the stop.
async fn wait(until: Instant, stop: &StopSignal) -> bool {
    tokio::select! {
        biased;
        () = stop.raised() => false,
        () = sleep_until(until) => true,
    }
}
