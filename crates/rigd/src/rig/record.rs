//! The events of the engine as records of the journal.
//!
//! The engine refers to samples and steps by index; a record is complete without the plan. The
//! recorder of a run knows the plan and its position in it.

mod values;

use std::sync::Arc;

use rig_engine::{
    Contact, Descended, Event, Fault, FinishedSweep, Jump, SweepPurpose, TouchOutcome, TouchResult,
};
use rig_link::{Flow, Frame, Transcript};
use rig_model::{Clearance, Mm, Position};
use rig_protocol::{Action, Plan, Prompt, Step, StepId, Touch};
use rig_resonance::FitOutcome;
use rig_store as store;
use rig_store::Record;

use self::values::{
    circuit_of, clearance_of, descent_of, ending_of, extra_of, fit_settings, onset_of, phase_of,
    pose_of, reading_of, size, tried,
};
use super::{Setting, resume};
use crate::{aim, hint, protocol_file::LoadedProtocol};

/// Turns the events of one journal into its records.
#[derive(Debug)]
pub(super) struct Recorder {
    plan: Option<Arc<Plan>>,
    /// The step under way.
    index: Option<usize>,
    /// The number of the last sweep.
    sweeps: u64,
    /// The last sweep with the probe clear.
    no_load_sweep: u64,
    /// The last two accepted sweeps in contact, the older one first.
    accepted_sweeps: [u64; 2],
    /// The sweeps of the last touch: with the probe clear, the last one in contact, and the one halfway.
    touch_sweeps: [u64; 3],
    /// The last read-back of the linear stage.
    linear: Option<Position<Mm>>,
}

impl Recorder {
    /// For the journal between runs.
    pub(super) const fn for_session() -> Self {
        Self {
            plan: None,
            index: None,
            sweeps: 0,
            no_load_sweep: 0,
            accepted_sweeps: [0; 2],
            touch_sweeps: [0; 3],
            linear: None,
        }
    }

    /// For the journal of a run or of an amendment; `sweeps` is the number of its last sweep, 0 at
    /// its beginning.
    pub(super) fn for_plan(plan: Arc<Plan>, sweeps: u64) -> Self {
        Self { plan: Some(plan), sweeps, ..Self::for_session() }
    }

    /// The journal goes on after a run, which has moved the linear stage.
    pub(super) fn follow(&mut self, run: &Self) {
        self.linear = run.linear.or(self.linear);
    }

    /// The names of the samples.
    pub(super) fn samples(&self) -> &[String] {
        self.plan.as_ref().map_or(&[], |plan| &plan.samples)
    }

    /// The first record of a run.
    pub(super) fn run_started(
        protocol: &LoadedProtocol,
        setting: &Setting,
        known_samples: &[(String, f64)],
    ) -> store::RunStarted {
        let plan = &protocol.plan;
        let is_prompt = |step: &&Step| matches!(step.action, Action::Prompt(_));
        let sample = |name: &String| store::Sample {
            name: name.clone(),
            stiffness_mpa: known_samples
                .iter()
                .find(|(known, _)| known == name)
                .map(|&(_, stiffness_mpa)| stiffness_mpa),
        };
        let touch = |step: &Step| match step.action {
            Action::Touch(touch) => Some(touch_settings(&step.id, &touch, &plan.samples)),
            _ => None,
        };
        let touches: Vec<_> = plan.steps.iter().filter_map(touch).collect();
        store::RunStarted {
            software: resume::SOFTWARE.to_owned(),
            seed: plan.seed,
            protocol: protocol.source.clone(),
            rig: setting.rig.clone(),
            is_simulated: setting.scene.is_some(),
            scene: setting.scene.clone(),
            devices: resume::devices(setting),
            calibrations: Vec::new(),
            samples: plan.samples.iter().map(sample).collect(),
            plan: store::PlanSize {
                steps: size(plan.steps.len()),
                touches: size(touches.len()),
                prompts: size(plan.steps.iter().filter(is_prompt).count()),
            },
            touches,
            classes: plan.classes.map(size),
            expected: None,
            aim: plan.aim.as_ref().map(aim::recorded),
            idempotency_key: None,
        }
    }

