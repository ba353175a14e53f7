//! Work beside the rig: the rig thread does nothing for it, and it delays nothing.

use std::{future::Future, io, thread, time::Duration};

use tokio::{sync::watch, time::timeout};
use tokio_util::sync::CancellationToken;

/// By how much the thread gives way to the rig thread.
const NICE: i32 = 10;
/// Time in which work is completed when the daemon ends.
const LAST_TIME: Duration = Duration::from_secs(2);

/// A thread with a runtime of its own and lower priority. It ends with its work, or with the value.
#[derive(Debug)]
pub(crate) struct Beside {
    ending: CancellationToken,
    thread: Option<thread::JoinHandle<()>>,
}

impl Beside {
    /// Begins work on a thread with this name.
    ///
    /// # Errors
    /// The system has no thread.
    pub(crate) fn start<F: Future<Output = ()>>(
        name: &'static str,
        work: impl FnOnce() -> F + Send + 'static,
    ) -> io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let ending = CancellationToken::new();
        let end = ending.clone();
        let run = move || {
            if let Err(error) = rig_system::priority::give_way(NICE) {
                tracing::warn!(%error, name, "a thread has the priority of the rig thread");
            }
            runtime.block_on(async {
                tokio::select! {
                    () = work() => {}
                    () = end.cancelled() => {}
                }
            });
            // A name that is being looked up cannot be interrupted; the program does not wait for it.
            runtime.shutdown_background();
        };
        let thread = Some(thread::Builder::new().name(name.to_owned()).spawn(run)?);
        Ok(Self { ending, thread })
    }

    /// Waits a short time until nobody says any more how the work stands, and ends it.
    pub(crate) async fn finish<T>(mut self, mut standing: watch::Receiver<T>) {
        let ended = async { while standing.changed().await.is_ok() {} };
        if timeout(LAST_TIME, ended).await.is_err() {
            self.ending.cancel();
        }
        self.join();
    }

    fn join(&mut self) {
        if let Some(thread) = self.thread.take() {
            _ = thread.join();
        }
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        self.ending.cancel();
        self.join();
    }
}

/// What the log says of work that fails and goes on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Words {
    pub(crate) fails: &'static str,
    pub(crate) goes_on: &'static str,
}

/// Logs when work fails and when it goes on, not each attempt.
pub(crate) async fn tell<T: Clone>(
    mut standing: watch::Receiver<T>,
    error_of: impl Fn(&T) -> Option<String>,
    words: Words,
) {
    let mut told = None;
    while standing.changed().await.is_ok() {
        let error = error_of(&standing.borrow_and_update());
        match (&error, &told) {
            (Some(error), None) => tracing::warn!(error, "{}", words.fails),
            (None, Some(_)) => tracing::warn!("{}", words.goes_on),
            _ => {}
        }
        told = error;
    }
}
