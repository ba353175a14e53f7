//! Who may say and hear what: the configuration of a nats-server, made from the benches and viewers of the hub.

use std::{
    collections::BTreeMap,
    fmt::Write as _,
    path::{Path, PathBuf},
};

use tokio_postgres::Client;

use super::{Broker, HUB_NAME, Subjects, subject};
use crate::{AdminError, BenchName};

/// The account in which the hub hears all laboratories. No laboratory has a name with a colon. nats-server makes subjects of the
/// names of accounts, in which a space is an error.
const HUB_ACCOUNT: &str = HUB_NAME;

/// Where the nats-server is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LiveServer {
    /// Name or address by which benches and viewers reach it.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// Directory of the hub's authority, which has `live.pem` and `live.key` too.
    pub certificates: PathBuf,
}

/// A nats-server, and whom it lets in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LiveSetup {
    /// Where it is.
    pub server: LiveServer,
    /// The laboratories.
    labs: BTreeMap<String, Lab>,
}

#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct Lab {
    benches: Vec<BenchName>,
    viewers: Vec<BenchName>,
}

impl LiveServer {
    /// The server as the hub itself reaches it.
    pub fn broker(&self) -> Broker {
        let files = ["live.pem", "live.key", "ca.pem"].map(|name| self.certificates.join(name));
        Broker::new((&self.host, self.port), files)
    }
}

/// Notes where the nats-server is.
///
/// # Errors
/// [`AdminError`].
pub async fn set_up(client: &Client, server: &LiveServer) -> Result<(), AdminError> {
    let note = "INSERT INTO hub.live_server (host, port, certificates) VALUES ($1, $2, $3)
                ON CONFLICT (is_only) DO UPDATE
                SET (host, port, certificates) = (excluded.host, excluded.port, excluded.certificates)";
    let certificates = server.certificates.display().to_string();
    client.execute(note, &[&server.host, &i32::from(server.port), &certificates]).await?;
    Ok(())
}

/// Notes a viewer, which is named as a bench: by its laboratory and a name in it.
///
/// # Errors
/// [`AdminError`].
pub async fn add_viewer(client: &Client, viewer: &BenchName) -> Result<(), AdminError> {
    let note = "INSERT INTO hub.viewer (lab, name) VALUES ($1, $2) ON CONFLICT DO NOTHING";
    client.execute(note, &[&viewer.lab, &viewer.name]).await?;
    Ok(())
}

/// Forgets a viewer.
///
/// # Errors
/// [`AdminError`].
pub async fn remove_viewer(client: &Client, viewer: &BenchName) -> Result<(), AdminError> {
    let forget = "DELETE FROM hub.viewer WHERE lab = $1 AND name = $2";
    if client.execute(forget, &[&viewer.lab, &viewer.name]).await? == 0 {
        return Err(AdminError::NoSuchViewer { viewer: viewer.to_string() });
    }
    Ok(())
}

/// The nats-server of the hub, with the benches that may ship and the viewers; none if there is no server.
///
/// # Errors
/// The error of PostgreSQL.
pub async fn setup(client: &Client) -> Result<Option<LiveSetup>, tokio_postgres::Error> {
    let select = "SELECT host, port, certificates FROM hub.live_server";
    let Some(row) = client.query_opt(select, &[]).await? else { return Ok(None) };
    let server = LiveServer {
        host: row.get(0),
        port: row.get::<_, i32>(1).try_into().unwrap_or_default(),
        certificates: row.get::<_, String>(2).into(),
    };
    let members = "
        SELECT b.lab, b.name, true FROM hub.bench AS b JOIN pg_roles AS r ON r.rolname = b.role WHERE r.rolcanlogin
        UNION ALL SELECT lab, name, false FROM hub.viewer ORDER BY 1, 2";
    let mut labs = BTreeMap::<String, Lab>::new();
    for row in client.query(members, &[]).await? {
        let member = BenchName { lab: row.get(0), name: row.get(1) };
        let lab = labs.entry(member.lab.clone()).or_default();
        if row.get(2) { lab.benches.push(member) } else { lab.viewers.push(member) }
    }
    Ok(Some(LiveSetup { server, labs }))
}

/// Common name of the certificate of a viewer.
pub fn viewer_name(viewer: &BenchName) -> String {
    format!("viewer:{viewer}")
}

impl LiveSetup {
    /// The configuration of the nats-server, which reads `nats.pem`, `nats.key` and `ca.pem` in `files`.
    pub fn text(&self, files: &Path) -> String {
        let file = |name: &str| quoted(&files.join(name).display().to_string());
        let mut text = format!(
            "# Made by `rigd-hub live config`. Make it again after each change of benches and viewers.\n\
             port: {}\n\
             tls {{\n  cert_file: {}\n  key_file: {}\n  ca_file: {}\n\
             \x20 # A certificate is a user, by its common name.\n  verify_and_map: true\n\
             \x20 # Seconds for a handshake: a bench that is busy needs more than the usual 2.\n  timeout: 10\n}}\n\
             accounts {{\n",
            self.server.port,
            file("nats.pem"),
            file("nats.key"),
            file("ca.pem"),
        );
        let mut imports = String::new();
        for (name, lab) in &self.labs {
            let subjects = subject::all_of(name);
            // Writing to a string cannot fail.
            _ = write!(text, "  {}: {{\n    users: [\n", quoted(name));
            for bench in &lab.benches {
                let publish = list(&Subjects::of(bench).all());
                let rights = format!("publish: {publish}, subscribe: {{ deny: \">\" }}");
                text.push_str(&user(&bench.to_string(), &rights));
            }
            for viewer in &lab.viewers {
                let rights = format!("publish: {{ deny: \">\" }}, subscribe: {}", list(&subjects));
                text.push_str(&user(&viewer_name(viewer), &rights));
            }
            text.push_str("    ]\n    exports: [\n");
            for subject in &subjects {
                let subject = quoted(subject);
                _ = writeln!(text, "      {{ stream: {subject} }}");
                _ = writeln!(
                    imports,
                    "      {{ stream: {{ account: {}, subject: {subject} }} }}",
                    quoted(name)
                );
            }
            text.push_str("    ]\n  }\n");
        }
        let hub = user(HUB_NAME, "publish: { deny: \">\" }");
        _ = write!(
            text,
            "  {}: {{\n    users: [\n{hub}    ]\n    imports: [\n{imports}    ]\n  }}\n}}\n",
            quoted(HUB_ACCOUNT)
        );
        text
    }
}

fn user(common_name: &str, rights: &str) -> String {
    let name = quoted(&format!("CN={common_name}"));
    format!("      {{ user: {name}, permissions: {{ {rights} }} }}\n")
}

fn list(subjects: &[String]) -> String {
    let subjects: Vec<_> = subjects.iter().map(|subject| quoted(subject)).collect();
    format!("[{}]", subjects.join(", "))
}

/// A text as the configuration has it.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_account_of_the_hub_is_a_word_of_a_subject_and_that_of_no_laboratory() {
        assert!(!HUB_ACCOUNT.contains([' ', '.', '*', '>']));
        assert!(format!("{HUB_ACCOUNT}/any").parse::<BenchName>().is_err());
    }
}
