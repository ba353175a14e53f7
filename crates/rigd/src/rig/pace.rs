//! The pace of a run: the time of the rig, and the time spent waiting for people.

use rig_model::RigTime;

/// Time that a run has spent waiting for people.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pace {
    /// Total time of all answers, s.
    waited_s: f64,
    /// Number of answered prompts.
    answers: u32,
    /// Start of the open prompt.
    asked: Option<RigTime>,
}

/// Remaining time of a run, s on the rig's clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Remaining {
    /// When every answer comes at once.
    pub least_s: f64,
    /// If answers take as long as before.
    pub most_s: f64,
}

/// A person takes about as long to change a sample, s, until it is known better.
const ANSWER_S: f64 = 30.0;
/// Relative accuracy of the expected durations of a plan, before there are touches to compare.
const PLAN_UNCERTAINTY: f64 = 0.3;

impl Pace {
    pub(super) const fn asked(&mut self, now: RigTime) {
        self.asked = Some(now);
    }

    pub(super) fn answered(&mut self, now: RigTime) {
        if let Some(asked) = self.asked.take() {
            self.waited_s += now.since(asked).as_secs_f64();
            self.answers += 1;
        }
    }

    /// Age of the open prompt, s.
    pub fn waited_s(&self, now: RigTime) -> f64 {
        self.waited_s + self.asked.map_or(0.0, |asked| now.since(asked).as_secs_f64())
    }

    /// The remaining time of a run. The plan expects `done_s` for its finished part and `left_s` for
    /// the rest; the finished part took `elapsed_s` with all waits.
    pub fn remaining(
        &self,
        now: RigTime,
        (done_s, left_s): (f64, f64),
        elapsed_s: f64,
        touches_done: usize,
        prompts_left: usize,
    ) -> Remaining {
        let worked_s = (elapsed_s - self.waited_s(now)).max(0.0);
        // The plan is a guess that the touches done replace little by little.
        let weight = touches_done as f64 / (touches_done as f64 + 2.0);
        let factor = if done_s > 0.0 { 1.0 + weight * (worked_s / done_s - 1.0) } else { 1.0 };
        let spread = PLAN_UNCERTAINTY / (touches_done as f64 + 1.0).sqrt();
        let answer_s =
            if self.answers == 0 { ANSWER_S } else { self.waited_s / f64::from(self.answers) };
        let work_s = left_s * factor;
        Remaining {
            least_s: work_s * (1.0 - spread),
            most_s: work_s * (1.0 + spread) + answer_s * prompts_left as f64,
        }
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
        let first = pace.remaining(at(0), (0.0, 100.0), 0.0, 0, 0);
        assert!((first.least_s - 70.0).abs() < 1e-9 && (first.most_s - 130.0).abs() < 1e-9);
        let later = pace.remaining(at(80), (80.0, 20.0), 80.0, 8, 0);
        assert!((later.least_s - 18.0).abs() < 1e-9 && (later.most_s - 22.0).abs() < 1e-9);
    }

    #[test]
    fn waits_for_persons_count_for_the_prompts_to_come_and_not_for_the_rig() {
        let mut pace = Pace::default();
        pace.asked(at(10));
        pace.answered(at(50));
        // 60 s of work, 40 s of waiting; 99 touches leave next to no doubt of the pace.
        let remaining = pace.remaining(at(100), (60.0, 60.0), 100.0, 99, 2);
        assert!((remaining.least_s - 58.2).abs() < 1e-9, "{remaining:?}");
        assert!((remaining.most_s - (61.8 + 80.0)).abs() < 1e-9, "{remaining:?}");
        pace.asked(at(100));
        assert!((pace.waited_s(at(130)) - 70.0).abs() < 1e-9);
    }
}
