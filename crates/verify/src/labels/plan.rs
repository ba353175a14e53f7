//! Steps against those that the plan needs.

use super::Labels;
use crate::{
    finding::{Check, Findings},
    layout::{self, NoLoad, Planned},
    record::{Action, PlanSize, Resumed, StepStarted, Touch},
    settings::Protocol,
};

impl Labels {
    /// A run begins: its touches need the steps that it says to have planned.
    pub(crate) fn begin(
        &mut self,
        seq: u64,
        size: PlanSize,
        planned: Vec<Touch>,
        protocol: Option<&Protocol>,
        findings: &mut Findings,
    ) {
        self.lay_out(planned, protocol);
        self.steps = size.steps;
        if self.layout.is_empty() {
            return;
        }
        let is_prompt = |planned: &&Planned| matches!(planned.action, Action::Prompt { .. });
        let prompts = self.layout.iter().filter(is_prompt).count();
        let expected = (self.layout.len(), prompts);
        let stated = (size.steps as usize, size.prompts.map_or(prompts, |stated| stated as usize));
        if stated != expected {
            let what = "the numbers of steps and prompts that the touches of the plan need";
            let (expected, found) = (format!("{expected:?}"), format!("{stated:?}"));
            findings.add(Check::Plan, seq, what, expected, found);
        }
    }

    /// The touches of a plan and their steps. Touches of unknown directions, or a policy for the reference that is not
    /// known, leave the steps unknown.
    pub(super) fn lay_out(&mut self, planned: Vec<Touch>, protocol: Option<&Protocol>) {
        self.no_load = protocol.and_then(NoLoad::of);
        let layout = self.no_load.and_then(|no_load| layout::steps(&planned, no_load));
        self.whole = layout.unwrap_or_default();
        (self.layout, self.planned) = (self.whole.clone(), planned);
    }

    /// A run goes on with the touches that have no outcome, behind the steps of those that have one.
    pub(super) fn lay_out_rest(&mut self, seq: u64, resumed: &Resumed, findings: &mut Findings) {
        let &Resumed { ref next, touches_done, touches_left, .. } = resumed;
        let elsewhere = self.done_elsewhere.remove(&seq).unwrap_or_default();
        let is_done = |touch: &&Touch| {
            self.results.contains_key(&touch.step) || elsewhere.contains_key(&touch.step)
        };
        for (step, &is_refused) in &elsewhere {
            if is_refused {
                self.refused.insert(step.clone());
            } else {
                self.refused.remove(step);
            }
        }
        let (done, left): (Vec<&Touch>, Vec<&Touch>) = self.planned.iter().partition(is_done);
        let expected = (done.len(), left.len(), left.first().map(|touch| &touch.step));
        let stated = (touches_done as usize, touches_left as usize, next.as_ref());
        if stated != expected {
            let what =
                "the touches with and without an outcome, and the next one, of a run that goes on";
            let (expected, found) = (format!("{expected:?}"), format!("{stated:?}"));
            findings.add(Check::Plan, seq, what, expected, found);
        }
        let is_first = |touch: &Touch| left.first().is_some_and(|left| left.step == touch.step);
        self.touches = self.planned.iter().position(is_first).unwrap_or(self.planned.len());
        let rest = self.no_load.and_then(|no_load| layout::steps(left.iter().copied(), no_load));
        let is_done = |planned: &Planned| done.iter().any(|touch| touch.step == planned.touch);
        let mut steps: Vec<Planned> =
            self.whole.iter().filter(|planned| is_done(planned)).cloned().collect();
        self.index = size(&steps);
        steps.extend(rest.unwrap_or_default());
        self.layout = if self.whole.is_empty() { Vec::new() } else { steps };
        if !self.layout.is_empty() {
            self.steps = size(&self.layout);
        }
    }

    /// A step is the one that the plan has at its place, and none of those before it was passed over.
    pub(super) fn check_place(&self, seq: u64, started: &StepStarted, findings: &mut Findings) {
        if self.layout.is_empty() {
            return;
        }
        self.check_gap(seq, started.index.saturating_sub(1), findings);
        let place = started.index.checked_sub(1).and_then(|place| self.layout.get(place as usize));
        if place.is_none_or(|place| place.step != started.step) {
            let what = format!("step {} of the plan", started.index);
            let expected = place.map_or("none", |place| &place.step);
            findings.add(Check::StepOrder, seq, what, expected, &started.step);
        }
    }

    /// The steps behind the last one, up to this one, may be passed over.
    pub(super) fn check_gap(&self, seq: u64, until: u32, findings: &mut Findings) {
        let passed = self.index as usize..(until as usize).min(self.layout.len());
        for place in passed.filter(|place| !self.may_pass(*place)) {
            let planned = &self.layout[place];
            let check = if planned.is_no_load() { Check::Reference } else { Check::StepOrder };
            let what = "a step that the protocol asks for";
            findings.add(check, seq, what, &planned.step, "it was passed over");
        }
    }

    /// Whether the step at this place need not be made: a touch that a person leaves out, the reference of it alone, or one
    /// for which the drift need not ask.
    fn may_pass(&self, place: usize) -> bool {
        let planned = &self.layout[place];
        let is_amended = self.elsewhere.contains(&planned.touch);
        if planned.is_touch() {
            return is_amended;
        }
        let is_after_touch = place > 0 && self.layout[place - 1].is_touch();
        planned.is_no_load()
            && match self.no_load {
                Some(NoLoad::ByDrift) => is_after_touch,
                Some(no_load) => is_amended && no_load.is_of_one_touch(),
                None => true,
            }
    }
}

/// The number of steps.
pub(super) fn size(steps: &[Planned]) -> u32 {
    u32::try_from(steps.len()).unwrap_or(u32::MAX)
}
