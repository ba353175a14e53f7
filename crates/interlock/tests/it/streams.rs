//! Random streams of commands against a small bench with its own truth: the commands that the
//! interlock admits keep the invariants, for any commands in any order.

use std::time::Duration;

use proptest::{prelude::*, strategy::ValueTree};
use rig_interlock::{Outcome, PortCommand, Word};
use rig_model::{Position, RigTime};

use crate::bench::{DEEPEST_MM, REST_MM, SURFACE_MM, TOLERANCE_MM, fresh, limits, prepared};

/// One event of a stream.
#[derive(Debug, Clone)]
enum Step {
    Command(PortCommand, Response),
    /// A measurement, which continues during the next steps.
    BeginMeasure,
    EndMeasure,
    Intent(f64),
    Acknowledge,
    /// A person states that nothing is below the probe.
    StateNothingBelow,
    Latch,
    Stop,
    Pause(u64),
    /// A person moves the stage by hand.
    Nudge(f64),
    ReadBack,
}

/// The effect of a command on the device.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Response {
    Works,
    /// It stops halfway without an alarm.
    Stalls,
    /// It is done and the answer is lost.
    FailsDone,
    FailsUndone,
}

fn response() -> impl Strategy<Value = Response> {
    prop_oneof![
        12 => Just(Response::Works),
        1 => Just(Response::Stalls),
        1 => Just(Response::FailsDone),
        1 => Just(Response::FailsUndone),
    ]
}

fn command() -> impl Strategy<Value = PortCommand> {
    let heights = prop_oneof![
        3 => Just(REST_MM),
        1 => 1.0..49.0,
        4 => 8.5..11.0,
    ];
    let linear = (heights, prop_oneof![4 => Just(1.0), 2 => Just(10.0), 1 => 0.0..15.0]);
    let linear = linear.prop_map(|(mm, speed_mm_per_s)| PortCommand::MoveLinear {
        to: Position::new(mm),
        speed_mm_per_s,
    });
    let rotary = (-50.0..50.0, 1.0..25.0).prop_map(|(degrees, speed_deg_per_s)| {
        PortCommand::MoveRotary { to: Position::new(degrees), speed_deg_per_s }
    });
    let descent = (8.5..11.0, prop_oneof![4 => Just(1.0), 1 => 0.0..15.0]);
    let descent = descent.prop_map(|(mm, speed_mm_per_s)| PortCommand::Descend {
        to: Position::new(mm),
        speed_mm_per_s,
    });
    prop_oneof![
        12 => linear,
        2 => descent,
        4 => rotary,
        1 => Just(PortCommand::Stop),
        1 => Just(PortCommand::FindLinear),
        2 => Just(PortCommand::HomeLinear),
        2 => Just(PortCommand::HomeRotary),
        2 => Just(PortCommand::Measure),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        16 => (command(), response()).prop_map(|(command, response)| Step::Command(command, response)),
        1 => Just(Step::BeginMeasure),
        1 => Just(Step::EndMeasure),
        4 => prop_oneof![3 => 8.0..10.0, 1 => 8.0..20.0].prop_map(Step::Intent),
        3 => Just(Step::Acknowledge),
        1 => Just(Step::StateNothingBelow),
        1 => Just(Step::Latch),
        1 => Just(Step::Stop),
        1 => (0_u64..200).prop_map(Step::Pause),
        1 => (-5.0..5.0).prop_map(Step::Nudge),
        1 => Just(Step::ReadBack),
    ]
}

/// The true state of the bench.
struct Truth {
    linear_mm: f64,
    rotary_deg: f64,
    /// The linear stage was not read back since it was moved by hand.
    is_nudged: bool,
    /// The last fault was not acknowledged, and no start came after it.
    is_latched: bool,
    intent_mm: f64,
    is_measuring: bool,
    /// When a person stated that nothing is below the probe, with no linear command since.
    stated: Option<RigTime>,
    turns: u32,
    /// Those with the probe below the clear position.
    low_turns: u32,
    lowerings: u32,
    homings: u32,
}

impl Truth {
    fn expected_mm(&self) -> f64 {
        SURFACE_MM + 0.5 / self.rotary_deg.to_radians().cos() - 0.5
    }

