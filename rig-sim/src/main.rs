//! The `rig-sim` program: a simulated rig that any client can talk to.

use std::{
    io::Write,
    net::SocketAddr,
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::{
    Args, Parser, Subcommand,
    builder::{PossibleValuesParser, TypedValueParser},
};
use rig_files::FileKind;
use rig_model::{AnalyzerMake, DriveMake, with_causes};
use rig_sim::{
    AxisWiring, LineTransport, SimRig, Wiring, scene,
    serve::{Role, Server},
    world::Scene,
};
use rig_system::signals::Ending;

/// A simulated rig: instruments that answer as the real ones do, and a bench behind them.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: CliCommand,
}

#[derive(Debug, Subcommand)]
enum CliCommand {
    /// Opens the ports of a simulated rig and serves them in real time until it is stopped.
    ///
    /// Each port is announced in a line of its own, with device and address. A device without a
    /// requested port gets a pseudo-terminal.
    Serve(Serve),
}

#[derive(Debug, Args)]
struct Serve {
    /// The scene file, such as config/scenes/paper.toml.
    scene: PathBuf,
    /// Decides all that is left to chance, instead of the seed of the scene.
    #[arg(long)]
    seed: Option<u64>,
    /// A sample that is in place from the beginning.
    #[arg(long, value_name = "NAME")]
    sample: Option<String>,

    /// The make of the analyzer.
    #[arg(long, default_value_t = AnalyzerMake::HiokiIm3536,
        value_parser = make_parser(AnalyzerMake::ALL, AnalyzerMake::name))]
    analyzer: AnalyzerMake,
    /// Opens the analyzer's port as a pseudo-terminal, and LINK pointing to it.
    #[cfg(target_os = "linux")]
    #[arg(long, value_name = "LINK")]
    analyzer_pty: Option<PathBuf>,
    /// Opens the analyzer's port on TCP.
    #[arg(long, value_name = "ADDRESS")]
    analyzer_tcp: Option<SocketAddr>,
    /// Opens the analyzer's port as a socket that stands for an instrument on USB. Rig files name it as
    /// `usbtmc = "PATH"`.
    #[cfg(target_os = "linux")]
    #[arg(long, value_name = "PATH")]
    analyzer_usbtmc: Option<PathBuf>,

    /// The make of the drive of the linear stage.
    #[arg(long, default_value_t = DriveMake::OrientalAz,
        value_parser = make_parser(DriveMake::ALL, DriveMake::name))]
    linear: DriveMake,
    /// Millimetres a step of that drive.
    #[arg(long, default_value_t = 0.001)]
    mm_per_step: f64,
    /// The unit id of that drive.
    #[arg(long, default_value_t = 1)]
    linear_unit: u8,
    /// The make of the drive of the rotary stage.
    #[arg(long, default_value_t = DriveMake::OrientalAz,
        value_parser = make_parser(DriveMake::ALL, DriveMake::name))]
    rotary: DriveMake,
    /// Degrees a step of that drive.
    #[arg(long, default_value_t = 0.01)]
    deg_per_step: f64,
    /// The unit id of that drive.
    #[arg(long, default_value_t = 2)]
    rotary_unit: u8,
    /// Rate of the serial line of the drives.
    #[arg(long, default_value_t = 115_200)]
    baud: u32,
    /// Opens the line of the drives as a pseudo-terminal (Modbus RTU), and LINK pointing to it.
    #[cfg(target_os = "linux")]
    #[arg(long, value_name = "LINK")]
    bus_pty: Option<PathBuf>,
    /// Opens the line of the drives on TCP with Modbus TCP frames.
    #[arg(long, value_name = "ADDRESS")]
    bus_tcp: Option<SocketAddr>,
    /// Opens the line of the drives on TCP with Modbus RTU frames, as a serial server passes them.
    #[arg(long, value_name = "ADDRESS")]
    bus_rtu_tcp: Option<SocketAddr>,

    /// Lets the drives answer at once, so that everything else can be timed.
    #[arg(long)]
    instant: bool,

    /// Opens the control connection: lines of text, of which the first to say is `help`.
    #[arg(long, value_name = "ADDRESS")]
    control: Option<SocketAddr>,
}

impl Serve {
    /// Whether the analyzer is served elsewhere than on a pseudo-terminal.
    const fn has_analyzer_port(&self) -> bool {
        #[cfg(target_os = "linux")]
        if self.analyzer_usbtmc.is_some() {
            return true;
        }
        self.analyzer_tcp.is_some()
    }

    /// Whether the drives are served elsewhere than on a pseudo-terminal.
    const fn has_bus_port(&self) -> bool {
        self.bus_tcp.is_some() || self.bus_rtu_tcp.is_some()
    }
}

/// Takes the names of makes that rig files use.
fn make_parser<T: Copy + Send + Sync + 'static, const N: usize>(
    makes: [T; N],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(makes.map(name)).map(move |given| {
        let make = makes.into_iter().find(|make| name(*make) == given);
        make.expect("only these names pass the parser")
    })
}

/// The scene file is wrong, or the command line.
const EXIT_INPUT: u8 = 2;
/// A port cannot be opened.
const EXIT_PORT: u8 = 1;

fn main() -> ExitCode {
    let CliCommand::Serve(args) = Cli::parse().command;
    tracing_subscriber::fmt()
        .with_env_filter(tracing_subscriber::EnvFilter::from_default_env())
        .with_writer(std::io::stderr)
        .init();
    let scene = match load(&args.scene) {
        Ok(scene) => scene,
        Err(message) => return fail(&message, EXIT_INPUT),
    };
    let runtime = match tokio::runtime::Builder::new_current_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(error) => return fail(&error.to_string(), EXIT_PORT),
    };
    match runtime.block_on(serve(&args, scene)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure { message, code }) => fail(&message, code),
    }
}

