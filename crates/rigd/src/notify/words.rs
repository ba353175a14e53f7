//! What is told: records of the journal as notes, and notes as JSON.

use rig_files::service_file::EventKind;
use rig_model::counted;
use rig_store::{Clearance, Ending, Fault, Prompt, Reader, Record, RunId, RunKind, StoreError};
use serde_json::{Value, json};

use super::outbox::{Message, Note};
use crate::{describe, loaded_rig::RigFacts};

/// The kinds of records that are news or answers.
pub(super) const KINDS: [&str; 7] = [
    "prompt_asked",
    "prompt_answered",
    "refusal_asked",
    "refusal_answered",
    "touch_refused",
    "fault",
    "run_finished",
];

/// A run or session as people know it.
#[derive(Debug, Clone)]
pub(super) struct RunName {
    id: RunId,
    rig: String,
    is_simulated: bool,
    /// Such as `smoke-3`; `None` for a session or an amendment.
    name: Option<String>,
}

impl RunName {
    /// A run or session of this rig.
    ///
    /// # Errors
    /// [`StoreError`] of the journal.
    pub(super) fn read(reader: &Reader, id: RunId, rig: &RigFacts) -> Result<Self, StoreError> {
        let run = reader.run(id)?;
        let name = (run.kind == RunKind::Run).then(|| run.short_name());
        Ok(Self { id, rig: rig.name.clone(), is_simulated: rig.is_simulated, name })
    }

    /// Whether it is a run, and not a session or an amendment.
    pub(super) const fn is_run(&self) -> bool {
        self.name.is_some()
    }

    fn note(&self, event: EventKind, what: &str, text: &str, asked_at: Option<&str>) -> Note {
        let simulated = if self.is_simulated { " (simulated)" } else { "" };
        let of_run = self.name.as_ref().map(|name| format!("\nRun: {name}")).unwrap_or_default();
        Note {
            event: event.name().to_owned(),
            journal_event: 0,
            run_id: self.id.to_string(),
            run: self.name.clone(),
            asked_at: asked_at.map(str::to_owned),
            title: format!("{}{simulated}: {what}", self.rig),
            text: format!("{text}{of_run}"),
            rig: self.rig.clone(),
            is_simulated: self.is_simulated,
            unix_ms: 0,
        }
    }

    pub(super) fn prompt(&self, step: &str, prompt: &Prompt) -> Note {
        let text = describe::recorded_prompt(prompt);
        self.note(EventKind::Prompt, "a person is needed", &text, Some(step))
    }

    pub(super) fn refused(&self, step: &str, reason: &str, is_asked: bool) -> Note {
        let (what, then) = if is_asked {
            ("a touch was refused, and a person is asked", " It waits for an answer.")
        } else {
            ("a touch was refused", "")
        };
        let text = format!("Touch {step} was refused: {reason}.{then}");
        self.note(EventKind::Refused, what, &text, is_asked.then_some(step))
    }

    pub(super) fn fault(&self, fault: &Fault) -> Note {
        let Fault { cause, probe, hint, .. } = fault;
        let probe = match probe {
            Clearance::Clear => "clear",
            Clearance::InContact => "lowered, and may be in contact",
            Clearance::Unknown => "not shown to be clear",
        };
        let text = format!("{cause}.\nThe probe is {probe}.\nTo do: {hint}.");
        self.note(EventKind::Fault, "fault, the rig is latched", &text, None)
    }

    /// # Errors
    /// [`StoreError`] of the journal.
    pub(super) fn end(&self, reader: &Reader, ending: Ending) -> Result<Note, StoreError> {
        let results = reader.unchecked(self.id, &["touch_result", "touch_refused"])?;
        let refused = results
            .iter()
            .filter(|stored| matches!(stored.record(), Ok(Record::TouchRefused(_))))
            .count();
        let measured = results.len() - refused;
        let status = ending.name().replace('_', " ");
        let touches = counted(measured, "touch");
        let text = format!("The run is {status}: {touches} measured, {refused} refused.");
        Ok(self.note(EventKind::End, &format!("run {status}"), &text, None))
    }
}

/// The body for a webhook.
pub(super) fn webhook(message: &Message) -> Value {
    let Note {
        event,
        journal_event,
        run_id,
        run,
        asked_at,
        rig,
        is_simulated,
        title,
        text,
        unix_ms,
    } = &message.note;
    json!({
        "id": format!("{journal_event}-{}", message.number),
        "event": event,
        "title": title,
        "text": text,
        "rig": rig,
        "is_simulated": is_simulated,
        "run": run,
        "run_id": run_id,
        "asked_at": asked_at,
        "unix_ms": unix_ms,
    })
}

/// The address and the body for ntfy, whose topic is the last part of the URL.
pub(super) fn ntfy(url: &str, message: &Message) -> Option<(String, Value)> {
    let (base, topic) = url.trim_end_matches('/').rsplit_once('/')?;
    // `https://host` alone has no topic.
    if topic.is_empty() || base.ends_with('/') {
        return None;
    }
    let (priority, tag) = match message.note.event.as_str() {
        "fault" => (5, "rotating_light"),
        "end" => (3, "checkered_flag"),
        "prompt" => (4, "raising_hand"),
        _ => (4, "warning"),
    };
    let Note { title, text, .. } = &message.note;
    let body = json!({
        "topic": topic,
        "title": title,
        "message": text,
        "priority": priority,
        "tags": [tag],
    });
    Some((format!("{base}/"), body))
}
