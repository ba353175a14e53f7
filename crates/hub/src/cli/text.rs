//! What is printed for a person.

use crate::{State, doctor::Finding};

/// Each bench in a line, the last pruning, live messages, and each alarm.
pub(super) fn status(state: &State) -> String {
    let mut lines = vec![format!(
        "{:<24} {:>20} {:>7} {:>7} {:>7} {:>10} {:>7}",
        "bench", "last seen", "runs", "sealed", "pruned", "records", "aside"
    )];
    lines.extend(state.benches.iter().map(|bench| {
        format!(
            "{:<24} {:>20} {:>7} {:>7} {:>7} {:>10} {:>7}",
            bench.bench,
            bench.last_seen.as_deref().unwrap_or("never"),
            bench.runs,
            bench.sealed,
            bench.pruned,
            bench.records,
            bench.clashes
        )
    }));
    lines.push(match &state.pruning {
        None => "records were never pruned".to_owned(),
        Some(last) => format!(
            "last pruning {}: {} records of {} runs removed, older than {} days and in {}; {} runs stayed",
            last.at, last.records, last.runs, last.keep_days, last.objects, last.stayed
        ),
    });
    if let Some(live) = &state.live {
        let heard = if live.heard.is_empty() { "no rig".to_owned() } else { live.heard.join(", ") };
        lines.push(match &live.error {
            Some(error) => format!("no live messages: {error}"),
            None => format!("heard by {}: {heard}", live.address),
        });
    }
    for alarm in &state.alarms {
        lines.push(format!(
            "alarm {}: {} of {}, {} ({} times, last {}): {}",
            alarm.id,
            alarm.kind,
            alarm.bench.as_deref().unwrap_or("nobody"),
            alarm.subject,
            alarm.times,
            alarm.last_at,
            alarm.detail
        ));
    }
    lines.join("\n")
}

/// A finding, and the advice below it.
pub(super) fn finding(finding: &Finding) -> String {
    let advice = finding.advice.map(|advice| format!("\n         → {advice}"));
    format!(
        "{:<8} {}: {}{}",
        finding.level.name(),
        finding.check,
        finding.text,
        advice.unwrap_or_default()
    )
}
