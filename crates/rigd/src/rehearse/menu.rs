//! The faults of a rehearsal.

use rig_sim::PortId;
use rig_store::DiskFailure;

/// A fault of the menu.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rehearsed {
    /// Its number in [`crate::faults`].
    pub(super) number: u8,
    /// A few words.
    pub(super) what: &'static str,
    pub(super) trouble: Trouble,
}

/// What happens, at a drawn moment.
#[derive(Debug, Clone, Copy)]
pub(super) enum Trouble {
    /// At a frame of a port, a fault in the words of the simulator's control interface.
    Frame { port: PortId, words: &'static str },
    /// From a call of the journal on.
    Disk(DiskFailure),
    /// At a record.
    Kill,
    /// A prompt is answered after an hour.
    Late,
    /// A prompt is not answered; after 12 h somebody ends rigd, and starts it again.
    Absent,
    /// A prompt is answered, and nothing was done.
    Wrong,
}

/// A fault of the bus.
const fn bus(number: u8, what: &'static str, words: &'static str) -> Rehearsed {
    other(number, what, Trouble::Frame { port: PortId::Bus, words })
}

/// A fault of the analyzer or its line.
const fn analyzer(number: u8, what: &'static str, words: &'static str) -> Rehearsed {
    other(number, what, Trouble::Frame { port: PortId::Analyzer, words })
}

const fn other(number: u8, what: &'static str, trouble: Trouble) -> Rehearsed {
    Rehearsed { number, what, trouble }
}

pub(super) const MENU: [Rehearsed; 29] = [
    bus(1, "request lost", "drop-request"),
    bus(2, "reply lost", "drop-reply"),
    bus(3, "reply late", "delay ms=300"),
    bus(4, "reply twice", "duplicate"),
    bus(5, "wrong bit", "corrupt"),
    bus(6, "reply cut", "truncate"),
    bus(7, "noise", "noise bytes=8"),
    bus(8, "another unit answers", "wrong-unit as=7"),
    bus(9, "busy", "busy"),
    bus(10, "refusal", "exception code=4"),
    bus(12, "echo", "echo"),
    bus(13, "unplugged for 20 s", "unplug ms=20000"),
    analyzer(16, "analyzer 3 s late", "delay ms=3000"),
    analyzer(17, "analyzer cut short", "truncate"),
    analyzer(18, "overload", "overload"),
    analyzer(19, "analyzer restarts", "reboot"),
    bus(21, "alarm of the linear drive", "alarm code=48 unit=1"),
    bus(22, "linear drive halts", "stall unit=1"),
    bus(23, "linear drive loses 0.6 mm", "lose-steps by=0.6 unit=1"),
    bus(24, "linear drive restarts", "reboot unit=1"),
    bus(25, "limit switch", "limit-switch unit=1"),
    analyzer(29, "contact sense stuck", "stuck-contact"),
    other(31, "rigd killed", Trouble::Kill),
    other(34, "disk full", Trouble::Disk(DiskFailure::Full)),
    other(35, "disk fails", Trouble::Disk(DiskFailure::Io)),
    other(35, "disk read-only", Trouble::Disk(DiskFailure::ReadOnly)),
    other(39, "answer after an hour", Trouble::Late),
    other(39, "no answer for 12 h", Trouble::Absent),
    other(39, "answer without the act", Trouble::Wrong),
];
