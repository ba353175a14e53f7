//! What is left of a run whose readings were moved to an archive.
//!
//! The readings have lost their content and kept their digests. Each record that is left stands between two
//! digests, so that a change of it is found; the end of the chain stands under the seal and in the note. Of the results,
//! what needs no readings is checked: the shift, the depth, and that every touch of a completed run has an outcome.

use std::collections::BTreeSet;

use rusqlite::Connection;

use crate::{
    chain::Chain,
    finding::{ArchivedPart, Check, Findings, Verdict},
    journal::Journal,
    labels,
    record::{Archived, Record, Touch, TouchResult},
    walk,
};

/// The kinds of records that have lost their content: readings and frames.
const KINDS: [&str; 6] =
    ["sweep", "descended", "surface_found", "surface_not_found", "surface_checked", "black_box"];

/// The touches of a run and those that have an outcome.
#[derive(Debug, Default)]
struct Outcomes {
    planned: Vec<Touch>,
    done: BTreeSet<String>,
    is_complete: bool,
}

impl Outcomes {
    fn take(&mut self, seq: u64, record: &Record, findings: &mut Findings) {
        match record {
            Record::RunStarted(started) => self.planned.clone_from(&started.touches),
            Record::TouchResult(result) => {
                let &TouchResult { surface_mm, linear_mm, indentation_mm, .. } = &**result;
                labels::check_shift(seq, result, findings);
                labels::check_depth(seq, (surface_mm, linear_mm), indentation_mm, findings);
                self.done(seq, &result.touch, findings);
            }
            Record::TouchRefused(refused) => self.done(seq, &refused.touch, findings),
            Record::RunFinished(finished) => {
                self.is_complete = finished.status.starts_with("completed");
            }
            _ => {}
        }
    }

    fn done(&mut self, seq: u64, touch: &Touch, findings: &mut Findings) {
        if !self.planned.is_empty() && !self.planned.contains(touch) {
            let (what, found) = ("the touch of an outcome", format!("{touch:?}"));
            findings.add(Check::Row, seq, what, "one of the plan", found);
        }
        self.done.insert(touch.step.clone());
    }

    /// `elsewhere` are the touches that need no outcome in the run itself.
    fn end<'a>(
        &self,
        seq: u64,
        elsewhere: impl Iterator<Item = &'a String>,
        findings: &mut Findings,
    ) {
        let elsewhere: BTreeSet<&String> = elsewhere.collect();
        for Touch { step, .. } in self.planned.iter().filter(|_| self.is_complete) {
            if !self.done.contains(step) && !elsewhere.contains(step) {
                let what = format!("touch {step} of a completed run");
                findings.add(Check::Row, seq, what, "a result or a refusal", "none");
            }
        }
    }
}

/// Checks the records that are left, the list of runs, the seal and the note.
pub(crate) fn check(connection: &Connection, journal: &Journal, note: &Journal) -> Verdict {
    let (mut chain, mut findings) = (Chain::new(), Findings::default());
    let (mut archived, mut outcomes) = (0, Outcomes::default());
    for entry in journal.entries.iter().filter(|entry| entry.is_own) {
        if KINDS.contains(&&*entry.kind) {
            if !entry.payload.is_empty() {
                let what = format!("a record of the kind {} of an archived run", entry.kind);
                findings.add(Check::Seal, entry.seq, what, "in its archive", "here");
            }
            archived += 1;
            chain.follow_archived(entry, &mut findings);
            continue;
        }
        let record = serde_json::from_str(&entry.payload);
        if let Ok(record) = &record {
            outcomes.take(entry.seq, record, &mut findings);
        }
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
    outcomes.end(chain.records(), journal.elsewhere(), &mut findings);
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

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    /// The checks that find something in a run of one touch whose result was changed, if it has one.
    fn found(status: &str, result: Option<fn(&mut Value)>) -> Vec<Check> {
        let touch = |step: &str| {
            json!({
                "step": step, "phase": "main", "sample": "1", "repeat": 1,
                "pose": { "direction": "front", "angle_deg": 0.0 },
            })
        };
        let mut outcomes = Outcomes {
            planned: vec![serde_json::from_value(touch("main/1")).unwrap()],
            ..Outcomes::default()
        };
        let mut findings = Findings::default();
        let mut take = |payload: Value| {
            let record = serde_json::from_value(payload).unwrap();
            outcomes.take(1, &record, &mut findings);
        };
        if let Some(change) = result {
            let mut payload = json!({
                "kind": "touch_result", "touch": touch("main/1"), "no_load_sweep": 1, "sweep": 2,
                "no_load_hz": 140.0, "no_load_sigma_hz": 3.0, "resonance_hz": 150.0, "sigma_hz": 4.0,
                "shift_hz": 10.0, "shift_sigma_hz": 5.0, "surface_mm": 30.0, "surface_sigma_mm": 0.01,
                "indentation_mm": 0.5, "linear_mm": 29.5, "rotary_deg": 0.0,
            });
            change(&mut payload);
            take(payload);
        }
        take(json!({ "kind": "run_finished", "status": status }));
        outcomes.end(2, ["main/2".to_owned()].iter(), &mut findings);
        findings.0.iter().map(|finding| finding.check).collect()
    }

    #[test]
    fn what_needs_no_readings_is_checked() {
        let none: &[Check] = &[];
        assert_eq!(found("completed", Some(|_| {})), none);
        assert_eq!(found("completed", None), [Check::Row]);
        assert_eq!(found("aborted", None), none);
        let shift = found("completed", Some(|result| result["shift_hz"] = json!(10.1)));
        assert_eq!(shift, [Check::Shift]);
        let depth = found("completed", Some(|result| result["indentation_mm"] = json!(0.4)));
        assert_eq!(depth, [Check::Indentation]);
        let other = found("completed", Some(|result| result["touch"]["sample"] = json!("2")));
        assert_eq!(other, [Check::Row]);
    }
}
