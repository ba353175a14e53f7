//! What is left of a run whose readings were moved to an archive.
//!
//! The readings have lost their content and kept their digests. Each record that is left stands between two
//! digests, so that a change of it is found; the end of the chain stands under the seal and in the note.

use rusqlite::Connection;

use crate::{
    chain::Chain,
    finding::{ArchivedPart, Check, Findings, Verdict},
    journal::Journal,
    record::{Archived, Record},
    walk,
};

/// The kinds of records that may have lost their content: readings and frames. Nothing else of a run is
/// asked of them.
const KINDS: [&str; 6] =
    ["sweep", "descended", "surface_found", "surface_not_found", "surface_checked", "black_box"];

/// Checks the records that are left, the list of runs, the seal and the note.
pub(crate) fn check(connection: &Connection, journal: &Journal, note: &Journal) -> Verdict {
    let (mut chain, mut findings) = (Chain::new(), Findings::default());
    let mut archived = 0;
    for entry in journal.entries.iter().filter(|entry| entry.is_own) {
        if entry.payload.is_empty() && KINDS.contains(&&*entry.kind) {
            archived += 1;
            chain.follow_archived(entry, &mut findings);
            continue;
        }
        let record = serde_json::from_str(&entry.payload);
        let opens = match &record {
            Ok(Record::Resumed(resumed)) => Some(resumed.epoch),
            Ok(Record::GivenUp(given_up)) => Some(given_up.epoch),
            Ok(_) => None,
            Err(error) => {
                let what = format!("a record of the kind {}", entry.kind);
                findings.add(Check::Readable, entry.seq, what, "a known kind of record", error);
                None
            }
        };
        chain.follow(entry, opens, &mut findings);
    }
    if let Some(damage) = &journal.damage {
        let what = "the database is damaged behind this record";
        findings.add(Check::Readable, chain.records(), what, "records", damage);
    }
    chain.check_list(journal, true, &mut findings);
    if let Some(finding) = walk::check(connection, note).findings.first() {
        findings.add(Check::Seal, 0, "the note of its archive", "a sound note", finding);
    }
    let place = check_note(journal, note, &chain, &mut findings);
    let (records, digest) = (chain.records(), chain.digest());
    let mut findings = findings.0;
    findings.sort_by_key(|finding| finding.record);
    Verdict {
        run: journal.run.id.clone(),
        is_sound: findings.is_empty(),
        records,
        sweeps: 0,
        digest,
        checker: env!("CARGO_PKG_VERSION").to_owned(),
        archived: Some(ArchivedPart { records: archived, place }),
        findings,
        notes: Vec::new(),
    }
}

/// The note says how the run ended. Returns the place in the archive.
fn check_note(journal: &Journal, note: &Journal, chain: &Chain, findings: &mut Findings) -> String {
    let first = note.entries.iter().find(|entry| entry.is_own);
    let record = first.map(|entry| serde_json::from_str(&entry.payload));
    let Some(Ok(Record::Archived(said))) = record else {
        let what = "the note of its archive";
        findings.add(Check::Seal, 0, what, "where its readings are", "nothing");
        return String::new();
    };
    let Archived { run, records, head, place } = said;
    if (&run, records, &head) != (&journal.run.id, chain.records(), &chain.digest()) {
        let expected =
            format!("run {}, {} records, {}", journal.run.id, chain.records(), chain.digest());
        let found = format!("run {run}, {records} records, {head}");
        findings.add(Check::Seal, 0, "the run in the note of its archive", expected, found);
    }
    place
}
