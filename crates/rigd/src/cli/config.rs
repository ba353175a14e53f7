//! `rigd config show`: every value in force, with where it comes from and how it is changed; `rigd config reload`.

use std::{env, path::PathBuf};

use clap::{Args, Subcommand};
use rig_files::{FileKind, rig_file::RigFile, service_file::TlsFile, settings::InForce};
use serde::Serialize;

use super::{
    Failure,
    args::{BenchArgs, OutputArgs},
    daemon::{DaemonArgs, over_http},
    settings::{Origin, ServiceArgs, Settings},
    table::{print, print_json},
};
use crate::{
    files::{self, FileError},
    http::{Changed, Kept, Reloaded},
    operator,
    place::{self, Place, PlaceKind},
};

#[derive(Debug, Args)]
pub(super) struct ConfigArgs {
    #[command(subcommand)]
    command: ConfigCommand,
}

#[derive(Debug, Subcommand)]
enum ConfigCommand {
    /// Print the directories that are searched and every value with which `rigd serve` with these flags
    /// would start: its place in a file, its flag, its variable, or that it is a default
    Show(Box<ShowArgs>),
    /// Ask a daemon to read its configuration again. What needs a restart stays, and is told with the reason
    Reload(DaemonArgs),
}

#[derive(Debug, Args)]
struct ShowArgs {
    #[command(flatten)]
    bench: BenchArgs,
    #[command(flatten)]
    service: ServiceArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// The values in force.
#[derive(Debug, Serialize)]
struct ConfigView {
    /// The directories, in the order of the search.
    searched: Vec<SearchedView>,
    values: Vec<ValueView>,
}

#[derive(Debug, Serialize)]
struct SearchedView {
    place: PlaceKind,
    rig: String,
    data: String,
    /// Whether its rig file is there. The first place with one is used.
    has_rig: bool,
}

#[derive(Debug, Serialize)]
struct ValueView {
    part: Part,
    name: String,
    /// The value, in a file as TOML. `null` for a key that the file leaves out and whose default is no
    /// single value, and for a variable that is not set.
    value: Option<String>,
    from: Origin,
    /// How a running daemon takes a change.
    change: Change,
}

/// The key of a value.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct ConfigKey {
    part: Part,
    pub(super) name: String,
}

/// How a running daemon takes a change of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(tag = "by", content = "reason", rename_all = "snake_case")]
pub(super) enum Change {
    /// By a reload, also during a run: neither motion nor results depend on it.
    #[serde(rename = "reload")]
    Live,
    /// By a restart, for this reason.
    Restart(&'static str),
}

/// What a value belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
enum Part {
    Directories,
    Service,
    Environment,
    Rig,
}

/// Variables that rigd reads beside those of the directories.
const VARIABLES: [&str; 9] = [
    "LOGNAME",
    "USER",
    "RUST_LOG",
    "NO_COLOR",
    "TERM",
    "TZ",
    "NOTIFY_SOCKET",
    "WATCHDOG_USEC",
    "WATCHDOG_PID",
];

pub(super) fn config(args: &ConfigArgs) -> Result<(), Failure> {
    match &args.command {
        ConfigCommand::Show(args) => show(args),
        ConfigCommand::Reload(args) => reload(args),
    }
}

fn show(args: &ShowArgs) -> Result<(), Failure> {
    let settings = Settings::settle(&args.bench, &args.service)?;
    let mut values = of_daemon(&args.bench, &settings);
    values.extend(of_environment());
    // Which file it is stands above its faults.
    let rig = of_rig(&settings);
    let faults = rig.map(|rig| values.extend(rig)).err();
    let searched = Place::all(|name| env::var_os(name)).iter().map(SearchedView::of).collect();
    let view = ConfigView { searched, values };
    if args.output.json {
        print_json(&view)?;
    } else {
        print(&view.text())?;
    }
    faults.map_or(Ok(()), |error| Err(error.into()))
}

/// Asks a daemon to read its configuration again.
fn reload(args: &DaemonArgs) -> Result<(), Failure> {
    let Reloaded { changed, kept } =
        over_http(async { args.client()?.make("/api/v1/config/reload").await })?;
    let shown = |value: &Option<String>| match value {
        Some(text) if text.is_empty() => "none".to_owned(),
        Some(text) => text.clone(),
        None => "not set".to_owned(),
    };
    let mut lines = Vec::new();
    for Changed { name, from, to } in &changed {
        let is_same = from == to;
        let (from, to) = (shown(from), shown(to));
        lines.push(if is_same {
            format!("changed: {name}, the content of {to}")
        } else {
            format!("changed: {name}, from {from} to {to}")
        });
    }
    for Kept { name, value, wanted, reason } in &kept {
        let (value, wanted) = (shown(value), shown(wanted));
        lines.push(format!("needs a restart: {name}, still {value} and not {wanted}: {reason}"));
    }
    if lines.is_empty() {
        lines.push("nothing has changed".to_owned());
    }
    print(&lines.join("\n"))
}

/// Every value that the daemon reads at its start, by its key.
pub(super) fn in_force(
    bench: &BenchArgs,
    settings: &Settings,
) -> Result<impl Iterator<Item = (ConfigKey, Option<String>)>, FileError> {
    let values = of_daemon(bench, settings).into_iter().chain(of_rig(settings)?);
    Ok(values.map(|ValueView { part, name, value, .. }| (ConfigKey { part, name }, value)))
}

/// The settings of the daemon.
fn of_daemon(bench: &BenchArgs, settings: &Settings) -> Vec<ValueView> {
    let mut values = of_service(settings);
    values.push(of_operator(bench));
    values.extend(of_sections(settings));
    values
}

impl ConfigKey {
    /// A key of the rig file, or of what it names.
    pub(super) fn of_rig(name: &str) -> Self {
        Self { part: Part::Rig, name: name.to_owned() }
    }

