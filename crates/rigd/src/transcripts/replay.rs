//! Replays a transcript through the driver: what the instrument file sends is compared byte by byte with
//! what was sent, and the recorded answers come back at the recorded times.

use std::{
    sync::{Arc, Mutex, PoisonError},
    thread,
    time::Duration,
};

use rig_analyzer::{Analyzer, TransportSettings};
use rig_files::instrument::{Dialect, RegisterMap};
use rig_link::{Clock, Flow, Frame, Port};
use rig_model::{
    Axis, AxisLimits, LineSettings, Mm, Parity, Position, RigTime, Scale, Span, StopBits,
    Terminator, with_causes,
};
use rig_stage::{BusHandle, BusSettings, Stage};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt, DuplexStream},
    time::sleep,
};

use super::{
    Role, TranscriptError, TranscriptFile,
    file::Section,
    roles::{AnalyzerTask, of_analyzer, of_drive},
};

/// What the devices on a port must be told.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Device {
    Analyzer(&'static Dialect),
    Drive(&'static RegisterMap),
}

impl Device {
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::Analyzer(dialect) => &dialect.name,
            Self::Drive(map) => &map.name,
        }
    }

    pub(crate) const fn roles(self) -> &'static [Role] {
        match self {
            Self::Analyzer(_) => &Role::ANALYZER,
            Self::Drive(_) => &Role::DRIVE,
        }
    }
}

/// Whether a role is proven.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct RoleProof {
    pub(crate) role: Role,
    pub(crate) verdict: Verdict,
}

/// The result of a replay.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// The bytes and the result are those of the transcript.
    Proven,
    /// The transcript does not have the role.
    NotRecorded,
    /// The first difference.
    Differs(String),
}

