//! The attempts of a touch: a touch is made once, and again only after a refusal and its answer.

use super::Labels;
use crate::{
    finding::{Check, Findings},
    record::{Action, FitSettings, Flag, Outcome, Reading, RefusalAnswered, Sweep, Tried},
    settings::Settings,
};

/// A sweep in contact that was refused is made once more at its depth.
const SWEEPS_AT_DEPTH: u32 = 2;
/// A reference that is too vague is measured once more, and then taken as it is.
const REFERENCES: u32 = 2;
/// The same for each of the sweeps by which the level is checked, at most so many with the survey.
const SWEEPS_OF_LEVELS: u32 = 49;
/// Begins of the reason if the analyzer has given up on its readings.
const FLAGGED: &str = "the analyzer flagged ";
/// Numbers of a reason are those of the readings but for their last digits.
const ROUNDING: f64 = 1e-9;

/// What the attempt under way has come to.
#[derive(Debug, Clone, Default)]
pub(super) struct Attempt {
    /// Whether it follows a refusal and its answer.
    is_again: bool,
    /// Searches and indentations that were declared.
    approaches: u32,
    indents: u32,
    /// Sweeps in contact: all, the accepted ones, and those since the last move.
    sweeps: u32,
    accepted: u32,
    here: u32,
    /// Accepted references of the step.
    references: u32,
    /// Whether the last sweep since the last move was accepted.
    is_accepted_here: bool,
    /// What the analyzer flagged at the end of the last search that found no surface.
    flagged: Option<Flagged>,
    /// The answer after which no attempt follows, and the reason of the refusal.
    ended: Option<(String, String)>,
}

/// Readings that the analyzer flagged in every try.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Flagged {
    flag: Flag,
    frequency_hz: f64,
    tries: usize,
}

impl Flagged {
    /// What the last readings show; `None` if the last one has no flag.
    pub(super) fn of(readings: &[Reading]) -> Option<Self> {
        let is_flagged = |reading: &&Reading| reading.flag != Flag::Normal;
        let last = readings.last().filter(is_flagged)?;
        let tries = readings.iter().rev().take_while(is_flagged).count();
        Some(Self { flag: last.flag, frequency_hz: last.frequency_hz, tries })
    }

    /// What a reason says.
    fn said(reason: &str) -> Option<Self> {
        let (flag, rest) = reason.strip_prefix(FLAGGED)?.split_once(" at ")?;
        let (frequency, rest) = rest.split_once(" Hz in ")?;
        let (tries, _) = rest.split_once(" of ")?;
        let flag = match flag {
            "overload" => Flag::Overload,
            "low signal" => Flag::LowSignal,
            _ => return None,
        };
        Some(Self { flag, frequency_hz: frequency.parse().ok()?, tries: tries.parse().ok()? })
    }

    fn is_same(&self, other: &Self) -> bool {
        let off_hz = (self.frequency_hz - other.frequency_hz).abs();
        (self.flag, self.tries) == (other.flag, other.tries)
            && off_hz <= ROUNDING * self.frequency_hz
    }
}

/// Adds a finding if a reason says that the analyzer flagged something else than the readings show.
fn check_flagged(seq: u64, reason: &str, shown: Option<&Flagged>, findings: &mut Findings) {
    let said = Flagged::said(reason);
    if !said.as_ref().zip(shown).is_some_and(|(said, shown)| said.is_same(shown)) {
        let what = "what the analyzer flagged before a refusal";
        findings.add(Check::Sweep, seq, what, format!("{shown:?}"), reason);
    }
}

impl Labels {
    /// A descent is declared: one search and one indentation for each attempt.
    pub(crate) fn declared(&mut self, seq: u64, purpose: &str, findings: &mut Findings) {
        let Some(step) = &self.step else { return };
        if !matches!(step.started.action, Action::Touch { .. }) {
            return;
        }
        let count = match purpose {
            "approach" => &mut self.attempt.approaches,
            "indent" => &mut self.attempt.indents,
            _ => return,
        };
        *count += 1;
        if *count > 1 || step.is_done || self.attempt.ended.is_some() {
            let what = format!("a touch that is made again without a refusal: {purpose}");
            findings.add(Check::Row, seq, what, "one, or an answer to a refusal before it", *count);
        }
    }

