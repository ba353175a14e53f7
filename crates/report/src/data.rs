//! The records of a run, sorted by kind.

mod words;

use std::{collections::BTreeMap, fmt::Write as _};

use rig_record::{
    Amended, Amendment, Change, CitedCalibration, Confirmed, Direction, Expected, Intent,
    MoveReason, Record, RefusedTouch, Resumed, RunId, RunStarted, Sample, Source, StoredRecord,
    Sweep, SweepOutcome, Touch, TouchSettings, UnreadableRecord,
};

use self::words::{
    clock_set, decided, faulted, held_up, jump, kept_frames, request, retract_tried,
};
use crate::{
    between::Between,
    units::{duration, with_sigma},
};

/// The directions, in the order of their indices in the analysis.
pub(crate) const DIRECTIONS: [Direction; 3] = [Direction::Front, Direction::Back, Direction::Left];

/// The records of a run, by kind.
#[derive(Debug, Default)]
pub(crate) struct RunData {
    /// The first record, unless the journal is damaged there.
    pub(crate) started: Option<RunStarted>,
    /// Time of the last record since the beginning of the run, µs.
    pub(crate) end_us: u64,
    /// The part of it between an interruption and what ended it, µs.
    idle_us: u64,
    /// Every sweep, in order, also those of amendments.
    pub(crate) sweeps: Vec<Sweep>,
    /// The number of those before the first amendment.
    own_sweeps: Option<usize>,
    /// For each sweep: the time of the run at zero of the clock of its readings, s.
    pub(crate) clock_zeros_s: Vec<f64>,
    /// Every touch that gave a shift, in order; of one that was measured again, the last. Its reference is that between
    /// the one before it and the one after it.
    pub(crate) touches: Vec<Touch>,
    /// What lies between two references.
    pub(crate) between: Between,
    /// The epochs of the records, in order: each has a clock of its own.
    pub(crate) epochs: Vec<u64>,
    /// The amendment whose records are being read, and the time of the run to which it is added, µs.
    amendment: Option<(Amended, u64)>,
    /// Every planned touch, in order, with its outcome.
    pub(crate) planned: Vec<PlannedTouch>,
    /// What the touches rest on, one part of the run after the other.
    pub(crate) parts: Vec<Part>,
    /// For each event from which the run itself rests on another part: that part.
    run_parts: Vec<(u64, usize)>,
    /// The part whose records are being read.
    part: usize,
    /// The part of the touch with each sweep in contact.
    part_of: BTreeMap<u64, usize>,
    /// Which measured touches are confirmed.
    pub(crate) confirmed: Confirmed,
    /// Whether the surface was looked for again in the touch under way.
    has_slip_check: bool,
    /// Time in which surfaces were looked for, from the declaration of each search to its end, without amendments, s.
    pub(crate) surfaces_s: f64,
    /// When the search under way was declared, µs.
    search_us: Option<u64>,
    /// Number of answered prompts.
    pub(crate) prompts: u32,
    /// Prompts, commands, faults and refused sweeps, in order.
    pub(crate) log: Vec<LogEntry>,
    /// The operator who began the run, as of its first command.
    operator: Option<String>,
    /// Cause of the first fault of the last part of the run, without amendments.
    pub(crate) fault: Option<String>,
}

/// What touches rest on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Part {
    /// The rig file; `None` where it has changed, and an older journal does not have its text.
    pub(crate) rig: Option<Source>,
    /// The calibrations that hold.
    pub(crate) calibrations: Vec<CitedCalibration>,
}

impl Part {
    fn of(RunStarted { rig, calibrations, .. }: &RunStarted) -> Self {
        Self { rig: Some(rig.clone()), calibrations: calibrations.clone() }
    }

    /// The part after this one, with what has changed. An older journal does not have the calibrations that have changed:
    /// nothing rests on them.
    pub(crate) fn after(
        &self,
        changes: &[Change],
        rig: Option<Source>,
        calibrations: Option<Vec<CitedCalibration>>,
    ) -> Self {
        let has_changed = |what: &str| changes.iter().any(|change| change.what == what);
        let still_holds =
            |cited: &&CitedCalibration| !has_changed(&format!("calibration ({})", cited.kind));
        let kept = || self.calibrations.iter().filter(still_holds).cloned().collect();
        let same_rig = self.rig.clone().filter(|_| !has_changed("rig file"));
        Self { rig: rig.or(same_rig), calibrations: calibrations.unwrap_or_else(kept) }
    }
}

