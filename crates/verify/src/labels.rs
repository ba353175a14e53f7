//! What was measured where: steps and prompts against the plan; sweeps, surfaces and touches have modules
//! of their own.

mod attempt;
mod bench;
mod contact;
mod descent;
mod noise;
mod plan;
mod reference;
mod sweep;
mod touch;

pub(crate) use sweep::{CLOCK_SLACK_S, READINGS_PER_OUTLIER};
pub(crate) use touch::{check_depth, check_shift};

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    finding::{Check, Findings},
    journal::Journal,
    layout::{NoLoad, Planned},
    motion::{Descent, Motion, Probe, Turn},
    record::{
        Action, Circuit, Descended, Pose, Prompt, PromptAnswered, PromptAsked, Resumed,
        StepStarted, Touch, TouchResult,
    },
    settings::{Protocol, Settings, orientation, tilt_deg},
    surface,
};

/// A standstill is noticed at most this late, s.
const BEAT_S: f64 = 0.15;
/// A finished sweep.
#[derive(Debug, Clone)]
struct SweepFacts {
    number: u64,
    purpose: String,
    step: Option<String>,
    /// Resonance and its standard deviation, Hz, or the reason of the refusal.
    outcome: Result<(f64, f64), String>,
    /// The circuit that was found.
    circuit: Option<Circuit>,
}

/// A sweep of the free sensor, by its record.
#[derive(Debug, Clone, Copy)]
struct FreeSweep {
    seq: u64,
    is_accepted: bool,
    /// Whether its step had what it was made for.
    is_over: bool,
}

/// A surface that was found.
#[derive(Debug, Clone)]
struct SurfaceFacts {
    step: String,
    position_mm: f64,
    sigma_mm: f64,
    /// The impedance at the last clear position, ohm.
    clear: Option<[f64; 2]>,
}

/// The step under way.
#[derive(Debug, Clone)]
struct Step {
    seq: u64,
    started: StepStarted,
    /// Whether it has what it was made for.
    is_done: bool,
}

/// The labels so far.
#[derive(Debug, Default)]
pub(crate) struct Labels {
    planned: Vec<Touch>,
    /// The steps of the plan when the run began; none if they cannot be known.
    whole: Vec<Planned>,
    /// Those since the run last went on.
    layout: Vec<Planned>,
    no_load: Option<NoLoad>,
    steps: u32,
    step: Option<Step>,
    index: u32,
    touches: usize,
    sample: Option<String>,
    orientation: Option<String>,
    sweeps: u64,
    sweep: Option<SweepFacts>,
    /// When the last accepted sweep in contact ended, s.
    swept_s: f64,
    /// Number of refused sweeps in contact of the step under way.
    refused_sweeps: u32,
    /// What the attempt under way of the touch has come to.
    attempt: attempt::Attempt,
    noise: noise::NoiseChain,
    bench: bench::BenchChain,
    /// The last sweep with the probe clear that was accepted, and the touches since then.
    reference: Option<SweepFacts>,
    pub(crate) references: reference::References,
    surface: Option<SurfaceFacts>,
    /// The last descent of the touch under way, until a search in steps follows.
    descended: Option<Descended>,
    /// The read-back after the indentation, mm, until the next surface.
    indented_mm: Option<f64>,
    /// The first accepted sweep in contact since the surface was found, and the read-back before it, mm.
    halfway: Option<(SweepFacts, f64)>,
    /// What was found of the surface after the sweep; `None` before it was looked for.
    again: Option<surface::Again>,
    /// The window of the sweep in contact after it was widened, Hz.
    window: Option<[f64; 2]>,
    /// The last reading may not begin before this, s.
    free_s: f64,
    /// The record of the result of each touch.
    results: BTreeMap<String, u64>,
    refused: BTreeSet<String>,
    /// The last touch with a result, until it is contradicted.
    last: Option<TouchResult>,
    elsewhere: BTreeSet<String>,
    done_elsewhere: BTreeMap<u64, BTreeMap<String, bool>>,
    /// The largest number of a sweep in another record of the same touches, before each sweep.
    numbered: BTreeMap<u64, u64>,
    /// When the computer was held up, s on the rig's clock.
    standstills: Vec<(f64, f64)>,
    /// Whether the protocol ends the run with the refused touch before.
    is_ended_by_refusal: bool,
    /// Why the last touch is said to be contradicted, and the last fault.
    contradiction: Option<(u64, String)>,
    fault: Option<String>,
    /// The last no-load sweep since the last step began.
    free: Option<FreeSweep>,
    /// Whether the next step may have any number.
    is_anew: bool,
    is_amendment: bool,
}

