//! What is in the folder of a run and where it comes from: for programs (`manifest.json`,
//! `ro-crate-metadata.json`) and for people (`README.md`).

use std::fmt::Write as _;

use rig_record::{Record, StoredRecord};
use rig_report::{
    RunResults,
    export::{TableFormat, TableName},
};
use rig_store::Chain;
use rig_verify::Verdict;
use serde::Serialize;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

/// Version of the folder: its files, and the keys of the manifest.
const FORMAT: u32 = 1;

/// A file of the folder.
#[derive(Debug, Clone, Serialize)]
pub(super) struct FolderFile {
    pub(super) name: String,
    bytes: u64,
    sha256: String,
    media_type: &'static str,
    description: String,
}

impl FolderFile {
    pub(super) fn new(name: &str, bytes: &[u8]) -> Self {
        let sha256 = Sha256::digest(bytes);
        let (media_type, description) = described(name);
        Self {
            name: name.to_owned(),
            bytes: bytes.len() as u64,
            sha256: rig_store::Digest::from_bytes(sha256.into()).to_string(),
            media_type,
            description,
        }
    }

    /// The file in an RO-Crate.
    fn entity(&self) -> Value {
        json!({
            "@id": self.name,
            "@type": "File",
            "name": self.name,
            "description": self.description,
            "encodingFormat": self.media_type,
            "contentSize": self.bytes.to_string(),
            "sha256": self.sha256,
        })
    }
}

pub(super) const MANIFEST: &str = "manifest.json";
pub(super) const RO_CRATE: &str = "ro-crate-metadata.json";
pub(super) const README: &str = "README.md";

/// The files of the folder other than the tables, each with its media type and its contents.
const FILES: [(&str, &str, &str); 10] = [
    (README, "text/markdown", "This page: the files and the columns of the tables."),
    ("report.html", "text/html", "The report: results, figures and provenance, for a browser."),
    ("run.toml", "application/toml", "The protocol, as it was read when the run began."),
    ("rig.toml", "application/toml", "The rig file, as it was read when the run began."),
    ("scene.toml", "application/toml", "The scene of the simulated bench."),
    (
        "records.jsonl",
        "application/jsonl",
        "Every record of the journal of the run, one JSON object a line, with its digest.",
    ),
    (
        "documents.jsonl",
        "application/jsonl",
        "The run in the event model of bluesky: a stream of touches, and one of sweeps.",
    ),
    ("verify.json", "application/json", "The verdict of the checker on the journal."),
    (MANIFEST, "application/json", "Provenance, and the SHA-256 of every other file."),
    (RO_CRATE, "application/ld+json", "Provenance and files as an RO-Crate."),
];

/// Whether rigd writes a file of this name.
pub(super) fn is_own(name: &str) -> bool {
    let is_table = |(stem, extension): (&str, &str)| {
        TableName::ALL.iter().any(|table| table.name() == stem)
            && TableFormat::ALL.iter().any(|format| format.extension() == extension)
    };
    FILES.iter().any(|(own, ..)| *own == name) || name.split_once('.').is_some_and(is_table)
}

/// Media type and contents of a file.
fn described(name: &str) -> (&'static str, String) {
    if let Some((_, media_type, description)) = FILES.iter().find(|(own, ..)| *own == name) {
        return (media_type, (*description).to_owned());
    }
    let stem = name.split('.').next().unwrap_or_default();
    let table = TableName::ALL.into_iter().find(|table| table.name() == stem);
    let media_type =
        if name.ends_with(".parquet") { "application/vnd.apache.parquet" } else { "text/csv" };
    (media_type, table.map(TableName::description).unwrap_or_default().to_owned())
}

/// The commit in the name of a software, such as `rigd 0.1.0 (65dbd97c95, changed)`.
fn commit(software: &str) -> Option<&str> {
    let (_, commit) = software.split_once('(')?;
    Some(commit.split([',', ')']).next()?.trim())
}

/// The run as its files tell of it.
pub(super) struct Origin<'a> {
    pub(super) results: &'a RunResults,
    pub(super) chain: &'a Chain,
    pub(super) verdict: &'a Verdict,
    operators: Vec<String>,
    /// Ids of the journal and of the bench.
    journal: (String, String),
}

impl<'a> Origin<'a> {
    /// `records` are those of the run with those of its amendments behind them.
    pub(super) fn new(
        results: &'a RunResults,
        chain: &'a Chain,
        records: &[StoredRecord],
        verdict: &'a Verdict,
        journal: (String, String),
    ) -> Self {
        let mut operators: Vec<String> = Vec::new();
        for stored in records {
            let who = match stored.record() {
                Ok(Record::Operator(operator)) => operator.who,
                Ok(Record::PromptAnswered(answered)) => answered.by,
                Ok(Record::Amended(amended)) => amended.who,
                Ok(Record::Resumed(resumed)) => resumed.who,
                Ok(Record::GivenUp(given_up)) => given_up.who,
                _ => continue,
            };
            if !operators.contains(&who) {
                operators.push(who);
            }
        }
        Self { results, chain, verdict, operators, journal }
    }