    /// A sweep in contact: none follows an accepted one at its depth, and one follows a refused one.
    pub(super) fn swept_in_contact(
        &mut self,
        seq: u64,
        sweep: &Sweep,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let attempt = &mut self.attempt;
        let is_accepted = matches!(sweep.outcome, Outcome::Accepted { .. });
        attempt.here += 1;
        attempt.sweeps += 1;
        attempt.accepted += u32::from(is_accepted);
        let is_again = std::mem::replace(&mut attempt.is_accepted_here, is_accepted);
        let is_twice = settings.is_none_or(|all| all.protocol.touch.halfway_mm.is_some());
        if is_again || attempt.accepted > 1 + u32::from(is_twice) {
            let what = "a sweep in contact after an accepted one at its depth";
            findings.add(Check::Sweep, seq, what, "none", sweep.number);
        } else if attempt.here > SWEEPS_AT_DEPTH {
            let what = "the sweeps in contact at one depth";
            let limit = Some(SWEEPS_AT_DEPTH.to_string());
            findings.within(Check::Sweep, seq, what, "one, or two", attempt.here, limit);
        }
    }

    /// Whether a reference may be measured in the step of a touch: before the touch is made again.
    pub(super) const fn may_refer(&self) -> bool {
        self.attempt.is_again && self.attempt.approaches == 0
    }

    /// A touch is over: its references are not those that close the run.
    pub(super) const fn may_be_closed(&mut self) {
        self.attempt.references = 0;
    }

    /// A reference was accepted in its step.
    pub(super) fn referred(
        &mut self,
        seq: u64,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        self.attempt.references += 1;
        let has_levels = settings.is_none_or(|all| all.protocol.no_load_sweep.level_check);
        let most = if has_levels { REFERENCES * SWEEPS_OF_LEVELS } else { REFERENCES };
        // Behind the reference of a last touch that a person leaves out, those that close the run follow in its step.
        let most = if self.is_rest_left_out() { most + REFERENCES } else { most };
        if self.attempt.references > most {
            let what = "the accepted references of a step";
            let (found, limit) = (self.attempt.references, Some(most.to_string()));
            findings.within(Check::Reference, seq, what, "one, or a vague one more", found, limit);
        }
    }

    /// The probe has moved: the next sweep is at another depth.
    pub(super) const fn left_depth(&mut self) {
        (self.attempt.here, self.attempt.is_accepted_here) = (0, false);
    }

    /// A search has ended without a surface.
    pub(crate) fn lost_surface(&mut self, trail: &[Tried]) {
        let readings: Vec<Reading> = trail.iter().map(|tried| tried.reading).collect();
        self.attempt.flagged = Flagged::of(&readings);
    }

    /// The numbers in the reason of a refused sweep are those of its readings.
    pub(super) fn check_reason(seq: u64, sweep: &Sweep, findings: &mut Findings) {
        let Outcome::Refused { reason } = &sweep.outcome else { return };
        if reason.starts_with(FLAGGED) {
            check_flagged(seq, reason, Flagged::of(&sweep.readings).as_ref(), findings);
        }
        let of_readings = sweep.readings.iter().filter(|reading| reading.flag == Flag::Normal);
        let count = of_readings.count();
        let is_ringing = sweep.fit.as_ref().is_some_and(FitSettings::is_ringing);
        let Some(stated) = count_in(reason, is_ringing).filter(|stated| *stated != count) else {
            return;
        };
        let what = "the number of readings in the reason of a refused sweep";
        findings.add(Check::Sweep, seq, what, count, stated);
    }

