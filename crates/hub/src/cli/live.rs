//! `rigd-hub live`: messages of NATS for many viewers.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::{DatabaseArgs, Failure, say};
use crate::{
    Authority, BenchName, CertificateError,
    live::{self, Broker, HUB_NAME, LiveServer, LiveSetup, Scope, Watch, viewer_name},
};

/// Files of the nats-server and of the hub as a viewer, in the directory of the authority.
const SERVER_STEM: &str = "nats";
const HUB_STEM: &str = "live";
const VIEWER_STEM: &str = "viewer";

#[derive(Debug, Subcommand)]
pub(super) enum LiveCommand {
    /// Say where the nats-server is, and make its certificate
    Init(InitArgs),
    /// Print the configuration of the nats-server: its accounts, benches and viewers
    Config(ConfigArgs),
    /// Add a viewer of a laboratory and write its certificate and key, or remove it
    Viewer {
        #[command(subcommand)]
        command: ViewerCommand,
    },
    /// Print each message as a line of JSON, until interrupted
    Watch(WatchArgs),
}

#[derive(Debug, Subcommand)]
pub(super) enum ViewerCommand {
    /// Add a viewer
    Add(ViewerAddArgs),
    /// Remove a viewer
    Remove(ViewerRemoveArgs),
}

#[derive(Debug, Args)]
pub(super) struct InitArgs {
    /// Host and port by which benches and viewers reach the nats-server
    #[arg(long, value_name = "HOST:PORT", value_parser = host_and_port)]
    address: (String, u16),
    /// Directory of the authority, as `rigd-hub init` made it
    #[arg(long, value_name = "DIR")]
    certificates: PathBuf,
    #[command(flatten)]
    database: DatabaseArgs,
}

#[derive(Debug, Args)]
pub(super) struct ConfigArgs {
    /// Directory in which the nats-server finds `nats.pem`, `nats.key` and `ca.pem`
    #[arg(long, value_name = "DIR", default_value = "/etc/rigd-hub-live")]
    files: PathBuf,
    #[command(flatten)]
    database: DatabaseArgs,
}

#[derive(Debug, Args)]
pub(super) struct ViewerAddArgs {
    /// LAB/NAME of the viewer
    viewer: BenchName,
    /// Directory of the authority, as `rigd-hub init` made it
    #[arg(long, value_name = "DIR")]
    certificates: PathBuf,
    /// Directory for `viewer.pem`, `viewer.key` and `ca.pem`, to be brought to the computer of the viewer
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    database: DatabaseArgs,
}

#[derive(Debug, Args)]
pub(super) struct ViewerRemoveArgs {
    /// LAB/NAME of the viewer
    viewer: BenchName,
    #[command(flatten)]
    database: DatabaseArgs,
}

#[derive(Debug, Args)]
pub(super) struct WatchArgs {
    /// LAB or LAB/BENCH; without it all, which the hub itself may see
    scope: Option<Scope>,
    /// States alone, without the records of the rigs
    #[arg(long)]
    states: bool,
    /// End after this many messages
    #[arg(long, value_name = "NUMBER")]
    count: Option<u64>,
    /// Watch from another computer: host and port of the nats-server
    #[arg(long, value_name = "HOST:PORT", value_parser = host_and_port, requires_all = ["files", "scope"])]
    address: Option<(String, u16)>,
    /// Directory with `viewer.pem`, `viewer.key` and `ca.pem`
    #[arg(long, value_name = "DIR", requires = "address")]
    files: Option<PathBuf>,
    #[command(flatten)]
    database: DatabaseArgs,
}

/// A host, or an address in brackets, and a port.
fn host_and_port(text: &str) -> Result<(String, u16), String> {
    let parts = text.rsplit_once(':').and_then(|(host, port)| {
        let host = host.strip_prefix('[').map_or(host, |host| host.trim_end_matches(']'));
        Some((host, port.parse::<u16>().ok()?))
    });
    match parts {
        Some((host, port)) if !host.is_empty() && port > 0 => Ok((host.to_owned(), port)),
        _ => Err("give HOST:PORT, such as hub.lab.example:4222".to_owned()),
    }
}

