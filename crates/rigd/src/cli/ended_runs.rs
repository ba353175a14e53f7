//! The folders of ended runs, and the count of the verdicts on their models.

use std::path::{Path, PathBuf};

use rig_model::with_causes;
use rig_store::{Reader, RunId};
use tokio::{sync::watch, task::spawn_blocking};

use super::screen::say;
use crate::{http::Shared, rig::Status};

/// Writes the folder of each run when it has ended, until the rig is closed.
///
/// The journal says which runs have ended: a run can begin and end while the folder of the one before it is
/// written, and the status shows the last one alone.
pub(super) async fn write(shared: Shared, mut status: watch::Receiver<Status>, data: PathBuf) {
    let (mut last_event, mut last) = (0, None);
    loop {
        let is_open = status.changed().await.is_ok();
        let (first_event, seen) = {
            let status = status.borrow_and_update();
            (status.first_event, status.run.as_ref().map(|run| (run.id, run.ending)))
        };
        let is_new = std::mem::replace(&mut last, seen) != seen;
        // Without an event of its own, this daemon has ended no run.
        if first_event > 0 && (is_new || !is_open) {
            last_event = write_after(&shared, &data, last_event.max(first_event - 1)).await;
        }
        if !is_open {
            return;
        }
    }
}

/// Writes the folders of the runs that have ended behind an event, and gives the event of the last ending.
async fn write_after(shared: &Shared, data: &Path, mut event: u64) -> u64 {
    let directory = data.to_path_buf();
    let found = spawn_blocking(move || Reader::open(&directory)?.ended_after(event)).await;
    let ended: Vec<(u64, RunId)> = match found {
        Ok(Ok(ended)) => ended,
        Ok(Err(error)) => {
            let error = with_causes(&error);
            say(&format!("the runs that have ended cannot be read: {error}"));
            return event;
        }
        Err(_) => return event,
    };
    for (ending, run) in ended {
        event = ending;
        match shared.start_writing_files(run).await {
            Ok(Ok(files)) => {
                if let Some(verdict) = files.results.model_verdict() {
                    shared.count_verdict(verdict);
                }
                if !files.verdict.is_sound() {
                    let sentence = files.verdict.sentence;
                    say(&format!("run {run} is {sentence}; `rigd verify {run}` lists them"));
                }
            }
            Ok(Err(error)) => {
                say(&format!("the folder of run {run} cannot be written: {}", with_causes(&error)));
            }
            _ => {}
        }
    }
    event
}