    /// A refusal before the probe was in the sample: the analyzer flagged its readings of the clear probe or in the
    /// search, and there was neither an indentation nor a sweep.
    pub(super) fn refused_above(&self, seq: u64, reason: &str, findings: &mut Findings) {
        let Attempt { indents, sweeps, flagged, .. } = &self.attempt;
        if (*indents, *sweeps) != (0, 0) {
            let what = "a refusal that leaves out where the probe was in the sample";
            let found = format!("{indents} indentations, {sweeps} sweeps");
            findings.add(Check::Copy, seq, what, "no indentation and no sweep before it", found);
            return;
        }
        check_flagged(seq, reason, flagged.as_ref(), findings);
    }

    /// An answer about the attempt under way, which was refused for the stated reason.
    pub(super) fn answered_attempt(
        &mut self,
        seq: u64,
        answered: &RefusalAnswered,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let RefusalAnswered { answer, reason, .. } = answered;
        let is_done = self.step.as_ref().is_none_or(|step| step.is_done);
        if is_done || self.attempt.ended.is_some() {
            let what = "an answer about a touch that was not refused";
            findings.add(Check::Row, seq, what, "a touch without an outcome", answer);
        }
        let reference = self.reference.as_ref().and_then(|facts| facts.outcome.as_ref().ok());
        match reference {
            _ if self.attempt.indents == 0 => self.refused_above(seq, reason, findings),
            Some(&of) => self.refused_in_contact(seq, reason, of, settings, findings),
            None => {}
        }
        if ["widen", "repeat"].contains(&answer.as_str()) {
            self.begin_attempt();
        } else {
            self.attempt.ended = Some((answer.clone(), reason.clone()));
        }
    }

    /// What was found of a touch is of the attempt in which it was found.
    fn begin_attempt(&mut self) {
        self.attempt = Attempt { is_again: true, ..Attempt::default() };
        (self.surface, self.indented_mm, self.again, self.halfway) = (None, None, None, None);
        (self.descended, self.sweep, self.refused_sweeps) = (None, None, 0);
    }

    /// Nothing but the refusal follows an answer that keeps it.
    pub(super) fn outcome_of_attempt(
        &self,
        seq: u64,
        refused: Option<&str>,
        findings: &mut Findings,
    ) {
        let Some((answer, reason)) = &self.attempt.ended else { return };
        if refused != Some(reason.as_str()) {
            let what = format!("the outcome of a touch after the answer {answer}");
            let found = refused.unwrap_or("a result");
            findings.add(Check::Copy, seq, what, format!("refused: {reason}"), found);
        }
    }

    /// After a person or the protocol has ended the run at a refused touch, no step follows.
    pub(super) fn goes_on(&mut self, seq: u64, findings: &mut Findings) {
        let is_answered = self.attempt.ended.as_ref().is_some_and(|(answer, _)| answer == "abort");
        if std::mem::take(&mut self.is_ended_by_refusal) || is_answered {
            let what = "a run that goes on after a refused touch has ended it";
            findings.add(Check::Stopped, seq, what, "the end of the run", "a step");
        }
    }
}

/// The number of readings that a reason states, if it is that of all readings without a flag. A sweep on a given grid
/// counts those at different frequencies.
fn count_in(reason: &str, is_ringing: bool) -> Option<usize> {
    let after = |word: &str| Some(reason.split_once(word)?.1);
    let number = |text: &str| text.split(' ').next().and_then(|word| word.parse().ok());
    if reason.starts_with("the target was not reached: ") {
        return after(" after ").and_then(number);
    }
    let is_few = reason.contains(" readings at different frequencies, at least ");
    if is_few && is_ringing {
        return number(reason);
    }
    reason.contains(" readings were overloaded").then(|| after(" of ").and_then(number)).flatten()
}

#[cfg(test)]
mod tests {
    use super::super::{Step, SweepFacts};
    use super::*;
    use crate::record::{Pose, StepStarted, Touch};

    fn reading(frequency_hz: f64, flag: Flag) -> Reading {
        Reading {
            frequency_hz,
            resistance_ohm: None,
            reactance_ohm: None,
            started_s: 1.0,
            settle_s: 0.1,
            integration_s: 0.1,
            flag,
        }
    }

