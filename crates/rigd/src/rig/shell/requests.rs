//! The requests of persons and programs: each is refused, or begins something in the engine.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use rig_engine::{Command, CommandRefusal, RigState};
use rig_interlock::Word;
use rig_protocol::StepId;
use rig_store::{Operator, Record, RunId};

use super::Shell;
use crate::rig::{
    Doing, Request, RequestRefusal, ResumeRefusal, TouchOrder, amend, identify::Answers,
    open::HALT_WITHIN, record::Recorder,
};

impl Shell {
    pub(super) fn take(&mut self, request: Request) {
        if request.uses_data() {
            self.pulse.beat(Doing::Recording);
        }
        // The caller may have closed its end. Its command is carried out.
        match request {
            Request::Run { protocol, by, key, reply } => {
                _ = reply.send(self.start_run(&protocol, &by, key));
            }
            Request::Resume { run, is_confirmed, by, reply } => {
                _ = reply.send(self.resume_run(run, is_confirmed, &by));
            }
            Request::Redo { order, is_confirmed, by, reply } => {
                _ = reply.send(self.redo(&order, is_confirmed, &by));
            }
            Request::Skip { order, by, reply } => {
                let skipped = self.skip(&order, &by);
                self.log.count_others();
                _ = reply.send(skipped);
            }
            Request::GiveUp { run, by, reply } => {
                let given_up = self.give_up(run, &by);
                self.log.count_others();
                _ = reply.send(given_up);
            }
            Request::Sweep { request, by, reply } => {
                let result = self.command(Command::Sweep(request), &by);
                _ = reply.send(result.map(|()| self.view.sweeps()));
            }
            Request::Command { command, run, by, reply } => {
                let result = run.map_or(Ok(()), |run| self.under_way(run).map(|_| ()));
                _ = reply.send(result.and_then(|()| self.command(command, &by)));
            }
            Request::Answer { run, step, by, reply } => {
                _ = reply.send(self.answer(run, step, &by));
            }
            Request::Identify { by, reply } => _ = reply.send(self.identify(by)),
            Request::Commission { order, by, reply } => _ = reply.send(self.drive(order, by)),
            Request::StepSeen { axis, by, reply } => _ = reply.send(self.step_seen(axis, by)),
            Request::AskSimulated { asked, reply } => _ = reply.send(self.ask_simulated(asked)),
            Request::Answered { asked, answer, reply } => {
                self.answered(asked, answer);
                _ = reply.send(());
            }
            Request::ReadCalibrations { by, reply } => {
                _ = reply.send(self.read_calibrations(&by));
            }
            Request::Note { action, by, reply } => _ = reply.send(self.put_on_record(action, by)),
            Request::Close { reply } => _ = reply.send(()),
            #[cfg(test)]
            Request::Block(until) => _ = until.recv(),
            #[cfg(test)]
            Request::PanicAt(event) => {
                assert!(event != 0, "injected");
                self.panic_at = event;
            }
        }
        // A request that met a failure of the disk has closed the journal.
        self.log.check();
        self.pulse.beat(Doing::Deciding);
        self.publish();
    }

    /// Stops the axes before anything is decided or written, if a request asks for that, which came at this time.
    pub(super) async fn halt_if_asked(&self, request: &Request, at: Instant) {
        let Request::Command { command: command @ (Command::Stop | Command::Abort), run, .. } =
            request
        else {
            return;
        };
        // A stop would lead to the retract that is in progress.
        let is_commissioned = self.uncommissioned.is_none();
        if is_commissioned
            && (run.is_some_and(|run| self.under_way(run).is_err())
                || self.is_retracting()
                || self.engine.admit(command.clone()).is_err())
        {
            return;
        }
        // In virtual time none passes while a request waits.
        let waited = if self.is_virtual_time { Duration::ZERO } else { at.elapsed() };
        self.gate.stop_asked(waited);
        // A line that takes longer gets them when it can; the decision must not wait for it, and it is said that it took long.
        drop(tokio::time::timeout(HALT_WITHIN, self.owners.halt()).await);
        self.gate.stop_sent();
    }

