//! The settings of the daemon: flags first, then the service file, then defaults.
//!
//! `rigd serve` and `rigd config show` settle them by the same function.

use std::{
    net::{Ipv4Addr, SocketAddr, SocketAddrV4, ToSocketAddrs},
    path::{Path, PathBuf},
};

use clap::Args;
use rig_files::{
    Complaint, Faults, FileKind,
    service_file::{HubFile, NotificationsFile, ServiceFile, TlsFile},
    settings::{InForce, Setting},
};
use serde::Serialize;

use super::{args::BenchArgs, screen::say};
use crate::{
    files::{self, FileError},
    http::access::{HostName, HostNameError},
    notify::{TargetError, Targets},
    place::{Place, PlaceKind},
};

/// Where the daemon listens if nothing says otherwise.
const LISTEN: SocketAddr = SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 8137));

/// Flags of the daemon, each of which has precedence over the service file.
#[derive(Debug, Clone, Args)]
pub(super) struct ServiceArgs {
    /// Service file [default: service.toml beside the rig file that is found]
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Address and port to listen on. Any but a loopback address needs tokens (`rigd token new`)
    /// [default: 127.0.0.1:8137]
    #[arg(long, value_name = "ADDR", value_parser = address)]
    listen: Option<SocketAddr>,
    /// Another name by which clients may call this computer; can be given several times
    #[arg(long, value_name = "NAME")]
    allow_host: Vec<HostName>,
    /// File with the token that clients must send as `Authorization: Bearer`
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// Begin what waits in the queue without waiting for `rigd queue release`, unless a person or a
    /// fault has held it
    #[arg(long)]
    release_queue: bool,
    #[command(flatten)]
    tls: TlsArgs,
}

/// Whether clients must speak TLS.
#[derive(Debug, Clone, Args)]
struct TlsArgs {
    /// Speak TLS, with a certificate that the daemon makes for itself in its data directory
    #[arg(long, conflicts_with = "tls_certificate")]
    tls: bool,
    /// Speak TLS, with the certificate chain in this file (PEM), which is read again when it changes
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    tls_certificate: Option<PathBuf>,
    /// File with the key of the certificate (PEM)
    #[arg(long, value_name = "FILE", requires = "tls_certificate")]
    tls_key: Option<PathBuf>,
}

/// Where a value comes from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(super) enum Origin {
    /// A line of a file.
    File { file: String, line: usize },
    /// A flag of the command.
    Flag { flag: &'static str },
    /// A variable of the environment.
    Variable { variable: &'static str },
    /// The search for the directories.
    Search { place: PlaceKind },
    /// Nothing gives another value.
    Default,
}

impl Origin {
    /// For a person.
    pub(super) fn text(&self) -> String {
        match self {
            Self::File { file, line } => format!("{file}:{line}"),
            Self::Flag { flag } => (*flag).to_owned(),
            Self::Variable { variable } => format!("${variable}"),
            Self::Search { place } => format!("found in {}", place.name()),
            Self::Default => "default".to_owned(),
        }
    }
}

/// A value and where it comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Settled<T> {
    pub(super) value: T,
    pub(super) from: Origin,
}

impl<T> Settled<T> {
    const fn default(value: T) -> Self {
        Self { value, from: Origin::Default }
    }

    /// The value of the flag of this name, if it is given.
    fn flag_or(flag: Option<T>, name: &'static str, otherwise: Self) -> Self {
        let flag = flag.map(|value| Self { value, from: Origin::Flag { flag: name } });
        flag.unwrap_or(otherwise)
    }
}

/// The settings of the daemon.
#[derive(Debug)]
pub(super) struct Settings {
    pub(super) rig: Settled<PathBuf>,
    pub(super) data: Settled<PathBuf>,
    /// The service file, if there is one.
    pub(super) service: Settled<Option<PathBuf>>,
    pub(super) listen: Settled<SocketAddr>,
    pub(super) allow_hosts: Settled<Vec<HostName>>,
    pub(super) token_file: Settled<Option<PathBuf>>,
    pub(super) release_queue: Settled<bool>,
    pub(super) tls: Settled<TlsFile>,
    /// Who is told what happens on the rig, if anybody.
    pub(super) notifications: Option<NotificationsFile>,
    /// Where the journal is shipped to, if anywhere.
    pub(super) hub: Option<HubFile>,
    /// The values of both sections, each with its line.
    pub(super) of_sections: Vec<InForce>,
}