pub(super) async fn carry_out(command: LiveCommand) -> Result<(), Failure> {
    match command {
        LiveCommand::Init(args) => init(args).await,
        LiveCommand::Config(args) => {
            let text = setup(&args.database).await?.text(&args.files);
            say(text.trim_end())
        }
        LiveCommand::Viewer { command: ViewerCommand::Add(args) } => {
            let (client, _task) = args.database.connect().await?;
            let authority = Authority::open(&args.certificates)?;
            let name = viewer_name(&args.viewer);
            let [certificate, key] = authority.sign_client(&name, &args.out, VIEWER_STEM)?;
            live::add_viewer(&client, &args.viewer).await?;
            say(&format!("{} and {}", certificate.display(), key.display()))?;
            say(&format!(
                "{} may watch once the nats-server has its new configuration",
                args.viewer
            ))
        }
        LiveCommand::Viewer { command: ViewerCommand::Remove(args) } => {
            let (client, _task) = args.database.connect().await?;
            live::remove_viewer(&client, &args.viewer).await?;
            say(&format!(
                "{} may not watch any more once the nats-server has its new configuration",
                args.viewer
            ))
        }
        LiveCommand::Watch(args) => watch(args).await,
    }
}

async fn init(args: InitArgs) -> Result<(), Failure> {
    let (client, _task) = args.database.connect().await?;
    let (host, port) = args.address;
    let certificates = std::path::absolute(&args.certificates)?;
    let (made, of_server) =
        (make_certificates(&certificates, &host)?, certificates.join(format!("{SERVER_STEM}.pem")));
    for path in &made {
        say(&path.display().to_string())?;
    }
    if !made.contains(&of_server) {
        say(&format!(
            "{} is there already: if it is not for {host}, remove it with its key, and call this again",
            of_server.display()
        ))?;
    }
    live::set_up(&client, &LiveServer { host, port, certificates }).await?;
    say("the configuration of the nats-server is that of `rigd-hub live config`")
}

/// Makes the certificates of the nats-server and of the hub as a viewer, where they are missing.
pub(super) fn make_certificates(
    directory: &Path,
    host: &str,
) -> Result<Vec<PathBuf>, CertificateError> {
    let authority = Authority::open(directory)?;
    let mut made = Vec::new();
    if !directory.join(format!("{SERVER_STEM}.pem")).exists() {
        made.extend(authority.sign_server(vec![host.to_owned()], SERVER_STEM)?);
    }
    if !directory.join(format!("{HUB_STEM}.pem")).exists() {
        made.extend(authority.sign_client(HUB_NAME, directory, HUB_STEM)?);
    }
    Ok(made)
}

async fn setup(database: &DatabaseArgs) -> Result<LiveSetup, Failure> {
    let (client, _task) = database.connect().await?;
    live::setup(&client).await?.ok_or(Failure::NoLive)
}

async fn watch(args: WatchArgs) -> Result<(), Failure> {
    let broker = match (&args.address, &args.files) {
        (Some((host, port)), Some(files)) => {
            let names = ["viewer.pem", "viewer.key", "ca.pem"];
            Broker::new((host, *port), names.map(|name| files.join(name)))
        }
        _ => setup(&args.database).await?.server.broker(),
    };
    let scope = args.scope.unwrap_or(Scope::All);
    let mut watch = Watch::open(&broker, &scope).await?;
    let mut left = args.count.unwrap_or(u64::MAX);
    while left > 0 {
        let heard = watch.next().await?;
        if args.states && heard.kind.is_some() {
            continue;
        }
        let kind = heard.kind.as_deref().unwrap_or("state");
        // A line break of JSON is between its words, never in them.
        let document = heard.document.replace(['\n', '\r'], " ");
        say(&format!(r#"{{"bench":"{}","kind":"{kind}","message":{document}}}"#, heard.bench))?;
        left -= 1;
    }
    Ok(())
}
