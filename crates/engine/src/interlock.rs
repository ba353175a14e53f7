//! The interlock: the one place that admits motion.
//!
//! ```text
//!              declare(down_to)           any linear move below rest
//!   ┌───────┐ ───────────────▶ ┌───────┐ ─────────────▶ ┌────────────┐
//!   │ Clear │                  │ Clear │                │ In contact │
//!   └───────┘ ◀─────┐          └───────┘                └────────────┘
//!       ▲           └── read-back of a retract ◀─────────────┘ │
//!       │                                                      │ a linear operation fails
//!       └──────── read-back of a move to rest or above ── Unknown ◀┘
//! ```
//!
//! A retract goes to the clear position, or only above everything that the sample reaches in its next turn. The
//! sample then turns no further than that, and a declaration ends with each retract and each turn.
//!
//! It is a table of states and transitions, so that a test can enumerate every history.

use rig_model::{Clearance, Deg, Mm, Position, RigLimits, Target};

use rig_protocol::Pose;

use crate::{Operation, Report};

/// An operation that the interlock forbids.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum InterlockError {
    /// The sample may be tilted only when the probe is proven clear.
    #[error("the rotary stage must not move: the probe is {}", .clearance.text())]
    RotaryNotClear {
        /// Clearance of the probe.
        clearance: Clearance,
    },
    /// The probe is clear, but not of everything that the sample reaches in this turn.
    #[error(
        "the rotary stage must not move to {to}: the probe is at {at}, and the sample reaches to below \
         {clear} on the way"
    )]
    RotaryTooLow {
        /// Refused target of the rotary stage.
        to: Position<Deg>,
        /// The linear stage as read back.
        at: Position<Mm>,
        /// The lowest position for this turn.
        clear: Position<Mm>,
    },
    /// The probe may be lowered only from a known state.
    #[error("the probe must not be lowered to {target}: it is not known where it is")]
    LoweringFromUnknown {
        /// Refused target of the linear stage, mm.
        target: Position<Mm>,
    },
    /// Homing in an unknown direction may lead into a sample, wherever the probe was last.
    #[error(
        "the linear stage must not be homed: nobody has stated that nothing is below the probe"
    )]
    HomingUnproven,
    /// The probe may be lowered only as far as was declared before.
    #[error("the probe must not be lowered to {target}: the lowest declared is {floor}")]
    BelowDeclared {
        /// Refused target of the linear stage, mm.
        target: Position<Mm>,
        /// The lowest position declared.
        floor: Position<Mm>,
    },
}

/// Knows whether the probe is clear, and admits or refuses each operation.
#[derive(Debug, Clone, PartialEq)]
pub struct Interlock {
    limits: RigLimits,
    clearance: Clearance,
    floor: Position<Mm>,
    /// Where a retract has ended, as read back, until the next move of the linear stage.
    height: Option<Position<Mm>>,
    /// The rotary stage as last read back, until it turns.
    tilt: Option<Position<Deg>>,
    /// Where the next retract ends, if it is below the clear position.
    low: Option<Target<Mm>>,
    /// A person has stated that nothing is below the probe. It holds for one homing.
    is_nothing_below: bool,
}

/// What is proven of the probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Proven {
    pub(crate) clearance: Clearance,
    /// Where the probe is clear, as read back.
    pub(crate) height: Option<Position<Mm>>,
    /// The rotary stage as last read back.
    pub(crate) tilt: Option<Position<Deg>>,
}

impl Proven {
    /// Where the probe must be before the sample turns to this pose, or before a person comes near it.
    pub(crate) fn clear_before(&self, next: Option<Pose>, limits: &RigLimits) -> Target<Mm> {
        let tilts = self.tilt.zip(next.map(|pose| pose.direction.rotary_position(pose.angle)));
        tilts.map_or(limits.linear.rest_target(), |(from, to)| limits.clear_for_turn(from, to))
    }

    /// Whether the probe is proven clear at this position or above it.
    pub(crate) fn is_above(&self, clear: Target<Mm>, limits: &RigLimits) -> bool {
        let lowest = clear.position().offset(-limits.linear.tolerance());
        self.clearance == Clearance::Clear && self.height.is_some_and(|at| lowest <= at)
    }
}

impl Interlock {
    /// Starts with an unknown clearance: the probe may be anywhere.
    pub const fn new(limits: RigLimits) -> Self {
        let floor = limits.linear.rest_target().position();
        Self {
            limits,
            clearance: Clearance::Unknown,
            floor,
            height: None,
            tilt: None,
            low: None,
            is_nothing_below: false,
        }
    }