/// Replays every role of an instrument.
///
/// # Errors
/// [`TranscriptError`] for a transcript of another instrument, or without what was asked.
pub(crate) fn replay(
    device: Device,
    file: &TranscriptFile,
) -> Result<Vec<RoleProof>, TranscriptError> {
    let found = file.value("instrument").unwrap_or_default();
    if found != device.name() {
        let (found, expected) = (found.to_owned(), device.name().to_owned());
        return Err(TranscriptError::OtherInstrument { found, expected });
    }
    // The caller may be in a runtime, in which another one cannot wait.
    thread::scope(|scope| {
        let replay = || -> Result<Vec<RoleProof>, TranscriptError> {
            let runtime = tokio::runtime::Builder::new_current_thread()
                .enable_time()
                .start_paused(true)
                .build()
                .map_err(|source| TranscriptError::Thread { source })?;
            runtime.block_on(replay_all(device, file))
        };
        let thread = thread::Builder::new().spawn_scoped(scope, replay);
        let thread = thread.map_err(|source| TranscriptError::Thread { source })?;
        thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

async fn replay_all(
    device: Device,
    file: &TranscriptFile,
) -> Result<Vec<RoleProof>, TranscriptError> {
    let (host, peer) = tokio::io::duplex(1 << 16);
    let progress = Progress::default();
    // The requests of a network bus are numbered from the start of the connection, which other drives share.
    let is_numbered = matches!(device, Device::Drive(_)) && file.value("line") == Some("tcp");
    tokio::spawn(play(peer, file.sections.clone(), is_numbered, progress.clone()));
    let port = Port::new("the transcript", host, line(file)?, Clock::start());
    let mut driver = Driver::new(device, port, file)?;
    let mut proofs = Vec::new();
    let mut is_lost = false;
    for &role in device.roles() {
        let Some(section) = file.sections.iter().find(|section| section.role == role) else {
            proofs.push(RoleProof { role, verdict: Verdict::NotRecorded });
            continue;
        };
        let verdict = if is_lost {
            Verdict::Differs("not replayed, as a role before it differs".to_owned())
        } else {
            driver.verdict(section, &progress).await
        };
        is_lost |= verdict != Verdict::Proven;
        proofs.push(RoleProof { role, verdict });
    }
    Ok(proofs)
}

/// The driver that a transcript is replayed through.
enum Driver {
    Analyzer(Box<Analyzer>, AnalyzerTask),
    Drive(Box<Stage<Mm>>),
}

impl Driver {
    fn new(device: Device, port: Port, file: &TranscriptFile) -> Result<Self, TranscriptError> {
        match device {
            Device::Analyzer(dialect) => {
                let task = AnalyzerTask {
                    level_v: file.number("level_v")?,
                    low_hz: file.number("low_hz")?,
                    high_hz: file.number("high_hz")?,
                };
                let terminator = file.value("terminator").map(|name| {
                    let known = Terminator::ALL.into_iter().find(|known| known.name() == name);
                    known.ok_or(TranscriptError::Head { key: "terminator" })
                });
                let terminator = terminator.transpose()?;
                let reply_s = file.number("reply_timeout_s")?.clamp(0.05, 60.0);
                let reply_within = Duration::from_secs_f64(reply_s);
                let settings = TransportSettings { terminator, reply_within };
                let analyzer = Analyzer::open_with(port, dialect, settings);
                Ok(Self::Analyzer(Box::new(analyzer), task))
            }
            Device::Drive(map) => {
                let settings = match file.value("line") {
                    Some("tcp") => BusSettings::tcp(),
                    _ => BusSettings::rtu(),
                };
                let bus = BusHandle::open(port, settings);
                let unit = file.number("unit_id")?;
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "it is clamped to the addresses of a line"
                )]
                let unit = unit.clamp(1.0, 247.0) as u8;
                let stage = Stage::new(bus, map, unit, scale(file)?, axis(file)?);
                Ok(Self::Drive(Box::new(stage)))
            }
        }
    }

    async fn verdict(&mut self, section: &Section, progress: &Progress) -> Verdict {
        let result = match self {
            Self::Analyzer(analyzer, task) => {
                let done = of_analyzer(analyzer, section.role, task).await;
                done.map_err(|error| with_causes(&error))
            }
            Self::Drive(stage) => of_drive(stage).await.map_err(|error| with_causes(&error)),
        };
        // The player reads what was sent last.
        sleep(Duration::from_millis(1)).await;
        if let Some(difference) = progress.difference() {
            return Verdict::Differs(difference);
        }
        match result {
            Err(error) => Verdict::Differs(error),
            Ok(_) if progress.played(section.role) < section.frames.len() => {
                let at = section.frames[progress.played(section.role)].at.as_seconds();
                Verdict::Differs(format!(
                    "at {at:.3} s the transcript goes on, and the file does not"
                ))
            }
            Ok(found) if found != section.result => {
                let shown = |lines: &[String]| lines.join("; ");
                let (found, expected) = (shown(&found), shown(&section.result));
                Verdict::Differs(format!("the result is {found}, and was {expected}"))
            }
            Ok(_) => Verdict::Proven,
        }
    }
}

/// How far a transcript was played.
#[derive(Debug, Clone, Default)]
struct Progress {
    state: Arc<Mutex<State>>,
}

#[derive(Debug, Default)]
struct State {
    played: Vec<(Role, usize)>,
    difference: Option<String>,
}

impl Progress {
    fn note(&self, role: Role) {
        let mut state = self.lock();
        match state.played.iter_mut().find(|(known, _)| *known == role) {
            Some((_, count)) => *count += 1,
            None => state.played.push((role, 1)),
        }
    }

    fn played(&self, role: Role) -> usize {
        let state = self.lock();
        state.played.iter().find(|(known, _)| *known == role).map_or(0, |(_, count)| *count)
    }

    fn differ(&self, difference: String) {
        self.lock().difference.get_or_insert(difference);
    }

    fn difference(&self) -> Option<String> {
        self.lock().difference.clone()
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Plays the side of the instrument, and hangs up at the first difference.
async fn play(mut io: DuplexStream, sections: Vec<Section>, is_numbered: bool, progress: Progress) {
    let (mut last_at, mut number) = (RigTime::ZERO, None);
    for Section { role, frames, .. } in sections {
        for Frame { at, flow, bytes } in frames {
            match flow {
                Flow::Sent => {
                    match expect(&mut io, &bytes, if is_numbered { NUMBER_BYTES } else { 0 }).await
                    {
                        Ok(found) => number = is_numbered.then_some(found),
                        Err(difference) => {
                            progress.differ(format!("at {:.3} s {difference}", at.as_seconds()));
                            return;
                        }
                    }
                }
                Flow::Received | Flow::Discarded => {
                    sleep(at.since(last_at)).await;
                    let bytes = match number.take() {
                        Some(number) => [
                            number.get(..NUMBER_BYTES).unwrap_or_default(),
                            bytes.get(NUMBER_BYTES..).unwrap_or_default(),
                        ]
                        .concat(),
                        None => bytes,
                    };
                    if io.write_all(&bytes).await.is_err() {
                        return;
                    }
                }
            }
            last_at = at;
            progress.note(role);
        }
    }
    // What comes now is in no transcript.
    let mut more = [0; 256];
    if let Ok(count @ 1..) = io.read(&mut more).await {
        let sent = more[..count].escape_ascii();
        progress.differ(format!("the file sends `{sent}`, and the transcript is over"));
    }
}

/// Bytes of the number of a request to a network bus, at its begin and at that of its answer.
const NUMBER_BYTES: usize = 2;

/// Reads the bytes that the transcript has, of which the first ones may differ.
async fn expect(io: &mut DuplexStream, bytes: &[u8], free: usize) -> Result<Vec<u8>, String> {
    let mut found = Vec::with_capacity(bytes.len());
    while found.len() < bytes.len() {
        let mut buffer = vec![0; bytes.len() - found.len()];
        match io.read(&mut buffer).await {
            Ok(count @ 1..) => found.extend_from_slice(&buffer[..count]),
            // The driver has given up, and says why.
            _ => return Err("the driver ended".to_owned()),
        }
        let (from, to) = (free.min(found.len()), found.len());
        if found[from..] != bytes[from..to] {
            let (sent, recorded) = (found.escape_ascii(), bytes.escape_ascii());
            return Err(format!("the file sends `{sent}`, and the transcript has `{recorded}`"));
        }
    }
    Ok(found)
}

/// The serial line of a transcript: `38400 none 1`; none for a network.
fn line(file: &TranscriptFile) -> Result<Option<LineSettings>, TranscriptError> {
    let missing = TranscriptError::Head { key: "line" };
    let words: Vec<_> = file.value("line").unwrap_or_default().split(' ').collect();
    let [baud, parity, stop_bits] = words[..] else {
        return if words == ["tcp"] { Ok(None) } else { Err(missing) };
    };
    let Ok(baud) = baud.parse() else { return Err(missing) };
    let parity = match parity {
        "even" => Parity::Even,
        "odd" => Parity::Odd,
        "none" => Parity::None,
        _ => return Err(missing),
    };
    let stop_bits = if stop_bits == "2" { StopBits::Two } else { StopBits::One };
    Ok(Some(LineSettings { baud, parity, stop_bits }))
}

fn scale(file: &TranscriptFile) -> Result<Scale<Mm>, TranscriptError> {
    Ok(Scale {
        per_count: file.number("per_count")?,
        zero: Position::new(file.number("zero")?),
        counts_per_revolution: file.number("counts_per_revolution")?,
        acceleration_per_s2: file.number("acceleration")?,
    })
}

/// An axis with the soft limits of the transcript; they are among the settings that a look compares.
fn axis(file: &TranscriptFile) -> Result<Axis<Mm>, TranscriptError> {
    let (min, max) = (file.number("soft_min")?, file.number("soft_max")?);
    let soft = Span::new(min, max);
    let limits =
        AxisLimits { travel: soft, soft, rest: soft.min, tolerance: 1.0, max_speed_per_s: 1.0 };
    Axis::new("the transcript", limits).map_err(|_| TranscriptError::Head { key: "soft_max" })
}