impl Labels {
    /// Touches may have an outcome in an amendment, whose sweeps are numbered together with those of the
    /// run.
    pub(crate) fn new(journal: &Journal) -> Self {
        let elsewhere = journal.elsewhere().cloned().collect();
        let (numbered, done_elsewhere) = (journal.numbered.clone(), journal.done_elsewhere.clone());
        Self { elsewhere, done_elsewhere, numbered, ..Self::default() }
    }

    /// A touch of another run is measured again, with the steps that it needs alone.
    pub(crate) fn amend(&mut self, touch: Option<Touch>, protocol: Option<&Protocol>) {
        self.is_amendment = true;
        self.lay_out(touch.into_iter().collect(), protocol);
        self.steps = plan::size(&self.layout);
    }

    /// Whether the steps are those of an amendment whose run is not known.
    fn is_unplanned(&self) -> bool {
        self.is_amendment && self.layout.is_empty()
    }

    /// A run goes on: the sample and the sensor are mounted again, and a reference is measured again.
    pub(crate) fn resume(&mut self, seq: u64, resumed: &Resumed, findings: &mut Findings) {
        self.lay_out_rest(seq, resumed, findings);
        (self.step, self.sample, self.orientation, self.reference) = (None, None, None, None);
        self.references = reference::References::default();
        (self.surface, self.indented_mm, self.free_s) = (None, None, 0.0);
        self.halfway = None;
        self.again = None;
        self.attempt = attempt::Attempt::default();
        self.bench = bench::BenchChain::default();
        (self.contradiction, self.fault, self.is_ended_by_refusal) = (None, None, false);
        self.free = None;
        self.standstills.clear();
        self.is_anew = self.layout.is_empty();
    }

    /// The computer was held up until now: no reading is of that time. A standstill is noticed at a beat.
    pub(crate) fn stalled(&mut self, rig_us: u64, stalled_s: f64) {
        let end_s = rig_us as f64 / 1e6;
        let standstill = (end_s - stalled_s + BEAT_S, end_s - BEAT_S);
        self.standstills.push(standstill);
    }

    pub(crate) fn step_started(
        &mut self,
        (seq, rig_us): (u64, u64),
        started: StepStarted,
        motion: &mut Motion,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        self.check_contradiction(findings);
        self.check_closed(false, findings);
        self.bench.step_started(findings);
        self.references.no_jump(findings);
        self.goes_on(seq, findings);
        self.step_ended(motion.fault.is_some(), findings);
        let is_anew = std::mem::take(&mut self.is_anew) || self.is_unplanned();
        let is_ahead = self.pass_amended(&started.step) && started.index > self.index;
        let is_by_drift = settings.is_some_and(|all| all.protocol.is_by_drift());
        let is_left_out = is_by_drift && self.references.may_leave_out(self.index, &started);
        self.references.step_started(rig_us, &started, is_left_out);
        let (next, count) = (self.index + 1 + u32::from(is_left_out), self.steps);
        if !is_anew
            && (started.index, started.count) != (next, count)
            && !(is_ahead && started.count == count)
        {
            let found = format!("step {} of {}", started.index, started.count);
            let expected = format!("step {next} of {count}");
            findings.add(Check::StepOrder, seq, "a step out of order", expected, found);
        }
        if let Some(fault) = motion.fault {
            let found = format!("a step after the fault of record {fault}");
            findings.add(Check::Stopped, seq, "a run ends with its fault", "no step", found);
        }
        if is_anew {
            self.steps = started.count;
        } else {
            self.check_place(seq, &started, findings);
        }
        self.index = started.index;
        motion.turn = match &started.action {
            Action::Prompt { prompt: Prompt::PlaceSample { .. } } => Turn::To(0.0),
            Action::Prompt { .. } => Turn::Forbidden,
            Action::NoLoad { pose } | Action::Touch { pose, .. } => {
                tilt_deg(&pose.direction, pose.angle_deg).map_or(Turn::Forbidden, Turn::To)
            }
        };
        if !self.is_unplanned() {
            self.check_address(seq, &started, findings);
        }
        if let Action::NoLoad { pose } | Action::Touch { pose, .. } = &started.action {
            self.check_mounting(seq, pose, findings);
        }
        if let Action::Touch { sample, .. } = &started.action {
            self.touches += 1;
            if self.sample.as_ref() != Some(sample) {
                let placed = self.sample.as_deref().unwrap_or("none");
                let what = "the sample of a touch is not the one under the probe";
                findings.add(Check::Sample, seq, what, placed, sample);
            }
        }
        (self.surface, self.indented_mm, self.again) = (None, None, None);
        (self.window, self.refused_sweeps, self.halfway) = (None, 0, None);
        self.attempt = attempt::Attempt::default();
        self.step = Some(Step { seq, started, is_done: false });
    }

