//! The chain of digests: records, the list of runs, and the seal.

use std::fmt::Write as _;

use crate::{
    finding::{Check, Findings},
    journal::{Entry, Journal, Part, Stretch, digest},
};

/// Follows the records of a run: each has the next number, a time not before the last, and a digest
/// over the one before it.
#[derive(Debug)]
pub(crate) struct Chain {
    last: Vec<u8>,
    seq: u64,
    epoch: u64,
    rig_us: u64,
}

impl Chain {
    pub(crate) fn new() -> Self {
        Self { last: vec![0; 32], seq: 0, epoch: 0, rig_us: 0 }
    }

    /// Number of the last record.
    pub(crate) const fn records(&self) -> u64 {
        self.seq
    }

    /// Digest of the last record, in hexadecimal.
    pub(crate) fn digest(&self) -> String {
        if self.seq == 0 { String::new() } else { hex(&self.last) }
    }

    /// `opens` is the epoch that the record says it opens.
    pub(crate) fn follow(&mut self, entry: &Entry, opens: Option<u64>, findings: &mut Findings) {
        self.check_order(entry, opens, findings);
        let Entry { seq, rig_us, kind, payload, digest: stored, .. } = entry;
        let [number, time] = [Part::Number(*seq), Part::Number(*rig_us)];
        let found =
            digest([Part::Digest(&self.last), number, time, Part::Text(kind), Part::Text(payload)]);
        if found[..] != stored[..] {
            let what = "the digest is not that of the record and the one before it";
            findings.add(Check::Digest, *seq, what, hex(&found), hex(stored));
        }
        self.pass(entry);
    }

    /// A record whose content is in an archive: its digest is under that of the next one.
    pub(crate) fn follow_archived(&mut self, entry: &Entry, findings: &mut Findings) {
        self.check_order(entry, None, findings);
        self.pass(entry);
    }

    fn check_order(&self, entry: &Entry, opens: Option<u64>, findings: &mut Findings) {
        let Entry { seq, epoch, rig_us, .. } = entry;
        let next = self.seq + 1;
        if *seq != next {
            let what = "a record is missing or out of order";
            findings.add(Check::Complete, *seq, what, format!("record {next}"), seq);
        }
        let is_first = self.seq == 0;
        if *epoch != self.epoch && !is_first && opens != Some(*epoch) {
            let what = "the epoch changes at a record that opens none";
            findings.add(Check::Time, *seq, what, self.epoch, epoch);
        }
        if *epoch == self.epoch && *rig_us < self.rig_us {
            let what = "the time of the record lies before the one before it, µs";
            findings.add(Check::Time, *seq, what, format!("at least {}", self.rig_us), rig_us);
        }
    }

    fn pass(&mut self, entry: &Entry) {
        let Entry { seq, epoch, rig_us, digest: stored, .. } = entry;
        // From here on against what is stored, so that one flaw is one finding.
        self.last.clone_from(stored);
        (self.seq, self.epoch, self.rig_us) = (*seq, *epoch, *rig_us);
    }

    /// The entry in the list of runs, the stretches and the seal. `ends` tells whether the records end
    /// the run for good.
    pub(crate) fn check_list(&self, journal: &Journal, ends: bool, findings: &mut Findings) {
        let Journal { run, stretches, seal, links, .. } = journal;
        let found = digest(run.parts());
        if found[..] != run.digest[..] {
            let what = "the entry of the run in the list of runs is not what was written";
            findings.add(Check::List, 0, what, hex(&found), hex(&run.digest));
        }
        if let Err(broken) = links {
            let what = "an entry is missing from the list of runs, or was changed";
            findings.add(
                Check::List,
                0,
                what,
                "a link to the entry before",
                format!("run {}", broken.run),
            );
        }
        let mut epochs: Vec<u64> =
            journal.entries.iter().filter(|e| e.is_own).map(|e| e.epoch).collect();
        epochs.dedup();
        let listed: Vec<u64> = stretches.iter().map(|stretch| stretch.epoch).collect();
        if epochs != listed {
            let what = "the stretches of the run are not those of its records";
            findings.add(Check::List, 0, what, format!("{epochs:?}"), format!("{listed:?}"));
        }
        for stretch in stretches {
            let Stretch { epoch, digest: stored, .. } = stretch;
            let found = digest([Part::Text(&run.id)].into_iter().chain(parts(stretch)));
            if found[..] != stored[..] {
                let what = format!("the stretch of epoch {epoch} is not what was written");
                findings.add(Check::List, 0, what, hex(&found), hex(stored));
            }
        }
        let Some(seal) = seal else {
            if ends {
                findings.add(Check::Seal, 0, "a run that has ended for good", "a seal", "none");
            }
            return;
        };
        if !ends {
            findings.add(Check::Seal, 0, "a run that can go on", "no seal", "a seal");
        }
        if seal.records != self.seq || seal.head[..] != self.last[..] {
            let found = format!("{} records, {}", seal.records, hex(&seal.head));
            let expected = format!("{} records, {}", self.seq, hex(&self.last));
            findings.add(Check::Seal, 0, "the end of the run under its seal", expected, found);
        }
        let finished_at = run.finished_at.as_deref().unwrap_or_default();
        let end = [
            Part::Text(finished_at),
            Part::Text(&run.status),
            Part::Number(seal.records),
            Part::Digest(&seal.head),
        ];
        let parts = run.parts().into_iter().chain(stretches.iter().flat_map(parts)).chain(end);
        let found = digest(parts);
        if found[..] != seal.digest[..] {
            let what = "the seal is not that of the run";
            findings.add(Check::Seal, 0, what, hex(&found), hex(&seal.digest));
        }
    }
}

pub(crate) fn parts(stretch: &Stretch) -> [Part<'_>; 3] {
    [Part::Number(stretch.epoch), Part::Text(&stretch.started_at), Part::Number(stretch.rig_us)]
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        // Writing to a string cannot fail.
        _ = write!(text, "{byte:02x}");
        text
    })
}
