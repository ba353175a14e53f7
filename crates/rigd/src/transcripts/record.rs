//! Records a transcript of each device of a rig. Nothing moves, and nothing is written into a drive.

use rig_analyzer::Analyzer;
use rig_files::{
    instrument::Dialect,
    rig_file::{AxisFile, Connection, PortFile, RigFile},
};
use rig_link::{Clock, OpenError as PortError, Port, Transcript};
use rig_model::{Axis, LineSettings, Parity, StopBits, Unit, with_causes};
use rig_stage::{BusHandle, RegisterMap, Stage};

use super::{
    TranscriptFile,
    file::Section,
    replay::Device,
    roles::{AnalyzerTask, of_analyzer, of_drive},
};
use crate::{
    loaded_rig::LoadedRig,
    rig::{OpenError, Ports, analyzer_on, bus_settings, runtime_of},
};

/// Frames that are kept while a device is recorded: with an echo, each character is two of them.
const FRAMES: usize = 20_000;

/// The level of the readings, V; less where the rig allows less.
const LEVEL_V: f64 = 1.0;

/// The transcript of a device.
#[derive(Debug)]
pub(crate) struct Recorded {
    /// Role of the device on the rig.
    pub(crate) device: &'static str,
    pub(crate) instrument: Device,
    pub(crate) file: TranscriptFile,
    /// Why the roles after the recorded ones are not there.
    pub(crate) fault: Option<String>,
}

/// Records every device of a rig.
///
/// # Errors
/// [`OpenError`] for a scene that cannot be set up. Ports and devices have their fault in [`Recorded`].
pub(crate) fn record(rig: LoadedRig) -> Result<Vec<Recorded>, OpenError> {
    let runtime = runtime_of(&rig)?;
    runtime.block_on(async {
        let LoadedRig { file, instruments, scene, .. } = rig;
        // The simulated devices live until the end.
        let Ports { analyzer, bus, simulation: _simulation } =
            Ports::open(&file, &instruments, scene, None, Clock::start()).await?;
        let (recorded, _) = record_analyzer(&file, instruments.analyzer, analyzer).await;
        let mut all = vec![recorded];
        let drives = [("linear stage", instruments.linear), ("rotary stage", instruments.rotary)];
        match bus {
            Err(error) => all.extend(drives.map(|(device, map)| {
                let instrument = Device::Drive(map);
                nothing(device, instrument, &error)
            })),
            Ok(port) => {
                let transcript = port.transcript();
                keep_frames(&transcript);
                let bus = BusHandle::open(port, bus_settings(&file.bus));
                let [(first, linear), (second, rotary)] = drives;
                let axis = (&file.linear, file.limits.linear);
                all.push(record_axis(first, linear, axis, &bus, &transcript, &file.bus).await.0);
                let axis = (&file.rotary, file.limits.rotary);
                all.push(record_axis(second, rotary, axis, &bus, &transcript, &file.bus).await.0);
            }
        }
        Ok(all)
    })
}

fn nothing(device: &'static str, instrument: Device, error: &PortError) -> Recorded {
    Recorded {
        device,
        instrument,
        file: TranscriptFile::default(),
        fault: Some(with_causes(error)),
    }
}

/// Keeps enough frames for a device.
pub(crate) fn keep_frames(transcript: &Transcript) {
    transcript.keep(FRAMES);
}

/// Records the roles of an analyzer, and returns its driver if the port is open.
pub(crate) async fn record_analyzer(
    rig: &RigFile,
    dialect: &'static Dialect,
    port: Result<Port, PortError>,
) -> (Recorded, Option<Analyzer>) {
    let (device, instrument) = ("analyzer", Device::Analyzer(dialect));
    let port = match port {
        Ok(port) => port,
        Err(error) => return (nothing(device, instrument, &error), None),
    };
    let transcript = port.transcript();
    keep_frames(&transcript);
    let ((low_hz, high_hz), level_v) =
        (rig.limits.analyzer.frequency_hz, LEVEL_V.min(rig.limits.analyzer.max_level_v));
    let task = AnalyzerTask { level_v, low_hz, high_hz };
    let mut head = head(instrument, rig.analyzer.port.line());
    let numbers = [("level_v", level_v), ("low_hz", low_hz), ("high_hz", high_hz)];
    head.extend(numbers.map(|(key, value)| (key.to_owned(), value.to_string())));
    head.push(("reply_timeout_s".to_owned(), rig.analyzer.reply_timeout_s.to_string()));
    let is_real = rig.connection == Connection::Ports;
    if let Some(terminator) = rig.analyzer.terminator.filter(|_| is_real) {
        head.push(("terminator".to_owned(), terminator.name().to_owned()));
    }
    let mut file = TranscriptFile { head, sections: Vec::new() };
    let mut analyzer = analyzer_on(port, rig, dialect);
    let mut fault = None;
    for &role in instrument.roles() {
        let before = transcript.frames().len();
        match of_analyzer(&mut analyzer, role, &task).await {
            Ok(result) => {
                let frames = transcript.frames().split_off(before);
                file.sections.push(Section { role, frames, result });
            }
            Err(error) => {
                fault = Some(format!("{}: {}", role.name(), with_causes(&error)));
                break;
            }
        }
    }
    (Recorded { device, instrument, file, fault }, Some(analyzer))
}

/// Records a look at the drive of an axis, and returns its driver.
pub(crate) async fn record_axis<U: Unit>(
    device: &'static str,
    map: &'static RegisterMap,
    (axis_file, axis): (&AxisFile<U>, Axis<U>),
    bus: &BusHandle,
    transcript: &Transcript,
    port: &PortFile,
) -> (Recorded, Stage<U>) {
    let instrument = Device::Drive(map);
    let mut head = head(instrument, port.line());
    let scale = axis_file.scale;
    head.push(("unit_id".to_owned(), axis_file.unit_id.to_string()));
    let numbers = [
        ("per_count", scale.per_count),
        ("zero", scale.zero.value()),
        ("counts_per_revolution", scale.counts_per_revolution),
        ("acceleration", scale.acceleration_per_s2),
        ("soft_min", axis.soft().min.value()),
        ("soft_max", axis.soft().max.value()),
    ];
    head.extend(numbers.map(|(key, value)| (key.to_owned(), value.to_string())));
    let mut file = TranscriptFile { head, sections: Vec::new() };
    let mut stage = Stage::new(bus.clone(), map, axis_file.unit_id, scale, axis);
    let mut fault = None;
    for &role in instrument.roles() {
        let before = transcript.frames().len();
        match of_drive(&mut stage).await {
            Ok(result) => {
                let frames = transcript.frames().split_off(before);
                file.sections.push(Section { role, frames, result });
            }
            Err(error) => fault = Some(format!("{}: {}", role.name(), with_causes(&error))),
        }
    }
    (Recorded { device, instrument, file, fault }, stage)
}

/// What every transcript begins with.
fn head(instrument: Device, line: Option<LineSettings>) -> Vec<(String, String)> {
    let line = line.map_or("tcp".to_owned(), |LineSettings { baud, parity, stop_bits }| {
        let parity = match parity {
            Parity::None => "none",
            Parity::Even => "even",
            Parity::Odd => "odd",
        };
        let stop_bits = if stop_bits == StopBits::Two { 2 } else { 1 };
        format!("{baud} {parity} {stop_bits}")
    });
    vec![("instrument".to_owned(), instrument.name().to_owned()), ("line".to_owned(), line)]
}
