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

mod e4990a;
mod hioki;
mod lcr;

use std::{collections::VecDeque, fmt, time::Duration};

use num_complex::Complex64;
use rig_model::RigTime;
use rig_scpi::{Call, Dialect, Instrument, ScpiError, Tree, Value};

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

/// What a reading is called on the displays of these instruments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Quantity {
    Off,
    Z,
    Y,
    PhaseDeg,
    PhaseRad,
    AdmittancePhaseDeg,
    AdmittancePhaseRad,
    Rs,
    Rp,
    X,
    G,
    B,
    Cs,
    Cp,
    Ls,
    Lp,
    D,
    Q,
}

impl Quantity {
    /// The value for an impedance at a frequency, in SI units and degrees.
    pub(crate) fn of(self, impedance_ohm: Complex64, frequency_hz: f64) -> f64 {
        let omega = std::f64::consts::TAU * frequency_hz;
        let admittance = impedance_ohm.inv();
        match self {
            Self::Off => 0.0,
            Self::Z => impedance_ohm.norm(),
            Self::Y => admittance.norm(),
            Self::PhaseDeg => impedance_ohm.arg().to_degrees(),
            Self::PhaseRad => impedance_ohm.arg(),
            Self::AdmittancePhaseDeg => admittance.arg().to_degrees(),
            Self::AdmittancePhaseRad => admittance.arg(),
            Self::Rs => impedance_ohm.re,
            Self::Rp => 1.0 / admittance.re,
            Self::X => impedance_ohm.im,
            Self::G => admittance.re,
            Self::B => admittance.im,
            Self::Cs => -1.0 / (omega * impedance_ohm.im),
            Self::Cp => admittance.im / omega,
            Self::Ls => impedance_ohm.im / omega,
            Self::Lp => -1.0 / (omega * admittance.im),
            Self::D => impedance_ohm.re / impedance_ohm.im.abs(),
            Self::Q => impedance_ohm.im.abs() / impedance_ohm.re,
        }
    }
}

/// Rounds to a multiple of a decimal step, to the float that is nearest to the decimal.
pub(crate) fn round_step(value: f64, step: f64) -> f64 {
    let per_unit = (1.0 / step).round();
    if per_unit >= 1.0 {
        (value * per_unit).round() / per_unit
    } else {
        (value / step).round() * step
    }
}

#[cfg(test)]
pub(crate) mod bench {
    //! A meter on a bench without nuisances.

    use super::*;
    use crate::{
        scene::paper,
        world::{Nuisances, Scene},
    };

    #[derive(Debug)]
    pub(crate) struct Bench<M: Model> {
        pub(crate) meter: Meter<M>,
        pub(crate) world: World,
        pub(crate) now: RigTime,
    }

    impl<M: Model> Bench<M> {
        pub(crate) fn new() -> Self {
            let scene = Scene { nuisances: Nuisances::NONE, ..paper() };
            let world = World::new(scene, 1).unwrap();
            Self { meter: Meter::new(Duration::ZERO), world, now: RigTime::ZERO }
        }

        /// Sends a line and waits until nothing more will happen.
        pub(crate) fn say(&mut self, line: &str) -> String {
            self.send(line);
            while let Some(deadline) = self.meter.deadline() {
                self.now = self.now.max(deadline);
                self.meter.advance(self.now, &mut self.world);
            }
            self.heard()
        }

        /// Sends a line.
        pub(crate) fn send(&mut self, line: &str) {
            self.meter.push(self.now, format!("{line}\r\n").as_bytes(), &mut self.world);
        }

        /// What was said up to now.
        pub(crate) fn heard(&mut self) -> String {
            let said = self.meter.take_said();
            said.into_iter().map(|(_, bytes)| String::from_utf8(bytes).unwrap()).collect()
        }

        /// What a settled instrument measures at this frequency.
        pub(crate) fn settled_ohm(&self, frequency_hz: f64) -> Complex64 {
            let mut world = World::new(self.world.scene().clone(), 1).unwrap();
            world.set_frequency(RigTime::ZERO, frequency_hz);
            world.measure(RigTime::from_micros(10_000_000), 1).0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_quantities_agree_with_each_other() {
        let impedance = Complex64::new(3.0, -4.0);
        let value = |quantity: Quantity| quantity.of(impedance, 1.0 / std::f64::consts::TAU);
        let rows = [
            (Quantity::Off, 0.0),
            (Quantity::Z, 5.0),
            (Quantity::PhaseDeg, -53.130_102_354_155_98),
            (Quantity::PhaseRad, -0.927_295_218_001_612_2),
            (Quantity::AdmittancePhaseDeg, 53.130_102_354_155_98),
            (Quantity::AdmittancePhaseRad, 0.927_295_218_001_612_2),
            (Quantity::Y, 0.2),
            (Quantity::Rs, 3.0),
            (Quantity::X, -4.0),
            (Quantity::Cs, 0.25),
            (Quantity::G, 0.12),
            (Quantity::B, 0.16),
            (Quantity::Rp, 25.0 / 3.0),
            (Quantity::Cp, 0.16),
            (Quantity::Ls, -4.0),
            (Quantity::Lp, -6.25),
            (Quantity::D, 0.75),
            (Quantity::Q, 4.0 / 3.0),
        ];
        for (quantity, expected) in rows {
            assert!((value(quantity) - expected).abs() < 1e-12, "{quantity:?}");
        }
    }

    #[test]
    fn decimals_are_rounded_to_the_nearest_float() {
        for (value, step, rounded) in
            [(139.998, 0.01, 140.0), (140.406, 0.01, 140.41), (0.1 + 0.2, 1e-3, 0.3)]
        {
            assert_eq!(round_step(value, step), rounded);
        }
        assert_eq!(round_step(123_456.0, 10.0), 123_460.0);
    }
}
