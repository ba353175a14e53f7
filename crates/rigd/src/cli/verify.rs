//! `rigd verify`: checks the journal of a run with the checker that shares no code with rigd, and the
//! folder of the run against its manifest.

use rig_verify::{FileFinding, Verdict};
use serde::Serialize;

use clap::Args;

use super::{
    Failure,
    args::{OutputArgs, RunArg},
    table::{print, print_json},
};
use crate::run_files;

/// The verdict on the journal of a run and on its folder.
#[derive(Debug, Serialize)]
struct VerifyView {
    #[serde(flatten)]
    verdict: Verdict,
    /// Whether the run has a folder.
    has_folder: bool,
    /// The files of the folder that are not those of its manifest.
    files: Vec<FileFinding>,
}

#[derive(Debug, Args)]
pub(super) struct VerifyArgs {
    #[command(flatten)]
    run: RunArg,
    #[command(flatten)]
    output: OutputArgs,
}

pub(super) fn verify(args: &VerifyArgs) -> Result<(), Failure> {
    let (_, run) = args.run.find()?;
    let data = &args.run.data.data;
    let verdict = rig_verify::verify(data, &run.id.to_string())
        .map_err(|source| Failure::Unchecked { data: data.clone(), source })?;
    let folder = run_files::folder(data, &run);
    let has_folder = folder.is_dir();
    let files = if has_folder {
        rig_verify::verify_folder(&folder, &verdict.run, &verdict.digest)
            .map_err(|source| Failure::File { path: folder.clone(), source })?
    } else {
        Vec::new()
    };
    let is_sound = verdict.is_sound && files.is_empty();
    let view = VerifyView { verdict, has_folder, files };
    if args.output.json {
        print_json(&view)?;
    } else {
        for finding in &view.verdict.findings {
            print(&finding.to_string())?;
        }
        for FileFinding { file, what } in &view.files {
            print(&format!("{}: {what}", folder.join(file).display()))?;
        }
        let name = run.short_name();
        print(&format!("{name}: {}", view.verdict.sentence()))?;
        print(&match view.files.len() {
            _ if !has_folder => format!("{name}: no folder; `rigd report {name}` writes it"),
            0 => format!("{name}: its folder is the one in the manifest"),
            1 => format!("{name}: 1 file of its folder differs from the manifest"),
            count => format!("{name}: {count} files of its folder differ from the manifest"),
        })?;
    }
    if is_sound { Ok(()) } else { Err(Failure::NotSound) }
}