    /// The highest place that an edge of the largest sample passes in a turn, by trying every tilt.
    fn highest_edge_mm(&self, to_deg: f64) -> f64 {
        let geometry = limits().geometry;
        let top_mm = geometry.surface_above_pivot_mm + TOLERANCE_MM;
        let of_tilt = |part: i32| {
            let tilt_deg = self.rotary_deg + (to_deg - self.rotary_deg) * f64::from(part) / 100.0;
            let (sin, cos) = tilt_deg.to_radians().sin_cos();
            SURFACE_MM - geometry.surface_above_pivot_mm
                + top_mm * cos
                + geometry.sample_half_width_mm * sin.abs()
        };
        (0..=100).map(of_tilt).fold(f64::MIN, f64::max)
    }

    /// The invariants, of a command that was let through.
    fn check(&self, now: RigTime, command: &PortCommand) {
        let is_way_out = match command {
            PortCommand::MoveLinear { to, .. } => to.value() >= REST_MM,
            PortCommand::Stop | PortCommand::FindLinear => true,
            _ => false,
        };
        assert!(is_way_out || !self.is_latched, "{command:?} while latched");
        match *command {
            PortCommand::MoveRotary { to, .. } => {
                let room_mm = self.linear_mm - self.highest_edge_mm(to.value());
                let is_up = self.linear_mm >= REST_MM - 0.011 || 0.48 < room_mm;
                assert!(is_up || self.is_nudged, "turned at {} mm", self.linear_mm);
            }
            PortCommand::HomeRotary => {
                let is_up = self.linear_mm >= REST_MM - 0.011;
                assert!(is_up || self.is_nudged, "homed at {} mm", self.linear_mm);
            }
            PortCommand::MoveLinear { to, speed_mm_per_s }
            | PortCommand::Descend { to, speed_mm_per_s }
                if to.value() < REST_MM =>
            {
                let to_mm = to.value();
                let tolerance_mm = TOLERANCE_MM / self.rotary_deg.to_radians().cos();
                let floor_mm = self.expected_mm() - tolerance_mm - DEEPEST_MM;
                assert!(to_mm >= floor_mm - 1e-3, "{to_mm} is below {floor_mm}");
                assert!(to_mm >= self.intent_mm, "{to_mm} was not declared");
                let highest_mm = self.expected_mm() + tolerance_mm;
                let depth_mm = self.linear_mm.min(highest_mm) - to_mm;
                if depth_mm > 1e-3 && !self.is_nudged {
                    assert!(speed_mm_per_s <= 1.0 + 1e-6, "{speed_mm_per_s} mm/s near the sample");
                    assert!(depth_mm <= tolerance_mm + DEEPEST_MM + 1e-3, "a step of {depth_mm}");
                }
            }
            PortCommand::Measure => assert!(!self.is_measuring),
            PortCommand::HomeLinear => {
                let age = self.stated.map(|at| now.since(at));
                assert!(age.is_some_and(|age| age.as_secs() <= 60), "homed, stated {age:?} ago");
            }
            _ => {}
        }
    }

    /// Carries a command out.
    fn perform(&mut self, command: &PortCommand, response: Response) -> Outcome {
        let part = match response {
            Response::Works | Response::FailsDone => 1.0,
            Response::Stalls => 0.5,
            Response::FailsUndone => 0.0,
        };
        let is_failed = matches!(response, Response::FailsDone | Response::FailsUndone);
        if matches!(
            command,
            PortCommand::MoveLinear { .. }
                | PortCommand::Descend { .. }
                | PortCommand::HomeLinear
                | PortCommand::FindLinear
        ) {
            self.stated = None;
        }
        let outcome = match *command {
            PortCommand::MoveLinear { to, .. } | PortCommand::Descend { to, .. } => {
                self.linear_mm += part * (to.value() - self.linear_mm);
                self.lowerings += u32::from(to.value() < REST_MM);
                self.is_nudged &= is_failed;
                Outcome::LinearAt(Position::new(self.linear_mm))
            }
            PortCommand::HomeLinear | PortCommand::FindLinear => {
                self.homings += u32::from(matches!(command, PortCommand::HomeLinear));
                self.is_nudged &= is_failed;
                Outcome::LinearAt(Position::new(self.linear_mm))
            }
            PortCommand::MoveRotary { to, .. } => {
                self.rotary_deg += part * (to.value() - self.rotary_deg);
                self.turns += 1;
                self.low_turns += u32::from(self.linear_mm < REST_MM - 0.011);
                self.intent_mm = f64::INFINITY;
                Outcome::RotaryAt(Position::new(self.rotary_deg))
            }
            PortCommand::HomeRotary => {
                self.intent_mm = f64::INFINITY;
                Outcome::RotaryAt(Position::new(self.rotary_deg))
            }
            PortCommand::JogLinear { .. }
            | PortCommand::JogRotary { .. }
            | PortCommand::ClearLinear
            | PortCommand::ClearRotary
            | PortCommand::SeekLinear
            | PortCommand::SeekRotary => {
                unreachable!("no stream commissions a rig")
            }
            PortCommand::Stop | PortCommand::Measure | PortCommand::Stream => Outcome::Done,
        };
        self.is_latched |= is_failed;
        if is_failed { Outcome::Failed } else { outcome }
    }
}

