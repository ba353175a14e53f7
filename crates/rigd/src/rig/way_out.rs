//! The way out of contact without the rest of the rig: for `rigd safe`, and after a panic of the rig
//! thread.
//!
//! It opens the bus of the drives and nothing else, stops both axes, finds the linear stage, and
//! retracts until a read-back shows the probe clear, with the patience of the rig file. It lowers
//! nothing and turns nothing. A journal is kept where there is one, and is not needed.

#[cfg(test)]
pub(super) mod tests;

use std::{
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, Instant},
};

use rig_engine::{
    Device, Effect, Engine, Event, Fault, Input, Jump, LeftRig, Operation, Report, RigState,
};
use rig_files::rig_file::{Connection, RigFile};
use rig_interlock::Proven;
use rig_link::{Clock, Port};
use rig_model::{Clearance, Mm, Position, with_causes};
use rig_stage::{BusHandle, HaltFrames};
use rig_store::{
    Ending, Journal, Reader, Record, RunFinished, RunId, RunKind, StateChanged, Store, StoreError,
};

use super::{
    OpenError,
    devices::{Axes, stage_failure},
    gate::Gate,
    open::{HALT_WITHIN, Ports, bus_settings, device, open_port, runtime_of, stage},
    proof::Proof,
    record::Recorder,
    slot::Slot,
    until,
};
use crate::{
    instruments::Instruments, interruption::jump, loaded_rig::LoadedRig, place::Place,
    simulation::Simulation,
};

/// Longest wait for a port that another program holds: one that is ending releases it at once.
const HELD_FOR: Duration = Duration::from_secs(2);

/// Pause between two attempts to open the port.
const PAUSE: Duration = Duration::from_millis(200);

/// Longest duration of the last attempt, which may begin when the patience is nearly over: finding
/// the drive, homing it upwards, and the retract.
const LAST_ATTEMPT: Duration = Duration::from_secs(180);

/// The end of the way out.
#[derive(Debug, Clone)]
pub struct WayOut {
    /// Whether the probe is shown to be clear.
    pub clearance: Clearance,
    /// Where the linear stage was found.
    pub from: Option<Position<Mm>>,
    /// Where it was read back last.
    pub linear: Option<Position<Mm>>,
    /// The faults on the way, in order.
    pub faults: Vec<Fault>,
    /// Duration of the way out.
    pub took: Duration,
    /// The session in the journal; an error says why there is none, and `None` that none was asked
    /// for.
    pub recorded: Result<Option<RunId>, Arc<str>>,
}

/// What a program that is replaced by the way out knows of its rig without reading a disk.
#[derive(Debug, Clone, Copy, Default)]
pub struct KnownRig {
    /// It was in service: it was commissioned when it was opened.
    pub was_in_service: bool,
    /// The position of its linear stage may be wrong.
    pub jump: Option<Jump>,
}

/// Retracts the probe of a rig that no program has open, and records it in the journal of `data`, if
/// that can be written. Without `data`, the default directory is read, and nothing is written.
///
/// # Errors
/// [`OpenError`] when nothing was sent: another rigd has the data directory, or the port cannot be
/// opened.
pub fn make_safe(
    rig: LoadedRig,
    data: Option<&Path>,
    known: KnownRig,
    by: &str,
) -> Result<WayOut, OpenError> {
    let runtime = runtime_of(&rig)?;
    let default = Place::found().data;
    let place = data.unwrap_or(&default);
    let stopped = Fault::Stopped { by: by.to_owned() };
    // The disk may be what the program was waiting for.
    let (fault, missing) = if known.was_in_service && data.is_none() {
        (left(stopped, known.jump), None)
    } else {
        let jump = known.jump.or_else(|| last_jump(place, &rig.file));
        let missing = Proof::for_way_out(&rig, place).missing.filter(|_| !known.was_in_service);
        let missing = missing.map(|missing| match data {
            Some(_) => missing,
            None => {
                format!("{missing} (in {}; --data names another directory)", place.display()).into()
            }
        });
        (left(stopped, jump), missing)
    };
    let log = Log::open(data, &rig.file.name)?;
    runtime.block_on(async {
        let clock = Clock::start();
        let LoadedRig { file, instruments, scene, .. } = rig;
        // The simulated devices live until the end.
        let (port, _simulation) = match &file.connection {
            Connection::Ports => (wait_for_port(&file, clock).await, None),
            Connection::Simulated(_) => {
                let Ports { bus, simulation, .. } =
                    Ports::open(&file, &instruments, scene, None, clock).await?;
                (bus, simulation)
            }
        };
        let port = port.map_err(|source| OpenError::Port { role: "bus", source })?;
        if let Some(missing) = missing {
            return halt(&file, &instruments, port, clock, &missing, log).await;
        }
        retract(&file, &instruments, port, clock, fault, log).await
    })
}

