//! Why a command fails: its message, its exit code, and its advice.

use std::{
    io,
    net::SocketAddr,
    path::{Path, PathBuf},
};

use rig_engine::{CommandRefusal, RigState};
use rig_model::{Clearance, Mm, Position};
use rig_report::export::ExportError;
use rig_ship::{KeyError, ShipError, StorageError};
use rig_store::StoreError;
use rig_verify::JournalError;

use super::{client::DaemonError, commission::CommissionFailure};
use crate::{
    archive::ArchiveError,
    doctor::advice,
    endpoint::EndpointError,
    http::{access::TokenError, tls::TlsError},
    loaded_rig::FileError,
    notify::{NotifyError, TargetError},
    place::SHIPPED_RIG,
    rig::{LadderError, OpenError, RequestRefusal, ResumeRefusal},
    run_files::RunFilesError,
    sweep_form::SweepFaults,
    tokens::TokensError,
};

pub(super) const EXIT_CODES: &str = "\
Exit codes:
  0  done
  1  something failed: a file, a directory, a device, a daemon, a check
  2  a bad command line, protocol, rig or sweep file, a target beyond the
     limits, or a change since a run that nobody confirmed
  3  no such run, no run under way, or no resonance
  4  the rig is latched after a fault
  5  a run, a move or a sweep was aborted, also by one signal to end
  6  a run came to its end, and some of its touches were refused
  7  the journal or the folder of a run is not sound
  8  the daily check of the bench says look, or not to be trusted
130  ended by a signal before the rig was ready, or at once by the last
     one, with the rig left as it was";

