//! A rehearsal: a protocol on a copy of a rig with simulated devices, once without a fault and once with
//! each fault of the menu, in virtual time.
//!
//! The journals are in a temporary directory, and no port of the rig is opened. The person of the
//! rehearsal removes the cause of a fault, acknowledges, and resumes the run.

mod menu;

use std::{
    io,
    path::{Path, PathBuf},
};

use rig_engine::{Command, RigState, RunStatus};
use rig_files::Location;
use rig_files::rig_file::{Connection, Pace, RigFile, SimulatedPerson, Simulation};
use rig_model::{Clearance, RigTime, random::Stream};
use rig_protocol::Plan;
use rig_sim::{
    PortId, control,
    world::{Mechanics, Sample, Scene, TrueGeometry},
};
use rig_store::{
    Action, Axis, MoveReason, Reader, Record, RunId, Source, StoreError, StoredRecord,
};

use tempfile::TempDir;

use self::menu::{MENU, Rehearsed};
use crate::{
    hint,
    loaded_rig::{LoadedRig, LoadedScene},
    protocol_file::LoadedProtocol,
    rig::{self, OpenError, RequestRefusal, RigHandle, Status},
};

/// The stiffness of a sample that the rig file does not know, MPa: the middle of the paper's.
const STIFFNESS_MPA: f64 = 0.235;

/// The depth at which a sample of the rehearsal tears, mm.
const TEARS_AT_MM: f64 = 1.0;

/// Number of times that the person acknowledges and resumes before giving up.
const ATTEMPTS: u32 = 4;

/// The name of the stream that draws the frames at which the faults happen.
const FRAMES: u64 = 0x5eed;

/// A rehearsal.
#[derive(Debug, Clone)]
pub struct Rehearsal {
    /// Number of touches of the protocol.
    pub touches: usize,
    /// Duration of the run without a fault, on the rig's clock, s.
    pub undisturbed_s: f64,
    /// One row for each fault.
    pub rows: Vec<RehearsedFault>,
}

/// The run with one fault.
#[derive(Debug, Clone)]
pub struct RehearsedFault {
    /// Number of the fault in the list of faults.
    pub number: u8,
    /// The fault in a few words.
    pub what: &'static str,
    /// What the rig was doing.
    pub phase: &'static str,
    /// The messages that a person would have seen, each with its advice.
    pub seen: Vec<String>,
    /// Number of touches that were refused.
    pub refused: usize,
    /// Number of touches that were begun again.
    pub repeated: usize,
    /// Number of times that the person acknowledged a fault and resumed the run.
    pub resumed: u32,
    /// Whether the run came to its end.
    pub is_complete: bool,
    /// Whether the probe was clear in the end.
    pub is_clear: bool,
    /// Additional time of the rig, s.
    pub additional_s: f64,
}

