//! References by drift, which may be left out, and the touches between two references of which the second one is far
//! from where the drift lets it be expected.

use crate::{
    drift::{Drift, JUMP_SIGMAS, Unexpected},
    finding::{Check, Findings},
    record::{Action, ReferenceJumped, StepStarted, TouchResult},
    settings::Settings,
};

/// With `no_load = "by-drift"` the drift may reach this many times the target of the no-load sweep.
const DRIFT_SIGMAS: f64 = 2.0;
/// A drift grows with the time since the reference to this power at most: with the time itself at a constant rate, and
/// a little more where the rate changes.
const GROWTH: f64 = 1.5;
/// The run counts from the middle of a reference, and this checker from its end.
const SLACK: f64 = 1.05;
/// A reference that is less probable than this is a jump. Here and in the run the moment of a sweep is not quite the same, so
/// that a probability within a factor of two of it may be called either.
const JUMP: f64 = 1e-4;
const EITHER: f64 = 2.0;
/// The same for how far it is off.
const NEARLY: f64 = 1.05;
/// For the same reason what is stated of the drift may differ by this part.
const SAME: f64 = 0.03;
/// A touch is taken to last this long before there was one, s.
const FIRST_TOUCH_S: f64 = 10.0;

/// The references of a run so far.
#[derive(Debug, Default)]
pub(crate) struct References {
    /// The last accepted one, and when it had been measured, s.
    last: Option<(u64, f64)>,
    /// The one before it.
    before: Option<u64>,
    /// Measured touches since the last one, and between the last two.
    since: Vec<String>,
    between: Vec<String>,
    /// When the touch under way began, and how long the one before it took, s.
    begun_s: f64,
    /// When the reference under way may have begun, s: with its step, or with an answer after which a touch is made again.
    from_s: f64,
    lasted_s: Option<f64>,
    /// Whether the last step was a touch.
    is_after_touch: bool,
    /// When the touch under way had to end so that it needed no reference, s; `None` if it has one of its own.
    left_out_until_s: Option<f64>,
    drift: Drift,
    /// The records of the references of this step, and how unexpected each was. A vague one is measured again: all of them
    /// follow the same touches.
    unexpected: Vec<(u64, Unexpected)>,
    /// Whether this step has a reference.
    is_again: bool,
}

impl References {
    /// Whether the step before this one may be a reference that was left out: no person was at the bench since the last
    /// touch.
    pub(super) fn may_leave_out(&self, index: u32, started: &StepStarted) -> bool {
        let is_touch = matches!(started.action, Action::Touch { .. });
        is_touch && self.is_after_touch && started.index == index + 2
    }

    pub(super) fn step_started(&mut self, rig_us: u64, started: &StepStarted, is_left_out: bool) {
        self.begun_s = rig_us as f64 / 1e6;
        self.from_s = self.begun_s;
        self.is_after_touch = matches!(started.action, Action::Touch { .. });
        let until_s = self.begun_s + self.lasted_s.unwrap_or(FIRST_TOUCH_S);
        self.left_out_until_s = is_left_out.then_some(until_s);
        self.is_again = false;
    }

    /// A touch is made again or over, and another reference may follow.
    pub(super) fn may_follow(&mut self, rig_us: u64, findings: &mut Findings) {
        self.no_jump(findings);
        self.from_s = rig_us as f64 / 1e6;
        self.is_again = false;
    }

    /// A reference was accepted: its record, its sweep, since when the sensor was free for it and when it ended, s, and
    /// what was found, Hz.
    pub(super) fn measured(
        &mut self,
        seq: u64,
        sweep: u64,
        (free_s, end_s): (f64, f64),
        found: (f64, f64),
    ) {
        let last = self.last.replace((sweep, end_s));
        self.left_out_until_s = None;
        if !std::mem::replace(&mut self.is_again, true) {
            self.before = last.map(|(sweep, _)| sweep);
            self.between = std::mem::take(&mut self.since);
            self.unexpected.clear();
        }
        let unexpected =
            self.drift.reference(f64::midpoint(self.from_s.max(free_s), end_s), found, JUMP);
        self.unexpected.extend(unexpected.filter(|_| !self.between.is_empty()).map(|of| (seq, of)));
    }

    /// A person has turned the sensor.
    pub(super) fn turned(&mut self) {
        self.drift.turned();
    }

