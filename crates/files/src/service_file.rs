//! The service file: the settings of the daemon that are no part of the bench.
//!
//! `config/service/service.toml` is the manual of its keys. Paths in it begin at its directory.

mod hub;
mod notifications;

use std::path::{Path, PathBuf};

pub use hub::HubFile;
pub use notifications::{Address, EventKind, NotificationsFile, TargetFile, Url, Via};

use crate::{
    Complaint, Faults,
    settings::{self, InForce, Setting, Table},
};

/// A checked service file. What it leaves out is `None`.
#[derive(Debug, Clone, Default)]
pub struct ServiceFile {
    /// Address and port to listen on, `host:port`.
    pub listen: Option<Setting<String>>,
    /// Other names by which clients may call this computer.
    pub allow_hosts: Option<Setting<Vec<String>>>,
    /// The file with the token that clients must send.
    pub token_file: Option<Setting<PathBuf>>,
    /// Whether the queue goes on after a start without a person.
    pub release_queue: Option<Setting<bool>>,
    /// How the daemon speaks TLS.
    pub tls: Option<Setting<TlsFile>>,
    /// Who is told what happens on the rig.
    pub notifications: Option<Setting<NotificationsFile>>,
    /// Where the journal is shipped to.
    pub hub: Option<Setting<HubFile>>,
}

/// How the daemon speaks TLS.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TlsFile {
    /// Not at all.
    Off,
    /// With a certificate that the daemon makes for itself.
    SelfSigned,
    /// With these files (PEM).
    Files {
        /// The certificate with its chain.
        certificate: PathBuf,
        /// The key of the certificate.
        key: PathBuf,
    },
}

/// A service file that contradicts itself.
#[derive(Debug, thiserror::Error)]
enum ServiceFault {
    #[error("listen = \"{0}\" is not an address and a port")]
    NoAddress(String),
    #[error("[tls] has `{0}` alone")]
    HalfAPair(&'static str),
    #[error("[tls] has self_signed = true and files of its own")]
    BothCertificates,
}

impl Complaint for ServiceFault {
    fn suggestion(&self) -> Option<String> {
        Some(match self {
            Self::NoAddress(_) => "write it as \"127.0.0.1:8137\"".to_owned(),
            Self::HalfAPair(_) => "give `certificate` and `key`".to_owned(),
            Self::BothCertificates => "remove one of them".to_owned(),
        })
    }
}

impl ServiceFile {
    /// Reads and checks the `text` of the service file at `path`.
    ///
    /// # Errors
    /// All faults of the file.
    pub fn read(path: &Path, text: &str) -> Result<Self, Faults> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let name = path.display().to_string();
        let (file, faults) = settings::read(&name, text, |table| service(table, folder));
        faults.finish(file)
    }

    /// The values in force of the sections `[notifications]` and `[hub]` of a service file, each with its place.
    ///
    /// # Errors
    /// All faults of the file.
    pub fn in_force(path: &Path, text: &str) -> Result<Vec<InForce>, Faults> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let name = path.display().to_string();
        let (_, faults, mut values) =
            settings::in_force(&name, text, |table| service(table, folder));
        let is_wanted = |name: &str| name.starts_with("notifications.") || name.starts_with("hub.");
        values.retain(|value| is_wanted(&value.name));
        faults.finish(values)
    }

    /// The JSON Schema of service files.
    pub fn schema() -> serde_json::Value {
        settings::schema("service file of rigd", |table| service(table, Path::new("")))
    }
}

fn service(table: &mut Table<'_>, folder: &Path) -> ServiceFile {
    let listen = table.text("listen").optional();
    if let Some(listen) = &listen {
        listen_address(table, listen);
    }
    let hosts = table.text("allow_hosts").list().optional();
    let texts = |hosts: Vec<Setting<String>>| hosts.into_iter().map(|host| host.value).collect();
    ServiceFile {
        listen,
        allow_hosts: hosts.map(|hosts| hosts.map(texts)),
        token_file: path(table, "token_file", folder),
        release_queue: table.flag("release_queue").optional(),
        tls: table.section("tls", |table| tls(table, folder)).optional(),
        notifications: table
            .section("notifications", |table| notifications::notifications(table, folder))
            .optional(),
        hub: table.section("hub", |table| hub::hub(table, folder)).optional(),
    }
}

fn listen_address(table: &Table<'_>, listen: &Setting<String>) {
    let is_address = |text: &str| {
        let parts = text.rsplit_once(':');
        parts.is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok())
    };
    if let Some(text) = listen.sound().filter(|text| !is_address(text)) {
        table.refuse(listen, &ServiceFault::NoAddress(text.clone()));
    }
}

