//! The cost of a plan: touches, prompts, extremes and duration.

use std::f64::consts::PI;

use rig_model::{
    AnalyzerRange, Deg, Mm, Position, RigLimits, Span, SweepMethod, SweepRequest, Unit,
};

use crate::{
    Action, Approach, PartTimes, Plan, Pose, Prompt, Step, Touch, TouchSettings,
    expected_drift::ExpectedDrift,
};

/// The extent of a plan on a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Touches, of both phases.
    pub touches: usize,
    /// Number of no-load measurements; an expected one if the drift decides.
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
const ASSUMED_Q: f64 = 66.0;

/// The first reading after a contact waits for this many time constants of the ring, the baseline for as many
/// more, and the reading of the self-test.
const AFTER_CONTACT_TIME_CONSTANTS: f64 = 3.0;
const BASELINE_TIME_CONSTANTS: f64 = 4.0;
const TEST_TIME_CONSTANTS: f64 = 3.0;

/// Mean duration of an adaptive sweep: some time constants, in which the resonance is found, and then readings until
/// its standard deviation is that of the target. A model of the ring takes the place of waiting.
#[derive(Debug, Clone, Copy)]
struct AdaptiveTime {
    time_constants: f64,
    /// The duration times the square of the target, s Hz².
    s_hz2: f64,
}

/// On the shipped bench, by the setting of the targets on the page of touches.
const CONTACT_TIME: AdaptiveTime = AdaptiveTime { time_constants: 1.8, s_hz2: 4.8e-4 };
const NO_LOAD_TIME: AdaptiveTime = AdaptiveTime { time_constants: 1.25, s_hz2: 4.4e-5 };

/// How well a surface is known from the touches before, as a part of its tolerance: on the shipped bench, 65 µm
/// for a new mounting of the sample or the sensor, and 15 µm for a known one.
const NEW_MOUNTING: f64 = 0.13;
const KNOWN_MOUNTING: f64 = 0.03;

/// The geometry of the bench is learnt from this many touches; until then each counts as one of a new mounting.
const LEARNING_TOUCHES: u32 = 10;

/// A search whose surface is known begins this many standard deviations and fine steps above it, and takes fine
/// steps from the third number on.
const START_SIGMAS: f64 = 4.0;
const START_FINE_STEPS: f64 = 2.0;
const LIKELY_SIGMAS: f64 = 1.5;

/// Before the first surface of a run the probe goes down in steps of this part of the largest indentation.
const WAY_PART: f64 = 0.5;

/// The first reading of this way waits for this many time constants: the drive has had the frequency of the self-test.
const SETTLED_TIME_CONSTANTS: f64 = 5.0;

/// Each pass of the search for the surface is finer than the one before it by at most this factor.
const REFINEMENT: f64 = 20.0;

/// Overhead of a move: requests to the drive, s.
const MOVE_S: f64 = 0.025;

/// Overhead of a reading of the search: commands and answer on a serial line, s. With an analyzer whose stream has
/// another overhead than [`USUAL_OVERHEAD_S`] it is longer by the difference.
const READING_S: f64 = 0.02;
const USUAL_OVERHEAD_S: f64 = 0.01;

/// Readings of an adaptive sweep, and the cycles of most of them. Their time is in [`AdaptiveTime`], for an analyzer
/// that integrates no longer than it is asked to.
const SWEEP_READINGS: f64 = 10.0;
const SWEEP_CYCLES: u32 = 2;

/// Readings of a clear probe before a search: the baseline, the self-test, and one of each change of frequency.
const CLEAR_READINGS: f64 = 4.0;

/// Time in which a stage is assumed to reach the travel speed and the speed of the rotary stage, s: that of the
/// accelerations of the shipped rig files.
const LINEAR_RAMP_S: f64 = 0.1;
const ROTARY_RAMP_S: f64 = 0.2;

/// Readings of a descent after the contact: until the stop, and at rest.
const DESCENT_READINGS: f64 = 5.0;

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
/// About the number of sweeps by which the level is checked after it.
const LEVEL_SWEEPS: usize = 24;

