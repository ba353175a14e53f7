//! One run of a rehearsal, with the person who looks after it.

use std::{collections::BTreeMap, pin::pin, time::Duration};

use rig_engine::{Command, RefusalAnswer, RigState, RunStatus};
use rig_model::{Clearance, Orientation, RigTime};
use rig_protocol::{Action as Act, Prompt};
use rig_sim::{PortId, SimHandle, control};
use rig_store::{Action, MemoryDisk, Reader, Record, RunId, StoreError, StoredRecord};
use tokio::time::{Instant, sleep};

use super::{RehearseError, Shift, bench::simulated, menu::Trouble};
use crate::{
    hint,
    loaded_rig::LoadedRig,
    protocol_file::LoadedProtocol,
    rig::{self, RequestRefusal, RigHandle, Status, unwritable},
};

/// The person of the rehearsal, in its journal.
const PERSON: &str = "rehearsal";

/// Number of times that the person acknowledges, and that the person resumes, before giving up.
const ATTEMPTS: u32 = 4;

/// Starts of rigd in a run.
const STARTS: u32 = 4;

const LATE: Duration = Duration::from_secs(3600);
const ABSENT: Duration = Duration::from_secs(12 * 3600);

/// A run of a rehearsal, as far as it has come.
pub(super) struct Play<'a> {
    rig: &'a LoadedRig,
    protocol: &'a LoadedProtocol,
    disk: MemoryDisk,
    bench: Option<SimHandle>,
    trouble: Option<(Trouble, usize)>,
    run: Option<RunId>,
    /// The event before the first one of the run.
    first_event: u64,
    acknowledged: u32,
    /// The sample under the probe before the last prompt.
    placed: Option<String>,
    played: Played,
}

/// A run of a rehearsal.
#[derive(Debug, Default)]
pub(super) struct Played {
    pub(super) is_complete: bool,
    pub(super) is_clear: bool,
    /// Each message that a person has seen, with its advice.
    pub(super) seen: Vec<String>,
    pub(super) refused: usize,
    /// Number of touches begun.
    pub(super) begun: usize,
    /// Number of prompts answered.
    pub(super) answers: usize,
    pub(super) resumed: u32,
    pub(super) restarted: u32,
    pub(super) took_s: f64,
    /// When the fault happened, on the clock of that epoch.
    pub(super) struck: Option<RigTime>,
    /// When each message arrived at the analyzer and at the bus, since the run began.
    pub(super) frames: [Vec<RigTime>; 2],
    pub(super) shifts: BTreeMap<String, Shift>,
    pub(super) records: Vec<StoredRecord>,
}

/// The end of one life of rigd.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Killed,
    Restarted,
    Over,
}

