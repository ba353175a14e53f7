//! Signals that ask the program to end. While a rig is open, none of them ends it directly: the
//! probe is retracted first.

use std::fs;

use tokio::signal::unix::{Signal, SignalKind, signal};

use super::Failure;

/// The signals of a person at a terminal, of a terminal that is closed, and of a service manager.
pub(super) struct Signals {
    interrupt: Signal,
    quit: Signal,
    terminate: Signal,
    /// Nothing where hanging up is to be ignored, as `nohup` asks for.
    hangup: Option<Signal>,
    /// Number of signals so far.
    pub(super) count: u32,
}

impl Signals {
    /// From now on the signals wait to be taken. Needs the runtime.
    pub(super) fn new() -> Result<Self, Failure> {
        let listen =
            |kind| signal(kind).map_err(|source| Failure::System { what: "signals", source });
        let is_nohup = is_ignored(SignalKind::hangup().as_raw_value());
        Ok(Self {
            interrupt: listen(SignalKind::interrupt())?,
            quit: listen(SignalKind::quit())?,
            terminate: listen(SignalKind::terminate())?,
            hangup: if is_nohup { None } else { Some(listen(SignalKind::hangup())?) },
            count: 0,
        })
    }

    /// Waits for the next one. Cancel-safe.
    pub(super) async fn next(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.quit.recv() => {}
            _ = self.terminate.recv() => {}
            () = received(&mut self.hangup) => {}
        }
        self.count += 1;
    }
}

async fn received(signal: &mut Option<Signal>) {
    match signal {
        Some(signal) => _ = signal.recv().await,
        None => std::future::pending().await,
    }
}

/// Whether the parent process set a signal to be ignored; `false` if the system does not say.
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
