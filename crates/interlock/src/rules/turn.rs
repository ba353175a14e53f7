//! The sample turns only under a probe that was read back above everything that it reaches on the way, not
//! long ago, with no command to the linear stage since.
//!
//! ```text
//!   clear position ───────────────────────────   every turn, and homing
//!   its height     ── ── ── ── ── ── ── ── ──   this turn
//!                      room, read-back
//!   highest edge   ───────────────────────────   of the largest sample, at every tilt on the way
//! ```

use std::time::Duration;

use rig_model::{Deg, Mm, Position, RigLimits, RigTime};

use crate::{Outcome, PortCommand, Refusal};

/// How old the read-back may be. A hand or a slipping brake moves the stage within minutes.
const FRESH: Duration = Duration::from_secs(60);

/// Room above the highest edge, for a stage that has lost steps, mm.
const ROOM_MM: f64 = 0.5;

/// Rounding of a target to the steps of a drive, mm.
const ROUNDING_MM: f64 = 1e-6;

/// ```text
///            a command to the linear stage
///   ┌──────┐ ──────────────────────────▶ ┌──────────┐
///   │ Read │                             │ In doubt │
///   └──────┘ ◀────────────────────────── └──────────┘
///            its read-back
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Turn {
    limits: RigLimits,
    /// The linear stage as last read back, and when; `None` when in doubt.
    linear: Option<(Position<Mm>, RigTime)>,
    /// The rotary stage as last read back; `None` while it turns.
    tilt: Option<Position<Deg>>,
}

impl Turn {
    /// In doubt.
    pub const fn new(limits: RigLimits) -> Self {
        Self { limits, linear: None, tilt: None }
    }

    /// Whether a turn needs the probe to be read back again, and nothing else.
    pub fn needs_reading(&self, now: RigTime, command: &PortCommand) -> bool {
        self.linear.is_some_and(|(at, read)| {
            FRESH < now.since(read) && self.lowest_mm(command).is_some_and(|mm| mm <= at.value())
        })
    }

    pub(crate) fn admit(&self, now: RigTime, command: &PortCommand) -> Result<(), Refusal> {
        let what = command.name();
        let Some(lowest_mm) = self.lowest_mm(command) else { return Ok(()) };
        let (at, read) = self.linear.ok_or(Refusal::NotClear { what })?;
        let is_clear = lowest_mm <= at.value();
        if !is_clear {
            return Err(Refusal::NotClear { what });
        }
        let age = now.since(read);
        if FRESH < age {
            let (age_s, limit_s) = (age.as_secs_f64(), FRESH.as_secs_f64());
            return Err(Refusal::ClearIsOld { what, age_s, limit_s });
        }
        Ok(())
    }

    /// The lowest read-back of the linear stage at which the sample may turn, mm; `None` for other commands.
    fn lowest_mm(&self, command: &PortCommand) -> Option<f64> {
        let rest_mm = self.limits.linear.rest_target().position().value();
        let clear_mm = match *command {
            PortCommand::MoveRotary { to, .. } => self
                .tilt
                .map_or(rest_mm, |from| rest_mm.min(self.highest_edge_mm(from, to) + ROOM_MM)),
            PortCommand::HomeRotary => rest_mm,
            _ => return None,
        };
        Some(clear_mm - self.limits.linear.tolerance() - ROUNDING_MM)
    }

    /// The highest place that the edges of the largest sample pass between two tilts. The stage stands within
    /// its tolerance of where it was read back, and within twice that of a target.
    ///
    /// An edge is `height` above the pivot and `half_width` beside it, and rises to `height cos t +
    /// half_width sin t`: highest where the edge is above the pivot, or at the end of the turn.
    fn highest_edge_mm(&self, from: Position<Deg>, to: Position<Deg>) -> f64 {
        let geometry = &self.limits.geometry;
        let height = geometry.surface_above_pivot_mm + geometry.surface_tolerance_mm;
        let half_width = geometry.sample_half_width_mm;
        let (from, to, tolerance) = (from.value(), to.value(), self.limits.rotary.tolerance());
        let low = (from - tolerance).min(to - 2.0 * tolerance);
        let high = (from + tolerance).max(to + 2.0 * tolerance);
        let summit = half_width.atan2(height).to_degrees();
        let tilts = [low, high, (-summit).clamp(low, high), summit.clamp(low, high)];
        let rise = |tilt: f64| {
            let (sin, cos) = tilt.to_radians().sin_cos();
            height * cos + half_width * sin.abs()
        };
        let highest = tilts.into_iter().map(rise).fold(f64::NEG_INFINITY, f64::max);
        geometry.surface.value() - geometry.surface_above_pivot_mm + highest
    }

    pub(crate) fn begun(&mut self, command: &PortCommand) {
        if command.is_linear() {
            self.linear = None;
        }
        if command.is_turn() {
            self.tilt = None;
        }
    }

    /// The end of a command, or a reading of an axis without a command.
    pub(crate) fn read(&mut self, now: RigTime, outcome: &Outcome) {
        match outcome {
            Outcome::LinearAt(at) => self.linear = Some((*at, now)),
            Outcome::RotaryAt(at) => self.tilt = Some(*at),
            Outcome::Done | Outcome::Interrupted | Outcome::Failed => {}
        }
    }

    /// Whether the probe was read back at the clear position or above, however long ago.
    pub(crate) fn is_clear(&self) -> bool {
        let limits = &self.limits.linear;
        let lowest = limits.rest_target().position().offset(-limits.tolerance());
        self.linear.is_some_and(|(at, _)| lowest <= at)
    }
}
