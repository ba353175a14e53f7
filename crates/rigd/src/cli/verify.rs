//! `rigd verify`: checks the journal of a run with the checker that shares no code with rigd.

use clap::Args;

use super::{
    Failure,
    args::{OutputArgs, RunArg},
    table::{print, print_json},
};

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
    if args.output.json {
        print_json(&verdict)?;
    } else {
        for finding in &verdict.findings {
            print(&finding.to_string())?;
        }
        print(&format!("{}: {}", run.short_name(), verdict.sentence()))?;
    }
    if verdict.is_sound { Ok(()) } else { Err(Failure::NotSound) }
}
