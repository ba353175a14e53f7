//! `rigd instrument`: files of instruments to start from, their transcripts, and their check.

use std::{
    fs::File,
    io::{self, Write},
    path::{Path, PathBuf},
};

use clap::{Args, Subcommand, ValueEnum};
use rig_files::{
    FileKind,
    instrument::{Dialect, Named, RegisterMap, shipped_text},
    rig_file::RigFile,
};
use rig_model::{AnalyzerMake, DriveMake, with_causes};
use serde::Serialize;

use super::{
    Failure,
    args::{OutputArgs, RigArgs},
    schema::{ANALYZER, DRIVE},
    table::{concluded, note, print, print_json},
};
use crate::{
    files::read,
    loaded_rig::FileError,
    transcripts::{Device, Recorded, RoleProof, TranscriptFile, Verdict, beside, record, replay},
};

#[derive(Debug, Args)]
pub(super) struct InstrumentArgs {
    #[command(subcommand)]
    what: InstrumentCommand,
}

#[derive(Debug, Subcommand)]
enum InstrumentCommand {
    /// Write a file to start from, in which every key is explained
    New(NewInstrumentArgs),
    /// Record a transcript of each device of a rig; nothing moves, and nothing is written into a drive
    Record(RecordArgs),
    /// Check the file of an instrument, and replay its transcript against it
    Check(CheckInstrumentArgs),
}

#[derive(Debug, Args)]
struct NewInstrumentArgs {
    #[arg(value_enum)]
    kind: Kind,
    /// File to write, which must not exist; stdout without it. Its name becomes that of the instrument
    file: Option<PathBuf>,
}

/// A kind of instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// An impedance analyzer
    Analyzer,
    /// A Modbus axis drive
    Drive,
}

#[derive(Debug, Args)]
struct RecordArgs {
    #[command(flatten)]
    rig: RigArgs,
    /// Directory of the transcripts of shipped instruments; those of others stand beside their files
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
}

#[derive(Debug, Args)]
struct CheckInstrumentArgs {
    /// File of the instrument, or the name of a shipped one
    instrument: String,
    /// Transcript to replay [default: the file with the end .transcript]
    #[arg(long, value_name = "FILE")]
    transcript: Option<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
}

pub(super) fn instrument(args: &InstrumentArgs) -> Result<(), Failure> {
    match &args.what {
        InstrumentCommand::New(args) => new(args),
        InstrumentCommand::Record(args) => record_rig(args),
        InstrumentCommand::Check(args) => check(args),
    }
}

fn new(args: &NewInstrumentArgs) -> Result<(), Failure> {
    let (manual, old) = match args.kind {
        Kind::Analyzer => (ANALYZER, "my-analyzer"),
        Kind::Drive => (DRIVE, "my-drive"),
    };
    // Its schema is elsewhere.
    let manual = manual.split_once('\n').map_or(manual, |(_, rest)| rest);
    let Some(path) = &args.file else { return print(manual.trim_end()) };
    let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let name = serde_json::Value::from(stem.unwrap_or_else(|| old.to_owned()));
    let text = manual.replacen(&format!("name = \"{old}\""), &format!("name = {name}"), 1);
    write_new(path, &text)?;
    note(&format!("wrote {path}; `rigd instrument check {path}` checks it", path = path.display()));
    Ok(())
}

fn write_new(path: &Path, text: &str) -> Result<(), Failure> {
    let failed = |source: io::Error| Failure::File { path: path.to_owned(), source };
    let mut out = File::create_new(path).map_err(failed)?;
    out.write_all(text.as_bytes()).map_err(failed)
}

fn record_rig(args: &RecordArgs) -> Result<(), Failure> {
    let rig = args.rig.load()?;
    let folder = rig.path.parent().unwrap_or(Path::new("")).to_owned();
    let RigFile { analyzer, linear, rotary, .. } = &rig.file;
    let files =
        [file_of(&analyzer.instrument), file_of(&linear.instrument), file_of(&rotary.instrument)]
            .map(|file| file.map(|file| beside(&folder.join(file))));
    let (mut incomplete, mut written): (usize, Vec<PathBuf>) = (0, Vec::new());
    let mut unwritten = None;
    for (recorded, file) in record(rig)?.into_iter().zip(files) {
        let Recorded { device, instrument, file: transcript, fault } = recorded;
        if let Some(fault) = fault {
            note(&format!("{device}: {fault}"));
            incomplete += 1;
        }
        let name = instrument.name();
        let path = file.unwrap_or_else(|| beside(&args.out.join(format!("{name}.toml"))));
        // Two axes with one drive have one transcript.
        if transcript.sections.is_empty() || written.contains(&path) {
            continue;
        }
        written.push(path.clone());
        // The transcripts of the other devices are as good without this one.
        if let Err(failure) = write_new(&path, &transcript.text()) {
            note(&format!("{device}: not recorded in {}", path.display()));
            unwritten.get_or_insert(failure);
            continue;
        }
        let roles: Vec<_> = transcript.sections.iter().map(|section| section.role.name()).collect();
        print(&format!("{device}: {name}, {} recorded in {}", roles.join(", "), path.display()))?;
    }
    if let Some(failure) = unwritten {
        return Err(failure);
    }
    if incomplete > 0 { Err(Failure::Unidentified { silent: incomplete }) } else { Ok(()) }
}

