//! `rigd runs`, `show`, `report`, `give-up`, `skip`, `backup`, `restore` and `salvage`: the runs of a data directory.

use std::{
    fs,
    path::{Path, PathBuf},
};

use clap::Args;
use rig_record::StoredRecord;
use rig_report::{RunResults, RunVerdict};
use rig_store::{BackedUpRun, Reader, Run, RunKind, StoreError};
use serde::Serialize;

use super::{
    Failure,
    args::{DataArgs, OperatorArgs, OutputArgs, RunArg, TouchArgs},
    failure::SALVAGE,
    output_file::{self, OutputKind},
    table::{columns, concluded, duration, note, print, print_json},
};
use crate::{
    archive,
    calibrations::FOLDER as CALIBRATIONS,
    corrections::FILE as CORRECTIONS,
    interruption::{ADVICE, InterruptionView},
    local_time,
    rig::{self, RequestRefusal},
    run_files::{self, ResultsView, RunFilesError},
    verdict,
};

#[derive(Debug, Args)]
pub(super) struct RunsArgs {
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Debug, Args)]
pub(super) struct ShowArgs {
    #[command(flatten)]
    run: RunArg,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Debug, Args)]
pub(super) struct ReportArgs {
    #[command(flatten)]
    run: RunArg,
    /// File to write instead of the one in the data directory. One that is there is replaced only if it is a report
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(super) struct GiveUpArgs {
    #[command(flatten)]
    run: RunArg,
    #[command(flatten)]
    operator: OperatorArgs,
}

#[derive(Debug, Args)]
pub(super) struct SalvageArgs {
    /// Directory of the new journal
    to: PathBuf,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// A run in a list, for a program.
#[derive(Debug, Serialize)]
struct RunView {
    run_id: String,
    name: String,
    protocol: String,
    status: &'static str,
    is_simulated: bool,
    started_at: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    finished_at: Option<String>,
    records: u64,
    /// The folder in the archive that has its readings.
    #[serde(skip_serializing_if = "Option::is_none")]
    archived_to: Option<String>,
    /// It can be resumed with `rigd run --resume`.
    is_resumable: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    interruption: Option<InterruptionView>,
    #[serde(skip)]
    wall_s: Option<f64>,
}

/// The results of a run and its interruption, for a program.
#[derive(Debug, Serialize)]
struct ShowView {
    #[serde(flatten)]
    results: ResultsView,
    #[serde(skip_serializing_if = "Option::is_none")]
    interruption: Option<InterruptionView>,
}

pub(super) fn list(args: &RunsArgs) -> Result<(), Failure> {
    let data = args.data.dir();
    let mut views = Vec::new();
    if archive::is_archive(&data) {
        for object in archive::objects(&data)? {
            let source = |source| Failure::Data { data: object.place.clone(), source };
            let of_object = Reader::open(&object.place).map_err(source);
            match of_object.and_then(|reader| views_of(&reader)) {
                Ok(found) => views.extend(found),
                Err(failure) => note(&format!("not listed: {failure}")),
            }
        }
    } else {
        views = views_of(&args.data.journal()?)?;
    }
    if args.output.json {
        return print_json(&views);
    }
    let row = |view: &RunView| {
        let status = view.status.replace('_', " ");
        vec![
            view.name.clone(),
            if view.archived_to.is_some() { format!("{status}, archived") } else { status },
            local_time::local(&view.started_at),
            view.wall_s.map(duration).unwrap_or_default(),
            if view.is_simulated { "simulated" } else { "real" }.to_owned(),
        ]
    };
    let rows: Vec<_> = views.iter().map(row).collect();
    print(&columns(&["run", "status", "started", "took (clock)", "rig"], &rows))?;
    for RunView { name, interruption, .. } in &views {
        if let Some(left) = interruption.as_ref().filter(|left| left.is_open()) {
            note(&format!("{name} was {}; {ADVICE}", left.message));
        }
    }
    Ok(())
}

/// The runs of a journal, the latest first. What cannot be read of one is noted, and the others are listed.
fn views_of(reader: &Reader) -> Result<Vec<RunView>, Failure> {
    let is_run = |run: &Run| run.kind == RunKind::Run;
    let view = |run: Run| {
        let name = run.short_name();
        let archived = or_noted(reader.archive_of(run.id), "the archive", &name);
        let interruption = or_noted(InterruptionView::read(reader, &run), "the end", &name);
        RunView {
            run_id: run.id.to_string(),
            is_resumable: run.is_resumable(),
            status: run.status.name(),
            is_simulated: reader.is_simulated(run.id),
            records: run.records,
            archived_to: archived.map(|note| note.place),
            interruption,
            wall_s: run.wall_s,
            protocol: run.name,
            started_at: run.started_at,
            finished_at: run.finished_at,
            name,
        }
    };
    for (id, flaw) in reader.damaged_entries()? {
        note(&format!("not listed: {id}: {flaw}; {SALVAGE}"));
    }
    Ok(reader.runs()?.into_iter().filter(is_run).map(view).collect())
}

/// What was found of a run; none after a note if it cannot be read.
fn or_noted<T>(found: Result<Option<T>, StoreError>, what: &str, run: &str) -> Option<T> {
    found.unwrap_or_else(|error| {
        note(&format!("{what} of {run} cannot be read: {error}"));
        None
    })
}

pub(super) fn show(args: &ShowArgs) -> Result<(), Failure> {
    let (reader, run) = args.run.find()?;
    print_run(&args.run.dir()?, &reader, &run, args.output.json)
}

/// Prints the results of a run for a person; of an amendment, those of the run that it amends.
pub(super) fn show_run(data: &DataArgs, run: &str) -> Result<(), Failure> {
    let reader = data.journal()?;
    let run = reader.amended_run(reader.find(run)?)?;
    print_run(&data.dir(), &reader, &run, false)
}

fn print_run(data: &Path, reader: &Reader, run: &Run, is_json: bool) -> Result<(), Failure> {
    let results = results_of(run, &reader.amended(run.id)?)?;
    let verdict = verdict::for_report(data, run.id);
    print_results(data, &results, &verdict, is_json)
}

pub(super) fn report(args: &ReportArgs) -> Result<(), Failure> {
    let data = &args.run.dir()?;
    let (reader, run) = args.run.find()?;
    let path = match &args.out {
        Some(path) => {
            output_file::check(path, OutputKind::Report)?;
            let written = run_files::write_report(data, &reader, run.id, path);
            written.map_err(|error| match error {
                RunFilesError::File { path, source } => Failure::File { path, source },
                error => error.into(),
            })?;
            path.clone()
        }
        None if reader.is_excerpt() => {
            // An archive is never written: its report is the one from before.
            let path = run_files::report(data, &run);
            fs::metadata(&path).map_err(|source| Failure::File { path: path.clone(), source })?;
            path
        }
        None => run_files::write(data, run.id)?.report,
    };
    note(&format!("report: {}", path.display()));
    Ok(())
}

/// Seals a run that was not completed.
pub(super) fn give_up(args: &GiveUpArgs) -> Result<(), Failure> {
    let (_, run) = args.run.find()?;
    args.run.data.store()?.give_up(run.id, 0, args.operator.name().as_str())?;
    run_files::write(&args.run.data.dir(), run.id)?;
    note(&format!("{} is given up and sealed", run.short_name()));
    Ok(())
}

/// A run that was salvaged, for a program.
#[derive(Debug, Serialize)]
struct SalvagedView {
    run_id: String,
    name: String,
    kind: String,
    records: u64,
    /// The damaged parts.
    #[serde(skip_serializing_if = "Option::is_none")]
    flaw: Option<String>,
}

#[derive(Debug, Args)]
pub(super) struct BackupArgs {
    /// New directory for the copy
    to: PathBuf,
    #[command(flatten)]
    data: DataArgs,
}

/// What a data directory has beside its journal that cannot be made again from it: notes of people, corrections of the
/// analyzer, and the calibrations.
const BESIDE: [&str; 3] = ["notes.json", CORRECTIONS, CALIBRATIONS];

/// Copies a journal that may be written meanwhile, and checks the copy.
pub(super) fn back_up(args: &BackupArgs) -> Result<(), Failure> {
    let from = args.data.dir();
    let data_error = |source| copy_failed(source, &from, &args.to);
    let runs = rig_store::back_up(&from, &args.to, &BESIDE).map_err(data_error)?;
    let is_whole = is_whole(&runs);
    let printed =
        print(&format!("{} copied to {}, and read there", sizes(&runs), args.to.display()));
    concluded(printed, if is_whole { Ok(()) } else { Err(Failure::NotSound) })
}

/// A journal that could not be copied, with the directory that the error is about.
fn copy_failed(source: StoreError, from: &Path, to: &Path) -> Failure {
    let is_of_copy = match &source {
        StoreError::NotEmpty
        | StoreError::Occupied { .. }
        | StoreError::InUse
        | StoreError::NotADirectory
        | StoreError::DiskFull => true,
        StoreError::Path { path, .. } => path.starts_with(to),
        _ => false,
    };
    Failure::Data { data: if is_of_copy { to } else { from }.to_path_buf(), source }
}

#[derive(Debug, Args)]
pub(super) struct RestoreArgs {
    /// Directory of a backup
    backup: PathBuf,
    #[command(flatten)]
    data: DataArgs,
}

/// Copies a backup to an empty data directory, if every run of the copy is whole.
pub(super) fn restore(args: &RestoreArgs) -> Result<(), Failure> {
    let to = args.data.dir();
    let data_error = |source| copy_failed(source, &args.backup, &to);
    let runs = rig_store::restore(&args.backup, &to, &BESIDE).map_err(data_error)?;
    if !is_whole(&runs) {
        let backup = args.backup.display();
        note(&format!(
            "nothing was restored; `rigd salvage NEW --data {backup}` copies what is whole to a new directory"
        ));
        return Err(Failure::NotSound);
    }
    print(&format!("{} restored to {}, and read there", sizes(&runs), to.display()))?;
    note("`rigd report RUN` writes the folder of a run again; tokens are made again");
    Ok(())
}

fn sizes(runs: &[BackedUpRun]) -> String {
    let records: u64 = runs.iter().map(|run| run.records).sum();
    format!("{} runs and sessions with {records} records", runs.len())
}

/// Whether no run of a copy has a flaw. Each flaw is told.
fn is_whole(runs: &[BackedUpRun]) -> bool {
    let broken: Vec<_> =
        runs.iter().filter_map(|run| Some((&run.id, run.flaw.as_ref()?))).collect();
    for (id, flaw) in &broken {
        note(&format!("{id}: {flaw}"));
    }
    broken.is_empty()
}

/// Copies what verifies of a damaged journal.
pub(super) fn salvage(args: &SalvageArgs) -> Result<(), Failure> {
    let from = args.data.dir();
    let data_error = |source| match source {
        StoreError::Damaged(_) => Failure::NothingReadable { data: from.clone(), source },
        source => copy_failed(source, &from, &args.to),
    };
    let salvaged = rig_store::salvage(&from, &args.to, &BESIDE).map_err(data_error)?;
    let view = |run: rig_store::SalvagedRun| SalvagedView {
        run_id: run.id,
        name: run.name,
        kind: run.kind,
        records: run.records,
        flaw: run.flaw.map(|flaw| flaw.to_string()),
    };
    let views: Vec<_> = salvaged.into_iter().map(view).collect();
    if args.output.json {
        return print_json(&views);
    }
    let row = |view: &SalvagedView| {
        let flaw = view.flaw.clone().unwrap_or_else(|| "whole".to_owned());
        vec![
            view.name.clone(),
            view.kind.clone(),
            view.records.to_string(),
            flaw,
            view.run_id.clone(),
        ]
    };
    let rows: Vec<_> = views.iter().map(row).collect();
    print(&columns(&["name", "kind", "records", "copied", "id"], &rows))?;
    note(&format!("copied to {}; the old directory is unchanged", args.to.display()));
    Ok(())
}

/// Leaves a touch of a run out.
pub(super) fn skip(args: &TouchArgs) -> Result<(), Failure> {
    let (data, touch) = (&args.run.data, args.order()?);
    rig::skip(&data.store()?, &touch, args.operator.name().as_str(), 0)
        .map_err(RequestRefusal::from)?;
    run_files::write(&data.dir(), touch.run)?;
    note(&format!("{} is left out; its readings stay in the journal", touch.step));
    Ok(())
}

/// Prints the results of a run.
pub(super) fn print_results(
    data: &Path,
    results: &RunResults,
    verdict: &RunVerdict,
    is_json: bool,
) -> Result<(), Failure> {
    let reader = Reader::open(data)?;
    let run = results.run();
    let interruption = InterruptionView::read(&reader, run)?;
    if is_json {
        if let Some(sentence) = results.shortfall() {
            note(&sentence);
        }
        let folder = run_files::folder(data, run);
        let results = ResultsView::new(results, verdict, folder);
        return print_json(&ShowView { results, interruption });
    }
    print(results.text().trim_end())?;
    if run.is_resumable() {
        let name = run.short_name();
        print(&format!("not completed: `rigd run --resume {name}` resumes it"))?;
    }
    if !verdict.is_sound() {
        let name = run.short_name();
        print(&format!(
            "the journal of {name} is {}; `rigd verify {name}` lists them",
            verdict.sentence
        ))?;
    }
    match interruption {
        Some(left) if left.is_open() => print(&format!("{}; {ADVICE}", left.message)),
        Some(left) => print(&left.message),
        None => Ok(()),
    }
}

pub(super) fn results_of(run: &Run, records: &[StoredRecord]) -> Result<RunResults, Failure> {
    Ok(RunResults::new(run, records).map_err(StoreError::from)?)
}