fn fail(message: &str, code: u8) -> ExitCode {
    // A failed write has no further consequence.
    _ = writeln!(std::io::stderr(), "{message}");
    ExitCode::from(code)
}

/// The reason of an early end of the program.
struct Failure {
    message: String,
    code: u8,
}

impl Failure {
    fn port(error: impl std::error::Error + 'static) -> Self {
        Self { message: with_causes(&error), code: EXIT_PORT }
    }

    fn input(error: impl std::error::Error + 'static) -> Self {
        Self { message: with_causes(&error), code: EXIT_INPUT }
    }
}

fn load(path: &Path) -> Result<Scene, String> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|error| format!("{name}: {error}"))?;
    let text = rig_files::settings::text(&name, &bytes);
    let scene = text.and_then(|text| {
        FileKind::Scene.expect(&name, text)?;
        scene::read(&name, text)
    });
    scene.map_err(|faults| faults.to_string())
}

async fn serve(args: &Serve, scene: Scene) -> Result<(), Failure> {
    // Before the ports are announced, so that no signal is missed.
    let mut ending = Ending::listen().map_err(Failure::port)?;
    let seed = args.seed.unwrap_or(scene.seed);
    let rig = SimRig::start(scene, &wiring(args), seed).map_err(Failure::input)?;
    if let Some(name) = &args.sample {
        rig.technician().place_sample(name).map_err(Failure::input)?;
    }
    if args.instant {
        rig.handle().with(|_, rig| rig.answer_at_once());
    }
    let _server = open_ports(args, &rig).await?;
    ending.asked_for().await;
    Ok(())
}

fn wiring(args: &Serve) -> Wiring {
    Wiring {
        analyzer: args.analyzer,
        linear: AxisWiring::new(args.linear, args.linear_unit, args.mm_per_step),
        rotary: AxisWiring::new(args.rotary, args.rotary_unit, args.deg_per_step),
        transport: LineTransport::Serial { baud: args.baud },
    }
}

/// Opens the requested ports and prints one line for each.
async fn open_ports(args: &Serve, rig: &SimRig) -> Result<Server, Failure> {
    let mut server = Server::new(rig.handle());
    let serial = LineTransport::Serial { baud: args.baud };
    let bus = Role::Bus(serial);
    open_files(args, &mut server, bus)?;
    let listeners = [
        ("analyzer-tcp", Role::Analyzer, args.analyzer_tcp),
        ("bus-tcp", Role::Bus(LineTransport::Tcp), args.bus_tcp),
        ("bus-rtu-tcp", bus, args.bus_rtu_tcp),
    ];
    for (name, role, address) in listeners {
        let Some(address) = address else { continue };
        let address = server.listen(role, address).await.map_err(Failure::port)?;
        announce(name, format_args!("{address}"))?;
    }
    if let Some(address) = args.control {
        let address = server.listen_control(address).await.map_err(Failure::port)?;
        announce("control", format_args!("{address}"))?;
    }
    Ok(server)
}

/// Opens what is a file to clients: the socket that stands for an instrument on USB, and pseudo-terminals.
#[cfg(target_os = "linux")]
fn open_files(args: &Serve, server: &mut Server, bus: Role) -> Result<(), Failure> {
    if let Some(path) = &args.analyzer_usbtmc {
        server.open_usbtmc(path).map_err(Failure::port)?;
        announce("analyzer-usbtmc", format_args!("{}", path.display()))?;
    }
    let ptys = [
        ("analyzer", Role::Analyzer, &args.analyzer_pty, args.has_analyzer_port()),
        ("bus", bus, &args.bus_pty, args.has_bus_port()),
    ];
    for (name, role, link, has_other) in ptys {
        if link.is_none() && has_other {
            continue;
        }
        let path = server.open_pty(role, link.as_deref()).map_err(Failure::port)?;
        match link {
            Some(link) => announce(name, format_args!("{} {}", path.display(), link.display()))?,
            None => announce(name, format_args!("{}", path.display()))?,
        }
    }
    Ok(())
}

/// Each device must have a port of the network here.
#[cfg(not(target_os = "linux"))]
fn open_files(args: &Serve, _: &mut Server, _: Role) -> Result<(), Failure> {
    if args.has_analyzer_port() && args.has_bus_port() {
        return Ok(());
    }
    let message = "rig-sim has pseudo-terminals on Linux alone: give the analyzer --analyzer-tcp 127.0.0.1:0, and the drives \
                   --bus-tcp 127.0.0.1:0 or --bus-rtu-tcp 127.0.0.1:0";
    Err(Failure { message: message.to_owned(), code: EXIT_INPUT })
}

fn announce(name: &str, place: std::fmt::Arguments<'_>) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{name} {place}").and_then(|()| out.flush()).map_err(Failure::port)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_readme_names_every_make_that_can_be_served() {
        let readme = include_str!("../README.md");
        let makes = AnalyzerMake::ALL.iter().map(|make| make.name());
        for make in makes.chain(DriveMake::ALL.iter().map(|make| make.name())) {
            assert!(readme.contains(&format!("`{make}`")), "{make} is not in README.md");
        }
    }

    #[test]
    fn a_file_of_another_kind_is_told_so() {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config");
        let said = load(&config.join("rigs/simulated.toml")).unwrap_err();
        assert!(said.contains("this looks like a rig file, not like a scene file"), "{said}");
        load(&config.join("scenes/paper.toml")).unwrap();
    }
}
