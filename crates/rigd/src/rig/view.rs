//! What the rig thread publishes: the status, kept up to date by the events of the engine.

use std::{sync::Arc, time::Instant};

use rig_engine::{Event, Fault, RigState, RunStatus, Snapshot, SweepPurpose};
use rig_model::{Clearance, Mm, Position, RigTime};
use tokio::sync::watch;

use super::{PortFrames, RunView, Setting, Status, live::LiveSweep, log::Log};

/// The status at the end of each step, and those who watch it.
pub(super) struct View {
    status: Status,
    watched: watch::Sender<Status>,
}

impl View {
    pub(super) fn new(
        snapshot: Snapshot,
        now: RigTime,
        log: &Log,
        setting: &Setting,
        ports: Arc<[PortFrames]>,
    ) -> (Self, watch::Receiver<Status>) {
        let status = Status {
            snapshot,
            now,
            published: Instant::now(),
            run: None,
            session: log.session(),
            sweep: None,
            sweeps: 0,
            devices: Arc::clone(&setting.devices),
            setting: Arc::new(setting.clone()),
            ports,
            live: None,
            state_since: now,
            first_event: 0,
            last_event: 0,
            journal_error: None,
            silence: None,
        };
        let (watched, watcher) = watch::channel(status.clone());
        (Self { status, watched }, watcher)
    }

    /// What publishes if the rig thread fails or is silent.
    pub(super) fn watched(&self) -> watch::Sender<Status> {
        self.watched.clone()
    }

    pub(super) fn begin_run(&mut self, run: RunView) {
        self.status.run = Some(run);
    }

    /// A manual sweep begins.
    pub(super) const fn begin_sweep(&mut self, number: u64) {
        self.status.sweeps = number;
        self.status.sweep = Some(number);
    }

    /// Number of manual sweeps begun.
    pub(super) const fn sweeps(&self) -> u64 {
        self.status.sweeps
    }

    /// Whether the last run has ended.
    pub(super) fn has_ended(&self) -> bool {
        self.status.run.as_ref().is_some_and(|run| run.ending.is_some())
    }

    /// A person leaves a touch of the run out.
    pub(super) fn skipped(&mut self, step: &str) {
        self.run(|run| run.skipped(step));
    }

    /// The last records of the run are not on disk.
    pub(super) fn run_is_incomplete(&mut self) {
        self.run(|run| run.ending = Some(RunStatus::Faulted));
    }

    pub(super) fn note(&mut self, event: &Event, now: RigTime) {
        match event {
            Event::StepStarted { .. } => self.run(|run| run.step_began = now),
            Event::PromptAsked(_) => self.run(|run| run.pace.asked(now)),
            Event::PromptAnswered { .. } => self.run(|run| run.pace.answered(now)),
            &Event::SweepBegun { purpose, request } => {
                let serial = self.status.live.as_ref().map_or(1, |last| last.serial + 1);
                self.status.live = Some(Arc::new(LiveSweep::begin(serial, purpose, request)));
            }
            Event::Measured { readings, estimate } => {
                if let Some(live) = &mut self.status.live {
                    Arc::make_mut(live).add(readings, estimate.as_ref());
                }
            }
            Event::TouchFinished(result) => self.run(|run| {
                run.touches_done += 1;
                run.touches_refused += usize::from(result.is_refused());
            }),
            Event::TouchDoubted(_) => self.run(|run| run.touches_refused += 1),
            Event::RunFinished(ending) => self.run(|run| run.ending = Some(*ending)),
            Event::SweepFinished(outcome) if outcome.purpose == SweepPurpose::Manual => {
                self.status.sweep = None;
            }
            Event::StateChanged(word) => {
                // A question about a refused touch comes unplanned, as a pause does.
                self.run(|run| {
                    let is_asked = *word == RigState::WaitingForPerson && !run.pace.is_asked();
                    run.pace.pauses(now, is_asked || *word == RigState::Paused);
                });
                // A sweep that was aborted or failed is never finished.
                if *word != RigState::Running {
                    self.status.sweep = None;
                }
            }
            _ => {}
        }
    }

    /// Publishes the status.
    pub(super) fn publish(&mut self, snapshot: Snapshot, now: RigTime, log: &Log) {
        let Self { status, watched } = self;
        status.now = now;
        status.published = Instant::now();
        let last = &status.snapshot;
        if (snapshot.state, snapshot.prompt) != (last.state, last.prompt) {
            status.state_since = now;
        }
        status.snapshot = snapshot;
        status.session = log.session();
        [status.first_event, status.last_event] = log.events();
        status.journal_error = log.error().cloned();
        watched.send_replace(status.clone());
    }

    fn run(&mut self, change: impl FnOnce(&mut RunView)) {
        if let Some(run) = &mut self.status.run {
            change(run);
        }
    }
}

/// Publishes a state of the way out after the rig thread has failed.
pub(super) fn publish_way_out(
    watched: &watch::Sender<Status>,
    fault: &Fault,
    (state, clearance, linear): (RigState, Clearance, Option<Position<Mm>>),
) {
    watched.send_modify(|status| {
        let snapshot = &mut status.snapshot;
        (snapshot.state, snapshot.clearance, snapshot.linear) = (state, clearance, linear);
        snapshot.fault = Some(fault.clone());
        (snapshot.progress, snapshot.prompt) = (None, None);
        status.sweep = None;
        if let Some(run) = status.run.as_mut().filter(|_| state == RigState::Latched) {
            run.ending.get_or_insert(RunStatus::Faulted);
        }
    });
}