impl Settings {
    /// Settles the settings of a daemon with these flags.
    ///
    /// # Errors
    /// [`FileError`] with every fault of the service file.
    pub(super) fn settle(bench: &BenchArgs, args: &ServiceArgs) -> Result<Self, FileError> {
        let place = Place::found();
        let found = |path: &Path| Settled {
            value: path.to_path_buf(),
            from: Origin::Search { place: place.kind },
        };
        let (rig, data) = (bench.rig.rig.clone(), bench.data.data.clone());
        let given = Given::read(args, &place)?;
        let listen = given
            .made(given.file.listen.as_ref(), |text| address(text).map_err(Unusable::Listen))?;
        let hosts = given.made(given.file.allow_hosts.as_ref(), |hosts| {
            hosts.iter().map(|host| host.parse().map_err(Unusable::Host)).collect()
        })?;
        let token_file =
            given.made(given.file.token_file.as_ref(), |path| Ok(Some(path.clone())))?;
        let release_queue =
            given.made(given.file.release_queue.as_ref(), |is_released| Ok(*is_released))?;
        let tls = given.made(given.file.tls.as_ref(), |tls| Ok(tls.clone()))?;
        let hosts_given = (!args.allow_host.is_empty()).then(|| args.allow_host.clone());
        let (tls_given, tls_flag) = args.tls.given();
        Ok(Self {
            rig: Settled::flag_or(rig, "--rig", found(&place.rig)),
            data: Settled::flag_or(data, "--data", found(&place.data)),
            listen: Settled::flag_or(
                args.listen,
                "--listen",
                listen.unwrap_or(Settled::default(LISTEN)),
            ),
            allow_hosts: Settled::flag_or(
                hosts_given,
                "--allow-host",
                hosts.unwrap_or(Settled::default(Vec::new())),
            ),
            token_file: Settled::flag_or(
                args.token_file.clone().map(Some),
                "--token-file",
                token_file.unwrap_or(Settled::default(None)),
            ),
            release_queue: Settled::flag_or(
                args.release_queue.then_some(true),
                "--release-queue",
                release_queue.unwrap_or(Settled::default(false)),
            ),
            tls: Settled::flag_or(
                tls_given,
                tls_flag,
                tls.unwrap_or(Settled::default(TlsFile::Off)),
            ),
            notifications: given.file.notifications.map(|section| section.value),
            hub: given.file.hub.map(|section| section.value),
            of_sections: given.in_force,
            service: given.path,
        })
    }
}

impl Settings {
    /// Those who are told what happens on the rig.
    ///
    /// # Errors
    /// [`TargetError`] for a target whose files cannot be used.
    pub(super) fn targets(&self) -> Result<Option<Targets>, TargetError> {
        self.notifications.as_ref().map(Targets::new).transpose()
    }

    /// Says which files are used, and why.
    pub(super) fn say(&self) {
        let part = |what: &str, path: &Path, from: &Origin| {
            format!("{what} {} ({})", path.display(), from.text())
        };
        let service = match &self.service.value {
            Some(path) => part("service file", path, &self.service.from),
            None => "no service file".to_owned(),
        };
        let rig = part("rig file", &self.rig.value, &self.rig.from);
        let data = part("data", &self.data.value, &self.data.from);
        say(&format!("rigd: {rig}, {data}, {service}"));
    }
}

/// The hub of the service file that a daemon without flags would use.
///
/// # Errors
/// [`FileError`] with every fault of the service file.
pub(super) fn hub() -> Result<Option<HubFile>, FileError> {
    let file = Place::found().service;
    if !file.try_exists().unwrap_or(true) {
        return Ok(None);
    }
    let (_, text) = files::read(&file, FileKind::Service)?;
    let file = ServiceFile::read(&file, &text).map_err(FileError::Faults)?;
    Ok(file.hub.map(|section| section.value))
}

impl TlsArgs {
    /// What the flags say, and the flag that says it.
    fn given(&self) -> (Option<TlsFile>, &'static str) {
        match (&self.tls_certificate, &self.tls_key) {
            (Some(certificate), Some(key)) => {
                let (certificate, key) = (certificate.clone(), key.clone());
                (Some(TlsFile::Files { certificate, key }), "--tls-certificate")
            }
            _ => (self.tls.then_some(TlsFile::SelfSigned), "--tls"),
        }
    }
}