    /// The record of an event; a few events have none.
    pub(super) fn record(&mut self, event: &Event) -> Option<Record> {
        Some(match event {
            Event::StateChanged(word) => Record::StateChanged(store::StateChanged {
                state: word.name().to_owned(),
                reason: None,
            }),
            Event::StepStarted { index } => {
                self.index = Some(*index);
                let (plan, step) = (self.plan.as_ref()?, self.step()?);
                Record::StepStarted(store::StepStarted {
                    step: step.id.to_string(),
                    index: size(index + 1),
                    count: size(plan.steps.len()),
                    action: self.action(&step.action),
                })
            }
            Event::PromptAsked(prompt) => Record::PromptAsked(store::PromptAsked {
                step: self.step_id()?,
                prompt: self.prompt(prompt),
            }),
            Event::PromptAnswered { by, .. } => Record::PromptAnswered(store::PromptAnswered {
                step: self.step_id()?,
                by: by.clone(),
            }),
            Event::RefusalAsked { .. } | Event::RefusalAnswered { .. } => self.refusal(event)?,
            Event::Intent { down_to, purpose } => Record::Intent(store::Intent {
                what: purpose_of(*purpose),
                axis: store::Axis::LinearMm,
                from: self.linear.map(Position::value),
                to: down_to.value(),
                limit: Some(down_to.value()),
            }),
            &Event::LinearMoved { target, read_back, is_clear } => {
                self.linear = Some(read_back);
                moved(store::Axis::LinearMm, target.value(), read_back.value(), is_clear)
            }
            &Event::RotaryMoved { target, read_back } => {
                moved(store::Axis::RotaryDeg, target.value(), read_back.value(), false)
            }
            Event::Descended(descended) => self.descended(descended)?,
            Event::SurfaceFound { .. }
            | Event::SurfaceNotFound { .. }
            | Event::SurfaceChecked { .. } => self.search(event)?,
            // Watched while it happens; the journal has the sweep when it is finished.
            Event::Planned { .. } | Event::SweepBegun { .. } | Event::Measured { .. } => {
                return None;
            }
            Event::SweepFinished(outcome) => self.sweep(outcome),
            Event::TouchFinished(result) => self.touch_of_last_sweeps(result),
            Event::TouchDoubted(result) => self.touch(result),
            Event::ReferenceJumped { .. } => self.jumped(event)?,
            Event::Operator { action, by } => {
                Record::Operator(store::Operator { action: (*action).to_owned(), who: by.clone() })
            }
            Event::Faulted { fault, clearance } => self.fault(fault, *clearance),
            Event::RetractTried { attempt, fault, clearance } => {
                Record::RetractTried(store::RetractTried {
                    attempt: *attempt,
                    cause: fault.as_ref().map(ToString::to_string),
                    probe: clearance_of(*clearance),
                })
            }
            &Event::Stalled { lasted, is_measured_again } => Record::Stalled(store::Stalled {
                stalled_s: lasted.as_secs_f64(),
                is_measured_again,
            }),
            Event::RunFinished(status) => {
                Record::RunFinished(store::RunFinished { status: ending_of(*status) })
            }
        })
    }

    /// The record of a jump of the free resonance.
    fn jumped(&self, event: &Event) -> Option<Record> {
        let Event::ReferenceJumped { off_hz, sigma_hz, touches } = event else { return None };
        Some(Record::ReferenceJumped(store::ReferenceJumped {
            no_load_sweep: self.touch_sweeps[0],
            next_no_load_sweep: self.no_load_sweep,
            off_hz: *off_hz,
            sigma_hz: *sigma_hz,
            touches: touches.iter().map(ToString::to_string).collect(),
        }))
    }

    /// The record of a question about a refused touch, or of its answer.
    fn refusal(&self, event: &Event) -> Option<Record> {
        let step = self.step_id()?;
        Some(match event {
            Event::RefusalAsked { refusal } => {
                let reason = refusal.to_string();
                Record::RefusalAsked(store::RefusalAsked { step, reason })
            }
            Event::RefusalAnswered { answer, by, refusal, window } => {
                Record::RefusalAnswered(store::RefusalAnswered {
                    step,
                    reason: refusal.to_string(),
                    answer: answer.name().to_owned(),
                    by: by.clone(),
                    window_hz: window.map(|window| [window.min_hz, window.max_hz]),
                })
            }
            _ => return None,
        })
    }

    /// The record of a search for the surface.
    fn search(&self, event: &Event) -> Option<Record> {
        let (step, pose) = (self.step_id()?, self.pose()?);
        let tried = |trail: &[_]| trail.iter().map(tried).collect();
        Some(match event {
            Event::SurfaceFound { position, sigma_mm, onset, trail } => {
                Record::SurfaceFound(store::Surface {
                    step,
                    pose,
                    position_mm: position.value(),
                    sigma_mm: *sigma_mm,
                    onset: onset.as_ref().map(onset_of),
                    trail: tried(trail),
                })
            }
            Event::SurfaceNotFound { trail, reason } => {
                let (trail, reason) = (tried(trail), reason.clone());
                Record::SurfaceNotFound(store::LostSurface { step, pose, trail, reason })
            }
            Event::SurfaceChecked { trail } => {
                Record::SurfaceChecked(store::CheckedSurface { step, pose, trail: tried(trail) })
            }
            _ => return None,
        })
    }

