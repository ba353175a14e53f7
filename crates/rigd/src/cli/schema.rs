//! `rigd schema` and `rigd new`: the form of the files that a person writes.

mod reference;

use std::{
    fs::File,
    io::{self, Write},
    path::PathBuf,
};

use clap::{Args, Subcommand, ValueEnum};
use rig_files::{
    instrument::{Dialect, RegisterMap},
    rig_file::RigFile,
    service_file::ServiceFile,
};
use rig_protocol::Protocol;
use serde_json::Value;

use super::{
    Failure,
    table::{note, print},
};

#[derive(Debug, Args)]
pub(super) struct SchemaArgs {
    /// Kind of file
    #[arg(value_enum)]
    kind: FileKind,
    /// Print tables of the keys for a person, as Markdown, instead of the JSON Schema
    #[arg(long)]
    markdown: bool,
}

/// A kind of file that a person writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FileKind {
    /// What to measure
    Protocol,
    /// The devices, axes, limits and sensor of a bench
    Rig,
    #[cfg(feature = "simulator")]
    /// Sensor, samples and nuisances of a simulated bench
    Scene,
    /// The settings of the daemon
    Service,
    /// What an impedance analyzer must be told
    Analyzer,
    /// What an axis drive must be told
    Drive,
}

#[derive(Debug, Args)]
pub(super) struct NewArgs {
    #[command(subcommand)]
    what: New,
}

#[derive(Debug, Subcommand)]
enum New {
    /// A protocol with every key and its explanation, which `rigd check` accepts
    Protocol(NewProtocolArgs),
}

#[derive(Debug, Args)]
struct NewProtocolArgs {
    /// File to write, which must not exist; stdout without it. Its name becomes that of the protocol
    file: Option<PathBuf>,
}

const PROTOCOL: &str = include_str!("../../../../config/protocols/three-direction.toml");
const RIG: &str = include_str!("../../../../config/rigs/simulated.toml");
const SERVICE: &str = include_str!("../../../../config/service/service.toml");
/// The files of instruments to start from, which explain every key.
pub(super) const ANALYZER: &str = include_str!("../../../../config/instruments/new-analyzer.toml");
pub(super) const DRIVE: &str = include_str!("../../../../config/instruments/new-drive.toml");
#[cfg(feature = "simulator")]
const SCENE: &str = concat!(
    include_str!("../../../../config/scenes/paper.toml"),
    include_str!("../../../../config/scenes/matched.toml"),
    include_str!("../../../../config/scenes/new-bench.toml")
);

/// Prints the JSON Schema of a kind of file.
pub(super) fn schema(args: &SchemaArgs) -> Result<(), Failure> {
    let (schema, manual) = match args.kind {
        FileKind::Protocol => (Protocol::schema(), PROTOCOL),
        FileKind::Rig => (RigFile::schema(), RIG),
        #[cfg(feature = "simulator")]
        FileKind::Scene => (rig_sim::scene::schema(), SCENE),
        FileKind::Service => (ServiceFile::schema(), SERVICE),
        FileKind::Analyzer => (Dialect::schema(), ANALYZER),
        FileKind::Drive => (RegisterMap::schema(), DRIVE),
    };
    let comments = comments(manual);
    let schema = described(schema, "", &comments);
    if args.markdown {
        let kind = args.kind.to_possible_value();
        let kind = kind.as_ref().map_or("", |kind| kind.get_name());
        return print(reference::page(kind, &schema, &comments).trim_end());
    }
    print(&format!("{schema:#}"))
}

/// Writes a file to start from.
pub(super) fn new(args: &NewArgs) -> Result<(), Failure> {
    let New::Protocol(NewProtocolArgs { file }) = &args.what;
    let name = file.as_ref().and_then(|file| file.file_stem()).map(|stem| stem.to_string_lossy());
    let text = protocol(name.as_deref().unwrap_or("new"));
    let Some(path) = file else { return print(text.trim_end()) };
    let failed = |source: io::Error| Failure::File { path: path.clone(), source };
    let mut out = File::create_new(path).map_err(failed)?;
    out.write_all(text.as_bytes()).map_err(failed)?;
    note(&format!("wrote {}; `rigd check {}` checks it", path.display(), path.display()));
    Ok(())
}