fn file_of<M>(named: &Named<M>) -> Option<&Path> {
    match named {
        Named::Shipped(_) => None,
        Named::File { path, .. } => Some(path),
    }
}

/// The result of a check, for a program.
#[derive(Debug, Serialize)]
struct CheckView {
    instrument: &'static str,
    roles: Vec<RoleView>,
}

#[derive(Debug, Serialize)]
struct RoleView {
    role: &'static str,
    verdict: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    difference: Option<String>,
}

fn check(args: &CheckInstrumentArgs) -> Result<(), Failure> {
    let (device, transcript) = find(args)?;
    let proofs = match &transcript {
        None => {
            let not_recorded = |&role| RoleProof { role, verdict: Verdict::NotRecorded };
            device.roles().iter().map(not_recorded).collect()
        }
        Some(path) => {
            let replayed = TranscriptFile::load(path).and_then(|file| replay(device, &file));
            replayed.map_err(|error| Failure::Transcript { because: with_causes(&error) })?
        }
    };
    let differs = proofs.iter().filter(|p| matches!(p.verdict, Verdict::Differs(_))).count();
    let roles: Vec<_> = proofs.into_iter().map(RoleView::from).collect();
    let printed = if args.output.json {
        print_json(&CheckView { instrument: device.name(), roles })
    } else {
        let line = |view: &RoleView| {
            let more = view.difference.as_ref().map_or(String::new(), |text| format!(": {text}"));
            format!("{:<9} {}{more}", view.role, view.verdict)
        };
        let printed = print(&roles.iter().map(line).collect::<Vec<_>>().join("\n"));
        if transcript.is_none() {
            note(
                "no transcript; `rigd instrument record --rig RIG` records one on the ports of a rig",
            );
        }
        printed
    };
    concluded(printed, if differs > 0 { Err(Failure::Differs { differs }) } else { Ok(()) })
}

impl From<RoleProof> for RoleView {
    fn from(RoleProof { role, verdict }: RoleProof) -> Self {
        let (verdict, difference) = match verdict {
            Verdict::Proven => ("proven", None),
            Verdict::NotRecorded => ("unproven", None),
            Verdict::Differs(difference) => ("differs", Some(difference)),
        };
        Self { role: role.name(), verdict, difference }
    }
}

/// The instrument, and its transcript if there is one.
fn find(args: &CheckInstrumentArgs) -> Result<(Device, Option<PathBuf>), Failure> {
    let given = args.transcript.clone();
    if shipped_text(&args.instrument).is_some() {
        let analyzer = AnalyzerMake::ALL.into_iter().find(|make| make.name() == args.instrument);
        let drive = DriveMake::ALL.into_iter().find(|make| make.name() == args.instrument);
        let analyzer = analyzer.map(|make| Device::Analyzer(Dialect::of(make)));
        let device = analyzer.or(drive.map(|make| Device::Drive(RegisterMap::of(make))));
        if let Some(device) = device {
            return Ok((device, given));
        }
    }
    let path = Path::new(&args.instrument);
    let device = match read(path, FileKind::Analyzer) {
        Ok((name, text)) => {
            let dialect = Dialect::read_and_keep(&name, &text);
            Device::Analyzer(dialect.map_err(FileError::Faults)?)
        }
        Err(error) => {
            // A file that cannot be read as a drive either gives the first error.
            let Ok((name, text)) = read(path, FileKind::Drive) else { return Err(error.into()) };
            Device::Drive(RegisterMap::read_and_keep(&name, &text).map_err(FileError::Faults)?)
        }
    };
    let usual = beside(path);
    Ok((device, given.or_else(|| usual.exists().then_some(usual))))
}