    fn descended(&mut self, descended: &Descended) -> Option<Record> {
        self.linear = Some(descended.read_back);
        Some(Record::Descended(descent_of(self.step_id()?, self.pose()?, descended)))
    }

    fn fault(&self, fault: &Fault, clearance: Clearance) -> Record {
        Record::Fault(store::Fault {
            step: self.step_id(),
            cause: fault.to_string(),
            probe: clearance_of(clearance),
            hint: hint::after(fault, clearance).text.to_owned(),
            last_moves_mm: fault
                .jump()
                .map(|Jump { last_moves, .. }| [last_moves.min.value(), last_moves.max.value()]),
        })
    }

    fn step(&self) -> Option<&Step> {
        self.plan.as_ref()?.steps.get(self.index?)
    }

    /// Address of the step under way.
    pub(super) fn step_id(&self) -> Option<String> {
        self.step().map(|step| step.id.to_string())
    }

    fn pose(&self) -> Option<store::Pose> {
        match self.step()?.action {
            Action::NoLoad(pose) => Some(pose_of(pose)),
            Action::Touch(touch) => Some(pose_of(touch.pose)),
            Action::Prompt(_) => None,
        }
    }

    fn sample(&self, index: usize) -> String {
        self.samples().get(index).cloned().unwrap_or_default()
    }

    fn prompt(&self, prompt: &Prompt) -> store::Prompt {
        match *prompt {
            Prompt::PlaceSample { sample } => {
                store::Prompt::PlaceSample { sample: self.sample(sample) }
            }
            Prompt::TurnSensor { orientation } => {
                store::Prompt::TurnSensor { orientation: orientation.name().to_owned() }
            }
        }
    }

    fn action(&self, action: &Action) -> store::Action {
        match action {
            Action::Prompt(prompt) => store::Action::Prompt { prompt: self.prompt(prompt) },
            Action::NoLoad(pose) => store::Action::NoLoad { pose: pose_of(*pose) },
            Action::Touch(touch) => store::Action::Touch {
                phase: phase_of(touch.phase),
                sample: self.sample(touch.sample),
                pose: pose_of(touch.pose),
                repeat: touch.repeat,
            },
        }
    }

    /// A sweep is begun by hand. It has its number from the beginning, also when it never ends.
    pub(super) const fn begin_sweep(&mut self) -> u64 {
        self.sweeps += 1;
        self.sweeps
    }

    fn sweep(&mut self, finished: &FinishedSweep) -> Record {
        if finished.purpose != SweepPurpose::Manual {
            self.sweeps += 1;
        }
        if finished.purpose == SweepPurpose::NoLoad {
            self.no_load_sweep = self.sweeps;
        }
        if finished.purpose == SweepPurpose::Touch
            && matches!(finished.outcome, FitOutcome::Accepted(_))
        {
            self.accepted_sweeps = [self.accepted_sweeps[1], self.sweeps];
        }
        let outcome = match &finished.outcome {
            FitOutcome::Accepted(resonance) => store::SweepOutcome::Accepted {
                resonance_hz: resonance.resonance_hz,
                sigma_hz: resonance.sigma_hz,
                effective_time_s: finished.effective_time_s,
                circuit: Some(store::Circuit {
                    loss_tangent: resonance.loss_tangent,
                    loss_tangent_sigma: resonance.loss_tangent_sigma(),
                    quality_factor_sigma: Some(resonance.q_sigma()),
                    static_capacitance_sigma_f: Some(resonance.c0_sigma_farad()),
                    capacitance_ratio_sigma: Some(resonance.capacitance_ratio_sigma()),
                    ..circuit_of(&resonance.circuit())
                }),
                extra: resonance.extra.as_ref().map(extra_of),
                left_out: usable(finished).saturating_sub(resonance.points),
            },
            FitOutcome::Refused(refusal) => {
                store::SweepOutcome::Refused { reason: refusal.to_string() }
            }
        };
        Record::Sweep(store::Sweep {
            number: self.sweeps,
            purpose: match finished.purpose {
                SweepPurpose::NoLoad => store::SweepPurpose::NoLoad,
                SweepPurpose::Touch => store::SweepPurpose::Touch,
                SweepPurpose::Manual => store::SweepPurpose::Manual,
            },
            step: self.step_id(),
            pose: self.pose(),
            level_v: Some(finished.level.volt),
            readings: finished.readings.iter().map(reading_of).collect(),
            probe_readings: finished.probe_readings,
            fit: fit_settings(finished),
            outcome,
        })
    }

    fn touch_of_last_sweeps(&mut self, result: &TouchResult) -> Record {
        let sweeps = [self.no_load_sweep, self.sweeps, self.accepted_sweeps[0]];
        let before = std::mem::replace(&mut self.touch_sweeps, sweeps);
        let record = self.touch(result);
        if matches!(&result.outcome, TouchOutcome::Refused { contact: None, .. }) {
            // The touch before it may still be doubted.
            self.touch_sweeps = before;
        }
        record
    }

