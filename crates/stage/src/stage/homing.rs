//! Homing: the drive finds its zero by itself.

use std::time::Duration;

use rig_link::StopSignal;
use rig_model::{Position, Unit};
use tokio::time::Instant;

use super::{READ_INTERVAL_MIN, Stage};
use crate::{StageError, order::Order};

/// The time between two readings of an axis that homes: the duration of homing is unknown.
const READ_INTERVAL_HOMING: Duration = Duration::from_millis(250);

/// Time limit of homing.
const HOME_WITHIN: Duration = Duration::from_secs(120);

/// Time within which a homing of an axis that is homed already must show.
const SHOWS_WITHIN: Duration = Duration::from_secs(2);

impl<U: Unit> Stage<U> {
    /// Lets the drive find its zero. May move over the whole travel.
    ///
    /// A drive that says that it is homed, and goes on saying so without a motion, has not been homed unless it stands ready at its
    /// zero: one whose stop input or servo is off acknowledges the command and does nothing.
    ///
    /// # Errors
    /// As [`move_to`](Self::move_to), [`StageError::NotHomed`], and [`StageError::HomingUnseen`].
    pub async fn home(&mut self, stop: &StopSignal) -> Result<Position<U>, StageError<U>> {
        let was_homed = self.seen.is_some_and(|seen| seen.is_homed);
        let unseen_within = if was_homed { SHOWS_WITHIN } else { Duration::ZERO };
        self.home_within(stop, f64::INFINITY, unseen_within).await
    }

    /// The same, for an axis that may only rise while it homes: as soon as a reading shows that it
    /// sinks, it is stopped.
    ///
    /// # Errors
    /// As [`home`](Self::home), and [`StageError::HomesDownwards`].
    pub async fn home_upwards(&mut self, stop: &StopSignal) -> Result<Position<U>, StageError<U>> {
        self.home_within(stop, self.axis.tolerance(), Duration::ZERO).await
    }

    /// Homes an axis that is commissioned, whose drive gets no settings. With `is_upwards`, it is stopped as soon as a reading
    /// shows that it sinks.
    ///
    /// # Errors
    /// As [`home_upwards`](Self::home_upwards), and [`StageError::Alarmed`] before anything moves.
    pub async fn home_unproven(
        &mut self,
        is_upwards: bool,
        stop: &StopSignal,
    ) -> Result<Position<U>, StageError<U>> {
        let seen = self.read_drive().await?;
        self.refuse_alarm(&seen, self.scale.position(seen.position.into())).await?;
        self.command(&self.map.prepare).await?;
        let sinks_most = if is_upwards { self.axis.tolerance() } else { f64::INFINITY };
        self.home_within(stop, sinks_most, Duration::ZERO).await
    }

    /// Homes, and stops if the axis sinks further than `sinks_most`. Unless `unseen_within` is zero, the homing must show within that
    /// time.
    async fn home_within(
        &mut self,
        stop: &StopSignal,
        sinks_most: f64,
        unseen_within: Duration,
    ) -> Result<Position<U>, StageError<U>> {
        let from = self.seen.ok_or(StageError::NotIdentified)?;
        if stop.is_raised() {
            return Err(self.stopped_at(from.position));
        }
        let started_at = self.scale.position(from.position.into()).value();
        let order = Order::at_rest(&self.scale, &self.axis)?;
        self.send_on(&self.map.home, &order, stop).await?;
        let started = Instant::now();
        let mut next_reading_at =
            started + if unseen_within.is_zero() { self.start_within() } else { READ_INTERVAL_MIN };
        let mut is_seen = unseen_within.is_zero();
        loop {
            let (reading, at) = self.read_moving(next_reading_at, stop).await?;
            let now = Instant::now();
            let is_elsewhere = (at.value() - started_at).abs() > self.axis.tolerance();
            is_seen |= reading.is_moving || !reading.is_homed || is_elsewhere;
            if !is_seen && started + unseen_within <= now {
                // One that stands at its zero need not move, as after a homing whose end was not heard.
                let off_zero = (at.value() - self.scale.position(0).value()).abs();
                if reading.is_ready && off_zero <= self.axis.tolerance() {
                    is_seen = true;
                    continue;
                }
                return Err(StageError::HomingUnseen { at, hint: &self.map.ignored_hint });
            }
            if !is_seen || !reading.is_moving && now < started + self.start_within() {
                next_reading_at = now + READ_INTERVAL_MIN;
                continue;
            }
            if !reading.is_moving {
                if !reading.is_homed {
                    return Err(StageError::NotHomed { at });
                }
                self.came_to_rest();
                self.jumped_from = None;
                return Ok(at);
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
}