/// The manual of protocols under another name, without what it says about the shipped one.
fn protocol(name: &str) -> String {
    let (_, body) = PROTOCOL.split_once("\nname = ").unwrap_or_default();
    let (_, rest) = body.split_once('\n').unwrap_or_default();
    // JSON and TOML have the same escapes for what the name of a file may hold.
    let name = Value::from(name);
    format!(
        "# A protocol of rigd. `rigd check FILE` says whether a rig can run it, and lists its prompts and\n\
         # its duration. Every key ends in its unit; lengths are in mm, times in s, frequencies in Hz, angles\n\
         # in degrees. `rigd schema protocol > protocol.schema.json` and a first line\n\
         # `#:schema protocol.schema.json` let an editor complete and check the keys.\n\n\
         name = {name}\n{rest}"
    )
}

/// A key of a manual, or a table.
#[derive(Debug)]
struct KeyComment {
    /// With the names of its tables and dots.
    name: String,
    text: String,
    /// Its value in the manual as TOML; empty for a table.
    value: String,
}

/// The comment of each key of a manual, by the dotted name of the key, in the order of the manual.
///
/// It stands behind the key or above it. A key without one has that of the key or of the header before it.
fn comments(manual: &str) -> Vec<KeyComment> {
    let (mut found, mut table, mut block): (Vec<KeyComment>, _, _) =
        (Vec::new(), String::new(), Vec::new());
    let (mut current, mut was_left_out) = (String::new(), false);
    let mut note = |name: String, text: &str, value: &str| {
        if !found.iter().any(|known| known.name == name) {
            found.push(KeyComment { name, text: text.to_owned(), value: value.to_owned() });
        }
    };
    for line in manual.lines() {
        // A key or a table that is left out, with its comment above.
        let has_comment = was_left_out || !block.is_empty();
        let left_out = line.strip_prefix("# ").filter(|text| has_comment && is_toml(text));
        was_left_out = left_out.is_some();
        match left_out.or((!line.starts_with('#')).then_some(line)) {
            // What stands above belongs to the file as a whole.
            None if line.starts_with("#:") => block.clear(),
            None if line.starts_with("# ----") => {}
            None => block.push(line[1..].trim()),
            Some(header) if header.starts_with('[') => {
                header.trim_matches(['[', ']']).clone_into(&mut table);
                current = joined(&block);
                note(table.clone(), &current, "");
                table.push('.');
                block.clear();
            }
            Some(line) if is_toml(line) => {
                let (key, value) = line.split_once(" = ").unwrap_or_default();
                let above = joined(&block);
                let (value, behind) = value.rsplit_once(" # ").unwrap_or((value, ""));
                if !behind.is_empty() {
                    behind.clone_into(&mut current);
                } else if !above.is_empty() {
                    current = above;
                }
                note(format!("{table}{key}"), &current, value);
                block.clear();
            }
            Some(_) => {
                block.clear();
                current.clear();
            }
        }
    }
    found
}

/// The lines of a comment as one text. A word that is explained beside it gets a colon.
fn joined(block: &[&str]) -> String {
    let mut text = block.join(" ").replace("\"  ", "\": ");
    while text.contains("  ") {
        text = text.replace("  ", " ");
    }
    text.trim().to_owned()
}

/// Whether a line is a header or begins with a key.
fn is_toml(line: &str) -> bool {
    line.starts_with("[[")
        || line.starts_with('[') && line.ends_with(']')
        || line.split_once(" = ").is_some_and(|(key, _)| is_key(key))
}

fn is_key(text: &str) -> bool {
    !text.is_empty()
        && text.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}

/// A schema with the comments of its manual as descriptions.
fn described(mut schema: Value, path: &str, comments: &[KeyComment]) -> Value {
    let of_path = |key: &&KeyComment| key.name == path && !key.text.is_empty();
    if let Some(KeyComment { text, .. }) = comments.iter().find(of_path) {
        schema["description"] = text.as_str().into();
    }
    if let Some(items) = schema.get_mut("items") {
        *items = with_keys(items.take(), path, comments);
    }
    with_keys(schema, path, comments)
}

/// The same for the keys of a table.
fn with_keys(mut schema: Value, path: &str, comments: &[KeyComment]) -> Value {
    for (key, value) in
        schema.get_mut("properties").and_then(Value::as_object_mut).into_iter().flatten()
    {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        *value = described(value.take(), &path, comments);
    }
    schema
}
