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

impl<U: Unit> Stage<U> {
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
        self.home_within(stop, if is_upwards { self.axis.tolerance() } else { f64::INFINITY }).await
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
        let order = Order::at_rest(&self.scale, &self.axis)?;
        self.send_on(&self.map.home, &order, stop).await?;
        let started = Instant::now();
        let mut next_reading_at = started + self.start_within();
        loop {
            let (reading, at) = self.read_moving(next_reading_at, stop).await?;
            let now = Instant::now();
            if !reading.is_moving {
                if !reading.is_homed {
                    return Err(StageError::NotHomed { at });
                }
                self.came_to_rest();
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
