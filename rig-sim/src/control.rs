//! The control interface: one line of text is one action of a technician or one injected fault.
//!
//! It also shows the true state, which no instrument shows. The commands are in [`HELP`].

use std::{fmt::Write, ops::RangeInclusive, str::FromStr, time::Duration};

use rig_model::{Orientation, RigTime};

use crate::{
    faults::{DeviceFault, Fault, FaultKind, FaultTrigger, ReplyFault, RequestFault},
    rig::Rig,
    wiring::PortId,
    world::{NoSuchSample, Truth, Violation},
};

/// The answer to `help`: every command with its arguments.
pub const HELP: &str = "\
help
place NAME             put a sample under the probe; the name may have spaces
take-away              take the sample away
turn front/back|left   turn the sensor about its axis
truth                  the true state of the bench
violations             safety violations so far
fault PORT KIND [KEY=VALUE ...] [unit=N] [nth=N|next=N|rate=P]
  PORT: analyzer, bus
  requests: drop-request, busy, exception code=N, disconnect, unplug ms=N
  replies:  drop-reply, delay ms=N, duplicate, corrupt, truncate, noise bytes=N, echo,
            wrong-unit as=N, disconnect-reply
  devices:  reboot, alarm code=N, stall, jam, lose-steps by=X, miscount by=X, limit-switch,
            emergency-stop, overload, blind-contact, stuck-contact, stuck-frequency, knock by=HZ,
            wrong-reading by=FACTOR
  nth: once, at the N-th frame from now; next: at each of the next N frames; rate: at each
  frame with this probability. By default a fault of a device is injected at once, any other
  at the next frame.
clear                  clear all faults";

/// Why a line was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ControlError {
    /// The first word is not a command.
    #[error("\"{word}\" is no command; say help")]
    Command {
        /// The unknown word.
        word: String,
    },
    /// An argument is missing.
    #[error("{what} is missing; say help")]
    Missing {
        /// The expected form.
        what: &'static str,
    },
    /// An argument is not one of the allowed words.
    #[error("\"{word}\" is no {what}; say help")]
    Word {
        /// The expected form.
        what: &'static str,
        /// The unknown word.
        word: String,
    },
    /// There is no such sample.
    #[error(transparent)]
    Sample(#[from] NoSuchSample),
}

/// Executes a line, and answers in one or more lines.
///
/// # Errors
/// [`ControlError`]; nothing was done then.
pub fn execute(now: RigTime, rig: &mut Rig, line: &str) -> Result<String, ControlError> {
    let mut words = line.split_whitespace();
    let command = words.next().unwrap_or("help");
    let mut word = |what| words.next().ok_or(ControlError::Missing { what });
    let done = || Ok("ok".to_owned());
    match command {
        "help" => Ok(HELP.to_owned()),
        "place" => {
            word("the name of a sample")?;
            // All of the line: a name may have spaces.
            let (_, name) = line.split_once(command).unwrap_or_default();
            rig.world().place_sample(now, name.trim())?;
            done()
        }
        "take-away" => {
            rig.world().take_sample_away(now);
            done()
        }
        "turn" => {
            let orientation = one_of("orientation", word("the orientation")?, &ORIENTATIONS)?;
            rig.world().turn_sensor(now, orientation);
            done()
        }
        "truth" => Ok(describe(&rig.world().truth(now))),
        "violations" => Ok(list(rig.world().violations(now))),
        "fault" => {
            let port = one_of("port", word("the port")?, &PORTS)?;
            let kind = word("the kind of fault")?;
            let options = Options(words.collect());
            inject(now, rig, port, kind, &options)?;
            done()
        }
        "clear" => {
            rig.clear_faults(now);
            done()
        }
        word => Err(ControlError::Command { word: word.to_owned() }),
    }
}

const ORIENTATIONS: [(&str, Orientation); 2] = [
    (Orientation::FrontBack.name(), Orientation::FrontBack),
    (Orientation::Left.name(), Orientation::Left),
];

