//! Inputs and effects of the engine.

use std::time::Duration;

use rig_model::Reading;

use crate::{Event, Failure, Operation, OperationId, Report};

/// An effect, which the shell carries out in order.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// Write the event into the journal.
    Note(Event),
    /// Make everything noted so far durable before going on.
    Commit,
    /// Carry out the operation and report.
    Do(OperationId, Operation),
    /// Make the operation in progress end early. It still reports, but the engine does not wait for
    /// the report of a measurement.
    Interrupt,
    /// Stop the linear stage and the stream of readings of the descent in progress. It still reports.
    EndDescent,
}

/// An input that wakes the engine.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// An operation has ended.
    Done(OperationId, Result<Report, Failure>),
    /// A reading of the descent in progress.
    Read(OperationId, Reading),
    /// The host did nothing for this long: the program or the computer was held up.
    Stalled(Duration),
    /// The deadline that [`Engine::deadline`](crate::Engine::deadline) named has come.
    Tick,
}
