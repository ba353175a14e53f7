//! A person who moves an idle rig by hand: into the sample, and then the sample under the probe.

use rig_engine::Command;
use rig_model::{Clearance, Position};
use rigd::rig::{RigHandle, Status};

use super::Life;

/// How deep the person lowers the probe into the sample, mm.
const DEPTH_MM: f64 = 0.3;

/// The tilt to which the person turns the sample, °.
const TILT_DEG: f64 = 20.0;

/// A move of a person.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ByHand {
    /// The probe into the sample.
    Lower,
    /// The sample.
    Turn,
}

impl Life<'_> {
    /// The next move of the person on an idle rig. At last the probe is taken clear. Returns whether the
    /// person has asked for one.
    pub(super) async fn moves_by_hand(&mut self, handle: &RigHandle, status: &Status) -> bool {
        let command = match self.by_hand.pop() {
            Some(ByHand::Lower) => {
                let truth =
                    self.simulation.as_ref().map(|rig| rig.with(|now, rig| rig.world().truth(now)));
                // Without a sample there is nothing to lower the probe into.
                let Some(truth) = truth.filter(|truth| truth.indentation_mm.is_finite()) else {
                    self.by_hand.clear();
                    return false;
                };
                let at_mm = truth.tip_mm + truth.indentation_mm - DEPTH_MM;
                Command::MoveLinear(Position::new(at_mm))
            }
            Some(ByHand::Turn) => Command::MoveRotary(Position::new(TILT_DEG)),
            None if status.snapshot.clearance != Clearance::Clear => {
                Command::MoveLinear(self.bench.rest())
            }
            None => return false,
        };
        // What the rig does not allow is refused, and the person goes on.
        _ = handle.command(command, None, "by hand").await;
        true
    }
}