const PORTS: [(&str, PortId); 2] = [("analyzer", PortId::Analyzer), ("bus", PortId::Bus)];

fn one_of<T: Copy>(what: &'static str, word: &str, known: &[(&str, T)]) -> Result<T, ControlError> {
    let found = known.iter().find(|(known, _)| *known == word);
    found.map(|(_, value)| *value).ok_or_else(|| ControlError::Word { what, word: word.to_owned() })
}

/// The options of a fault.
struct Options<'a>(Vec<&'a str>);

impl Options<'_> {
    /// The value of a key, if the key is there.
    fn get<T: FromStr>(&self, key: &'static str) -> Result<Option<T>, ControlError> {
        let value = self.0.iter().find_map(|word| word.strip_prefix(key)?.strip_prefix('='));
        let read = |value: &str| {
            let word = || format!("{key}={value}");
            value.parse().map_err(|_| ControlError::Word { what: "number", word: word() })
        };
        value.map(read).transpose()
    }

    /// A value in this range.
    fn within<T: FromStr + PartialOrd>(
        &self,
        key: &'static str,
        range: RangeInclusive<T>,
        what: &'static str,
    ) -> Result<T, ControlError> {
        let value = self.need(key)?;
        if range.contains(&value) {
            return Ok(value);
        }
        let written = self.0.iter().find(|word| word.starts_with(key)).copied();
        Err(ControlError::Word { what, word: written.unwrap_or(key).to_owned() })
    }

    /// A time, ms.
    fn milliseconds(&self) -> Result<Duration, ControlError> {
        self.within("ms", 0..=MOST_MS, "time of up to a day").map(Duration::from_millis)
    }

    /// A distance, mm or degrees.
    fn distance(&self) -> Result<f64, ControlError> {
        self.within("by", -MOST_WAY..=MOST_WAY, "distance from -1000 to 1000")
    }

    fn need<T: FromStr>(&self, key: &'static str) -> Result<T, ControlError> {
        self.get(key)?.ok_or(ControlError::Missing { what: key })
    }
}

/// The longest time of a fault, ms: a day.
const MOST_MS: u64 = 24 * 3600 * 1000;

/// The largest distance of a fault, mm or degrees: more than a bench has.
const MOST_WAY: f64 = 1000.0;

/// The largest knock, Hz: a sensor has about 140 Hz.
const MOST_KNOCK_HZ: f64 = 50.0;

/// The largest factor of a wrong reading.
const MOST_FACTOR: f64 = 1000.0;

/// The exception code of a busy Modbus unit.
const BUSY: u8 = 6;

fn fault_kind(kind: &str, options: &Options<'_>) -> Result<FaultKind, ControlError> {
    let device = |fault| Ok(FaultKind::Device(fault));
    let reply = |fault| Ok(FaultKind::Reply(fault));
    let request = |fault| Ok(FaultKind::Request(fault));
    match kind {
        "drop-request" => request(RequestFault::Drop),
        "busy" => request(RequestFault::Exception(BUSY)),
        "exception" => request(RequestFault::Exception(options.need("code")?)),
        "disconnect" => request(RequestFault::Disconnect),
        "unplug" => request(RequestFault::Unplug(options.milliseconds()?)),
        "drop-reply" => reply(ReplyFault::Drop),
        "delay" => reply(ReplyFault::Delay(options.milliseconds()?)),
        "duplicate" => reply(ReplyFault::Duplicate),
        "corrupt" => reply(ReplyFault::Corrupt),
        "truncate" => reply(ReplyFault::Truncate),
        "noise" => reply(ReplyFault::Noise(options.need::<u16>("bytes")?.into())),
        "echo" => reply(ReplyFault::Echo),
        "wrong-unit" => reply(ReplyFault::Unit(options.need("as")?)),
        "disconnect-reply" => reply(ReplyFault::Disconnect),
        "reboot" => device(DeviceFault::Reboot),
        "alarm" => device(DeviceFault::Alarm(options.need("code")?)),
        "stall" => device(DeviceFault::Stall),
        "jam" => device(DeviceFault::Jam),
        "lose-steps" => device(DeviceFault::LoseSteps(options.distance()?)),
        "miscount" => device(DeviceFault::Miscount(options.distance()?)),
        "limit-switch" => device(DeviceFault::LimitSwitch),
        "emergency-stop" => device(DeviceFault::EmergencyStop),
        "overload" => device(DeviceFault::Overload),
        "wrong-reading" => {
            let range = -MOST_FACTOR..=MOST_FACTOR;
            let factor = options.within("by", range, "factor from -1000 to 1000")?;
            device(DeviceFault::WrongReading(factor))
        }
        "blind-contact" => device(DeviceFault::BlindContact),
        "stuck-contact" => device(DeviceFault::StuckContact),
        "stuck-frequency" => device(DeviceFault::StuckFrequency),
        "knock" => {
            let range = -MOST_KNOCK_HZ..=MOST_KNOCK_HZ;
            device(DeviceFault::Knock(options.within("by", range, "shift from -50 to 50 Hz")?))
        }
        word => Err(ControlError::Word { what: "kind of fault", word: word.to_owned() }),
    }
}

