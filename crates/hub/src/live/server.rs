//! A nats-server of its own, for a first look and for tests.

use std::{
    fs,
    io::{self, BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    thread,
};

use rustix::process::{Pid, Signal, kill_process};

use super::LiveSetup;
use crate::{TrialError, trial::free_port};

/// Where Debian has the program, which is not in the PATH of every user.
const DEBIAN: &str = "/usr/sbin/nats-server";
/// Starts the server, says its number, and kills it when its own input ends, also where the program that has begun it is
/// killed.
const KEEPER: &str = r#"
"$1" --config "$2" 2>&1 &
echo "process $!"
exec >&-
read -r _
kill -KILL $!
wait
"#;
/// What the server says when it takes connections.
const READY: &str = "Server is ready";

/// A running nats-server. It is killed with the value, and with the program.
#[derive(Debug)]
pub struct NatsServer {
    keeper: Child,
    process: Pid,
}

impl NatsServer {
    /// Starts a server on the port of `setup`, with its configuration and certificates in `directory`.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn start(directory: &Path, setup: &LiveSetup) -> Result<Self, TrialError> {
        Self::with(directory, &setup.text(directory))
    }

    /// Starts a server with this configuration, which is written to `directory`.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn with(directory: &Path, configuration: &str) -> Result<Self, TrialError> {
        let program = program().ok_or(TrialError::NoNats)?;
        let config = directory.join("nats.conf");
        let failed = |path: &Path| {
            let path = path.to_path_buf();
            move |source| TrialError::System { path, source }
        };
        fs::write(&config, configuration).map_err(failed(&config))?;
        let mut keeper = Command::new("sh")
            .arg("-c")
            .arg(KEEPER)
            .arg("sh")
            .args([&program, &config])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(failed(&program))?;
        let mut said = String::new();
        if let Some(stdout) = keeper.stdout.take() {
            let mut lines = BufReader::new(stdout);
            // The two lines come in any order.
            let is_ready = |said: &str| said.contains(READY) && process_in(said).is_some();
            while !is_ready(&said) && lines.read_line(&mut said).map_err(failed(&program))? > 0 {}
            // A server whose output nobody reads stands still.
            thread::spawn(move || io::copy(&mut lines, &mut io::sink()));
        }
        match process_in(&said) {
            Some(process) if said.contains(READY) => Ok(Self { keeper, process }),
            _ => {
                drop(keeper.stdin.take());
                _ = keeper.wait();
                Err(TrialError::Program { program: "nats-server", output: said })
            }
        }
    }

    /// A port of the loopback that nobody has now.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn free_port() -> Result<u16, TrialError> {
        let failed = |source| TrialError::System { path: PathBuf::from("127.0.0.1"), source };
        free_port().map_err(failed)
    }

    /// Makes the server stand still: it takes nothing and says nothing.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn freeze(&self) -> Result<(), TrialError> {
        self.signal(Signal::STOP)
    }

    /// Lets a server that stands still go on.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn thaw(&self) -> Result<(), TrialError> {
        self.signal(Signal::CONT)
    }

    fn signal(&self, signal: Signal) -> Result<(), TrialError> {
        kill_process(self.process, signal).map_err(|error| TrialError::System {
            path: PathBuf::from("nats-server"),
            source: error.into(),
        })
    }
}

impl Drop for NatsServer {
    fn drop(&mut self) {
        // The end of its input ends the keeper, and the keeper the server.
        drop(self.keeper.stdin.take());
        _ = self.keeper.wait();
    }
}

/// The process of the server, once the shell has said it.
fn process_in(said: &str) -> Option<Pid> {
    said.lines().find_map(|line| Pid::from_raw(line.strip_prefix("process ")?.parse().ok()?))
}

/// The program: the first one in PATH, or that of Debian.
fn program() -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let in_path = std::env::split_paths(&path).map(|directory| directory.join("nats-server"));
    in_path.chain([PathBuf::from(DEBIAN)]).find(|program| program.exists())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_that_is_ready_before_its_process_is_named_is_waited_for() {
        let mut said = format!("[7] [INF] {READY}\n");
        assert_eq!(process_in(&said), None);
        said += "process 7\n";
        assert_eq!(process_in(&said), Pid::from_raw(7));
    }
}