/// Why a rehearsal is not possible.
#[derive(Debug, thiserror::Error)]
pub enum RehearseError {
    /// The simulated rig cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The run cannot be begun.
    #[error(transparent)]
    Refused(#[from] RequestRefusal),
    /// The journal of the rehearsal cannot be read.
    #[error("the journal of the rehearsal")]
    Store(#[from] StoreError),
    /// There is no temporary directory.
    #[error("temporary directory")]
    Directory(#[source] io::Error),
    /// The run without a fault does not come to its end, so that nothing can be compared with it.
    #[error("the run without a fault does not come to its end on the simulated bench: {reason}")]
    Undisturbed {
        /// Its fault or its end.
        reason: String,
    },
}

/// Rehearses a protocol; `progress` is told the number of each run before it begins, and the number of
/// all. `seed` decides at which frames the faults happen.
///
/// # Errors
/// [`RehearseError`].
pub async fn rehearse(
    rig: &LoadedRig,
    protocol: &LoadedProtocol,
    seed: u64,
    mut progress: impl FnMut(usize, usize),
) -> Result<Rehearsal, RehearseError> {
    let bench = Bench { rig, protocol };
    progress(0, MENU.len());
    let undisturbed = bench.play(None).await?;
    if !undisturbed.is_complete {
        let reason = undisturbed.seen.first().cloned();
        return Err(RehearseError::Undisturbed { reason: reason.unwrap_or_default() });
    }
    let mut rows = Vec::new();
    for (index, fault) in MENU.iter().enumerate() {
        progress(index + 1, MENU.len());
        let frames = undisturbed.frames[fault.port as usize].len();
        let frame = Stream::of_trial(seed, FRAMES, index as u64).below(frames.max(1));
        let run = bench.play(Some((fault, frame))).await?;
        let struck = run.frames[fault.port as usize].get(frame).copied();
        rows.push(RehearsedFault {
            number: fault.number,
            what: fault.what,
            phase: phase(&run.records, struck.unwrap_or(RigTime::ZERO)),
            refused: run.refused.saturating_sub(undisturbed.refused),
            repeated: run.repeated,
            resumed: run.resumed,
            is_complete: run.is_complete,
            is_clear: run.is_clear,
            additional_s: run.rig_s - undisturbed.rig_s,
            seen: run.seen,
        });
    }
    let touches = protocol.summary.touches;
    Ok(Rehearsal { touches, undisturbed_s: undisturbed.rig_s, rows })
}

/// A copy of the rig with simulated devices.
struct Bench<'a> {
    rig: &'a LoadedRig,
    protocol: &'a LoadedProtocol,
}

/// A run of a rehearsal.
struct Played {
    is_complete: bool,
    is_clear: bool,
    seen: Vec<String>,
    refused: usize,
    repeated: usize,
    resumed: u32,
    rig_s: f64,
    /// When each message arrived at the analyzer and at the bus, since the run began.
    frames: [Vec<RigTime>; 2],
    records: Vec<StoredRecord>,
}

impl Bench<'_> {
    /// Runs the protocol with a fault at one message since the run began.
    async fn play(&self, fault: Option<(&Rehearsed, usize)>) -> Result<Played, RehearseError> {
        let folder = TempDir::new().map_err(RehearseError::Directory)?;
        let rig = simulated(self.rig, &self.protocol.plan);
        let (handle, thread) = rig::open(rig, folder.path().to_owned())?;
        let played = play(&handle, self.protocol, fault, folder.path()).await;
        handle.close().await;
        thread.join();
        played
    }
}

async fn play(
    handle: &RigHandle,
    protocol: &LoadedProtocol,
    fault: Option<(&Rehearsed, usize)>,
    data: &Path,
) -> Result<Played, RehearseError> {
    settled(handle).await?;
    if let Some(simulation) = handle.simulation() {
        simulation.with(|_, rig| rig.listen_in());
    }
    if let Some((fault, frame)) = fault {
        let port = if fault.port == PortId::Bus { "bus" } else { "analyzer" };
        control(handle, &format!("fault {port} {} nth={}", fault.words, frame + 1));
    }
    let begun = handle.status().borrow().now;
    let run = handle.run(protocol.clone(), PERSON).await?;
    let (mut seen, mut resumed) = (Vec::new(), 0);
    let end = loop {
        let end = ended(handle, run).await?;
        if let Some(fault) = &end.snapshot.fault {
            let hint = hint::after(fault, end.snapshot.clearance);
            seen.push(format!("{fault} → {}", hint.text));
        }
        if is_complete(&end) || resumed >= ATTEMPTS {
            break end;
        }
        // The person removes the cause.
        control(handle, "clear");
        handle.command(Command::Acknowledge, None, PERSON).await?;
        let prepared = settled(handle).await?;
        if prepared.snapshot.state == RigState::Latched {
            break prepared;
        }
        resumed += 1;
        handle.resume(run, true, PERSON).await?;
    };
    let records = Reader::open(data)?.records(run)?;
    let is_touch = |stored: &&StoredRecord| match stored.record() {
        Ok(Record::StepStarted(step)) => matches!(step.action, Action::Touch { .. }),
        _ => false,
    };
    let begun_touches = records.iter().filter(is_touch).count();
    Ok(Played {
        is_complete: is_complete(&end),
        is_clear: end.snapshot.clearance == Clearance::Clear,
        seen,
        refused: end.run.as_ref().map_or(0, |view| view.touches_refused),
        repeated: begun_touches.saturating_sub(protocol.summary.touches),
        resumed,
        rig_s: end.now.since(begun).as_secs_f64(),
        frames: frames(handle),
        records,
    })
}

/// Whether the run has come to its end.
fn is_complete(status: &Status) -> bool {
    let ending = status.run.as_ref().and_then(|view| view.ending);
    matches!(ending, Some(RunStatus::Completed | RunStatus::CompletedWithRefusals))
}

/// Gives a line to the control interface of the simulator.
fn control(handle: &RigHandle, line: &str) {
    let Some(simulation) = handle.simulation() else { return };
    let done = simulation.with(|now, rig| control::execute(now, rig, line).map(drop));
    if let Err(error) = done {
        tracing::error!(%error, line, "the menu has a wrong line");
    }
}

/// When each message arrived at the analyzer and at the bus.
fn frames(handle: &RigHandle) -> [Vec<RigTime>; 2] {
    let mut frames = [Vec::new(), Vec::new()];
    if let Some(simulation) = handle.simulation() {
        simulation.with(|_, rig| {
            for heard in rig.overheard() {
                frames[heard.port as usize].push(heard.at);
            }
        });
    }
    frames
}

/// The person of the rehearsal, in its journal.
const PERSON: &str = "rehearsal";

/// Waits until the rig is in service or latched.
async fn settled(handle: &RigHandle) -> Result<Status, RehearseError> {
    wait(handle, |status| matches!(status.snapshot.state, RigState::Idle | RigState::Latched)).await
}

/// Waits until a run has ended, and the rig has settled.
async fn ended(handle: &RigHandle, run: RunId) -> Result<Status, RehearseError> {
    wait(handle, |status| {
        let view = status.run.as_ref().filter(|view| view.id == run);
        view.is_some_and(|view| view.ending.is_some())
            && matches!(status.snapshot.state, RigState::Idle | RigState::Latched)
    })
    .await
}

async fn wait(
    handle: &RigHandle,
    is_reached: impl Fn(&Status) -> bool,
) -> Result<Status, RehearseError> {
    let mut status = handle.status();
    let reached = status.wait_for(|status| is_reached(status)).await;
    Ok(reached.map_err(|_| RequestRefusal::Closed)?.clone())
}

/// The rig with simulated devices of the same makes. Without a scene of its own, the bench is as the rig
/// file describes it.
fn simulated(rig: &LoadedRig, plan: &Plan) -> LoadedRig {
    let scene = rig.scene.as_ref().map_or_else(
        || bench_of(&rig.file, plan),
        |loaded| LoadedScene { scene: loaded.scene.clone(), source: loaded.source.clone() },
    );
    let simulation = Simulation {
        scene: PathBuf::new(),
        scene_location: Location { line: 1, column: 1 },
        pace: Pace::Virtual,
        person: SimulatedPerson::Answers,
    };
    let file = RigFile { connection: Connection::Simulated(simulation), ..rig.file.clone() };
    LoadedRig { file, source: rig.source.clone(), scene: Some(scene) }
}

fn bench_of(file: &RigFile, plan: &Plan) -> LoadedScene {
    let paper = rig_sim::scene::paper();
    let known = |name: &String| {
        let found = file.samples.iter().find(|known| known.name == *name);
        found.map_or(STIFFNESS_MPA, |known| known.stiffness_mpa)
    };
    let sample = |name: &String| Sample {
        name: name.clone(),
        stiffness_mpa: known(name),
        max_indentation_mm: TEARS_AT_MM,
    };
    let (geometry, linear, rotary) =
        (&file.limits.geometry, &file.limits.linear, &file.limits.rotary);
    let scene = Scene {
        name: format!("the bench of {}", file.name),
        samples: plan.samples.iter().map(sample).collect(),
        place: TrueGeometry {
            surface_mm: geometry.surface.value(),
            surface_above_pivot_mm: geometry.surface_above_pivot_mm,
            probe_beside_pivot_mm: geometry.probe_beside_pivot_mm,
        },
        linear: Mechanics {
            start: linear.rest_target().position().value(),
            travel: (linear.travel().min.value(), linear.travel().max.value()),
        },
        rotary: Mechanics {
            start: rotary.rest_target().position().value(),
            travel: (rotary.travel().min.value(), rotary.travel().max.value()),
        },
        ..paper
    };
    let source = Source { name: scene.name.clone(), toml: String::new() };
    LoadedScene { scene, source }
}

/// What the rig was doing at a time, from the records before it.
fn phase(records: &[StoredRecord], at: RigTime) -> &'static str {
    let before = records.iter().take_while(|stored| stored.rig_us <= at.as_micros());
    let mut phase = "before the run";
    for stored in before {
        phase = match stored.record() {
            Ok(Record::StepStarted(step)) => match step.action {
                Action::Prompt { .. } => "prompt",
                Action::NoLoad { .. } => "no-load sweep",
                Action::Touch { .. } => "turn",
            },
            Ok(Record::Intent(intent)) => match intent.what {
                MoveReason::Approach => "search",
                _ => "indentation",
            },
            Ok(Record::Moved(moved)) if moved.axis == Axis::LinearMm && moved.is_clear => "clear",
            Ok(Record::Moved(moved)) if moved.axis == Axis::LinearMm && phase == "indentation" => {
                "contact sweep"
            }
            Ok(Record::Sweep(_)) if phase == "contact sweep" => "retract",
            _ => phase,
        };
    }
    phase
}
