//! The section `[hub]`: where the journal is shipped to.

use std::path::{Path, PathBuf};

use crate::{
    Complaint,
    settings::{Setting, Table},
};

/// The ports that these servers have by default.
const POSTGRES_PORT: u16 = 5432;
const NATS_PORT: u16 = 4222;

/// The hub of the laboratory, and who this bench is there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HubFile {
    /// Name or address of its PostgreSQL.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// Name of its database.
    pub database: String,
    /// `LAB/NAME` of this bench, the name of its role and of its certificate.
    pub bench: String,
    /// The certificate of this bench (PEM).
    pub certificate: PathBuf,
    /// The key of the certificate.
    pub key: PathBuf,
    /// The certificate of the authority that has signed those of the servers.
    pub authority: PathBuf,
    /// Host and port of its nats-server, which tells viewers what the rig does.
    pub live: Option<(String, u16)>,
}

/// A hub that cannot be there.
#[derive(Debug, thiserror::Error)]
enum HubFault {
    #[error("{key} = \"{text}\" is not a name or an address, and a port")]
    NoAddress { key: &'static str, text: String, port: u16 },
}

impl Complaint for HubFault {
    fn suggestion(&self) -> Option<String> {
        let Self::NoAddress { port, .. } = self;
        Some(format!("write it as \"hub.lab.example:{port}\""))
    }
}

pub(super) fn hub(table: &mut Table<'_>, folder: &Path) -> HubFile {
    let address = table.text("address").max_chars(300).required();
    let database = table.text("database").max_chars(63).or("rigd_hub".to_owned()).value;
    let bench = table.text("bench").max_chars(63).required().value;
    let mut file = |key| folder.join(table.text(key).required().value);
    let (certificate, key, authority) = (file("certificate"), file("key"), file("authority"));
    let live = table.text("live").max_chars(300).optional();
    let live = live.and_then(|live| parts(table, "live", &live, NATS_PORT));
    let (host, port) = parts(table, "address", &address, POSTGRES_PORT).unwrap_or_default();
    HubFile { host, port, database, bench, certificate, key, authority, live }
}

/// Host and port of an address, of which `usual` is the port that most servers have.
fn parts(
    table: &Table<'_>,
    key: &'static str,
    address: &Setting<String>,
    usual: u16,
) -> Option<(String, u16)> {
    let text = address.sound()?;
    let parts = text.rsplit_once(':').and_then(|(host, port)| {
        let host = host.strip_prefix('[').map_or(host, |host| host.trim_end_matches(']'));
        Some((host, port.parse::<u16>().ok()?))
    });
    match parts {
        // A path would be a socket, which has no certificate.
        Some((host, port)) if !host.is_empty() && !host.starts_with('/') && port > 0 => {
            Some((host.to_owned(), port))
        }
        _ => {
            table.refuse(address, &HubFault::NoAddress { key, text: text.clone(), port: usual });
            None
        }
    }
}
