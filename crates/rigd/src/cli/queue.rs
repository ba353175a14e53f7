//! `rigd queue`: the protocols that wait for the rig of a daemon.

use std::{path::PathBuf, str::FromStr, time::Duration};

use axum::http::Method;
use clap::{Args, Subcommand};
use jiff::{Timestamp, ToSpan, Zoned, civil, tz::TimeZone};
use rig_files::FileKind;
use serde::Deserialize;
use serde_json::{Value, json};

use super::{
    Failure,
    args::OutputArgs,
    daemon::{DaemonArgs, over_http},
    table::{columns, duration, print, print_json},
};
use crate::files::read;

#[derive(Debug, Args)]
pub(super) struct QueueArgs {
    #[command(subcommand)]
    command: QueueCommand,
}

#[derive(Debug, Subcommand)]
enum QueueCommand {
    /// Add a protocol at the end
    Add(AddArgs),
    /// Show what waits, and what it asks of a person
    List(ListArgs),
    /// Move an entry to another place
    Move {
        /// Number of the entry
        number: u64,
        /// Its new place, from 1 for the next one
        place: usize,
        #[command(flatten)]
        daemon: DaemonArgs,
    },
    /// Take an entry out
    Cancel {
        /// Number of the entry
        number: u64,
        #[command(flatten)]
        daemon: DaemonArgs,
    },
    /// Let no entry begin until the queue is released; a run under way goes on
    Hold(DaemonArgs),
    /// Let the entries begin, one after the other
    Release(DaemonArgs),
}

#[derive(Debug, Args)]
struct ListArgs {
    #[command(flatten)]
    daemon: DaemonArgs,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Debug, Args)]
struct AddArgs {
    /// Protocol file; without it, the one that the daemon has loaded
    protocol: Option<PathBuf>,
    /// A note for people
    #[arg(long, value_name = "TEXT", default_value = "")]
    note: String,
    /// The run must have ended by this time, or it does not begin: 06:30, 2026-11-24T06:30, or with an
    /// offset
    #[arg(long, value_name = "TIME")]
    deadline: Option<Deadline>,
    #[command(flatten)]
    daemon: DaemonArgs,
}

/// A time by which a run has ended.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Deadline(Timestamp);

/// A text that is no time.
#[derive(Debug, thiserror::Error)]
#[error("expected a time such as 06:30, 2026-11-24T06:30 or 2026-11-24T06:30+01:00")]
struct NotATime;

impl FromStr for Deadline {
    type Err = NotATime;

    fn from_str(text: &str) -> Result<Self, NotATime> {
        Self::after(text, &Zoned::now()).ok_or(NotATime)
    }
}

impl Deadline {
    /// The time that a person means now. A time of day is the next one.
    fn after(text: &str, now: &Zoned) -> Option<Self> {
        if let Ok(time) = text.parse::<Timestamp>() {
            return Some(Self(time));
        }
        let in_zone = |time: civil::DateTime, zone: &TimeZone| {
            time.to_zoned(zone.clone()).ok().map(|time| Self(time.timestamp()))
        };
        let zone = now.time_zone();
        if let Ok(time) = text.parse::<civil::DateTime>() {
            return in_zone(time, zone);
        }
        // A text with a date would be a time of day too, without its date.
        let today = now.date().to_datetime(text.parse::<civil::Time>().ok()?);
        let is_over = today <= now.datetime();
        in_zone(if is_over { today.checked_add(1.day()).ok()? } else { today }, zone)
    }
}

/// The queue as the daemon shows it.
#[derive(Debug, Deserialize)]
struct QueueView {
    hold: Option<HoldView>,
    run: Option<String>,
    entries: Vec<EntryView>,
    duration_s: f64,
    prompts: usize,
    late: Vec<LateView>,
}

#[derive(Debug, Deserialize)]
struct LateView {
    run: String,
    number: u64,
    protocol: String,
    deadline_unix_ms: u64,
    ended_unix_ms: u64,
}

#[derive(Debug, Deserialize)]
struct HoldView {
    reason: String,
}