    /// A touch that was amended need not be made. Returns whether one was passed.
    fn pass_amended(&mut self, step: &str) -> bool {
        let is_passed = |touch: &Touch| {
            let Touch { step: amended, .. } = touch;
            self.elsewhere.contains(amended) && !is_of_touch(step, amended)
        };
        let passed = self.planned.iter().skip(self.touches).take_while(|t| is_passed(t)).count();
        self.touches += passed;
        passed > 0
    }

    /// A step belongs to the next touch of the plan.
    fn check_address(&self, seq: u64, started: &StepStarted, findings: &mut Findings) {
        let Some(next) = self.planned.get(self.touches) else {
            let what = "a step behind the last touch of the plan";
            findings.add(Check::StepOrder, seq, what, "no step", &started.step);
            return;
        };
        let (expected, pose_matches) = match &started.action {
            Action::Touch { phase, sample, pose, repeat } => {
                let is_same = (phase, sample, pose, repeat)
                    == (&next.phase, &next.sample, &next.pose, &next.repeat);
                (next.step.clone(), is_same)
            }
            Action::NoLoad { pose } => (format!("{}/no-load", next.step), *pose == next.pose),
            Action::Prompt { prompt: Prompt::PlaceSample { sample } } => {
                (format!("{}/place-sample", next.step), *sample == next.sample)
            }
            Action::Prompt { prompt: Prompt::TurnSensor { orientation: turned } } => {
                let needed = orientation(&next.pose.direction);
                (format!("{}/turn-sensor", next.step), needed == Some(turned))
            }
        };
        if started.step != expected {
            let what = "the address of a step is not that of the next touch of the plan";
            findings.add(Check::StepOrder, seq, what, expected, &started.step);
        } else if !pose_matches {
            let what = "the action of a step is not that of the plan";
            findings.add(
                Check::Pose,
                seq,
                what,
                format!("{next:?}"),
                format!("{:?}", started.action),
            );
        }
    }

    fn check_mounting(&self, seq: u64, pose: &Pose, findings: &mut Findings) {
        let needed = orientation(&pose.direction);
        if needed.is_none() || self.orientation.as_deref() != needed {
            let found = self.orientation.as_deref().unwrap_or("none");
            let what = format!("the mounting of the sensor for {}", pose.direction);
            findings.add(Check::Orientation, seq, what, needed.unwrap_or("known"), found);
        }
    }

    /// The step under way has what it was made for, unless a fault or a person ended it.
    pub(crate) fn step_ended(&mut self, is_cut_short: bool, findings: &mut Findings) {
        let Some(step) = self.step.take().filter(|step| !step.is_done && !is_cut_short) else {
            return;
        };
        let (check, missing) = match step.started.action {
            Action::Prompt { .. } => (Check::StepOrder, "an answer"),
            Action::NoLoad { .. } => (Check::Reference, "an accepted sweep"),
            Action::Touch { .. } => (Check::Row, "a result or a refusal"),
        };
        let what = format!("step {} ended without {missing}", step.started.step);
        findings.add(check, step.seq, what, missing, "none");
    }

    pub(crate) fn asked(
        &mut self,
        seq: u64,
        asked: &PromptAsked,
        motion: &mut Motion,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let started = self.step.as_ref().map(|step| &step.started);
        let is_of_step = started.is_some_and(|started| {
            started.step == asked.step
                && started.action == Action::Prompt { prompt: asked.prompt.clone() }
        });
        if !is_of_step {
            let expected = format!("{:?}", started.map(|started| &started.action));
            let what = "a prompt that is not that of its step";
            findings.add(Check::StepOrder, seq, what, expected, format!("{:?}", asked.prompt));
        }
        if motion.probe != Probe::Clear {
            let what = "a person is sent to the bench while the probe is not shown clear";
            findings.add(Check::Stopped, seq, what, "clear", motion.probe.name());
        }
        if let (Prompt::PlaceSample { .. }, Some(settings)) = (&asked.prompt, settings) {
            let tilt = motion.rotary_deg.unwrap_or(f64::NAN);
            let tolerance = settings.rig.rotary.tolerance_deg;
            let what = "the tilt at which a sample is placed, °";
            findings.agree(Check::Pose, seq, what, (0.0, tilt), tolerance);
        }
        motion.is_waiting = true;
    }

