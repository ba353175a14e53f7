//! The cost of a plan: touches, prompts, extremes and duration.

use std::f64::consts::PI;

use rig_model::{Deg, Mm, Position, RigLimits, Span, SweepMethod, SweepRequest, Unit};

use crate::{Action, Approach, Plan, Pose, Step, Touch, TouchSettings};

/// The extent of a plan on a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Touches, of both phases.
    pub touches: usize,
    /// Number of no-load measurements.
    pub no_loads: usize,
    /// Number of prompts.
    pub prompts: usize,
    /// Expected time on the rig's clock, without the time that a person takes, in s.
    pub duration_s: f64,
    /// The part of it for the measurements halfway to the depth, s.
    pub halfway_s: f64,
    /// Space that the journal and the files of the run may take, bytes.
    pub disk_bytes: u64,
    /// The lowest position that a touch may ask for, and the clear position.
    pub linear: Span<Mm>,
    /// The extreme positions of the rotary stage.
    pub rotary: Span<Deg>,
}

/// The quality of resonance that is assumed of a sensor, for the time that it rings.
const ASSUMED_Q: f64 = 60.0;

/// The first reading of each finer pass waits for about this many, beyond the ways up and down: the
/// contact has set it ringing.
const AFTER_CONTACT_TIME_CONSTANTS: f64 = 2.0;

/// The two readings of the clear probe before a search wait for about this many time constants of the ring,
/// beyond the turn of the sample.
const CLEAR_TIME_CONSTANTS: f64 = 1.0;

/// Duration of an adaptive sweep in time constants, which nine of ten do not exceed: a model of the ring
/// takes the place of waiting. 222 sweeps in contact took 3.6 in the mean, and 5.9 at the 90th percentile.
const ADAPTIVE_TIME_CONSTANTS: f64 = 6.0;

/// Each pass of the search for the surface is finer than the one before it by at most this factor.
const REFINEMENT: f64 = 20.0;

/// Overhead of a move: starting, stopping, and requests to the drive, s.
const MOVE_S: f64 = 0.04;

/// Space of a run without touches, bytes: its files as they were read, and the report.
const RUN_BYTES: u64 = 400_000;

/// Space of a touch without its readings, bytes.
const TOUCH_BYTES: u64 = 10_000;

/// Space of a reading, bytes: in the journal, in its table, and in `records.jsonl`. The smoke run has
/// 800 for each reading, with everything else.
const READING_BYTES: u64 = 800;

/// More readings than a search for the surface takes.
const SEARCH_READINGS: usize = 40;

/// More readings than an adaptive sweep takes.
const ADAPTIVE_READINGS: usize = 64;

/// About the number of readings of a survey.
const SURVEY_READINGS: usize = 500;

fn readings(request: &SweepRequest) -> usize {
    match request.method {
        SweepMethod::Uniform { points } => points as usize,
        SweepMethod::Adaptive | SweepMethod::Survey { .. } => ADAPTIVE_READINGS,
    }
}

