//! The check of the free sensor of a rig of a daemon, begun by a client: a task makes its sweeps, as `rigd measure` would.
//!
//! ```text
//!   start ──▶ task: sweep ──▶ wait for its end ──▶ [`Progress`] ──▶ next … ──▶ record
//! ```

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rig_commission::{Finding, sensor::SensorSweeps};
use rig_engine::{Command, RigState};
use rig_model::{Clearance, RigTime, SweepRequest, with_causes};
use rig_store::{Reader, RunId, StoreError, Sweep};
use tokio::{sync::watch, task::JoinError};
use tokio_util::sync::CancellationToken;

use super::{FreeSensor, NoRecord, SensorCheck, keep};
use crate::{
    calibrations::Witness,
    commissioning::Commissioned,
    rig::{RequestRefusal, RigHandle, Status},
    sweeps,
};

/// The checks of the sensor of one rig.
#[derive(Debug, Clone)]
pub(crate) struct SensorWatch {
    rig: RigHandle,
    of: Commissioned,
    progress: Arc<Mutex<Progress>>,
}

/// Where the check is.
#[derive(Debug, Clone, Default)]
pub(crate) struct Progress {
    /// Whether one is under way.
    pub(crate) is_under_way: bool,
    /// Time for which the sensor is watched, minutes; 0 before the first check.
    pub(crate) minutes: u32,
    /// Sweeps so far, with the surveys.
    pub(crate) sweeps: usize,
    /// Refused ones among them.
    pub(crate) refused: usize,
    /// The finding of the last check, with the name of its file.
    pub(crate) found: Option<(Finding, String)>,
    /// Why the last check has no finding.
    pub(crate) trouble: Option<String>,
    stop: CancellationToken,
    /// Who aborted it.
    aborted_by: Option<String>,
}

/// Why a request about the check is refused.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SensorCheckRefusal {
    #[error("a check of the sensor is under way; wait for its end, or abort it")]
    UnderWay,
    #[error("no check of the sensor is under way")]
    NotUnderWay,
    #[error("the probe is {}; retract it, so that the sensor is free", .0.name())]
    NotClear(Clearance),
    #[error("the rig is {}; the check begins on an idle one", .0.name())]
    NotIdle(RigState),
}

