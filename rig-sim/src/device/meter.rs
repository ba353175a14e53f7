//! An impedance analyzer of any make: it takes messages, and it takes time.
//!
//! What the makes have in common is here: one command after the other, a measurement that waits,
//! integrates and then has a result, and a drive that never stops. What a make calls things is in
//! its [`Model`].
//!
//! ```text
//!           command that measures              delay is over            all points are there
//!   idle ───────────────────────────▶ waiting ───────────────▶ integrating ─────────────────▶ idle
//!                                        ▲                          │
//!                                        └────── next point ────────┘
//! ```

#[cfg(test)]
mod bench;
mod e4990a;
mod hioki;
mod lcr;
mod quantity;

use std::{collections::VecDeque, fmt, time::Duration};

use num_complex::Complex64;
use rig_model::RigTime;
use rig_scpi::{Call, Dialect, Instrument, ScpiError, Tree, Value};

use self::quantity::{Quantity, round_step};
pub(crate) use self::{
    e4990a::E4990a,
    hioki::Hioki,
    lcr::{E4980a, Hp4284a, Lcr, Th2832},
};

use crate::world::World;

/// What distinguishes one make of analyzer from another.
pub(crate) trait Model: fmt::Debug + Default {
    /// What its commands are called.
    type Command: Copy + fmt::Debug;

    /// The commands, which a test builds.
    fn commands() -> Tree<Self::Command>;

    /// How it speaks.
    fn dialect() -> Dialect;

    /// Does what a command says, or says what that takes.
    fn carry_out(
        &mut self,
        call: &Call<Self::Command>,
        memory: Memory<'_>,
    ) -> Result<Outcome, ScpiError>;

    /// What drives the terminals now.
    fn drive(&self) -> Drive;

    /// The answer of a measurement that answers by itself.
    fn answer(&self, readings: &[Reading]) -> Vec<Value>;

    /// Events of the operation status when a measurement is complete.
    fn done_bits(&self) -> u16 {
        0
    }
}

/// What is left at the terminals when the level is zero, V.
const LEAKAGE_V: f64 = 1e-6;

/// What drives the terminals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Drive {
    pub(crate) frequency_hz: f64,
    pub(crate) level_v: f64,
}

/// What has been measured.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Memory<'a> {
    /// The points of the last finished measurement.
    pub(crate) readings: &'a [Reading],
    /// Whether another measurement is under way.
    pub(crate) is_measuring: bool,
}

/// What comes of a command.
#[derive(Debug)]
pub(crate) enum Outcome {
    /// It is done, with what it answers.
    Done(Vec<Value>),
    /// It measures.
    Measure(Job),
    /// It has to wait for the measurement that is under way.
    Wait,
    /// It ends the measurement that is under way.
    Abort,
}

/// A measurement.
#[derive(Debug)]
pub(crate) struct Job {
    /// What to measure, in order.
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
pub(crate) struct Reading {
    pub(crate) frequency_hz: f64,
    /// `None` when the input was overloaded.
    pub(crate) impedance_ohm: Option<Complex64>,
}

#[derive(Debug)]
enum Phase {
    Waiting,
    Integrating(Reading),
}

#[derive(Debug)]
struct UnderWay {
    job: Job,
    phase: Phase,
    until: RigTime,
    readings: Vec<Reading>,
}

/// An analyzer.
#[derive(Debug)]
pub(crate) struct Meter<M: Model> {
    instrument: Instrument<M::Command>,
    model: M,
    under_way: Option<UnderWay>,
    /// A command that waits for the measurement.
    held: Option<Call<M::Command>>,
    readings: Vec<Reading>,
    /// How long the instrument takes over a command.
    per_command: Duration,
    /// When it last heard something.
    heard_at: RigTime,
    /// When it is done with the last command.
    free_at: RigTime,
    /// What it has said, and when.
    said: Vec<(RigTime, Vec<u8>)>,
    overloads: u32,
}

impl<M: Model> Meter<M> {
    /// An instrument that was just switched on and drives its terminals.
    pub(crate) fn new(per_command: Duration) -> Self {
        Self {
            instrument: Instrument::new(M::commands(), M::dialect()),
            model: M::default(),
            under_way: None,
            held: None,
            readings: Vec::new(),
            per_command,
            heard_at: RigTime::ZERO,
            free_at: RigTime::ZERO,
            said: Vec::new(),
            overloads: 0,
        }
    }

    /// Takes bytes that came at `now`.
    pub(crate) fn push(&mut self, now: RigTime, bytes: &[u8], world: &mut World) {
        self.heard_at = now;
        self.instrument.push(bytes);
        self.advance(now, world);
    }

    /// When the measurement goes on.
    pub(crate) fn deadline(&self) -> Option<RigTime> {
        self.under_way.as_ref().map(|under_way| under_way.until)
    }

    /// What has been said up to now, with the time of each answer.
    pub(crate) fn take_said(&mut self) -> Vec<(RigTime, Vec<u8>)> {
        std::mem::take(&mut self.said)
    }

    /// The input is overloaded at the next measured point.
    pub(crate) fn overload(&mut self) {
        self.overloads += 1;
    }

    /// Forgets every message; what is under way ends without an answer.
    pub(crate) fn device_clear(&mut self) {
        self.instrument.device_clear();
    }

    /// Switches the instrument off and on again.
    pub(crate) fn restart(&mut self, now: RigTime, world: &mut World) {
        let before = self.model.drive();
        *self = Self { free_at: now, ..Self::new(self.per_command) };
        self.apply_drive(now, before, world);
    }