/// What the journal says of a position that may be wrong. A journal that cannot be read is no reason to leave the probe where
/// it is.
fn last_jump(data: &Path, file: &RigFile) -> Option<Jump> {
    let is_simulated = matches!(file.connection, Connection::Simulated(_));
    jump(&Reader::open(data).ok()?, &file.name, is_simulated)
}

/// The fault, with a position that may be wrong.
fn left(fault: Fault, jump: Option<Jump>) -> Fault {
    if jump.is_none() {
        return fault;
    }
    Fault::Interrupted(LeftRig {
        message: fault.to_string(),
        may_touch: true,
        was_lowered: true,
        jump,
    })
}

/// What is needed for the way out after a panic.
pub(super) struct Kept {
    pub(super) file: RigFile,
    pub(super) instruments: Instruments,
    pub(super) data: PathBuf,
    pub(super) simulation: Option<Simulation>,
    /// What is missing for a rig in service.
    pub(super) missing: Option<Arc<str>>,
}

impl Kept {
    /// Retracts after the devices and the journal of the rig thread were dropped; a rig that is not commissioned is
    /// stopped.
    pub(super) async fn retract(self, fault: Fault) -> Result<WayOut, OpenError> {
        let Self { file, instruments, data, simulation, missing } = self;
        let fault = left(fault, last_jump(&data, &file));
        let clock = Clock::start();
        let port = match simulation {
            Some(bench) => Port::open(bench.bus(&file), clock).await,
            None => wait_for_port(&file, clock).await,
        };
        let port = port.map_err(|source| OpenError::Port { role: "bus", source })?;
        let mut log = Log::open(Some(&data), &file.name).unwrap_or_else(|error| Log {
            journal: None,
            recorded: Err(with_causes(&error).into()),
        });
        if let Some(missing) = missing {
            log.note(clock, &Event::Faulted { fault, clearance: Clearance::Unknown });
            return halt(&file, &instruments, port, clock, &missing, log).await;
        }
        retract(&file, &instruments, port, clock, fault, log).await
    }
}

/// The journal of the way out, if there is one.
struct Log {
    journal: Option<(Store, Journal, Recorder)>,
    recorded: Result<Option<RunId>, Arc<str>>,
}

impl Log {
    /// A directory in use means that another program may have the rig: that is an error. Any other
    /// failure leaves the way out without a record.
    fn open(data: Option<&Path>, rig: &str) -> Result<Self, OpenError> {
        let Some(data) = data else { return Ok(Self { journal: None, recorded: Ok(None) }) };
        let session = Store::open(data).and_then(|store| {
            let journal = store.begin(RunKind::Session, rig)?;
            Ok((store, journal))
        });
        match session {
            Ok((store, journal)) => {
                let recorded = Ok(Some(journal.id()));
                Ok(Self { journal: Some((store, journal, Recorder::for_session())), recorded })
            }
            Err(source @ StoreError::InUse) => {
                Err(OpenError::Data { data: data.to_owned(), source })
            }
            Err(error) => Ok(Self { journal: None, recorded: Err(with_causes(&error).into()) }),
        }
    }

    fn note(&mut self, clock: Clock, event: &Event) {
        if let Some((_, _, recorder)) = &mut self.journal
            && let Some(record) = recorder.record(event)
        {
            self.append(clock, &record);
        }
    }

    /// The next program waits for a person: where the probe was left is not shown.
    fn end_latched(&mut self, clock: Clock) {
        let state = RigState::Latched.name().to_owned();
        self.append(clock, &Record::StateChanged(StateChanged { state, reason: None }));
        self.append(clock, &Record::RunFinished(RunFinished { status: Ending::Completed }));
    }

    /// A journal that fails is left: the way out needs none.
    fn append(&mut self, clock: Clock, record: &Record) {
        let Some((_, journal, _)) = &mut self.journal else { return };
        let appended = journal.append(clock.now().as_micros(), record);
        if let Err(error) = appended.and_then(|_| journal.commit()) {
            self.recorded = Err(with_causes(&error).into());
            self.journal = None;
        }
    }
}

/// Opens the port of the drives; one that is held, for a moment, and one that is absent, as long as
/// the rig file says.
async fn wait_for_port(file: &RigFile, clock: Clock) -> Result<Port, rig_link::OpenError> {
    let began = Instant::now();
    loop {
        let error = match open_port(&file.bus, clock).await {
            Ok(port) => return Ok(port),
            Err(error) => error,
        };
        let patience = match error {
            rig_link::OpenError::Busy { .. } => HELD_FOR,
            _ => Duration::from_secs_f64(file.recovery_patience_s),
        };
        if began.elapsed() + PAUSE > patience {
            return Err(error);
        }
        tokio::time::sleep(PAUSE).await;
    }
}

