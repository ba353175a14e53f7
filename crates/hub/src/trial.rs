//! A PostgreSQL of its own in a directory, for a first look and for tests.

use std::{
    fs,
    io::{self, BufRead, BufReader, Write},
    net::TcpListener,
    os::unix::{fs::chown, process::CommandExt},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
};

use tokio_postgres::Config;

use crate::{Authority, CertificateError, Identity, TlsError};

/// Where Debian has the programs of each version.
const DEBIAN: &str = "/usr/lib/postgresql";
/// Users as whom PostgreSQL may run where root starts it: it refuses to run as root.
const USERS: [&str; 2] = ["postgres", "nobody"];
/// Starts the server, says so, waits until its input ends, and stops the server. It goes on where the program that has
/// begun it is killed.
const KEEPER: &str = r#"
"$1/pg_ctl" --pgdata "$2/data" --log "$2/log" --wait start > "$2/start.log" 2>&1 && echo ready || echo failed
read -r _
"$1/pg_ctl" --pgdata "$2/data" --mode immediate stop > /dev/null 2>&1
[ "$3" = keep ] || rm -rf -- "$2"
"#;

/// Why there is no server.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// PostgreSQL is not installed.
    #[error(
        "there is no `initdb` in PATH or below {DEBIAN}: install the Debian package `postgresql`"
    )]
    NotInstalled,
    /// The nats-server is not installed.
    #[error(
        "there is no `nats-server` in PATH or /usr/sbin: install the Debian package `nats-server`"
    )]
    NoNats,
    /// There is no user as whom it can run.
    #[error("PostgreSQL does not run as root, and there is no user `postgres` or `nobody`")]
    NoUser,
    /// A file or a program of the system.
    #[error("{}", path.display())]
    System {
        /// The file or the program.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// A program of PostgreSQL failed.
    #[error("{program} failed: {output}")]
    Program {
        /// Name of the program.
        program: &'static str,
        /// What it has written.
        output: String,
    },
    /// The certificates.
    #[error(transparent)]
    Certificate(#[from] CertificateError),
    /// The certificate of a bench.
    #[error(transparent)]
    Tls(#[from] TlsError),
}

/// A running PostgreSQL. It stops with the value, and with the program.
#[derive(Debug)]
pub struct Trial {
    directory: PathBuf,
    programs: PathBuf,
    user: Option<[u32; 2]>,
    port: u16,
    keep: bool,
    keeper: Child,
}

impl Trial {
    /// Makes a server in `directory`, which must not have one, and starts it. With `keep`, the directory stays.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn start(directory: &Path, keep: bool) -> Result<Self, TrialError> {
        let programs = programs().ok_or(TrialError::NotInstalled)?;
        let user = if rustix::process::geteuid().is_root() { Some(unprivileged()?) } else { None };
        let port = free_port().map_err(|source| system(Path::new("127.0.0.1"), source))?;
        let certificates = directory.join("certificates");
        let authority = Authority::open_or_make(&certificates)?;
        authority.sign_server(vec!["localhost".to_owned(), "127.0.0.1".to_owned()], "server")?;
        if let Some([uid, gid]) = user {
            for path in
                [directory.to_path_buf(), certificates.clone(), certificates.join("server.key")]
            {
                chown(&path, Some(uid), Some(gid)).map_err(|source| system(&path, source))?;
            }
        }
        let data = directory.join("data");
        let mut initdb = as_user(&programs.join("initdb"), user);
        initdb.args([
            "--username",
            "postgres",
            "--auth",
            "trust",
            "--encoding",
            "UTF8",
            "--locale",
            "C",
        ]);
        initdb.arg("--no-sync").arg("--pgdata").arg(&data);
        run(&mut initdb, "initdb")?;
        let settings = settings(directory, &certificates, port);
        append(&data.join("postgresql.conf"), &settings)?;
        let rules = data.join("pg_hba.conf");
        fs::write(&rules, RULES).map_err(|source| system(&rules, source))?;
        let keeper = keeper(&programs, directory, user, keep)?;
        Ok(Self { directory: directory.to_path_buf(), programs, user, port, keep, keeper })
    }

    /// How its superuser reaches this database.
    pub fn admin(&self, database: &str) -> Config {
        let mut config = Config::new();
        config.host_path(&self.directory).port(self.port).user("postgres").dbname(database);
        config
    }

    /// How a role reaches this database over the network.
    pub fn bench(&self, role: &str, database: &str) -> Config {
        let mut config = Config::new();
        config.host("localhost").port(self.port).user(role).dbname(database);
        config
    }

    /// A new certificate for this role, its key, and the certificate of the authority.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn certify(&self, role: &str) -> Result<[PathBuf; 3], TrialError> {
        let mut out = self.directory.clone();
        for part in ["benches"].into_iter().chain(role.split('/')) {
            out.push(part);
            fs::create_dir_all(&out).map_err(|source| system(&out, source))?;
            // The owner of a directory may remove what is in it.
            give(&out, self.user)?;
        }
        let authority = Authority::open(&self.directory.join("certificates"))?;
        let [certificate, key] = authority.sign_client(role, &out, "bench")?;
        Ok([certificate, key, authority.certificate()])
    }

    /// Makes the certificate of a role, and reads it with its key and that of the authority.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn identity(&self, role: &str) -> Result<Identity, TrialError> {
        let [certificate, key, authority] = self.certify(role)?;
        Ok(Identity::read(&certificate, &key, &authority)?)
    }

    /// The directory of the database.
    pub fn data(&self) -> PathBuf {
        self.directory.join("data")
    }

    /// The directory of the authority.
    pub fn certificates(&self) -> PathBuf {
        self.directory.join("certificates")
    }

    /// Port on the loopback.
    pub const fn port(&self) -> u16 {
        self.port
    }

    /// Ends the server as a crash does, and starts it again: what was not committed is gone.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn crash(&self) -> Result<(), TrialError> {
        self.stop()?;
        self.go_on()
    }

    /// Ends the server as a crash does.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn stop(&self) -> Result<(), TrialError> {
        let mut stop = as_user(&self.programs.join("pg_ctl"), self.user);
        stop.arg("--pgdata").arg(self.directory.join("data")).args(["--mode", "immediate", "stop"]);
        run(&mut stop, "pg_ctl")
    }

    /// Starts the server again.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn go_on(&self) -> Result<(), TrialError> {
        let mut start = as_user(&self.programs.join("pg_ctl"), self.user);
        start.arg("--pgdata").arg(self.directory.join("data"));
        start.arg("--log").arg(self.directory.join("log")).args(["--wait", "start"]);
        start.stdout(Stdio::null()).stderr(Stdio::null());
        let status = start.status().map_err(|source| system(&self.programs, source))?;
        if status.success() { Ok(()) } else { Err(self.failed()) }
    }

    fn failed(&self) -> TrialError {
        let log = |name| fs::read_to_string(self.directory.join(name)).unwrap_or_default();
        TrialError::Program { program: "pg_ctl", output: log("start.log") + &log("log") }
    }
}