    /// What is proven of the probe.
    pub(crate) const fn proven(&self) -> Proven {
        Proven { clearance: self.clearance, height: self.height, tilt: self.tilt }
    }

    /// Clearance of the probe.
    pub const fn clearance(&self) -> Clearance {
        self.clearance
    }

    /// Takes the probe for lowered until a read-back shows it clear.
    pub const fn assume_contact(&mut self) {
        self.clearance = Clearance::InContact;
    }

    /// Allows one homing in an unknown direction: a person has stated that nothing is below the probe.
    pub(crate) const fn state_nothing_below(&mut self) {
        self.is_nothing_below = true;
    }

    /// Allows lowering as far as `down_to`. The caller has made the intent durable.
    pub(crate) fn declare(&mut self, down_to: Position<Mm>) {
        self.floor = down_to;
    }

    /// The next move of the linear stage, to this target, is a retract.
    pub(crate) fn retract_to(&mut self, target: Target<Mm>) {
        self.low = Some(target).filter(|target| *target != self.limits.linear.rest_target());
    }

    /// Whether a retract to `low` clears the sample at the present tilt.
    fn is_clear_here(&self, low: Target<Mm>) -> bool {
        self.tilt.is_some_and(|tilt| self.limits.clear_at(tilt).position() <= low.position())
    }

    /// Admits an operation that is about to be sent, and updates the clearance of the probe.
    ///
    /// # Errors
    /// [`InterlockError`] when the operation is not safe in the present state. Nothing changes
    /// then.
    pub fn admit(&mut self, operation: &Operation) -> Result<(), InterlockError> {
        let rest = self.limits.linear.rest_target();
        match operation {
            Operation::HomeLinear { .. } => {
                if !std::mem::take(&mut self.is_nothing_below) {
                    return Err(InterlockError::HomingUnproven);
                }
                (self.clearance, self.height) = (Clearance::Unknown, None);
            }
            Operation::FindLinear { .. } | Operation::HomeUpwards => {
                (self.clearance, self.height) = (Clearance::Unknown, None);
            }
            Operation::PrepareRotary => self.admit_turn(None)?,
            Operation::MoveRotary { target, .. } => self.admit_turn(Some(*target))?,
            // The clear position, or above it.
            Operation::MoveLinear { target, .. } if rest.position() <= target.position() => {
                self.height = None;
            }
            Operation::MoveLinear { target, .. } | Operation::Descend { target, .. } => {
                let target = target.position();
                if self.clearance == Clearance::Unknown {
                    return Err(InterlockError::LoweringFromUnknown { target });
                }
                if target < self.floor {
                    return Err(InterlockError::BelowDeclared { target, floor: self.floor });
                }
                (self.clearance, self.height) = (Clearance::InContact, None);
            }
            Operation::Measure { .. } | Operation::StopMotion | Operation::StopRotary => {}
        }
        Ok(())
    }

    /// A turn to this target, or with homing.
    fn admit_turn(&mut self, target: Option<Target<Deg>>) -> Result<(), InterlockError> {
        let at = match (self.clearance, self.height) {
            (Clearance::Clear, Some(at)) => at,
            (clearance, _) => return Err(InterlockError::RotaryNotClear { clearance }),
        };
        let to = target.map_or(self.limits.rotary.rest_target(), |target| target).position();
        let clear = match (self.tilt, target) {
            (Some(tilt), Some(_)) => self.limits.clear_for_turn(tilt, to),
            _ => self.limits.linear.rest_target(),
        };
        let clear = clear.position();
        if at < clear.offset(-self.limits.linear.tolerance()) {
            return Err(InterlockError::RotaryTooLow { to, at, clear });
        }
        (self.tilt, self.floor) = (None, at);
        Ok(())
    }

    /// Takes the report of an admitted operation.
    pub fn ended(&mut self, operation: &Operation, report: Option<&Report>) {
        let low = self.low.take_if(|_| !matches!(operation, Operation::Measure { .. }));
        match (operation, report) {
            (Operation::MoveLinear { target, .. }, Some(Report::LinearAt(read_back))) => {
                let rest = self.limits.linear.rest_target().position();
                let is_up = rest <= target.position();
                let is_low = low == Some(*target) && self.is_clear_here(*target);
                if is_up || is_low {
                    let is_there = self.limits.linear.is_at(*read_back, *target);
                    self.clearance = if is_there { Clearance::Clear } else { Clearance::Unknown };
                    self.height = is_there.then_some(*read_back);
                    self.floor = if is_up { rest } else { target.position() };
                }
            }
            (Operation::MoveRotary { .. } | Operation::PrepareRotary, report) => {
                self.tilt = match report {
                    Some(Report::RotaryAt(read_back)) => Some(*read_back),
                    _ => None,
                };
                let rest = self.limits.linear.rest_target();
                // The sample may stand, or turn, where its edge reaches a probe below the clear position.
                if self.tilt.is_none() && !self.proven().is_above(rest, &self.limits) {
                    (self.clearance, self.height) = (Clearance::Unknown, None);
                }
            }
            (
                Operation::MoveLinear { .. }
                | Operation::HomeLinear { .. }
                | Operation::HomeUpwards
                | Operation::FindLinear { .. },
                _,
            )
            | (Operation::Descend { .. }, None) => {
                self.clearance = Clearance::Unknown;
            }
            _ => {}
        }
    }
}

