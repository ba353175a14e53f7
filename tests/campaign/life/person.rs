//! The person at the bench of a faulted run: starts and resumes it, answers prompts, acknowledges
//! faults, and brings the bench in order when the faults end.

use std::time::Duration;

use rig_engine::{Command, FailureKind, Fault as EngineFault, RigState, RunStatus};
use rig_sim::SimHandle;
use rig_store::{Ending, Reader, RunStatus as StoredStatus};
use rigd::rig::{RigHandle, Status};
use tokio::time::{Instant, sleep};

use super::{End, Life, PART, TRIES};
use crate::{counts::Phase, faults::Trouble, judge};

/// Name of the person at the bench.
const TECHNICIAN: &str = "technician";
/// A person takes this long for what has to be done.
const PROMPT: Duration = Duration::from_secs(5);
const LATE: Duration = Duration::from_secs(3600);
/// To lift a probe by hand.
const LIFT: Duration = Duration::from_secs(10);
const RESUME: Duration = Duration::from_secs(20);

/// What a person at the bench waits for.
fn key_of(status: &Status) -> u64 {
    let step = status.snapshot.progress.as_ref().map_or(0, |progress| progress.step);
    ((status.snapshot.state as u64) << 32) + step as u64
}

/// Whether the linear stage does not know where it is and may home downwards, or may be wrong about it.
fn is_to_be_homed(status: &Status) -> bool {
    let fault = status.snapshot.fault.as_ref();
    let is_unhomed = fault.is_some_and(|fault| {
        matches!(fault, EngineFault::Device(failure) if failure.kind == FailureKind::Unhomed)
    });
    is_unhomed || status.snapshot.jump.is_some()
}

/// Whether the linear stage says that it is where it cannot be, so that rigd moves nothing.
fn is_lost(status: &Status) -> bool {
    let fault = status.snapshot.fault.as_ref();
    fault.is_some_and(
        |fault| matches!(fault, EngineFault::Device(failure) if failure.kind == FailureKind::Lost),
    )
}

