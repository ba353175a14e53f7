//! A rig that is not commissioned: it refuses everything but stops and the steps of commissioning.

use std::sync::Arc;

use rig_commission::{Answer, Asked, Jog, JogAxis, Jogged, Order};
use rig_engine::{Command, Jump};
use rig_interlock::{Proven, Word};
use rig_store::{Operator, Record};
use tokio::sync::oneshot;

use super::Shell;
use crate::rig::{NotMade, RequestRefusal, proof::Purpose};

impl Shell {
    /// Refuses what needs a rig in service.
    pub(super) fn is_commissioned(&self) -> Result<(), RequestRefusal> {
        match &self.uncommissioned {
            Some(rig) => Err(RequestRefusal::NotCommissioned { missing: rig.missing.clone() }),
            None => Ok(()),
        }
    }

    /// What is missing for a rig in service.
    pub(in crate::rig) fn missing(&self) -> Option<Arc<str>> {
        self.uncommissioned.as_ref().map(|rig| Arc::clone(&rig.missing))
    }

    /// Latches a rig that is not commissioned, with the jump that the last program has left.
    pub(super) fn latch_uncommissioned(&mut self, jump: Option<Jump>) {
        let Some(rig) = &self.uncommissioned else { return };
        let mut effects = Vec::new();
        self.engine.latch_uncommissioned(rig.missing.to_string(), jump, &mut effects);
        self.carry_out(effects);
    }

    /// Begins what a drive is to do. It ends when the receiver has its end.
    pub(super) fn drive(
        &mut self,
        order: Order,
        by: String,
    ) -> Result<oneshot::Receiver<Result<Jogged, NotMade>>, RequestRefusal> {
        if self.uncommissioned.is_none() {
            return Err(RequestRefusal::InService);
        }
        if self.owners.are_busy() {
            return Err(RequestRefusal::StepUnderWay);
        }
        if order.may_move() {
            self.gate.operator(&by, Word::ThisStep)?;
        }
        let (axis, unit) = (order.axis().name(), order.axis().unit());
        let action = match order {
            Order::Step(Jog { by, .. }) => format!("step the {axis} by {by:+.3} {unit}"),
            Order::ClearAlarm(_) => format!("clear the alarm of the {axis}"),
            Order::Home(_) | Order::HomeDown => format!("have the {axis} find its zero"),
        };
        self.put_on_record(action, by)?;
        if let Some(person) = &mut self.person {
            person.look();
        }
        Ok(self.owners.commission(order))
    }

    /// A person has seen on a gauge how long the last step of an axis was.
    pub(super) fn step_seen(&mut self, axis: JogAxis, by: String) -> Result<(), RequestRefusal> {
        let word = match axis {
            JogAxis::Linear => Word::LinearStepSeen,
            JogAxis::Rotary => Word::RotaryStepSeen,
        };
        self.gate.operator(&by, word)?;
        self.put_on_record(format!("the last step of the {} was as long as asked", axis.name()), by)
    }

    /// Asks the simulated person, if there is one who answers.
    pub(super) fn ask_simulated(&mut self, asked: Asked) -> Option<Answer> {
        self.person.as_mut().map(|person| person.answer(asked))
    }

    /// Does on a simulated bench what a user says is done.
    pub(super) fn answered(&self, asked: Asked, answer: Answer) {
        if let Some(simulation) = self.simulation() {
            simulation.follow_hand(asked, answer);
        }
    }

    /// Reads the calibrations again: the interlock opens as far as they show, and a rig that has all of them goes
    /// into service. Returns what is missing.
    pub(super) fn read_calibrations(&mut self, by: &str) -> Option<std::sync::Arc<str>> {
        let rig = self.uncommissioned.as_mut()?;
        let proof = rig.read_again();
        let is_for_service = rig.purpose == Purpose::Service;
        if let Some(missing) = &proof.missing {
            rig.missing = missing.clone();
        }
        if proof.proven == Proven::Bench && !is_for_service {
            self.gate.prove(Proven::Scales);
            return None;
        }
        self.gate.prove(proof.proven);
        if proof.missing.is_none() {
            self.uncommissioned = None;
            self.log.append(&Record::Operator(Operator {
                action: "bring the commissioned rig into service".to_owned(),
                who: by.to_owned(),
            }));
            // Otherwise the engine was latched for nothing else.
            if !self.latch_interrupted() {
                _ = self.command(Command::Acknowledge, by);
            }
        }
        proof.missing
    }

    /// A stop ends a step. There is nothing to retract from.
    pub(super) fn stop_step(&mut self) {
        self.owners.interrupt();
    }
}
