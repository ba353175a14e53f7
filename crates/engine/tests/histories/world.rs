//! An ideal bench that plays a run with one trouble at one moment, and checks each operation.

use std::{collections::BTreeMap, f64::consts::TAU};

use rig_engine::{
    Admitted, Command, Effect, Engine, Event, FailureKind, Input, Operation, OperationId,
    RefusalAnswer, Report, RigState, RunStatus,
};
use rig_model::{
    ContactAngle, Direction, DriveLevel, Impedance, Orientation, PointResult, Position, Reading,
    RigTime, SweepMethod, SweepPoint, SweepRequest, Window,
};
use rig_protocol::{
    Action, Approach, Phase, Plan, Pose, Prompt, Step, StepId, Touch, TouchSettings,
};

use crate::drive::Drive;

#[path = "trouble.rs"]
mod trouble;
pub(crate) use trouble::{OF_ONE_OPERATION, Trouble};

use crate::streams::Streams;

#[path = "../../../model/tests/support/limits.rs"]
mod bench;
pub(crate) use bench::{REST_MM, limits};

pub(crate) const SURFACE_MM: f64 = 10.07;
/// What an analyzer reads whose times are wrong.
pub(crate) const NONSENSE: PointResult =
    PointResult::Value(Impedance { resistance_ohm: 1.0, reactance_ohm: -1.0 });
pub(crate) const FREE_HZ: f64 = 140.0;
/// Most steps of a history: the attempts of a day take some tens of thousands.
pub(crate) const STEPS_MAX: usize = 200_000;
pub(crate) const LOADED_HZ: f64 = 158.0;

pub(crate) fn plan() -> Plan {
    let sweep = |min_hz, max_hz| SweepRequest {
        window: Window { min_hz, max_hz },
        method: SweepMethod::Uniform { points: 41 },
        target_sigma_hz: 0.05,
        time_limit_s: 60.0,
        cycles: 10,
        settle_s: 0.5,
        level: DriveLevel { volt: 5.0 },
    };
    let pose = |direction, degrees| Pose { direction, angle: ContactAngle::new(degrees).unwrap() };
    let touch = |direction, degrees| {
        let pose = pose(direction, degrees);
        Action::Touch(Touch { phase: Phase::Main, sample: 0, pose, repeat: 1 })
    };
    let actions = [
        Action::Prompt(Prompt::PlaceSample { sample: 0 }),
        Action::NoLoad(pose(Direction::Front, 0.0)),
        touch(Direction::Front, 0.0),
        touch(Direction::Back, 30.0),
        Action::Prompt(Prompt::TurnSensor { orientation: Orientation::Left }),
        touch(Direction::Left, 0.0),
    ];
    let steps = actions
        .into_iter()
        .enumerate()
        .map(|(index, action)| Step { id: StepId(format!("step/{index}")), action })
        .collect();
    Plan {
        no_load: rig_protocol::NoLoadPolicy::EveryTouch,
        name: "histories".to_owned(),
        samples: vec!["one".to_owned()],
        steps,
        touch: TouchSettings {
            indentation_mm: 0.5,
            halfway_mm: None,
            dwell_s: 1.0,
            approach: Approach {
                start_above_mm: 0.4,
                give_up_below_mm: 0.6,
                coarse_step_mm: 0.1,
                fine_step_mm: 0.005,
                contact_threshold: 0.1,
                settle_s: 0.1,
                cycles: 10,
                slip_mm: 0.025,
                descent_mm_per_s: None,
                slow_descent_mm_per_s: None,
            },
            on_refusal: rig_protocol::RefusalPolicy::Record,
        },
        no_load_sweep: sweep(125.0, 160.0),
        survey_s: None,
        level_check: false,
        contact_sweep: sweep(130.0, 190.0),
        classes: None,
        seed: 0,
        aim: None,
    }
}

