//! Inspects each device of a rig separately, so that a fault of one does not hide the others.
//! Nothing moves, nothing is written into a drive, and no journal is needed.

use std::path::Path;

use rig_analyzer::{Analyzer, AnalyzerError};
use rig_files::rig_file::{PortFile, RigFile};
use rig_link::{Clock, Flow, Holder, Port, Transcript, attached_ports, device_of};
use rig_model::{Axis, DriveLevel, PortKind, RigLimits, Unit};
use rig_stage::{Alarm, AxisStatus, BusHandle, Look, Stage, StageError};

use super::{
    DeviceError, OpenError,
    open::{Ports, analyzer_on, bus_settings, describe, runtime_of, stage},
};
use crate::{instruments::Instruments, loaded_rig::LoadedRig};

/// Number of readings of an axis, for the statistics of round trips.
const LOOKS: u32 = 10;

/// The level at which the settings of an analyzer are tried, V; less where the rig allows less.
const TRIAL_LEVEL_V: f64 = 1.0;

/// Facts about a rig.
#[derive(Debug)]
pub struct Inspection {
    /// The port of the analyzer and that of the drives.
    pub ports: [PortSeen; 2],
    /// The analyzer, the linear stage and the rotary stage.
    pub devices: [DeviceSeen; 3],
}

/// A port of the rig.
#[derive(Debug)]
pub struct PortSeen {
    /// Role of the devices on the port.
    pub role: &'static str,
    /// The path of the port, or the address of the host.
    pub name: String,
    /// Facts about it, or the reason why it could not be opened.
    pub outcome: Result<PortFacts, rig_link::OpenError>,
}

/// A port that could be opened.
#[derive(Debug, Clone, PartialEq)]
pub struct PortFacts {
    /// Other programs that have it open too, as far as this user may know.
    pub intruders: Vec<Holder>,
    /// The latency timer of its adapter, ms, if the system tells it.
    pub adapter_delay_ms: Option<u32>,
    /// Answer times of its devices.
    pub round_trips: Option<RoundTrips>,
}

/// From the first byte of a question to the first byte of its answer, over all of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoundTrips {
    /// Number of round trips.
    pub count: usize,
    /// Half of them took no longer, ms.
    pub median_ms: f64,
    /// The longest, ms.
    pub longest_ms: f64,
}

/// A device of the rig.
#[derive(Debug)]
pub struct DeviceSeen {
    /// Its role on the rig.
    pub role: &'static str,
    /// The name of its port.
    pub port: String,
    /// What that port is to this computer.
    pub kind: PortKind,
    /// Facts about it; None if its port could not be opened.
    pub outcome: Option<Result<DeviceFacts, DeviceError>>,
}

/// A device that answered.
#[derive(Debug)]
pub struct DeviceFacts {
    /// Its reported identity, or its command set if it reports none.
    pub identity: String,
    /// The version of its firmware, if it says so.
    pub firmware: Option<String>,
    /// Whether an analyzer took its settings and gave them back. A drive is given none.
    pub settings: Result<(), AnalyzerError>,
    /// Its state, for an axis.
    pub axis: Option<AxisFacts>,
}

/// The state of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisFacts {
    /// Where, by its own account, with its unit.
    pub at: String,
    /// Whether it can be there.
    pub place: AxisPosition,
    /// Whether the axis can move, or the reason why not.
    pub state: AxisState,
    /// Whether its drive has the settings that it gets when the rig is opened for work.
    pub has_settings: bool,
}

/// Whether an axis can be where it says; the first of these that applies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AxisPosition {
    /// It does not know where it is.
    NotHomed,
    /// It cannot be there: outside this travel.
    BeyondTravel(String),
    /// It can be there, but nothing sends it there: outside these soft limits.
    BeyondLimits(String),
    /// Inside its soft limits.
    InLimits,
}

/// State of an axis; the first of these that applies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisState {
    /// The drive reports an alarm.
    Alarmed(Alarm),
    /// It moves without a command.
    Moving,
    /// The drive takes no moves.
    NotReady,
    /// The drive takes no moves, and does not have the settings that it gets when the rig is opened for work.
    NotInService,
    /// It takes moves.
    Ready,
}

/// Opens the ports of a rig, simulated or real, and inspects each device on them.
///
/// # Errors
/// [`OpenError`] for a scene that cannot be set up. All other errors are in the [`Inspection`].
pub fn inspect(rig: LoadedRig) -> Result<Inspection, OpenError> {
    let runtime = runtime_of(&rig)?;
    runtime.block_on(inspect_devices(rig))
}

async fn inspect_devices(rig: LoadedRig) -> Result<Inspection, OpenError> {
    let LoadedRig { file, instruments, scene, .. } = rig;
    // The simulated devices live until the end.
    let Ports { analyzer, bus, simulation: _simulation } =
        Ports::open(&file, &instruments, scene, None, Clock::start()).await?;
    let (analyzer_port, analyzer) = look_at_analyzer(&file, &instruments, analyzer).await;
    let (bus_port, linear, rotary) = look_at_bus(&file, &instruments, bus).await;
    Ok(Inspection { ports: [analyzer_port, bus_port], devices: [analyzer, linear, rotary] })
}

