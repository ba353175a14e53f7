//! Forged digests and a forged list of runs.

use rig_verify::Check;

use super::Case;

pub(super) const CASES: &[Case] = &[
    ("a wrong digest", Check::Digest, |forged| {
        forged.execute("UPDATE records SET digest = zeroblob(32) WHERE run = ?1 AND seq = 40");
    }),
    ("a record taken out", Check::Complete, |forged| {
        forged.execute("DELETE FROM records WHERE run = ?1 AND seq = 40");
    }),
    ("a record taken out and the rest renumbered", Check::Digest, |forged| {
        forged.execute("DELETE FROM records WHERE run = ?1 AND seq = 40");
        forged.execute("UPDATE records SET seq = -seq WHERE run = ?1 AND seq > 40");
        forged.execute("UPDATE records SET seq = -seq - 1 WHERE run = ?1 AND seq < 0");
    }),
    ("the end taken off", Check::Ends, |forged| {
        forged.execute(
            "DELETE FROM records WHERE run = ?1
             AND seq = (SELECT max(seq) FROM records WHERE run = ?1)",
        );
    }),
    ("a time without its digest", Check::Digest, |forged| {
        forged.execute("UPDATE records SET rig_us = rig_us + 1 WHERE run = ?1 AND seq = 40");
    }),
    ("another epoch", Check::Time, |forged| {
        forged.execute("UPDATE records SET epoch = 2 WHERE run = ?1 AND seq > 40");
    }),
    ("another name in the list of runs", Check::List, |forged| {
        forged.execute("UPDATE runs SET name = 'other' WHERE key = ?1");
    }),
    ("another begin in the list of runs", Check::List, |forged| {
        forged.execute("UPDATE runs SET started_at = '2026-01-01T00:00:00.000Z' WHERE key = ?1");
    }),
    ("an entry before it taken out of the list of runs", Check::List, |forged| {
        forged.execute("DELETE FROM runs WHERE key = ?1 - 1");
    }),
    ("another begin of a stretch", Check::List, |forged| {
        forged.execute("UPDATE stretches SET rig_us = rig_us + 1 WHERE run = ?1");
    }),
    ("no stretch", Check::List, |forged| forged.execute("DELETE FROM stretches WHERE run = ?1")),
    ("another end in the list of runs", Check::Ends, |forged| {
        forged.execute("UPDATE runs SET status = 'aborted' WHERE key = ?1");
    }),
    ("another time of the end", Check::Seal, |forged| {
        forged.execute("UPDATE runs SET finished_at = '2026-01-01T00:00:00.000Z' WHERE key = ?1");
    }),
    ("no seal", Check::Seal, |forged| forged.execute("DELETE FROM seals WHERE run = ?1")),
    ("a seal of fewer records", Check::Seal, |forged| {
        forged.execute("UPDATE seals SET records = records - 1 WHERE run = ?1");
    }),
    ("a record of a session between those of a run", Check::OneWriter, |forged| {
        // Places for one more.
        forged.execute(
            "UPDATE records SET id = -id WHERE id > (SELECT id FROM records WHERE run = ?1 AND seq = 40)",
        );
        forged.execute("UPDATE records SET id = 1 - id WHERE id < ?1 - ?1");
        forged.execute(
            "INSERT INTO records SELECT (SELECT id + 1 FROM records WHERE run = ?1 AND seq = 40),
                 run, 1000, epoch, rig_us, kind, payload, digest FROM records
             WHERE run != ?1 AND kind = 'moved' LIMIT 1",
        );
    }),
];