/// A reading that belongs to no sweep.
#[derive(Debug)]
pub(crate) struct Listened {
    /// At the frequency of the self-test.
    pub(crate) is_test: bool,
    /// Before or after a touch.
    pub(crate) is_clear: bool,
    /// Time for which the sensor was driven at its frequency, s, and the part of it that was waited for.
    pub(crate) driven_s: f64,
    pub(crate) asked_s: f64,
}

/// An ideal bench, with its own idea of where things are.
#[derive(Debug)]
pub(crate) struct World {
    pub(crate) engine: Engine,
    pub(crate) now: RigTime,
    pub(crate) linear_mm: f64,
    pub(crate) rotary_deg: f64,
    pub(crate) operations: usize,
    /// Steps of the history so far.
    pub(crate) steps: usize,
    /// Number of homings of the linear stage in any direction.
    pub(crate) homings: usize,
    pub(crate) events: Vec<Event>,
    pub(crate) trouble: Option<(usize, Trouble)>,
    /// The last thing made durable was the intent of the moves that follow.
    pub(crate) is_intent_durable: bool,
    pub(crate) in_flight: Option<(OperationId, Operation)>,
    pub(crate) was_interrupted: bool,
    pub(crate) is_lost: bool,
    pub(crate) random: u64,
    /// The linear drive, while it is in trouble.
    pub(crate) drive: Option<Drive>,
    /// The trouble after the first one.
    pub(crate) then: Option<(usize, Trouble)>,
    /// A measurement that is not waited for, and whose report comes too late.
    pub(crate) abandoned: Option<OperationId>,
    /// The last impedance that was read.
    pub(crate) last_read: Option<PointResult>,
    /// The impedance that a frozen analyzer repeats.
    pub(crate) frozen: Option<PointResult>,
    /// Drift of the resonance, Hz/s, the standard deviation of its walk after an hour, Hz, and where that is now, Hz.
    pub(crate) drift_hz_per_s: f64,
    pub(crate) walk_hz_per_sqrt_hour: f64,
    pub(crate) walked_hz: f64,
    /// When the resonance jumps, in touches, and how far, Hz.
    pub(crate) jump: Option<(usize, f64)>,
    /// Fall of the resonance with the square of the level of the drive, Hz/V², and that level, V.
    pub(crate) softening_hz_per_v2: f64,
    pub(crate) level_v: f64,
    /// What a person says about refused touches.
    pub(crate) decision: RefusalAnswer,
    /// Who sends the commands.
    pub(crate) person: &'static str,
    /// C₁/C₀ of the sensor.
    pub(crate) ratio: f64,
    /// Height of the probe above what the linear stage says, mm.
    pub(crate) slip_mm: f64,
    /// The true depth of the last sweep, mm, and that of each finished touch.
    pub(crate) pressed_mm: f64,
    pub(crate) depths_mm: BTreeMap<String, f64>,
    /// The frequency that the analyzer measured at last, and whether it keeps it, Hz.
    pub(crate) measured_hz: (f64, bool),
    /// When the analyzer was set to its frequency.
    set_at: RigTime,
    /// Each reading that belongs to no sweep.
    pub(crate) listened: Vec<Listened>,
    /// When the first fault was noted.
    pub(crate) faulted_at: Option<RigTime>,
    pub(crate) streams: Streams,
}

impl World {
    pub(crate) fn new(trouble: Option<(usize, Trouble)>) -> Self {
        Self {
            engine: Engine::new(limits()),
            now: RigTime::ZERO,
            linear_mm: 7.0,
            rotary_deg: 12.0,
            operations: 0,
            steps: 0,
            homings: 0,
            events: Vec::new(),
            trouble,
            is_intent_durable: false,
            in_flight: None,
            was_interrupted: false,
            is_lost: false,
            random: 1,
            drive: None,
            then: None,
            abandoned: None,
            last_read: None,
            frozen: None,
            drift_hz_per_s: 0.0,
            walk_hz_per_sqrt_hour: 0.0,
            walked_hz: 0.0,
            jump: None,
            softening_hz_per_v2: 0.0,
            level_v: 0.0,
            decision: RefusalAnswer::Skip,
            person: "test",
            ratio: 0.05,
            slip_mm: 0.0,
            pressed_mm: f64::NAN,
            depths_mm: BTreeMap::new(),
            measured_hz: (FREE_HZ, false),
            set_at: RigTime::ZERO,
            listened: Vec::new(),
            faulted_at: None,
            streams: Streams::default(),
        }
    }

