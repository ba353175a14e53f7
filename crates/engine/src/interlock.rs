//! The interlock: the one place that admits motion.
//!
//! ```text
//!              declare(down_to)           any linear move below rest
//!   ┌───────┐ ───────────────▶ ┌───────┐ ─────────────▶ ┌────────────┐
//!   │ Clear │                  │ Clear │                │ In contact │
//!   └───────┘ ◀─────┐          └───────┘                └────────────┘
//!       ▲           └── read-back of a move to rest ◀────────┘ │
//!       │                                                      │ a linear operation fails
//!       └───────────── read-back of a move to rest ── Unknown ◀┘
//! ```
//!
//! It is a table of states and transitions, so that a test can enumerate every history.

use rig_model::{Axis, Clearance, Mm, Position};

use crate::{Operation, Report};

/// An operation that the interlock forbids.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum InterlockError {
    /// The sample may be tilted only when the probe is proven clear.
    #[error("the rotary stage must not move: the probe is {}", .clearance.name())]
    RotaryNotClear {
        /// Clearance of the probe.
        clearance: Clearance,
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
    linear: Axis<Mm>,
    clearance: Clearance,
    floor: Position<Mm>,
    /// A person has stated that nothing is below the probe. It holds for one homing.
    is_nothing_below: bool,
}

impl Interlock {
    /// Starts with an unknown clearance: the probe may be anywhere.
    pub const fn new(linear: Axis<Mm>) -> Self {
        let floor = linear.rest_target().position();
        Self { linear, clearance: Clearance::Unknown, floor, is_nothing_below: false }
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

    /// Admits an operation that is about to be sent, and updates the clearance of the probe.
    ///
    /// # Errors
    /// [`InterlockError`] when the operation is not safe in the present state. Nothing changes
    /// then.
    pub fn admit(&mut self, operation: &Operation) -> Result<(), InterlockError> {
        let rest = self.linear.rest_target();
        match operation {
            Operation::HomeLinear => {
                if !std::mem::take(&mut self.is_nothing_below) {
                    return Err(InterlockError::HomingUnproven);
                }
                self.clearance = Clearance::Unknown;
            }
            Operation::FindLinear { .. } => self.clearance = Clearance::Unknown,
            Operation::PrepareRotary | Operation::MoveRotary { .. } => {
                if self.clearance != Clearance::Clear {
                    return Err(InterlockError::RotaryNotClear { clearance: self.clearance });
                }
            }
            Operation::MoveLinear { target, .. } if *target == rest => {}
            Operation::MoveLinear { target, .. } => {
                let target = target.position();
                if self.clearance == Clearance::Unknown {
                    return Err(InterlockError::LoweringFromUnknown { target });
                }
                if target < self.floor {
                    return Err(InterlockError::BelowDeclared { target, floor: self.floor });
                }
                self.clearance = Clearance::InContact;
            }
            Operation::Measure { .. } | Operation::StopMotion => {}
        }
        Ok(())
    }

    /// Takes the report of an admitted operation.
    pub fn ended(&mut self, operation: &Operation, report: Option<&Report>) {
        match (operation, report) {
            (Operation::MoveLinear { target, .. }, Some(Report::LinearAt(read_back))) => {
                let rest = self.linear.rest_target();
                if *target == rest {
                    let is_there = self.linear.is_at(*read_back, rest);
                    self.clearance = if is_there { Clearance::Clear } else { Clearance::Unknown };
                    self.floor = rest.position();
                }
            }
            (
                Operation::MoveLinear { .. } | Operation::HomeLinear | Operation::FindLinear { .. },
                _,
            ) => {
                self.clearance = Clearance::Unknown;
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use rig_model::{AxisLimits, Deg, DriveLevel, Span};

    use super::*;

    fn linear() -> Axis<Mm> {
        Axis::new(
            "linear stage",
            AxisLimits {
                travel: Span::new(0.0, 50.0),
                soft: Span::new(1.0, 49.0),
                rest: Position::new(40.0),
                tolerance: 0.01,
                max_speed_per_s: 10.0,
            },
        )
        .unwrap()
    }

    fn rotary() -> Axis<Deg> {
        Axis::new(
            "rotary stage",
            AxisLimits {
                travel: Span::new(-90.0, 90.0),
                soft: Span::new(-50.0, 50.0),
                rest: Position::new(0.0),
                tolerance: 0.01,
                max_speed_per_s: 10.0,
            },
        )
        .unwrap()
    }

    fn move_linear(mm: f64) -> Operation {
        let target = linear().target(Position::new(mm)).unwrap();
        Operation::MoveLinear { target, speed_mm_per_s: 1.0 }
    }

    /// Every operation of interest with every way in which it can end.
    fn moves() -> Vec<(Operation, Option<Report>)> {
        let at = |mm| Some(Report::LinearAt(Position::new(mm)));
        let target = rotary().target(Position::new(30.0)).unwrap();
        let rotate = Operation::MoveRotary { target, speed_deg_per_s: 1.0 };
        let measure = Operation::Measure { points: Vec::new(), level: DriveLevel { volt: 1.0 } };
        vec![
            (Operation::HomeLinear, at(49.0)),
            (Operation::HomeLinear, None),
            (move_linear(40.0), at(40.005)),
            // A stall on the way up: the move has ended, but not where it should.
            (move_linear(40.0), at(20.0)),
            (move_linear(40.0), None),
            (move_linear(20.0), at(20.0)),
            (move_linear(20.0), None),
            (move_linear(18.0), at(18.0)),
            (rotate, Some(Report::RotaryAt(Position::new(30.0)))),
            (Operation::PrepareRotary, None),
            (Operation::StopMotion, Some(Report::Stopped)),
            (measure, None),
        ]
    }

    /// The truth about the probe, kept without the interlock's logic: the last linear operation
    /// either ended at rest as read back, or the probe counts as down.
    fn is_up(history: &[(Operation, Option<Report>)]) -> bool {
        let is_linear = |operation: &Operation| {
            matches!(operation, Operation::MoveLinear { .. } | Operation::HomeLinear)
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
            let mut interlock = Interlock::new(linear());
            interlock.declare(Position::new(19.0));
            let mut history: Vec<(Operation, Option<Report>)> = Vec::new();
            let mut rest_of_code = code;
            for _ in 0..5 {
                let (operation, report) = &moves[rest_of_code % moves.len()];
                rest_of_code /= moves.len();
                if *operation == Operation::HomeLinear {
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
        let mut interlock = Interlock::new(linear());
        for _ in 0..2 {
            let refused = interlock.admit(&Operation::HomeLinear);
            assert_eq!(refused, Err(InterlockError::HomingUnproven));
            interlock.state_nothing_below();
            interlock.admit(&Operation::HomeLinear).unwrap();
            interlock.ended(&Operation::HomeLinear, Some(&Report::LinearAt(Position::new(49.0))));
        }
        // A clear probe proves nothing about what is below it.
        interlock.admit(&move_linear(40.0)).unwrap();
        let clear = Report::LinearAt(Position::new(40.0));
        interlock.ended(&move_linear(40.0), Some(&clear));
        assert_eq!(interlock.clearance(), Clearance::Clear);
        interlock.admit(&Operation::HomeLinear).unwrap_err();
    }

    #[test]
    fn a_declaration_ends_when_the_probe_is_clear_again() {
        let mut interlock = Interlock::new(linear());
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
}