    /// The references of the last step are no jump, because no record says so.
    pub(crate) fn no_jump(&mut self, findings: &mut Findings) {
        let is_certain =
            |(_, of): &(u64, Unexpected)| of.is_jump(JUMP / EITHER, NEARLY * JUMP_SIGMAS);
        if let Some((seq, of)) = std::mem::take(&mut self.unexpected).into_iter().find(is_certain) {
            let what = "a reference that no drift explains, and the record of a jump";
            findings.add(
                Check::Reference,
                seq,
                what,
                format!("a jump by {} Hz", of.off_hz),
                "none",
            );
        }
    }

    /// What a touch states of the drift since its reference, when its sweep has ended, s.
    pub(super) fn drifted(
        &self,
        seq: u64,
        swept_s: f64,
        result: &TouchResult,
        findings: &mut Findings,
    ) {
        let what = "the standard deviation of the drift since the reference, Hz";
        let expected = self.drift.sigma_hz(swept_s);
        findings.agree(
            Check::Reference,
            seq,
            what,
            (expected, result.drift_sigma_hz),
            SAME * expected,
        );
    }

    /// A touch has a result. If no reference was measured before it, the drift did not ask for one.
    pub(crate) fn touch_measured(
        &mut self,
        (seq, rig_us): (u64, u64),
        result: &TouchResult,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        self.since.push(result.touch.step.clone());
        let end_s = rig_us as f64 / 1e6;
        self.may_follow(rig_us, findings);
        self.lasted_s = Some(end_s - self.begun_s);
        let target_hz = settings.and_then(|all| all.protocol.no_load_sweep.target_sigma_hz);
        let (Some(until_s), Some((_, measured_s)), Some(target_hz)) =
            (self.left_out_until_s, self.last, target_hz)
        else {
            return;
        };
        let longer = ((end_s - measured_s) / (until_s - measured_s)).max(1.0);
        let limit_hz = SLACK * DRIFT_SIGMAS * target_hz * longer.powf(GROWTH);
        if result.drift_sigma_hz.is_nan() || result.drift_sigma_hz > limit_hz {
            let what = "the drift at the end of a touch whose reference was left out, Hz";
            let limit = Some(limit_hz.to_string());
            findings.within(Check::Reference, seq, what, "less", result.drift_sigma_hz, limit);
        }
    }

    pub(crate) fn touch_refused(&mut self, rig_us: u64, findings: &mut Findings) {
        self.may_follow(rig_us, findings);
        self.lasted_s = Some(rig_us as f64 / 1e6 - self.begun_s);
    }

    /// The first of the last references that may be a jump is said to be one.
    pub(crate) fn jumped(&mut self, seq: u64, jumped: &ReferenceJumped, findings: &mut Findings) {
        let ReferenceJumped { no_load_sweep, next_no_load_sweep, off_hz, sigma_hz, touches } =
            jumped;
        let found = (Some(*no_load_sweep), Some(*next_no_load_sweep));
        let expected = (self.before, self.last.map(|(sweep, _)| sweep));
        if found != expected {
            let what = "the sweeps before and after a jump of the resonance";
            let (expected, found) = (format!("{expected:?}"), format!("{found:?}"));
            findings.add(Check::Reference, seq, what, expected, found);
        }
        if *touches != self.between {
            let what = "the touches before a jump of the resonance";
            findings.add(Check::Row, seq, what, self.between.join(", "), touches.join(", "));
        }
        let may_be = |(_, of): &&(u64, Unexpected)| of.is_jump(JUMP * EITHER, JUMP_SIGMAS / NEARLY);
        let all = std::mem::take(&mut self.unexpected);
        let off_by = |(_, of): &&(u64, Unexpected)| (of.off_hz - off_hz).abs();
        let nearest = |a: &&_, b: &&_| off_by(a).total_cmp(&off_by(b));
        let of = all.iter().filter(may_be).min_by(nearest).or_else(|| all.first());
        let Some((_, of)) = of else {
            let what = "a jump of the resonance without a reference and touches before it";
            findings.add(Check::Reference, seq, what, "none", off_hz);
            return;
        };
        if !of.is_jump(JUMP * EITHER, JUMP_SIGMAS / NEARLY) {
            let what = "a jump of the resonance that the drift explains, probability";
            let limit = Some(JUMP.to_string());
            findings.within(Check::Reference, seq, what, "less", of.probability, limit);
        }
        let what = "how far a jump of the resonance is off, Hz";
        findings.agree(Check::Reference, seq, what, (of.off_hz, *off_hz), SAME * of.off_hz.abs());
        let what = "the standard deviation of a jump of the resonance, Hz";
        findings.agree(Check::Reference, seq, what, (of.sigma_hz, *sigma_hz), SAME * of.sigma_hz);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Pose, StepStarted};

