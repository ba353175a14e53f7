//! The pace of a run: the time of the rig, and the time spent waiting for people.

use rig_model::RigTime;
use rig_protocol::{Action, Step};

use super::history::{History, StepKind};

/// Time that a run has spent waiting for people.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pace {
    /// Total time of all answers, s.
    waited_s: f64,
    /// Number of answered prompts.
    answers: u32,
    /// Start of the open prompt.
    asked: Option<RigTime>,
    /// Total time of all pauses, s.
    paused_s: f64,
    /// Start of the present pause.
    paused: Option<RigTime>,
}

/// Remaining time of a run, s on the rig's clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Remaining {
    /// When every answer comes at once.
    pub least_s: f64,
    /// If answers take as long as before.
    pub most_s: f64,
}

impl Remaining {
    /// The remaining time when the step under way, with which this time begins, has lasted `lasted_s`.
    /// `next` is the remaining time from the next step on, which the step under way does not change.
    pub(super) const fn after(self, lasted_s: f64, next: Self) -> Self {
        Self {
            least_s: (self.least_s - lasted_s).max(next.least_s),
            most_s: (self.most_s - lasted_s).max(next.most_s),
        }
    }
}

/// A part of a plan: its steps with their expected durations, s.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part<'a> {
    pub(super) steps: &'a [Step],
    pub(super) durations_s: &'a [f64],
}

impl Part<'_> {
    /// The time that the plan expects, s.
    fn planned_s(self) -> f64 {
        self.durations_s.iter().sum()
    }

    /// Number of prompts.
    fn prompts(self) -> usize {
        let is_prompt = |step: &&Step| matches!(step.action, Action::Prompt(_));
        self.steps.iter().filter(is_prompt).count()
    }

    /// The least and the most time by what such steps took before, s; `None` without a history of each
    /// of their kinds.
    fn by_history(self, history: &History) -> Option<[f64; 2]> {
        let mut range_s = [0.0; 2];
        for kind in [StepKind::NoLoad, StepKind::Touch] {
            let of_kind = self.steps.iter().zip(self.durations_s);
            let of_kind = of_kind.filter(|(step, _)| StepKind::of(&step.action) == Some(kind));
            let (count, planned_s) =
                of_kind.fold((0, 0.0), |(count, sum_s), (_, s)| (count + 1, sum_s + s));
            if count == 0 {
                continue;
            }
            let ratios = history.ratios(kind, count)?;
            for (end_s, ratio) in range_s.iter_mut().zip(ratios) {
                *end_s += planned_s * ratio;
            }
        }
        Some(range_s)
    }
}

/// A person takes about as long to change a sample, s, until it is known better.
const ANSWER_S: f64 = 30.0;
/// Relative accuracy of the expected durations of a plan, before there are touches to compare.
const PLAN_UNCERTAINTY: f64 = 0.3;
/// After this number of touches, the run itself says as much as the runs before it.
const HISTORY_TOUCHES: f64 = 10.0;

impl Pace {
    pub(super) const fn asked(&mut self, now: RigTime) {
        self.asked = Some(now);
    }

    /// Whether a prompt is open.
    pub(super) const fn is_asked(&self) -> bool {
        self.asked.is_some()
    }

    pub(super) fn answered(&mut self, now: RigTime) {
        if let Some(asked) = self.asked.take() {
            self.waited_s += now.since(asked).as_secs_f64();
            self.answers += 1;
        }
    }

    /// The run has a state in which it is paused, or another one.
    pub(super) fn pauses(&mut self, now: RigTime, is_paused: bool) {
        if is_paused {
            self.paused.get_or_insert(now);
        } else if let Some(since) = self.paused.take() {
            self.paused_s += now.since(since).as_secs_f64();
        }
    }

    /// Total time that the rig has not worked, with the open prompt and the present pause, s.
    pub fn waited_s(&self, now: RigTime) -> f64 {
        let since =
            |begin: Option<RigTime>| begin.map_or(0.0, |begin| now.since(begin).as_secs_f64());
        self.waited_s + since(self.asked) + self.paused_s + since(self.paused)
    }