impl Drop for Trial {
    fn drop(&mut self) {
        // The end of its input ends the keeper, and the keeper the server.
        drop(self.keeper.stdin.take());
        _ = self.keeper.wait();
        if !self.keep {
            // Files of this program's user, which the keeper could not remove.
            _ = fs::remove_dir_all(&self.directory);
        }
    }
}

/// Who may connect, and how.
const RULES: &str = "\
local   all all                             trust
hostssl all +rigd_hub_bench 127.0.0.1/32    cert
hostssl all +rigd_hub_bench ::1/128         cert
";

fn settings(directory: &Path, certificates: &Path, port: u16) -> String {
    let quoted = |path: &Path| path.display().to_string().replace('\'', "''");
    format!(
        // Who comes by the socket is trusted, whatever role is asked for.
        "listen_addresses = 'localhost'\nport = {port}\nunix_socket_directories = '{}'\n\
         unix_socket_permissions = 0700\nssl = on\n\
         ssl_cert_file = '{}'\nssl_key_file = '{}'\nssl_ca_file = '{}'\n",
        quoted(directory),
        quoted(&certificates.join("server.pem")),
        quoted(&certificates.join("server.key")),
        quoted(&certificates.join("ca.pem")),
    )
}

fn keeper(
    programs: &Path,
    directory: &Path,
    user: Option<[u32; 2]>,
    keep: bool,
) -> Result<Child, TrialError> {
    let failed = |source| system(Path::new("sh"), source);
    let mut keeper = as_user(Path::new("sh"), user);
    keeper.arg("-c").arg(KEEPER).arg("sh").arg(programs).arg(directory);
    keeper.arg(if keep { "keep" } else { "remove" });
    let mut keeper = keeper.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().map_err(failed)?;
    let mut line = String::new();
    if let Some(said) = keeper.stdout.take() {
        BufReader::new(said).read_line(&mut line).map_err(failed)?;
    }
    if line.trim() == "ready" {
        return Ok(keeper);
    }
    let log = |name| fs::read_to_string(directory.join(name)).unwrap_or_default();
    let output = log("start.log") + &log("log");
    drop(keeper.stdin.take());
    _ = keeper.wait();
    Err(TrialError::Program { program: "pg_ctl", output })
}