    pub(crate) fn command(&mut self, command: Command) {
        let admitted = self.engine.admit(command).unwrap();
        self.begin(admitted);
    }

    pub(crate) fn begin(&mut self, admitted: Admitted) {
        let mut effects = Vec::new();
        self.engine.begin(self.now, admitted, self.person, &mut effects);
        self.carry_out(effects);
    }

    pub(crate) fn carry_out(&mut self, effects: Vec<Effect>) {
        let mut last_intent = None;
        for effect in effects {
            match effect {
                Effect::Note(event) => {
                    if let Event::Intent { down_to, .. } = event {
                        last_intent = Some(down_to);
                    }
                    if matches!(event, Event::Faulted { .. }) {
                        self.faulted_at.get_or_insert(self.now);
                    }
                    if let Event::TouchFinished(touch) = &event {
                        self.depths_mm.insert(touch.step.0.clone(), self.pressed_mm);
                        let is_due =
                            |(touches, _): &mut (usize, f64)| *touches == self.depths_mm.len();
                        let jump = self.jump.take_if(is_due);
                        self.walked_hz += jump.map_or(0.0, |(_, hz)| hz);
                    }
                    self.events.push(event);
                }
                Effect::Commit => {
                    assert!(last_intent.is_some(), "a commit without an intent");
                    self.is_intent_durable = true;
                }
                Effect::Interrupt => {
                    self.was_interrupted = true;
                    let is_measuring = |(_, operation): &mut (OperationId, Operation)| {
                        matches!(operation, Operation::Measure { .. })
                    };
                    self.abandoned = self.in_flight.take_if(is_measuring).map(|(id, _)| id);
                }
                Effect::EndDescent => self.streams.is_ended = true,
                Effect::Do(id, operation) => {
                    assert!(self.in_flight.is_none(), "two operations at once");
                    self.check(&operation);
                    self.in_flight = Some((id, operation));
                }
            }
        }
    }

    /// The invariants that hold for every operation that leaves the engine.
    pub(crate) fn check(&self, operation: &Operation) {
        match operation {
            Operation::MoveRotary { target, .. } => {
                let to_deg = target.position().value();
                let room_mm = self.linear_mm - self.highest_edge_mm(to_deg);
                assert!(
                    0.45 < room_mm || (self.linear_mm - REST_MM).abs() < 0.011,
                    "the sample turns from {}° to {to_deg}° with the probe at {} mm",
                    self.rotary_deg,
                    self.linear_mm
                );
            }
            Operation::PrepareRotary => assert!(
                (self.linear_mm - REST_MM).abs() < 0.011,
                "the rotary stage homes with the probe at {} mm",
                self.linear_mm
            ),
            Operation::Descend { target, .. } => self.check_descent(target.position().value()),
            Operation::MoveLinear { target, .. } => {
                assert!(!self.is_lost, "moved from where it cannot be");
                let target_mm = target.position().value();
                assert!(
                    target_mm + self.slip_mm.max(0.0) >= SURFACE_MM - 0.61,
                    "too deep: {target_mm}"
                );
                assert!(target_mm >= REST_MM || self.is_intent_durable, "no durable intent");
                let is_way_out = self.engine.snapshot().state == RigState::Retracting;
                assert!(
                    !is_way_out || self.linear_mm - 0.011 < target_mm,
                    "a way out goes down from {} mm to {target_mm} mm",
                    self.linear_mm
                );
            }
            _ => {}
        }
    }