    /// The remaining time of a run, from what such touches took before on this rig, or else from the
    /// plan, and more and more from the touches that are done. The finished part took `elapsed_s`
    /// with all waits.
    pub(super) fn remaining(
        &self,
        now: RigTime,
        (done, left): (Part<'_>, Part<'_>),
        elapsed_s: f64,
        touches_done: usize,
        history: &History,
    ) -> Remaining {
        let (done_s, left_s) = (done.planned_s(), left.planned_s());
        let waits_s = self.answer_s(history) * left.prompts() as f64;
        let by_plan = self.by_plan(now, (done_s, left_s), elapsed_s, touches_done, waits_s);
        let Some([least_s, most_s]) = left.by_history(history) else { return by_plan };
        let weight = touches_done as f64 / (touches_done as f64 + HISTORY_TOUCHES);
        let mixed = |before_s: f64, now_s: f64| (1.0 - weight) * before_s + weight * now_s;
        Remaining {
            least_s: mixed(least_s, by_plan.least_s),
            most_s: mixed(most_s, by_plan.most_s - waits_s) + waits_s,
        }
    }

    /// Usual time of an answer, s.
    fn answer_s(&self, history: &History) -> f64 {
        if self.answers == 0 {
            return history.answer_s().unwrap_or(ANSWER_S);
        }
        self.waited_s / f64::from(self.answers)
    }

    /// The remaining time by the plan, corrected by the touches that are done.
    fn by_plan(
        &self,
        now: RigTime,
        (done_s, left_s): (f64, f64),
        elapsed_s: f64,
        touches_done: usize,
        waits_s: f64,
    ) -> Remaining {
        let worked_s = (elapsed_s - self.waited_s(now)).max(0.0);
        // The plan is a guess that the touches done replace little by little.
        let weight = touches_done as f64 / (touches_done as f64 + 2.0);
        let factor = if done_s > 0.0 { 1.0 + weight * (worked_s / done_s - 1.0) } else { 1.0 };
        let spread = PLAN_UNCERTAINTY / (touches_done as f64 + 1.0).sqrt();
        let work_s = left_s * factor;
        Remaining { least_s: work_s * (1.0 - spread), most_s: work_s * (1.0 + spread) + waits_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: u64) -> RigTime {
        RigTime::from_micros(seconds * 1_000_000)
    }

    #[test]
    fn the_range_holds_the_plan_at_first_and_narrows_with_the_touches() {
        let pace = Pace::default();
        let first = pace.by_plan(at(0), (0.0, 100.0), 0.0, 0, 0.0);
        assert!((first.least_s - 70.0).abs() < 1e-9 && (first.most_s - 130.0).abs() < 1e-9);
        let later = pace.by_plan(at(80), (80.0, 20.0), 80.0, 8, 0.0);
        assert!((later.least_s - 18.0).abs() < 1e-9 && (later.most_s - 22.0).abs() < 1e-9);
    }

    #[test]
    fn the_time_of_the_step_under_way_passes_and_no_more_than_that() {
        let (here, next) =
            (Remaining { least_s: 50.0, most_s: 80.0 }, Remaining { least_s: 40.0, most_s: 60.0 });
        assert_eq!(here.after(0.0, next), here);
        assert_eq!(here.after(5.0, next), Remaining { least_s: 45.0, most_s: 75.0 });
        assert_eq!(here.after(15.0, next), Remaining { least_s: 40.0, most_s: 65.0 });
        assert_eq!(here.after(500.0, next), next);
    }

    #[test]
    fn a_pause_is_no_work_of_the_rig_and_no_answer_of_a_person() {
        let mut paused = Pace::default();
        paused.pauses(at(10), true);
        paused.pauses(at(20), true);
        paused.pauses(at(36_010), false);
        paused.pauses(at(36_020), false);
        let (with, without) = (
            paused.by_plan(at(36_080), (80.0, 20.0), 36_080.0, 8, 0.0),
            Pace::default().by_plan(at(80), (80.0, 20.0), 80.0, 8, 0.0),
        );
        assert_eq!(with, without);
        assert_eq!((paused.waited_s(at(40_000)), paused.answers), (36_000.0, 0));
        paused.pauses(at(40_000), true);
        assert_eq!(paused.waited_s(at(40_005)), 36_005.0);
    }

    #[test]
    fn waits_for_persons_count_for_the_prompts_to_come_and_not_for_the_rig() {
        let mut pace = Pace::default();
        pace.asked(at(10));
        pace.answered(at(50));
        // 60 s of work, 40 s of waiting; 99 touches leave next to no doubt of the pace.
        let waits_s = 2.0 * pace.answer_s(&History::default());
        let remaining = pace.by_plan(at(100), (60.0, 60.0), 100.0, 99, waits_s);
        assert!((remaining.least_s - 58.2).abs() < 1e-9, "{remaining:?}");
        assert!((remaining.most_s - (61.8 + 80.0)).abs() < 1e-9, "{remaining:?}");
        pace.asked(at(100));
        assert!((pace.waited_s(at(130)) - 70.0).abs() < 1e-9);
    }
}
