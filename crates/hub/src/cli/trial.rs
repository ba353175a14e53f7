//! `rigd-hub trial`: a hub for a first look, in a directory of its own.

use std::path::PathBuf;

use clap::Args;

use super::{Failure, ended, say};
use crate::{
    BenchName, Trial,
    admin::{self, DATABASE},
    connect,
};

#[derive(Debug, Args)]
pub(super) struct TrialArgs {
    /// Directory for the server, which is made and stays
    directory: PathBuf,
    /// LAB/NAME of a bench; may be repeated
    #[arg(long = "bench", default_value = "lab/left")]
    benches: Vec<BenchName>,
}

/// Runs a PostgreSQL until the program is ended.
pub(super) async fn trial(args: TrialArgs) -> Result<(), Failure> {
    std::fs::create_dir_all(&args.directory)?;
    let directory = args.directory.canonicalize()?;
    let trial = Trial::start(&directory, true)?;
    let config = trial.admin(DATABASE);
    admin::init(&config).await?;
    let (client, _task) = connect(&config, None).await?;
    for bench in &args.benches {
        admin::add_bench(&client, bench).await?;
        let [certificate, key, authority] = trial.certify(&bench.to_string())?;
        say(&format!(
            "# In the service file of a daemon:\n[hub]\naddress = \"localhost:{}\"\nbench = \"{bench}\"\n\
             certificate = \"{}\"\nkey = \"{}\"\nauthority = \"{}\"\n",
            trial.port(),
            certificate.display(),
            key.display(),
            authority.display(),
        ))?;
    }
    say(&format!(
        "# For the other commands of rigd-hub:\n--database 'host={} port={} user=postgres dbname={DATABASE}'\n\
         # It runs until it is interrupted.",
        directory.display(),
        trial.port(),
    ))?;
    Ok(ended().await?)
}
