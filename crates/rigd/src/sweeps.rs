//! Sweeps on request, from the journal of a session.

use rig_store::{Reader, Record, RunId, StoreError, Sweep};

/// The sweep with this number, if it has been finished.
///
/// # Errors
/// The error of the journal.
pub(crate) fn find(
    reader: &Reader,
    session: RunId,
    number: u64,
) -> Result<Option<Sweep>, StoreError> {
    for stored in reader.records(session)? {
        if stored.kind == "sweep"
            && let Record::Sweep(sweep) = stored.record()?
            && sweep.number == number
        {
            return Ok(Some(sweep));
        }
    }
    Ok(None)
}