    /// `manifest.json`.
    pub(super) fn manifest(&self, files: &[FolderFile]) -> Value {
        let (run, started) = (self.results.run(), self.results.started());
        json!({
            "format": FORMAT,
            "run_id": run.id.to_string(),
            "name": run.short_name(),
            "protocol": run.name,
            "status": run.status.name(),
            "is_simulated": started.is_some_and(|started| started.is_simulated),
            "is_sealed": run.is_sealed,
            "started_at": run.started_at,
            "finished_at": run.finished_at,
            "operators": self.operators,
            "rig": started.map(|started| &started.rig.name),
            "scene": started.and_then(|started| Some(&started.scene.as_ref()?.name)),
            "samples": started.map(|started| &started.samples),
            "devices": started.map(|started| &started.devices),
            "software": started.map(|started| &started.software),
            "commit": started.and_then(|started| commit(&started.software)),
            "journal_id": self.journal.0,
            "bench_id": self.journal.1,
            "seed": started.map(|started| started.seed),
            "records": self.chain.records.len(),
            "digest": self.chain.records.last().map(|last| last.digest.to_string()),
            "amendments": run.amendments,
            "is_sound": self.verdict.is_sound,
            "findings": self.verdict.findings.iter().map(ToString::to_string).collect::<Vec<_>>(),
            "checker": self.verdict.checker,
            "files": files,
        })
    }

    /// `ro-crate-metadata.json`: the folder as a data set, the run as the action that made it.
    ///
    /// # Source
    /// RO-Crate 1.1, <https://w3id.org/ro/crate/1.1>: root data entity, data entities, provenance.
    pub(super) fn ro_crate(&self, files: &[FolderFile]) -> Value {
        let (run, started) = (self.results.run(), self.results.started());
        let id = |id: &str| json!({ "@id": id });
        let part = |file: &FolderFile| id(&file.name);
        let (parts, name): (Vec<_>, _) = (files.iter().map(part).collect(), run.short_name());
        let agent = |index: usize| format!("#operator-{}", index + 1);
        let agents: Vec<Value> = (0..self.operators.len()).map(|index| id(&agent(index))).collect();
        let mut graph = vec![
            json!({
                "@id": RO_CRATE,
                "@type": "CreativeWork",
                "about": id("./"),
                "conformsTo": id("https://w3id.org/ro/crate/1.1"),
            }),
            json!({
                "@id": "./",
                "@type": "Dataset",
                "identifier": run.id.to_string(),
                "name": name,
                "description": self.sentence(),
                "datePublished": run.finished_at.as_ref().unwrap_or(&run.started_at),
                "author": agents,
                "license": id("#licence"),
                "hasPart": parts,
                "mentions": id("#run"),
            }),
            json!({
                "@id": "#licence",
                "@type": "CreativeWork",
                "name": "no licence stated",
                "description": "rigd states no licence for the data; ask the laboratory.",
            }),
        ];
        for (index, operator) in self.operators.iter().enumerate() {
            graph.push(json!({ "@id": agent(index), "@type": "Person", "name": operator }));
        }
        let mut instruments = Vec::new();
        for device in started.iter().flat_map(|started| &started.devices) {
            let instrument = format!("#{}", device.role.replace(' ', "-"));
            graph.push(json!({
                "@id": instrument, "@type": "Thing", "name": device.role,
                "description": device.identity,
            }));
            instruments.push(id(&instrument));
        }
        if let Some(started) = started {
            graph.push(json!({
                "@id": "#software", "@type": "SoftwareApplication",
                "name": "rigd", "softwareVersion": started.software,
            }));
            instruments.push(id("#software"));
        }
        graph.push(json!({
            "@id": "#run",
            "@type": "CreateAction",
            "name": format!("run {name}"),
            "description": self.verdict.sentence(),
            "startTime": run.started_at,
            "endTime": run.finished_at,
            "agent": agents,
            "instrument": instruments,
            "object": id("run.toml"),
            "result": parts,
        }));
        graph.extend(files.iter().map(FolderFile::entity));
        json!({ "@context": "https://w3id.org/ro/crate/1.1/context", "@graph": graph })
    }

    /// `README.md`.
    pub(super) fn readme(&self, names: &[String]) -> String {
        let name = self.results.run().short_name();
        let mut text = format!("# {name}\n\n{}\n\n## Files\n\n", self.sentence());
        for name in
            [README].into_iter().chain(names.iter().map(String::as_str)).chain([RO_CRATE, MANIFEST])
        {
            _ = writeln!(text, "- `{name}`: {}", described(name).1);
        }
        text += "\nEach table is there as CSV and as Parquet. Units are UCUM; Parquet files have units and \
                 meanings under the key `rigd:columns`. In CSV, text is in quotes and a missing value is \
                 empty.\n";
        for table in TableName::ALL {
            _ = write!(
                text,
                "\n## {}\n\n{}\n\n{}",
                table.name(),
                table.description(),
                table.dictionary()
            );
        }
        text
    }

    /// The run in a few sentences.
    fn sentence(&self) -> String {
        let (run, started) = (self.results.run(), self.results.started());
        let bench = match started {
            Some(started) if started.is_simulated => "a SIMULATED bench",
            Some(_) => "a real bench",
            None => "an unknown bench",
        };
        let touches = self
            .results
            .shortfall()
            .unwrap_or_else(|| format!("all {} touches measured", self.results.touches().len()));
        format!(
            "Run {} of the protocol `{}` on {bench}, begun {}, {}: {touches}. The journal is {}. Id {}.",
            run.short_name(),
            run.name,
            run.started_at,
            run.status.describe(),
            self.verdict.sentence(),
            run.id,
        )
    }
}
