//! `rigd watch`: a run of the daemon as it happens.

use rig_store::Record;
use serde::Deserialize;

use super::{
    Failure,
    client::Event,
    daemon::{DaemonArgs, over_http},
    live::say_touch,
    runs, screen,
    table::{concluded, note},
};
use crate::rig_view::{EstimateView, LastRun, RigView};

/// A record of the journal, as an event.
#[derive(Debug, Deserialize)]
struct RecordEvent {
    record: Record,
}

/// The new part of a sweep.
#[derive(Debug, Deserialize)]
struct SweepEvent {
    estimates: Vec<EstimateView>,
}

/// What has been said so far.
#[derive(Debug, Default)]
struct Watch {
    /// Id of the run that is followed.
    run: Option<String>,
    said: Option<String>,
    estimate_hz: Option<[f64; 2]>,
}

/// The end of a watch.
#[derive(Debug)]
enum End {
    /// The run has ended.
    Run(LastRun),
    /// The rig is latched, and no run is under way.
    Latched { probe: String },
    /// The daemon has ended.
    Daemon,
}

/// Follows the run under way, or the next one, to its end.
pub(super) fn watch(args: &DaemonArgs) -> Result<(), Failure> {
    let end = over_http(async {
        let mut events = args.client()?.events().await?;
        note("watching; the rig goes on when this ends");
        let mut watch = Watch::default();
        while let Some(event) = events.next().await? {
            if let Some(end) = watch.take(&event) {
                return Ok(end);
            }
        }
        Ok(End::Daemon)
    });
    screen::show_progress("");
    let run = match end? {
        End::Daemon => {
            note("the daemon has ended");
            return Ok(());
        }
        End::Latched { probe } => return Err(Failure::DaemonLatched { probe }),
        End::Run(run) => run,
    };
    let verdict = match run.status.as_str() {
        "completed" => Ok(()),
        "completed_with_refusals" => Err(Failure::TouchesRefused),
        "aborted" => Err(Failure::Aborted),
        _ => Err(Failure::RunEnded { status: run.status }),
    };
    concluded(runs::show_run(&args.data, &run.id), verdict)
}

impl Watch {
    /// Says the news of an event.
    fn take(&mut self, event: &Event) -> Option<End> {
        match event.kind.as_str() {
            "rig" => {
                if let Ok(rig) = serde_json::from_str::<RigView>(&event.data) {
                    return self.see(&rig);
                }
            }
            "live_sweep" => {
                if let Ok(sweep) = serde_json::from_str::<SweepEvent>(&event.data) {
                    let last = sweep.estimates.last();
                    self.estimate_hz = last.map(|last| [last.resonance_hz, last.sigma_hz]);
                }
            }
            "touch_result" | "touch_refused" => {
                if let Ok(stored) = serde_json::from_str::<RecordEvent>(&event.data) {
                    say_touch(&stored.record);
                }
            }
            _ => {}
        }
        None
    }

    /// Says a change of the rig, and draws the progress of its run.
    fn see(&mut self, rig: &RigView) -> Option<End> {
        let fault = rig.fault().map(|[cause, advice]| format!("fault: {cause}\n→ {advice}"));
        let question = rig.question();
        let news = fault.or(question).unwrap_or_else(|| rig.state.clone());
        if self.said.as_ref() != Some(&news) {
            note(&news);
            self.said = Some(news);
        }
        if let Some(mut progress) = rig.progress() {
            self.run = rig.run.as_ref().map(|run| run.id.clone());
            progress.estimate_hz = self.estimate_hz;
            progress.draw();
            return None;
        }
        screen::show_progress("");
        let ended = rig.last_run.clone().filter(|last| self.run.as_ref() == Some(&last.id));
        let is_latched = rig.state == "latched";
        ended
            .map(End::Run)
            .or_else(|| is_latched.then(|| End::Latched { probe: rig.probe.clone() }))
    }
}
