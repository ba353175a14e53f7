//! Whether a run shows a bench as it is now: it was made on this rig, with the axes that its rig file describes, and since the
//! bench was changed last.

use jiff::Timestamp;
use rig_commission::{Basis, Calibration, Kind, last_change};
use rig_files::rig_file::RigFile;
use rig_store::{Run, RunStarted, Source};

use crate::{loaded_rig::FileError, local_time::local};

/// Why a run does not show a bench as it is now.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NotOfBench {
    #[error("{run} was made on the rig {was}, and not on the rig {is}")]
    OtherBench { run: String, was: String, is: String },
    #[error("{run} was made with other values of [linear] or [rotary] than the rig file has now")]
    OtherAxes { run: String },
    #[error(
        "{run} was begun {}, before the bench was changed {} ({change})",
        local(begun),
        local(changed)
    )]
    Changed { run: String, begun: String, changed: String, change: String },
    #[error("{run} is still under way")]
    UnderWay { run: String },
    #[error("{run} has a time that this rigd does not read")]
    NoTime { run: String, source: jiff::Error },
    /// The rig file of the run cannot be read by this version.
    #[error(transparent)]
    RigFile(#[from] FileError),
}

impl NotOfBench {
    /// Whether the run is another one than is asked for; otherwise it cannot be read.
    pub(crate) const fn is_other_run(&self) -> bool {
        !matches!(self, Self::NoTime { .. } | Self::RigFile(_))
    }
}

/// Refuses a run of another bench, which has drives, a table and a sensor of its own, and one that was made with other scales
/// and zeros of the axes than the rig file has now: its heights and tilts are not comparable.
///
/// # Errors
/// [`NotOfBench`].
pub(crate) fn is_of_bench(
    run: &Run,
    started: &RunStarted,
    (rig, basis): (&str, &Basis),
) -> Result<(), NotOfBench> {
    let Source { name, toml } = &started.rig;
    let (was_simulated, is_simulated) = (started.is_simulated, basis.is_simulated());
    if name != rig || was_simulated != is_simulated {
        let text = |name: &str, is_simulated: bool| {
            format!("\"{name}\" ({})", if is_simulated { "simulated" } else { "real" })
        };
        let (was, is) = (text(name, was_simulated), text(rig, is_simulated));
        return Err(NotOfBench::OtherBench { run: run.short_name(), was, is });
    }
    let file = RigFile::read(name, toml).map_err(FileError::Faults)?;
    // The keys of the axes alone are compared; the instrument files of that time are not in the journal.
    if Basis::of(&file, [None, None]).sha256(Kind::Scale) != basis.sha256(Kind::Scale) {
        return Err(NotOfBench::OtherAxes { run: run.short_name() });
    }
    Ok(())
}

/// Refuses a run that was begun before a change of the bench has voided what was shown of a kind.
///
/// # Errors
/// [`NotOfBench`].
pub(crate) fn is_since_change(
    run: &Run,
    kind: Kind,
    (records, basis): (&[Calibration], &Basis),
) -> Result<(), NotOfBench> {
    let Some(change) = last_change(kind, records, basis) else { return Ok(()) };
    if times(run)?.begun.as_second() < change.made_unix_s() {
        return Err(NotOfBench::Changed {
            run: run.short_name(),
            begun: run.started_at.clone(),
            changed: change.made().to_owned(),
            change: change.reason.clone().unwrap_or_default(),
        });
    }
    Ok(())
}

/// The times of a run that has ended.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Times {
    pub(crate) begun: Timestamp,
    pub(crate) ended: Timestamp,
}

/// When a run was begun and has ended.
///
/// # Errors
/// [`NotOfBench`], if it has not ended.
pub(crate) fn times(run: &Run) -> Result<Times, NotOfBench> {
    let read = |time: &str| {
        time.parse().map_err(|source| NotOfBench::NoTime { run: run.short_name(), source })
    };
    let ended = run.finished_at.as_deref();
    let ended = ended.ok_or_else(|| NotOfBench::UnderWay { run: run.short_name() })?;
    Ok(Times { begun: read(&run.started_at)?, ended: read(ended)? })
}