    pub(super) fn command(&mut self, command: Command, by: &str) -> Result<(), RequestRefusal> {
        if self.uncommissioned.is_some() && matches!(command, Command::Stop | Command::Abort) {
            let is_under_way = self.owners.are_busy();
            self.stop_step();
            // As in service: a stop is always on record, an abort if it ends something. A journal that cannot be written
            // refuses neither.
            if is_under_way || matches!(command, Command::Stop) {
                _ = self.put_on_record(command.name().to_owned(), by.to_owned());
            }
            return Ok(());
        }
        self.is_commissioned()?;
        let is_sweep = matches!(command, Command::Sweep(_));
        let word = match command {
            Command::Acknowledge => Word::Acknowledgement,
            Command::HomeLinear => Word::NothingBelow,
            _ => Word::Command,
        };
        let admitted = self.engine.admit(command)?;
        self.gate.operator(by, word)?;
        if is_sweep {
            self.view.begin_sweep(self.log.begin_sweep());
        }
        self.begin(admitted, by);
        Ok(())
    }

    /// Asks the devices again who they are. Nothing moves.
    fn identify(&mut self, by: String) -> Result<Answers, RequestRefusal> {
        let state = self.engine.snapshot().state;
        if state != RigState::Idle {
            return Err(CommandRefusal::State { command: "identify the devices", state }.into());
        }
        if self.owners.are_busy() {
            return Err(RequestRefusal::Identifying);
        }
        self.log.append(&Record::Operator(Operator { action: "identify".to_owned(), who: by }));
        self.log.commit();
        Ok(self.owners.identify(&self.setting.devices))
    }

    /// Records what a person did that is no command to the rig.
    pub(super) fn put_on_record(
        &mut self,
        action: String,
        by: String,
    ) -> Result<(), RequestRefusal> {
        self.log.append(&Record::Operator(Operator { action, who: by }));
        self.log.commit();
        match self.log.error() {
            Some(reason) => Err(RequestRefusal::Journal { reason: Arc::clone(reason) }),
            None => Ok(()),
        }
    }

    fn under_way(&self, run: RunId) -> Result<&Recorder, RequestRefusal> {
        let under_way = self.log.run().filter(|&(id, _)| id == run);
        under_way.map(|(_, recorder)| recorder).ok_or(RequestRefusal::NotUnderWay { run })
    }

    fn answer(&mut self, run: RunId, step: String, by: &str) -> Result<(), RequestRefusal> {
        if self.under_way(run)?.step_id().as_deref() != Some(&*step) {
            return Err(RequestRefusal::NotAsked { step });
        }
        self.command(Command::Answer, by)
    }

    fn give_up(&self, run: RunId, by: &str) -> Result<(), RequestRefusal> {
        if self.under_way(run).is_err() {
            self.is_between_runs("give up another run")?;
        }
        let given_up = self.log.store().give_up(run, self.clock.now().as_micros(), by);
        given_up.map_err(|error| ResumeRefusal::from(error).into())
    }

    /// Leaves a touch out. In the run under way it must not have begun.
    fn skip(&mut self, order: &TouchOrder, by: &str) -> Result<(), RequestRefusal> {
        let rig_us = self.clock.now().as_micros();
        if self.under_way(order.run).is_err() {
            if let Some((id, _)) = self.log.run() {
                amend::is_not_of(&self.log.store().reader()?.run(id)?, order)?;
            }
            self.is_between_runs("leave a touch of another run out")?;
            return Ok(amend::skip(self.log.store(), order, by, rig_us)?);
        }
        let admitted = self.engine.admit(Command::Skip(StepId(order.step.clone())))?;
        self.gate.operator(by, Word::Command)?;
        // What is recorded, the run can read.
        self.log.commit();
        amend::write_skip(self.log.store(), order, by, rig_us)?;
        self.view.skipped(&order.step);
        self.begin(admitted, by);
        Ok(())
    }
}