impl<'a> Play<'a> {
    /// Plays a protocol with a trouble at its n-th moment, counted from 0.
    pub(super) fn of(
        rig: &'a LoadedRig,
        protocol: &'a LoadedProtocol,
        trouble: Option<(Trouble, usize)>,
    ) -> Result<Played, RehearseError> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_time()
            .start_paused(true)
            .build()
            .map_err(RehearseError::Runtime)?;
        let mut play = Self {
            rig,
            protocol,
            disk: MemoryDisk::new()?,
            bench: None,
            trouble,
            run: None,
            first_event: 0,
            acknowledged: 0,
            placed: None,
            played: Played::default(),
        };
        runtime.block_on(async {
            let mut began = Instant::now();
            for _ in 0..STARTS {
                match Box::pin(play.live(&mut began)).await? {
                    End::Over => break,
                    End::Killed | End::Restarted => play.played.restarted += 1,
                }
            }
            play.played.took_s = began.elapsed().as_secs_f64();
            play.look_back()?;
            Ok(play.played)
        })
    }

    /// One life of rigd.
    async fn live(&mut self, began: &mut Instant) -> Result<End, RehearseError> {
        // A disk that failed before the run was written has left none: the person begins it again.
        if let Some(run) = self.run {
            match Reader::open_in_memory(&self.disk)?.records(run) {
                Err(StoreError::NoSuchRun { .. }) => self.run = None,
                found => drop(found?),
            }
        }
        let rig = simulated(self.rig, &self.protocol.plan);
        let opening = rig::open_in_memory(rig, &self.disk, self.bench.clone());
        let (handle, rig) = Box::pin(opening).await?;
        self.bench = handle.simulation().cloned();
        let mut serving = pin!(rig.serve());
        let end = tokio::select! {
            biased;
            () = &mut serving => return Err(RequestRefusal::Closed.into()),
            end = self.act(&handle, began) => end?,
        };
        if end != End::Killed {
            tokio::join!(handle.close(), serving);
        }
        self.played.is_clear = handle.status().borrow().snapshot.clearance == Clearance::Clear;
        Ok(end)
    }

    /// What the person does until this life of rigd ends.
    async fn act(&mut self, handle: &RigHandle, began: &mut Instant) -> Result<End, RehearseError> {
        let mut watch = handle.status();
        loop {
            let status = watch.wait_for(|status| self.is_moment(status)).await;
            let status = status.map_err(|_| RequestRefusal::Closed)?.clone();
            if self.is_killed(&status) {
                (self.played.struck, self.trouble) = (Some(status.now), None);
                return Ok(End::Killed);
            }
            if let Some(reason) = &status.journal_error {
                let fault = rig_engine::Fault::Device(unwritable(reason));
                self.see(&fault, status.snapshot.clearance);
                self.played.struck.get_or_insert(status.now);
                self.disk.mend();
                self.trouble = None;
                return Ok(End::Restarted);
            }
            match status.snapshot.state {
                RigState::WaitingForPerson => {
                    if let Some(end) = self.answer(handle, &status).await? {
                        return Ok(end);
                    }
                }
                RigState::Latched => {
                    if let Some(fault) = &status.snapshot.fault {
                        self.see(fault, status.snapshot.clearance);
                    }
                    self.acknowledged += 1;
                    if self.acknowledged > ATTEMPTS {
                        return Ok(End::Over);
                    }
                    // The person removes the cause.
                    self.control("clear");
                    handle.command(Command::Acknowledge, None, PERSON).await?;
                }
                _ => match self.run {
                    None => {
                        *began = Instant::now();
                        self.begin(handle).await?;
                    }
                    Some(_) if is_complete(&status) => {
                        self.played.is_complete = true;
                        return Ok(End::Over);
                    }
                    Some(_) if self.played.resumed >= ATTEMPTS => return Ok(End::Over),
                    Some(run) => {
                        self.played.resumed += 1;
                        handle.resume(run, true, PERSON).await?;
                    }
                },
            }
        }
    }

    /// Whether the person acts now, or the program is killed.
    fn is_moment(&self, status: &Status) -> bool {
        let needs_person = matches!(
            status.snapshot.state,
            RigState::Idle | RigState::Latched | RigState::WaitingForPerson
        );
        needs_person || self.is_killed(status)
    }

    fn is_killed(&self, status: &Status) -> bool {
        matches!(self.trouble, Some((Trouble::Kill, record))
            if self.run.is_some() && status.last_event > self.first_event + record as u64)
    }

    async fn begin(&mut self, handle: &RigHandle) -> Result<(), RehearseError> {
        if let Some(bench) = &self.bench {
            bench.with(|_, rig| rig.listen_in());
        }
        self.first_event = handle.status().borrow().last_event;
        match self.trouble {
            Some((Trouble::Frame { port, words }, frame)) => {
                let port = if port == PortId::Bus { "bus" } else { "analyzer" };
                self.control(&format!("fault {port} {words} nth={}", frame + 1));
            }
            Some((Trouble::Disk(failure), call)) => self.disk.fail_from(call as u64 + 1, failure),
            _ => {}
        }
        // A disk that fails at once refuses the run; rigd is then started again.
        match handle.run(self.protocol.clone(), PERSON).await {
            Ok(run) => self.run = Some(run),
            Err(RequestRefusal::Journal { .. }) => {}
            Err(refusal) => return Err(refusal.into()),
        }
        Ok(())
    }

    /// Does what a prompt asks for, and answers it. A question about a refused touch is answered with its
    /// omission.
    async fn answer(
        &mut self,
        handle: &RigHandle,
        status: &Status,
    ) -> Result<Option<End>, RehearseError> {
        if let Some(touch) = &status.snapshot.refused {
            let (step, answer) = (touch.step.clone(), RefusalAnswer::Skip);
            handle.command(Command::Decide { step, answer }, None, PERSON).await?;
            return Ok(None);
        }
        let Some(prompt) = status.snapshot.prompt else { return Ok(None) };
        let trouble = self.trouble.take_if(|(trouble, prompt)| {
            let is_of_person = matches!(trouble, Trouble::Late | Trouble::Absent | Trouble::Wrong);
            is_of_person && *prompt == self.played.answers
        });
        let trouble = trouble.map(|(trouble, _)| trouble);
        if trouble.is_some() {
            self.played.struck = Some(status.now);
        }
        match trouble {
            Some(Trouble::Late) => sleep(LATE).await,
            Some(Trouble::Absent) => {
                sleep(ABSENT).await;
                return Ok(Some(End::Restarted));
            }
            _ => {}
        }
        handle.command(Command::Answer, None, PERSON).await?;
        self.played.answers += 1;
        let before = self.placed.clone();
        if let Prompt::PlaceSample { sample } = prompt {
            self.placed = self.protocol.plan.samples.get(sample).cloned();
        }
        if let (Some(Trouble::Wrong), Some(bench)) = (trouble, &self.bench) {
            let technician = bench.technician();
            match prompt {
                Prompt::PlaceSample { .. } => match before {
                    Some(name) => drop(technician.place_sample(&name)),
                    None => technician.take_sample_away(),
                },
                Prompt::TurnSensor { orientation: Orientation::Left } => {
                    technician.turn_sensor(Orientation::FrontBack);
                }
                Prompt::TurnSensor { orientation: Orientation::FrontBack } => {
                    technician.turn_sensor(Orientation::Left);
                }
            }
        }
        Ok(None)
    }

    fn see(&mut self, fault: &rig_engine::Fault, clearance: Clearance) {
        let hint = hint::after(fault, clearance);
        self.played.seen.push(format!("{fault} → {}", hint.text));
    }

    /// Gives a line to the control interface of the simulator.
    fn control(&self, line: &str) {
        let Some(bench) = &self.bench else { return };
        if let Err(error) = bench.with(|now, rig| control::execute(now, rig, line).map(drop)) {
            tracing::error!(%error, line, "the menu has a wrong line");
        }
    }

    /// What the run has left behind.
    fn look_back(&mut self) -> Result<(), RehearseError> {
        if let Some(bench) = &self.bench {
            let frames = &mut self.played.frames;
            bench.with(|_, rig| {
                for heard in rig.overheard() {
                    frames[heard.port as usize].push(heard.at);
                }
            });
        }
        let Some(run) = self.run else { return Ok(()) };
        self.played.records = Reader::open_in_memory(&self.disk)?.records(run)?;
        for stored in &self.played.records {
            match stored.record() {
                Ok(Record::StepStarted(step)) if matches!(step.action, Action::Touch { .. }) => {
                    self.played.begun += 1;
                }
                Ok(Record::TouchResult(touch)) => {
                    let shift = Shift { shift_hz: touch.shift_hz, sigma_hz: touch.shift_sigma_hz };
                    self.played.shifts.insert(touch.touch.step.clone(), shift);
                }
                _ => {}
            }
        }
        let touches = self.protocol.plan.steps.iter();
        let touches = touches.filter(|step| matches!(step.action, Act::Touch(_))).count();
        self.played.refused = touches.saturating_sub(self.played.shifts.len());
        Ok(())
    }
}

/// Whether the run has come to its end.
fn is_complete(status: &Status) -> bool {
    let ending = status.run.as_ref().and_then(|view| view.ending);
    matches!(ending, Some(RunStatus::Completed | RunStatus::CompletedWithRefusals))
}
