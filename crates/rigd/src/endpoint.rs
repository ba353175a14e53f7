//! The file in a data directory by which commands find the daemon that serves it.
//!
//! The daemon holds a lock on the file for as long as it runs. Without that lock its content is what a
//! killed daemon left, and counts for nothing.

use std::{
    fs::{self, File, TryLockError},
    io::{self, Read, Seek, SeekFrom, Write},
    net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr},
    path::{Path, PathBuf},
};

use rig_system::files::{
    forbidden_mode, lock_to_hold, lock_to_try, set_mode, whole_path, with_mode,
};
use serde::{Deserialize, Serialize};

use crate::tokens::Secret;

const FILE: &str = "daemon.json";
/// The owner alone may read and write it: its content decides where clients send the token.
const MODE: u32 = 0o600;
/// Writing by the group or by others.
const MODE_FORBIDDEN: u32 = 0o022;
/// An address and a path fit in this, bytes.
const SIZE_MAX: u64 = 16 << 10;

/// How to reach a daemon.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Endpoint {
    /// Address on which a client of this computer reaches it.
    pub(crate) address: SocketAddr,
    /// The file with the token that it asks for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) token_file: Option<PathBuf>,
    /// The secret for commands on this computer, made again at each start of the daemon.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) secret: Option<String>,
}

/// Keeps the file for the time of the daemon, and removes it at the end.
#[derive(Debug)]
pub(crate) struct Announced {
    path: PathBuf,
    _lock: File,
}

/// Why no daemon was found.
#[derive(Debug, thiserror::Error)]
pub(crate) enum EndpointError {
    /// No daemon holds the file.
    #[error("no daemon serves the data directory {}", data.display())]
    None {
        /// The data directory.
        data: PathBuf,
    },
    /// The file cannot be read.
    #[error("{}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// The error of the system, or of its content.
        source: io::Error,
    },
    /// Other users could have changed it.
    #[error(
        "{} has mode {mode:03o}: other users could have written another address into it; restart \
         the daemon",
        path.display()
    )]
    Open {
        /// Path of the file.
        path: PathBuf,
        /// Permission bits of the file.
        mode: u32,
    },
}

impl Endpoint {
    /// The daemon that listens on `listening`. An address that stands for all of them is reached over
    /// the loopback.
    pub(crate) fn of(
        listening: SocketAddr,
        token_file: Option<&Path>,
        secret: Option<&Secret>,
    ) -> io::Result<Self> {
        let ip = match listening.ip() {
            IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
            IpAddr::V6(ip) if ip.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
            ip => ip,
        };
        let token_file = token_file.map(whole_path).transpose()?;
        let secret = secret.map(|secret| secret.reveal().to_owned());
        Ok(Self { address: SocketAddr::new(ip, listening.port()), token_file, secret })
    }

    /// Writes the file of a data directory that this program has open.
    pub(crate) fn announce(&self, data: &Path) -> io::Result<Announced> {
        let path = data.join(FILE);
        let mut options = File::options();
        let options = with_mode(options.create(true).truncate(false).read(true).write(true), MODE);
        let mut file = options.open(&path)?;
        let lock = lock_to_hold(&file, &path)?;
        lock.lock()?;
        set_mode(&file, MODE)?;
        file.set_len(0)?;
        file.seek(SeekFrom::Start(0))?;
        file.write_all(&serde_json::to_vec(self)?)?;
        Ok(Announced { path, _lock: lock })
    }

    /// Finds the daemon that serves a data directory.
    pub(crate) fn find(data: &Path) -> Result<Self, EndpointError> {
        let path = data.join(FILE);
        let none = || EndpointError::None { data: data.to_path_buf() };
        let failed = |source: io::Error| match source.kind() {
            io::ErrorKind::NotFound => none(),
            _ => EndpointError::File { path: path.clone(), source },
        };
        let file = File::open(&path).map_err(failed)?;
        match lock_to_try(&file, &path).map_err(failed)?.try_lock_shared() {
            Ok(()) => return Err(none()),
            Err(TryLockError::WouldBlock) => {}
            Err(TryLockError::Error(source)) => return Err(failed(source)),
        }
        let metadata = file.metadata().map_err(failed)?;
        if let Some(mode) = forbidden_mode(&metadata, MODE_FORBIDDEN) {
            return Err(EndpointError::Open { path, mode });
        }
        let mut text = Vec::new();
        file.take(SIZE_MAX).read_to_end(&mut text).map_err(failed)?;
        serde_json::from_slice(&text).map_err(|error| failed(error.into()))
    }
}

impl Drop for Announced {
    fn drop(&mut self) {
        // What remains has no lock, and counts for nothing.
        _ = fs::remove_file(&self.path);
    }
}

// Modes of files are of Unix.
#[cfg(test)]
#[cfg(unix)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use tempfile::TempDir;

    use super::*;

    #[test]
    fn a_daemon_is_found_while_it_runs_and_only_then() {
        let data = TempDir::new().unwrap();
        let is_none = || matches!(Endpoint::find(data.path()), Err(EndpointError::None { .. }));
        assert!(is_none());
        let endpoint = Endpoint::of("0.0.0.0:8137".parse().unwrap(), None, None).unwrap();
        assert_eq!(endpoint.address, "127.0.0.1:8137".parse().unwrap());
        let announced = endpoint.announce(data.path()).unwrap();
        assert_eq!(Endpoint::find(data.path()).unwrap(), endpoint);
        let path = data.path().join(FILE);
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, MODE);
        let left = fs::read(&path).unwrap();
        drop(announced);
        assert!(is_none() && !path.exists());
        // As a daemon that was killed leaves it.
        fs::write(&path, left).unwrap();
        assert!(is_none());
    }

    #[test]
    fn a_file_that_others_could_have_changed_is_refused() {
        let data = TempDir::new().unwrap();
        let path = data.path().join(FILE);
        let endpoint = Endpoint::of("127.0.0.1:1".parse().unwrap(), None, None).unwrap();
        let _announced = endpoint.announce(data.path()).unwrap();
        for (mode, is_accepted) in [(0o600, true), (0o644, true), (0o620, false), (0o602, false)] {
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            assert_eq!(Endpoint::find(data.path()).is_ok(), is_accepted, "{mode:o}");
        }
    }
}
