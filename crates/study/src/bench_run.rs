//! Runs of the daemon's rig on the simulated bench, in this process, with what only the simulator knows.

use std::{
    collections::{BTreeMap, HashMap},
    io,
    pin::pin,
    time::Duration,
};

use rig_engine::{RigState, RunPhase};
use rig_model::RigTime;
use rig_report::RunResults;
use rig_store::{MemoryDisk, Reader, RunId, StoreError};
use rigd::{
    files::FileError,
    loaded_rig::LoadedRig,
    protocol_file::LoadedProtocol,
    rig::{self, OpenError, RequestRefusal, RigHandle, RunView, Status},
};
use tokio::{sync::watch::error::RecvError, time};

/// Longest run on the rig's clock: three times the longest plan that a protocol allows.
const LONGEST: Duration = Duration::from_secs(24 * 3600);

/// A run that has ended.
#[derive(Debug)]
pub(crate) struct BenchRun {
    pub(crate) results: RunResults,
    /// The modulus of the touched point during the last sweep of each touch, MPa, by the address of its step.
    pub(crate) true_mpa: HashMap<String, f64>,
    /// Time on the rig's clock in each phase, s.
    pub(crate) phases_s: BTreeMap<&'static str, f64>,
    /// What must never happen on a bench.
    pub(crate) violations: Vec<String>,
}

