//! Speaks to the analyzer of a rig alone: the bus of the drives stays closed, and no journal is needed.

use rig_analyzer::Analyzer;
use rig_files::rig_file::Connection;
use rig_link::Clock;

use super::{
    DeviceError, OpenError,
    open::{Ports, analyzer_on, device, open_port, runtime_of},
};
use crate::loaded_rig::LoadedRig;

/// Opens the analyzer of a rig, simulated or real, and does some work with it.
///
/// # Errors
/// [`OpenError`], with the error of the work as that of the analyzer.
pub(crate) fn analyzer_alone<T>(
    rig: LoadedRig,
    work: impl AsyncFnOnce(&mut Analyzer) -> Result<T, DeviceError>,
) -> Result<T, OpenError> {
    let runtime = runtime_of(&rig)?;
    runtime.block_on(async {
        let LoadedRig { file, instruments, scene, .. } = rig;
        let clock = Clock::start();
        // The simulated devices live until the end.
        let (port, _simulation) = match &file.connection {
            Connection::Ports => (open_port(&file.analyzer.port, clock).await, None),
            Connection::Simulated(_) => {
                let Ports { analyzer, simulation, .. } =
                    Ports::open(&file, &instruments, scene, None, clock).await?;
                (analyzer, simulation)
            }
        };
        let port = port.map_err(|source| OpenError::Port { role: "analyzer", source })?;
        let mut analyzer = analyzer_on(port, &file, instruments.analyzer);
        work(&mut analyzer).await.map_err(device("analyzer", &file.analyzer.port))
    })
}