    pub(crate) fn answered(
        &mut self,
        seq: u64,
        answered: &PromptAnswered,
        motion: &mut Motion,
        findings: &mut Findings,
    ) {
        let step = self.step.as_mut().filter(|step| step.started.step == answered.step);
        let Some(step) = step.filter(|_| motion.is_waiting) else {
            let what = "an answer without its prompt";
            findings.add(Check::StepOrder, seq, what, "a prompt at this step", &answered.step);
            return;
        };
        motion.is_waiting = false;
        step.is_done = true;
        match &step.started.action {
            Action::Prompt { prompt: Prompt::PlaceSample { sample } } => {
                self.sample = Some(sample.clone());
            }
            Action::Prompt { prompt: Prompt::TurnSensor { orientation } } => {
                self.orientation = Some(orientation.clone());
                self.references.turned();
            }
            _ => {}
        }
    }

    /// The read-back of an indentation.
    pub(crate) fn moved(&mut self, motion: &Motion, rig_us: u64, settings: Option<&Settings>) {
        self.free_s = rig_us as f64 / 1e6;
        self.left_depth();
        // Later moves of the same descent look for the surface again.
        let is_twice = settings.is_some_and(|all| all.protocol.touch.halfway_mm.is_some());
        let is_indentation = |descent: &Descent| {
            descent.what == "indent" && descent.moves.len() <= 1 + usize::from(is_twice)
        };
        if motion.descent.as_ref().is_some_and(is_indentation) {
            self.indented_mm = motion.linear_mm;
            self.free_s += settings.map_or(0.0, |settings| settings.protocol.touch.dwell_s);
        }
    }

    /// Whether every touch that has not begun is left out.
    fn is_rest_left_out(&self) -> bool {
        let rest = self.planned.get(self.touches..).unwrap_or_default();
        !rest.is_empty() && rest.iter().all(|touch| self.elsewhere.contains(&touch.step))
    }

    /// The rows of a run that has ended.
    pub(crate) fn finish(&mut self, seq: u64, status: &str, findings: &mut Findings) {
        self.references.no_jump(findings);
        let is_complete = status.starts_with("completed");
        if is_complete {
            self.goes_on(seq, findings);
            self.check_closed(true, findings);
        }
        let has_outcome =
            |step: &String| self.results.contains_key(step) || self.elsewhere.contains(step);
        let missing = self.planned.iter().filter(|touch| !has_outcome(&touch.step));
        for touch in missing.filter(|_| is_complete) {
            let what = format!("touch {} of a completed run", touch.step);
            findings.add(Check::Row, seq, what, "a result or a refusal", "none");
        }
        if is_complete && (status == "completed") != self.refused.is_empty() {
            let what = "the ending of the run";
            let found = format!("{status} with {} refused", self.refused.len());
            findings.add(Check::Ends, seq, what, "completed without refusals", found);
        }
        if is_complete && self.index != self.steps && !self.is_rest_left_out() {
            findings.add(Check::StepOrder, seq, "the last step of the run", self.steps, self.index);
        } else if is_complete {
            self.check_gap(seq, self.steps, findings);
        }
    }
}

/// Whether a step is a touch, or leads to it: `blind/1/no-load` is of `blind/1`, and `blind/10` is not.
fn is_of_touch(step: &str, touch: &str) -> bool {
    step.strip_prefix(touch).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}

/// Checks that the rotary stage stands as the pose says.
fn pose_is_taken(
    seq: u64,
    pose: &Pose,
    motion: &Motion,
    settings: &Settings,
    findings: &mut Findings,
) {
    let tilt = tilt_deg(&pose.direction, pose.angle_deg).unwrap_or(f64::NAN);
    let stands = motion.rotary_deg.unwrap_or(f64::NAN);
    let tolerance = settings.rig.rotary.tolerance_deg;
    findings.agree(Check::Pose, seq, "the tilt of the sample, °", (stands, tilt), tolerance);
}