#[cfg(test)]
#[path = "../../model/tests/support/limits.rs"]
pub(crate) mod bench;

#[cfg(test)]
mod tests {
    use rig_model::DriveLevel;

    use super::{bench::limits, *};

    fn move_linear(mm: f64) -> Operation {
        let target = limits().linear.target(Position::new(mm)).unwrap();
        Operation::MoveLinear { target, speed_mm_per_s: 1.0 }
    }

    /// Every operation of interest with every way in which it can end.
    fn moves() -> Vec<(Operation, Option<Report>)> {
        let at = |mm| Some(Report::LinearAt(Position::new(mm)));
        let target = limits().rotary.target(Position::new(30.0)).unwrap();
        let rotate = Operation::MoveRotary { target, speed_deg_per_s: 1.0 };
        let measure = Operation::Measure { points: Vec::new(), level: DriveLevel { volt: 1.0 } };
        vec![
            (Operation::HomeLinear { anew: true }, at(49.0)),
            (Operation::HomeLinear { anew: true }, None),
            (move_linear(40.0), at(40.005)),
            // A stall on the way up: the move has ended, but not where it should.
            (move_linear(40.0), at(20.0)),
            (move_linear(40.0), None),
            (move_linear(20.0), at(20.0)),
            (move_linear(20.0), None),
            (move_linear(18.0), at(18.0)),
            (rotate, Some(Report::RotaryAt(Position::new(30.0)))),
            (Operation::PrepareRotary, None),
            (Operation::StopMotion, Some(Report::Stopped(None))),
            (measure, None),
        ]
    }

    /// The truth about the probe, kept without the interlock's logic: the last linear operation
    /// either ended at rest as read back, or the probe counts as down.
    fn is_up(history: &[(Operation, Option<Report>)]) -> bool {
        let is_linear = |operation: &Operation| {
            matches!(operation, Operation::MoveLinear { .. } | Operation::HomeLinear { .. })
        };
        history.iter().rev().find(|(operation, _)| is_linear(operation)).is_some_and(|last| {
            last.0 == move_linear(40.0) && last.1 == Some(Report::LinearAt(Position::new(40.005)))
        })
    }

    #[test]
    fn in_all_histories_of_five_operations_the_sample_turns_only_under_a_clear_probe() {
        let moves = moves();
        let mut rotations = 0_u32;
        for code in 0..moves.len().pow(5) {
            let mut interlock = Interlock::new(limits());
            interlock.declare(Position::new(19.0));
            let mut history: Vec<(Operation, Option<Report>)> = Vec::new();
            let mut rest_of_code = code;
            for _ in 0..5 {
                let (operation, report) = &moves[rest_of_code % moves.len()];
                rest_of_code /= moves.len();
                if matches!(operation, Operation::HomeLinear { .. }) {
                    interlock.state_nothing_below();
                }
                let is_admitted = interlock.admit(operation).is_ok();
                match operation {
                    Operation::MoveRotary { .. } | Operation::PrepareRotary => {
                        assert_eq!(is_admitted, is_up(&history), "{history:?}");
                        rotations += u32::from(is_admitted);
                    }
                    Operation::MoveLinear { target, .. } => {
                        let is_deep = target.position().value() < 19.0;
                        assert!(!(is_admitted && is_deep), "{history:?}");
                    }
                    _ => assert!(is_admitted),
                }
                if is_admitted {
                    interlock.ended(operation, report.as_ref());
                    history.push((operation.clone(), report.clone()));
                }
            }
        }
        assert!(rotations > 1000, "the histories hardly ever reached a rotation: {rotations}");
    }

