//! What goes into the engine and what comes out of it.

use crate::{Event, Failure, Operation, OperationId, Report};

/// What the shell has to carry out, in order.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// Write this into the journal.
    Note(Event),
    /// Make everything noted so far durable before going on.
    Commit,
    /// Do this and report.
    Do(OperationId, Operation),
    /// Have the operation in flight end early. It still reports.
    Interrupt,
}

/// What wakes the engine.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// An operation has ended.
    Done(OperationId, Result<Report, Failure>),
    /// The deadline that [`Engine::deadline`](crate::Engine::deadline) named has come.
    Tick,
}
