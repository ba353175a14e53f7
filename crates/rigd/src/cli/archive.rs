//! `rigd archive`: moves sealed runs out of the journal.

use std::{path::PathBuf, str::FromStr};

use clap::Args;
use jiff::{SignedDuration, Timestamp};
use rig_model::with_causes;
use rig_store::{Reader, Run, RunKind};
use serde::Serialize;

use super::{
    Failure,
    args::{DataArgs, OperatorArgs, OutputArgs},
    table::{columns, note, print, print_json},
};
use crate::archive::{self, Archive, ArchiveError};

#[derive(Debug, Args)]
pub(super) struct ArchiveArgs {
    /// Directory of the archive, made if it is missing
    to: PathBuf,
    /// Runs to archive: names such as `smoke-7`, or ids; without them, those that fit both rules
    #[arg(required_unless_present_any = ["older_than", "keep"])]
    runs: Vec<String>,
    /// Archive runs that ended at least this long ago, such as `90d` or `12w`
    #[arg(long, value_name = "TIME", conflicts_with = "runs")]
    older_than: Option<Age>,
    /// Keep the latest runs, this many
    #[arg(long, value_name = "COUNT", conflicts_with = "runs")]
    keep: Option<usize>,
    /// Say what would be archived, and change nothing
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    operator: OperatorArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// A time in days or weeks.
#[derive(Debug, Clone, Copy)]
struct Age(SignedDuration);

#[derive(Debug, thiserror::Error)]
#[error("`{0}` is not a duration: give a number of days or weeks, such as `90d` or `12w`")]
struct AgeError(String);

impl FromStr for Age {
    type Err = AgeError;

    fn from_str(text: &str) -> Result<Self, AgeError> {
        /// More than any journal is old, so that the arithmetic of times holds.
        const DAYS_MAX: u32 = 36_500;
        let days = |(count, unit): (&str, &str)| {
            let count: u32 = count.parse().ok()?;
            count.checked_mul(if unit == "w" { 7 } else { 1 }).filter(|days| *days <= DAYS_MAX)
        };
        let unit = ["d", "w"].into_iter().find(|unit| text.ends_with(unit));
        unit.and_then(|unit| Some((text.strip_suffix(unit)?, unit)))
            .and_then(days)
            .map(|days| Self(SignedDuration::from_hours(24 * i64::from(days))))
            .ok_or_else(|| AgeError(text.to_owned()))
    }
}

/// What is done with a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Outcome {
    /// It is in the archive, and its readings are no longer in the journal.
    Archived,
    /// It would be.
    WouldBeArchived,
    /// It is in the archive, and still in the journal.
    Copied,
    /// The rule leaves it in the journal, or it can still go on.
    Kept,
    /// It is not sound.
    Refused,
}

/// A run, for a program.
#[derive(Debug, Serialize)]
struct ArchivedView {
    run_id: String,
    name: String,
    outcome: Outcome,
    /// The folder in the archive.
    #[serde(skip_serializing_if = "Option::is_none")]
    place: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
}

impl ArchivedView {
    fn new(run: &Run, outcome: Outcome, place: Option<PathBuf>, reason: Option<String>) -> Self {
        Self { run_id: run.id.to_string(), name: run.short_name(), outcome, place, reason }
    }
}

pub(super) fn archive(args: &ArchiveArgs) -> Result<(), Failure> {
    let data = args.data.dir();
    let reader = args.data.journal()?;
    archive::check_apart(&args.to, &data)?;
    if args.dry_run {
        return report(args, &foretold(args, &reader)?);
    }
    let archive = Archive::open(&args.to)?;
    end_amendments(args, &reader)?;
    let mut views = Vec::new();
    let mut copied = Vec::new();
    for run in chosen(args, &reader)? {
        if reader.archive_of(run.id)?.is_some() {
            if archive.is_unfinished(&reader, &data, &run)? {
                copied.push(run);
            }
            continue;
        }
        if let Some(reason) = reason_to_keep(args, &run) {
            views.push(ArchivedView::new(&run, Outcome::Kept, None, Some(reason)));
        } else {
            match archive.copy(&data, &run) {
                Ok(_) => copied.push(run),
                Err(error) => views.push(of_run(&run, None, error)?),
            }
        }
    }
    drop(reader);
    let failure = take_out(args, &archive, &copied, &mut views);
    report(args, &views)?;
    failure?;
    if views.iter().any(|view| view.outcome == Outcome::Refused) {
        return Err(Failure::NotSound);
    }
    Ok(())
}

/// Ends the amendments that a killed program has left without their ends: a run with one of them is not archived. While another
/// program writes, they stay.
fn end_amendments(args: &ArchiveArgs, reader: &Reader) -> Result<(), Failure> {
    let is_left = |run: &Run| run.kind == RunKind::Amendment && !run.is_sealed;
    if reader.runs()?.iter().any(is_left) {
        // An error is that of the runs that are then taken out.
        drop(args.data.store());
    }
    Ok(())
}

