//! The signals of Unix.

use std::{
    fs,
    future::poll_fn,
    io::{self, IsTerminal},
    task::Poll,
};

use tokio::signal::unix::{Signal, SignalKind, signal};

use super::super::Failure;

/// Signals of timers, of a failing power supply, and of a limit of processor time. Without a handler each of
/// them would end the program where it is.
const OTHERS: &[i32] = &[
    rustix::process::Signal::VTALARM.as_raw(),
    rustix::process::Signal::PROF.as_raw(),
    rustix::process::Signal::XCPU.as_raw(),
    rustix::process::Signal::ALARM.as_raw(),
    // macOS has no such signal.
    #[cfg(target_os = "linux")]
    rustix::process::Signal::POWER.as_raw(),
];

/// The signals that ask a daemon to read its configuration again.
pub(in crate::cli) type Hangups = Signal;

/// The signals of a person at a terminal, of a terminal that is closed, of a service manager, and of others.
pub(in crate::cli) struct Signals {
    ending: Vec<Signal>,
    /// Number of signals so far.
    pub(in crate::cli) count: u32,
}

impl Signals {
    /// From now on the signals wait to be taken. Needs the runtime.
    pub(in crate::cli) fn new() -> Result<Self, Failure> {
        Self::listen(true)
    }

    /// The signals of a daemon. Without a terminal that could be closed, SIGHUP asks it to read its configuration
    /// again, and does not end it.
    pub(in crate::cli) fn of_daemon() -> Result<(Self, Option<Hangups>), Failure> {
        let has_terminal =
            io::stdin().is_terminal() || io::stdout().is_terminal() || io::stderr().is_terminal();
        let is_ignored = is_ignored(SignalKind::hangup().as_raw_value());
        let reload = (!has_terminal && !is_ignored).then(|| listen(SignalKind::hangup()));
        Ok((Self::listen(has_terminal)?, reload.transpose()?))
    }

    fn listen(is_ended_by_hangup: bool) -> Result<Self, Failure> {
        let mut kinds = vec![
            SignalKind::interrupt(),
            SignalKind::quit(),
            SignalKind::terminate(),
            SignalKind::user_defined1(),
            SignalKind::user_defined2(),
        ];
        kinds.extend(OTHERS.iter().copied().map(SignalKind::from_raw));
        // To be ignored, as `nohup` asks for.
        if is_ended_by_hangup && !is_ignored(SignalKind::hangup().as_raw_value()) {
            kinds.push(SignalKind::hangup());
        }
        // With a handler, a file that would grow beyond its limit is an error of the journal.
        drop(listen(SignalKind::from_raw(rustix::process::Signal::XFSZ.as_raw()))?);
        Ok(Self { ending: kinds.into_iter().map(listen).collect::<Result<_, _>>()?, count: 0 })
    }

    /// Waits for the next one. Cancel-safe.
    pub(in crate::cli) async fn next(&mut self) {
        poll_fn(|cx| {
            let has_come = |signal: &mut Signal| signal.poll_recv(cx).is_ready();
            // Each one must be asked, so that each one wakes this.
            let come = self.ending.iter_mut().map(has_come).filter(|has_come| *has_come).count();
            if come > 0 { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
        self.count += 1;
    }
}

/// Tells that the terminal has another size.
pub(in crate::cli) struct Resizes(Signal);

impl Resizes {
    pub(in crate::cli) fn listen() -> Result<Self, Failure> {
        listen(SignalKind::window_change()).map(Self)
    }

    /// Waits for the next one. Cancel-safe.
    pub(in crate::cli) async fn next(&mut self) {
        _ = self.0.recv().await;
    }
}

fn listen(kind: SignalKind) -> Result<Signal, Failure> {
    signal(kind).map_err(|source| Failure::System { what: "signals", source })
}

/// Whether the parent process set a signal to be ignored; `false` if the system does not say, as macOS: there `nohup` does not
/// keep a terminal that is closed from closing the rig.
fn is_ignored(number: i32) -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    is_in_mask(&status, number)
}

/// Reads the mask of ignored signals, in hexadecimal with signal 1 as the lowest bit (proc(5)).
fn is_in_mask(status: &str, number: i32) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (number - 1) & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::is_in_mask;

    #[test]
    fn the_mask_of_ignored_signals_is_read_from_its_lowest_bit() {
        let status = "SigBlk:\t0000000000000000\nSigIgn:\t0000000000001001\nSigCgt:\t0\n";
        assert!(is_in_mask(status, 1) && is_in_mask(status, 13));
        assert!(!is_in_mask(status, 2) && !is_in_mask(status, 15) && !is_in_mask("", 1));
    }
}