/// Why a check ends without a record.
#[derive(Debug, thiserror::Error)]
enum Ended {
    #[error("aborted")]
    Aborted,
    #[error(transparent)]
    Refused(#[from] RequestRefusal),
    #[error("the probe was {} during a sweep, so that the sensor was not free", .0.name())]
    NotClear(Clearance),
    #[error("the rig is latched: {0}")]
    Latched(String),
    #[error("sweep {0} was ended by another command")]
    NoSweep(u64),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("reading the journal has panicked")]
    Panicked(#[from] JoinError),
    #[error(transparent)]
    NoRecord(#[from] NoRecord),
}

impl SensorWatch {
    /// No check is under way yet.
    pub(crate) fn new(rig: RigHandle, of: Commissioned) -> Self {
        Self { rig, of, progress: Arc::default() }
    }

    /// Where it is. Nothing that holds it panics.
    pub(crate) fn progress(&self) -> MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins a check. It ends without a record when another command takes the rig between two of its sweeps.
    ///
    /// # Errors
    /// [`SensorCheckRefusal`]; nothing has begun then.
    pub(crate) fn start(
        &self,
        check: SensorCheck,
        by: String,
        temperature_c: Option<f64>,
    ) -> Result<(), SensorCheckRefusal> {
        let stop = CancellationToken::new();
        {
            let (state, clearance) = {
                let status = self.rig.status();
                let status = status.borrow();
                (status.snapshot.state, status.snapshot.clearance)
            };
            let mut progress = self.progress();
            if progress.is_under_way {
                return Err(SensorCheckRefusal::UnderWay);
            }
            if state != RigState::Idle {
                return Err(SensorCheckRefusal::NotIdle(state));
            }
            if clearance != Clearance::Clear {
                return Err(SensorCheckRefusal::NotClear(clearance));
            }
            *progress = Progress {
                is_under_way: true,
                minutes: check.minutes,
                stop: stop.clone(),
                ..Progress::default()
            };
        }
        let this = self.clone();
        tokio::spawn(async move {
            let ended = this.make(check, by, temperature_c, stop).await;
            let mut progress = this.progress();
            progress.is_under_way = false;
            match ended {
                Ok(found) => progress.found = Some(found),
                Err(ended) => progress.trouble = Some(with_causes(&ended)),
            }
        });
        Ok(())
    }

    /// Ends the check under way, and the sweep that it makes; the record of that abort names `by`.
    ///
    /// # Errors
    /// None is under way.
    pub(crate) fn abort(&self, by: String) -> Result<(), SensorCheckRefusal> {
        let mut progress = self.progress();
        if !progress.is_under_way {
            return Err(SensorCheckRefusal::NotUnderWay);
        }
        progress.aborted_by.get_or_insert(by);
        progress.stop.cancel();
        Ok(())
    }

    async fn make(
        &self,
        check: SensorCheck,
        by: String,
        temperature_c: Option<f64>,
        stop: CancellationToken,
    ) -> Result<(Finding, String), Ended> {
        let status = self.rig.status();
        let session = status.borrow().session.to_string();
        let mut sensor = RemoteSensor { watch: self.clone(), status, by: by.clone(), stop };
        let watched = check.watch(&mut sensor).await?;
        let witness = Witness { person: by, journal: vec![session], temperature_c };
        let (basis, data) = (self.of.basis.clone(), self.of.data.clone());
        let kept = tokio::task::spawn_blocking(move || keep(&watched, &basis, &data, witness));
        let (finding, path) = kept.await??;
        let file = path.file_name().map(|name| name.to_string_lossy().into_owned());
        Ok((finding, file.unwrap_or_default()))
    }
}

/// The free sensor of a rig of a daemon.
struct RemoteSensor {
    watch: SensorWatch,
    status: watch::Receiver<Status>,
    by: String,
    stop: CancellationToken,
}

impl FreeSensor for RemoteSensor {
    type Trouble = Ended;

    fn now(&self) -> RigTime {
        self.status.borrow().now
    }

    async fn sweep(&mut self, request: SweepRequest) -> Result<Sweep, Ended> {
        self.is_free()?;
        if self.stop.is_cancelled() {
            return Err(Ended::Aborted);
        }
        let number = self.watch.rig.sweep(request, &self.by).await?;
        let session = tokio::select! {
            session = ended(&mut self.status, number) => session?,
            () = self.stop.cancelled() => {
                if self.is_sweeping(number) {
                    let by = self.watch.progress().aborted_by.clone();
                    let by = by.as_deref().unwrap_or(&self.by);
                    // The sweep may end meanwhile, and then there is nothing to abort.
                    _ = self.watch.rig.command(Command::Abort, None, by).await;
                    ended(&mut self.status, number).await?;
                }
                return Err(Ended::Aborted);
            }
        };
        self.is_free()?;
        let data = self.watch.of.data.clone();
        let find =
            move || Reader::open(&data).and_then(|reader| sweeps::find(&reader, session, number));
        tokio::task::spawn_blocking(find).await??.ok_or(Ended::NoSweep(number))
    }

    fn measured(&mut self, so_far: &SensorSweeps) {
        let mut progress = self.watch.progress();
        progress.sweeps = so_far.sweeps.len() + so_far.refused + so_far.surveys.len();
        progress.refused = so_far.refused;
    }
}

impl RemoteSensor {
    fn is_free(&self) -> Result<(), Ended> {
        match self.status.borrow().snapshot.clearance {
            Clearance::Clear => Ok(()),
            other => Err(Ended::NotClear(other)),
        }
    }

    /// Whether this sweep of the check is under way, and no run: an abort ends either.
    fn is_sweeping(&self, number: u64) -> bool {
        let status = self.status.borrow();
        status.sweep == Some(number) && status.snapshot.progress.is_none()
    }
}

/// Waits until a sweep has ended, and returns the session whose journal has it.
async fn ended(status: &mut watch::Receiver<Status>, number: u64) -> Result<RunId, Ended> {
    let status = status
        .wait_for(|status| {
            let is_at_rest = matches!(status.snapshot.state, RigState::Idle | RigState::Latched);
            is_at_rest && status.sweep != Some(number)
        })
        .await
        .map_err(|_| RequestRefusal::Closed)?;
    match &status.snapshot.fault {
        Some(fault) if status.snapshot.state == RigState::Latched => {
            Err(Ended::Latched(fault.to_string()))
        }
        _ => Ok(status.session),
    }
}