fn play(is_prepared: bool, steps: &[Step]) -> [u32; 4] {
    let mut now = RigTime::ZERO;
    let mut interlock = if is_prepared { prepared(now) } else { fresh() };
    let (linear_mm, rotary_deg) = if is_prepared { (REST_MM, 0.0) } else { (7.0, 12.0) };
    let mut truth = Truth {
        linear_mm,
        rotary_deg,
        is_nudged: false,
        is_latched: false,
        intent_mm: f64::INFINITY,
        is_measuring: false,
        stated: None,
        turns: 0,
        low_turns: 0,
        lowerings: 0,
        homings: 0,
    };
    for step in steps {
        now = now + Duration::from_millis(10);
        match step {
            Step::Command(PortCommand::Measure, _) | Step::BeginMeasure => {
                if interlock.admit(now, &PortCommand::Measure).is_ok() {
                    truth.check(now, &PortCommand::Measure);
                    truth.is_measuring = true;
                }
            }
            Step::EndMeasure if truth.is_measuring => {
                truth.is_measuring = false;
                interlock.ended(now, &PortCommand::Measure, &Outcome::Done);
            }
            Step::EndMeasure => {}
            Step::Command(command, response) => {
                if interlock.admit(now, command).is_ok() {
                    truth.check(now, command);
                    let outcome = truth.perform(command, *response);
                    interlock.ended(now, command, &outcome);
                }
            }
            Step::Intent(mm) => {
                truth.intent_mm = *mm;
                interlock.intent_is_durable(Position::new(*mm));
            }
            Step::Acknowledge => {
                truth.is_latched = false;
                interlock.operator(now, "somebody", Word::Acknowledgement).unwrap();
            }
            Step::StateNothingBelow => {
                truth.is_latched = false;
                truth.stated = Some(now);
                interlock.operator(now, "somebody", Word::NothingBelow).unwrap();
            }
            Step::Latch => {
                truth.is_latched = true;
                interlock.latched();
            }
            Step::Stop => {
                truth.stated = None;
                interlock.stop_asked(now, Duration::ZERO);
            }
            Step::Pause(seconds) => now = now + Duration::from_secs(*seconds),
            Step::Nudge(mm) => {
                truth.linear_mm = (truth.linear_mm + mm).clamp(8.5, 49.0);
                truth.is_nudged = true;
            }
            Step::ReadBack => {
                truth.is_nudged = false;
                interlock.read(now, &Outcome::LinearAt(Position::new(truth.linear_mm)));
            }
        }
    }
    [truth.turns, truth.low_turns, truth.lowerings, truth.homings]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, ..ProptestConfig::default() })]

    #[test]
    fn what_is_let_through_keeps_the_invariants(
        is_prepared: bool,
        steps in prop::collection::vec(step(), 1..80),
    ) {
        play(is_prepared, &steps);
    }
}

/// Streams that never got anywhere would prove nothing.
#[test]
fn the_streams_turn_the_sample_lower_the_probe_and_home_it() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let streams = prop::collection::vec(step(), 40);
    let mut counts = [0; 4];
    for _ in 0..500 {
        let steps = streams.new_tree(&mut runner).unwrap().current();
        let more = play(true, &steps);
        counts = std::array::from_fn(|of| counts[of] + more[of]);
    }
    let [turns, low, lowerings, homings] = counts;
    let is_enough = turns > 200 && low > 20 && lowerings > 100 && homings > 20;
    assert!(
        is_enough,
        "{turns} turns, {low} of them low, {lowerings} lowerings, {homings} homings"
    );
}
