//! The published state of the rig and of its run.

use std::{sync::Arc, time::Instant};

use rig_commission::Basis;
use rig_engine::Snapshot;
use rig_link::{HealthMeter, Transcript};
use rig_model::{RigLimits, RigTime};
use rig_protocol::{Action, Plan, Prompt};
use rig_store::{RunId, Source};

use super::{History, LiveSweep, Meters, Pace, Remaining, Silence, pace, record};
use crate::describe;

/// The published state of the rig.
#[derive(Debug, Clone)]
pub struct Status {
    /// The engine's view.
    pub snapshot: Snapshot,
    /// When this was so, on the rig's clock.
    pub now: RigTime,
    /// When it was published, by the clock of the computer.
    pub published: Instant,
    /// The run under way or the last one.
    pub run: Option<RunView>,
    /// The journal of what happens between runs.
    pub session: RunId,
    /// Number of the manual sweep under way.
    pub sweep: Option<u64>,
    /// Number of manual sweeps begun in this session.
    pub sweeps: u64,
    /// Identities of the devices.
    pub devices: Arc<[DeviceIdentity; 3]>,
    /// The files and the limits of the rig.
    pub(crate) setting: Arc<Setting>,
    /// The last frames of each port.
    pub(crate) ports: Arc<[PortFrames]>,
    /// The sweep under way or the last one.
    pub live: Option<Arc<LiveSweep>>,
    /// Time of the last change of state, on the rig's clock.
    pub state_since: RigTime,
    /// The first event of this session in the journal; 0 before it.
    pub first_event: u64,
    /// The newest event that is committed to the journal.
    pub last_event: u64,
    /// Why the journal cannot be written any more.
    pub journal_error: Option<Arc<str>>,
    /// Since when the rig loop gives no sign of life. All else is then as it was at that time.
    pub silence: Option<Silence>,
}

/// The published state of a run.
#[derive(Debug, Clone)]
pub struct RunView {
    /// Id of the run in the journal.
    pub id: RunId,
    /// Plan of the run.
    pub plan: Arc<Plan>,
    /// When it began, on the rig's clock.
    pub started: RigTime,
    /// Its expected duration, s.
    pub expected_s: f64,
    /// Duration of each of its steps, s.
    pub durations_s: Arc<[f64]>,
    /// When the step under way began, on the rig's clock.
    pub step_began: RigTime,
    /// Number of steps that were done before this part of the run began.
    pub first_step: usize,
    /// The touches that were done before this part of the run began.
    pub touches_before: usize,
    /// The touches that are done, also those that were refused.
    pub touches_done: usize,
    /// The touches that were refused.
    pub touches_refused: usize,
    /// The touches that a person left out.
    pub touches_skipped: usize,
    /// Time spent waiting for people, s.
    pub pace: Pace,
    /// The touches of earlier runs of this rig.
    pub history: Arc<History>,
    /// How the run ended; `None` during the run.
    pub ending: Option<rig_engine::RunStatus>,
}

/// A device that answered.
#[derive(Debug, Clone)]
pub struct DeviceIdentity {
    /// Its role on the rig, such as `analyzer`.
    pub role: &'static str,
    /// Its reported identity.
    pub identity: String,
    /// Its instrument file, if it is one of the bench's own.
    pub instrument: Option<&'static Source>,
    /// Its counts since the rig was opened.
    pub health: HealthMeter,
}

impl Status {
    /// The present time on the rig's clock. Virtual time does not pass while the rig is idle.
    pub fn present(&self, is_virtual_time: bool) -> RigTime {
        if is_virtual_time { self.now } else { self.now + self.published.elapsed() }
    }
}

impl RunView {
    /// The description of a step of this run.
    pub fn describe_step(&self, index: usize) -> String {
        describe::step(&self.plan, index)
    }

    /// The text of a prompt.
    pub fn ask(&self, prompt: &Prompt) -> String {
        describe::prompt(&self.plan, prompt)
    }

    /// Number of planned touches, without those that were left out.
    pub fn touches_planned(&self) -> usize {
        let is_touch = |step: &&rig_protocol::Step| matches!(step.action, Action::Touch(_));
        self.plan.steps.iter().filter(is_touch).count() - self.touches_skipped
    }

    /// A person leaves a touch out, which takes no time then.
    pub(super) fn skipped(&mut self, step: &str) {
        let steps = self.plan.steps.iter();
        let durations_s = steps.zip(self.durations_s.iter());
        let left_s = |(one, &seconds): (&rig_protocol::Step, &f64)| {
            if one.id.0 == step { 0.0 } else { seconds }
        };
        self.durations_s = durations_s.map(left_s).collect();
        self.touches_skipped += 1;
    }

    /// Remaining time of the run, from the step under way on.
    pub fn remaining(&self, step: usize, now: RigTime) -> Remaining {
        let lasted_s = now.since(self.step_began.min(now)).as_secs_f64();
        self.left(step, step, now).after(lasted_s, self.left(step, step + 1, now))
    }

    /// The least time until a later step begins, s.
    pub fn until_s(&self, step: usize, later: usize, now: RigTime) -> f64 {
        let least_s = self.remaining(step, now).least_s - self.left(step, later, now).least_s;
        least_s.max(0.0)
    }

    /// The time of the steps from `from` on, as expected at the beginning of the step under way.
    fn left(&self, step: usize, from: usize, now: RigTime) -> Remaining {
        let (steps, durations_s) = (&self.plan.steps, &self.durations_s);
        let end = steps.len().min(durations_s.len());
        let part = |from: usize, to: usize| pace::Part {
            steps: &steps[from.min(to)..to],
            durations_s: &durations_s[from.min(to)..to],
        };
        let parts = (part(self.first_step, step.min(end)), part(from, end));
        let touches = self.touches_done.saturating_sub(self.touches_before);
        let began = self.step_began.min(now);
        let elapsed_s = began.since(self.started).as_secs_f64();
        self.pace.remaining(began, parts, elapsed_s, touches, &self.history)
    }
}

/// The last frames of a port, which its owner goes on writing.
#[derive(Debug, Clone)]
pub(crate) struct PortFrames {
    pub(super) port: Arc<str>,
    pub(super) transcript: Transcript,
}

impl PortFrames {
    /// A copy of what is there now. The owner of the port waits for the copy, which has a bounded size.
    pub(crate) fn read(&self) -> rig_store::BlackBox {
        record::frames(&self.port, &self.transcript)
    }
}

/// Facts about the rig that the rig thread keeps beside its devices.
#[derive(Debug, Clone)]
pub(crate) struct Setting {
    pub(super) limits: RigLimits,
    pub(super) rig: rig_store::Source,
    pub(super) scene: Option<rig_store::Source>,
    pub(super) devices: Arc<[DeviceIdentity; 3]>,
    /// What calibrations rest on.
    pub(super) rests_on: Arc<Basis>,
    /// Durations of the rig thread.
    pub(crate) meters: Meters,
}
