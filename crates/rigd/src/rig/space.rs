//! Whether the disk has room for a run.

use std::path::Path;

use super::RequestRefusal;

/// Space that must remain in addition to a run, bytes: for the session, the records of faults, and
/// the working files of the database.
pub(crate) const RESERVE_BYTES: u64 = 100 << 20;

/// Refuses a run for which the file system of the data directory has no room. Twice the expected
/// size must be free: the expectation is not a limit. A file system that does not report its free
/// space is accepted, and so is a journal in memory, which has no directory.
pub(crate) fn check(data: Option<&Path>, run_bytes: u64) -> Result<(), RequestRefusal> {
    data.and_then(free_bytes).map_or(Ok(()), |free_bytes| admit(free_bytes, run_bytes))
}

/// Free space of the file system of a directory, bytes; none if the system does not say.
pub(crate) fn free_bytes(data: &Path) -> Option<u64> {
    rig_system::disk::free_bytes(data).ok()
}

fn admit(free_bytes: u64, run_bytes: u64) -> Result<(), RequestRefusal> {
    let needed_bytes = run_bytes.saturating_mul(2).saturating_add(RESERVE_BYTES);
    if free_bytes < needed_bytes {
        return Err(RequestRefusal::NoSpace { free_bytes, run_bytes, needed_bytes });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_refused_unless_twice_its_size_and_the_reserve_are_free() {
        admit(RESERVE_BYTES + 2000, 1000).unwrap();
        let refusal = admit(RESERVE_BYTES + 1999, 1000).unwrap_err();
        assert_eq!(
            refusal.to_string(),
            "the data directory has 104 MB free, and 105 MB are needed: twice the 1 MB that the run may take, and \
             105 MB in reserve for the rest of the journal"
        );
        admit(u64::MAX, u64::MAX).unwrap();
    }
}