/// What is expected of the steps of a plan.
#[derive(Debug)]
pub(crate) struct Course {
    /// Duration of each step on the rig's clock, s.
    pub(crate) durations_s: Vec<f64>,
    /// Whether each step is made: a reference for which the drift does not ask is left out.
    pub(crate) is_made: Vec<bool>,
    /// Time of the ways down and the searches, s.
    surfaces_s: f64,
}

impl Course {
    /// Number of references.
    pub(crate) fn references(&self, plan: &Plan) -> usize {
        let is_reference = |(step, is_made): &(&Step, &bool)| {
            **is_made && matches!(step.action, Action::NoLoad(_))
        };
        plan.steps.iter().zip(&self.is_made).filter(is_reference).count()
    }
}

fn readings(request: &SweepRequest) -> usize {
    match request.method {
        SweepMethod::Uniform { points } => points as usize,
        SweepMethod::Adaptive | SweepMethod::Survey { .. } => ADAPTIVE_READINGS,
    }
}

impl Plan {
    /// The extent of the plan on a rig with these limits.
    ///
    /// The duration is a sum over the steps:
    ///
    /// ```text
    /// move      way/v + v/a, or 2 √(way/a), + 0.025 s; a: travel speed in 0.1 s, rotary speed in 0.2 s
    /// no-load   rotation, by way of level if a sample is placed, + sweep, the first time + survey
    /// touch     rotation + what is left of 4 τ after the touch before + what the rotation leaves of 3 τ
    ///           + way down + search + indentation + dwell + contact sweep + check of slip
    ///           + way up to where the next turn is clear
    ///           + halfway, if it is measured there: dwell + contact sweep
    /// search    moves and readings of settle + cycles/f + 0.02 s each; before the first one of a run, 5 τ
    ///           and steps of half of the largest indentation down to start_above; then coarse steps from there and
    ///           finer passes, each of half of its steps after 3 τ; later ones from
    ///           4 σ above, σ = 0.13 of the surface tolerance for a new mounting and in the first ten touches, then 0.03
    /// slip      way up and 3 τ, 2 readings and the way between
    /// reading   longer by what the analyzer integrates at least, and by its overhead beyond 0.01 s: 4 with the probe
    ///           clear, each of the search, 2 of the slip, and 10 in an adaptive sweep
    /// sweep     uniform: points · (settle + cycles/f); adaptive, with the target σ:
    ///           1.8 τ + 4.8·10⁻⁴ s Hz²/σ² in contact, 1.25 τ + 4.4·10⁻⁵ s Hz²/σ² without
    /// ```
    ///
    /// with f in the middle of the window and τ = Q/(π f) for a Q of 66. A reference by drift is expected where a walk of
    /// 1.2 Hz in an hour, 0.3 Hz from the third reference on, passes its limit in a touch as long as the last one.
    pub fn summary(&self, limits: &RigLimits) -> Summary {
        let level = limits.rotary.rest_target().position();
        let clear = limits.linear.rest_target().position();
        let course = self.course(limits);
        let mut summary = Summary {
            touches: 0,
            no_loads: course.references(self),
            prompts: 0,
            duration_s: course.durations_s.iter().sum(),
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
                Action::NoLoad(pose) => pose,
                Action::Touch(Touch { pose, .. }) => {
                    summary.touches += 1;
                    summary.halfway_s += self.halfway_s(limits);
                    include(&mut summary.linear, self.touch.floor(limits, pose));
                    pose
                }
            };
            include(&mut summary.rotary, pose.direction.rotary_position(pose.angle));
        }
        let of_survey = self.survey_s.map_or(0, |_| SURVEY_READINGS)
            + self.level_sweeps() * readings(&self.no_load_sweep);
        let sweeps = 1 + usize::from(self.touch.halfway_mm.is_some());
        let readings = of_survey
            + summary.no_loads * readings(&self.no_load_sweep)
            + summary.touches * (SEARCH_READINGS + sweeps * readings(&self.contact_sweep));
        summary.disk_bytes =
            RUN_BYTES + TOUCH_BYTES * summary.touches as u64 + READING_BYTES * readings as u64;
        summary
    }

    /// Expected duration of each step on the rig's clock, s: the terms of the sum in
    /// [`Plan::summary`]. A prompt counts as zero; the way to level before it belongs to the next step.
    pub fn durations_s(&self, limits: &RigLimits) -> Vec<f64> {
        self.course(limits).durations_s
    }

    /// Expected time of a touch by what it is for: the terms of the sum in [`Plan::summary`] over the touches.
    pub(crate) fn times(&self, limits: &RigLimits, course: &Course) -> PartTimes {
        let whole_s = course.durations_s.iter().sum::<f64>() / self.touches();
        let surface_s = course.surfaces_s / self.touches();
        let targets_hz = (self.contact_sweep.target_sigma_hz, self.no_load_sweep.target_sigma_hz);
        let known = PartTimes { surface_s, ..PartTimes::default() };
        let known = self.with_targets(limits, targets_hz, course.references(self), known);
        PartTimes { rest_s: whole_s - known.together_s(), ..known }
    }

    /// These times with other targets of the sweeps, in contact and without, Hz, and the same references.
    pub(crate) fn with_targets(
        &self,
        limits: &RigLimits,
        (contact_hz, no_load_hz): (f64, f64),
        references: usize,
        times: PartTimes,
    ) -> PartTimes {
        let contact = SweepRequest { target_sigma_hz: contact_hz, ..self.contact_sweep };
        let no_load = SweepRequest { target_sigma_hz: no_load_hz, ..self.no_load_sweep };
        let no_loads = references + self.level_sweeps();
        let survey_s = self.survey_s.map_or(0.0, f64::from);
        let halfway_sweeps = f64::from(u8::from(self.touch.halfway_mm.is_some()));
        PartTimes {
            sweep_s: (1.0 + halfway_sweeps) * sweep_s(&contact, CONTACT_TIME, limits),
            reference_s: (survey_s + no_loads as f64 * sweep_s(&no_load, NO_LOAD_TIME, limits))
                / self.touches(),
            ..times
        }
    }

    /// Number of touches; 1 for a plan without any.
    fn touches(&self) -> f64 {
        let is_touch = |step: &&Step| matches!(step.action, Action::Touch(_));
        self.steps.iter().filter(is_touch).count().max(1) as f64
    }

    /// What is expected of the steps on a rig with these limits.
    pub(crate) fn course(&self, limits: &RigLimits) -> Course {
        let level = limits.rotary.rest_target().position();
        let rest = limits.linear.rest_target().position();
        let check_s = self.level_sweeps() as f64 * self.no_load_s(limits);
        let mut survey_s = self.survey_s.map_or(0.0, f64::from) + check_s;
        let mut bench = Bench {
            tilt: level,
            height: rest,
            ringing_s: f64::INFINITY,
            mounting: None,
            touches: 0,
            surfaces_s: 0.0,
            descent_mm_per_s: None,
        };
        let mut levelling_s = 0.0;
        let (mut drift, mut touch_s) = (ExpectedDrift::default(), 0.0);
        let mut expected = |(index, step): (usize, &Step)| {
            let pose = match step.action {
                Action::Prompt(prompt) => {
                    bench.mounting = bench.mounting.map(|_| false);
                    if matches!(prompt, Prompt::PlaceSample { .. }) {
                        levelling_s += turn_s(limits, bench.tilt, level);
                        bench.tilt = level;
                    }
                    return (0.0, true);
                }
                Action::NoLoad(pose) | Action::Touch(Touch { pose, .. }) => pose,
            };
            let limit_hz2 = self.drift_limit_hz().powi(2);
            if self.is_by_drift(index) && drift.variance_hz2(touch_s) <= limit_hz2 {
                return (0.0, false);
            }
            if let Action::Touch(Touch { repeat, .. }) = step.action {
                bench.descent_mm_per_s = self.touch.approach.descent_of(repeat);
            }
            let there = pose.direction.rotary_position(pose.angle);
            let rotation_s = turn_s(limits, bench.tilt, there);
            bench.tilt = there;
            let at_pose_s = if let Action::NoLoad(_) = step.action {
                // The drive has another frequency after a sweep.
                bench.ringing_s = 0.0;
                drift.measured();
                std::mem::take(&mut survey_s) + self.no_load_s(limits)
            } else {
                let next = self.steps.get(index + 1).and_then(|next| match next.action {
                    Action::Prompt(_) => None,
                    Action::NoLoad(pose) | Action::Touch(Touch { pose, .. }) => Some(pose),
                });
                touch_s = rotation_s + self.touch_s(limits, pose, next, rotation_s, &mut bench);
                drift.passed(touch_s);
                touch_s - rotation_s
            };
            (std::mem::take(&mut levelling_s) + rotation_s + at_pose_s, true)
        };
        let (durations_s, is_made) = self.steps.iter().enumerate().map(&mut expected).unzip();
        Course { durations_s, is_made, surfaces_s: bench.surfaces_s }
    }

    /// A touch, without the rotation.
    fn touch_s(
        &self,
        limits: &RigLimits,
        pose: Pose,
        next: Option<Pose>,
        rotation_s: f64,
        bench: &mut Bench,
    ) -> f64 {
        let time_constant_s = time_constant_s(&self.no_load_sweep);
        let Approach { cycles, .. } = self.touch.approach;
        let integration_s = f64::from(cycles) / middle_hz(&self.no_load_sweep);
        let clear_s = (BASELINE_TIME_CONSTANTS * time_constant_s - bench.ringing_s).max(0.0)
            + (TEST_TIME_CONSTANTS * time_constant_s - rotation_s).max(0.0)
            + 2.0 * (integration_s + READING_S)
            + CLEAR_READINGS * longer_s(limits, integration_s);
        let highest = limits.highest_surface(pose.direction, pose.angle);
        let surface = limits.geometry.surface_at(pose.direction, pose.angle);
        bench.touches += 1;
        let mounting = bench.mounting.replace(LEARNING_TOUCHES <= bench.touches);
        let (first, search_s) = match (bench.descent_mm_per_s, mounting) {
            (descent, None) => {
                let way_mm = bench.height.value() - self.touch.start(limits, pose).value();
                let search_s = match descent {
                    Some(speed) => {
                        self.descent_s(limits, self.touch.approach.start_above_mm, speed)
                    }
                    None => self.cold_search_s(limits),
                };
                (bench.height, self.first_way_s(limits, way_mm) + search_s)
            }
            (Some(speed), Some(_)) => {
                (highest, self.descent_s(limits, highest.value() - surface.value(), speed))
            }
            (None, Some(is_known)) => {
                let highest_mm = highest.value() - surface.value();
                (highest, self.warm_search_s(limits, highest_mm, is_known))
            }
        };
        let down_s = travel_s(limits, bench.height.value() - first.value());
        bench.surfaces_s += down_s + search_s;
        let contact_s = contact_move_s(limits, self.touch.indentation_mm)
            + self.touch.dwell_s
            + self.contact_sweep_s(limits);
        let rest = limits.linear.rest_target();
        let clear = next.map_or(rest, |next| {
            limits.clear_for_turn(bench.tilt, next.direction.rotary_position(next.angle))
        });
        bench.height = clear.position();
        let up_s = travel_s(limits, bench.height.value() - surface.value());
        bench.ringing_s = up_s;
        clear_s
            + down_s
            + search_s
            + contact_s
            + self.halfway_s(limits)
            + self.slip_check_s(limits)
            + up_s
    }

    /// The measurement of a touch halfway to its depth, s.
    fn halfway_s(&self, limits: &RigLimits) -> f64 {
        let one_s = self.touch.dwell_s + MOVE_S + self.contact_sweep_s(limits);
        self.touch.halfway_mm.map_or(0.0, |_| one_s)
    }

    /// Looking for the surface again after the sweep.
    fn slip_check_s(&self, limits: &RigLimits) -> f64 {
        let Approach { coarse_step_mm, slip_mm, .. } = self.touch.approach;
        if !self.touch.approach.has_slip_check() {
            return 0.0;
        }
        let up_s = travel_s(limits, self.touch.indentation_mm + slip_mm + coarse_step_mm);
        let ringing_s = AFTER_CONTACT_TIME_CONSTANTS * time_constant_s(&self.no_load_sweep);
        let down_s = contact_move_s(limits, coarse_step_mm).max(ringing_s);
        let readings_s = 2.0 * self.reading_s(limits) - self.touch.approach.settle_s;
        up_s + down_s + readings_s + contact_move_s(limits, 2.0 * slip_mm)
    }

    /// One reading of the search, without the move to its position, s.
    fn reading_s(&self, limits: &RigLimits) -> f64 {
        let Approach { settle_s, cycles, .. } = self.touch.approach;
        let asked_s = f64::from(cycles) / middle_hz(&self.no_load_sweep);
        settle_s + asked_s + READING_S + longer_s(limits, asked_s)
    }

    /// A continuous descent from above the surface.
    fn descent_s(&self, limits: &RigLimits, above_mm: f64, speed_mm_per_s: f64) -> f64 {
        above_mm / speed_mm_per_s + DESCENT_READINGS * self.reading_s(limits) + MOVE_S
    }

    /// The way down to the first search of a run, with a reading after each step.
    fn first_way_s(&self, limits: &RigLimits, way_mm: f64) -> f64 {
        let step_mm = WAY_PART * limits.motion.max_indentation_mm;
        let ringing_s = SETTLED_TIME_CONSTANTS * time_constant_s(&self.no_load_sweep);
        ringing_s + (way_mm / step_mm).ceil() * (travel_s(limits, step_mm) + self.reading_s(limits))
    }

    /// Finding a surface of which nothing is known.
    fn cold_search_s(&self, limits: &RigLimits) -> f64 {
        let Approach { start_above_mm, coarse_step_mm, fine_step_mm, settle_s, .. } =
            &self.touch.approach;
        let step_s = |step_mm: f64| self.reading_s(limits) + contact_move_s(limits, step_mm);
        let ringing_s = AFTER_CONTACT_TIME_CONSTANTS * time_constant_s(&self.no_load_sweep);
        let mut seconds =
            self.reading_s(limits) + start_above_mm / coarse_step_mm * step_s(*coarse_step_mm);
        // A finer pass begins a coarse step higher, to take up the backlash, and ends anywhere among its
        // steps, each as likely.
        let mut width_mm = *coarse_step_mm;
        while *fine_step_mm < width_mm {
            let next_mm = (width_mm / REFINEMENT).max(*fine_step_mm);
            seconds += travel_s(limits, 2.0 * coarse_step_mm) + ringing_s.max(*settle_s);
            seconds += 0.5 * (width_mm / next_mm + 1.0) * step_s(next_mm);
            width_mm = next_mm;
        }
        seconds
    }

    /// Finding a surface that the touches before predict. The probe goes down slowly from where no surface
    /// can be higher.
    fn warm_search_s(&self, limits: &RigLimits, highest_mm: f64, is_known: bool) -> f64 {
        let Approach { start_above_mm, coarse_step_mm, fine_step_mm, .. } = self.touch.approach;
        let part = if is_known { KNOWN_MOUNTING } else { NEW_MOUNTING };
        let sigma_mm = part * limits.geometry.surface_tolerance_mm;
        let above_mm =
            (START_SIGMAS * sigma_mm + START_FINE_STEPS * fine_step_mm).min(start_above_mm);
        let slow_s = contact_move_s(limits, (highest_mm - above_mm).max(0.0));
        let likely_mm = LIKELY_SIGMAS * sigma_mm;
        let long = ((above_mm - likely_mm).max(0.0) / coarse_step_mm).ceil();
        let fine = likely_mm / fine_step_mm + 0.5;
        let way_s = (above_mm - likely_mm).max(0.0) / limits.motion.contact_speed_mm_per_s;
        slow_s
            + (1.0 + long + fine) * self.reading_s(limits)
            + way_s
            + long * MOVE_S
            + fine * contact_move_s(limits, fine_step_mm)
    }

    fn contact_sweep_s(&self, limits: &RigLimits) -> f64 {
        sweep_s(&self.contact_sweep, CONTACT_TIME, limits)
    }

    /// Number of sweeps by which the level is checked.
    fn level_sweeps(&self) -> usize {
        if self.level_check { LEVEL_SWEEPS } else { 0 }
    }

    fn no_load_s(&self, limits: &RigLimits) -> f64 {
        sweep_s(&self.no_load_sweep, NO_LOAD_TIME, limits)
    }
}