/// The service file, or an empty one.
struct Given {
    path: Settled<Option<PathBuf>>,
    file: ServiceFile,
    /// The values of its sections on notifications and the hub.
    in_force: Vec<InForce>,
}

impl Given {
    /// Reads the file that a flag names, or that beside the rig file of the place, if it is there.
    fn read(args: &ServiceArgs, place: &Place) -> Result<Self, FileError> {
        let (path, from) = match &args.config {
            Some(path) => (path.clone(), Origin::Flag { flag: "--config" }),
            // A file that this user may not look at is not passed over.
            None if place.service.try_exists().unwrap_or(true) => {
                (place.service.clone(), Origin::Search { place: place.kind })
            }
            None => {
                let (path, file) = (Settled::default(None), ServiceFile::default());
                return Ok(Self { path, file, in_force: Vec::new() });
            }
        };
        let (_, text) = files::read(&path, FileKind::Service)?;
        let file = ServiceFile::read(&path, &text).map_err(FileError::Faults)?;
        let in_force = ServiceFile::in_force(&path, &text).map_err(FileError::Faults)?;
        Ok(Self { path: Settled { value: Some(path), from }, file, in_force })
    }

    /// A value that is made of what the file says, with its line.
    fn made<T, U>(
        &self,
        setting: Option<&Setting<T>>,
        make: impl FnOnce(&T) -> Result<U, Unusable>,
    ) -> Result<Option<Settled<U>>, FileError> {
        let Some(Setting { value, location, .. }) = setting else { return Ok(None) };
        let file = self.path.value.as_deref().unwrap_or(Path::new("")).display().to_string();
        match make(value) {
            Ok(value) => {
                let from = Origin::File { file, line: location.line };
                Ok(Some(Settled { value, from }))
            }
            Err(unusable) => {
                let mut faults = Faults::new(file);
                faults.refuse(*location, &unusable);
                Err(FileError::Faults(faults))
            }
        }
    }
}

/// A value of the service file that this computer cannot use.
#[derive(Debug, thiserror::Error)]
enum Unusable {
    #[error("listen: {0}")]
    Listen(BadAddress),
    #[error("allow_hosts: {0}")]
    Host(HostNameError),
}

impl Complaint for Unusable {}

/// An address that cannot be listened on.
#[derive(Debug, thiserror::Error)]
enum BadAddress {
    #[error("expected an address or a name and a port, such as 127.0.0.1:8137 or localhost:8137")]
    Form,
    #[error("the name `{name}` has no address here; give an address of this computer")]
    Unknown { name: String },
}

/// An address, or the first one of a name. For a local name an IPv4 address is preferred, because
/// clients use it most often.
fn address(text: &str) -> Result<SocketAddr, BadAddress> {
    if let Ok(address) = text.parse() {
        return Ok(address);
    }
    let (name, port) = text.rsplit_once(':').ok_or(BadAddress::Form)?;
    let port: u16 = port.parse().map_err(|_| BadAddress::Form)?;
    if name.is_empty() || name.contains(':') {
        return Err(BadAddress::Form);
    }
    let unknown = || BadAddress::Unknown { name: name.to_owned() };
    let addresses = (name, port).to_socket_addrs().map_err(|_| unknown())?;
    addresses.min_by_key(SocketAddr::is_ipv6).ok_or_else(unknown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_to_listen_on_may_be_a_name() {
        let local: SocketAddr = "127.0.0.1:8140".parse().unwrap();
        assert_eq!(address("127.0.0.1:8140").unwrap(), local);
        assert_eq!(address("localhost:8140").unwrap(), local);
        assert_eq!(address("[::1]:80").unwrap(), "[::1]:80".parse().unwrap());
        for text in
            ["", "8140", ":8140", "localhost", "localhost:", "localhost:x", "::1", "a:99999"]
        {
            assert!(matches!(address(text), Err(BadAddress::Form)), "{text}");
        }
        assert!(matches!(address("no-such-host.invalid:1"), Err(BadAddress::Unknown { .. })));
    }
}
