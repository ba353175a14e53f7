//! The records of a run, sorted by kind.

use std::fmt::Write as _;

use rig_record::{
    Clearance, Direction, Prompt, Record, RefusedTouch, RunStarted, Sample, StoredRecord, Sweep,
    SweepOutcome, Touch, TouchSettings, UnreadableRecord,
};

use crate::units::duration;

/// The directions, in the order of their indices in the analysis.
pub(crate) const DIRECTIONS: [Direction; 3] = [Direction::Front, Direction::Back, Direction::Left];

/// The records of a run, by kind.
#[derive(Debug, Default)]
pub(crate) struct RunData {
    /// The first record, unless the journal is damaged there.
    pub(crate) started: Option<RunStarted>,
    /// Time of the first record on the rig's clock, µs.
    pub(crate) begin_us: u64,
    /// Time of the last record on the rig's clock, µs.
    pub(crate) end_us: u64,
    /// Every sweep, in order.
    pub(crate) sweeps: Vec<Sweep>,
    /// Every touch that gave a shift, in order.
    pub(crate) touches: Vec<Touch>,
    /// Every planned touch, in order, with its outcome.
    pub(crate) planned: Vec<PlannedTouch>,
    /// Number of answered prompts.
    pub(crate) prompts: u32,
    /// Prompts, commands, faults and refused sweeps, in order.
    pub(crate) log: Vec<LogEntry>,
    /// Cause of the first fault.
    pub(crate) fault: Option<String>,
}

/// A planned touch.
#[derive(Debug)]
pub(crate) struct PlannedTouch {
    /// Address, sample, pose and repeat.
    pub(crate) settings: TouchSettings,
    /// Time of its beginning: UTC, RFC 3339.
    pub(crate) began_at: Option<String>,
    /// `None` when it has not ended.
    pub(crate) outcome: Option<Outcome>,
}

/// The outcome of a touch.
#[derive(Debug)]
pub(crate) enum Outcome {
    /// It gave a shift: its index in [`RunData::touches`].
    Measured(usize),
    /// It gave no shift.
    Refused(Box<RefusedTouch>),
}

/// A line of the log.
#[derive(Debug)]
pub(crate) struct LogEntry {
    /// Time on the rig's clock, µs.
    pub(crate) rig_us: u64,
    /// The step in which it happened.
    pub(crate) step: Option<String>,
    pub(crate) kind: LogKind,
    /// The event in words.
    pub(crate) text: String,
}

/// The kind of a line of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LogKind {
    /// A person was asked or answered.
    Prompt,
    /// A person gave a command.
    Command,
    /// Something failed.
    Fault,
    /// A sweep gave no resonance.
    Refusal,
    /// The last frames of a port were kept.
    BlackBox,
}

impl LogKind {
    /// The word in the log.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Prompt => "prompt",
            Self::Command => "command",
            Self::Fault => "fault",
            Self::Refusal => "refused sweep",
            Self::BlackBox => "black box",
        }
    }
}

impl RunData {
    /// Sorts the records of a run.
    pub(crate) fn read(records: &[StoredRecord]) -> Result<Self, UnreadableRecord> {
        let mut data = Self {
            begin_us: records.first().map_or(0, |first| first.rig_us),
            end_us: records.last().map_or(0, |last| last.rig_us),
            ..Self::default()
        };
        for stored in records {
            data.take(stored, stored.record()?);
        }
        Ok(data)
    }

    /// Time from the first record to the last on the rig's clock, s.
    pub(crate) fn rig_s(&self) -> f64 {
        (self.end_us - self.begin_us) as f64 / 1e6
    }

    /// The samples, in the protocol's order.
    pub(crate) fn samples(&self) -> &[Sample] {
        self.started.as_ref().map_or(&[], |started| &started.samples)
    }

    /// The faults in the log.
    pub(crate) fn faults(&self) -> impl Iterator<Item = &LogEntry> {
        self.log.iter().filter(|entry| entry.kind == LogKind::Fault)
    }

    /// The sweep with this number.
    pub(crate) fn sweep(&self, number: u64) -> Option<&Sweep> {
        self.sweeps.iter().find(|sweep| sweep.number == number)
    }