fn tls(table: &mut Table<'_>, folder: &Path) -> TlsFile {
    let self_signed = table.flag("self_signed").or(false);
    let files = (path(table, "certificate", folder), path(table, "key", folder));
    match files {
        (Some(certificate), Some(_)) if self_signed.value => {
            table.refuse(&certificate, &ServiceFault::BothCertificates);
            TlsFile::Off
        }
        (Some(certificate), Some(key)) => {
            TlsFile::Files { certificate: certificate.value, key: key.value }
        }
        (Some(alone), None) | (None, Some(alone)) => {
            table.refuse(&alone, &ServiceFault::HalfAPair(alone.key));
            TlsFile::Off
        }
        (None, None) if self_signed.value => TlsFile::SelfSigned,
        (None, None) => TlsFile::Off,
    }
}

/// A path that begins at the directory of the file.
fn path(table: &mut Table<'_>, key: &'static str, folder: &Path) -> Option<Setting<PathBuf>> {
    let written = table.text(key).optional()?;
    Some(written.map(|text| folder.join(text)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MANUAL: &str = include_str!("../../../config/service/service.toml");

    fn read(text: &str) -> Result<ServiceFile, String> {
        let read = ServiceFile::read(Path::new("/etc/rigd/service.toml"), text);
        read.map_err(|faults| faults.to_string())
    }

    #[test]
    fn paths_begin_at_the_directory_of_the_file() {
        let text = "token_file = \"token\"\n[tls]\ncertificate = \"/c.pem\"\nkey = \"k.pem\"\n";
        let file = read(text).unwrap();
        assert_eq!(file.token_file.unwrap().value, PathBuf::from("/etc/rigd/token"));
        let files = TlsFile::Files { certificate: "/c.pem".into(), key: "/etc/rigd/k.pem".into() };
        assert_eq!(file.tls.unwrap().value, files);
    }

    #[test]
    fn a_hub_has_an_address_a_bench_and_files() {
        let files = "bench = \"lab/left\"\ncertificate = \"b.pem\"\nkey = \"b.key\"\nauthority = \"/ca.pem\"\n";
        for (address, host, port) in
            [("hub.lab.example:5432", "hub.lab.example", 5432), ("[::1]:6000", "::1", 6000)]
        {
            let hub = read(&format!("[hub]\naddress = \"{address}\"\n{files}")).unwrap().hub;
            let hub = hub.unwrap().value;
            assert_eq!(
                (hub.host.as_str(), hub.port, hub.database.as_str()),
                (host, port, "rigd_hub")
            );
            assert_eq!((hub.bench.as_str(), hub.authority), ("lab/left", "/ca.pem".into()));
            assert_eq!(hub.key, PathBuf::from("/etc/rigd/b.key"));
        }
        for wrong in ["hub.lab.example", ":5432", "/var/run/postgresql:5432", "h:0", "h:70000"] {
            let said = read(&format!("[hub]\naddress = \"{wrong}\"\n{files}")).unwrap_err();
            assert!(said.contains(":2:11: address = "), "{said}");
        }
        let live = |text| read(&format!("[hub]\naddress = \"h:1\"\n{files}live = \"{text}\""));
        let hub = live("nats.lab.example:4222").unwrap().hub.unwrap().value;
        assert_eq!(hub.live, Some(("nats.lab.example".to_owned(), 4222)));
        let said = live("nats").unwrap_err();
        assert!(said.contains("live = \"nats\"") && said.contains("example:4222"), "{said}");
        assert!(read("[hub]\naddress = \"h:1\"").unwrap_err().contains("`bench`"));
    }

    #[test]
    fn the_manual_is_a_service_file_and_so_is_an_empty_one() {
        let file = read(MANUAL).unwrap();
        assert_eq!(file.listen.unwrap().value, "127.0.0.1:8137");
        assert_eq!(file.tls.unwrap().value, TlsFile::Off);
        assert!(read("").unwrap().listen.is_none());
    }

    #[test]
    fn a_service_file_that_contradicts_itself_is_refused() {
        for (text, fault) in [
            ("listen = \"8137\"", ":1:10: listen = \"8137\" is not an address and a port"),
            ("listen = \":8137\"", ":1:10: listen = \":8137\" is not an address and a port"),
            ("[tls]\nkey = \"k\"", ":2:7: [tls] has `key` alone"),
            (
                "[tls]\nself_signed = true\ncertificate = \"c\"\nkey = \"k\"",
                ":3:15: [tls] has self_signed = true and files of its own",
            ),
            ("lisen = \"127.0.0.1:1\"", "did you mean `listen`?"),
        ] {
            let said = read(text).unwrap_err();
            assert!(said.contains(fault), "{text}: {said}");
        }
    }
}