#[derive(Debug, Deserialize)]
struct EntryView {
    number: u64,
    protocol: String,
    note: String,
    by: String,
    deadline_unix_ms: Option<i64>,
    is_missed: bool,
    late_s: Option<f64>,
    duration_s: f64,
    begins_in_s: f64,
    prompts: Vec<PromptView>,
    fault: Option<String>,
}

#[derive(Debug, Deserialize)]
struct PromptView {
    prompt: String,
    after_s: f64,
}

pub(super) fn queue(args: &QueueArgs) -> Result<(), Failure> {
    let (daemon, method, path, body) = match &args.command {
        QueueCommand::List(args) => {
            let view = ask(&args.daemon, Method::GET, "/api/v1/queue", None)?;
            return if args.output.json { print_json(&view) } else { show(view) };
        }
        QueueCommand::Add(args) => {
            let protocol = args.protocol.as_ref().map(|path| read(path, FileKind::Protocol));
            let toml = protocol.transpose()?.map(|(_, text)| text);
            let deadline = args.deadline.as_ref().map(|Deadline(time)| time.as_millisecond());
            let body = json!({
                "protocol_toml": toml, "note": args.note, "deadline_unix_ms": deadline
            });
            (&args.daemon, Method::POST, "/api/v1/queue".to_owned(), Some(body.to_string()))
        }
        QueueCommand::Move { number, place, daemon } => {
            let body = json!({ "place": place }).to_string();
            (daemon, Method::POST, format!("/api/v1/queue/{number}/move"), Some(body))
        }
        QueueCommand::Cancel { number, daemon } => {
            (daemon, Method::DELETE, format!("/api/v1/queue/{number}"), None)
        }
        QueueCommand::Hold(daemon) => (daemon, Method::POST, "/api/v1/queue/hold".to_owned(), None),
        QueueCommand::Release(daemon) => {
            (daemon, Method::POST, "/api/v1/queue/release".to_owned(), None)
        }
    };
    show(ask(daemon, method, &path, body)?)
}

fn ask(
    daemon: &DaemonArgs,
    method: Method,
    path: &str,
    body: Option<String>,
) -> Result<Value, Failure> {
    over_http(async { daemon.client()?.order(method, path, body).await })
}

fn show(view: Value) -> Result<(), Failure> {
    let view: QueueView = serde_json::from_value(view).map_err(|error| Failure::System {
        what: "the answer of the daemon",
        source: error.into(),
    })?;
    print(view.text().trim_end())
}

impl QueueView {
    /// For a person.
    fn text(&self) -> String {
        let mut lines = vec![match &self.hold {
            Some(hold) => format!("held: {}; `rigd queue release` lets entries begin", hold.reason),
            None => "released: entries begin one after the other".to_owned(),
        }];
        lines.extend(self.run.as_ref().map(|run| format!("run {run} of the queue is under way")));
        lines.extend(self.late.iter().map(LateView::text));
        if self.entries.is_empty() {
            lines.push("no entry waits; `rigd queue add PROTOCOL` adds one".to_owned());
            return lines.join("\n");
        }
        let head = ["entry", "protocol", "begins in", "takes", "deadline", "added by"];
        let rows: Vec<_> = self.entries.iter().map(EntryView::row).collect();
        lines.push(columns(&head, &rows));
        for entry in &self.entries {
            lines.extend(entry.remarks());
        }
        let takes = duration(self.duration_s);
        lines.push(match self.prompts {
            0 => format!("{takes} in all; nobody is asked for anything"),
            1 => format!("{takes} in all, and a person is needed once"),
            times => format!("{takes} in all, and a person is needed {times} times"),
        });
        lines.join("\n")
    }
}

impl LateView {
    fn text(&self) -> String {
        let Self { run, number, protocol, deadline_unix_ms, ended_unix_ms } = self;
        let late_ms = ended_unix_ms.saturating_sub(*deadline_unix_ms);
        let late = duration(Duration::from_millis(late_ms).as_secs_f64());
        format!("run {run} of entry {number}, {protocol}, ended {late} after its deadline")
    }
}