fn inject(
    now: RigTime,
    rig: &mut Rig,
    port: PortId,
    kind: &str,
    options: &Options<'_>,
) -> Result<(), ControlError> {
    const KEYS: [&str; 9] =
        ["code=", "ms=", "bytes=", "as=", "by=", "unit=", "nth=", "next=", "rate="];
    if let Some(word) = options.0.iter().find(|word| !KEYS.iter().any(|key| word.starts_with(key)))
    {
        return Err(ControlError::Word { what: "option", word: (*word).to_owned() });
    }
    let kind = fault_kind(kind, options)?;
    let unit = options.get("unit")?;
    let trigger = match (options.get("nth")?, options.get("next")?, options.get::<f64>("rate")?) {
        (Some(nth), None, None) => FaultTrigger::Nth(nth),
        (None, Some(next), None) => FaultTrigger::Next(next),
        (None, None, Some(_)) => {
            FaultTrigger::Rate(options.within("rate", 0.0..=1.0, "probability from 0 to 1")?)
        }
        (None, None, None) => {
            if let FaultKind::Device(fault) = kind {
                rig.apply_fault(now, port, unit, fault);
                return Ok(());
            }
            FaultTrigger::Nth(1)
        }
        _ => {
            let word = "more than one of nth, next and rate".to_owned();
            return Err(ControlError::Word { what: "time", word });
        }
    };
    rig.add_fault(Fault { port, unit, kind, trigger });
    Ok(())
}

fn describe(truth: &Truth) -> String {
    let mut text = format!(
        "sample={} orientation={} tip_mm={:.4} tilt_deg={:.3} contact={} ",
        truth.sample.as_deref().unwrap_or("none"),
        truth.orientation.name(),
        truth.tip_mm,
        truth.tilt_deg,
        if truth.is_in_contact() { "yes" } else { "no" },
    );
    if truth.indentation_mm.is_finite() {
        _ = write!(text, "indentation_mm={:.4} ", truth.indentation_mm);
    }
    if let Some(stiffness_mpa) = truth.stiffness_mpa {
        _ = write!(text, "contact_deg={:.3} stiffness_mpa={stiffness_mpa:.5} ", truth.contact_deg);
    }
    _ = write!(text, "resonance_hz={:.4} no_load_hz={:.4}", truth.resonance_hz, truth.no_load_hz);
    text
}

