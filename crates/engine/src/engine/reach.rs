//! Where its moves can have led the linear stage, and whether it was read back elsewhere.

use rig_model::{Axis, Mm, Position, Span};

use crate::{Fault, Jump, Operation};

/// Largest distance of a stage that is found again from the path of its last moves, in tolerances
/// of its read-back: its drive was switched off or stopped in between.
const JUMP_TOLERANCES: f64 = 10.0;

/// Where the linear stage can be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Reach {
    /// Anywhere: it was never read back, or has lost its position and is being homed.
    Anywhere,
    /// Where its moves since its last confirmed read-back can have led it.
    Between(Span<Mm>),
    /// It was read back elsewhere, or is being homed anew, so that its position may be wrong.
    Jumped(Jump),
}

impl Reach {
    /// The stage was read back here, after a move or a homing that ended in order.
    pub(super) const fn at(position: Position<Mm>) -> Self {
        Self::Between(Span { min: position, max: position })
    }

    /// As the last program left it.
    pub(super) fn left(jump: Option<Jump>) -> Self {
        jump.map_or(Self::Anywhere, Self::Jumped)
    }

    pub(super) const fn jump(&self) -> Option<Jump> {
        match self {
            Self::Jumped(jump) => Some(*jump),
            _ => None,
        }
    }

    /// An operation is about to be sent.
    pub(super) fn extend(&mut self, operation: &Operation, axis: &Axis<Mm>) {
        if matches!(operation, Operation::HomeLinear { anew: true }) {
            // Its drive goes on saying that it is homed, also after a homing that has not ended.
            let last_moves = match *self {
                Self::Anywhere => axis.travel(),
                Self::Between(span) => span,
                Self::Jumped(jump) => jump.last_moves,
            };
            *self = Self::Jumped(Jump { last_moves, is_homing_open: true });
            return;
        }
        match (self, operation) {
            (
                Self::Between(span),
                Operation::MoveLinear { target, .. } | Operation::Descend { target, .. },
            ) => {
                let target = target.position();
                span.min = if target < span.min { target } else { span.min };
                span.max = if target > span.max { target } else { span.max };
            }
            (Self::Jumped(jump), Operation::HomeLinear { .. }) => jump.is_homing_open = true,
            // No move begins before it was read back where it can be.
            (Self::Jumped(_), _) => {}
            (reach, Operation::HomeLinear { .. } | Operation::HomeUpwards) => {
                *reach = Self::Anywhere;
            }
            _ => {}
        }
    }

    /// The stage was found here. A drive that was switched off may have a wrong position, and a retract from
    /// it could go into the sample.
    ///
    /// # Errors
    /// [`Fault::PositionJumped`] where no move can have led there.
    pub(super) fn find(&mut self, found: Position<Mm>, axis: &Axis<Mm>) -> Result<(), Fault> {
        let jump = match *self {
            Self::Anywhere => return Ok(()),
            Self::Between(last_moves) => Jump { last_moves, is_homing_open: false },
            Self::Jumped(jump) => jump,
        };
        let margin_mm = JUMP_TOLERANCES * axis.tolerance();
        let Span { min, max } = jump.last_moves;
        let within = Span { min: min.offset(-margin_mm), max: max.offset(margin_mm) };
        if within.contains(found) && !jump.is_homing_open {
            *self = Self::Between(jump.last_moves);
            return Ok(());
        }
        *self = Self::Jumped(jump);
        Err(Fault::PositionJumped { found, jump })
    }
}