    /// Lives up to `now`.
    pub(crate) fn advance(&mut self, now: RigTime, world: &mut World) {
        loop {
            if self.under_way.as_ref().is_some_and(|under_way| under_way.until <= now) {
                self.go_on(world);
                continue;
            }
            if self.under_way.as_ref().is_some_and(|under_way| under_way.job.is_blocking) {
                return;
            }
            let held = self.held.take();
            let Some(call) = held.or_else(|| self.instrument.poll()) else {
                self.collect(self.heard_at.max(self.free_at));
                return;
            };
            // A command that has waited is obeyed as soon as the instrument is free, however late
            // that is looked at. Within a message the instrument is ahead of the wire by the little
            // time that its commands take.
            let at = self.free_at.max(self.heard_at) + self.per_command;
            if !self.carry_out(at, call, world) {
                return;
            }
        }
    }

    /// Carries a command out, unless it has to wait.
    fn carry_out(&mut self, at: RigTime, call: Call<M::Command>, world: &mut World) -> bool {
        let before = self.model.drive();
        let is_measuring = self.under_way.is_some();
        let memory = Memory { readings: &self.readings, is_measuring };
        let outcome = self.model.carry_out(&call, memory);
        if matches!(outcome, Ok(Outcome::Wait)) && is_measuring {
            self.held = Some(call);
            return false;
        }
        self.free_at = at;
        self.apply_drive(at, before, world);
        match outcome {
            // Triggers do not interrupt what they have begun.
            Ok(Outcome::Measure(_)) if is_measuring => self.reply(at, Err(ScpiError::new(-211))),
            Ok(Outcome::Measure(job)) => self.begin(at, job, world),
            Ok(Outcome::Done(values)) => self.reply(at, Ok(values)),
            Ok(Outcome::Abort) => {
                self.under_way = None;
                self.instrument.set_operation_pending(false);
                self.reply(at, Ok(Vec::new()));
            }
            // There is nothing to wait for: the data are stale.
            Ok(Outcome::Wait) => self.reply(at, Err(ScpiError::new(-230))),
            Err(error) => self.reply(at, Err(error)),
        }
        true
    }

    fn apply_drive(&self, at: RigTime, before: Drive, world: &mut World) {
        let drive = self.model.drive();
        if drive.frequency_hz != before.frequency_hz {
            world.set_frequency(at, drive.frequency_hz);
        }
        if drive.level_v != before.level_v {
            // A level of zero still leaves what leaks through.
            let volt = |drive: Drive| drive.level_v.max(LEAKAGE_V);
            world.scale_drive(at, volt(drive) / volt(before));
        }
    }

    fn begin(&mut self, at: RigTime, job: Job, world: &mut World) {
        if !(job.is_blocking || job.is_answered) {
            self.reply(at, Ok(Vec::new()));
        }
        self.instrument.set_operation_pending(true);
        self.under_way =
            Some(UnderWay { job, phase: Phase::Waiting, until: at, readings: Vec::new() });
        self.next_point(at, world);
    }

    /// Begins the next point of the measurement, or ends it.
    fn next_point(&mut self, at: RigTime, world: &mut World) {
        let Some(under_way) = &mut self.under_way else { return };
        if let Some(point) = under_way.job.points.front() {
            world.set_frequency(at, point.frequency_hz);
            under_way.phase = Phase::Waiting;
            under_way.until = at + Duration::from_secs_f64(point.delay_s);
            if point.delay_s == 0.0 {
                self.go_on(world);
            }
            return;
        }
        let Some(UnderWay { job, readings, .. }) = self.under_way.take() else { return };
        self.readings = readings;
        self.instrument.set_operation_pending(false);
        let operation = &mut self.instrument.status_mut().operation;
        operation.set(self.model.done_bits(), true);
        operation.set(self.model.done_bits(), false);
        self.free_at = self.free_at.max(at);
        if job.is_answered {
            let values = self.model.answer(&self.readings);
            self.reply(at, Ok(values));
        } else if job.is_blocking {
            self.reply(at, Ok(Vec::new()));
        }
    }

    /// What follows when the present phase is over.
    fn go_on(&mut self, world: &mut World) {
        let Some(under_way) = &mut self.under_way else { return };
        let at = under_way.until;
        match under_way.phase {
            Phase::Waiting => {
                let Some(point) = under_way.job.points.pop_front() else { return };
                let (impedance_ohm, until) = world.measure(at, point.cycles);
                let is_overloaded = self.overloads > 0;
                self.overloads = self.overloads.saturating_sub(1);
                let impedance_ohm = (!is_overloaded).then_some(impedance_ohm);
                let frequency_hz = point.frequency_hz;
                under_way.phase = Phase::Integrating(Reading { frequency_hz, impedance_ohm });
                under_way.until = until;
            }
            Phase::Integrating(reading) => {
                under_way.readings.push(reading);
                self.next_point(at, world);
            }
        }
    }

    fn reply(&mut self, at: RigTime, answer: Result<Vec<Value>, ScpiError>) {
        self.instrument.answer(answer);
        self.collect(at);
    }

    /// Keeps what the instrument has finished saying.
    fn collect(&mut self, at: RigTime) {
        let bytes = self.instrument.take_output();
        if !bytes.is_empty() {
            self.said.push((at, bytes));
        }
    }
}