    /// The highest place that an edge of the largest sample passes in a turn, by trying every tilt, mm.
    fn highest_edge_mm(&self, to_deg: f64) -> f64 {
        let geometry = limits().geometry;
        let top_mm = geometry.surface_above_pivot_mm + geometry.surface_tolerance_mm;
        let pivot_mm = geometry.surface.value() - geometry.surface_above_pivot_mm;
        let of_tilt = |part: i32| {
            let tilt_deg = self.rotary_deg + (to_deg - self.rotary_deg) * f64::from(part) / 500.0;
            let (sin, cos) = tilt_deg.to_radians().sin_cos();
            pivot_mm + top_mm * cos + geometry.sample_half_width_mm * sin.abs()
        };
        (0..=500).map(of_tilt).fold(f64::MIN, f64::max)
    }

    /// Ends the operation in flight, after the trouble that is due, if any.
    ///
    /// # Panics
    /// A history with more than [`STEPS_MAX`] of them, so that whatever waits for a state has an end.
    pub(crate) fn step(&mut self) {
        self.steps += 1;
        assert!(self.steps <= STEPS_MAX, "the history did not end");
        if let Some(id) = self.abandoned.take() {
            // Its report comes too late to be used.
            self.fail(id, FailureKind::Line);
        }
        let Some((id, operation)) = self.in_flight.take() else {
            // Only a wait can be going on.
            self.now = self.engine.deadline().expect("nothing to wait for");
            return self.handle(Input::Tick);
        };
        let trouble = self.trouble.filter(|(at, _)| *at == self.operations).map(|(_, what)| what);
        let then = self.then.filter(|(at, _)| *at == self.operations).map(|(_, what)| what);
        let trouble = trouble.or(then);
        self.operations += 1;
        self.now = self.now + std::time::Duration::from_millis(100);
        self.walk();
        self.let_last(trouble);
        if let Some(answer) = Drive::answer(self, &operation) {
            return self.handle(Input::Done(id, answer));
        }
        if self.is_lost && matches!(operation, Operation::FindLinear { .. }) {
            return self.fail(id, FailureKind::Lost);
        }
        match trouble {
            None
            | Some(
                Trouble::Drive(_)
                | Trouble::Freezes
                | Trouble::Slips(_)
                | Trouble::StaysAtFrequency,
            ) => {}
            Some(Trouble::Fails) => return self.fail(id, FailureKind::Line),
            Some(Trouble::Loses) => {
                self.is_lost = true;
                return self.fail(id, FailureKind::Lost);
            }
            Some(Trouble::Stalls) => {
                let report = self.stalled(&operation);
                return self.handle(Input::Done(id, Ok(report)));
            }
            Some(Trouble::Hangs) => return self.hang(&operation),
            Some(Trouble::Flags | Trouble::FlagsOnce) => {
                if let Operation::Measure { points, .. } = &operation {
                    let flagged =
                        Reading { measured: PointResult::Overload, ..self.reading(&points[0]) };
                    let readings = if trouble == Some(Trouble::Flags) {
                        vec![flagged; 3]
                    } else {
                        let values = points.iter().map(|point| self.reading(point));
                        std::iter::once(flagged).chain(values).collect()
                    };
                    return self.handle(Input::Done(id, Ok(Report::Measured(readings))));
                }
            }
            Some(Trouble::HoldUp(repeats)) => return self.hold_up(id, &operation, repeats),
            Some(Trouble::Abort) => self.try_command(Command::Abort),
            Some(Trouble::Stop) => self.try_command(Command::Stop),
            Some(Trouble::Pause) => self.try_command(Command::Pause),
        }
        if let Operation::Descend { .. } = operation {
            return self.descend(id, &operation);
        }
        let report = self.perform(&operation);
        self.handle(Input::Done(id, Ok(report)));
    }