impl Plan {
    /// The extent of the plan on a rig with these limits.
    ///
    /// The duration is a sum over the steps, in which the surface is found where it is expected:
    ///
    /// ```text
    /// no-load   rotation + no-load sweep, the first time + survey
    /// touch     rotation + τ + way down and up at travel speed + search + dwell + contact sweep
    ///           + check of slip: 2 τ + 2 readings + its way
    ///           + halfway, if it is measured there: dwell + contact sweep
    /// search    readings · (settle + cycles/f + 0.04 s) + way at contact speed
    /// readings  start above/coarse step + 1, and for each finer pass half of its steps; a pass has at
    ///           most 20, and begins with 2 τ
    /// sweep     uniform: points · (settle + cycles/f); adaptive: 6 τ
    /// ```
    ///
    /// with f in the middle of the window and τ = Q/(π f) for a Q of 60.
    pub fn summary(&self, limits: &RigLimits) -> Summary {
        let level = limits.rotary.rest_target().position();
        let clear = limits.linear.rest_target().position();
        let mut summary = Summary {
            touches: 0,
            no_loads: 0,
            prompts: 0,
            duration_s: self.durations_s(limits).iter().sum(),
            halfway_s: 0.0,
            disk_bytes: 0,
            linear: Span { min: clear, max: clear },
            rotary: Span { min: level, max: level },
        };
        for step in &self.steps {
            let pose = match step.action {
                Action::Prompt(_) => {
                    summary.prompts += 1;
                    continue;
                }
                Action::NoLoad(pose) => {
                    summary.no_loads += 1;
                    pose
                }
                Action::Touch(Touch { pose, .. }) => {
                    summary.touches += 1;
                    summary.halfway_s += self.halfway_s();
                    include(&mut summary.linear, self.touch.floor(limits, pose));
                    pose
                }
            };
            include(&mut summary.rotary, pose.direction.rotary_position(pose.angle));
        }
        let of_survey = self.survey_s.map_or(0, |_| SURVEY_READINGS)
            + usize::from(self.level_check) * readings(&self.no_load_sweep);
        let sweeps = 1 + usize::from(self.touch.halfway_mm.is_some());
        let readings = of_survey
            + summary.no_loads * readings(&self.no_load_sweep)
            + summary.touches * (SEARCH_READINGS + sweeps * readings(&self.contact_sweep));
        summary.disk_bytes =
            RUN_BYTES + TOUCH_BYTES * summary.touches as u64 + READING_BYTES * readings as u64;
        summary
    }

    /// Expected duration of each step on the rig's clock, s: the terms of the sum in
    /// [`Plan::summary`]. A prompt counts as zero.
    pub fn durations_s(&self, limits: &RigLimits) -> Vec<f64> {
        let mut here = limits.rotary.rest_target().position();
        let check_s = if self.level_check { sweep_s(&self.no_load_sweep) } else { 0.0 };
        let mut survey_s = self.survey_s.map_or(0.0, f64::from) + check_s;
        let mut duration = |step: &Step| {
            let (pose, at_pose_s) = match step.action {
                Action::Prompt(_) => return 0.0,
                Action::NoLoad(pose) => {
                    (pose, std::mem::take(&mut survey_s) + sweep_s(&self.no_load_sweep))
                }
                Action::Touch(Touch { pose, .. }) => (pose, self.touch_s(limits, pose)),
            };
            let there = pose.direction.rotary_position(pose.angle);
            let way_deg = (there.value() - here.value()).abs();
            here = there;
            way_deg / limits.motion.rotary_speed_deg_per_s + at_pose_s
        };
        self.steps.iter().map(&mut duration).collect()
    }

    /// A touch, without the rotation.
    fn touch_s(&self, limits: &RigLimits, pose: Pose) -> f64 {
        let clear = limits.linear.rest_target().position();
        let way_mm = clear.value() - self.touch.start(limits, pose).value();
        let travel_s = 2.0 * (way_mm / limits.motion.travel_speed_mm_per_s + MOVE_S);
        let baseline_s = CLEAR_TIME_CONSTANTS * time_constant_s(&self.no_load_sweep);
        let contact_s = self.search_s(limits) + self.touch.dwell_s + sweep_s(&self.contact_sweep);
        travel_s + baseline_s + contact_s + self.halfway_s() + self.slip_check_s(limits)
    }

    /// The measurement of a touch halfway to its depth, s.
    fn halfway_s(&self) -> f64 {
        let one_s = self.touch.dwell_s + MOVE_S + sweep_s(&self.contact_sweep);
        self.touch.halfway_mm.map_or(0.0, |_| one_s)
    }

