//! Before signs and scales of the drives are shown, only a short step of one axis is admitted, and each step
//! needs the word of a person that nothing is below the probe. While the scale is not shown, a step may be longer than
//! its drive says: a longer one is admitted only after a gauge has shown that a shorter one was as long as that. A drive that
//! does not know where its axis is has no position against which a long step could be judged.

use std::time::Duration;

use rig_model::{Deg, Mm, Position, RigLimits, RigTime, Span, Unit};

use crate::{PortCommand, Refusal};

/// How long the word of a person holds: a sample is placed within minutes.
const FRESH: Duration = Duration::from_secs(60);

/// Steps while nothing is shown, after signs and scales are shown, and their highest speed.
const LINEAR: Bounds = Bounds { first: 0.2, most: 10.0, speed_per_s: 1.0, unit: "mm" };
const ROTARY: Bounds = Bounds { first: 1.0, most: 31.0, speed_per_s: 5.0, unit: "°" };

/// How many times as long as a step that a gauge has shown the next one may be.
const GROWTH: f64 = 10.0;

/// How far beyond its travel an axis may step to be stopped by its limit, mm and degrees: never towards the table.
const BEYOND_MM: f64 = 1.0;
const BEYOND_DEG: f64 = 3.0;

/// Rounding of a step to the counts of a drive, in units of the axis.
const ROUNDING: f64 = 1e-6;

/// What calibrations show of the drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Proven {
    /// Nothing: a sign or a scale may be wrong.
    Nothing,
    /// Stop and signs: a step goes in the direction that is asked.
    Signs,
    /// The scales too: a step is as long as is asked.
    Scales,
    /// All that motion rests on.
    Bench,
}

#[derive(Debug, Clone, Copy)]
struct Bounds {
    first: f64,
    most: f64,
    speed_per_s: f64,
    unit: &'static str,
}

/// The steps of an axis, in its unit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Steps {
    /// The last one that was admitted.
    last: f64,
    /// The longest one that a gauge has shown.
    seen: f64,
}

impl Steps {
    const fn seen(&mut self) {
        self.seen = self.seen.max(self.last);
        self.last = 0.0;
    }
}

/// ```text
///              a person states that nothing is below the probe
///   ┌────────┐ ──────────────────────────────────────────────▶ ┌────────┐
///   │ Closed │                                                 │ Stated │   one step
///   └────────┘ ◀────────────────────────────────────────────── └────────┘
///              a step, a stop, or 60 s later
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Commission {
    proven: Proven,
    stated_at: Option<RigTime>,
    linear: Span<Mm>,
    rotary: Span<Deg>,
    /// The lower soft limit of the linear stage, which protects table and sample.
    lowest: Position<Mm>,
    linear_steps: Steps,
    rotary_steps: Steps,
}

impl Commission {
    /// Nobody has stated anything.
    pub const fn new(limits: &RigLimits, proven: Proven) -> Self {
        let (linear, rotary) = (limits.linear.travel(), limits.rotary.travel());
        let none = Steps { last: 0.0, seen: 0.0 };
        Self {
            proven,
            stated_at: None,
            linear,
            rotary,
            lowest: limits.linear.soft().min,
            linear_steps: none,
            rotary_steps: none,
        }
    }

    pub(crate) const fn prove(&mut self, proven: Proven) {
        self.proven = proven;
    }

    pub(crate) const fn stated(&mut self, now: RigTime) {
        self.stated_at = Some(now);
    }

    pub(crate) const fn linear_seen(&mut self) {
        self.linear_steps.seen();
    }

    pub(crate) const fn rotary_seen(&mut self) {
        self.rotary_steps.seen();
    }

    pub(crate) const fn withdrawn(&mut self) {
        self.stated_at = None;
    }