    pub(crate) fn try_command(&mut self, command: Command) {
        // Not every state admits every command.
        if let Ok(admitted) = self.engine.admit(command) {
            self.begin(admitted);
        }
    }

    pub(crate) fn handle(&mut self, input: Input) {
        let mut effects = Vec::new();
        self.engine.handle(self.now, input, &mut effects);
        self.carry_out(effects);
    }

    pub(crate) fn stalled(&mut self, operation: &Operation) -> Report {
        match operation {
            Operation::Descend { .. } => self.not_descended(),
            Operation::MoveLinear { .. }
            | Operation::HomeLinear { .. }
            | Operation::HomeUpwards
            | Operation::FindLinear { .. } => Report::LinearAt(Position::new(self.linear_mm)),
            Operation::MoveRotary { .. } | Operation::PrepareRotary => {
                Report::RotaryAt(Position::new(self.rotary_deg))
            }
            Operation::Measure { .. } => Report::Measured(Vec::new()),
            Operation::StopRotary => Report::RotaryStopped(Some(Position::new(self.rotary_deg))),
            Operation::StopMotion => {
                Report::Stopped((!self.is_lost).then_some(Position::new(self.linear_mm)))
            }
        }
    }

    pub(crate) fn perform(&mut self, operation: &Operation) -> Report {
        match operation {
            Operation::HomeLinear { .. } => {
                self.homings += 1;
                self.linear_mm = 49.0;
            }
            Operation::HomeUpwards => {
                self.linear_mm = 49.0;
                return Report::LinearHomed(Position::new(self.linear_mm));
            }
            Operation::PrepareRotary => self.rotary_deg = 0.0,
            Operation::MoveLinear { target, .. } => self.linear_mm = target.position().value(),
            Operation::MoveRotary { target, .. } => self.rotary_deg = target.position().value(),
            Operation::Measure { points, level } => {
                self.level_v = level.volt;
                if points.len() > 2 {
                    self.pressed_mm = self.surface_mm() - self.linear_mm - self.slip_mm;
                }
                let mut readings = Vec::new();
                for point in points {
                    let reading = self.reading(point);
                    let driven_s = self.now.since(reading.started).as_secs_f64();
                    if points.len() <= 2 && point.cycles > 1 {
                        self.listened.push(Listened {
                            is_test: point.frequency_hz < FREE_HZ - 1.0,
                            is_clear: points.len() == 2,
                            driven_s: driven_s + point.settle_s,
                            asked_s: point.settle_s,
                        });
                    }
                    readings.push(reading);
                }
                return Report::Measured(readings);
            }
            Operation::StopMotion
            | Operation::StopRotary
            | Operation::FindLinear { .. }
            | Operation::Descend { .. } => {}
        }
        self.stalled(operation)
    }

