//! An even way down, which a stop ends at any time.

use std::{pin::pin, time::Duration};

use rig_link::StopSignal;
use rig_model::{Position, RigTime, Target, Unit};
use tokio::time::{Instant, sleep};

use super::{MOVE_SLACK, Stage, wait};
use crate::{BusError, LineFault, StageError, drive_reading::DriveReading, order::Order};

/// The time between two readings of an axis that goes down evenly: a dozen of them know its way to a micrometre.
const READ_INTERVAL_DESCENT: Duration = Duration::from_millis(25);
/// A stop waits for the readings of the drive that are under way, which take less than this if no answer is lost.
const STOP_WAITS: Duration = Duration::from_millis(60);

impl<U: Unit> Stage<U> {
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
        let from = self.start().await?;
        let order = Order::to(target.position(), speed_per_s, self.map, &self.scale, &self.axis)?;
        let mut way = Vec::new();
        if stop.is_raised() {
            return Ok((self.scale.position(from.into()), way));
        }
        match self.send_on(&self.map.start, &order, stop).await {
            Err(StageError::Stopped { at }) => return Ok((at, way)),
            sent => sent?,
        }
        let started = Instant::now();
        let deadline = started + order.duration_from(from).saturating_mul(2) + MOVE_SLACK;
        loop {
            if !wait(Instant::now() + READ_INTERVAL_DESCENT, stop).await {
                return Ok((self.stop().await?, way));
            }
            let reading = match self.read_on_the_way(stop).await {
                Ok(reading) => reading,
                // The frames of a stop have left between the two.
                Err(StageError::Bus(BusError::Failed(LineFault::Halted { .. }))) => {
                    return Ok((self.stop().await?, way));
                }
                // Whether the drive answers again, the stop finds out.
                Err(StageError::Bus(_)) if stop.is_raised() => {
                    return Ok((self.stop().await?, way));
                }
                Err(error) => return Err(error),
            };
            let at = self.scale.position(reading.position.into());
            self.refuse_alarm(&reading, at).await?;
            self.refuse_unhomed(&reading).await?;
            if reading.is_moving {
                way.extend(self.seen_at.map(|seen_at| (seen_at, at)));
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

    /// Reads the drive. If the answer is not there soon after a stop was raised, the frames of the stop leave between two
    /// attempts.
    async fn read_on_the_way(&mut self, stop: &StopSignal) -> Result<DriveReading, StageError<U>> {
        let (bus, frames) = (self.bus.clone(), self.halt_frames()?);
        let mut read = pin!(self.read_drive());
        let late = async {
            stop.raised().await;
            sleep(STOP_WAITS).await;
        };
        tokio::select! {
            biased;
            reading = &mut read => return reading,
            () = late => drop(bus.halt(frames)),
        }
        read.await
    }
}
