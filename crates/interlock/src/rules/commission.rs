//! Before signs and scales of the drives are shown, only a short step of one axis is admitted, and each step
//! needs the word of a person that nothing is below the probe.

use std::time::Duration;

use rig_model::{Deg, Mm, Position, RigLimits, RigTime, Span, Unit};

use crate::{PortCommand, Refusal};

/// How long the word of a person holds: a sample is placed within minutes.
const FRESH: Duration = Duration::from_secs(60);

/// Longest step and highest speed while nothing is shown, and after the signs are shown.
const LINEAR: [Bounds; 2] =
    [Bounds { step: 0.2, speed_per_s: 1.0 }, Bounds { step: 10.0, speed_per_s: 1.0 }];
const ROTARY: [Bounds; 2] =
    [Bounds { step: 1.0, speed_per_s: 5.0 }, Bounds { step: 31.0, speed_per_s: 5.0 }];

/// Rounding of a step to the counts of a drive, in units of the axis.
const ROUNDING: f64 = 1e-6;

/// What calibrations show of the drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Proven {
    /// Nothing: a sign or a scale may be wrong.
    Nothing,
    /// Stop and signs: a step goes in the direction that is asked.
    Signs,
    /// All that motion rests on.
    Bench,
}

#[derive(Debug, Clone, Copy)]
struct Bounds {
    step: f64,
    speed_per_s: f64,
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
}

impl Commission {
    /// Nobody has stated anything.
    pub const fn new(limits: &RigLimits, proven: Proven) -> Self {
        let (linear, rotary) = (limits.linear.travel(), limits.rotary.travel());
        Self { proven, stated_at: None, linear, rotary }
    }

    pub(crate) const fn prove(&mut self, proven: Proven) {
        self.proven = proven;
    }

    pub(crate) const fn stated(&mut self, now: RigTime) {
        self.stated_at = Some(now);
    }

    pub(crate) const fn withdrawn(&mut self) {
        self.stated_at = None;
    }

    pub(crate) fn admit(&self, now: RigTime, command: &PortCommand) -> Result<(), Refusal> {
        let what = command.name();
        match *command {
            PortCommand::Stop | PortCommand::Measure => Ok(()),
            PortCommand::JogLinear { from, by_mm, speed_mm_per_s } => {
                self.admit_step(now, what, &LINEAR, (by_mm, speed_mm_per_s))?;
                self.stay_inside(what, from, by_mm, self.linear)
            }
            PortCommand::JogRotary { from, by_deg, speed_deg_per_s } => {
                self.admit_step(now, what, &ROTARY, (by_deg, speed_deg_per_s))?;
                self.stay_inside(what, from, by_deg, self.rotary)
            }
            _ if self.proven == Proven::Bench => Ok(()),
            _ => Err(Refusal::NotCommissioned { what }),
        }
    }

    fn admit_step(
        &self,
        now: RigTime,
        what: &'static str,
        bounds: &[Bounds; 2],
        (by, speed_per_s): (f64, f64),
    ) -> Result<(), Refusal> {
        let Bounds { step: limit, speed_per_s: limit_per_s } = match self.proven {
            Proven::Nothing => bounds[0],
            Proven::Signs => bounds[1],
            Proven::Bench => return Err(Refusal::Commissioned { what }),
        };
        if self.stated_at.is_none_or(|at| FRESH < now.since(at)) {
            return Err(Refusal::StepUnconfirmed { what });
        }
        // NaN is refused too.
        let is_short = by.abs() <= limit + ROUNDING;
        let is_slow = 0.0 < speed_per_s && speed_per_s <= limit_per_s;
        if !is_short {
            return Err(Refusal::JogTooLong { what, asked: by.abs(), limit });
        }
        if !is_slow {
            let (asked, limit) = (speed_per_s, limit_per_s);
            return Err(Refusal::JogTooFast { what, asked, limit });
        }
        Ok(())
    }

    /// A longer step stays inside the travel. Before the signs are shown, the position says nothing.
    fn stay_inside<U: Unit>(
        &self,
        what: &'static str,
        from: Position<U>,
        by: f64,
        travel: Span<U>,
    ) -> Result<(), Refusal> {
        let to = from.offset(by);
        if self.proven == Proven::Nothing || travel.contains(to) {
            return Ok(());
        }
        let (min, max) = (travel.min.value(), travel.max.value());
        Err(Refusal::BeyondTravel { what, to: to.value(), min, max })
    }

    pub(crate) const fn begun(&mut self, command: &PortCommand) {
        if command.is_jog() {
            self.withdrawn();
        }
    }
}