    /// Whether no real device took part.
    pub(crate) fn is_simulated(&self) -> bool {
        self.started.as_ref().is_some_and(|started| started.is_simulated)
    }

    /// Index of the sample with this name.
    pub(crate) fn sample(&self, name: &str) -> Option<usize> {
        self.samples().iter().position(|sample| sample.name == name)
    }

    /// Records the outcome of the touch at an address.
    fn end_touch(&mut self, step: &str, outcome: Outcome) {
        if let Some(planned) = self.planned(step) {
            planned.outcome = Some(outcome);
        }
    }

    /// The planned touch at an address.
    fn planned(&mut self, step: &str) -> Option<&mut PlannedTouch> {
        self.planned.iter_mut().find(|planned| planned.settings.step == step)
    }

    /// Adds an answer to the line of its prompt.
    fn answer(&mut self, rig_us: u64, by: &str) {
        self.prompts += 1;
        let is_question = |entry: &&mut LogEntry| entry.kind == LogKind::Prompt;
        if let Some(asked) = self.log.iter_mut().rev().find(is_question) {
            let waited = duration((rig_us - asked.rig_us) as f64 / 1e6);
            write!(asked.text, "; done after {waited}, says {by}")
                .expect("a string takes all text");
        }
    }

    fn take(&mut self, stored: &StoredRecord, record: Record) {
        let rig_us = stored.rig_us;
        let mut note = |step: Option<String>, kind, text| {
            self.log.push(LogEntry { rig_us, step, kind, text });
        };
        match record {
            Record::RunStarted(mut started) => {
                let touches = std::mem::take(&mut started.touches);
                self.planned = touches.into_iter().map(PlannedTouch::new).collect();
                self.started = Some(started);
            }
            Record::StepStarted(begun) => {
                if let Some(planned) = self.planned(&begun.step) {
                    planned.began_at.clone_from(&stored.at);
                }
            }
            Record::PromptAsked(asked) => {
                note(Some(asked.step), LogKind::Prompt, request(&asked.prompt));
            }
            Record::PromptAnswered(answered) => self.answer(rig_us, &answered.by),
            Record::Operator(operator) => {
                note(None, LogKind::Command, format!("{} by {}", operator.action, operator.who));
            }
            Record::Fault(fault) => {
                let probe = match fault.probe {
                    Clearance::Clear => "clear",
                    Clearance::InContact => "in contact",
                    Clearance::Unknown => "at an unknown position",
                };
                let text = format!("{}. The probe was {probe}. {}", fault.cause, fault.hint);
                self.fault.get_or_insert(fault.cause);
                note(fault.step, LogKind::Fault, text);
            }
            Record::Sweep(sweep) => {
                if let SweepOutcome::Refused { reason } = &sweep.outcome {
                    let text = format!("sweep {}: {reason}", sweep.number);
                    note(sweep.step.clone(), LogKind::Refusal, text);
                }
                self.sweeps.push(sweep);
            }
            Record::TouchResult(touch) => {
                self.end_touch(&touch.touch.step, Outcome::Measured(self.touches.len()));
                self.touches.push(touch);
            }
            Record::TouchRefused(refused) => {
                let step = refused.touch.step.clone();
                self.end_touch(&step, Outcome::Refused(Box::new(refused)));
            }
            Record::BlackBox(kept) => {
                let (count, port) = (kept.frames.len(), kept.port);
                let text = format!("the last frames on {port} are in the journal ({count})");
                note(None, LogKind::BlackBox, text);
            }
            Record::Intent(_)
            | Record::Moved(_)
            | Record::SurfaceFound(_)
            | Record::SurfaceNotFound(_)
            | Record::StateChanged(_)
            | Record::RunFinished(_) => {}
        }
    }
}

impl PlannedTouch {
    const fn new(settings: TouchSettings) -> Self {
        Self { settings, began_at: None, outcome: None }
    }
}

/// A prompt in words.
fn request(prompt: &Prompt) -> String {
    match prompt {
        Prompt::PlaceSample { sample } => format!("place sample {sample} under the probe"),
        Prompt::TurnSensor { orientation } => {
            format!("turn the sensor to its {orientation} position")
        }
    }
}