    #[test]
    fn a_flag_in_a_reason_is_that_of_the_last_readings() {
        let [sound, flagged] = [Flag::Normal, Flag::Overload].map(|flag| reading(140.25, flag));
        let readings = [flagged, sound, flagged, flagged, flagged];
        let reason = "the analyzer flagged overload at 140.25 Hz in 3 of 3 tries";
        for (readings, reason, expected) in [
            (&readings[..], reason, 0),
            (&readings[..4], reason, 1),
            (&readings[..2], reason, 1),
            (&readings[..], "the analyzer flagged low signal at 140.25 Hz in 3 of 3 tries", 1),
            (&readings[..], "the analyzer flagged overload at 163.24 Hz in 3 of 3 tries", 1),
            (&readings[..], "the sample was seen to move", 1),
        ] {
            let mut findings = Findings::default();
            check_flagged(1, reason, Flagged::of(readings).as_ref(), &mut findings);
            assert_eq!(findings.0.len(), expected, "{reason}, {} readings", readings.len());
        }
    }

    #[test]
    fn the_number_of_readings_in_a_reason_is_read() {
        let target = "the target was not reached: the standard deviation is 0.213 Hz after 35 readings, 0.1 Hz was \
                      asked for, and no further reading would help: ask for less";
        let few = "3 readings at different frequencies, at least 6 are needed";
        let far = "3 of 20 readings are far from the rest; at most 2 can be left out";
        for (reason, is_ringing, expected) in [
            (target, true, Some(35)),
            (few, true, Some(3)),
            (few, false, None),
            ("12 of 20 readings were overloaded", true, Some(20)),
            (far, true, None),
            ("the fit did not converge", true, None),
        ] {
            assert_eq!(count_in(reason, is_ringing), expected, "{reason}");
        }
    }

    /// Labels within a touch.
    fn touching() -> Labels {
        let pose = Pose { direction: "front".to_owned(), angle_deg: 0.0 };
        let action =
            Action::Touch { phase: "main".to_owned(), sample: "1".to_owned(), pose, repeat: 1 };
        let step = "main/1/front/0/1".to_owned();
        let started = StepStarted { step, index: 1, count: 1, action };
        Labels { step: Some(Step { seq: 1, started, is_done: false }), ..Labels::default() }
    }

    fn sweep(outcome: &serde_json::Value) -> Sweep {
        let sweep = serde_json::json!({
            "number": 1, "purpose": "touch", "readings": [], "probe_readings": 0, "outcome": outcome,
        });
        serde_json::from_value(sweep).expect("a sweep")
    }

    fn answered(answer: &str, reason: &str) -> RefusalAnswered {
        RefusalAnswered {
            step: "main/1/front/0/1".to_owned(),
            reason: reason.to_owned(),
            answer: answer.to_owned(),
            window_hz: None,
        }
    }

    #[test]
    fn a_touch_is_made_again_only_after_an_answer_to_its_refusal() {
        let mut trail = Vec::new();
        for _ in 0..3 {
            trail.push(Tried { position_mm: 12.0, reading: reading(140.25, Flag::LowSignal) });
        }
        let reason = "the analyzer flagged low signal at 140.25 Hz in 3 of 3 tries";
        for (is_lost, answer, expected) in [
            (true, Some("repeat"), 0),
            (true, Some("widen"), 0),
            (false, Some("repeat"), 1),
            (true, None, 1),
            (true, Some("skip"), 1),
        ] {
            let (mut labels, mut findings) = (touching(), Findings::default());
            labels.declared(1, "approach", &mut findings);
            if is_lost {
                labels.lost_surface(&trail);
            }
            if let Some(answer) = answer {
                labels.answered_attempt(2, &answered(answer, reason), None, &mut findings);
            }
            labels.declared(3, "approach", &mut findings);
            labels.declared(4, "indent", &mut findings);
            let more = usize::from(answer == Some("skip"));
            assert_eq!(findings.0.len(), expected + more, "{answer:?}: {findings:?}");
        }
    }

