//! The beginning of runs and amendments: space, journal, recorder, view.

use std::sync::Arc;

use rig_engine::{Admitted, Command, CommandRefusal, RigState};
use rig_protocol::Plan;
use rig_store::{CitedCalibration, Expected, Journal, Reader, Record, RunId, RunKind, RunStarted};

use super::Shell;
use crate::{
    protocol_file::LoadedProtocol,
    rig::{
        History, Pace, RequestRefusal, ResumeRefusal, RunView, TouchOrder, amend,
        record::Recorder,
        resume::{Known, Present, cited, resumable},
        space,
    },
};

impl Shell {
    pub(super) fn start_run(
        &mut self,
        protocol: &LoadedProtocol,
        by: &str,
        key: Option<String>,
    ) -> Result<RunId, RequestRefusal> {
        self.is_commissioned()?;
        let command = Command::Run(Box::new(protocol.plan.clone()));
        let admitted = self.engine.admit(command)?;
        self.journal_is_fine()?;
        self.has_space(&protocol.plan)?;
        let history = self.history();
        let mut journal = self.log.store().begin(RunKind::Run, &protocol.plan.name)?;
        let id = journal.id();
        let view = self.run_view(id, Arc::new(protocol.plan.clone()), history);
        let expected = view.remaining(0, view.started);
        let started = Recorder::run_started(protocol, &self.setting, &self.known_samples);
        let started = Record::RunStarted(RunStarted {
            expected: Some(Expected {
                least_s: expected.least_s,
                most_s: expected.most_s,
                from_touches: u32::try_from(view.history.touches()).unwrap_or(u32::MAX),
            }),
            calibrations: self.cited(),
            idempotency_key: key,
            ..started
        });
        journal.append(self.clock.now().as_micros(), &started)?;
        self.set_out(admitted, by, journal, 0, view)?;
        Ok(id)
    }

    fn run_view(&self, id: RunId, plan: Arc<Plan>, history: History) -> RunView {
        RunView {
            id,
            started: self.clock.now(),
            step_began: self.clock.now(),
            expected_s: plan.summary(&self.setting.limits).duration_s,
            durations_s: plan.durations_s(&self.setting.limits).into(),
            plan,
            first_step: 0,
            touches_before: 0,
            touches_done: 0,
            touches_refused: 0,
            touches_skipped: 0,
            pace: Pace::default(),
            history: Arc::new(history),
            ending: None,
        }
    }

    /// The calibrations that a run cites that begins now.
    fn cited(&self) -> Vec<CitedCalibration> {
        self.log.store().directory().map_or_else(Vec::new, |data| cited(data, &self.setting))
    }

    /// A run from the journal, beside what is now.
    fn known(&self, reader: &Reader, id: RunId) -> Result<Known, ResumeRefusal> {
        let now = Present { setting: &self.setting, calibrations: &self.cited() };
        Known::read(reader, id, now, &self.known_samples)
    }

    /// Refuses before a whole run is read, which a stop would have to wait for.
    fn is_idle_for(&self, command: &'static str) -> Result<(), CommandRefusal> {
        match self.engine.snapshot().state {
            RigState::Idle => Ok(()),
            state => Err(CommandRefusal::State { command, state }),
        }
    }

    /// Refuses before a whole run is read while another one is under way, whose stop would have to wait for it.
    pub(super) fn is_between_runs(&self, command: &'static str) -> Result<(), CommandRefusal> {
        let state = self.engine.snapshot().state;
        if self.log.run().is_some() {
            Err(CommandRefusal::State { command, state })
        } else {
            Ok(())
        }
    }

    /// What earlier runs took, read before a journal is begun: a journal in memory cannot be read while
    /// it has uncommitted records. A journal that cannot be read gives no estimate.
    fn history(&self) -> History {
        let history =
            self.log.store().reader().and_then(|reader| History::read(&reader, &self.setting));
        history.unwrap_or_else(|error| {
            tracing::warn!(%error, "earlier runs cannot be read; the plan alone gives the durations");
            History::default()
        })
    }