/// A planned touch.
#[derive(Debug)]
pub(crate) struct PlannedTouch {
    /// Address, sample, pose and repeat.
    pub(crate) settings: TouchSettings,
    /// Time of its beginning: UTC, RFC 3339.
    pub(crate) began_at: Option<String>,
    /// Whether it has begun in the last part of the run itself, and has no outcome.
    pub(crate) is_begun: bool,
    /// `None` when it has not ended.
    pub(crate) outcome: Option<Outcome>,
    /// Number of attempts.
    pub(crate) attempts: u32,
    /// Number of the clock on which its times count, from 1.
    pub(crate) clock: Option<u64>,
    /// Beginning and clock of an attempt that may replace the outcome.
    again: Option<(Option<String>, u64)>,
    /// The amendments and the outcomes that they replaced, oldest first.
    pub(crate) amendments: Vec<Replaced>,
}

/// An amendment of a touch, and the outcome before.
#[derive(Debug)]
pub(crate) struct Replaced {
    /// The action, the person, and the reason.
    pub(crate) amendment: String,
    /// The outcome before, in words.
    pub(crate) before: Option<String>,
}

/// The outcome of a touch.
#[derive(Debug)]
pub(crate) enum Outcome {
    /// It gave a shift: its index in [`RunData::touches`].
    Measured(usize),
    /// It gave no shift.
    Refused(Box<RefusedTouch>),
    /// It was left out, for this reason.
    Skipped(String),
}

/// A line of the log.
#[derive(Debug)]
pub(crate) struct LogEntry {
    /// Time since the beginning of the run, µs.
    pub(crate) run_us: u64,
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
    /// A fault of a device, the journal or the line.
    Fault,
    /// The computer was held up, or its clock was set.
    Computer,
    /// A sweep gave no resonance.
    Refusal,
    /// The free resonance has jumped.
    Reference,
    /// The last frames of a port were kept.
    BlackBox,
    /// The run was resumed or given up.
    Seam,
    /// A touch was amended.
    Amendment,
}

impl LogKind {
    /// The word in the log.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Prompt => "prompt",
            Self::Command => "command",
            Self::Fault => "fault",
            Self::Computer => "computer",
            Self::Refusal => "refused sweep",
            Self::Reference => "reference",
            Self::BlackBox => "black box",
            Self::Seam => "resumed",
            Self::Amendment => "amendment",
        }
    }
}

impl RunData {
    /// Sorts the records of a run and of its amendments behind them.
    pub(crate) fn read(records: &[StoredRecord]) -> Result<Self, UnreadableRecord> {
        let run = records.first().map(|first| first.run);
        let own = records.iter().rev().find(|record| Some(record.run) == run);
        let end_us = own.map_or(0, |last| last.run_us);
        let idle_us = run.map_or(0, |run| idle_us(records, run));
        let mut data = Self { end_us, idle_us, epochs: epochs(records), ..Self::default() };
        for stored in records {
            let mut record = stored.record()?;
            data.confirmed.take(&record);
            data.mark_slip_check(&mut record);
            let Self { between, touches, .. } = &mut data;
            between.take(&record, touches);
            data.take_part(stored.event, &record);
            data.take(stored, record);
        }
        Ok(data)
    }

    /// Whether the surface was looked for again in a touch, where its result does not say it, as in older journals.
    fn mark_slip_check(&mut self, record: &mut Record) {
        match record {
            Record::StepStarted(_) => self.has_slip_check = false,
            Record::SurfaceChecked(_) => self.has_slip_check = true,
            Record::TouchResult(touch) => {
                touch.is_slip_checked.get_or_insert(self.has_slip_check);
            }
            _ => {}
        }
    }

    /// Time from the first record of the run to the last by the rig's clock, s, without the time from an
    /// interruption to the resumption.
    pub(crate) fn rig_s(&self) -> f64 {
        self.end_us.saturating_sub(self.idle_us) as f64 / 1e6
    }