fn list(violations: &[Violation]) -> String {
    let mut text = format!("{}", violations.len());
    for Violation { at, kind } in violations {
        _ = write!(text, "\n{at} {kind}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LineTransport, Wiring, scene::matched};

    fn rig() -> Rig {
        let wiring = Wiring::paper(LineTransport::Serial { baud: 115_200 });
        Rig::new(matched(), &wiring, 1).unwrap()
    }

    #[test]
    fn a_person_acts_and_the_truth_shows_it() {
        let mut rig = rig();
        let mut say = |line: &str| execute(RigTime::ZERO, &mut rig, line).unwrap();
        assert!(say("truth").starts_with("sample=none orientation=front/back tip_mm="));
        assert_eq!(say("place 3"), "ok");
        assert_eq!(say(" turn  left "), "ok");
        assert!(say("truth").contains("sample=3 orientation=left"), "{}", say("truth"));
        assert_eq!(say("violations"), "0");
        assert_eq!(say("take-away"), "ok");
    }

    #[test]
    fn a_sample_may_have_spaces_in_its_name() {
        let mut scene = matched();
        scene.samples[0].name = "a b".to_owned();
        let wiring = Wiring::paper(LineTransport::Serial { baud: 115_200 });
        let mut rig = Rig::new(scene, &wiring, 1).unwrap();
        assert_eq!(execute(RigTime::ZERO, &mut rig, " place  a b ").as_deref(), Ok("ok"));
        let truth = execute(RigTime::ZERO, &mut rig, "truth").unwrap();
        assert!(truth.starts_with("sample=a b orientation"), "{truth}");
    }

    #[test]
    fn every_fault_of_the_menu_can_be_said() {
        let mut rig = rig();
        let options = "code=4 ms=100 bytes=5 as=7 by=-0.5";
        let kinds = [
            "drop-request",
            "busy",
            "exception",
            "disconnect",
            "drop-reply",
            "delay",
            "duplicate",
            "corrupt",
            "truncate",
            "noise",
            "echo",
            "wrong-unit",
            "disconnect-reply",
            "reboot",
            "alarm",
            "stall",
            "jam",
            "lose-steps",
            "limit-switch",
            "emergency-stop",
            "overload",
            "blind-contact",
            "stuck-contact",
            "stuck-frequency",
            "knock",
            "wrong-reading",
        ];
        for kind in kinds {
            assert!(HELP.contains(kind), "{kind}");
            for trigger in ["", "nth=3", "next=2 unit=1", "rate=0.01"] {
                for port in ["bus", "analyzer"] {
                    let line = format!("fault {port} {kind} {options} {trigger}");
                    assert_eq!(
                        execute(RigTime::ZERO, &mut rig, &line).as_deref(),
                        Ok("ok"),
                        "{line}"
                    );
                }
            }
        }
        assert_eq!(execute(RigTime::ZERO, &mut rig, "clear").as_deref(), Ok("ok"));
    }

    #[test]
    fn what_cannot_be_is_refused_by_its_word() {
        let mut rig = rig();
        let rows = [
            ("dance", "\"dance\" is no command; say help"),
            ("place", "the name of a sample is missing; say help"),
            ("place 9", "there is no sample named \"9\""),
            ("turn right", "\"right\" is no orientation; say help"),
            ("fault usb drop-reply", "\"usb\" is no port; say help"),
            ("fault bus explode", "\"explode\" is no kind of fault; say help"),
            ("fault bus delay", "ms is missing; say help"),
            ("fault bus delay ms=soon", "\"ms=soon\" is no number; say help"),
            ("fault bus miscount by=nan", "\"by=nan\" is no distance from -1000 to 1000; say help"),
            (
                "fault bus lose-steps by=inf",
                "\"by=inf\" is no distance from -1000 to 1000; say help",
            ),
            ("fault analyzer knock by=1e9", "\"by=1e9\" is no shift from -50 to 50 Hz; say help"),
            ("fault bus echo rate=nan", "\"rate=nan\" is no probability from 0 to 1; say help"),
            (
                "fault bus delay ms=18446744073709551615",
                "\"ms=18446744073709551615\" is no time of up to a day; say help",
            ),
            ("fault bus echo soon", "\"soon\" is no option; say help"),
            (
                "fault bus echo nth=1 rate=0.5",
                "\"more than one of nth, next and rate\" is no time; say help",
            ),
        ];
        for (line, message) in rows {
            let refused = execute(RigTime::ZERO, &mut rig, line).unwrap_err();
            assert_eq!(refused.to_string(), message, "{line}");
        }
    }
}