impl EntryView {
    fn row(&self) -> Vec<String> {
        let begins = if self.is_missed { "not".to_owned() } else { duration(self.begins_in_s) };
        let deadline = self.deadline_unix_ms.and_then(|ms| Timestamp::from_millisecond(ms).ok());
        let deadline = deadline
            .map(|time| time.to_zoned(TimeZone::system()).strftime("%Y-%m-%d %H:%M").to_string());
        vec![
            self.number.to_string(),
            self.protocol.clone(),
            begins,
            duration(self.duration_s),
            deadline.unwrap_or_default(),
            self.by.clone(),
        ]
    }

    /// What a person has to know of it.
    fn remarks(&self) -> Vec<String> {
        let number = self.number;
        // A line of a note must not look like a line of the list.
        let note: Vec<_> = self.note.lines().collect();
        let note = (!note.is_empty()).then(|| format!("entry {number}: {}", note.join(" ")));
        let asks = self.prompts.iter().map(|PromptView { prompt, after_s }| {
            format!("entry {number}, after {}: {prompt}", duration(*after_s))
        });
        let late = self.late_s.map(duration);
        let missed = late.filter(|_| !self.is_missed).map(|late| {
            format!("entry {number} would end {late} after its deadline, even if released now")
        });
        let missed = missed.or_else(|| {
            self.is_missed.then(|| {
                format!("entry {number} missed its deadline; cancel it, or move it to try again")
            })
        });
        let fault = self.fault.iter().map(|fault| format!("entry {number} cannot run: {fault}"));
        note.into_iter().chain(asks).chain(missed).chain(fault).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_of_day_is_the_next_one() {
        let now: Zoned = "2026-11-23T22:00[+01:00]".parse().unwrap();
        for (text, utc) in [
            ("06:30", "2026-11-24T05:30:00Z"),
            ("22:00", "2026-11-24T21:00:00Z"),
            ("22:01", "2026-11-23T21:01:00Z"),
            ("2026-11-25T06:30", "2026-11-25T05:30:00Z"),
            ("2026-11-25 06:30", "2026-11-25T05:30:00Z"),
            ("2026-11-25T06:30+02:00", "2026-11-25T04:30:00Z"),
        ] {
            let expected = Deadline(utc.parse().unwrap());
            assert_eq!(Deadline::after(text, &now), Some(expected), "{text}");
        }
        for text in ["", "soon", "25:00", "2026-13-01T00:00"] {
            assert_eq!(Deadline::after(text, &now), None, "{text}");
        }
    }

    #[test]
    fn the_list_fits_a_terminal() {
        let view: QueueView = serde_json::from_value(json!({
            "hold": null, "run": null, "duration_s": 589.0, "prompts": 1,
            "late": [{ "run": "01a2", "number": 11, "protocol": "smoke",
                "deadline_unix_ms": 1_795_000_000_000_u64, "ended_unix_ms": 1_795_000_065_000_u64 }],
            "entries": [{
                "number": 12, "protocol": "three-direction", "note": "the night run", "by": "Ada",
                "deadline_unix_ms": 1_795_000_000_000_i64, "is_missed": false,
                "duration_s": 589.0, "begins_in_s": 161.0, "fault": null, "late_s": 65.0,
                "prompts": [{ "prompt": "Put sample 1 under the probe.", "after_s": 0.0 }],
            }, {
                "number": 13, "protocol": "smoke", "note": "", "by": "Ada",
                "deadline_unix_ms": 1_795_000_000_000_i64, "is_missed": true,
                "duration_s": 60.0, "begins_in_s": 750.0, "late_s": 700.0, "prompts": [],
            }],
        }))
        .unwrap();
        let text = view.text();
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
        assert!(
            text.contains("entry 12: the night run\nentry 12, after 0 s: Put sample 1"),
            "{text}"
        );
        assert!(text.contains("run 01a2 of entry 11, smoke, ended 1 min 05 s after its deadline"));
        let late = "entry 12 would end 1 min 05 s after its deadline, even if released now";
        assert!(text.contains(late) && text.contains("entry 13 missed its deadline"), "{text}");
    }
}