    /// Looking for the surface again after the sweep.
    fn slip_check_s(&self, limits: &RigLimits) -> f64 {
        let Approach { coarse_step_mm, settle_s, slip_mm, .. } = self.touch.approach;
        if slip_mm == 0.0 {
            return 0.0;
        }
        let ringing_s = AFTER_CONTACT_TIME_CONSTANTS * time_constant_s(&self.no_load_sweep);
        let readings_s = 2.0 * self.reading_s() + (ringing_s - settle_s).max(0.0);
        let up_mm = self.touch.indentation_mm + slip_mm + coarse_step_mm;
        let up_s = up_mm / limits.motion.travel_speed_mm_per_s + MOVE_S;
        let down_mm = coarse_step_mm + 2.0 * slip_mm;
        readings_s + up_s + down_mm / limits.motion.contact_speed_mm_per_s
    }

    /// One reading of the search, with the move to its position, s.
    fn reading_s(&self) -> f64 {
        let Approach { settle_s, cycles, .. } = self.touch.approach;
        settle_s + f64::from(cycles) / middle_hz(&self.no_load_sweep) + MOVE_S
    }

    /// Finding the surface, and the indentation.
    fn search_s(&self, limits: &RigLimits) -> f64 {
        let Approach { start_above_mm, coarse_step_mm, fine_step_mm, settle_s, .. } =
            &self.touch.approach;
        let passes = ((coarse_step_mm / fine_step_mm).ln() / REFINEMENT.ln()).ceil();
        // A finer pass ends anywhere among its steps, each as likely.
        let (mut fine_readings, mut width_mm) = (0.0, *coarse_step_mm);
        while *fine_step_mm < width_mm {
            let next_mm = (width_mm / REFINEMENT).max(*fine_step_mm);
            fine_readings += 0.5 * (width_mm / next_mm + 1.0);
            width_mm = next_mm;
        }
        let readings = start_above_mm / coarse_step_mm + 1.0 + fine_readings;
        // Each finer pass begins a coarse step higher, to take up the backlash, and goes up fast.
        let way_mm = start_above_mm + passes * 1.5 * coarse_step_mm + self.touch.indentation_mm;
        let ringing_s = AFTER_CONTACT_TIME_CONSTANTS * time_constant_s(&self.no_load_sweep);
        let waits_s = passes * (ringing_s - settle_s).max(0.0);
        readings * self.reading_s() + waits_s + way_mm / limits.motion.contact_speed_mm_per_s
    }
}

impl TouchSettings {
    /// Start of the search for the surface at a pose.
    pub(crate) fn start(&self, limits: &RigLimits, pose: Pose) -> Position<Mm> {
        let surface = limits.geometry.surface_at(pose.direction, pose.angle);
        surface.offset(self.approach.start_above_mm)
    }

    /// The lowest position that a touch at a pose may ask for.
    pub(crate) fn floor(&self, limits: &RigLimits, pose: Pose) -> Position<Mm> {
        let surface = limits.geometry.surface_at(pose.direction, pose.angle);
        surface.offset(-self.approach.give_up_below_mm - self.indentation_mm)
    }
}

/// Widens the span so that it holds the position.
fn include<U: Unit>(span: &mut Span<U>, position: Position<U>) {
    if position < span.min {
        span.min = position;
    }
    if position > span.max {
        span.max = position;
    }
}

fn sweep_s(sweep: &SweepRequest) -> f64 {
    let planned_s = match sweep.method {
        SweepMethod::Adaptive | SweepMethod::Survey { .. } => {
            ADAPTIVE_TIME_CONSTANTS * time_constant_s(sweep)
        }
        SweepMethod::Uniform { points } => {
            let integration_s = f64::from(sweep.cycles) / middle_hz(sweep);
            f64::from(points) * (sweep.settle_s + integration_s)
        }
    };
    planned_s.min(sweep.time_limit_s)
}

/// Time constant of the free decay of the sensor, s.
fn time_constant_s(sweep: &SweepRequest) -> f64 {
    ASSUMED_Q / (PI * middle_hz(sweep))
}

fn middle_hz(sweep: &SweepRequest) -> f64 {
    0.5 * (sweep.window.min_hz + sweep.window.max_hz)
}