    #[test]
    fn one_homing_in_an_unknown_direction_follows_each_statement_that_nothing_is_below() {
        let mut interlock = Interlock::new(limits());
        for _ in 0..2 {
            let refused = interlock.admit(&Operation::HomeLinear { anew: false });
            assert_eq!(refused, Err(InterlockError::HomingUnproven));
            interlock.state_nothing_below();
            interlock.admit(&Operation::HomeLinear { anew: false }).unwrap();
            interlock.ended(
                &Operation::HomeLinear { anew: false },
                Some(&Report::LinearAt(Position::new(49.0))),
            );
        }
        // A clear probe proves nothing about what is below it.
        interlock.admit(&move_linear(40.0)).unwrap();
        let clear = Report::LinearAt(Position::new(40.0));
        interlock.ended(&move_linear(40.0), Some(&clear));
        assert_eq!(interlock.clearance(), Clearance::Clear);
        interlock.admit(&Operation::HomeLinear { anew: false }).unwrap_err();
    }

    #[test]
    fn the_probe_is_not_lowered_from_where_it_is_not_known() {
        let mut interlock = Interlock::new(limits());
        let lift = move_linear(40.0);
        let lower = move_linear(20.0);
        let target = Position::new(20.0);
        for _ in 0..2 {
            interlock.declare(Position::new(19.0));
            let refusal = interlock.admit(&lower).unwrap_err();
            assert_eq!(refusal, InterlockError::LoweringFromUnknown { target });
            interlock.admit(&lift).unwrap();
            interlock.ended(&lift, Some(&Report::LinearAt(Position::new(40.0))));
            interlock.declare(Position::new(19.0));
            interlock.admit(&lower).unwrap();
            // Nobody knows where a move that failed has ended.
            interlock.ended(&lower, None);
        }
    }

    #[test]
    fn a_declaration_ends_when_the_probe_is_clear_again() {
        let mut interlock = Interlock::new(limits());
        let clear = (move_linear(40.0), Report::LinearAt(Position::new(40.0)));
        interlock.admit(&clear.0).unwrap();
        interlock.ended(&clear.0, Some(&clear.1));
        let refusal = interlock.admit(&move_linear(20.0)).unwrap_err();
        assert_eq!(
            refusal.to_string(),
            "the probe must not be lowered to 20.000 mm: the lowest declared is 40.000 mm"
        );
        interlock.declare(Position::new(19.5));
        interlock.admit(&move_linear(20.0)).unwrap();
        assert_eq!(interlock.clearance(), Clearance::InContact);
        interlock.admit(&clear.0).unwrap();
        interlock.ended(&clear.0, Some(&clear.1));
        assert!(interlock.admit(&move_linear(20.0)).is_err());
    }

    /// The highest place that the edges of the largest sample pass in a turn, by trying every tilt.
    fn highest_edge_mm(from_deg: f64, to_deg: f64) -> f64 {
        let geometry = limits().geometry;
        let top_mm = geometry.surface_above_pivot_mm + geometry.surface_tolerance_mm;
        let level_mm = geometry.surface.value() - geometry.surface_above_pivot_mm;
        let of_tilt = |part: i32| {
            let tilt_deg = from_deg + (to_deg - from_deg) * f64::from(part) / 1000.0;
            let (sin, cos) = tilt_deg.to_radians().sin_cos();
            level_mm + top_mm * cos + geometry.sample_half_width_mm * sin.abs()
        };
        (0..=1000).map(of_tilt).fold(f64::MIN, f64::max)
    }

