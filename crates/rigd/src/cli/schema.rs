//! `rigd schema` and `rigd new`: the form of the files that a person writes.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, Write},
    path::PathBuf,
};

use clap::{Args, Subcommand, ValueEnum};
use rig_files::rig_file::RigFile;
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
}

/// A kind of file that a person writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FileKind {
    /// What to measure
    Protocol,
    /// The devices, axes, limits and sensor of a bench
    Rig,
    /// Sensor, samples and nuisances of a simulated bench
    Scene,
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
const SCENE: &str = include_str!("../../../../config/scenes/paper.toml");

/// Prints the JSON Schema of a kind of file.
pub(super) fn schema(args: &SchemaArgs) -> Result<(), Failure> {
    let (schema, manual) = match args.kind {
        FileKind::Protocol => (Protocol::schema(), PROTOCOL),
        FileKind::Rig => (RigFile::schema(), RIG),
        FileKind::Scene => (rig_sim::scene::schema(), SCENE),
    };
    print(&format!("{:#}", described(schema, "", &comments(manual))))
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

/// The comment above each key of a manual, by the dotted name of the key.
fn comments(manual: &str) -> BTreeMap<String, String> {
    let (mut found, mut table, mut block) = (BTreeMap::new(), String::new(), Vec::new());
    for line in manual.lines() {
        if let Some(text) = line.strip_prefix('#') {
            let is_key = text.trim_start().split_once(" = ").is_some_and(|(key, _)| is_key(key));
            if is_key && !block.is_empty() {
                // A key that is left out, with its comment above.
                let key = text.trim_start().split(' ').next().unwrap_or_default();
                found.entry(format!("{table}{key}")).or_insert_with(|| block.join(" "));
                block.clear();
            } else if !text.starts_with(" ----") {
                block.push(text.trim().to_owned());
            }
            continue;
        }
        if let Some(header) = line.strip_prefix('[') {
            header.trim_matches(['[', ']']).clone_into(&mut table);
            found.entry(table.clone()).or_insert_with(|| block.join(" "));
            table.push('.');
        } else if let Some((key, _)) = line.split_once(" = ")
            && is_key(key)
        {
            found.entry(format!("{table}{key}")).or_insert_with(|| block.join(" "));
        }
        block.clear();
    }
    found.retain(|_, text| !text.is_empty());
    found
}

fn is_key(text: &str) -> bool {
    !text.is_empty()
        && text.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}

/// A schema with the comments of its manual as descriptions.
fn described(mut schema: Value, path: &str, comments: &BTreeMap<String, String>) -> Value {
    if let Some(text) = comments.get(path) {
        schema["description"] = text.as_str().into();
    }
    if let Some(items) = schema.get_mut("items") {
        *items = with_keys(items.take(), path, comments);
    }
    with_keys(schema, path, comments)
}

/// The same for the keys of a table.
fn with_keys(mut schema: Value, path: &str, comments: &BTreeMap<String, String>) -> Value {
    for (key, value) in
        schema.get_mut("properties").and_then(Value::as_object_mut).into_iter().flatten()
    {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        *value = described(value.take(), &path, comments);
    }
    schema
}