/// The bench between two steps.
struct Bench {
    tilt: Position<Deg>,
    height: Position<Mm>,
    /// For how long the sensor has been free and driven at its resonance, s.
    ringing_s: f64,
    /// Whether the mounting was touched before; `None` before the first touch.
    mounting: Option<bool>,
    touches: u32,
    /// Time of the ways down and the searches so far, s.
    surfaces_s: f64,
    /// Planned speed of the descent of the touch, mm/s; `None` for a search in steps.
    descent_mm_per_s: Option<f64>,
}

/// Duration of a move from rest to rest.
fn move_s(way: f64, speed: f64, acceleration: f64) -> f64 {
    let way = way.max(0.0);
    let moving_s = if way < speed * speed / acceleration {
        2.0 * (way / acceleration).sqrt()
    } else {
        way / speed + speed / acceleration
    };
    MOVE_S + moving_s
}

fn turn_s(limits: &RigLimits, from: Position<Deg>, to: Position<Deg>) -> f64 {
    let motion = &limits.motion;
    let way_deg = (to.value() - from.value()).abs();
    move_s(way_deg, motion.rotary_speed_deg_per_s, motion.rotary_speed_deg_per_s / ROTARY_RAMP_S)
}

fn acceleration(limits: &RigLimits) -> f64 {
    limits.motion.travel_speed_mm_per_s / LINEAR_RAMP_S
}