    const KNOCK_HZ: f64 = 0.6;

    /// Steady references, a touch, and a reference that was measured twice: at first too vaguely.
    fn measured_twice(vague: (f64, f64), good_hz: f64) -> References {
        let mut references = References::default();
        let pose = Pose { direction: "front".to_owned(), angle_deg: 0.0 };
        let step = StepStarted {
            step: "no-load".to_owned(),
            index: 1,
            count: 100,
            action: Action::NoLoad { pose },
        };
        for number in 0..20_u64 {
            let at_s = 60.0 * number as f64;
            references.step_started(60_000_000 * number, &step, false);
            references.measured(number, number, (at_s, at_s + 1.0), (140.0, 0.02));
        }
        references.since.push("main/1/front/0/1".to_owned());
        references.step_started(1_200_000_000, &step, false);
        references.measured(20, 20, (1200.0, 1201.0), (140.0 + vague.0, vague.1));
        references.measured(21, 21, (1201.0, 1202.0), (140.0 + good_hz, 0.02));
        references
    }

    fn said(number: u64, off_hz: f64, sigma_hz: f64) -> ReferenceJumped {
        let touches = vec!["main/1/front/0/1".to_owned()];
        ReferenceJumped { no_load_sweep: 19, next_no_load_sweep: number, off_hz, sigma_hz, touches }
    }

    #[test]
    fn a_jump_is_one_whichever_of_the_sweeps_of_a_reference_shows_it() {
        for (vague, good_hz) in [((KNOCK_HZ, 0.02), KNOCK_HZ), ((0.0, 1.0), KNOCK_HZ)] {
            let mut left_out = Findings::default();
            measured_twice(vague, good_hz).no_jump(&mut left_out);
            assert_eq!(left_out.0.len(), 1, "{left_out:?}");

            let mut references = measured_twice(vague, good_hz);
            let is_jump = |(_, of): &&(u64, Unexpected)| of.is_jump(JUMP, JUMP_SIGMAS);
            let of = references.unexpected.iter().find(is_jump).expect("a jump").1;
            let mut findings = Findings::default();
            references.jumped(22, &said(21, of.off_hz, of.sigma_hz), &mut findings);
            assert!(findings.0.is_empty(), "{findings:?}");

            let mut findings = Findings::default();
            let mut references = measured_twice(vague, good_hz);
            references.jumped(22, &said(20, 0.5 * of.off_hz, of.sigma_hz), &mut findings);
            assert_eq!(findings.0.len(), 2, "{findings:?}");
        }
    }

    /// A reference that follows in the same step takes the place of one whose jump no record tells of.
    #[test]
    fn a_jump_is_missed_before_a_touch_is_made_again() {
        for (is_told, expected) in [(false, 1), (true, 0)] {
            let mut findings = Findings::default();
            let mut references = measured_twice((KNOCK_HZ, 0.02), KNOCK_HZ);
            let of = references.unexpected[0].1;
            if is_told {
                references.jumped(22, &said(21, of.off_hz, of.sigma_hz), &mut findings);
            }
            references.may_follow(1_203_000_000, &mut findings);
            references.measured(23, 22, (1203.0, 1204.0), (140.0 + KNOCK_HZ, 0.02));
            assert_eq!(findings.0.len(), expected, "{findings:?}");
        }
    }

    #[test]
    fn two_sweeps_of_a_steady_resonance_are_no_jump() {
        let mut findings = Findings::default();
        measured_twice((0.01, 0.02), 0.0).no_jump(&mut findings);
        assert!(findings.0.is_empty(), "{findings:?}");
        measured_twice((0.01, 0.02), 0.0).jumped(22, &said(21, KNOCK_HZ, 0.02), &mut findings);
        assert!(!findings.0.is_empty());
    }
}