    pub(super) fn change(&self) -> Change {
        change(self.part, &self.name)
    }
}

/// How a running daemon takes a change of a value. What is not known to be safe needs a restart.
fn change(part: Part, name: &str) -> Change {
    match (part, name) {
        (Part::Service, "allow_hosts" | "token_file") | (Part::Directories, "service") => {
            Change::Live
        }
        (Part::Service, name) if name.starts_with("notifications.") => Change::Live,
        (Part::Service, "listen") => Change::Restart("its port is open, and clients know it"),
        (Part::Service, "tls") => Change::Restart(
            "the port speaks as it did at the start; renewed files of a certificate need no reload",
        ),
        (Part::Service, name) if name.starts_with("hub.") => Change::Restart(
            "the journal is shipped, and viewers are told, as it was said at the start",
        ),
        (Part::Service, "release_queue") => Change::Restart("it says what happens after a start"),
        (Part::Service, _) => Change::Restart("it is a flag of the program"),
        (Part::Directories, _) => Change::Restart("the rig and its journal are open"),
        (Part::Environment, _) => {
            Change::Restart("a program has the variables with which it was started")
        }
        (Part::Rig, _) => Change::Restart(
            "motion and results rest on it: the devices, the limits and the journal of each run have it",
        ),
    }
}

fn of_service(settings: &Settings) -> Vec<ValueView> {
    let Settings {
        rig, data, service, listen, allow_hosts, token_file, release_queue, tls, ..
    } = settings;
    let value = |part, name: &str, value: Option<String>, from: &Origin| {
        ValueView::new(part, name, value, from.clone())
    };
    let path = |path: &PathBuf| path.display().to_string();
    let hosts: Vec<_> = allow_hosts.value.iter().map(ToString::to_string).collect();
    let (directories, daemon) = (Part::Directories, Part::Service);
    let speaks = match &tls.value {
        TlsFile::Off => "off".to_owned(),
        TlsFile::SelfSigned => "a certificate of its own".to_owned(),
        TlsFile::Files { certificate, key } => format!("{}, {}", path(certificate), path(key)),
    };
    vec![
        value(directories, "rig", Some(path(&rig.value)), &rig.from),
        value(directories, "data", Some(path(&data.value)), &data.from),
        value(directories, "service", service.value.as_ref().map(path), &service.from),
        value(daemon, "listen", Some(listen.value.to_string()), &listen.from),
        value(daemon, "allow_hosts", Some(hosts.join(", ")), &allow_hosts.from),
        value(daemon, "token_file", token_file.value.as_ref().map(path), &token_file.from),
        value(daemon, "release_queue", Some(release_queue.value.to_string()), &release_queue.from),
        value(daemon, "tls", Some(speaks), &tls.from),
    ]
}

/// Who is told what happens on the rig, and the hub: files with secrets are named, and not read.
fn of_sections(settings: &Settings) -> impl Iterator<Item = ValueView> {
    let file = settings.service.value.as_ref();
    let file = file.map(|path| path.display().to_string()).unwrap_or_default();
    let values = settings.of_sections.iter().cloned();
    values.map(move |value| ValueView::of_file(Part::Service, &file, value))
}

/// The name that the journal keeps with commands of this computer.
fn of_operator(bench: &BenchArgs) -> ValueView {
    let given = bench.operator.operator.clone();
    let (name, from) = match given {
        Some(name) => (name, Origin::Flag { flag: "--operator" }),
        None => match operator::Operator::logged_in() {
            (name, Some(variable)) => (name, Origin::Variable { variable }),
            (name, None) => (name, Origin::Default),
        },
    };
    let value = Some(name.as_str().to_owned());
    ValueView::new(Part::Service, "operator", value, from)
}

fn of_environment() -> impl Iterator<Item = ValueView> {
    place::VARIABLES.into_iter().chain(VARIABLES).map(|variable| {
        let value = env::var_os(variable).map(|value| value.to_string_lossy().into_owned());
        let set = Origin::Variable { variable };
        let from = if value.is_some() { set } else { Origin::Default };
        ValueView::new(Part::Environment, variable, value, from)
    })
}

fn of_rig(settings: &Settings) -> Result<Vec<ValueView>, FileError> {
    let (name, text) = files::read(&settings.rig.value, FileKind::Rig)?;
    let values = RigFile::in_force(&name, &text).map_err(FileError::Faults)?;
    Ok(values.into_iter().map(|value| ValueView::of_file(Part::Rig, &name, value)).collect())
}

impl ValueView {
    fn new(part: Part, name: &str, value: Option<String>, from: Origin) -> Self {
        Self { part, name: name.to_owned(), value, from, change: change(part, name) }
    }

