//! The descent of a touch, and the search in steps that follows where it does not find the surface.

use std::time::Duration;

use rig_model::{Impedance, Mm, Position, RigTime};
use rig_protocol::{Approach, descent_speed};

use super::{Phase, TouchMachine};
use crate::{
    Event, Fault, Operation, TouchResult,
    descent::{Descent, DescentSetting, DescentStep, Streamed, Vigil},
    machine::{MachineContext, MachineEvent, MachineStep},
    search::{Near, Search},
};

/// The interlock knows the surface from the tilt as it is read back, the engine from the one that was asked for, mm.
const MARGIN_MM: f64 = 0.02;

impl TouchMachine {
    /// Begins a descent as fast as the protocol asks for, or as fast as the readings of the analyzer allow.
    pub(super) fn begin_descent(
        &mut self,
        (approach, planned_mm_per_s): (Approach, f64),
        baseline: Impedance,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let reading_s = self.reading_s(context);
        let coarse_mm = approach.coarse_step_mm;
        let Some(speed_mm_per_s) = descent_speed(planned_mm_per_s, coarse_mm, reading_s) else {
            let reason = format!(
                "a reading takes {:.0} ms: no descent is faster than the search in steps and \
                 presses no deeper than coarse_step_mm = {coarse_mm}",
                1e3 * reading_s
            );
            context.surface_not_found(Vec::new(), Some(reason));
            return self.search_in_steps(None, context);
        };
        let (limits, pose, expected) = (context.limits, self.touch.pose, self.expected(context));
        let floor = Search::floor(&approach, expected);
        // The interlock in front of the ports admits no longer step below the highest surface.
        let deepest = expected.offset(MARGIN_MM - limits.motion.max_indentation_mm);
        let (point, _) = context.listening(&self.no_load).stream();
        let setting = DescentSetting {
            approach: &approach,
            expected,
            floor: if floor < deepest { deepest } else { floor },
            highest: limits.highest_surface(pose.direction, pose.angle),
            near: self.near(&approach, expected, context),
            speed_mm_per_s,
            point,
            reading_s,
            stream: limits.analyzer.stream,
            baseline,
        };
        let (descent, step) = Descent::begin(&setting, &self.no_load);
        self.phase = Phase::Descending(Box::new(descent));
        self.follow_descent(step, context)
    }

    /// The time of a reading of a stream, s. An analyzer may integrate longer than it was asked to, as in the self-test,
    /// which has the same cycles.
    fn reading_s(&self, context: &MachineContext<'_>) -> f64 {
        let (point, _) = context.listening(&self.no_load).stream();
        let asked_s = f64::from(point.cycles) / point.frequency_hz;
        asked_s.max(self.integration_s)
            + context.limits.analyzer.stream.overhead_s.unwrap_or_default()
    }

    /// Takes an event of the descent.
    pub(super) fn descending(
        &mut self,
        event: MachineEvent,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let Phase::Descending(descent) = &mut self.phase else {
            return MachineStep::Fault(event.out_of_order("a descent"));
        };
        let step = match event {
            MachineEvent::LinearAt(read_back) => {
                let step = descent.arrived(read_back);
                self.arrived(read_back, context.now);
                let due_s = context.listening(&self.no_load).stream_due_s();
                if due_s > 0.0 {
                    return MachineStep::Wait(Duration::from_secs_f64(due_s));
                }
                step
            }
            // The way down after the vibration has decayed.
            MachineEvent::Waited => descent.go_down(),
            MachineEvent::Descended { at, way } => {
                let tolerance_mm = context.limits.linear.tolerance();
                let (descended, step) = descent.ended(at, way, tolerance_mm);
                context.notes.push(Event::Descended(Box::new(descended)));
                self.arrived(at, context.now);
                step
            }
            MachineEvent::Readings(readings) => descent.read_at_rest(&readings),
            event => return MachineStep::Fault(event.out_of_order("a descent")),
        };
        self.follow_descent(step, context)
    }

    fn follow_descent(
        &mut self,
        step: DescentStep,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let Phase::Descending(descent) = &self.phase else {
            return MachineStep::Fault(MachineEvent::Begin.out_of_order("a descent"));
        };
        let (trail, reference) = (descent.trail().to_vec(), descent.reference());
        let (point, level) = context.listening(&self.no_load).stream();
        match step {
            DescentStep::MoveTo(to) => {
                context.move_linear(to, context.limits.motion.travel_speed_mm_per_s)
            }
            DescentStep::GoDown(to) => {
                let speed_mm_per_s = descent.speed_mm_per_s();
                match context.limits.linear.target(to) {
                    Ok(target) => {
                        let descend = Operation::Descend { target, speed_mm_per_s, point, level };
                        MachineStep::Do(descend)
                    }
                    Err(error) => MachineStep::Fault(Fault::LinearTarget(error)),
                }
            }
            DescentStep::ReadAtRest(readings) => {
                MachineStep::Do(Operation::Measure { points: vec![point; readings], level })
            }
            DescentStep::Found(surface, onset) => {
                self.baseline = reference.or(self.baseline);
                self.found((surface, Some(onset)), trail, context)
            }
            DescentStep::GiveUp(reason) => {
                let touched = descent.touched();
                context.surface_not_found(trail, Some(reason));
                self.search_in_steps(touched, context)
            }
            DescentStep::Fault(fault) => {
                context.surface_not_found(trail, None);
                MachineStep::Fault(fault)
            }
        }
    }

    /// Searches from a coarse step above where the descent has touched, or from where no surface is expected.
    fn search_in_steps(
        &mut self,
        touched: Option<Position<Mm>>,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<TouchResult> {
        let Some(baseline) = self.baseline else {
            return MachineStep::Fault(MachineEvent::Begin.out_of_order("a search"));
        };
        let (approach, expected) = (self.approach(context), self.expected(context));
        let near = touched.map(|at| {
            let pose = self.touch.pose;
            let highest = context.limits.highest_surface(pose.direction, pose.angle);
            let above_mm = 0.5 * approach.coarse_step_mm;
            let start = at.offset(approach.coarse_step_mm);
            Near { start, surface: at.offset(above_mm), sigma_mm: above_mm, highest }
        });
        let (search, step) = Search::begin_after_contact(approach, expected, baseline, near);
        self.phase = Phase::Searching(search);
        self.follow(step, context)
    }

    /// By when the first reading of a descent that begins now must come.
    pub(crate) fn first_reading_by(&self, now: RigTime) -> Option<RigTime> {
        match &self.phase {
            Phase::Descending(descent) => Some(descent.begins(now)),
            _ => None,
        }
    }

    pub(crate) fn streamed(&mut self, now: RigTime, streamed: Streamed) -> Vigil {
        match &mut self.phase {
            Phase::Descending(descent) => descent.streamed(now, streamed),
            _ => Vigil::Halt,
        }
    }
}
