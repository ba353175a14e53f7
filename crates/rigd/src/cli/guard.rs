//! Ends a program whose rig loop or whose HTTP server is silent.
//!
//! A rig loop that is silent may go on at any time, and only one program may command the drives. So the
//! program is replaced by `rigd safe`: the system ends all its threads before the new program begins.
//! An HTTP server that is silent has no influence on the rig, but nobody could stop the rig through it:
//! the rig is closed as after a signal.

use std::{
    path::PathBuf,
    process::{self, Command},
    thread,
    time::Duration,
};

use rig_engine::Fault;
use rig_model::Clearance;
use rig_store::Digest;
use rig_system::program::replace_by;
use tokio::{
    runtime::{self, Handle},
    sync::{oneshot, watch},
    time::{sleep, timeout},
};

use super::{
    Failure,
    safe::KnownArgs,
    screen::{say, say_clearly},
};
use crate::{
    hint::WHILE_SILENT,
    rig::{Doing, RigHandle, Silence, Status},
};

/// Interval of the questions to the HTTP server, and longest time of an answer.
const ASK: Duration = Duration::from_secs(1);
/// Questions without an answer until the silence of the HTTP server is reported, and until the rig is
/// closed.
const HTTP_SILENT_AFTER: u32 = 5;
const HTTP_GIVEN_UP_AFTER: u32 = 30;

/// Exit code of a program that does not know that the probe is clear.
const NOT_CLEAR: i32 = 4;

/// What `rigd safe` is called with.
#[derive(Debug, Clone)]
pub(super) struct WayOut {
    pub(super) rig: PathBuf,
    /// Digest of the rig file and the instrument files as they were read.
    pub(super) digest: Digest,
    pub(super) data: PathBuf,
}

/// Watches over an open rig until it is closed, on a thread of its own that nothing else uses.
pub(super) fn watch_over(rig: &RigHandle, way_out: WayOut) -> Result<(), Failure> {
    let mut status = rig.status();
    on_a_thread("rig guard", async move {
        while let Some(silence) = next_silence(&mut status).await {
            if silence.is_given_up {
                let known = KnownArgs::of(&status.borrow().snapshot, way_out.digest);
                replace(&way_out, &known, silence);
            }
            say(&format!("rigd: {silence}; {WHILE_SILENT}"));
            // Ended by a sign of life, or given up.
            let is_over =
                |status: &Status| status.silence.is_none_or(|silence| silence.is_given_up);
            match status.wait_for(is_over).await {
                Ok(status) if status.silence.is_none() => say("rigd: the rig loop answers again"),
                _ => {}
            }
        }
    })
}

async fn next_silence(status: &mut watch::Receiver<Status>) -> Option<Silence> {
    status.wait_for(|status| status.silence.is_some()).await.ok()?.silence
}

/// Becomes `rigd safe`. The data directory is left out if it was being used: it may block again.
fn replace(way_out: &WayOut, known: &[String], silence: Silence) {
    let program = std::env::current_exe().unwrap_or_else(|_| PathBuf::from("rigd"));
    let mut safe = Command::new(program);
    safe.arg("safe").arg("--rig").arg(&way_out.rig).args(["--operator", "rigd"]);
    safe.args(["--because", &silence.to_string()]).args(known);
    if silence.doing != Doing::Recording {
        safe.arg("--data").arg(&way_out.data);
    }
    let error = replace_by(safe, NOT_CLEAR);
    say(&format!(
        "rigd: {silence}, and `rigd safe` cannot be started: {error}. The drives may still carry out \
         their last command: keep your hands away, and check by eye where the probe is; `rigd doctor` says what to do \
         next, and moves nothing"
    ));
    process::exit(NOT_CLEAR);
}

/// Watches over the server that runs on `http`.
pub(super) fn watch_over_http(http: Handle, rig: RigHandle) -> Result<(), Failure> {
    on_a_thread("http guard", async move {
        silent(&http, HTTP_SILENT_AFTER, ASK).await;
        say("rigd: the HTTP server has not answered for 5 s; the rig is not affected");
        silent(&http, HTTP_GIVEN_UP_AFTER - HTTP_SILENT_AFTER, ASK).await;
        say("rigd: the HTTP server has not answered for 30 s, so that nobody can stop the rig \
             through it; ending what is under way and closing");
        rig.close().await;
        say_probe(&rig.status().borrow());
        process::exit(1);
    })
}

/// Says how the probe was left. One that was lowered by hand is not retracted when the rig is closed.
pub(super) fn say_probe(status: &Status) {
    say_clearly(&format!("rigd: {}", probe_left(status)));
}

/// What the last status of a rig says of its probe, for a person.
fn probe_left(status: &Status) -> &'static str {
    if status.silence.is_some() {
        return "the rig loop does not answer, and where the probe is now is not known; `rigd safe` stops both axes, and \
                retracts the probe of a commissioned rig";
    }
    match (status.snapshot.clearance, &status.snapshot.fault) {
        (Clearance::Clear, _) => "the probe is clear",
        (_, Some(Fault::NotCommissioned { .. })) => {
            "the probe is not shown to be clear, and stays where it is; the rig is not commissioned, so that `rigd safe` \
             stops both axes and does not retract"
        }
        (Clearance::InContact, _) => {
            "the probe is not clear: it was lowered, may be in contact, and stays where it is; `rigd safe` retracts \
             it"
        }
        (Clearance::Unknown, _) => {
            "the probe is not shown to be clear, and stays where it is; `rigd safe` retracts it"
        }
    }
}

/// Waits until a runtime has not answered several questions in a row.
async fn silent(runtime: &Handle, questions: u32, ask: Duration) {
    let mut unanswered = 0;
    while unanswered < questions {
        let (reply, answer) = oneshot::channel();
        drop(runtime.spawn(async move { reply.send(()) }));
        if timeout(ask, answer).await.is_ok() {
            unanswered = 0;
            sleep(ask).await;
        } else {
            unanswered += 1;
        }
    }
}

fn on_a_thread(name: &str, work: impl Future<Output = ()> + Send + 'static) -> Result<(), Failure> {
    let failed = |source| Failure::System { what: "guard", source };
    let runtime = runtime::Builder::new_current_thread().enable_time().build().map_err(failed)?;
    let work = move || runtime.block_on(work);
    thread::Builder::new().name(name.to_owned()).spawn(work).map(drop).map_err(failed)
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    #[test]
    fn a_server_whose_threads_are_all_blocked_is_silent_and_others_are_not() {
        let ask = Duration::from_millis(20);
        let judge = runtime::Builder::new_current_thread().enable_time().build().unwrap();
        let server = runtime::Builder::new_multi_thread().worker_threads(2).build().unwrap();
        let handle = server.handle().clone();
        let (blocked, is_blocked) = mpsc::channel();
        let block = |runtime: &Handle| {
            let (release, released) = mpsc::channel::<()>();
            let blocked = blocked.clone();
            drop(runtime.spawn(async move {
                blocked.send(()).unwrap();
                _ = released.recv();
            }));
            is_blocked.recv().unwrap();
            release
        };
        let one = block(&handle);
        let answers =
            judge.block_on(async { timeout(ask * 10, silent(&handle, 3, ask * 5)).await });
        assert!(answers.is_err(), "one thread is free");
        let two = block(&handle);
        judge.block_on(silent(&handle, 3, ask));
        drop((one, two));
    }
}