/// Why a command failed, with its exit code.
#[derive(Debug, thiserror::Error)]
pub(super) enum Failure {
    #[error(transparent)]
    BadFile(#[from] FileError),
    #[error(transparent)]
    RunFiles(#[from] RunFilesError),
    #[error(transparent)]
    Open(#[from] OpenError),
    #[error(transparent)]
    #[cfg(feature = "simulator")]
    Rehearse(#[from] crate::rehearse::RehearseError),
    #[error(transparent)]
    Commission(#[from] CommissionFailure),
    #[error(transparent)]
    Archive(#[from] ArchiveError),
    #[error(transparent)]
    Ship(#[from] ShipError),
    #[error(transparent)]
    Storage(#[from] StorageError),
    #[error(transparent)]
    Key(#[from] KeyError),
    #[error("{store} has no objects")]
    NoObjects { store: String },
    #[error("--signed-by is for objects of an object store; the journal has no signatures")]
    NotSigned,
    #[error("--hours is for --level soak; the levels before it take minutes")]
    NoSoak,
    #[error("data directory {}", data.display())]
    Data { data: PathBuf, source: StoreError },
    #[error("data directory {}: the list of its runs cannot be read, so that nothing is copied", data.display())]
    NothingReadable { data: PathBuf, source: StoreError },
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Export(#[from] ExportError),
    #[error(transparent)]
    Refused(#[from] RequestRefusal),
    #[error(transparent)]
    Sweep(#[from] SweepFaults),
    #[error("{reason}")]
    NoResonance { reason: String },
    #[error("{refused} of {sweeps} sweeps have no resonance")]
    NoResonances { refused: usize, sweeps: usize },
    #[error("this timing needs the columns {missing} in the file")]
    NoTimes { missing: &'static str },
    #[error("{because}")]
    Transcript { because: String },
    #[error("{differs} {} from the transcript", if *differs == 1 { "role differs" } else { "roles differ" })]
    Differs { differs: usize },
    #[error(transparent)]
    Ladder(#[from] LadderError),
    #[error(
        "no drive answers at any speed and parity; check its power, its address and the two wires"
    )]
    NoAnswer,
    #[error("the file of {analyzer} has no commands for this: {what}; correct it at its panel")]
    NoCorrection { analyzer: &'static str, what: &'static str },
    #[error("--length-m {wanted} is no length that the analyzer corrects for: {known} m")]
    CableLength { wanted: f64, known: String },
    #[error("{silent} of 3 devices did not answer correctly")]
    Unidentified { silent: usize },
    #[error("{problems} {}", if *problems == 1 { "problem" } else { "problems" })]
    Unfit { problems: usize },
    #[error(
        "--listen {listen} lets every computer on that network move the rig; make a token for each \
         person and program with `rigd token new NAME --data DIR`, which clients then send as \
         `Authorization: Bearer`, or listen on 127.0.0.1"
    )]
    NoToken { listen: SocketAddr },
    #[error("rigd cannot listen on {address}; {advice}")]
    Listen { address: SocketAddr, advice: &'static str, source: io::Error },
    #[error(
        "the service manager gives {count} sockets by LISTEN_FDS, and rigd listens on one; keep one \
         `ListenStream=` in its socket unit"
    )]
    Sockets { count: usize },
    #[error(
        "the socket that the service manager gives by LISTEN_FDS is not one on which rigd can listen; give it a \
         TCP address by `ListenStream=` in the socket unit"
    )]
    Socket { source: io::Error },
    #[error(transparent)]
    Token(#[from] TokenError),
    #[error(transparent)]
    Tokens(#[from] TokensError),
    #[error(transparent)]
    Tls(#[from] TlsError),
    #[error("the hub")]
    Hub(#[from] rig_hub::TlsError),
    #[error(transparent)]
    Bench(#[from] rig_hub::NameError),
    #[error(transparent)]
    Target(#[from] TargetError),
    #[error(transparent)]
    Notify(#[from] NotifyError),
    #[error("{what}")]
    System { what: &'static str, source: io::Error },
    /// It has been explained already.
    #[error("the rig is latched: {cause}")]
    Latched { cause: String },
    /// The faults have been listed.
    #[error("the probe is {}{hint}", probe.name())]
    NotClear { probe: Clearance, hint: String },
    /// The daemon was ended, and the probe is clear.
    #[error("{because}; rigd was ended, and the probe is clear")]
    Replaced { because: String },
    /// It has been said how the probe was left.
    #[error("the HTTP server ended unexpectedly, and the rig was closed")]
    HttpEnded,
    #[error("aborted")]
    Aborted,
    /// The runs have been listed already.
    #[error("touches were refused")]
    TouchesRefused,
    /// The check has been printed.
    #[error("the daily check says: {verdict}")]
    NotAccepted { verdict: &'static str },
    #[error("interrupted")]
    Interrupted,
    #[error(
        "{what} is not for a terminal; name a file with --out, or send the output to a program"
    )]
    NoFile { what: &'static str },
    #[error("{what} needs a directory; name it with --out")]
    NoFolder { what: &'static str },
    #[error("run {run} has no sweep {number}; `rigd export {run} --format sweeps` lists them")]
    NoSweep { run: String, number: u64 },
    #[error("{}: there is a file already, and it is not {kind}; it is left as it is", path.display())]
    Kept { path: PathBuf, kind: &'static str },
    #[error("{}", path.display())]
    File { path: PathBuf, source: io::Error },
    #[error(transparent)]
    Daemon(#[from] DaemonError),
    /// The fault has been printed.
    #[error("the rig is latched, and the probe is {probe}")]
    DaemonLatched { probe: String },
    #[error("the run was {status}")]
    RunEnded { status: String },
    #[error("data directory {}", data.display())]
    Unchecked { data: PathBuf, source: JournalError },
    /// The findings have been listed.
    #[error("the journal or the folder of the run is not sound")]
    NotSound,
    #[error(
        "ended at once while the rig was {}; it is left as it is, and the probe is {}{}. The \
         drives may still carry out their last command: keep your hands away, and check by eye \
         where the probe is; `rigd doctor` says what to do next, and moves nothing",
        state.name(),
        probe.text(),
        linear.map_or_else(String::new, |at| format!(" (last read back at {at})"))
    )]
    Left { state: RigState, probe: Clearance, linear: Option<Position<Mm>> },
}

impl Failure {
    pub(super) fn exit_code(&self) -> u8 {
        match self {
            Self::BadFile(_)
            | Self::Sweep(_)
            | Self::NoTimes { .. }
            | Self::NoToken { .. }
            | Self::Token(_)
            | Self::Tls(_)
            | Self::Hub(_)
            | Self::Bench(_)
            | Self::Target(_)
            | Self::Tokens(TokensError::Taken { .. } | TokensError::Unknown { .. })
            | Self::NoFile { .. }
            | Self::NoFolder { .. }
            | Self::NotSigned
            | Self::NoSoak
            | Self::CableLength { .. }
            | Self::Daemon(DaemonError::Token(_) | DaemonError::WrongAnswer(_)) => 2,
            Self::Refused(refusal) => code_of(refusal),
            Self::NoResonance { .. }
            | Self::NoResonances { .. }
            | Self::NoSweep { .. }
            | Self::NoObjects { .. }
            | Self::Daemon(DaemonError::NoRun)
            | Self::Store(StoreError::NoSuchRun { .. } | StoreError::Ambiguous { .. })
            | Self::Archive(
                ArchiveError::Store(StoreError::NoSuchRun { .. }) | ArchiveError::Ambiguous { .. },
            ) => 3,
            Self::Latched { .. }
            | Self::NotClear { .. }
            | Self::DaemonLatched { .. }
            | Self::Replaced { .. }
            | Self::RunEnded { .. } => 4,
            Self::Aborted => 5,
            Self::TouchesRefused => 6,
            Self::NotSound => 7,
            Self::NotAccepted { .. } => 8,
            Self::Commission(failure) => failure.exit_code(),
            Self::Interrupted | Self::Left { .. } => 130,
            #[cfg(feature = "simulator")]
            Self::Rehearse(_) => 1,
            Self::RunFiles(_)
            | Self::Tokens(_)
            | Self::Notify(_)
            | Self::Archive(_)
            | Self::Ship(_)
            | Self::Storage(_)
            | Self::Key(_)
            | Self::Daemon(_)
            | Self::Open(_)
            | Self::Data { .. }
            | Self::NothingReadable { .. }
            | Self::Store(_)
            | Self::Export(_)
            | Self::Transcript { .. }
            | Self::Differs { .. }
            | Self::Ladder(_)
            | Self::NoAnswer
            | Self::NoCorrection { .. }
            | Self::Unidentified { .. }
            | Self::Unfit { .. }
            | Self::Unchecked { .. }
            | Self::HttpEnded
            | Self::Listen { .. }
            | Self::Sockets { .. }
            | Self::Socket { .. }
            | Self::Kept { .. }
            | Self::File { .. }
            | Self::System { .. } => 1,
        }
    }
}

/// The exit code of a refused command.
fn code_of(refusal: &RequestRefusal) -> u8 {
    match refusal {
        RequestRefusal::Resume(refusal) => match &**refusal {
            ResumeRefusal::Changed { .. }
            | ResumeRefusal::OtherKind { .. }
            | ResumeRefusal::Protocol(_) => 2,
            ResumeRefusal::Store(StoreError::NoSuchRun { .. })
            | ResumeRefusal::NoSuchTouch { .. } => 3,
            _ => 1,
        },
        RequestRefusal::Command(CommandRefusal::NoSuchTouch { .. }) => 3,
        RequestRefusal::Command(
            CommandRefusal::LinearTarget(_)
            | CommandRefusal::RotaryTarget(_)
            | CommandRefusal::TooDeep { .. }
            | CommandRefusal::TooFar { .. },
        ) => 2,
        _ => 1,
    }
}

/// Advice for a damaged journal.
pub(crate) const SALVAGE: &str =
    "keep the directory; `rigd salvage NEW --data DIR` copies what verifies to a new one";

const NOTHING_READABLE: &str = "keep the directory, and `rigd restore BACKUP --data NEW` if there is a backup; a report that was written \
                                before is in the directory";

const NO_RIG_FILE: &str = "give a rig file with --rig; without --rig, rigd looks in /etc/rigd, in ~/.config/rigd, and for the \
                           shipped one here";

const FULL_DISK: &str = "free or check the disk of the data directory; if the probe may be in the sample, `rigd safe` retracts \
                         it without a journal";

impl Failure {
    /// Advice, if the message has none.
    pub(super) fn advice(&self) -> Option<&'static str> {
        match self {
            Self::Store(StoreError::Archived { .. })
            | Self::RunFiles(RunFilesError::Store(StoreError::Archived { .. })) => {
                Some("read it there: `rigd show RUN --data PLACE`, and so with the other commands")
            }
            Self::Store(StoreError::NoSuchRun { .. })
            | Self::Archive(ArchiveError::Store(StoreError::NoSuchRun { .. })) => {
                Some("`rigd runs --data DIR` lists the runs of a data directory")
            }
            Self::Data { source: StoreError::Damaged(_), .. }
            | Self::Open(OpenError::Data { source: StoreError::Damaged(_), .. }) => {
                Some("`rigd salvage NEW --data DIR` copies the readable part to a new directory")
            }
            Self::Kept { .. } => Some("name another file with --out, or remove this one"),
            Self::NothingReadable { .. } => Some(NOTHING_READABLE),
            Self::Store(StoreError::Io(_))
            | Self::RunFiles(RunFilesError::Store(StoreError::Io(_))) => {
                Some("check the disk of the data directory")
            }
            Self::RunFiles(RunFilesError::File { source, .. })
                if matches!(
                    source.kind(),
                    io::ErrorKind::ReadOnlyFilesystem
                        | io::ErrorKind::PermissionDenied
                        | io::ErrorKind::StorageFull
                ) =>
            {
                Some(
                    "the run is in the journal; `rigd report RUN --out FILE` writes its report to FILE",
                )
            }
            Self::Open(OpenError::Data {
                source: StoreError::DiskFull | StoreError::Io(_),
                ..
            }) => Some(FULL_DISK),
            Self::Data { source: StoreError::NoLog { .. }, .. }
            | Self::Open(OpenError::Data { source: StoreError::NoLog { .. }, .. }) => {
                Some("try again, or name a directory on a disk of this computer with --data")
            }
            Self::Data { source: StoreError::NoJournal, .. } => {
                Some("name the directory of an earlier run with --data")
            }
            Self::Open(OpenError::Data { source: StoreError::InUse, .. }) => Some(
                "end the other rigd, speak to it (`rigd status`, `rigd stop`), or name another \
                 directory with --data",
            ),
            Self::Refused(RequestRefusal::NoSpace { .. }) => {
                Some("move old runs elsewhere, or choose another directory with --data")
            }
            Self::Refused(RequestRefusal::Resume(refusal)) => on_resume(refusal),
            Self::Daemon(DaemonError::Endpoint(EndpointError::None { .. })) => Some(
                "`rigd serve --data DIR` starts one; `rigd runs --data DIR` lists the runs without one",
            ),
            Self::Open(error) => advice::on_rig(error),
            Self::Commission(failure) => failure.advice(),
            Self::BadFile(FileError::Missing { path, .. }) if path == Path::new(SHIPPED_RIG) => {
                Some(NO_RIG_FILE)
            }
            Self::Store(error)
            | Self::RunFiles(RunFilesError::Store(error))
            | Self::Archive(ArchiveError::Store(error))
                if error.is_damage() =>
            {
                Some(SALVAGE)
            }
            _ => None,
        }
    }
}

/// Advice for a run that is not resumed, or a touch that is not amended.
fn on_resume(refusal: &ResumeRefusal) -> Option<&'static str> {
    match refusal {
        ResumeRefusal::Changed { .. } => {
            Some("confirm the change with --accept-changes, or name the other rig file with --rig")
        }
        ResumeRefusal::Sealed { .. } | ResumeRefusal::Store(StoreError::Sealed { .. }) => Some(
            "`rigd redo RUN STEP` measures one touch again; `rigd run PROTOCOL` begins a new run",
        ),
        ResumeRefusal::Store(error) if error.is_damage() => Some(SALVAGE),
        _ => None,
    }
}
