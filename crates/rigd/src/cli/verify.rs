//! `rigd verify`: checks the journal of a run with the checker that shares no code with rigd, and the
//! folder of the run against its manifest. Objects of an object store are checked from their bytes alone.

mod objects;

use std::path::Path;

use rig_record::{Run, RunId, RunKind};
use rig_ship::PublicKey;
use rig_store::{Reader, StoreError};
use rig_verify::{FileFinding, ModelCheck, StatedModel, Verdict};
use serde::Serialize;

use clap::Args;

use super::{
    Failure,
    args::{OutputArgs, RunArg},
    runs::results_of,
    table::{concluded, print, print_json},
};
use crate::run_files;
use objects::Objects;

/// The verdict on the journal of a run and on its folder.
#[derive(Debug, Serialize)]
struct VerifyView {
    #[serde(flatten)]
    verdict: Verdict,
    /// The comparison of χ² of the model behind the stiffness; none for a run whose results have none.
    model: Option<ModelCheck>,
    /// Whether the run has a folder.
    has_folder: bool,
    /// The files of the folder that are not those of its manifest.
    files: Vec<FileFinding>,
    /// The verdict on each amendment of the run that has ended, the oldest first.
    amendments: Vec<Verdict>,
}

#[derive(Debug, Args)]
pub(super) struct VerifyArgs {
    #[command(flatten)]
    run: RunArg,
    /// Objects must be signed by the bench with this public key (`rigd bench-key show`)
    #[arg(long, value_name = "KEY")]
    signed_by: Option<PublicKey>,
    #[command(flatten)]
    output: OutputArgs,
}

pub(super) fn verify(args: &VerifyArgs) -> Result<(), Failure> {
    if let Some(objects) = Objects::named(args.run.text()) {
        return objects.verify(args);
    }
    if args.signed_by.is_some() {
        return Err(Failure::NotSigned);
    }
    let (reader, run) = args.run.find()?;
    let data = &args.run.dir()?;
    let check = |id: RunId| {
        rig_verify::verify(data, &id.to_string())
            .map_err(|source| Failure::Unchecked { data: data.clone(), source })
    };
    let verdict = check(run.id)?;
    let amendments = reader.amendments(run.id)?.into_iter().map(check);
    let amendments = amendments.collect::<Result<Vec<_>, _>>()?;
    let are_sound = verdict.is_sound && amendments.iter().all(|amendment| amendment.is_sound);
    let folder = run_files::folder(data, &run);
    let has_folder = folder.is_dir();
    let files = if has_folder {
        rig_verify::verify_folder(&folder, &verdict.run, &verdict.digest)
            .map_err(|source| Failure::File { path: folder.clone(), source })?
    } else {
        Vec::new()
    };
    let model = stated_model(&reader, &run, are_sound)?
        .map(|stated| rig_verify::verify_model(data, &run.id.to_string(), &stated))
        .transpose()
        .map_err(|source| Failure::Unchecked { data: data.clone(), source })?;
    let is_refuted = model.as_ref().is_some_and(|model| model.is_confirmed == Some(false));
    let is_sound = are_sound && files.is_empty() && !is_refuted;
    let view = VerifyView { verdict, model, has_folder, files, amendments };
    let printed =
        if args.output.json { print_json(&view) } else { print_all(&view, &run, &folder) };
    concluded(printed, if is_sound { Ok(()) } else { Err(Failure::NotSound) })
}

/// The verdict for a person.
fn print_all(view: &VerifyView, run: &Run, folder: &Path) -> Result<(), Failure> {
    let verdicts = [&view.verdict].into_iter().chain(&view.amendments);
    for finding in verdicts.flat_map(|verdict| &verdict.findings) {
        print(&finding.to_string())?;
    }
    for FileFinding { file, what } in &view.files {
        print(&format!("{}: {what}", folder.join(file).display()))?;
    }
    let name = run.short_name();
    for note in &view.verdict.notes {
        print(&format!("{name}: {note}"))?;
    }
    print(&format!("{name}: {}", view.verdict.sentence()))?;
    if let Some(amendments) = amended(&view.amendments) {
        print(&format!("{name}: {amendments}"))?;
    }
    if let Some(model) = &view.model {
        print(&format!("{name}: {}", in_words(model)))?;
    }
    if view.verdict.archived.is_some() && !view.has_folder {
        return Ok(());
    }
    print(&match view.files.len() {
        _ if !view.has_folder => format!("{name}: no folder; `rigd report {name}` writes it"),
        0 => format!("{name}: its folder is the one in the manifest"),
        1 => format!("{name}: 1 file of its folder differs from the manifest"),
        count => format!("{name}: {count} files of its folder differ from the manifest"),
    })
}

/// The amendments of a run in a sentence; `None` without one.
fn amended(amendments: &[Verdict]) -> Option<String> {
    let records: u64 = amendments.iter().map(|amendment| amendment.records).sum();
    let unsound = amendments.iter().filter(|amendment| !amendment.is_sound).count();
    let what = match amendments.len() {
        0 => return None,
        1 => "1 amendment".to_owned(),
        count => format!("{count} amendments"),
    };
    Some(match unsound {
        0 => format!("{what}: sound: {records} records"),
        unsound => format!("{what}: {unsound} not sound, in {records} records"),
    })
}

/// The model that the results of a run state; `None` when they have none, or cannot be read.
///
/// # Errors
/// The journal. Records that cannot be read are findings of the checker, and are no error if it has found some.
fn stated_model(
    reader: &Reader,
    run: &Run,
    are_sound: bool,
) -> Result<Option<StatedModel>, Failure> {
    if run.kind != RunKind::Run {
        return Ok(None);
    }
    let records = reader.archive_of(run.id).and_then(|archived| match archived {
        Some(_) => Ok(None),
        None => reader.amended(run.id).map(Some),
    });
    let records = match records {
        Ok(Some(records)) => records,
        Ok(None) => return Ok(None),
        Err(StoreError::Broken { .. }) if !are_sound => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    let Ok(results) = results_of(run, &records) else { return Ok(None) };
    let stated = results.summary().model.map(|model| StatedModel {
        tangential_ratio: model.tangential_ratio.value,
        arm_mm: model.arm_mm.value,
        is_held_by_stage: model.depth == "stage",
        learnt: [model.tangential_ratio, model.arm_mm]
            .iter()
            .filter(|term| term.sigma.is_some())
            .count(),
        chi2_per_dof: model.chi2_per_dof,
        degrees_of_freedom: model.degrees_of_freedom,
    });
    Ok(stated)
}

fn in_words(model: &ModelCheck) -> String {
    let ModelCheck { is_confirmed, chi2_per_dof, degrees_of_freedom, reason } = model;
    match (is_confirmed, chi2_per_dof, degrees_of_freedom) {
        (Some(true), Some(chi2), Some(degrees)) => {
            format!(
                "χ²/{degrees} = {chi2:.2} of its model is confirmed by an independent beam model"
            )
        }
        (_, Some(chi2), Some(degrees)) => {
            format!("χ²/{degrees} of its model is {chi2:.3} by another beam, unlike its results")
        }
        _ => format!(
            "χ² of its model is not checked: {}",
            reason.as_deref().unwrap_or("it was not computed")
        ),
    }
}