    /// A touch, also one that is doubted after further sweeps.
    fn touch(&self, result: &TouchResult) -> Record {
        let touch = touch_settings(&result.step, &result.touch, self.samples());
        let [no_load_sweep, sweep, halfway_sweep] = self.touch_sweeps;
        let no_load = &result.no_load;
        let (no_load_hz, no_load_sigma_hz) = (no_load.resonance_hz, no_load.sigma_hz);
        let rotary_deg = result.rotary.value();
        let indented = |contact: &Contact| store::TouchPosition {
            sweep,
            surface_mm: contact.surface.position.value(),
            surface_sigma_mm: contact.surface.sigma_mm,
            indentation_mm: contact.indentation_mm(),
            linear_mm: contact.linear.value(),
        };
        let (contact, loaded, halfway, drift_sigma_hz) = match &result.outcome {
            TouchOutcome::Measured { contact, loaded, halfway, drift_sigma_hz } => {
                (contact, loaded, halfway, *drift_sigma_hz)
            }
            TouchOutcome::Refused { contact, refusal } => {
                return Record::TouchRefused(store::RefusedTouch {
                    touch,
                    reason: refusal.to_string(),
                    no_load_sweep,
                    no_load_hz,
                    no_load_sigma_hz,
                    rotary_deg,
                    indented: contact.as_ref().map(indented),
                });
            }
        };
        let store::TouchPosition { sweep, surface_mm, surface_sigma_mm, indentation_mm, linear_mm } =
            indented(contact);
        Record::TouchResult(store::Touch {
            touch,
            no_load_sweep,
            no_load_hz,
            no_load_sigma_hz,
            drift_sigma_hz,
            sweep,
            resonance_hz: loaded.resonance_hz,
            sigma_hz: loaded.sigma_hz,
            shift_hz: loaded.resonance_hz - no_load_hz,
            shift_sigma_hz: loaded.sigma_hz.hypot(no_load_sigma_hz).hypot(drift_sigma_hz),
            surface_mm,
            surface_sigma_mm,
            indentation_mm,
            linear_mm,
            rotary_deg,
            is_slip_checked: self.plan.as_ref().map(|plan| plan.touch.approach.has_slip_check()),
            halfway: halfway.as_ref().map(|halfway| store::Halfway {
                sweep: halfway_sweep,
                resonance_hz: halfway.loaded.resonance_hz,
                sigma_hz: halfway.loaded.sigma_hz,
                indentation_mm: halfway.contact.indentation_mm(),
                linear_mm: halfway.contact.linear.value(),
            }),
        })
    }
}

fn touch_settings(step: &StepId, touch: &Touch, samples: &[String]) -> store::TouchSettings {
    store::TouchSettings {
        step: step.to_string(),
        phase: phase_of(touch.phase),
        sample: samples.get(touch.sample).cloned().unwrap_or_default(),
        pose: pose_of(touch.pose),
        repeat: touch.repeat,
    }
}

/// The last frames of a port, as they are now.
pub(super) fn black_box(port: &str, transcript: &Transcript) -> Record {
    Record::BlackBox(frames(port, transcript))
}

/// The last frames of a port.
pub(super) fn frames(port: &str, transcript: &Transcript) -> store::BlackBox {
    let digit = |half: u8| char::from(b"0123456789abcdef"[usize::from(half)]);
    let frame = |frame: Frame| store::Frame {
        rig_us: frame.at.as_micros(),
        is_sent: frame.flow == Flow::Sent,
        hex: frame.bytes.iter().flat_map(|byte| [byte >> 4, byte & 15].map(digit)).collect(),
    };
    let frames = transcript.frames().into_iter().map(frame).collect();
    store::BlackBox { port: port.to_owned(), frames }
}

const fn moved(axis: store::Axis, target: f64, read_back: f64, is_clear: bool) -> Record {
    Record::Moved(store::Move { axis, target, read_back, is_clear })
}

const fn purpose_of(purpose: rig_engine::LoweringPurpose) -> store::MoveReason {
    match purpose {
        rig_engine::LoweringPurpose::FindSurface => store::MoveReason::Approach,
        rig_engine::LoweringPurpose::Indent => store::MoveReason::Indent,
        rig_engine::LoweringPurpose::ByHand => store::MoveReason::ByHand,
    }
}

/// Number of readings of a sweep that have a value, without those of the contact sense.
fn usable(finished: &FinishedSweep) -> usize {
    let readings = finished.readings.iter().skip(finished.probe_readings);
    readings.filter(|reading| reading.impedance().is_some()).count()
}
