//! The way down to the first search of a run.
//!
//! Before the first surface of a run only the rig file says where it lies. The probe goes down in steps to where the search
//! begins, and each reading is compared with the one before. A contact on the way ends the run: no surface may be
//! there, and one that lies far above its place would else be pressed deeper than it bears.

use rig_model::{Impedance, Mm, PointResult, Position, Reading};

use super::{Phase, TouchMachine};
use crate::{
    Fault, TouchResult,
    contact_sense::check_alive,
    listening::Decay,
    machine::{MachineContext, MachineEvent, MachineStep},
    search::relative_change,
};

/// The length of a step, as a part of the largest indentation. The sensor takes some periods to follow a contact, so
/// that one may be felt a step late.
const STEP_PART: f64 = 0.5;

#[derive(Debug)]
pub(super) struct WayDown {
    /// The search begins here, or a descent above it.
    to: Position<Mm>,
    commanded: Position<Mm>,
    here: Position<Mm>,
    before: Impedance,
    trail: Vec<(Position<Mm>, Reading)>,
}

impl TouchMachine {
    /// Goes down from the position where the probe was shown clear.
    pub(super) fn come_down(
        &mut self,
        before: Impedance,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let (limits, pose) = (context.limits, self.touch.pose);
        let approach = self.approach(context);
        let to = match approach.descent_mm_per_s {
            Some(_) => limits.highest_surface(pose.direction, pose.angle),
            None => self.expected(context).offset(approach.start_above_mm),
        };
        let rest = limits.linear.rest_target().position();
        let here = context.probe.height.unwrap_or(rest);
        self.phase =
            Phase::ComingDown(WayDown { to, commanded: here, here, before, trail: Vec::new() });
        self.step_down(context)
    }

    /// Goes down by a step, or begins the search if it begins within one.
    fn step_down(&mut self, context: &mut MachineContext<'_>) -> MachineStep<TouchResult> {
        let Phase::ComingDown(way) = &mut self.phase else {
            return MachineStep::Fault(MachineEvent::Begin.out_of_order("the way down"));
        };
        let motion = context.limits.motion;
        let next = way.commanded.offset(-STEP_PART * motion.max_indentation_mm);
        if next <= way.to {
            return self.begin_search(context);
        }
        way.commanded = next;
        context.move_linear(next, motion.travel_speed_mm_per_s)
    }

    /// Takes an event of the way down.
    pub(super) fn coming_down(
        &mut self,
        event: MachineEvent,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let Phase::ComingDown(way) = &mut self.phase else {
            return MachineStep::Fault(event.out_of_order("the way down"));
        };
        match event {
            MachineEvent::LinearAt(read_back) => {
                way.here = read_back;
                self.arrived(read_back, context.now);
                self.listen(Decay::Whole, context)
            }
            MachineEvent::Readings(readings) => self.on_way(&readings, context),
            event => MachineStep::Fault(event.out_of_order("the way down")),
        }
    }

    /// The impedance has been read on the way down.
    fn on_way(
        &mut self,
        readings: &[Reading],
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let expected = self.expected(context);
        let threshold = context.plan.touch.approach.contact_threshold;
        let Phase::ComingDown(way) = &mut self.phase else {
            return MachineStep::Fault(MachineEvent::Begin.out_of_order("the way down"));
        };
        way.trail.extend(readings.iter().map(|reading| (way.here, *reading)));
        let Some(PointResult::Value(now)) = readings.last().map(|last| last.measured) else {
            let trail = std::mem::take(&mut way.trail);
            return self.unreadable(trail, context);
        };
        if let Err(fault) = check_alive(&self.no_load, self.no_load.resonance_hz, way.before, now) {
            return MachineStep::Fault(Fault::ContactSense(fault));
        }
        let change = relative_change(way.before, now);
        // An impedance that cannot be compared counts as contact.
        let is_clear = change <= threshold;
        if !is_clear {
            let (at, change_percent) = (way.here, 100.0 * change);
            context.surface_not_found(std::mem::take(&mut way.trail), None);
            return MachineStep::Fault(Fault::ContactTooEarly { at, expected, change_percent });
        }
        way.before = now;
        (self.baseline, self.baseline_at) = (Some(now), context.now);
        self.step_down(context)
    }
}
