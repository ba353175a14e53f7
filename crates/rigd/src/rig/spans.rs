//! The spans of the rig thread, for those who follow the program by `tracing`.
//!
//! ```text
//! run ──┬── step ──┬── operation
//!       │          ├── operation
//!       │          └── commit
//!       └── step ─── …
//! ```
//!
//! A span lasts by the wall clock, also in virtual time. Where nobody follows, a span is a look at a level.

use rig_engine::{Event, Operation, OperationId};
use rig_store::RunId;
use tracing::{Span, field::Empty, info_span};

use super::slot::Ended;

/// What is under way. A span is closed when it is replaced.
#[derive(Debug)]
pub(super) struct Spans {
    run: Span,
    step: Span,
    /// Of the axes, and of the analyzer.
    operations: [Option<(OperationId, Span)>; 2],
}

impl Default for Spans {
    fn default() -> Self {
        Self { run: Span::none(), step: Span::none(), operations: [None, None] }
    }
}

impl Spans {
    pub(super) fn begin_run(&mut self, id: RunId, protocol: &str) {
        self.step = Span::none();
        self.run = info_span!(
            parent: None,
            "run",
            rig.run = %id,
            rig.protocol = protocol,
            rig.ending = Empty,
            otel.status_code = Empty
        );
    }

    /// Follows an event; `step` is the id of the step under way.
    pub(super) fn note(&mut self, event: &Event, step: impl FnOnce() -> Option<String>) {
        match event {
            Event::StepStarted { .. } if !self.run.is_none() => {
                let id = step().unwrap_or_default();
                self.step = info_span!(
                    parent: &self.run,
                    "step",
                    otel.name = format!("step {id}"),
                    rig.step = id,
                    rig.outcome = Empty
                );
            }
            Event::TouchFinished(result) => {
                let outcome = if result.is_refused() { "refused" } else { "measured" };
                self.step.record("rig.outcome", outcome);
            }
            Event::Faulted { fault, .. } => {
                self.run.record("otel.status_code", "ERROR");
                self.present().in_scope(|| tracing::info!(%fault, "the rig is latched"));
            }
            Event::RunFinished(ending) => {
                self.run.record("rig.ending", ending.name());
                (self.step, self.run) = (Span::none(), Span::none());
            }
            _ => {}
        }
    }

    /// The innermost of the run and its step.
    pub(super) fn present(&self) -> &Span {
        if self.step.is_none() { &self.run } else { &self.step }
    }

    pub(super) fn begin(&mut self, id: OperationId, operation: &Operation) {
        let span = info_span!(
            parent: self.present(),
            "operation",
            otel.name = word(operation),
            rig.to_mm = Empty,
            rig.to_deg = Empty,
            rig.points = Empty,
            rig.failure = Empty,
            otel.status_code = Empty
        );
        match operation {
            Operation::MoveLinear { target, .. } | Operation::Descend { target, .. } => {
                span.record("rig.to_mm", target.position().value())
            }
            Operation::MoveRotary { target, .. } => {
                span.record("rig.to_deg", target.position().value())
            }
            Operation::Measure { points, .. } => span.record("rig.points", points.len()),
            _ => &span,
        };
        self.operations[usize::from(matches!(operation, Operation::Measure { .. }))] =
            Some((id, span));
    }

    pub(super) fn end(&mut self, id: OperationId, ended: &Ended) {
        for operation in &mut self.operations {
            let Some((_, span)) = operation.take_if(|(of, _)| *of == id) else { continue };
            if let Err(failure) = ended {
                span.record("otel.status_code", "ERROR");
                span.record("rig.failure", failure.detail.as_str());
            }
        }
    }
}

/// The name of an operation.
const fn word(operation: &Operation) -> &'static str {
    match operation {
        Operation::HomeLinear { .. } => "home linear",
        Operation::PrepareRotary => "prepare rotary",
        Operation::FindLinear { .. } => "find linear",
        Operation::HomeUpwards => "home linear upwards",
        Operation::MoveLinear { .. } => "move linear",
        Operation::Descend { .. } => "descend",
        Operation::MoveRotary { .. } => "move rotary",
        Operation::Measure { .. } => "measure",
        Operation::StopMotion => "stop motion",
        Operation::StopRotary => "stop rotary",
    }
}
