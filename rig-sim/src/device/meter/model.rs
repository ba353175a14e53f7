//! A make of analyzers: its commands and their outcomes.

use std::{collections::VecDeque, fmt};

use num_complex::Complex64;
use rig_scpi::{Call, Dialect, ScpiError, Tree, Value};

/// The differences between makes of analyzers.
pub(crate) trait Model: fmt::Debug + Default {
    /// The names of its commands.
    type Command: Copy + fmt::Debug;

    /// Whether the end of a measurement is always an event of the operation status, independent of
    /// the filters. Otherwise the filters of the standard decide.
    const ENDS_ARE_EVENTS: bool = false;

    /// The commands, which a test builds.
    fn commands() -> Tree<Self::Command>;

    /// Its command set.
    fn dialect() -> Dialect;

    /// Carries out a command, or returns the job that it needs.
    fn carry_out(
        &mut self,
        call: &Call<Self::Command>,
        memory: Memory<'_>,
    ) -> Result<Outcome, ScpiError>;

    /// The present drive of the terminals.
    fn drive(&self) -> Drive;

    /// The answer of a measurement to the command that began it.
    fn answer(&self, command: Self::Command, readings: &[FinishedPoint]) -> Vec<Value>;

    /// Whether the command may end a measurement that another client waits for.
    fn may_interrupt(_command: Self::Command) -> bool {
        false
    }

    /// Conditions of the operation status while it measures.
    fn busy_bits(&self) -> u16 {
        0
    }
}

/// The drive of the terminals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Drive {
    pub(crate) frequency_hz: f64,
    pub(crate) level_v: f64,
}

/// The finished points of the instrument.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Memory<'a> {
    /// The points of the last finished measurement.
    pub(crate) readings: &'a [FinishedPoint],
    /// Whether another measurement is under way.
    pub(crate) is_measuring: bool,
}

/// The outcome of a command.
#[derive(Debug)]
pub(crate) enum Outcome {
    /// The command is done, with its answer.
    Done(Vec<Value>),
    /// Start a measurement.
    Measure(Job),
    /// It has to wait for the measurement that is under way.
    Wait,
    /// It ends the measurement that is under way.
    Abort,
    /// It ends the measurement that is under way, and no points are left.
    Reset,
}

/// A measurement in progress.
#[derive(Debug)]
pub(crate) struct Job {
    /// The quantities to measure, in order.
    pub(crate) points: VecDeque<Point>,
    /// Whether nothing else is done meanwhile.
    pub(crate) is_blocking: bool,
    /// Whether its end is the answer to the command.
    pub(crate) is_answered: bool,
}

/// One point of a measurement.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point {
    pub(crate) frequency_hz: f64,
    pub(crate) delay_s: f64,
    pub(crate) cycles: u32,
}

/// A finished point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FinishedPoint {
    pub(crate) frequency_hz: f64,
    /// `None` when the input was overloaded.
    pub(crate) impedance_ohm: Option<Complex64>,
}
