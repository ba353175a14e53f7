//! The command line. Data goes to stdout, messages go to stderr.

mod live;
mod prune;
mod text;
mod trial;

use std::{
    io::{self, Write},
    net::SocketAddr,
    path::PathBuf,
    process::ExitCode,
};

use clap::{Args, Parser, Subcommand};
use rig_model::with_causes;
use rig_ship::StorageError;
use rig_system::{network::POSTGRESQL, signals::Ending};
use serde::Serialize;
use tokio::{net::TcpListener, task::JoinHandle};
use tokio_postgres::{Client, Config};

use crate::{
    Authority, BenchName, Catalogue, CertificateError, ConnectError, PruneError, TrialError,
    VersionError,
    admin::{self, AdminError, DATABASE},
    connect,
    doctor::{self, Level},
    is_local, judge,
    live::LiveError,
    migrations, state,
};

/// Keeps the records of many rigs in one PostgreSQL.
#[derive(Debug, Parser)]
#[command(name = "rigd-hub", version, max_term_width = 80, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: HubCommand,
}

const EXIT_CODES: &str = "Exit codes: 0 done; 1 the server, a file or a check failed; 2 bad command line; 3 there is no such thing.";

#[derive(Debug, Subcommand)]
enum HubCommand {
    /// Make the database, its roles and certificates, or bring them up to date
    Init(InitArgs),
    /// Add a bench, or take its right to ship away
    Bench {
        #[command(subcommand)]
        command: BenchCommand,
    },
    /// Serve the page of the laboratory: rigs, and runs with search
    Serve(ServeArgs),
    /// Set up live messages by NATS, or watch the rigs
    Live {
        #[command(subcommand)]
        command: live::LiveCommand,
    },
    /// Show what each bench has shipped, and the alarms
    Status(OutputArgs),
    /// Check the hub and advise on each problem
    Doctor(OutputArgs),
    /// Note that an alarm was looked at
    Acknowledge(AcknowledgeArgs),
    /// Take a journal out of quarantine: the copy that connects first goes on
    Release(ReleaseArgs),
    /// Run a PostgreSQL with a hub in a new directory, for a first look
    Trial(trial::TrialArgs),
    /// Make the typed tables again from the records
    Rebuild(DatabaseArgs),
    /// Make the results of sealed runs that have none: stiffness, and whether the model holds
    Judge(DatabaseArgs),
    /// Remove old records whose run is in a verified object
    Prune(prune::PruneArgs),
}

#[derive(Debug, Subcommand)]
enum BenchCommand {
    /// Add a bench, and write its certificate and key
    Add(AddArgs),
    /// End the connections of a bench, and allow no other one; `add` allows it again
    Revoke(RevokeArgs),
}

#[derive(Debug, Args)]
struct DatabaseArgs {
    /// Where the database is, in the words of libpq
    #[arg(long, value_name = "WORDS", default_value_t = format!("host={POSTGRESQL} dbname={DATABASE}"))]
    database: String,
}

