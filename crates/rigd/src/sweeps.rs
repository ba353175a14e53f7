//! Sweeps on request, from the journals of the sessions.

use rig_store::{Reader, Record, Run, RunId, RunKind, StoreError, Sweep};

/// The sweep with this number in a session or in an earlier one of the same daemon, if it has been
/// finished.
///
/// # Errors
/// The error of the journal.
pub(crate) fn find(
    reader: &Reader,
    session: RunId,
    number: u64,
) -> Result<Option<Sweep>, StoreError> {
    let epoch = reader.run(session)?.epoch;
    let is_of_daemon = |run: &Run| run.kind == RunKind::Session && run.epoch == epoch;
    for session in reader.runs()?.into_iter().filter(is_of_daemon) {
        for stored in reader.records(session.id)? {
            if stored.kind == "sweep"
                && let Record::Sweep(sweep) = stored.record()?
                && sweep.number == number
            {
                return Ok(Some(sweep));
            }
        }
    }
    Ok(None)
}