async fn look_at_analyzer(
    file: &RigFile,
    instruments: &Instruments,
    port: Result<Port, rig_link::OpenError>,
) -> (PortSeen, DeviceSeen) {
    let name = name(&file.analyzer.port, &port);
    let kind = file.analyzer.port.kind();
    let device = |outcome| DeviceSeen { role: "analyzer", port: name.clone(), kind, outcome };
    let seen = |outcome| PortSeen { role: "analyzer port", name: name.clone(), outcome };
    let port = match port {
        Ok(port) => port,
        Err(error) => return (seen(Err(error)), device(None)),
    };
    let (intruders, transcript) = (port.intruders(), port.transcript());
    let outcome = greet(analyzer_on(port, file, instruments.analyzer), &file.limits).await;
    (seen(Ok(port_facts(&name, intruders, &transcript))), device(Some(outcome)))
}

async fn greet(mut analyzer: Analyzer, limits: &RigLimits) -> Result<DeviceFacts, DeviceError> {
    let mut identity = analyzer.identify().await?;
    let firmware = identity.firmware.take();
    let volt = TRIAL_LEVEL_V.min(limits.analyzer.max_level_v);
    let settings = analyzer.configure(DriveLevel { volt }).await;
    Ok(DeviceFacts { identity: identity.to_string(), firmware, settings, axis: None })
}

async fn look_at_bus(
    file: &RigFile,
    instruments: &Instruments,
    port: Result<Port, rig_link::OpenError>,
) -> (PortSeen, DeviceSeen, DeviceSeen) {
    let name = name(&file.bus, &port);
    let kind = file.bus.kind();
    let device = |role, outcome| DeviceSeen { role, port: name.clone(), kind, outcome };
    let seen = |outcome| PortSeen { role: "bus", name: name.clone(), outcome };
    let port = match port {
        Ok(port) => port,
        Err(error) => {
            return (seen(Err(error)), device("linear stage", None), device("rotary stage", None));
        }
    };
    let (intruders, transcript) = (port.intruders(), port.transcript());
    let bus = BusHandle::open(port, bus_settings(&file.bus));
    let linear =
        look_at_axis(stage(&bus, &file.linear, instruments.linear, file.limits.linear)).await;
    let rotary =
        look_at_axis(stage(&bus, &file.rotary, instruments.rotary, file.limits.rotary)).await;
    let linear = linear.map(|axis| axis_facts(describe(&file.linear, instruments.linear), axis));
    let rotary = rotary.map(|axis| axis_facts(describe(&file.rotary, instruments.rotary), axis));
    (
        seen(Ok(port_facts(&name, intruders, &transcript))),
        device("linear stage", Some(linear.map_err(DeviceError::from))),
        device("rotary stage", Some(rotary.map_err(DeviceError::from))),
    )
}

async fn look_at_axis<U: Unit>(mut stage: Stage<U>) -> Result<AxisFacts, StageError<U>> {
    let Look { mut status, has_settings, .. } = stage.look().await?;
    for _ in 0..LOOKS {
        status = stage.status().await?;
    }
    let mut facts = AxisFacts { has_settings, ..standing(stage.axis(), &status) };
    // Opening the rig for work is what brings a drive into service.
    if facts.state == AxisState::NotReady && !has_settings {
        facts.state = AxisState::NotInService;
    }
    Ok(facts)
}

/// The state of an axis whose drive has its settings.
pub(super) fn standing<U: Unit>(axis: &Axis<U>, status: &AxisStatus<U>) -> AxisFacts {
    let state = match status.alarm {
        Some(alarm) => AxisState::Alarmed(alarm),
        None if status.is_moving => AxisState::Moving,
        // Before homing it accepts no moves.
        None if status.is_homed && !status.is_ready => AxisState::NotReady,
        None => AxisState::Ready,
    };
    let place = if !status.is_homed {
        AxisPosition::NotHomed
    } else if !axis.can_be_at(status.position) {
        AxisPosition::BeyondTravel(axis.travel().to_string())
    } else if axis.target(status.position).is_err() {
        AxisPosition::BeyondLimits(axis.soft().to_string())
    } else {
        AxisPosition::InLimits
    };
    AxisFacts { at: status.position.to_string(), place, state, has_settings: true }
}

const fn axis_facts(identity: String, axis: AxisFacts) -> DeviceFacts {
    DeviceFacts { identity, firmware: None, settings: Ok(()), axis: Some(axis) }
}

fn port_facts(name: &str, intruders: Vec<Holder>, transcript: &Transcript) -> PortFacts {
    let adapter_delay_ms = adapter_delay_ms(Path::new(name));
    PortFacts { intruders, adapter_delay_ms, round_trips: round_trips(transcript) }
}

/// `None` for a path that is not a serial port of this computer.
fn adapter_delay_ms(path: &Path) -> Option<u32> {
    let device = device_of(path)?;
    attached_ports().into_iter().find(|port| Path::new(&port.device) == device)?.latency_ms
}

/// The black box knows when each frame went.
fn round_trips(transcript: &Transcript) -> Option<RoundTrips> {
    let frames = transcript.frames();
    let answered = frames.windows(2).filter_map(|pair| match pair {
        [sent, received] if (sent.flow, received.flow) == (Flow::Sent, Flow::Received) => {
            Some(received.at.since(sent.at).as_secs_f64() * 1e3)
        }
        _ => None,
    });
    let mut all: Vec<f64> = answered.collect();
    all.sort_by(f64::total_cmp);
    let (&median_ms, &longest_ms) = (all.get(all.len() / 2)?, all.last()?);
    Some(RoundTrips { count: all.len(), median_ms, longest_ms })
}

/// The name of the open port, or the name in the rig file.
fn name(file: &PortFile, port: &Result<Port, rig_link::OpenError>) -> String {
    match port {
        Ok(port) => port.name().to_string(),
        Err(_) => file.place().to_owned(),
    }
}