#[derive(Debug, Args)]
struct OutputArgs {
    #[command(flatten)]
    database: DatabaseArgs,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct ServeArgs {
    #[command(flatten)]
    database: DatabaseArgs,
    /// Address and port to listen on, of this computer alone
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:8138")]
    listen: SocketAddr,
    /// Another name by which clients may call this computer, as behind a proxy; may be repeated
    #[arg(long, value_name = "NAME")]
    allow_host: Vec<String>,
}

#[derive(Debug, Args)]
struct InitArgs {
    #[command(flatten)]
    database: DatabaseArgs,
    /// Directory for an authority of the hub and the certificate of its server; what is there is kept
    #[arg(long, value_name = "DIR", requires = "host")]
    certificates: Option<PathBuf>,
    /// Name or address by which benches reach the server; may be repeated
    #[arg(long)]
    host: Vec<String>,
}

#[derive(Debug, Args)]
struct AddArgs {
    /// LAB/NAME of the bench
    bench: BenchName,
    #[command(flatten)]
    database: DatabaseArgs,
    /// Directory of the authority, as `init` made it; without it, no certificate is made
    #[arg(long, value_name = "DIR", requires = "out")]
    certificates: Option<PathBuf>,
    /// Directory for `bench.pem`, `bench.key` and `ca.pem`, to be brought to the computer of the bench
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Address of the page of the rig, such as `http://left.lab.example:8137`, to which the page of the laboratory leads
    #[arg(long, value_name = "URL", value_parser = page_address)]
    page: Option<String>,
}

/// An address without a slash at its end.
fn page_address(text: &str) -> Result<String, String> {
    let is_web = text.starts_with("http://") || text.starts_with("https://");
    let is_plain = !text.chars().any(|letter| letter.is_whitespace() || "?#\"'<>".contains(letter));
    if is_web && is_plain {
        Ok(text.trim_end_matches('/').to_owned())
    } else {
        Err("give http://HOST:PORT or https://HOST, without `?` and `#`".to_owned())
    }
}

#[derive(Debug, Args)]
struct RevokeArgs {
    /// LAB/NAME of the bench
    bench: BenchName,
    #[command(flatten)]
    database: DatabaseArgs,
}

#[derive(Debug, Args)]
struct AcknowledgeArgs {
    /// Number of the alarm, as `rigd-hub status` shows it
    alarm: i64,
    /// Who has looked at it
    #[arg(long)]
    who: String,
    #[command(flatten)]
    database: DatabaseArgs,
}

#[derive(Debug, Args)]
struct ReleaseArgs {
    /// Id of the journal
    journal: String,
    #[command(flatten)]
    database: DatabaseArgs,
}

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error(transparent)]
    Admin(#[from] AdminError),
    #[error(transparent)]
    Connect(#[from] ConnectError),
    #[error(transparent)]
    Version(#[from] VersionError),
    #[error(transparent)]
    Certificate(#[from] CertificateError),
    #[error(transparent)]
    Trial(#[from] TrialError),
    #[error("PostgreSQL refuses")]
    Refused(#[from] tokio_postgres::Error),
    /// The words may have a password, so that they are not repeated.
    #[error("`--database`")]
    Words(#[source] tokio_postgres::Error),
    #[error(transparent)]
    Prune(#[from] PruneError),
    #[error(transparent)]
    Storage(#[from] StorageError),
    #[error(transparent)]
    Live(#[from] LiveError),
    /// There is no nats-server.
    #[error("the hub has no live messages: call `rigd-hub live init`")]
    NoLive,
    #[error("runtime or stdout")]
    System(#[from] io::Error),
    #[error("the output cannot be written as JSON")]
    Json(#[from] serde_json::Error),
    /// The page would be open to other computers.
    #[error(
        "{listen} can be reached from other computers, and the page knows no persons: listen on 127.0.0.1, and let a proxy \
         with TLS and passwords stand before it (docs/hub.md)"
    )]
    Open { listen: SocketAddr },
    /// What was found has been listed.
    #[error("problems were found")]
    Found,
}

impl Failure {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Words(_) | Self::Open { .. } => 2,
            Self::NoLive => 3,
            Self::Admin(
                AdminError::NoSuchBench { .. }
                | AdminError::NoSuchViewer { .. }
                | AdminError::NoSuchJournal { .. }
                | AdminError::NoSuchAlarm { .. },
            ) => 3,
            _ => 1,
        }
    }
}

/// Runs the program.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let done = match runtime {
        Ok(runtime) => runtime.block_on(carry_out(cli.command)),
        Err(error) => Err(error.into()),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            if !matches!(failure, Failure::Found) {
                // Nobody can be told of a stderr that is closed.
                _ = writeln!(io::stderr(), "rigd-hub: {}", with_causes(&failure));
            }
            ExitCode::from(failure.exit_code())
        }
    }
}

async fn carry_out(command: HubCommand) -> Result<(), Failure> {
    match command {
        HubCommand::Init(args) => init(args).await,
        HubCommand::Bench { command: BenchCommand::Add(args) } => add(args).await,
        HubCommand::Bench { command: BenchCommand::Revoke(args) } => {
            let (client, _task) = args.database.connect().await?;
            admin::revoke_bench(&client, &args.bench).await?;
            say(&format!("{} may not ship any more", args.bench))
        }
        HubCommand::Serve(args) => serve(args).await,
        HubCommand::Live { command } => live::carry_out(command).await,
        HubCommand::Status(args) => status(&args).await,
        HubCommand::Doctor(args) => doctor(&args).await,
        HubCommand::Acknowledge(args) => {
            let (client, _task) = args.database.connect().await?;
            Ok(admin::acknowledge(&client, args.alarm, &args.who).await?)
        }
        HubCommand::Release(args) => {
            let (mut client, _task) = args.database.connect().await?;
            Ok(admin::release_journal(&mut client, &args.journal).await?)
        }
        HubCommand::Trial(args) => trial::trial(args).await,
        HubCommand::Rebuild(args) => {
            let (client, _task) = args.connect().await?;
            let read = admin::rebuild(&client).await?;
            say(&format!("{read} records read"))
        }
        HubCommand::Judge(args) => {
            let (mut client, _task) = args.connect().await?;
            let judged = judge(&mut client).await?;
            say(&format!("{judged} runs judged"))
        }
        HubCommand::Prune(args) => prune::prune_records(args).await,
    }
}

impl DatabaseArgs {
    fn config(&self) -> Result<Config, Failure> {
        self.database.parse().map_err(Failure::Words)
    }

    /// Connects to a database with the version of this program.
    async fn connect(&self) -> Result<(Client, JoinHandle<()>), Failure> {
        let (client, task) = connect(&self.config()?, None).await?;
        migrations::check(&client).await?;
        Ok((client, task))
    }
}

async fn serve(args: ServeArgs) -> Result<(), Failure> {
    let listen = args.listen;
    if !is_local(listen) {
        return Err(Failure::Open { listen });
    }
    let catalogue = Catalogue::new(args.database.config()?);
    let listener = TcpListener::bind(listen).await?;
    // Programs that wait for the address read it here.
    _ = writeln!(io::stderr(), "rigd-hub: listening on http://{}/", listener.local_addr()?);
    tokio::select! {
        served = crate::serve(listener, catalogue, args.allow_host) => Ok(served?),
        ended = ended() => Ok(ended?),
    }
}

/// Waits until the program is interrupted or terminated.
async fn ended() -> io::Result<()> {
    Ending::listen()?.asked_for().await;
    Ok(())
}

async fn init(args: InitArgs) -> Result<(), Failure> {
    let made = admin::init(&args.database.config()?).await?;
    say(&match made {
        0 => "the database is up to date".to_owned(),
        made => format!("{made} steps of the schema made"),
    })?;
    let Some(directory) = args.certificates else { return Ok(()) };
    let authority = Authority::open_or_make(&directory)?;
    if directory.join("server.pem").exists() {
        return say(&format!("{} is there already", directory.join("server.pem").display()));
    }
    let [certificate, key] = authority.sign_server(args.host, "server")?;
    say(&format!(
        "in postgresql.conf:\nssl = on\nssl_cert_file = '{}'\nssl_key_file = '{}'\nssl_ca_file = '{}'",
        certificate.display(),
        key.display(),
        authority.certificate().display()
    ))
}

async fn add(args: AddArgs) -> Result<(), Failure> {
    let (client, _task) = args.database.connect().await?;
    // The certificate first: its files may be there.
    if let (Some(directory), Some(out)) = (&args.certificates, &args.out) {
        let [certificate, key] =
            Authority::open(directory)?.sign_client(&args.bench.to_string(), out, "bench")?;
        say(&format!("{} and {}", certificate.display(), key.display()))?;
    }
    admin::add_bench(&client, &args.bench).await?;
    if let Some(page) = &args.page {
        admin::set_page(&client, &args.bench, page).await?;
    }
    say(&format!("{} may ship", args.bench))
}

async fn status(args: &OutputArgs) -> Result<(), Failure> {
    let (client, _task) = args.database.connect().await?;
    let mut state = state(&client).await?;
    state.listen(&client).await?;
    if args.json { print_json(&state) } else { say(&text::status(&state)) }
}

async fn doctor(args: &OutputArgs) -> Result<(), Failure> {
    // Doctor tells of another version by itself.
    let (client, _task) = connect(&args.database.config()?, None).await?;
    let findings = doctor::findings(&client).await?;
    if args.json {
        print_json(&findings)?;
    } else {
        let lines: Vec<_> = findings.iter().map(text::finding).collect();
        say(&lines.join("\n"))?;
    }
    if findings.iter().any(|finding| finding.level == Level::Problem) {
        return Err(Failure::Found);
    }
    Ok(())
}

fn print_json(value: &impl Serialize) -> Result<(), Failure> {
    say(&serde_json::to_string(value)?)
}

fn say(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    writeln!(out, "{text}")?;
    Ok(out.flush()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_that_cannot_be_read_are_not_repeated() {
        for words in ["password=secret port=high", "postgres://ada:secret@hub:high/rigd_hub"] {
            let args = DatabaseArgs { database: words.to_owned() };
            let said = with_causes(&args.config().unwrap_err());
            assert!(said.contains("port") && !said.contains("secret"), "{said}");
        }
    }
}
