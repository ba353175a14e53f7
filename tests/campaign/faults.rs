//! The menu of the fault campaign, and what of it a seed draws.

use rig_engine::{Command, RunPhase};
use rig_store::DiskFailure;

use crate::{
    bench::Draw,
    counts::{PHASES, Phase},
};

/// Something that goes wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Fault {
    /// A fault of a frame, in the words of the simulator's control interface.
    Frame(&'static str),
    /// A fault of a device.
    Device(&'static str),
    /// Faults of both drives at once.
    Drives([&'static str; 2]),
    /// The journal cannot be written.
    Disk(DiskFailure),
    /// The daemon is killed.
    Kill,
    /// A client gives a command.
    Person(Order),
    /// Two clients give commands at the same time.
    Clients(Order, Order),
    /// The person answers a prompt an hour late.
    Late,
    /// The person answers for another step, for another run, without a name, and twice.
    WrongAnswer,
    /// The person presses a button that is not connected, and then stops the rig on its page.
    DeadButton,
    /// The person aborts the run, lowers the probe into the sample by hand, and turns the sample.
    ByHand,
}

/// The longest pause between two attempts of the way out, s.
const PAUSE_S: f64 = 5.0;

/// A person sees within this time that a button has no effect, s.
const DEAD_BUTTON_S: f64 = 2.0;

impl Fault {
    /// How far the load of the linear drive is moved without its knowledge, upwards, mm.
    pub(crate) fn lost_mm(self) -> Option<f64> {
        let Self::Device(words) = self else { return None };
        words.strip_prefix("bus lose-steps by=")?.strip_suffix(" unit=1")?.parse().ok()
    }
}

/// A command of a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Order {
    Stop,
    Abort,
    Pause,
    Resume,
    Acknowledge,
}

impl Order {
    pub(crate) const fn command(self) -> Command {
        match self {
            Self::Stop => Command::Stop,
            Self::Abort => Command::Abort,
            Self::Pause => Command::Pause,
            Self::Resume => Command::Resume,
            Self::Acknowledge => Command::Acknowledge,
        }
    }
}

use DiskFailure::{Full, Io, ReadOnly};
use Fault::{
    ByHand, Clients, DeadButton, Device, Disk, Drives, Frame, Kill, Late, Person, WrongAnswer,
};
use Order::{Abort, Acknowledge, Pause, Resume, Stop};

/// The whole menu, with names for the tables.
pub(crate) const MENU: [(&str, Fault); 71] = [
    ("bus: request lost", Frame("bus drop-request")),
    ("bus: busy", Frame("bus busy")),
    ("bus: exception 4", Frame("bus exception code=4")),
    ("bus: connection breaks", Frame("bus disconnect")),
    ("bus: unplugged 2 s", Frame("bus unplug ms=2000")),
    ("bus: unplugged 30 s", Frame("bus unplug ms=30000")),
    ("bus: unplugged 10 min", Frame("bus unplug ms=600000")),
    ("bus: reply lost", Frame("bus drop-reply")),
    ("bus: reply 0.3 s late", Frame("bus delay ms=300")),
    ("bus: reply 3 s late", Frame("bus delay ms=3000")),
    ("bus: reply twice", Frame("bus duplicate")),
    ("bus: reply with a wrong bit", Frame("bus corrupt")),
    ("bus: reply cut", Frame("bus truncate")),
    ("bus: noise", Frame("bus noise bytes=20")),
    ("bus: echo", Frame("bus echo")),
    ("bus: reply of another unit", Frame("bus wrong-unit as=9")),
    ("bus: connection breaks after a request", Frame("bus disconnect-reply")),
    ("bus: linear drive silent", Frame("bus drop-request unit=1")),
    ("bus: rotary drive silent", Frame("bus drop-request unit=2")),
    ("linear drive: restarts", Device("bus reboot unit=1")),
    ("linear drive: alarm", Device("bus alarm code=48 unit=1")),
    ("linear drive: stalls", Device("bus stall unit=1")),
    ("linear drive: jams", Device("bus jam unit=1")),
    ("linear drive: loses 0.05 mm", Device("bus lose-steps by=0.05 unit=1")),
    ("linear drive: loses 0.3 mm upwards", Device("bus lose-steps by=0.3 unit=1")),
    ("linear drive: loses 0.3 mm downwards", Device("bus lose-steps by=-0.3 unit=1")),
    ("linear drive: limit switch", Device("bus limit-switch unit=1")),
    ("rotary drive: restarts", Device("bus reboot unit=2")),
    ("rotary drive: alarm", Device("bus alarm code=16 unit=2")),
    ("rotary drive: stalls", Device("bus stall unit=2")),
    ("rotary drive: jams", Device("bus jam unit=2")),
    ("rotary drive: limit switch", Device("bus limit-switch unit=2")),
    (
        "emergency stop: takes the power off the drives",
        Drives(["bus reboot unit=1", "bus reboot unit=2"]),
    ),
    ("emergency stop: blocks the drives", Drives(["bus jam unit=1", "bus jam unit=2"])),
    ("emergency stop: not connected", DeadButton),
    ("analyzer: request lost", Frame("analyzer drop-request")),
    ("analyzer: connection breaks", Frame("analyzer disconnect")),
    ("analyzer: unplugged 2 s", Frame("analyzer unplug ms=2000")),
    ("analyzer: unplugged 10 min", Frame("analyzer unplug ms=600000")),
    ("analyzer: reply lost", Frame("analyzer drop-reply")),
    ("analyzer: reply 0.3 s late", Frame("analyzer delay ms=300")),
    ("analyzer: reply 3 s late", Frame("analyzer delay ms=3000")),
    ("analyzer: reply twice", Frame("analyzer duplicate")),
    ("analyzer: reply with a wrong bit", Frame("analyzer corrupt")),
    ("analyzer: reply cut", Frame("analyzer truncate")),
    ("analyzer: noise", Frame("analyzer noise bytes=8")),
    ("analyzer: echo", Frame("analyzer echo")),
    ("analyzer: connection breaks after a request", Frame("analyzer disconnect-reply")),
    ("analyzer: restarts", Device("analyzer reboot")),
    ("analyzer: overload", Device("analyzer overload")),
    ("analyzer: feels no contact", Device("analyzer blind-contact")),
    ("analyzer: feels a contact always", Device("analyzer stuck-contact")),
    ("analyzer: stays at its frequency", Device("analyzer stuck-frequency")),
    ("disk: full", Disk(Full)),
    ("disk: I/O error", Disk(Io)),
    ("disk: read-only", Disk(ReadOnly)),
    ("daemon: killed", Kill),
    ("client: stop", Person(Stop)),
    ("client: abort", Person(Abort)),
    ("client: pause", Person(Pause)),
    ("client: resume", Person(Resume)),
    ("client: acknowledge", Person(Acknowledge)),
    ("two clients: stop and abort", Clients(Stop, Abort)),
    ("two clients: abort and stop", Clients(Abort, Stop)),
    ("two clients: pause and stop", Clients(Pause, Stop)),
    ("two clients: pause and resume", Clients(Pause, Resume)),
    ("two clients: stop and acknowledge", Clients(Stop, Acknowledge)),
    ("two clients: both acknowledge", Clients(Acknowledge, Acknowledge)),
    ("person: answers late", Late),
    ("person: answers wrongly", WrongAnswer),
    ("by hand: lowers the probe and turns the sample", ByHand),
];

/// A fault of the menu at a moment of the run.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Trouble {
    /// Its row of the menu.
    pub(crate) row: usize,
    /// The phase in which it begins.
    pub(crate) phase: Phase,
    /// The change of the status in that phase at which it begins.
    pub(crate) nth_change: u64,
    /// A wait after that, s.
    pub(crate) after_s: f64,
    /// For a fault of frames: when it acts, in the words of the control interface. For a disk or a
    /// kill, the number of the call or of the event from then on.
    pub(crate) trigger: String,
    pub(crate) nth: u64,
}

impl Trouble {
    pub(crate) const fn fault(&self) -> Fault {
        MENU[self.row].1
    }

    /// Whether the fault lasts until it is cleared.
    pub(crate) fn is_lasting(&self) -> bool {
        self.trigger.starts_with("rate")
    }

    /// For how long the bus is unplugged in all, s. A connection that breaks is opened again after a pause of the way out.
    pub(crate) fn unplugs_bus_s(&self) -> f64 {
        let Fault::Frame(words) = self.fault() else { return 0.0 };
        let ms = words.strip_prefix("bus unplug ms=").and_then(|ms| ms.parse::<f64>().ok());
        let times = if self.trigger.starts_with("next") { self.nth as f64 } else { 1.0 };
        let broken_s = if words.starts_with("bus disconnect") { PAUSE_S } else { 0.0 };
        ms.map_or(broken_s, |ms| ms * 1e-3) * times
    }

    /// The fault that undoes a loss of steps.
    pub(crate) fn undo_of_lost_steps(&self) -> Option<String> {
        let lost_mm = self.fault().lost_mm()?;
        Some(format!("bus lose-steps by={} unit=1", -lost_mm))
    }

    fn draw(draw: &mut Draw, is_first: bool) -> Self {
        let row = usize::try_from(draw.below(MENU.len() as u64)).unwrap_or_default();
        let phases = if is_first { &PHASES[..Phase::RUN] } else { &PHASES[..] };
        let phase = match MENU[row].1 {
            Late | WrongAnswer => Phase::Run(RunPhase::Prompt),
            _ => *draw.one_of(phases),
        };
        let nth = 1 + draw.below(6);
        let trigger = match draw.below(10) {
            0 => "rate=1".to_owned(),
            1 => "rate=0.3".to_owned(),
            2 | 3 => format!("next={nth}"),
            _ => format!("nth={nth}"),
        };
        let mut after_s = if draw.happens(0.5) { 0.0 } else { draw.between(0.0, 1.0).powi(2) };
        if MENU[row].1 == DeadButton {
            after_s += DEAD_BUTTON_S;
        }
        let changes = if phase == Phase::Run(RunPhase::Search) { 8 } else { 1 };
        Self { row, phase, nth_change: 1 + draw.below(changes), after_s, trigger, nth }
    }
}

/// One to four faults.
pub(crate) fn draw(draw: &mut Draw) -> Vec<Trouble> {
    let count = *draw.one_of(&[1, 1, 2, 2, 3, 4]);
    (0..count).map(|index| Trouble::draw(draw, index == 0)).collect()
}