/// Stops both axes of a rig that is not commissioned: it has not lowered its probe, and may not know where up is.
async fn halt(
    file: &RigFile,
    instruments: &Instruments,
    port: Port,
    clock: Clock,
    missing: &str,
    mut log: Log,
) -> Result<WayOut, OpenError> {
    let began = clock.now();
    let bus = BusHandle::open(port, bus_settings(&file.bus));
    let mut linear = stage(&bus, &file.linear, instruments.linear, file.limits.linear);
    let mut rotary = stage(&bus, &file.rotary, instruments.rotary, file.limits.rotary);
    let frames = HaltFrames::of([
        linear.halt_frames().map_err(device("bus", &file.bus))?,
        rotary.halt_frames().map_err(device("bus", &file.bus))?,
    ]);
    // A line that takes longer gets them when it can.
    _ = tokio::time::timeout(HALT_WITHIN, bus.halt(frames)).await;
    let mut faults = Vec::new();
    if let Err(error) = linear.stop().await {
        faults.push(Fault::Device(stage_failure(Device::LinearStage, &error)));
    }
    if let Err(error) = rotary.stop().await {
        faults.push(Fault::Device(stage_failure(Device::RotaryStage, &error)));
    }
    faults.push(Fault::NotCommissioned { missing: missing.to_owned() });
    for fault in &faults {
        let clearance = Clearance::Unknown;
        log.note(clock, &Event::Faulted { fault: fault.clone(), clearance });
    }
    log.end_latched(clock);
    let took = clock.now().since(began);
    let clearance = Clearance::Unknown;
    Ok(WayOut { clearance, from: None, linear: None, faults, took, recorded: log.recorded })
}

async fn retract(
    file: &RigFile,
    instruments: &Instruments,
    port: Port,
    clock: Clock,
    fault: Fault,
    mut log: Log,
) -> Result<WayOut, OpenError> {
    let began = clock.now();
    let bus = BusHandle::open(port, bus_settings(&file.bus));
    let axes = Axes {
        linear: stage(&bus, &file.linear, instruments.linear, file.limits.linear),
        rotary: stage(&bus, &file.rotary, instruments.rotary, file.limits.rotary),
        is_homing_up: file.linear.is_homing_up,
        is_rotary_doubtful: false,
        gate: Gate::new(&file.limits, Proven::Bench, clock),
    };
    let frames = axes.halt_frames().map_err(device("bus", &file.bus))?;
    // A line that takes longer gets them when it can.
    _ = tokio::time::timeout(HALT_WITHIN, bus.halt(frames.clone())).await;
    let patience = Duration::from_secs_f64(file.recovery_patience_s);
    let mut engine = Engine::with_patience(file.limits, patience);
    let mut axes = Slot::new(axes);
    let (mut from, mut linear, mut faults) = (None, None, Vec::new());
    let mut effects = Vec::new();
    engine.leave_contact(began, fault, &mut effects);
    let give_up_at = began + patience + LAST_ATTEMPT;
    while clock.now() < give_up_at {
        for effect in effects.drain(..) {
            match effect {
                Effect::Note(event) => {
                    if let Event::Faulted { fault, .. } = &event {
                        faults.push(fault.clone());
                    }
                    log.note(clock, &event);
                }
                Effect::Do(id, operation) => {
                    debug_assert!(!matches!(operation, Operation::MoveRotary { .. }));
                    axes.start(id, operation);
                }
                Effect::Interrupt => {
                    axes.end();
                    drop(bus.halt(frames.clone()));
                }
                // Nothing is lowered.
                Effect::Commit | Effect::EndDescent => {}
            }
        }
        if engine.snapshot().state == RigState::Latched {
            break;
        }
        let input = tokio::select! {
            biased;
            Some((id, ended)) = axes.ended() => {
                if let Ok(Report::LinearAt(at) | Report::LinearHomed(at)) = &ended {
                    from = from.or(Some(*at));
                    linear = Some(*at);
                }
                Input::Done(id, ended)
            }
            () = until(clock, engine.deadline()) => Input::Tick,
            () = until(clock, Some(give_up_at)) => break,
        };
        engine.handle(clock.now(), input, &mut effects);
    }
    // The first one is the reason for the way out.
    faults.drain(..1.min(faults.len()));
    let end = Record::RunFinished(RunFinished { status: Ending::Completed });
    if engine.snapshot().state == RigState::Latched {
        log.append(clock, &end);
    } else {
        log.end_latched(clock);
    }
    let clearance = engine.snapshot().clearance;
    let took = clock.now().since(began);
    Ok(WayOut { clearance, from, linear, faults, took, recorded: log.recorded })
}
