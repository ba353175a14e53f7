//! The one seam between a simulated and a real rig: both end in the same drivers.

use std::{path::PathBuf, sync::Arc, time::Duration};

use rig_analyzer::{Analyzer, AnalyzerError, Dialect, TransportSettings};
use rig_files::rig_file::{AnalyzerFile, AxisFile, Connection, PortFile, RigFile};
use rig_interlock::Proven;
use rig_link::{Clock, Endpoint, Port, Transcript};
use rig_model::{Deg, Mm, PortKind, Reading, Unit};
use rig_stage::{BusHandle, BusSettings, HaltFrames, RegisterMap, Stage, StageError};
use rig_store::StoreError;
use tokio::{runtime::Runtime, sync::mpsc};

use super::{
    DeviceIdentity, Meters, Setting,
    devices::{Axes, GatedAnalyzer},
    gate::Gate,
};
use crate::{
    instruments::{Instruments, NotSimulated},
    loaded_rig::{LoadedRig, LoadedScene},
    simulation::{SceneError, SimHandle, Simulation},
};

/// Why a rig cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The thread of the rig cannot be started.
    #[error("the rig thread cannot be started")]
    Thread {
        /// The error of the system.
        source: std::io::Error,
    },
    /// The thread of the rig has ended without a message.
    #[error("the rig thread has ended")]
    Gone,
    /// The journal cannot be opened.
    #[error("data directory {}", data.display())]
    Data {
        /// The data directory.
        data: PathBuf,
        /// The error of the journal.
        source: StoreError,
    },
    /// The scene cannot be set up.
    #[error("scene")]
    Scene(#[from] SceneError),
    /// A simulated rig has an instrument that no simulated device plays.
    #[error(transparent)]
    NotSimulated(#[from] NotSimulated),
    /// A port cannot be opened.
    #[error("{role}")]
    Port {
        /// Role of the devices on the port.
        role: &'static str,
        /// The error of the port.
        source: rig_link::OpenError,
    },
    /// A device does not answer as it should.
    #[error("{role}")]
    Device {
        /// Its role on the rig.
        role: &'static str,
        /// What its port is to this computer.
        kind: PortKind,
        /// The error of the device, with the failed action.
        source: Box<DeviceError>,
    },
}

/// The error of a device. The caller knows which one.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// An error of the analyzer.
    #[error(transparent)]
    Analyzer(#[from] AnalyzerError),
    /// The linear stage.
    #[error(transparent)]
    Linear(#[from] StageError<Mm>),
    /// The rotary stage.
    #[error(transparent)]
    Rotary(#[from] StageError<Deg>),
}

/// A device of this role did this.
pub(super) fn device<E: Into<DeviceError>>(
    role: &'static str,
    port: &PortFile,
) -> impl Fn(E) -> OpenError {
    let kind = port.kind();
    move |error| OpenError::Device { role, kind, source: Box::new(error.into()) }
}

/// A rig whose devices have answered.
pub(super) struct Opened {
    pub(super) setting: Setting,
    pub(super) analyzer: GatedAnalyzer,
    /// Its readings during a descent.
    pub(super) streamed: mpsc::UnboundedReceiver<Reading>,
    pub(super) axes: Axes,
    pub(super) gate: Gate,
    pub(super) halt: Halt,
    pub(super) simulation: Option<Simulation>,
    /// The last frames of each port, under its name.
    pub(super) black_boxes: [(Arc<str>, Transcript); 2],
    /// The samples whose stiffness is known, and how stiff they are, MPa.
    pub(super) known_samples: Vec<(String, f64)>,
    /// Patience with a linear stage that does not answer on the way out of contact.
    pub(super) patience: Duration,
}

/// Longest wait for the frames of a stop to leave.
pub(super) const HALT_WITHIN: Duration = Duration::from_millis(200);

/// Stops both axes without waiting for anything.
pub(super) struct Halt {
    bus: BusHandle,
    frames: HaltFrames,
}

impl Halt {
    /// The frames leave now, also when the result is not awaited. It ends when they have left.
    pub(super) fn now(&self) -> impl Future<Output = ()> + use<> {
        self.bus.halt(self.frames.clone())
    }
}

/// Opens the ports of a rig, simulated or real, and has every device identify itself.
/// A simulated one is at `bench`, or at a new one. Drives of which calibrations show too little are only looked at.
pub(super) async fn open_rig(
    rig: LoadedRig,
    bench: Option<SimHandle>,
    clock: Clock,
    proven: Proven,
) -> Result<Opened, OpenError> {
    let known_samples = rig.known_samples();
    let rests_on = Arc::new(rig.basis());
    let LoadedRig { file, instruments, source, scene, .. } = rig;
    let scene_source = scene.as_ref().map(|scene| scene.source().clone());
    let Ports { analyzer, bus, simulation } =
        Ports::open(&file, &instruments, scene, bench, clock).await?;
    let analyzer_port = analyzer.map_err(|source| OpenError::Port { role: "analyzer", source })?;
    let bus_port = bus.map_err(|source| OpenError::Port { role: "bus", source })?;
    let black_boxes =
        [&analyzer_port, &bus_port].map(|port| (port.name().clone(), port.transcript()));
    let mut analyzer = analyzer_on(analyzer_port, &file, instruments.analyzer);
    let bus = BusHandle::open(bus_port, bus_settings(&file.bus));
    let mut linear = stage(&bus, &file.linear, instruments.linear, file.limits.linear);
    let mut rotary = stage(&bus, &file.rotary, instruments.rotary, file.limits.rotary);
    let identity = analyzer.identify().await.map_err(device("analyzer", &file.analyzer.port))?;
    find(&mut linear, proven).await.map_err(device("linear stage", &file.bus))?;
    find(&mut rotary, proven).await.map_err(device("rotary stage", &file.bus))?;
    let device_of =
        |role, identity, health, instrument| DeviceIdentity { role, identity, instrument, health };
    let on_linear = describe(&file.linear, instruments.linear);
    let on_rotary = describe(&file.rotary, instruments.rotary);
    let [of_analyzer, of_linear, of_rotary] = instruments.own_files;
    let devices = Arc::new([
        device_of("analyzer", identity.to_string(), analyzer.health(), of_analyzer),
        device_of("linear stage", on_linear, linear.health(), of_linear),
        device_of("rotary stage", on_rotary, rotary.health(), of_rotary),
    ]);
    let setting = Setting {
        limits: file.limits,
        rig: source,
        scene: scene_source,
        devices,
        rests_on,
        meters: Meters::default(),
    };
    let is_homing_up = file.linear.is_homing_up;
    let patience = Duration::from_secs_f64(file.recovery_patience_s);
    let gate = Gate::new(&file.limits, proven, clock);
    let axes = Axes { linear, rotary, is_homing_up, is_rotary_doubtful: false, gate: gate.clone() };
    // A descent ends at its target at the latest, so that some hundred readings wait here at most.
    let (readings, streamed) = mpsc::unbounded_channel();
    let analyzer = GatedAnalyzer { analyzer, gate: gate.clone(), readings };
    let frames = axes.halt_frames().map_err(device("bus", &file.bus))?;
    let halt = Halt { bus, frames };
    Ok(Opened {
        setting,
        analyzer,
        streamed,
        axes,
        gate,
        halt,
        simulation,
        black_boxes,
        known_samples,
        patience,
    })
}

/// Finds a drive. One that says that it is where it cannot be must be understood by a person before
/// anything moves, this axis or the other. Nothing is written into a drive whose sign and scale may be wrong, and
/// its position says nothing.
async fn find<U: Unit>(stage: &mut Stage<U>, proven: Proven) -> Result<(), StageError<U>> {
    if proven != Proven::Bench {
        return stage.look().await.map(drop);
    }
    if stage.identify().await?.is_homed {
        stage.trusted_position()?;
    }
    Ok(())
}

/// A runtime for a conversation with the devices of a rig. On virtual time, its clock stands still until everything waits.
pub(crate) fn runtime_of(rig: &LoadedRig) -> Result<Runtime, OpenError> {
    tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .start_paused(rig.is_virtual_time())
        .build()
        .map_err(|source| OpenError::Thread { source })
}

/// The ports of a rig. One can be open while the other is not.
pub(crate) struct Ports {
    pub(crate) analyzer: Result<Port, rig_link::OpenError>,
    pub(crate) bus: Result<Port, rig_link::OpenError>,
    pub(crate) simulation: Option<Simulation>,
}

impl Ports {
    /// Opens them; with a scene, simulated devices replace those on the ports.
    pub(crate) async fn open(
        file: &RigFile,
        instruments: &Instruments,
        scene: Option<LoadedScene>,
        bench: Option<SimHandle>,
        clock: Clock,
    ) -> Result<Self, OpenError> {
        if let Some(scene) = scene {
            let makes = instruments.simulated()?;
            return Ok(
                Self::simulated(file, Simulation::start(file, makes, scene, bench)?, clock).await
            );
        }
        Ok(Self {
            analyzer: open_port(&file.analyzer.port, clock).await,
            bus: open_port(&file.bus, clock).await,
            simulation: None,
        })
    }

    async fn simulated(file: &RigFile, simulation: Simulation, clock: Clock) -> Self {
        Self {
            analyzer: Port::open(simulation.analyzer(file), clock).await,
            bus: Port::open(simulation.bus(file), clock).await,
            simulation: Some(simulation),
        }
    }
}

/// An analyzer as the rig file describes it. A simulated one ends its messages as is usual.
pub(crate) fn analyzer_on(port: Port, file: &RigFile, dialect: &'static Dialect) -> Analyzer {
    let AnalyzerFile { terminator, reply_timeout_s, .. } = &file.analyzer;
    let terms = TransportSettings {
        terminator: terminator.filter(|_| file.connection == Connection::Ports),
        reply_within: Duration::from_secs_f64(*reply_timeout_s),
    };
    Analyzer::open_with(port, dialect, terms)
}

pub(super) fn stage<U: Unit>(
    bus: &BusHandle,
    file: &AxisFile<U>,
    map: &'static RegisterMap,
    axis: rig_model::Axis<U>,
) -> Stage<U> {
    Stage::new(bus.clone(), map, file.unit_id, file.scale, axis)
}

/// The identity of a drive. Few drives report one.
pub(super) fn describe<U>(file: &AxisFile<U>, map: &RegisterMap) -> String {
    format!("{} at unit {}", map.name, file.unit_id)
}

/// Modbus RTU on a serial line, Modbus TCP on the network. A rig file has no drives on another port.
pub(crate) const fn bus_settings(port: &PortFile) -> BusSettings {
    match port {
        PortFile::Serial { .. } => BusSettings::rtu(),
        PortFile::Tcp { .. } | PortFile::Usbtmc { .. } => BusSettings::tcp(),
    }
}

pub(super) async fn open_port(port: &PortFile, clock: Clock) -> Result<Port, rig_link::OpenError> {
    let endpoint = match port {
        PortFile::Serial { path, line } => Endpoint::Serial { path: path.clone(), line: *line },
        PortFile::Tcp { address } => Endpoint::Tcp { address: address.clone() },
        PortFile::Usbtmc { path } => Endpoint::Usbtmc { path: path.clone() },
    };
    Port::open(endpoint, clock).await
}
