//! The counts of a campaign, and how long planning took.

use std::{
    collections::BTreeMap,
    fmt,
    sync::{Arc, Mutex},
};

use rig_engine::RunStatus;
use rig_resonance::Planner;
use tracing::{
    Event, Level, Subscriber,
    field::{Field, Visit},
};
use tracing_subscriber::{Layer, filter::Targets, layer::Context, prelude::*};

use crate::run::Outcome;

/// The ends of the runs.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    completed: usize,
    with_refusals: usize,
    faulted: usize,
    aborted: usize,
    panicked: usize,
    without_end: usize,
    failed: usize,
    sweeps: usize,
    /// Runs with a journal that is not sound.
    unsound: usize,
    /// Why sweeps were refused and runs faulted, without the numbers, and how often.
    reasons: BTreeMap<String, usize>,
}

impl Tally {
    pub(crate) fn count(&mut self, outcome: &Outcome, may_fault: bool) {
        self.failed += usize::from(outcome.failure(may_fault).is_some());
        match outcome {
            Outcome::Ended { status, cause, sweeps, refusals, findings } => {
                self.unsound += usize::from(!findings.is_empty());
                for finding in findings {
                    self.note("not sound", &format!("{}: {}", finding.check.name(), finding.what));
                }
                let ended = match status {
                    RunStatus::Completed => &mut self.completed,
                    RunStatus::CompletedWithRefusals => &mut self.with_refusals,
                    RunStatus::Faulted => &mut self.faulted,
                    RunStatus::Aborted => &mut self.aborted,
                };
                *ended += 1;
                self.sweeps += sweeps;
                for reason in refusals {
                    self.note("sweep refused", reason);
                }
                if let Some(cause) = cause {
                    self.note("run faulted", cause);
                }
            }
            Outcome::Panicked => self.panicked += 1,
            Outcome::NoEnd => self.without_end += 1,
        }
    }

    fn note(&mut self, what: &str, reason: &str) {
        let is_number = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
        let words =
            reason.split(' ').map(|word| match word.trim_matches(|c| "[](),;:".contains(c)) {
                number if !number.is_empty() && number.chars().all(is_number) => "…",
                _ => word,
            });
        let words: Vec<&str> = words.collect();
        *self.reasons.entry(format!("{what}: {}", words.join(" "))).or_default() += 1;
    }

    pub(crate) fn print_reasons(&self) {
        for (reason, count) in &self.reasons {
            println!("{count:6} {reason}");
        }
    }

    pub(crate) const fn is_clean(&self) -> bool {
        self.failed == 0
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} completed, {} completed with refusals, {} faulted, {} aborted, {} panicked, {} without \
             an end, {} not sound; {} failed; {} sweeps",
            self.completed,
            self.with_refusals,
            self.faulted,
            self.aborted,
            self.panicked,
            self.without_end,
            self.unsound,
            self.failed,
            self.sweeps,
        )
    }
}

/// The planning steps of all rigs: rows computed, and processor time.
#[derive(Debug, Clone, Default)]
pub(crate) struct Steps(Arc<Mutex<Vec<Step>>>);

#[derive(Debug, Clone, Copy, Default)]
struct Step {
    work: u64,
    seconds: f64,
}

impl Steps {
    /// Listens to every rig of this process from now on.
    pub(crate) fn collect() -> Self {
        let steps = Self::default();
        let targets = Targets::new().with_target("rigd::planned", Level::TRACE);
        tracing_subscriber::registry().with(steps.clone().with_filter(targets)).init();
        steps
    }
}

impl<S: Subscriber> Layer<S> for Steps {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut step = Step::default();
        event.record(&mut step);
        if let Ok(mut steps) = self.0.lock() {
            steps.push(step);
        }
    }
}

impl Visit for Step {
    fn record_f64(&mut self, field: &Field, value: f64) {
        if field.name() == "seconds" {
            self.seconds = value;
        }
    }

    fn record_u64(&mut self, field: &Field, value: u64) {
        if field.name() == "work" {
            self.work = value;
        }
    }

    fn record_debug(&mut self, _: &Field, _: &dyn fmt::Debug) {}
}

impl fmt::Display for Steps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut steps = self.0.lock().map_err(|_| fmt::Error)?.clone();
        let count = steps.len();
        let most = steps.iter().map(|step| step.work).max().unwrap_or_default();
        steps.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        let at = |place: usize| steps.get(place).map_or(0.0, |step| 1e3 * step.seconds);
        write!(
            f,
            "{count} planning steps: 99.9 % under {:.2} ms of processor, the longest {:.2} ms, {most} of at most {} \
             rows",
            at(count - count.div_ceil(1000)),
            at(count.saturating_sub(1)),
            Planner::WORK_MAX,
        )
    }
}