    #[test]
    fn a_retract_may_end_above_the_edges_of_the_next_turn_and_admits_no_other_turn() {
        let limits = limits();
        let turn_to = |degrees| Operation::MoveRotary {
            target: limits.rotary.target(Position::new(degrees)).unwrap(),
            speed_deg_per_s: 1.0,
        };
        let lift = move_linear(40.0);
        let mut low_turns = 0;
        for from_deg in [0.0, 15.0, -15.0, 30.0, -45.0] {
            for to_deg in [0.0, 15.0, -30.0, 45.0, 50.0] {
                let mut interlock = Interlock::new(limits);
                interlock.admit(&lift).unwrap();
                interlock.ended(&lift, Some(&Report::LinearAt(Position::new(40.0))));
                let turn = turn_to(from_deg);
                interlock.admit(&turn).unwrap();
                interlock.ended(&turn, Some(&Report::RotaryAt(Position::new(from_deg))));
                interlock.declare(Position::new(9.5));
                let down = move_linear(10.0);
                interlock.admit(&down).unwrap();
                interlock.ended(&down, Some(&Report::LinearAt(Position::new(10.0))));

                let (from, to) = (Position::new(from_deg), Position::new(to_deg));
                let low = limits.clear_for_turn(from, to);
                interlock.retract_to(low);
                let up = Operation::MoveLinear { target: low, speed_mm_per_s: 1.0 };
                interlock.admit(&up).unwrap();
                assert!(interlock.admit(&turn_to(to_deg)).is_err(), "before the read-back");
                interlock.ended(&up, Some(&Report::LinearAt(low.position())));
                assert_eq!(interlock.clearance(), Clearance::Clear);
                // The declaration has ended with the retract.
                assert!(interlock.clone().admit(&move_linear(10.0)).is_err());
                for other_deg in -50..=50 {
                    let other_deg = f64::from(other_deg);
                    let room_mm = low.position().value() - highest_edge_mm(from_deg, other_deg);
                    if interlock.clone().admit(&turn_to(other_deg)).is_ok() {
                        assert!(0.49 < room_mm, "{from_deg}° to {other_deg}°: {room_mm} mm");
                        low_turns += 1;
                    } else {
                        assert!(room_mm < 0.6, "{from_deg}° to {other_deg}°: {room_mm} mm");
                    }
                }
                interlock.admit(&turn_to(to_deg)).unwrap();
                let homing = interlock.clone().admit(&Operation::PrepareRotary);
                assert!(homing.is_err(), "a homing may turn anywhere");
            }
        }
        assert!(500 < low_turns, "{low_turns}");
    }

    #[test]
    fn a_retract_that_ends_too_low_or_elsewhere_proves_nothing() {
        let limits = limits();
        let level = Position::new(0.0);
        let begin = || {
            let mut interlock = Interlock::new(limits);
            for (operation, report) in [
                (move_linear(40.0), Report::LinearAt(Position::new(40.0))),
                (Operation::PrepareRotary, Report::RotaryAt(level)),
            ] {
                interlock.admit(&operation).unwrap();
                interlock.ended(&operation, Some(&report));
            }
            interlock.declare(Position::new(9.5));
            let down = move_linear(10.0);
            interlock.admit(&down).unwrap();
            interlock.ended(&down, Some(&Report::LinearAt(Position::new(10.0))));
            interlock
        };
        let low = limits.clear_for_turn(level, Position::new(30.0));
        let below = limits.linear.target(Position::new(10.9)).unwrap();
        for (target, at_mm, expected) in [
            (low, low.position().value(), Clearance::Clear),
            (low, low.position().value() - 0.02, Clearance::Unknown),
            // A search goes up to places like this one.
            (below, 10.9, Clearance::InContact),
        ] {
            let mut interlock = begin();
            interlock.retract_to(target);
            let up = Operation::MoveLinear { target, speed_mm_per_s: 1.0 };
            interlock.admit(&up).unwrap();
            interlock.ended(&up, Some(&Report::LinearAt(Position::new(at_mm))));
            assert_eq!(interlock.clearance(), expected, "{at_mm} mm");
        }
        // A move to the same place is no retract.
        let mut interlock = begin();
        let up = Operation::MoveLinear { target: low, speed_mm_per_s: 1.0 };
        interlock.admit(&up).unwrap();
        interlock.ended(&up, Some(&Report::LinearAt(low.position())));
        assert_eq!(interlock.clearance(), Clearance::InContact);
    }

    #[test]
    fn below_the_clear_position_a_probe_is_not_clear_of_a_sample_whose_tilt_is_unknown() {
        let limits = limits();
        let rest = move_linear(40.0);
        let turn = Operation::MoveRotary {
            target: limits.rotary.target(Position::new(10.0)).unwrap(),
            speed_deg_per_s: 1.0,
        };
        let level = Position::new(0.0);
        let low = limits.clear_for_turn(level, Position::new(10.0));
        let up = Operation::MoveLinear { target: low, speed_mm_per_s: 1.0 };
        for (is_low, expected) in [(true, Clearance::Unknown), (false, Clearance::Clear)] {
            let mut interlock = Interlock::new(limits);
            for (operation, report) in [
                (&rest, Report::LinearAt(Position::new(40.0))),
                (&Operation::PrepareRotary, Report::RotaryAt(level)),
            ] {
                interlock.admit(operation).unwrap();
                interlock.ended(operation, Some(&report));
            }
            if is_low {
                interlock.declare(Position::new(9.5));
                interlock.retract_to(low);
                interlock.admit(&up).unwrap();
                interlock.ended(&up, Some(&Report::LinearAt(low.position())));
            }
            interlock.admit(&turn).unwrap();
            interlock.ended(&turn, None);
            assert_eq!(interlock.clearance(), expected);
        }
    }
}
