//! The checked plan, which the engine replays step by step.

use std::fmt;

use crate::{AimPlan, NoLoadPolicy};
use rig_model::{ContactAngle, Direction, Orientation, SweepRequest};

/// A protocol that this rig can run, laid out in steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Name of the protocol.
    pub name: String,
    /// Names of the samples; steps refer to them by index.
    pub samples: Vec<String>,
    /// The steps, in order.
    pub steps: Vec<Step>,
    /// The settings of the search and the indentation.
    pub touch: TouchSettings,
    /// When the no-load resonance is measured again.
    pub no_load: NoLoadPolicy,
    /// The no-load sweep.
    pub no_load_sweep: SweepRequest,
    /// Duration of the survey of the bench before the first no-load sweep, s; without it there is none.
    pub survey_s: Option<u32>,
    /// Whether the resonance is compared with that at half the level after a survey.
    pub level_check: bool,
    /// The sweep in contact.
    pub contact_sweep: SweepRequest,
    /// Classification of the blind touches, if there are any.
    pub classes: Option<usize>,
    /// The seed that chose every random order, angle and sample in it.
    pub seed: u64,
    /// What the protocol wants of its touches, and how their time is split for it; `None` if it states every
    /// setting itself.
    pub aim: Option<AimPlan>,
}

/// With [`NoLoadPolicy::ByDrift`] the drift may reach this many standard deviations of the no-load sweep. A touch
/// between two references then has as much of the sweeps as of the drift: on a straight line between them, the mean
/// variance of a random walk is a sixth of that at its end.
const DRIFT_SIGMAS: f64 = 2.0;

impl Plan {
    /// Whether a step is a reference that is measured only if the drift asks for it. The first one after a person
    /// was at the bench is always measured.
    pub fn is_by_drift(&self, index: usize) -> bool {
        let before = index.checked_sub(1).and_then(|before| self.steps.get(before));
        let is_after_touch = before.is_some_and(|step| matches!(step.action, Action::Touch(_)));
        let is_reference =
            self.steps.get(index).is_some_and(|step| matches!(step.action, Action::NoLoad(_)));
        self.no_load == NoLoadPolicy::ByDrift && is_reference && is_after_touch
    }

    /// Largest standard deviation of the drift at the end of a touch for which no reference is measured before it, Hz.
    pub fn drift_limit_hz(&self) -> f64 {
        DRIFT_SIGMAS * self.no_load_sweep.target_sigma_hz
    }
}

/// One step, with an address that stays the same from run to run.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Address of the step.
    pub id: StepId,
    /// Action of the step.
    pub action: Action,
}

/// The address of a step, such as `main/3/left/30/1`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct StepId(pub String);

impl fmt::Display for StepId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// The action of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Action {
    /// A prompt: an action that the bench cannot carry out.
    Prompt(Prompt),
    /// The no-load resonance is measured at a pose, with the probe clear.
    NoLoad(Pose),
    /// One touch, from clear to clear.
    Touch(Touch),
}

/// A prompt for a person.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Prompt {
    /// Put this sample under the probe.
    PlaceSample {
        /// Index into [`Plan::samples`].
        sample: usize,
    },
    /// Turn the sensor about its own axis.
    TurnSensor {
        /// Orientation after the turn.
        orientation: Orientation,
    },
}

/// The pose of the surface against the probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Direction of the tilt.
    pub direction: Direction,
    /// Contact angle, from 0° to below 90°.
    pub angle: ContactAngle,
}

/// Phase of the protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Phase {
    /// The grid of samples, directions and angles.
    Main,
    /// The random touches that are classified without their labels.
    Blind,
}

impl Phase {
    /// The word in step addresses and results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Main => "main",
            Self::Blind => "blind",
        }
    }
}

/// One touch of one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// Phase of the protocol.
    pub phase: Phase,
    /// Index into [`Plan::samples`]. The analysis of the blind phase does not use it.
    pub sample: usize,
    /// Pose of the surface.
    pub pose: Pose,
    /// Counts from 1: the repeat of this pose in the main phase, the trial in the blind phase.
    pub repeat: u32,
}

/// The settings of a touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchSettings {
    /// Depth below the surface found, along the probe axis, in mm.
    pub indentation_mm: f64,
    /// The smaller depth at which each touch is measured first, mm; `None` for the full depth alone.
    pub halfway_mm: Option<f64>,
    /// Rest between the indentation and the sweep, so that the tissue relaxes, in s.
    pub dwell_s: f64,
    /// The settings of the search for the surface.
    pub approach: Approach,
    /// What happens after a touch was refused.
    pub on_refusal: RefusalPolicy,
}

/// What happens after a touch was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RefusalPolicy {
    /// The refusal is recorded, and the run goes on.
    Record,
    /// The touch is repeated once.
    Repeat,
    /// The window of the sweep in contact is widened, and the touch is repeated once.
    Widen,
    /// The run is aborted.
    Abort,
    /// A person is asked.
    Ask,
}

/// The settings of the search for the surface.
///
/// The probe goes down in steps. At each one the impedance at the no-load resonance is compared
/// with that of the clear probe. After the first change it goes back above the last clear step and
/// comes down again in finer steps, until the finest step brackets the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// Start of the search above the expected surface, mm.
    pub start_above_mm: f64,
    /// End of the search below the expected surface, mm.
    pub give_up_below_mm: f64,
    /// The first step, in mm.
    pub coarse_step_mm: f64,
    /// The last step, in mm: the surface is known to a uniform error of this width.
    pub fine_step_mm: f64,
    /// Relative change of impedance that counts as contact.
    pub contact_threshold: f64,
    /// Settling at each step, in s.
    pub settle_s: f64,
    /// Whole cycles integrated at each step.
    pub cycles: u32,
    /// After the sweep the surface must still lie within this distance of where it was found, mm;
    /// 0 for no such check.
    pub slip_mm: f64,
    /// Speed of a continuous descent, which finds the surface before a search in steps is tried, mm/s; `None`
    /// for the search in steps alone.
    pub descent_mm_per_s: Option<f64>,
    /// Speed of the descents of every second touch of a pose instead, mm/s: touches at two speeds show the latency
    /// between stage and analyzer.
    pub slow_descent_mm_per_s: Option<f64>,
}

impl Approach {
    /// The planned speed of the descent of a touch that is the `repeat`th of its pose, mm/s; `None` for a search in
    /// steps.
    pub fn descent_of(&self, repeat: u32) -> Option<f64> {
        let slow_mm_per_s = self.slow_descent_mm_per_s.filter(|_| repeat.is_multiple_of(2));
        slow_mm_per_s.or(self.descent_mm_per_s)
    }

    /// Whether the surface is looked for again after each sweep.
    pub fn has_slip_check(&self) -> bool {
        0.0 < self.slip_mm
    }
}
