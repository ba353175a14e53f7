//! Digests of the list of runs: its entries, and the seals of ended runs.

use crate::{
    Digest,
    DigestPart::{self, Number, Text},
};

/// An entry of the list of runs at the start of the run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ListEntry {
    /// Id of the bench, a UUID.
    pub bench: String,
    /// Id of the journal in which the run was made, a UUID.
    pub journal: String,
    /// Id of the run.
    pub run: String,
    /// Kind of the run.
    pub kind: String,
    /// Name of the run.
    pub name: String,
    /// Format of its records.
    pub format: u64,
    /// Number of the epoch in which it began.
    pub epoch: u64,
    /// When it began: UTC, RFC 3339 with milliseconds.
    pub started_at: String,
}

impl ListEntry {
    fn parts(&self) -> [DigestPart<'_>; 8] {
        [
            Text(&self.bench),
            Text(&self.journal),
            Text(&self.run),
            Text(&self.kind),
            Text(&self.name),
            Number(self.format),
            Number(self.epoch),
            Text(&self.started_at),
        ]
    }

    /// SHA-256 over the fields, in their order.
    pub fn digest(&self) -> Digest {
        Digest::of(self.parts())
    }
}

/// A part of a run on one clock.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stretch {
    /// Number of the epoch whose clock it is.
    pub epoch: u64,
    /// When it began: UTC, RFC 3339 with milliseconds.
    pub started_at: String,
    /// When it began, on the rig's clock, µs.
    pub rig_us: u64,
}

impl Stretch {
    fn parts(&self) -> [DigestPart<'_>; 3] {
        [Number(self.epoch), Text(&self.started_at), Number(self.rig_us)]
    }

    /// SHA-256 over the id of the run and the fields, in their order.
    pub fn digest(&self, run: &str) -> Digest {
        Digest::of([Text(run)].into_iter().chain(self.parts()))
    }
}

/// The seal of an ended run: SHA-256 over the fields of its entry, its stretches in order, each with
/// its three fields, and then the end, the status, the number of records and the last digest.
pub fn seal(
    entry: &ListEntry,
    stretches: &[Stretch],
    finished_at: &str,
    status: &str,
    records: u64,
    head: Digest,
) -> Digest {
    let end = [Text(finished_at), Text(status), Number(records), DigestPart::Digest(head)];
    let stretches = stretches.iter().flat_map(Stretch::parts);
    Digest::of(entry.parts().into_iter().chain(stretches).chain(end))
}

/// What the seal of an ended run covers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SealedRun {
    /// Its entry in the list of runs.
    pub entry: ListEntry,
    /// Its stretches, in order.
    pub stretches: Vec<Stretch>,
    /// When it ended: UTC, RFC 3339 with milliseconds.
    pub finished_at: String,
    /// How it ended.
    pub status: String,
    /// Number of records.
    pub records: u64,
    /// Digest of the last record.
    pub head: Digest,
}

impl SealedRun {
    /// The seal over all of it.
    pub fn seal(&self) -> Digest {
        let Self { entry, stretches, finished_at, status, records, head } = self;
        seal(entry, stretches, finished_at, status, *records, *head)
    }
}
