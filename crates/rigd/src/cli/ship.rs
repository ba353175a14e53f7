//! `rigd ship`: puts sealed runs in an object store, each as one Parquet file.

use std::{path::PathBuf, rc::Rc};

use clap::Args;
use rig_model::with_causes;
use rig_ship::{Address, BenchKey, Label, ObjectStore, Outcome, ShipError, Shipper};
use rig_store::{Reader, Run, StoreError};
use serde::Serialize;

use super::{
    Failure,
    args::{DataArgs, OutputArgs},
    table::{columns, note, print, print_json},
};
use crate::archive;

#[derive(Debug, Args)]
pub(super) struct ShipArgs {
    /// Object store: `folder:DIR`, which is made if it is missing, or `s3://BUCKET/PREFIX`
    to: Address,
    /// Runs to ship: names such as `smoke-7`, or ids; without them, everything that is sealed
    runs: Vec<String>,
    /// Name of the laboratory in the names of objects
    #[arg(long, default_value = "lab")]
    lab: Label,
    /// Name of the bench in the names of objects [default: its id in the journal]
    #[arg(long)]
    bench: Option<Label>,
    /// Sign seals with the key of the bench in this file (`rigd bench-key new`). An object that is there already stays as it
    /// is, signed or not
    #[arg(long, value_name = "FILE")]
    sign: Option<PathBuf>,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// What is done with a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Word {
    /// It was put in the store.
    Shipped,
    /// It was there already.
    Present,
    /// It is not sealed, or its readings are in an archive.
    Kept,
    /// The store has this run with other records.
    Clash,
    /// It, or its object, is damaged.
    Refused,
    /// The system, or the store, did not let it be shipped this time.
    Failed,
}

impl Word {
    const fn name(self) -> &'static str {
        match self {
            Self::Shipped => "shipped",
            Self::Present => "present",
            Self::Kept => "kept",
            Self::Clash => "clash",
            Self::Refused => "refused",
            Self::Failed => "failed",
        }
    }
}

/// A run, for a program.
#[derive(Debug, Serialize)]
struct ShippedView {
    run_id: String,
    kind: &'static str,
    name: String,
    outcome: Word,
    /// Name of its object.
    #[serde(skip_serializing_if = "Option::is_none")]
    object: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
}

/// One run that fails keeps back no other: at the next call it would be the same. After this many in a row the store, or the
/// way to it, is taken for what fails.
const FAILURES_MAX: usize = 3;

pub(super) fn ship(args: &ShipArgs) -> Result<(), Failure> {
    let key = args.sign.as_deref().map(BenchKey::read).transpose()?;
    let store = ObjectStore::at(args.to.clone())?;
    let shipper = Shipper::new(store, args.lab.clone(), args.bench.clone(), key);
    let mut views = Vec::new();
    let (mut failure, mut in_a_row) = (None, 0);
    for (reader, run) in sources(args)? {
        let (view, error) = shipped(&shipper, &reader, &run);
        views.push(view);
        in_a_row = if error.is_some() { in_a_row + 1 } else { 0 };
        failure = failure.or(error);
        if in_a_row == FAILURES_MAX {
            break;
        }
    }
    report(args, &views)?;
    if let Some(failure) = failure {
        return Err(failure);
    }
    if views.iter().any(|view| matches!(view.outcome, Word::Clash | Word::Refused)) {
        return Err(Failure::NotSound);
    }
    Ok(())
}

/// The runs to ship, oldest first, each with what reads its journal.
fn sources(args: &ShipArgs) -> Result<Vec<(Rc<Reader>, Run)>, Failure> {
    if !args.runs.is_empty() {
        let find = |wanted: &String| {
            let (reader, run) = args.data.find(wanted)?;
            Ok((reader.into(), run))
        };
        return args.runs.iter().map(find).collect();
    }
    let data = args.data.dir();
    let directories = if archive::is_archive(&data) {
        archive::objects(&data)?.into_iter().rev().map(|object| object.place).collect()
    } else {
        vec![data]
    };
    let mut all = Vec::new();
    for data in directories {
        let reader = Reader::open(&data).map_err(|source| Failure::Data { data, source })?;
        let reader = Rc::new(reader);
        let runs = reader.runs()?.into_iter().rev().filter(|run| run.is_sealed);
        all.extend(runs.map(|run| (Rc::clone(&reader), run)));
    }
    Ok(all)
}

/// What became of a run, and why it could not be shipped this time.
fn shipped(shipper: &Shipper, reader: &Reader, run: &Run) -> (ShippedView, Option<Failure>) {
    let mut failure = None;
    let (outcome, object, reason) = match shipper.ship(reader, run) {
        Ok(Outcome::Shipped { object }) => (Word::Shipped, Some(object), None),
        Ok(Outcome::Present { object }) => (Word::Present, Some(object), None),
        Ok(Outcome::Clash { object }) => {
            let reason = "the store has this run with other records; keep both, and look how one id came to two runs: \
                          a copied or restored data directory that went on gives one";
            (Word::Clash, Some(object), Some(reason.to_owned()))
        }
        Err(
            error @ ShipError::Store(StoreError::Archived { .. } | StoreError::NotSealed { .. }),
        ) => (Word::Kept, None, Some(with_causes(&error))),
        Err(error) if error.is_of_run() => (Word::Refused, None, Some(with_causes(&error))),
        Err(error) => {
            let reason = with_causes(&error);
            failure = Some(error.into());
            (Word::Failed, None, Some(reason))
        }
    };
    let (run_id, kind, name) = (run.id.to_string(), run.kind.name(), run.short_name());
    (ShippedView { run_id, kind, name, outcome, object, reason }, failure)
}

fn report(args: &ShipArgs, views: &[ShippedView]) -> Result<(), Failure> {
    if args.output.json {
        return print_json(&views);
    }
    // Those that were there before are only counted: they may be thousands.
    let is_told = |view: &&ShippedView| view.outcome != Word::Present;
    let row = |view: &ShippedView| {
        let detail: Vec<_> = view.object.iter().chain(&view.reason).cloned().collect();
        vec![view.name.clone(), view.outcome.name().to_owned(), detail.join("; ")]
    };
    let rows: Vec<_> = views.iter().filter(is_told).map(row).collect();
    if !rows.is_empty() {
        print(&columns(&["run", "", "object, or why"], &rows))?;
    }
    let count = |word| views.iter().filter(|view| view.outcome == word).count();
    let (shipped, present) = (count(Word::Shipped), count(Word::Present));
    note(&format!("{}: {shipped} shipped, {present} there already", args.to));
    Ok(())
}