    fn of_file(part: Part, file: &str, InForce { name, text, location }: InForce) -> Self {
        let at = |line| Origin::File { file: file.to_owned(), line };
        let from = location.map_or(Origin::Default, |location| at(location.line));
        Self::new(part, &name, text, from)
    }
}

impl SearchedView {
    fn of(place: &Place) -> Self {
        let (rig, data) = (place.rig.display().to_string(), place.data.display().to_string());
        Self { place: place.kind, rig, data, has_rig: place.has_rig() }
    }
}

impl Part {
    const ALL: [Self; 4] = [Self::Directories, Self::Service, Self::Environment, Self::Rig];

    const fn title(self) -> &'static str {
        match self {
            Self::Directories => "Directories",
            Self::Service => "Service",
            Self::Environment => "Environment",
            Self::Rig => "Rig file",
        }
    }
}

impl ConfigView {
    /// For a person: a line for each value.
    fn text(&self) -> String {
        /// Longer values move the last column of their own line alone.
        const VALUE_MAX: usize = 40;
        let mut lines = vec![
            "A running daemon takes a change by a restart, or where `reload` stands, by `rigd config reload`"
                .to_owned(),
            String::new(),
            "Searched, the first with a rig file is used".to_owned(),
        ];
        for place in &self.searched {
            let is_there = if place.has_rig { "there" } else { "not there" };
            lines.push(format!("  {}: {is_there}; data in {}", place.rig, place.data));
        }
        for part in Part::ALL {
            let values = || self.values.iter().filter(|value| value.part == part);
            let shown = |value: &ValueView| match &value.value {
                Some(text) if text.is_empty() => "none".to_owned(),
                Some(text) => text.clone(),
                None => "not set".to_owned(),
            };
            let names = values().map(|value| value.name.len()).max().unwrap_or(0);
            let wide = values().map(|value| shown(value).chars().count().min(VALUE_MAX)).max();
            let wide = wide.unwrap_or(0);
            if values().next().is_some() {
                lines.extend([String::new(), part.title().to_owned()]);
            }
            lines.extend(values().map(|value| {
                let from = value.from.text();
                let change = match value.change {
                    Change::Live => "; reload",
                    Change::Restart(_) => "",
                };
                format!("  {:<names$}  {:<wide$}  {from}{change}", value.name, shown(value))
            }));
        }
        lines.join("\n")
    }
}