impl Life<'_> {
    /// The person at the bench, who acts a while after something is asked for.
    pub(super) async fn serve_person(
        &mut self,
        handle: &RigHandle,
        status: &Status,
    ) -> Option<End> {
        let state = status.snapshot.state;
        let ending = status.run.as_ref().and_then(|view| view.ending);
        let now = Instant::now();
        if self.part_ends <= now {
            return Some(self.part_is_over(status));
        }
        let key = key_of(status);
        let wait = match state {
            RigState::WaitingForPerson if self.is_late => LATE,
            RigState::WaitingForPerson => PROMPT,
            RigState::Paused | RigState::Latched | RigState::Idle => RESUME,
            RigState::Preparing | RigState::Running | RigState::Retracting => {
                self.person_at = None;
                return None;
            }
        };
        let is_complete =
            matches!(ending, Some(RunStatus::Completed | RunStatus::CompletedWithRefusals));
        if state == RigState::Idle && is_complete {
            return Some(self.is_finished(status));
        }
        let starts = state == RigState::Idle && self.run.is_none();
        match self.person_at {
            Some((at, for_key)) if for_key == key && at <= now => {}
            None if starts => {}
            Some((_, for_key)) if for_key == key => return None,
            _ => {
                self.person_at = Some((now + wait, key));
                return None;
            }
        }
        self.person_at = None;
        self.person_acts(handle, status).await
    }

    async fn person_acts(&mut self, handle: &RigHandle, status: &Status) -> Option<End> {
        match status.snapshot.state {
            RigState::WaitingForPerson => self.answer(handle, status).await,
            RigState::Paused => _ = handle.command(Command::Resume, None, TECHNICIAN).await,
            RigState::Idle if self.moves_by_hand(handle, status).await => {
                self.person_at = Some((Instant::now() + PROMPT, key_of(status)));
            }
            RigState::Latched | RigState::Idle => {
                self.by_hand.clear();
                if let Some(end) = self.has_settled(status) {
                    return Some(end);
                }
                if self.is_mended && is_lost(status) {
                    return Some(self.find_by_hand().await);
                }
                if status.snapshot.state == RigState::Idle && self.is_sealed() {
                    // It was completed just before the daemon ended.
                    return Some(self.is_finished(status));
                }
                let done = match (status.snapshot.state, self.run) {
                    (RigState::Latched, _) if is_to_be_homed(status) => {
                        self.clear_bench().await;
                        handle.command(Command::HomeLinear, None, TECHNICIAN).await
                    }
                    (RigState::Latched, _) => {
                        handle.command(Command::Acknowledge, None, TECHNICIAN).await
                    }
                    (_, Some(run)) => {
                        self.played.resumptions += 1;
                        handle.resume(run, true, TECHNICIAN).await
                    }
                    (_, None) => {
                        let begun = handle.run(self.bench.protocol.clone(), TECHNICIAN).await;
                        begun.map(|run| self.run = Some(run))
                    }
                };
                if let Err(refusal) = &done
                    && self.is_mended
                {
                    self.fail(&format!("a person cannot go on: {refusal}"));
                    return Some(End::Finished);
                }
                if done.is_err() {
                    if self.run.is_none() && self.tries_left == 0 {
                        self.mend();
                        return status.journal_error.is_some().then_some(End::Restart);
                    }
                    self.tries_left -= u32::from(self.run.is_none());
                    // A refusal changes nothing; the person tries again later.
                    self.person_at = Some((Instant::now() + RESUME, key_of(status)));
                }
            }
            _ => {}
        }
        None
    }

    /// The rig is at rest and waits for a person: the faults end, or the person tries on.
    fn has_settled(&mut self, status: &Status) -> Option<End> {
        if self.run.is_none() && status.snapshot.state == RigState::Idle {
            return None;
        }
        self.is_left(status);
        if self.tries_left > 0 {
            self.tries_left -= 1;
            // Only a daemon that is started again opens its journal again.
            let must_restart = status.journal_error.is_some() && self.is_mended;
            return must_restart.then_some(End::Restart);
        }
        if self.is_mended {
            let fault = status.snapshot.fault.as_ref().map(ToString::to_string);
            self.fail(&format!(
                "not finished after the faults: {}: {}",
                status.snapshot.state.name(),
                fault.unwrap_or_default()
            ));
            return Some(End::Finished);
        }
        self.mend();
        status.journal_error.is_some().then_some(End::Restart)
    }

    /// The faults are over, and the run is complete.
    fn is_finished(&mut self, status: &Status) -> End {
        self.is_left(status);
        self.mend();
        End::Finished
    }

    /// A part took too long.
    fn part_is_over(&mut self, status: &Status) -> End {
        let phase = Phase::of(status).map_or("at rest", Phase::name);
        self.fail(&format!("no end within 4 h of the rig's clock: {phase}"));
        End::Finished
    }

    /// Judges where a rig at rest has left the probe.
    pub(super) fn is_left(&mut self, status: &Status) {
        // A daemon that was started again waits for a person before it moves anything.
        let waits = matches!(status.snapshot.fault, Some(EngineFault::Interrupted(_)));
        if self.is_in_contact()
            && !waits
            && !judge::has_no_way_out(&self.all, &self.played, self.bench)
        {
            self.fail("ended in contact though a retract was possible");
        }
    }

    /// Ends all faults.
    pub(super) fn mend(&mut self) {
        if self.is_mended {
            return;
        }
        self.is_mended = true;
        self.tries_left = TRIES;
        self.part_ends = Instant::now() + PART;
        self.troubles.clear();
        self.kill_at = None;
        self.disk.mend();
        self.say("clear");
        // The person brings the stage back to where its encoder says that it is.
        for words in self.all.iter().filter_map(Trouble::undo_of_lost_steps) {
            self.say(&format!("fault {words}"));
        }
    }

    /// Whether the list of runs says that the run is complete.
    fn is_sealed(&self) -> bool {
        let Ok(reader) = Reader::open_in_memory(&self.disk) else { return false };
        let run = self.run.and_then(|run| reader.run(run).ok());
        run.is_some_and(|run| {
            let is_of = |ending| run.status == StoredStatus::Ended(ending);
            is_of(Ending::Completed) || is_of(Ending::CompletedWithRefusals)
        })
    }

    /// A person clears the bench and starts the daemon again.
    async fn find_by_hand(&mut self) -> End {
        self.clear_bench().await;
        End::Restart
    }

    /// A person lifts a probe that touches, and takes the sample away.
    async fn clear_bench(&mut self) {
        let Some(technician) = self.simulation.as_ref().map(SimHandle::technician) else { return };
        if self.is_in_contact() {
            self.played.lifts += 1;
            technician.lift_probe();
            sleep(LIFT).await;
        }
        if self.is_in_contact() {
            // A blocked stage is freed first.
            self.mend();
            technician.lift_probe();
            sleep(LIFT).await;
        }
        technician.take_sample_away();
    }

    async fn answer(&mut self, handle: &RigHandle, status: &Status) {
        let Some(view) = &status.run else { return };
        let Some(progress) = &status.snapshot.progress else { return };
        let step = view.plan.steps[progress.step].id.to_string();
        if std::mem::take(&mut self.is_wrong) {
            _ = handle.answer(view.id, "main/9/left/0/1".to_owned(), TECHNICIAN).await;
            _ = handle.answer(status.session, step.clone(), TECHNICIAN).await;
            _ = handle.answer(view.id, step.clone(), "").await;
            _ = tokio::join!(
                handle.answer(view.id, step.clone(), TECHNICIAN),
                handle.answer(view.id, step.clone(), "client 2"),
            );
        } else {
            _ = handle.answer(view.id, step, TECHNICIAN).await;
        }
        self.is_late = false;
        self.prompts += 1;
    }
}