/// Makes a file or a directory that of the user as whom PostgreSQL runs.
fn give(path: &Path, user: Option<[u32; 2]>) -> Result<(), TrialError> {
    let Some([uid, gid]) = user else { return Ok(()) };
    chown(path, Some(uid), Some(gid)).map_err(|source| system(path, source))
}

/// A command in the root directory, which every user can enter.
fn as_user(program: &Path, user: Option<[u32; 2]>) -> Command {
    let mut command = Command::new(program);
    command.current_dir("/");
    if let Some([uid, gid]) = user {
        command.uid(uid).gid(gid);
    }
    command
}

fn run(command: &mut Command, program: &'static str) -> Result<(), TrialError> {
    let output = command.output().map_err(|source| system(Path::new(program), source))?;
    if output.status.success() {
        return Ok(());
    }
    let output = String::from_utf8_lossy(&output.stderr).into_owned();
    Err(TrialError::Program { program, output })
}

/// The directory of `initdb`: the first one in PATH, or the newest of Debian.
fn programs() -> Option<PathBuf> {
    let has_initdb = |directory: &PathBuf| directory.join("initdb").exists();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let in_path = std::env::split_paths(&path).find(has_initdb);
    let version = |path: &PathBuf| {
        path.file_name().and_then(|name| name.to_str()?.parse::<u32>().ok()).unwrap_or(0)
    };
    let mut versions: Vec<_> =
        fs::read_dir(DEBIAN).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    versions.sort_by_key(version);
    let of_debian = versions.into_iter().rev().map(|path| path.join("bin")).find(has_initdb);
    of_debian.or(in_path)
}

/// User and group as whom PostgreSQL may run.
fn unprivileged() -> Result<[u32; 2], TrialError> {
    let path = Path::new("/etc/passwd");
    let users = fs::read_to_string(path).map_err(|source| system(path, source))?;
    let ids = |wanted: &&str| {
        let line = users.lines().find(|line| line.split(':').next() == Some(*wanted))?;
        let mut fields = line.split(':').skip(2).map(str::parse);
        Some([fields.next()?.ok()?, fields.next()?.ok()?])
    };
    USERS.iter().find_map(ids).ok_or(TrialError::NoUser)
}

/// A port of the loopback that nobody has now.
pub(crate) fn free_port() -> io::Result<u16> {
    Ok(TcpListener::bind("127.0.0.1:0")?.local_addr()?.port())
}

fn append(path: &Path, text: &str) -> Result<(), TrialError> {
    let write = || {
        let mut file = fs::OpenOptions::new().append(true).open(path)?;
        file.write_all(text.as_bytes())
    };
    write().map_err(|source| system(path, source))
}

fn system(path: &Path, source: io::Error) -> TrialError {
    TrialError::System { path: path.to_path_buf(), source }
}
