//! Where the files of a run are.

use std::path::{Path, PathBuf};

use rig_store::{Reader, RunId};

/// The folder of the files of a run. Its name says whether the run was simulated.
pub(crate) fn of(data: &Path, reader: &Reader, run: RunId) -> PathBuf {
    let suffix = if reader.is_simulated(run) { "-simulated" } else { "" };
    data.join("runs").join(format!("{run}{suffix}"))
}
