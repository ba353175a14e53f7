//! One run of the daemon's rig on the simulated bench, in this process.

use std::{io, path::Path};

use rig_contact::Direction;
use rig_engine::RigState;
use rig_report::{RecognitionSummary, RunResults, TouchRow};
use rig_store::{Ending, Reader, RunId, RunStatus, StoreError};
use rigd::{
    files::FileError,
    loaded_rig::LoadedRig,
    protocol_file::LoadedProtocol,
    rig::{self, OpenError, RequestRefusal, RunView},
};
use tempfile::TempDir;
use tokio::sync::watch::error::RecvError;

/// The results of a run that the page uses.
#[derive(Debug)]
pub(super) struct BenchRun {
    pub(super) rig_seconds: f64,
    pub(super) no_load_hz: Option<f64>,
    pub(super) sensitivity_hz_per_mpa: Option<f64>,
    pub(super) recognition: Vec<RecognitionSummary>,
    pub(super) touches: Vec<BenchTouch>,
}

/// A measured touch.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct BenchTouch {
    pub(super) is_blind: bool,
    /// Index of the true sample, also for a blind touch.
    pub(super) sample: usize,
    pub(super) direction: Direction,
    pub(super) angle_deg: f64,
    pub(super) shift_hz: f64,
    pub(super) shift_sigma_hz: f64,
    pub(super) indentation_mm: f64,
}

/// A failed run.
#[derive(Debug, thiserror::Error)]
pub(super) enum BenchError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("the rig is not simulated: a study moves no real bench")]
    NotSimulated,
    #[error("temporary directory")]
    Directory(#[from] io::Error),
    #[error("the rig cannot be opened")]
    Open(#[from] OpenError),
    #[error("the rig refused the run")]
    Refused(#[from] RequestRefusal),
    #[error("the rig ended before the run")]
    Closed(#[from] RecvError),
    #[error("the run is not completed but {status}")]
    NotCompleted { status: String },
    #[error(transparent)]
    Journal(#[from] StoreError),
    #[error("touch {step} has no result, or a sample that the paper does not have")]
    NotATouch { step: String },
}

impl BenchRun {
    /// Runs a protocol on a simulated rig.
    pub(super) fn of(rig: &Path, protocol: &Path) -> Result<Self, BenchError> {
        let rig = LoadedRig::load(rig)?;
        if !rig.is_simulated() {
            return Err(BenchError::NotSimulated);
        }
        let protocol = LoadedProtocol::load(protocol, &rig.facts())?;
        let data = TempDir::new()?;
        let runtime = tokio::runtime::Builder::new_current_thread().build()?;
        let run = runtime.block_on(replay(rig, protocol, data.path()))?;
        let reader = Reader::open(data.path())?;
        let results = RunResults::new(&reader.run(run)?, &reader.records(run)?);
        Self::from_results(&results.map_err(StoreError::from)?)
    }

    fn from_results(results: &RunResults) -> Result<Self, BenchError> {
        let (status, summary) = (results.run().status, results.summary());
        if status != RunStatus::Ended(Ending::Completed) {
            return Err(BenchError::NotCompleted { status: status.describe() });
        }
        let touch = |row: &TouchRow| {
            BenchTouch::of(row).ok_or_else(|| BenchError::NotATouch { step: row.step.clone() })
        };
        Ok(Self {
            rig_seconds: summary.rig_seconds,
            no_load_hz: summary.no_load_hz,
            sensitivity_hz_per_mpa: summary.sensitivity_hz_per_mpa,
            recognition: summary.recognition,
            touches: results.touches().iter().map(touch).collect::<Result<_, _>>()?,
        })
    }
}

impl BenchTouch {
    fn of(row: &TouchRow) -> Option<Self> {
        Some(Self {
            is_blind: row.phase == "blind",
            // The protocol numbers its samples from one, softest first.
            sample: row.sample.parse::<usize>().ok()?.checked_sub(1)?,
            direction: Direction::ALL.into_iter().find(|one| one.name() == row.direction)?,
            angle_deg: row.angle_deg,
            shift_hz: row.shift_hz?,
            shift_sigma_hz: row.shift_sigma_hz?,
            indentation_mm: row.indentation_mm?,
        })
    }
}

/// Replays the protocol to its end and closes the rig.
async fn replay(
    rig: LoadedRig,
    protocol: LoadedProtocol,
    data: &Path,
) -> Result<RunId, BenchError> {
    let (handle, thread) = rig::open(rig, data.to_owned())?;
    let mut status = handle.status();
    // After opening, the rig homes its axes and proves that the probe is clear.
    let is_ready = |state| matches!(state, RigState::Idle | RigState::Latched);
    status.wait_for(|status| is_ready(status.snapshot.state)).await?;
    let id = handle.run(protocol, "rig-study").await?;
    let is_ended = |run: &RunView| run.id == id && run.ending.is_some();
    status.wait_for(|status| status.run.as_ref().is_some_and(is_ended)).await?;
    handle.close().await;
    thread.join();
    Ok(id)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_touch_of_a_run_in_this_process_is_read() {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        let (rig, protocol) =
            (config.join("rigs/simulated.toml"), config.join("protocols/smoke.toml"));
        let run = BenchRun::of(&rig, &protocol).unwrap();
        assert_eq!(run.touches.len(), 18);
        assert_eq!(run.touches.iter().filter(|touch| touch.is_blind).count(), 6);
        let first = &run.touches[0];
        assert_eq!((first.sample, first.direction, first.angle_deg), (0, Direction::Front, 0.0));
        assert!((first.shift_hz - 8.0).abs() < 1.0, "{first:?}");
        assert!((run.no_load_hz.unwrap() - 140.4).abs() < 0.2, "{run:?}");
    }

    #[test]
    fn a_real_bench_is_refused() {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        let (rig, protocol) = (config.join("rigs/bench.toml"), config.join("protocols/smoke.toml"));
        let refused = BenchRun::of(&rig, &protocol);
        assert!(matches!(refused, Err(BenchError::NotSimulated)), "{refused:?}");
    }
}
