//! One run, from an open rig to its end.

use std::{
    sync::mpsc::{self, RecvTimeoutError},
    thread,
    time::Duration,
};

use rig_engine::RunStatus;
use rig_store::{Record, SweepOutcome};
use rig_tests::TestRig;
use rig_verify::Finding;

use crate::case::Case;

/// A run that takes longer by the clock on the wall has no end: the longest take half a minute.
const PATIENCE: Duration = Duration::from_secs(300);

/// The end of a run.
#[derive(Debug)]
pub(crate) enum Outcome {
    Ended {
        status: RunStatus,
        /// The cause of a fault.
        cause: Option<String>,
        sweeps: usize,
        /// Why sweeps were refused.
        refusals: Vec<String>,
        /// What the checker found in the journals of the run and of the session.
        findings: Vec<Finding>,
    },
    /// With a panic of the daemon or of this program.
    Panicked,
    /// No end within the patience.
    NoEnd,
}

impl Outcome {
    /// Why the run did not end as it must.
    pub(crate) fn failure(&self, may_fault: bool) -> Option<String> {
        match self {
            Self::Ended { findings, .. } if !findings.is_empty() => {
                Some(format!("not sound: {}", findings[0]))
            }
            Self::Ended { status, cause, .. } => match status {
                RunStatus::Completed | RunStatus::CompletedWithRefusals => None,
                RunStatus::Faulted | RunStatus::Aborted if may_fault => None,
                RunStatus::Faulted | RunStatus::Aborted => {
                    Some(format!("{}: {}", status.name(), cause.as_deref().unwrap_or("no cause")))
                }
            },
            Self::Panicked => Some("panicked".to_owned()),
            Self::NoEnd => Some(format!("no end after {} s", PATIENCE.as_secs())),
        }
    }
}

/// Runs a case on a thread of its own, so that a case without an end does not block the others.
pub(crate) fn play(case: Case) -> Outcome {
    let (sender, ended) = mpsc::sync_channel(1);
    thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().build();
        let Ok(runtime) = runtime else { return };
        // After a timeout there is no receiver.
        _ = sender.send(runtime.block_on(played(&case)));
    });
    match ended.recv_timeout(PATIENCE) {
        Ok(outcome) => outcome,
        Err(RecvTimeoutError::Timeout) => Outcome::NoEnd,
        Err(RecvTimeoutError::Disconnected) => Outcome::Panicked,
    }
}

async fn played(case: &Case) -> Outcome {
    let scene: Vec<(&str, &str)> =
        case.scene.iter().map(|(from, to)| (*from, to.as_str())).collect();
    let rig = TestRig::open_bench(&[], &scene).await;
    let protocol = rig.protocol(&case.protocol);
    let run = rig.handle.run(protocol, "campaign").await.expect("the rig is idle");
    let status = rig.ended(run).await;
    let (mut sweeps, mut refusals, mut cause) = (0, Vec::new(), None);
    for stored in rig.records(run) {
        match stored.record() {
            Ok(Record::Sweep(sweep)) => {
                sweeps += 1;
                if let SweepOutcome::Refused { reason } = sweep.outcome {
                    refusals.push(reason);
                }
            }
            Ok(Record::Fault(fault)) => cause = cause.or(Some(fault.cause)),
            _ => {}
        }
    }
    let session = rig.handle.status().borrow().session;
    let verdicts = [run, session].map(|id| rig_verify::verify(rig.data(), &id.to_string()));
    let findings = verdicts.into_iter().flat_map(|verdict| verdict.expect("a journal").findings);
    let findings = findings.collect();
    rig.close().await;
    Outcome::Ended { status, cause, sweeps, refusals, findings }
}