    /// Uniform noise of 0.1 % from a linear congruential generator (Knuth's MMIX constants).
    pub(crate) fn noise(&mut self) -> f64 {
        self.random =
            self.random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        1e-3 * ((self.random >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
    }

    /// How far the free resonance has drifted, Hz.
    pub(crate) fn drifted_hz(&self) -> f64 {
        self.drift_hz_per_s * self.now.as_micros() as f64 * 1e-6 + self.walked_hz
    }

    /// The walk of the free resonance in a tenth of a second.
    fn walk(&mut self) {
        if 0.0 < self.walk_hz_per_sqrt_hour {
            // Twelve uniform numbers with a variance of a third of 1e-6 each.
            let normal = 0.5e3 * (0..12).map(|_| self.noise()).sum::<f64>();
            self.walked_hz += self.walk_hz_per_sqrt_hour * (0.1_f64 / 3600.0).sqrt() * normal;
        }
    }

    /// Position of the linear stage at which the probe touches.
    fn surface_mm(&self) -> f64 {
        SURFACE_MM + 0.5 / self.rotary_deg.to_radians().cos() - 0.5
    }

    /// The impedance of a Butterworth–Van Dyke circuit, whose resonance jumps on contact.
    pub(crate) fn reading(&mut self, point: &SweepPoint) -> Reading {
        let is_touching = self.linear_mm + self.slip_mm <= self.surface_mm();
        let drifted_hz = self.drifted_hz();
        let softened_hz = self.softening_hz_per_v2 * self.level_v * self.level_v;
        let resonance_hz = drifted_hz - softened_hz + if is_touching { LOADED_HZ } else { FREE_HZ };
        if !self.measured_hz.1 && self.measured_hz.0 != point.frequency_hz {
            (self.measured_hz.0, self.set_at) = (point.frequency_hz, self.now);
        }
        let frequency_hz = self.measured_hz.0;
        let (q, c0, ratio) = (50.0, 27e-9, self.ratio);
        let u = frequency_hz / resonance_hz;
        let (real, imaginary) = (1.0 - u * u, u / q);
        let norm = real * real + imaginary * imaginary;
        // Y = jωC₀ (1 + m/(1 − u² + ju/Q)), Z = 1/Y.
        let omega_c0 = TAU * frequency_hz * c0;
        let (a, b) = (1.0 + ratio * real / norm, -ratio * imaginary / norm);
        let (g, s) = (-omega_c0 * b, omega_c0 * a);
        let size = g * g + s * s;
        let (noise_re, noise_im) = (self.noise(), self.noise());
        let fresh = PointResult::Value(Impedance {
            resistance_ohm: (g + s * noise_im) / size * (1.0 + noise_re),
            reactance_ohm: (-s + g * noise_im) / size * (1.0 + noise_re),
        });
        let measured = self.frozen.unwrap_or(fresh);
        self.last_read = Some(measured);
        Reading {
            // An analyzer sets its frequency in whole hundredths.
            frequency_hz: (100.0 * point.frequency_hz).round() / 100.0,
            measured,
            started: self.set_at,
            settle_s: point.settle_s,
            integration_s: f64::from(point.cycles) / point.frequency_hz,
        }
    }

    /// Prepares the rig and replays the plan until nothing is left to do.
    pub(crate) fn play(&mut self) {
        self.play_plan(&plan());
    }

    pub(crate) fn play_plan(&mut self, plan: &Plan) {
        self.play_while(plan, |_| true);
    }

    /// The same, until a condition holds.
    pub(crate) fn play_until(&mut self, is_reached: impl Fn(&Self) -> bool) {
        self.play_while(&plan(), |world| !is_reached(world));
    }

    fn play_while(&mut self, plan: &Plan, goes_on: impl Fn(&Self) -> bool) {
        self.command(Command::Prepare);
        let mut is_started = false;
        for _ in 0..2000 {
            if !goes_on(self) {
                return;
            }
            let state = self.engine.snapshot().state;
            match state {
                RigState::Idle if is_started => return,
                RigState::Idle => {
                    self.command(Command::Run(Box::new(plan.clone())));
                    is_started = true;
                }
                RigState::Latched => return,
                RigState::WaitingForPerson => self.answer(),
                RigState::Paused => {
                    // Somebody may reach in.
                    assert!((self.linear_mm - REST_MM).abs() < 0.011, "{} mm", self.linear_mm);
                    self.command(Command::Resume);
                }
                RigState::Preparing | RigState::Running | RigState::Retracting => self.step(),
            }
        }
        panic!("the run did not end");
    }

    /// A person answers what is asked.
    pub(crate) fn answer(&mut self) {
        let decision = self
            .engine
            .snapshot()
            .refused
            .map(|touch| Command::Decide { step: touch.step, answer: self.decision });
        self.command(decision.unwrap_or(Command::Answer));
    }

    pub(crate) fn endings(&self) -> Vec<RunStatus> {
        let ending = |event: &Event| match event {
            Event::RunFinished(status) => Some(*status),
            _ => None,
        };
        self.events.iter().filter_map(ending).collect()
    }
}