    pub(crate) fn admit(&self, now: RigTime, command: &PortCommand) -> Result<(), Refusal> {
        let what = command.name();
        match *command {
            PortCommand::Stop | PortCommand::Measure => Ok(()),
            PortCommand::JogLinear { from, is_homed, by_mm, speed_mm_per_s } => {
                let step = (by_mm, speed_mm_per_s, is_homed);
                self.admit_step(now, what, (&LINEAR, self.linear_steps), step)?;
                let Span { min, max } = self.linear;
                let beyond = Span::new(min.value(), max.value() + BEYOND_MM);
                self.stay_inside(what, from.offset(by_mm), self.linear, beyond)?;
                self.stay_above(what, from, by_mm)
            }
            PortCommand::JogRotary { from, is_homed, by_deg, speed_deg_per_s } => {
                let step = (by_deg, speed_deg_per_s, is_homed);
                self.admit_step(now, what, (&ROTARY, self.rotary_steps), step)?;
                let Span { min, max } = self.rotary;
                let beyond = Span::new(min.value() - BEYOND_DEG, max.value() + BEYOND_DEG);
                self.stay_inside(what, from.offset(by_deg), self.rotary, beyond)
            }
            PortCommand::ClearLinear | PortCommand::ClearRotary => self.admit_scaled(what),
            PortCommand::SeekLinear | PortCommand::SeekRotary => {
                self.admit_scaled(what)?;
                self.is_stated(now, what)
            }
            _ if self.proven == Proven::Bench => Ok(()),
            _ => Err(Refusal::NotCommissioned { what }),
        }
    }

    fn admit_step(
        &self,
        now: RigTime,
        what: &'static str,
        (bounds, steps): (&Bounds, Steps),
        (by, speed_per_s, is_homed): (f64, f64, bool),
    ) -> Result<(), Refusal> {
        let Bounds { first, most, speed_per_s: limit_per_s, unit } = *bounds;
        let limit = match self.proven {
            Proven::Nothing => first,
            Proven::Signs => (GROWTH * steps.seen).clamp(first, most),
            Proven::Scales => most,
            Proven::Bench => return Err(Refusal::Commissioned { what }),
        };
        self.is_stated(now, what)?;
        // NaN is refused too.
        let is_short = by.abs() <= limit + ROUNDING;
        let is_slow = 0.0 < speed_per_s && speed_per_s <= limit_per_s;
        if !is_short {
            return Err(Refusal::JogTooLong { what, asked: by.abs(), limit, unit });
        }
        if !is_homed && by.abs() > first + ROUNDING {
            return Err(Refusal::JogUnhomed { what, asked: by.abs(), limit: first, unit });
        }
        if !is_slow {
            let (asked, limit) = (speed_per_s, limit_per_s);
            return Err(Refusal::JogTooFast { what, asked, limit, unit });
        }
        Ok(())
    }

    /// What is written into a drive, and a motion of unknown length, need signs and scales that are shown.
    const fn admit_scaled(&self, what: &'static str) -> Result<(), Refusal> {
        match self.proven {
            Proven::Scales => Ok(()),
            Proven::Bench => Err(Refusal::Commissioned { what }),
            Proven::Nothing | Proven::Signs => Err(Refusal::NotCommissioned { what }),
        }
    }

    /// A person has just said that nothing is below the probe.
    fn is_stated(&self, now: RigTime, what: &'static str) -> Result<(), Refusal> {
        match self.stated_at {
            Some(at) if now.since(at) <= FRESH => Ok(()),
            _ => Err(Refusal::StepUnconfirmed { what }),
        }
    }

    /// A longer step stays inside the travel, and a little beyond it once the scales are shown. Before the signs are
    /// shown, the position says nothing.
    fn stay_inside<U: Unit>(
        &self,
        what: &'static str,
        to: Position<U>,
        travel: Span<U>,
        beyond: Span<U>,
    ) -> Result<(), Refusal> {
        let travel = if self.proven == Proven::Scales { beyond } else { travel };
        if self.proven == Proven::Nothing || travel.contains(to) {
            return Ok(());
        }
        let (min, max) = (travel.min.value(), travel.max.value());
        Err(Refusal::BeyondTravel { what, to: to.value(), min, max, unit: U::SYMBOL })
    }

    /// No step leads down below the lower soft limit. One that leads up from there is admitted.
    fn stay_above(
        &self,
        what: &'static str,
        from: Position<Mm>,
        by_mm: f64,
    ) -> Result<(), Refusal> {
        let to = from.offset(by_mm);
        if self.proven == Proven::Nothing || 0.0 < by_mm || self.lowest <= to.offset(ROUNDING) {
            return Ok(());
        }
        Err(Refusal::BelowSoftLimit { what, to: to.value(), min: self.lowest.value() })
    }

    pub(crate) const fn begun(&mut self, command: &PortCommand) {
        match *command {
            PortCommand::JogLinear { by_mm, .. } => self.linear_steps.last = by_mm.abs(),
            PortCommand::JogRotary { by_deg, .. } => self.rotary_steps.last = by_deg.abs(),
            PortCommand::SeekLinear | PortCommand::SeekRotary => {}
            _ => return,
        }
        self.withdrawn();
    }
}
