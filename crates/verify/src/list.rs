//! Times in the list of runs: those of a run, of its id and of its stretches agree.

use crate::{
    finding::{Check, Findings},
    journal::{Journal, Stretch},
    object::unix_ms,
};

/// A run gets its id, and a moment later its place in the list with the time. The computer may be held up in between, ms.
const HELD_UP_MS: u64 = 60_000;

/// Checks the times of a run. A jump of the wall clock that a record tells of explains them; the record may be of the session
/// around the run, or of a run in the session.
pub(crate) fn check(journal: &Journal, findings: &mut Findings) {
    let Journal { run, stretches, entries, .. } = journal;
    let has_jumped = entries.iter().any(|entry| entry.kind == "clock_jumped");
    let mut add = |what: &str, expected: &str, found: &str| {
        findings.add(Check::List, 0, what, expected, found);
    };
    let Some(started_ms) = unix_ms(&run.started_at) else {
        add("the time at which the run began", "a time", &run.started_at);
        return;
    };
    let of_id = id_ms(&run.id);
    if let Some(id_ms) = of_id.filter(|id| HELD_UP_MS < id.abs_diff(started_ms) && !has_jumped) {
        let what = "the time at which the run began, and that of its id, ms";
        add(what, &id_ms.to_string(), &started_ms.to_string());
    }
    // A run that goes on may do so after the clock was set.
    let finished_ms = run.finished_at.as_deref().and_then(unix_ms);
    if stretches.len() == 1 && !has_jumped && finished_ms.is_some_and(|end| end < started_ms) {
        let finished_at = run.finished_at.as_deref().unwrap_or_default();
        add("the time at which the run ended", "after its begin", finished_at);
    }
    if stretches.first().is_some_and(|first| first.started_at != run.started_at) {
        add("the begin of the first stretch", &run.started_at, &stretches[0].started_at);
    }
    for Stretch { epoch, rig_us, .. } in stretches {
        let first = entries.iter().find(|entry| entry.is_own && entry.epoch == *epoch);
        if let Some(first) = first.filter(|first| first.rig_us < *rig_us) {
            let what = "the begin of a stretch on the rig's clock, µs";
            let expected = format!("at most {}", first.rig_us);
            findings.add(Check::Time, first.seq, what, expected, rig_us);
        }
    }
}

/// The time in an id of version 7, ms since 1970; `None` for another id.
fn id_ms(id: &str) -> Option<i64> {
    let (high, rest) = id.split_once('-')?;
    let (low, rest) = rest.split_once('-')?;
    let is_timed = high.len() == 8 && low.len() == 4 && rest.starts_with('7');
    is_timed.then(|| i64::from_str_radix(&format!("{high}{low}"), 16).ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_has_its_time() {
        let id = "01a21f8c-ab92-7147-828b-7d26ac22adb9";
        assert_eq!(id_ms(id), unix_ms("2026-11-28T00:27:22.386Z"));
        assert_eq!(id_ms("01a21f8c-ab92-4147-828b-7d26ac22adb9"), None);
        assert_eq!(id_ms("a run"), None);
    }
}