/// What an error says of a run that stays in the journal.
///
/// # Errors
/// The error, if it is not about this run alone.
fn of_run(
    run: &Run,
    place: Option<PathBuf>,
    error: ArchiveError,
) -> Result<ArchivedView, ArchiveError> {
    let outcome = match &error {
        error if error.is_under_way() => Outcome::Kept,
        error if error.is_of_run() => Outcome::Refused,
        _ => return Err(error),
    };
    Ok(ArchivedView::new(run, outcome, place, Some(with_causes(&error))))
}

/// What would be done, as far as the list of runs tells.
fn foretold(args: &ArchiveArgs, reader: &Reader) -> Result<Vec<ArchivedView>, Failure> {
    let root = std::path::absolute(&args.to)
        .map_err(|source| Failure::File { path: args.to.clone(), source })?;
    let mut views = Vec::new();
    for run in chosen(args, reader)? {
        if reader.archive_of(run.id)?.is_some() {
            continue;
        }
        let reason = reason_to_keep(args, &run);
        let outcome = if reason.is_some() { Outcome::Kept } else { Outcome::WouldBeArchived };
        let place = reason.is_none().then(|| archive::place(&root, &run));
        views.push(ArchivedView::new(&run, outcome, place, reason));
    }
    Ok(views)
}

/// Takes copied runs out of the journal. Where another program has it open, they are in both places.
fn take_out(
    args: &ArchiveArgs,
    archive: &Archive,
    copied: &[Run],
    views: &mut Vec<ArchivedView>,
) -> Result<(), Failure> {
    if copied.is_empty() {
        return Ok(());
    }
    let store = args.data.store();
    let who = args.operator.name();
    let mut failure = None;
    for run in copied {
        let place = Some(archive.place(run));
        let taken_out = match &store {
            Ok(store) if failure.is_none() => {
                archive.take_out(store, &args.data.dir(), run, who.as_str())
            }
            _ => {
                let reason = Some("its readings are still in the journal too".to_owned());
                views.push(ArchivedView::new(run, Outcome::Copied, place, reason));
                continue;
            }
        };
        match taken_out {
            Ok(is_gone) => {
                let reason = "its folder in the data directory has other files, and stays";
                let reason = (!is_gone).then(|| reason.to_owned());
                views.push(ArchivedView::new(run, Outcome::Archived, place, reason));
            }
            Err(error) => match of_run(run, place, error) {
                Ok(view) => views.push(view),
                Err(error) => failure = Some(Failure::from(error)),
            },
        }
    }
    store?;
    failure.map_or(Ok(()), Err)
}

/// The runs that are named, or all, the latest first.
fn chosen(args: &ArchiveArgs, reader: &Reader) -> Result<Vec<Run>, Failure> {
    if args.runs.is_empty() {
        let is_run = |run: &Run| run.kind == RunKind::Run;
        return Ok(reader
            .runs()?
            .into_iter()
            .filter(is_run)
            .skip(args.keep.unwrap_or(0))
            .collect());
    }
    args.runs.iter().map(|wanted| Ok(reader.find(wanted)?)).collect()
}

/// Why a run stays in the journal, as a fragment.
fn reason_to_keep(args: &ArchiveArgs, run: &Run) -> Option<String> {
    if run.kind != RunKind::Run {
        return Some(format!("a {} is archived with its run, or not at all", run.kind.name()));
    }
    if !run.is_sealed {
        return Some(format!("{} and not sealed: it can be resumed", run.status.describe()));
    }
    let Age(age) = args.older_than?;
    let ended = run.finished_at.as_deref().and_then(|at| at.parse::<Timestamp>().ok());
    let is_old = ended.is_some_and(|ended| Timestamp::now().duration_since(ended) >= age);
    (!is_old).then(|| "it ended later than that".to_owned())
}

fn report(args: &ArchiveArgs, views: &[ArchivedView]) -> Result<(), Failure> {
    if args.output.json {
        return print_json(&views);
    }
    let row = |view: &ArchivedView| {
        let outcome = match view.outcome {
            Outcome::Archived => "archived",
            Outcome::WouldBeArchived => "would be archived",
            Outcome::Copied => "copied",
            Outcome::Kept => "kept",
            Outcome::Refused => "refused",
        };
        let place = view.place.as_ref().map(|place| place.display().to_string());
        let detail: Vec<_> = place.into_iter().chain(view.reason.clone()).collect();
        vec![view.name.clone(), outcome.to_owned(), detail.join("; ")]
    };
    let rows: Vec<_> = views.iter().map(row).collect();
    if rows.is_empty() {
        note("no run to archive");
        return Ok(());
    }
    print(&columns(&["run", "", "where, or why"], &rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, days: Option<i64>) {
        let hours = text.parse::<Age>().ok().map(|Age(age)| age.as_hours());
        assert_eq!(hours, days.map(|days| 24 * days), "{text}");
    }

    #[test]
    fn an_age_is_in_days_or_weeks() {
        check("90d", Some(90));
        check("0d", Some(0));
        check("12w", Some(84));
        check("36500d", Some(36_500));
        for wrong in
            ["", "d", "90", "-1d", "1.5d", "90 d", "3m", "36501d", "99999999w", "4294967295w"]
        {
            check(wrong, None);
        }
    }
}
