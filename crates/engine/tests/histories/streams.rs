//! The streams of readings of descents in the ideal world, and what goes wrong within one.

use std::time::Duration;

use rig_engine::{Command, Input, Operation, OperationId, Report};
use rig_model::{PointResult, Position, Reading, SweepPoint};

use crate::world::{SURFACE_MM, World};

/// A reading of two cycles and what comes between two of them.
const READING: Duration = Duration::from_millis(20);

/// What goes wrong within a stream, at a reading of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum StreamTrouble {
    /// A person stops everything, or aborts.
    Stop,
    Abort,
    /// No further reading comes, and the probe goes on down until it is told to stop.
    Silent,
    /// The stream breaks off, and the stage is stopped by its owner.
    BreaksOff,
    /// The computer is held up.
    HeldUp,
    /// The analyzer flags the reading.
    Flagged,
    /// The analyzer repeats the reading from here on.
    Stuck,
    /// The analyzer feels no contact from here on.
    Blind,
    /// It feels one that is not there, once.
    Ghost,
}

/// The streams of a world.
#[derive(Debug, Default)]
pub(crate) struct Streams {
    /// The descent in progress was told to end.
    pub(crate) is_ended: bool,
    /// The trouble of the first descent, at this reading.
    pub(crate) trouble: Option<(usize, StreamTrouble)>,
    is_blind: bool,
    descents: usize,
}

impl World {
    /// Goes down with a stream of readings until the target, an end, or a stop.
    pub(crate) fn descend(&mut self, id: OperationId, operation: &Operation) {
        let Operation::Descend { target, speed_mm_per_s, point, .. } = operation else { return };
        let target_mm = target.position().value();
        let trouble = self.streams.trouble.filter(|_| self.streams.descents == 0);
        self.streams.descents += 1;
        (self.streams.is_ended, self.was_interrupted) = (false, false);
        let mut way = Vec::new();
        let (mut count, mut stuck) = (0, None);
        while self.linear_mm > target_mm && !self.streams.is_ended && !self.was_interrupted {
            let gone_mm = speed_mm_per_s * READING.as_secs_f64();
            self.linear_mm = (self.linear_mm - gone_mm).max(target_mm);
            self.now = self.now + READING;
            way.push((self.now, Position::new(self.linear_mm)));
            let due = trouble.filter(|(at, _)| *at <= count).map(|(_, what)| what);
            let is_now = trouble.is_some_and(|(at, _)| at == count);
            count += 1;
            let mut reading = self.stream_reading(point);
            match due {
                Some(StreamTrouble::Stop) if is_now => self.try_command(Command::Stop),
                Some(StreamTrouble::Abort) if is_now => self.try_command(Command::Abort),
                Some(StreamTrouble::HeldUp) if is_now => {
                    self.handle(Input::Stalled(Duration::from_secs(2)));
                }
                Some(StreamTrouble::BreaksOff) => break,
                Some(StreamTrouble::Silent) => {
                    if self.engine.deadline().is_some_and(|by| by <= self.now) {
                        self.handle(Input::Tick);
                    }
                    continue;
                }
                Some(StreamTrouble::Flagged) => reading.measured = PointResult::Overload,
                Some(StreamTrouble::Stuck) => {
                    reading.measured = *stuck.get_or_insert(reading.measured);
                }
                Some(StreamTrouble::Blind) => self.streams.is_blind = true,
                Some(StreamTrouble::Ghost) if is_now => {
                    if let PointResult::Value(value) = &mut reading.measured {
                        value.resistance_ohm *= 3.0;
                    }
                }
                _ => {}
            }
            self.handle(Input::Read(id, reading));
        }
        let at = Position::new(self.linear_mm);
        self.handle(Input::Done(id, Ok(Report::Descended { at, way })));
    }

    /// The target of a descent is declared, and no deeper than the search in steps may go.
    pub(crate) fn check_descent(&self, target_mm: f64) {
        assert!(!self.is_lost, "a descent from where the probe cannot be");
        assert!(9.4 - 1e-9 <= target_mm, "too deep: {target_mm}");
        assert!(self.is_intent_durable, "no durable intent");
    }

    /// No reading comes of a descent that never reports: first its end is asked for.
    pub(crate) fn hang_stream(&mut self, operation: &Operation) {
        if let Operation::Descend { .. } = operation {
            self.streams.is_ended = false;
            self.now = self.engine.deadline().expect("a reading is due");
            self.handle(Input::Tick);
            assert!(self.streams.is_ended && !self.was_interrupted);
        }
    }

    /// The report of a stage that has not moved.
    pub(crate) fn not_descended(&self) -> Report {
        Report::Descended { at: Position::new(self.linear_mm), way: Vec::new() }
    }

    /// A reading at the frequency of the stream; a blind analyzer reads the free sensor.
    fn stream_reading(&mut self, point: &SweepPoint) -> Reading {
        let here_mm = self.linear_mm;
        if self.streams.is_blind {
            self.linear_mm = SURFACE_MM + 5.0;
        }
        let reading = self.reading(point);
        self.linear_mm = here_mm;
        reading
    }
}