    #[test]
    fn what_closes_a_completed_run_is_accepted_and_its_end() {
        for (is_reference, is_done, status, is_complete, expected) in [
            (false, true, "accepted", true, 0),
            (false, true, "refused", true, 1),
            // The fault that ended the run is another record.
            (false, false, "refused", false, 0),
            // Another step follows.
            (false, true, "accepted", false, 1),
            // In the step of a reference whose touch is left out, and in that of one whose touch follows.
            (true, true, "accepted", true, 0),
            (true, true, "refused", true, 1),
            (true, true, "accepted", false, 0),
        ] {
            let mut labels = touching();
            let step = labels.step.as_mut().expect("a step");
            step.is_done = is_done;
            if let (true, Action::Touch { pose, .. }) = (is_reference, &step.started.action) {
                step.started.action = Action::NoLoad { pose: pose.clone() };
            }
            let outcome = if status == "accepted" {
                Ok((140.0, 0.02))
            } else {
                Err("the fit did not converge".to_owned())
            };
            let facts = SweepFacts {
                number: 1,
                purpose: "no_load".to_owned(),
                step: None,
                outcome,
                circuit: None,
            };
            labels.closing(1, &facts);
            let mut findings = Findings::default();
            labels.check_closed(is_complete, &mut findings);
            assert_eq!(findings.0.len(), expected, "{status}: {findings:?}");
        }
    }

    #[test]
    fn no_sweep_follows_an_accepted_one_at_its_depth() {
        let accepted = sweep(&serde_json::json!({
            "status": "accepted", "resonance_hz": 145.0, "sigma_hz": 0.1,
        }));
        let refused = sweep(&serde_json::json!({
            "status": "refused", "reason": "the fit did not converge",
        }));
        // `None` for a move.
        for (all, expected) in [
            (vec![Some(&refused), Some(&accepted)], 0),
            (vec![Some(&accepted), None, Some(&refused), Some(&accepted)], 0),
            (vec![Some(&accepted), Some(&accepted)], 1),
            (vec![Some(&accepted), Some(&refused)], 1),
            (vec![Some(&refused), Some(&refused), Some(&accepted)], 1),
            (vec![Some(&accepted), None, Some(&accepted), None, Some(&accepted)], 1),
        ] {
            let (mut labels, mut findings) = (touching(), Findings::default());
            for one in &all {
                match one {
                    Some(sweep) => labels.swept_in_contact(1, sweep, None, &mut findings),
                    None => labels.left_depth(),
                }
            }
            assert_eq!(findings.0.len(), expected, "{findings:?}");
        }
    }

    #[test]
    fn nothing_but_the_refusal_follows_an_answer_that_keeps_it() {
        let reason = "the fit did not converge";
        for (answer, refused, expected) in [
            ("skip", Some(reason), 0),
            ("abort", Some(reason), 1),
            ("skip", Some("a second mode near 150.00 Hz"), 1),
            ("skip", None, 1),
            ("abort", None, 2),
        ] {
            let (mut labels, mut findings) = (touching(), Findings::default());
            labels.attempt.ended = Some((answer.to_owned(), reason.to_owned()));
            labels.outcome_of_attempt(1, refused, &mut findings);
            labels.goes_on(2, &mut findings);
            assert_eq!(findings.0.len(), expected, "{answer}: {findings:?}");
        }
    }

    #[test]
    fn a_vague_reference_is_measured_once_more() {
        let (mut labels, mut findings) = (touching(), Findings::default());
        for _ in 0..REFERENCES * SWEEPS_OF_LEVELS {
            labels.referred(1, None, &mut findings);
        }
        assert!(findings.0.is_empty(), "{findings:?}");
        labels.referred(1, None, &mut findings);
        assert_eq!(findings.0.len(), 1);
        // Behind the reference of a last touch that is left out, those that close the run follow.
        let pose = Pose { direction: "front".to_owned(), angle_deg: 0.0 };
        let (step, phase, sample) =
            ("main/1/front/0/1".to_owned(), "main".to_owned(), "1".to_owned());
        labels.elsewhere.insert(step.clone());
        labels.planned.push(Touch { step, phase, sample, pose, repeat: 1 });
        labels.referred(1, None, &mut findings);
        assert_eq!(findings.0.len(), 1);
    }
}
