//! The queue as a client sees it: what waits, when it begins, and what it asks of a person.

use std::time::SystemTime;

use rig_protocol::{Action, Plan};
use schemars::JsonSchema;
use serde::Serialize;

use crate::{
    describe,
    http::progress::unix_ms,
    loaded_rig::RigFacts,
    protocol_file::LoadedProtocol,
    queue::{Entry, Hold, LateRun, Queue},
    rig::Status,
};

/// The queue.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::http) struct QueueView {
    /// Why nothing begins; absent from a queue that is released.
    #[serde(skip_serializing_if = "Option::is_none")]
    hold: Option<Hold>,
    /// The run of the queue that is under way.
    #[serde(skip_serializing_if = "Option::is_none")]
    run: Option<String>,
    /// In the order in which they begin.
    entries: Vec<EntryView>,
    /// Expected time of all entries on the rig's clock, without the time that a person takes, s.
    duration_s: f64,
    /// How often a person is needed.
    prompts: usize,
    /// Number of entries that can no longer end by their deadline.
    missed: usize,
    /// The last runs that ended after their deadlines, the latest first; at most 20.
    late: Vec<LateRun>,
}

/// An entry of the queue.
#[derive(Debug, Serialize, JsonSchema)]
struct EntryView {
    number: u64,
    /// Name of the protocol.
    protocol: String,
    note: String,
    /// The operator who added it.
    by: String,
    added_unix_ms: u64,
    /// The run must have ended by this time.
    #[serde(skip_serializing_if = "Option::is_none")]
    deadline_unix_ms: Option<u64>,
    /// It can no longer end by its deadline, and does not begin.
    is_missed: bool,
    /// By how much it would end after its deadline if the queue were released now, s; absent if it is in
    /// time, and without a deadline.
    #[serde(skip_serializing_if = "Option::is_none")]
    late_s: Option<f64>,
    /// Expected on the rig's clock, without the time that a person takes, s.
    duration_s: f64,
    /// Expected time until it begins if the queue is released now, s.
    begins_in_s: f64,
    /// What it asks of a person.
    prompts: Vec<EntryPrompt>,
    /// The rig cannot run it: the first fault.
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<String>,
}

/// Something that a person has to do during an entry.
#[derive(Debug, Serialize, JsonSchema)]
struct EntryPrompt {
    prompt: String,
    /// Expected time from the beginning of the entry, s.
    after_s: f64,
}

impl QueueView {
    pub(super) fn new(queue: &Queue, status: &Status, facts: &RigFacts) -> Self {
        let mut begins_in_s = remaining_s(status, facts);
        let now_unix_ms = unix_ms(SystemTime::now());
        let mut entry = |entry: &Entry| {
            let view = EntryView::new(entry, begins_in_s, facts, now_unix_ms);
            if !view.is_missed {
                begins_in_s += view.duration_s;
            }
            view
        };
        let entries: Vec<_> = queue.entries().iter().map(&mut entry).collect();
        let ahead = || entries.iter().filter(|entry| !entry.is_missed);
        let missed = entries.iter().filter(|entry| entry.is_missed).count();
        Self {
            missed,
            late: queue.late().to_vec(),
            hold: queue.hold().cloned(),
            run: queue.run().map(str::to_owned),
            duration_s: ahead().map(|entry| entry.duration_s).sum(),
            prompts: ahead().map(|entry| entry.prompts.len()).sum(),
            entries,
        }
    }
}

impl EntryView {
    fn new(entry: &Entry, begins_in_s: f64, facts: &RigFacts, now_unix_ms: u64) -> Self {
        // Another version of rigd or another rig file may see the protocol otherwise.
        let checked = LoadedProtocol::check(&entry.protocol, &entry.toml, facts);
        let (duration_s, prompts, fault) = match checked {
            Ok(protocol) => {
                let prompts = prompts(&protocol.plan, facts);
                (protocol.summary.duration_s, prompts, None)
            }
            Err(faults) => (0.0, Vec::new(), Some(first(&faults))),
        };
        Self {
            number: entry.number,
            protocol: entry.protocol.clone(),
            note: entry.note.clone(),
            by: entry.by.clone(),
            added_unix_ms: entry.added_unix_ms,
            deadline_unix_ms: entry.deadline_unix_ms,
            is_missed: entry.is_missed || !entry.is_in_time(now_unix_ms, wall_s(facts, duration_s)),
            late_s: entry.late_s(now_unix_ms, wall_s(facts, begins_in_s + duration_s)),
            duration_s,
            begins_in_s,
            prompts,
            fault,
        }
    }
}

/// What a protocol asks of a person, and when.
fn prompts(plan: &Plan, facts: &RigFacts) -> Vec<EntryPrompt> {
    let mut after_s = 0.0;
    let mut prompts = Vec::new();
    for (step, duration_s) in plan.steps.iter().zip(plan.durations_s(&facts.limits)) {
        if let Action::Prompt(prompt) = &step.action {
            prompts.push(EntryPrompt { prompt: describe::prompt(plan, prompt), after_s });
        }
        after_s += duration_s;
    }
    prompts
}

/// The least time until the run under way has ended, s.
fn remaining_s(status: &Status, facts: &RigFacts) -> f64 {
    let run = status.run.as_ref().filter(|run| run.ending.is_none());
    let now = status.present(facts.is_virtual_time);
    run.zip(status.snapshot.progress.as_ref())
        .map_or(0.0, |(run, progress)| run.remaining(progress.step, now).least_s)
}

/// A duration by the clock of the computer: virtual time takes none.
pub(super) const fn wall_s(facts: &RigFacts, duration_s: f64) -> f64 {
    if facts.is_virtual_time { 0.0 } else { duration_s }
}

pub(super) fn first(faults: &rig_files::Faults) -> String {
    faults.to_string().lines().next().unwrap_or_default().to_owned()
}
