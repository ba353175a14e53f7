//! How deep, how fast and in which steps the probe may go, from the geometry of the bench alone.
//!
//! ```text
//!   clear position ───────────────────────────
//!                      any allowed speed
//!   highest surface ── ── ── ── ── ── ── ── ──   expected surface + tolerance
//!                      contact speed, short steps
//!   floor ────────────────────────────────────   expected surface − tolerance − deepest indentation
//! ```

use std::time::Duration;

use rig_model::{Deg, Mm, Position, RigLimits, RigTime};

use crate::{Outcome, PortCommand, Refusal};

/// Rounding of a target to the steps of a drive, mm.
const ROUNDING_MM: f64 = 1e-6;

/// How old the read-back of the tilt may be, on which the floor rests. A hand turns the stage within minutes.
const FRESH: Duration = Duration::from_secs(60);

/// Floor, speeds and steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Depth {
    limits: RigLimits,
    /// The last read-back of the linear stage.
    linear_mm: Option<f64>,
    /// The last read-back of the rotary stage, and when; `None` while it turns.
    tilt: Option<(Position<Deg>, RigTime)>,
}

impl Depth {
    /// Neither axis has been read back.
    pub const fn new(limits: RigLimits) -> Self {
        Self { limits, linear_mm: None, tilt: None }
    }

    /// Whether a way down needs the tilt to be read back again.
    pub(crate) fn needs_tilt(&self, now: RigTime, command: &PortCommand) -> bool {
        let rest = self.limits.linear.rest_target().position();
        let is_down = match *command {
            PortCommand::MoveLinear { to, .. } => to < rest,
            PortCommand::Descend { .. } => true,
            _ => false,
        };
        is_down && self.tilt.is_some_and(|(_, read)| FRESH < now.since(read))
    }

    pub(crate) fn admit(&self, now: RigTime, command: &PortCommand) -> Result<(), Refusal> {
        let motion = &self.limits.motion;
        let what = command.name();
        match *command {
            PortCommand::MoveRotary { speed_deg_per_s, .. } => {
                let limit = motion.rotary_speed_deg_per_s;
                refuse_speed(what, speed_deg_per_s, limit, "°")
            }
            PortCommand::MoveLinear { to, speed_mm_per_s } => {
                refuse_speed(what, speed_mm_per_s, motion.travel_speed_mm_per_s, "mm")?;
                if self.limits.linear.rest_target().position() <= to {
                    return Ok(());
                }
                self.admit_lowering(now, what, to, speed_mm_per_s)
            }
            // Slow from its beginning: it is watched by readings that may come late.
            PortCommand::Descend { to, speed_mm_per_s } => {
                refuse_speed(what, speed_mm_per_s, motion.contact_speed_mm_per_s, "mm")?;
                self.admit_lowering(now, what, to, speed_mm_per_s)
            }
            _ => Ok(()),
        }
    }

    fn admit_lowering(
        &self,
        now: RigTime,
        what: &'static str,
        to: Position<Mm>,
        speed_mm_per_s: f64,
    ) -> Result<(), Refusal> {
        let (geometry, motion) = (&self.limits.geometry, &self.limits.motion);
        let not_read = |axis| Refusal::NotIdentified { what, axis };
        let (tilt, read) = self.tilt.ok_or_else(|| not_read("rotary stage"))?;
        let age = now.since(read);
        if FRESH < age {
            let (age_s, limit_s) = (age.as_secs_f64(), FRESH.as_secs_f64());
            return Err(Refusal::TiltIsOld { what, age_s, limit_s });
        }
        let from_mm = self.linear_mm.ok_or_else(|| not_read("linear stage"))?;
        // The tolerance is measured along the normal of a tilted surface.
        let tolerance_mm = geometry.surface_tolerance_mm / tilt.value().to_radians().cos().max(0.1);
        let expected = self.expected_surface(tilt);
        let deepest_mm = tolerance_mm + motion.max_indentation_mm;
        let floor = expected.offset(-deepest_mm);
        let is_above_floor = floor.value() - ROUNDING_MM <= to.value();
        if !is_above_floor {
            return Err(Refusal::BelowFloor { to, tilt, floor });
        }
        let highest_mm = expected.offset(tolerance_mm).value();
        if highest_mm - ROUNDING_MM <= to.value() {
            return Ok(());
        }
        let step_mm = from_mm.min(highest_mm) - to.value();
        let limit_mm = deepest_mm;
        if limit_mm + ROUNDING_MM < step_mm {
            return Err(Refusal::StepTooLong { to, step_mm, limit_mm });
        }
        if 0.0 < step_mm {
            refuse_speed(what, speed_mm_per_s, motion.contact_speed_mm_per_s, "mm")?;
        }
        Ok(())
    }

    /// Whether a move of the linear stage leads up or nowhere, as far as its position is known.
    pub(crate) fn is_up(&self, command: &PortCommand) -> bool {
        let PortCommand::MoveLinear { to, .. } = command else { return false };
        let tolerance_mm = self.limits.linear.tolerance();
        self.linear_mm.is_none_or(|from_mm| from_mm <= to.value() + tolerance_mm)
    }

    /// The linear position at which the tip touches a sample of nominal height. A ball of radius r
    /// beside the pivot by x touches the plane x sin α + z cos α = d when its centre fulfils it for
    /// d + r. In place of the plane a pin of radius ρ may lie with its top there: in the frame of the sample its axis is at
    /// (x, d − ρ), and the centre of the ball on the vertical line of the probe is ρ + r from it.
    fn expected_surface(&self, tilt: Position<Deg>) -> Position<Mm> {
        let geometry = &self.limits.geometry;
        let (d, r) = (geometry.surface_above_pivot_mm, geometry.probe_radius_mm);
        let (sin, cos) = tilt.value().to_radians().sin_cos();
        let x = geometry.probe_beside_pivot_mm;
        let centre_mm = match geometry.pin_radius_mm {
            None => (d + r - x * sin) / cos,
            Some(pin_mm) => {
                // The foot of the perpendicular from the axis of the pin to that line, and its distance.
                let foot_mm = (d - pin_mm) * cos - x * sin;
                let off_mm = (d - pin_mm) * sin - x * (1.0 - cos);
                foot_mm + ((r + pin_mm).powi(2) - off_mm.powi(2)).max(0.0).sqrt()
            }
        };
        geometry.surface.offset(centre_mm - r - d)
    }

    pub(crate) fn begun(&mut self, command: &PortCommand) {
        if command.is_turn() {
            self.tilt = None;
        }
        if command.is_linear() {
            self.linear_mm = None;
        }
    }

    pub(crate) fn read(&mut self, now: RigTime, outcome: &Outcome) {
        match outcome {
            Outcome::LinearAt(at) => self.linear_mm = Some(at.value()),
            Outcome::RotaryAt(at) => self.tilt = Some((*at, now)),
            Outcome::Done | Outcome::Interrupted | Outcome::Failed => {}
        }
    }
}

fn refuse_speed(
    what: &'static str,
    asked: f64,
    limit: f64,
    unit: &'static str,
) -> Result<(), Refusal> {
    // A speed that is not a number is refused too.
    if 0.0 < asked && asked <= limit * (1.0 + 1e-9) {
        return Ok(());
    }
    Err(Refusal::TooFast { what, asked, limit, unit })
}