    /// The sweeps of the run itself: those of amendments were made at other times.
    pub(crate) fn own_sweeps(&self) -> &[Sweep] {
        &self.sweeps[..self.own_sweeps.unwrap_or(self.sweeps.len())]
    }

    /// The duration that was expected at the beginning.
    pub(crate) fn expected(&self) -> Option<Expected> {
        self.started.as_ref()?.expected
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

    /// The person or program that began the run.
    pub(crate) fn operator(&self) -> Option<&str> {
        self.operator.as_deref()
    }

    /// Whether no real device took part.
    pub(crate) fn is_simulated(&self) -> bool {
        self.started.as_ref().is_some_and(|started| started.is_simulated)
    }

    /// The part of the run that a touch rests on.
    pub(crate) fn part_of(&self, touch: &Touch) -> usize {
        self.part_of.get(&touch.sweep).copied().unwrap_or(0)
    }

    /// Whether each touch of another reading of the records rests on what it rests on here.
    pub(crate) fn rests_alike(&self, other: &Self) -> bool {
        self.parts == other.parts && self.part_of == other.part_of
    }

    /// The following records rest on this part.
    fn begin_part(&mut self, part: Part) {
        let known = self.parts.iter().position(|known| *known == part);
        self.part = known.unwrap_or(self.parts.len());
        if known.is_none() {
            self.parts.push(part);
        }
    }

    /// Follows what the run rests on. Where it goes on, or a touch of it is measured again, that is what its part before
    /// this event rests on, with what has changed.
    fn take_part(&mut self, event: u64, record: &Record) {
        let before = self.run_parts.iter().rev().find(|(begun, _)| *begun < event);
        let before = before.and_then(|(_, part)| self.parts.get(*part));
        match (record, before) {
            (Record::RunStarted(started), _) => {
                self.begin_part(Part::of(started));
                self.run_parts.push((event, self.part));
            }
            (Record::Resumed(Resumed { changes, rig, calibrations, .. }), Some(before)) => {
                self.begin_part(before.after(changes, rig.clone(), calibrations.clone()));
                self.run_parts.push((event, self.part));
            }
            (Record::Amended(Amended { changes, rig, calibrations, .. }), Some(before)) => {
                self.begin_part(before.after(changes, rig.clone(), calibrations.clone()));
            }
            (Record::TouchResult(touch), _) => _ = self.part_of.insert(touch.sweep, self.part),
            _ => {}
        }
    }

    /// The last daily check of the bench before the run.
    pub(crate) fn daily_check(&self) -> Option<&CitedCalibration> {
        let cited = self.started.iter().flat_map(|started| &started.calibrations);
        cited.into_iter().find(|cited| cited.verdict.is_some())
    }

    /// Index of the sample with this name.
    pub(crate) fn sample(&self, name: &str) -> Option<usize> {
        self.samples().iter().position(|sample| sample.name == name)
    }

    /// A touch begins, or another step. An attempt that ends without an outcome leaves the one before.
    fn begin_touch(&mut self, step: &str, times: (Option<String>, u64)) {
        let is_of_run = self.amendment.is_none();
        let Some(planned) = self.planned(step) else { return };
        planned.attempts += 1;
        if planned.outcome.is_some() {
            planned.again = Some(times);
        } else {
            (planned.began_at, planned.clock) = (times.0, Some(times.1));
            planned.is_begun |= is_of_run;
        }
    }

    /// Records the outcome of the touch at an address, in place of an earlier one.
    fn end_touch(&mut self, step: &str, outcome: Outcome) {
        let amendment = self.amendment.as_ref().map(|(amended, _)| described(amended));
        let Some(index) = self.planned.iter().position(|planned| planned.settings.step == step)
        else {
            return;
        };
        let planned = &mut self.planned[index];
        if let Some((began_at, clock)) = planned.again.take() {
            (planned.began_at, planned.clock) = (began_at, Some(clock));
        }
        let earlier = planned.outcome.replace(outcome);
        let before = earlier.as_ref().map(|earlier| self.describe(earlier));
        if let Some(Outcome::Measured(replaced)) = earlier {
            self.touches.remove(replaced);
            for planned in &mut self.planned {
                if let Some(Outcome::Measured(touch)) = &mut planned.outcome {
                    *touch -= usize::from(*touch > replaced);
                }
            }
        }
        if let Some(amendment) = amendment {
            self.planned[index].amendments.push(Replaced { amendment, before });
        }
    }

    /// An outcome in words.
    fn describe(&self, outcome: &Outcome) -> String {
        match outcome {
            Outcome::Measured(index) => {
                let touch = &self.touches[*index];
                format!("shift {} Hz", with_sigma(touch.shift_hz, touch.shift_sigma_hz))
            }
            Outcome::Refused(refused) => format!("refused: {}", refused.reason),
            Outcome::Skipped(why) => format!("skipped: {why}"),
        }
    }

    /// Number of the clock of an epoch, from 1.
    fn clock(&self, epoch: u64) -> u64 {
        clock(&self.epochs, epoch)
    }

    /// The planned touch at an address.
    fn planned(&mut self, step: &str) -> Option<&mut PlannedTouch> {
        self.planned.iter_mut().find(|planned| planned.settings.step == step)
    }

    /// Adds an answer to the line of its prompt.
    fn answer(&mut self, run_us: u64, by: &str) {
        self.prompts += 1;
        let is_question = |entry: &&mut LogEntry| entry.kind == LogKind::Prompt;
        if let Some(asked) = self.log.iter_mut().rev().find(is_question) {
            let waited = duration(run_us.saturating_sub(asked.run_us) as f64 / 1e6);
            write!(asked.text, "; done after {waited}, says {by}")
                .expect("a string takes all text");
        }
    }

    /// The run was resumed, given up, or amended.
    fn seam(&mut self, run_us: u64, record: Record) {
        let mut note = |step: Option<String>, kind, text| {
            self.log.push(LogEntry { run_us, step, kind, text });
        };
        match record {
            Record::Resumed(resumed) => {
                self.fault = None;
                self.planned.iter_mut().for_each(|planned| planned.is_begun = false);
                let Resumed { who, next, touches_left, changes, .. } = &resumed;
                let next = next.as_deref().unwrap_or("the end");
                let touches = if *touches_left == 1 { "touch" } else { "touches" };
                let mut text = format!("resumed by {who} at {next}; {touches_left} {touches} left");
                for Change { what, was, is } in changes {
                    write!(text, "; other {what}: {was} → {is}").expect("a string takes all text");
                }
                note(resumed.next, LogKind::Seam, text);
            }
            Record::GivenUp(given_up) => {
                note(None, LogKind::Seam, format!("given up by {}", given_up.who));
            }
            Record::Amended(amended) => {
                self.own_sweeps.get_or_insert(self.sweeps.len());
                let (step, end_us) = (amended.step.clone(), self.end_us.max(run_us));
                let text = described(&amended);
                self.log.push(LogEntry {
                    run_us: end_us,
                    step: Some(step.clone()),
                    kind: LogKind::Amendment,
                    text,
                });
                let skipped = (amended.what == Amendment::Skip).then(|| amended.why.clone());
                self.amendment = Some((amended, end_us));
                if let Some(why) = skipped {
                    self.end_touch(&step, Outcome::Skipped(why));
                }
            }
            _ => {}
        }
    }

    /// Counts the time of a search, from its declaration to its end.
    fn searched(&mut self, run_us: u64, record: &Record) {
        match record {
            Record::Intent(Intent { what: MoveReason::Approach, .. }) => {
                self.search_us = Some(run_us);
            }
            // The search in steps follows a descent that has not found it.
            Record::SurfaceNotFound(lost) if lost.reason.is_some() => {}
            Record::SurfaceFound(_) | Record::SurfaceNotFound(_) if self.amendment.is_none() => {
                let begun_us = self.search_us.take().unwrap_or(run_us);
                self.surfaces_s += run_us.saturating_sub(begun_us) as f64 / 1e6;
            }
            _ => {}
        }
    }

    fn take(&mut self, stored: &StoredRecord, record: Record) {
        let clock = self.clock(stored.epoch);
        let run_us = stored.run_us + self.amendment.as_ref().map_or(0, |(_, begun_us)| *begun_us);
        let mut note = |step: Option<String>, kind, text| {
            self.log.push(LogEntry { run_us, step, kind, text });
        };
        match record {
            Record::RunStarted(mut started) => {
                let touches = std::mem::take(&mut started.touches);
                self.planned = touches.into_iter().map(PlannedTouch::new).collect();
                self.started = Some(started);
            }
            Record::StepStarted(begun) => {
                self.begin_touch(&begun.step, (stored.at.clone(), clock));
            }
            Record::PromptAsked(asked) => {
                note(Some(asked.step), LogKind::Prompt, request(&asked.prompt));
            }
            Record::PromptAnswered(answered) => self.answer(run_us, &answered.by),
            Record::Operator(operator) => {
                note(None, LogKind::Command, format!("{} by {}", operator.action, operator.who));
                self.operator.get_or_insert(operator.who);
            }
            Record::Fault(fault) => {
                let text = faulted(&fault);
                if self.amendment.is_none() {
                    self.fault.get_or_insert(fault.cause);
                }
                note(fault.step, LogKind::Fault, text);
            }
            Record::Sweep(sweep) => {
                if let SweepOutcome::Refused { reason } = &sweep.outcome {
                    let text = format!("sweep {}: {reason}", sweep.number);
                    note(sweep.step.clone(), LogKind::Refusal, text);
                }
                self.sweeps.push(sweep);
                self.clock_zeros_s.push((run_us as f64 - stored.rig_us as f64) / 1e6);
            }
            Record::TouchResult(touch) => {
                let step = touch.touch.step.clone();
                self.touches.push(touch);
                self.end_touch(&step, Outcome::Measured(self.touches.len() - 1));
            }
            Record::TouchRefused(refused) => {
                let step = refused.touch.step.clone();
                self.end_touch(&step, Outcome::Refused(Box::new(refused)));
            }
            Record::RefusalAnswered(answered) => {
                note(Some(answered.step.clone()), LogKind::Refusal, decided(&answered));
            }
            Record::ReferenceJumped(jumped) => note(None, LogKind::Reference, jump(&jumped)),
            Record::BlackBox(kept) => note(None, LogKind::BlackBox, kept_frames(&kept)),
            Record::RetractTried(tried) => note(None, LogKind::Fault, retract_tried(&tried)),
            Record::Stalled(stalled) => note(None, LogKind::Computer, held_up(&stalled)),
            Record::ClockJumped(jumped) => note(None, LogKind::Computer, clock_set(jumped)),
            seam @ (Record::Resumed(_) | Record::GivenUp(_) | Record::Amended(_)) => {
                self.seam(run_us, seam);
            }
            search @ (Record::Intent(_) | Record::SurfaceFound(_) | Record::SurfaceNotFound(_)) => {
                self.searched(run_us, &search);
            }
            Record::Moved(_)
            | Record::Descended(_)
            | Record::SurfaceChecked(_)
            | Record::RefusalAsked(_)
            | Record::StateChanged(_)
            | Record::Archived(_)
            | Record::RunFinished(_) => {}
        }
    }
}

impl PlannedTouch {
    const fn new(settings: TouchSettings) -> Self {
        Self {
            settings,
            began_at: None,
            is_begun: false,
            outcome: None,
            attempts: 0,
            clock: None,
            again: None,
            amendments: Vec::new(),
        }
    }
}

/// Time between the parts of a run, µs: from the last record before it was resumed or given up to that record.
fn idle_us(records: &[StoredRecord], run: RunId) -> u64 {
    let own: Vec<_> = records.iter().filter(|record| record.run == run).collect();
    let pairs = own.windows(2).filter(|pair| matches!(&*pair[1].kind, "resumed" | "given_up"));
    pairs.map(|pair| pair[1].run_us.saturating_sub(pair[0].run_us)).sum()
}

/// The epochs of records, in order. Each has a clock of its own.
pub(crate) fn epochs(records: &[StoredRecord]) -> Vec<u64> {
    let mut epochs: Vec<u64> = records.iter().map(|record| record.epoch).collect();
    epochs.sort_unstable();
    epochs.dedup();
    epochs
}

/// Number of the clock of an epoch, from 1.
pub(crate) fn clock(epochs: &[u64], epoch: u64) -> u64 {
    epochs.iter().take_while(|known| **known < epoch).count() as u64 + 1
}

/// An amendment in words.
fn described(amended: &Amended) -> String {
    format!("{} by {}: {}", amended.what.name(), amended.who, amended.why)
}
