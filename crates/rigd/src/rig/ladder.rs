//! Tries the speeds and parities of a serial line until its drives answer. Only registers are read.

use rig_files::rig_file::{PortFile, RigFile};
use rig_link::Clock;
use rig_model::{LineSettings, Parity, StopBits};
use rig_stage::{BusHandle, BusSettings};

use super::{
    OpenError,
    open::{open_port, stage},
};
use crate::{instruments::Instruments, loaded_rig::LoadedRig};

/// The speeds of drives, bits per second.
const BAUDS: [u32; 6] = [115_200, 9_600, 19_200, 38_400, 57_600, 230_400];

/// The parities, the most usual one first.
const PARITIES: [Parity; 3] = [Parity::Even, Parity::None, Parity::Odd];

/// A speed and a parity at which something answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rung {
    /// The settings of the line.
    pub line: LineSettings,
    /// Whether the drive of the linear stage answered as its make does.
    pub linear: bool,
    /// Whether the drive of the rotary stage did.
    pub rotary: bool,
}

/// A rig whose bus is no serial line of this computer.
#[derive(Debug, thiserror::Error)]
pub enum LadderError {
    /// There are no speeds to try.
    #[error("the bus of this rig is no serial line of this computer, and has no speed to be tried")]
    NoLine,
    /// A port or a thread is not to be had.
    #[error(transparent)]
    Open(#[from] OpenError),
}

/// Tries every speed and parity on the bus of a rig, and returns those at which a drive answered.
/// `report` gets each one before it is tried, and once more with the reason if the port does not take it: not every
/// adapter has every speed. Nothing is written, and nothing moves.
///
/// # Errors
/// [`LadderError`], also if the port takes no setting.
pub fn climb(
    rig: &LoadedRig,
    report: impl Fn(LineSettings, Option<&OpenError>),
) -> Result<Vec<Rung>, LadderError> {
    let LoadedRig { file, instruments, .. } = rig;
    let path = match &file.bus {
        PortFile::Serial { path, .. } if !rig.is_simulated() => path,
        PortFile::Serial { .. } | PortFile::Tcp { .. } | PortFile::Usbtmc { .. } => {
            return Err(LadderError::NoLine);
        }
    };
    let (mut found, mut was_open, mut trouble) = (Vec::new(), false, None);
    for parity in PARITIES {
        for baud in BAUDS {
            let line = LineSettings { baud, parity, stop_bits: StopBits::One };
            report(line, None);
            // With its runtime ends the owner of the port, which is closed before it is opened again.
            let runtime = tokio::runtime::Builder::new_current_thread()
                .enable_all()
                .build()
                .map_err(|source| OpenError::Thread { source })?;
            match runtime.block_on(try_line(file, instruments, path, line)) {
                Ok(rung) => {
                    was_open = true;
                    found.extend(Some(rung).filter(|rung| rung.linear || rung.rotary));
                }
                Err(error) => {
                    report(line, Some(&error));
                    trouble = Some(error);
                }
            }
        }
    }
    match trouble {
        Some(error) if !was_open => Err(error.into()),
        _ => Ok(found),
    }
}

async fn try_line(
    file: &RigFile,
    instruments: &Instruments,
    path: &str,
    line: LineSettings,
) -> Result<Rung, OpenError> {
    let port = PortFile::Serial { path: path.to_owned(), line };
    let port = open_port(&port, Clock::start()).await;
    let port = port.map_err(|source| OpenError::Port { role: "bus", source })?;
    let bus = BusHandle::open(port, BusSettings::rtu());
    let mut linear = stage(&bus, &file.linear, instruments.linear, file.limits.linear);
    let mut rotary = stage(&bus, &file.rotary, instruments.rotary, file.limits.rotary);
    Ok(Rung { line, linear: linear.look().await.is_ok(), rotary: rotary.look().await.is_ok() })
}