    /// Resumes a run at its next touch without an outcome.
    pub(super) fn resume_run(
        &mut self,
        id: RunId,
        is_confirmed: bool,
        by: &str,
    ) -> Result<(), RequestRefusal> {
        self.is_commissioned()?;
        let reader = self.log.store().reader()?;
        resumable(&reader.run(id).map_err(ResumeRefusal::from)?)?;
        self.is_idle_for("continue")?;
        let known = self.known(&reader, id)?;
        let rest = known.rest()?;
        let command = Command::Continue {
            plan: Box::new(rest.plan.clone()),
            from: rest.from,
            has_refusals: rest.touches_refused > 0,
        };
        let admitted = self.engine.admit(command)?;
        self.journal_is_fine()?;
        known.confirm(is_confirmed)?;
        self.has_space(&rest.plan.after(rest.from))?;
        let history = self.history();
        let mut journal = self.log.store().reopen(id).map_err(ResumeRefusal::from)?;
        let resumed = known.resumed(&rest, self.log.store().epoch()?, by, &self.setting);
        journal.append(self.clock.now().as_micros(), &resumed)?;
        let view = RunView {
            first_step: rest.from,
            touches_before: rest.touches_done,
            touches_done: rest.touches_done,
            touches_refused: rest.touches_refused,
            touches_skipped: rest.touches_skipped,
            ..self.run_view(id, Arc::new(rest.plan), history)
        };
        self.set_out(admitted, by, journal, rest.sweeps, view)
    }

    /// Measures one touch of a run again, as an amendment.
    pub(super) fn redo(
        &mut self,
        order: &TouchOrder,
        is_confirmed: bool,
        by: &str,
    ) -> Result<RunId, RequestRefusal> {
        self.is_commissioned()?;
        self.is_idle_for("measure a touch again")?;
        let known = self.known(&self.log.store().reader()?, order.run)?;
        let (plan, sweeps) = (known.only(&order.step)?, known.rest()?.sweeps);
        let admitted = self.engine.admit(Command::Run(Box::new(plan.clone())));
        let admitted = admitted.map_err(|refusal| refusal.for_command("measure a touch again"))?;
        self.journal_is_fine()?;
        known.confirm(is_confirmed)?;
        self.has_space(&plan)?;
        let (rig_us, history) = (self.clock.now().as_micros(), self.history());
        let journal = amend::redo(self.log.store(), &known, order, by, rig_us, &self.setting)?;
        let id = journal.id();
        let view = self.run_view(id, Arc::new(plan), history);
        self.set_out(admitted, by, journal, sweeps, view)?;
        Ok(id)
    }

    /// Begins what was admitted with a journal of its own, whose last sweep has this number. Its first
    /// record is on disk before that: an id that a client gets is that of a run that the journal has, and
    /// nothing moves for a run that it has not.
    fn set_out(
        &mut self,
        admitted: Admitted,
        by: &str,
        mut journal: Journal,
        sweeps: u64,
        view: RunView,
    ) -> Result<(), RequestRefusal> {
        journal.commit()?;
        self.log.follow_run(journal, Recorder::for_plan(Arc::clone(&view.plan), sweeps));
        self.spans.begin_run(view.id, &view.plan.name);
        self.view.begin_run(view);
        self.begin(admitted, by);
        // A client that has the id may ask for the records of its begin at once.
        self.log.commit();
        Ok(())
    }

    fn journal_is_fine(&self) -> Result<(), RequestRefusal> {
        match self.log.error() {
            Some(reason) => Err(RequestRefusal::Journal { reason: Arc::clone(reason) }),
            None => Ok(()),
        }
    }

    /// Refuses a plan for which the disk has no room.
    fn has_space(&self, plan: &Plan) -> Result<(), RequestRefusal> {
        space::check(self.log.store().directory(), plan.summary(&self.setting.limits).disk_bytes)
    }
}
