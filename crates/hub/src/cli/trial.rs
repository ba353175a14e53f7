//! `rigd-hub trial`: a hub for a first look, in a directory of its own.

use std::path::PathBuf;

use clap::Args;
use tokio_postgres::Client;

use super::{Failure, ended, live::make_certificates, say};
use crate::{
    BenchName, Trial,
    admin::{self, DATABASE},
    connect,
    live::{self, LiveServer, NatsServer},
};

#[derive(Debug, Args)]
pub(super) struct TrialArgs {
    /// Directory for the server, which is made and stays
    directory: PathBuf,
    /// LAB/NAME of a bench; may be repeated
    #[arg(long = "bench", default_value = "lab/left")]
    benches: Vec<BenchName>,
    /// Run a nats-server too, for live messages
    #[arg(long)]
    live: bool,
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
    }
    let nats = if args.live { Some(start_nats(&trial, &client).await?) } else { None };
    let live = nats.as_ref().map(|(port, _)| format!("live = \"localhost:{port}\"\n"));
    let live = live.unwrap_or_default();
    for bench in &args.benches {
        let [certificate, key, authority] = trial.certify(&bench.to_string())?;
        say(&format!(
            "# In the service file of a daemon:\n[hub]\naddress = \"localhost:{}\"\nbench = \"{bench}\"\n\
             certificate = \"{}\"\nkey = \"{}\"\nauthority = \"{}\"\n{live}",
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

/// A nats-server beside the PostgreSQL, and its port.
async fn start_nats(trial: &Trial, client: &Client) -> Result<(u16, NatsServer), Failure> {
    let (port, certificates) = (NatsServer::free_port()?, trial.certificates());
    make_certificates(&certificates, "localhost")?;
    let server = LiveServer { host: "localhost".to_owned(), port, certificates };
    live::set_up(client, &server).await?;
    let setup = live::setup(client).await?.ok_or(Failure::NoLive)?;
    Ok((port, NatsServer::start(&server.certificates, &setup)?))
}