/// A run without a result.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BenchError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("the rig is not simulated: a study moves no real bench")]
    NotSimulated,
    #[error("a runtime or a temporary file")]
    System(#[from] io::Error),
    #[error("the rig cannot be opened")]
    Open(#[from] OpenError),
    #[error("the rig refused the run")]
    Refused(#[from] RequestRefusal),
    #[error("the rig ended before the run")]
    Closed,
    #[error("the run has no end within {} h on the rig's clock", LONGEST.as_secs() / 3600)]
    NoEnd,
    #[error("the run is not completed but {status}")]
    NotCompleted { status: String },
    #[error(transparent)]
    Journal(#[from] StoreError),
    #[error("touch {step} has no result, or a sample that the paper does not have")]
    NotATouch { step: String },
}

impl From<RecvError> for BenchError {
    fn from(_: RecvError) -> Self {
        Self::Closed
    }
}

impl BenchRun {
    /// Runs a protocol on a simulated rig, with its journal in memory. The rig, its bench and the one who watches
    /// share one paused clock, so that the same files give the same run.
    pub(crate) fn of(rig: LoadedRig, protocol: LoadedProtocol) -> Result<Self, BenchError> {
        if !rig.is_simulated() {
            return Err(BenchError::NotSimulated);
        }
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_time()
            .start_paused(true)
            .build()?;
        let disk = MemoryDisk::new()?;
        let (run, watcher) = runtime.block_on(played(rig, protocol, &disk))?;
        let reader = Reader::open_in_memory(&disk)?;
        let results = RunResults::new(&reader.run(run)?, &reader.records(run)?);
        let Watcher { true_mpa, phases_s, violations, .. } = watcher;
        let results = results.map_err(StoreError::from)?;
        Ok(Self { results, true_mpa, phases_s, violations })
    }
}

async fn played(
    rig: LoadedRig,
    protocol: LoadedProtocol,
    disk: &MemoryDisk,
) -> Result<(RunId, Watcher), BenchError> {
    let (handle, rig) = rig::open_in_memory(rig, disk, None).await?;
    let mut watcher = Watcher::default();
    let mut serving = pin!(rig.serve());
    let run = tokio::select! {
        biased;
        () = &mut serving => return Err(BenchError::Closed),
        run = time::timeout(LONGEST, watcher.follow(&handle, protocol)) => run,
    };
    tokio::join!(handle.close(), serving);
    Ok((run.map_err(|_| BenchError::NoEnd)??, watcher))
}

/// Looks at the bench whenever the rig says something new. The clock stands still meanwhile.
#[derive(Debug, Default)]
struct Watcher {
    true_mpa: HashMap<String, f64>,
    phases_s: BTreeMap<&'static str, f64>,
    violations: Vec<String>,
    /// The phase under way, and since when.
    phase: Option<(&'static str, RigTime)>,
}

impl Watcher {
    /// Follows a run to its end.
    async fn follow(
        &mut self,
        handle: &RigHandle,
        protocol: LoadedProtocol,
    ) -> Result<RunId, BenchError> {
        let mut status = handle.status();
        // After opening, the rig homes its axes and proves that the probe is clear.
        let is_ready = |state| matches!(state, RigState::Idle | RigState::Latched);
        status.wait_for(|status| is_ready(status.snapshot.state)).await?;
        let id = handle.run(protocol, "rig-study").await?;
        loop {
            let now = status.borrow_and_update().clone();
            self.look(handle, &now);
            let is_ended = |run: &RunView| run.id == id && run.ending.is_some();
            if now.run.as_ref().is_some_and(is_ended) {
                break;
            }
            status.changed().await?;
        }
        if let Some(simulation) = handle.simulation() {
            let violations = simulation.with(|now, rig| rig.world().violations(now).to_vec());
            self.violations = violations.iter().map(|one| one.kind.to_string()).collect();
        }
        Ok(id)
    }

    fn look(&mut self, handle: &RigHandle, status: &Status) {
        let progress = status.snapshot.progress.as_ref();
        let phase = progress.map(|progress| phase_name(progress.phase));
        if let Some((before, since)) = self.phase.filter(|(before, _)| phase != Some(before)) {
            *self.phases_s.entry(before).or_default() += status.now.since(since).as_secs_f64();
        }
        if phase != self.phase.map(|(before, _)| before) {
            self.phase = phase.map(|phase| (phase, status.now));
        }
        let (Some(progress), Some(run), Some(simulation)) =
            (progress, &status.run, handle.simulation())
        else {
            return;
        };
        if progress.phase == RunPhase::Sweep
            && let Some(step) = run.plan.steps.get(progress.step)
            && let Some(mpa) = simulation.with(|now, rig| rig.world().truth(now).stiffness_mpa)
        {
            self.true_mpa.insert(step.id.to_string(), mpa);
        }
    }
}

/// The phases of a run, in the order of a touch.
pub(crate) const PHASES: [&str; 12] = [
    "between",
    "prompt",
    "rotation",
    "no-load sweep",
    "baseline",
    "search",
    "indentation",
    "dwell",
    "sweep",
    "slip check",
    "retract",
    "confirmation",
];

const fn phase_name(phase: RunPhase) -> &'static str {
    PHASES[match phase {
        RunPhase::Between => 0,
        RunPhase::Prompt => 1,
        RunPhase::Rotation => 2,
        RunPhase::NoLoadSweep => 3,
        RunPhase::Baseline => 4,
        RunPhase::Search => 5,
        RunPhase::Indentation => 6,
        RunPhase::Dwell => 7,
        RunPhase::Sweep => 8,
        RunPhase::SlipCheck => 9,
        RunPhase::Retract => 10,
        RunPhase::Confirmation => 11,
    }]
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn loaded(rig: &str) -> (LoadedRig, LoadedProtocol) {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        let rig = LoadedRig::load(&config.join("rigs").join(rig)).unwrap();
        let protocol = config.join("protocols/smoke.toml");
        let protocol = LoadedProtocol::load(&protocol, &rig.facts()).unwrap();
        (rig, protocol)
    }

    #[test]
    fn every_touch_of_a_run_in_this_process_is_read_beside_its_truth() {
        let (rig, protocol) = loaded("simulated.toml");
        let run = BenchRun::of(rig, protocol).unwrap();
        assert_eq!((run.violations, run.true_mpa.len()), (Vec::new(), 18));
        let touches = run.results.touches();
        assert_eq!(touches.len(), 18);
        for touch in touches {
            let truth = run.true_mpa[&touch.step];
            let known = touch.known_mpa.unwrap();
            assert!((truth / known).ln().abs() < 0.15, "{} {truth} {known}", touch.step);
            let found = touch.stiffness_mpa.unwrap();
            assert!((found / truth).ln().abs() < 0.15, "{} {found} {truth}", touch.step);
        }
        let phases: f64 = run.phases_s.values().sum();
        let rig_seconds = run.results.summary().rig_seconds;
        assert!((phases - rig_seconds).abs() < 0.01 * rig_seconds, "{phases} {rig_seconds}");
    }

    #[test]
    fn a_real_bench_is_refused() {
        let (rig, protocol) = loaded("bench.toml");
        let refused = BenchRun::of(rig, protocol);
        assert!(matches!(refused, Err(BenchError::NotSimulated)), "{refused:?}");
    }
}