fn travel_s(limits: &RigLimits, way_mm: f64) -> f64 {
    move_s(way_mm, limits.motion.travel_speed_mm_per_s, acceleration(limits))
}

fn contact_move_s(limits: &RigLimits, way_mm: f64) -> f64 {
    move_s(way_mm, limits.motion.contact_speed_mm_per_s, acceleration(limits))
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

/// How much longer a reading takes that is to integrate this long than on an analyzer that does so, s.
fn longer_s(limits: &RigLimits, asked_s: f64) -> f64 {
    let AnalyzerRange { stream, shortest_integration_s, .. } = limits.analyzer;
    // A trace has two points.
    let overhead_s = stream.overhead_s.map_or(asked_s, |found| (found - USUAL_OVERHEAD_S).max(0.0));
    (shortest_integration_s - asked_s).max(0.0) + overhead_s
}

fn sweep_s(sweep: &SweepRequest, adaptive: AdaptiveTime, limits: &RigLimits) -> f64 {
    unlimited_s(sweep, adaptive, limits).min(sweep.time_limit_s)
}

/// Time in which a sweep in contact or, without one, of the free sensor reaches its target, s.
pub(crate) fn to_target_s(sweep: &SweepRequest, is_contact: bool, limits: &RigLimits) -> f64 {
    unlimited_s(sweep, if is_contact { CONTACT_TIME } else { NO_LOAD_TIME }, limits)
}

fn unlimited_s(sweep: &SweepRequest, adaptive: AdaptiveTime, limits: &RigLimits) -> f64 {
    let longer_s = |cycles: u32| longer_s(limits, f64::from(cycles) / middle_hz(sweep));
    match sweep.method {
        SweepMethod::Adaptive | SweepMethod::Survey { .. } => {
            let AdaptiveTime { time_constants, s_hz2 } = adaptive;
            time_constants * time_constant_s(sweep)
                + s_hz2 / sweep.target_sigma_hz.powi(2)
                + SWEEP_READINGS * longer_s(SWEEP_CYCLES)
        }
        SweepMethod::Uniform { points } => {
            let integration_s = f64::from(sweep.cycles) / middle_hz(sweep);
            f64::from(points) * (sweep.settle_s + integration_s + longer_s(sweep.cycles))
        }
    }
}

/// Time constant of the free decay of the sensor, s.
fn time_constant_s(sweep: &SweepRequest) -> f64 {
    ASSUMED_Q / (PI * middle_hz(sweep))
}

fn middle_hz(sweep: &SweepRequest) -> f64 {
    0.5 * (sweep.window.min_hz + sweep.window.max_hz)
}
