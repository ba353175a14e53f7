//! What Windows tells a program in place of signals.

use std::convert::Infallible;

use rig_system::signals::Ending;

use super::super::Failure;

/// Windows has nothing that asks a daemon to read its configuration again: `rigd config reload` does.
pub(in crate::cli) struct Hangups(Infallible);

impl Hangups {
    #[expect(clippy::unused_async, reason = "the same signature as on Unix")]
    pub(in crate::cli) async fn recv(&mut self) -> Option<()> {
        match self.0 {}
    }
}

/// Ctrl-C, Ctrl-Break, a console that is closed, a user who logs off, and a computer that shuts down.
///
/// Windows ends the program some seconds after each of the last three, also while the probe is on its way. The next start
/// finds where it was left.
pub(in crate::cli) struct Signals {
    ending: Ending,
    /// Number of signals so far.
    pub(in crate::cli) count: u32,
}

impl Signals {
    /// From now on the signals wait to be taken. Needs the runtime.
    pub(in crate::cli) fn new() -> Result<Self, Failure> {
        let failed = |source| Failure::System { what: "signals", source };
        Ok(Self { ending: Ending::listen().map_err(failed)?, count: 0 })
    }

    /// The signals of a daemon.
    pub(in crate::cli) fn of_daemon() -> Result<(Self, Option<Hangups>), Failure> {
        Ok((Self::new()?, None))
    }

    /// Waits for the next one. Cancel-safe.
    pub(in crate::cli) async fn next(&mut self) {
        self.ending.asked_for().await;
        self.count += 1;
    }
}

/// A console of Windows does not tell its programs that it has another size: a prompt that it has cut off is not shown again.
pub(in crate::cli) struct Resizes;

impl Resizes {
    #[expect(clippy::unnecessary_wraps, reason = "the same signature as on Unix")]
    pub(in crate::cli) const fn listen() -> Result<Self, Failure> {
        Ok(Self)
    }

    pub(in crate::cli) async fn next(&mut self) {
        std::future::pending::<()>().await;
    }
}
