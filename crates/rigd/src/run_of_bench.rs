//! Whether a run shows a bench as it is now: it was made on this rig, with the axes that its rig file describes, and since the
//! bench was changed last.

use jiff::Timestamp;
use rig_commission::{Basis, Calibration, HOLDS_S, Kind, last_change};
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
    #[error("{run} ended {}, and a calibration holds for a year", local(ended))]
    Expired { run: String, ended: String },
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

/// Refuses a run that was begun before a change of the bench has voided what was shown of a kind, or that ended longer ago
/// than a calibration holds.
///
/// # Errors
/// [`NotOfBench`].
pub(crate) fn still_shows(
    run: &Run,
    kind: Kind,
    now: Timestamp,
    (records, basis): (&[Calibration], &Basis),
) -> Result<(), NotOfBench> {
    let Times { begun, ended } = times(run)?;
    if ended.as_second() + HOLDS_S <= now.as_second() {
        return Err(NotOfBench::Expired { run: run.short_name(), ended: ended.to_string() });
    }
    let Some(change) = last_change(kind, records, basis) else { return Ok(()) };
    if begun.as_second() < change.made_unix_s() {
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

#[cfg(test)]
mod tests {
    use jiff::SignedDuration;
    use rig_store::{Ending, RunKind, RunStatus};

    use super::*;

    #[test]
    fn a_run_shows_a_bench_for_a_year() {
        let text = include_str!("../../../config/rigs/simulated.toml");
        let basis = Basis::of(&RigFile::read("rig.toml", text).unwrap(), [None, None]);
        let run = Run {
            id: "01890a5d-ac96-774b-bcce-b302099a8057".parse().unwrap(),
            kind: RunKind::Run,
            name: "block".to_owned(),
            number: 3,
            started_at: "2026-03-01T08:00:00.000Z".to_owned(),
            finished_at: Some("2026-03-01T09:00:00.000Z".to_owned()),
            wall_s: Some(3600.0),
            status: RunStatus::Ended(Ending::Completed),
            records: 100,
            epoch: 1,
            amendments: 0,
            is_sealed: true,
        };
        let shows = |now: Timestamp| still_shows(&run, Kind::Scale, now, (&[], &basis));
        let expires: Timestamp = "2027-03-01T09:00:00Z".parse().unwrap();
        assert!(shows(expires - SignedDuration::from_secs(1)).is_ok());
        let refused = shows(expires).unwrap_err();
        assert!(refused.is_other_run());
        let said = refused.to_string();
        assert!(
            said.starts_with("block-3 ended 2026-03-0") && said.ends_with("holds for a year"),
            "{said}"
        );
    }
}
