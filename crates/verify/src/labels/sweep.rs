//! Sweeps against their step, the axes, their times, and what the protocol asks for.

use super::{FreeSweep, Labels, SweepFacts, pose_is_taken};
use crate::{
    finding::{Check, Findings},
    motion::{Motion, Probe},
    record::{Action, FitSettings, Flag, Outcome, Reading, Sweep},
    settings::Settings,
};

/// Clocks of drivers and journal may differ by this much, s: an analyzer is asked for settings and
/// measurement in one message, and the time within it is an estimate.
pub(crate) const CLOCK_SLACK_S: f64 = 0.05;
/// At most one reading in this number is left out of a fit.
pub(crate) const READINGS_PER_OUTLIER: usize = 5;

/// An analyzer may round a frequency that is set again a little otherwise, by this part of it.
const SAME_FREQUENCY: f64 = 1e-6;
/// Two readings of one stay at a frequency may state it by this part otherwise. A bit of a reply without a check sum can be
/// wrong, and of an analyzer with a list of its own the driver takes any frequency this near.
const SAME_STAY: f64 = 0.01;

/// An analyzer that rounds frequencies coarsely takes one within this part of it.
const COARSE: f64 = 0.015;

impl Labels {
    pub(crate) fn sweep(
        &mut self,
        seq: u64,
        rig_us: u64,
        sweep: &Sweep,
        motion: &Motion,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let others = self.numbered.get(&seq).copied().unwrap_or_default();
        let next = self.sweeps.max(others) + 1;
        let is_manual = sweep.purpose == "manual";
        // A manual sweep has its number from its begin, also when it never ends.
        if if is_manual { sweep.number < next } else { sweep.number != next } {
            findings.add(Check::Sweep, seq, "the number of a sweep", next, sweep.number);
        }
        self.sweeps = sweep.number;
        self.check_step(seq, sweep, motion, findings);
        if let (Some(pose), Some(settings)) = (&sweep.pose, settings) {
            pose_is_taken(seq, pose, motion, settings, findings);
        }
        self.check_times(seq, rig_us, sweep, findings);
        Self::check_readings(seq, sweep, findings);
        Self::check_reason(seq, sweep, findings);
        if sweep.purpose == "touch" {
            self.swept_in_contact(seq, sweep, settings, findings);
        }
        self.check_standstills(seq, &sweep.readings, findings);
        if let Some(settings) = settings.filter(|_| !is_manual) {
            let window = self.window.filter(|_| sweep.purpose == "touch");
            request(seq, sweep, window, settings, findings);
        }
        let (outcome, circuit) = match &sweep.outcome {
            &Outcome::Accepted { resonance_hz, sigma_hz, circuit, .. } => {
                (Ok((resonance_hz, sigma_hz)), circuit)
            }
            Outcome::Refused { reason } => (Err(reason.clone()), None),
        };
        self.refused_sweeps += u32::from(sweep.purpose == "touch" && outcome.is_err());
        self.noise.sweep(seq, sweep, outcome.is_ok(), findings);
        if let Some(settings) = settings.filter(|_| !is_manual) {
            self.bench.sweep(seq, sweep, outcome.is_ok(), &settings.protocol, findings);
        }
        let facts = SweepFacts {
            number: sweep.number,
            purpose: sweep.purpose.clone(),
            step: sweep.step.clone(),
            outcome,
            circuit,
        };
        if facts.purpose == "no_load" {
            self.closing(seq, &facts);
            if let (Some(step), Ok(_)) = (&mut self.step, &facts.outcome) {
                step.is_done |= matches!(step.started.action, Action::NoLoad { .. });
            }
            self.reference = Some(facts.clone()).filter(|facts| facts.outcome.is_ok());
            if let Ok(found) = facts.outcome {
                self.referred(seq, settings, findings);
                let end_s = rig_us as f64 / 1e6;
                self.references.measured(seq, facts.number, (self.free_s, end_s), found);
            }
        }
        if let (true, Some(indented_mm)) = (facts.outcome.is_ok(), self.indented_mm)
            && facts.purpose == "touch"
        {
            self.swept_s = rig_us as f64 / 1e6;
            self.halfway.get_or_insert((facts.clone(), indented_mm));
        }
        if facts.purpose == "touch" {
            // The surface is looked for again after it.
            self.again = None;
        }
        self.sweep = Some(facts);
        self.free_s = rig_us as f64 / 1e6;
    }

    /// A sweep with the probe clear in a step that has what it was made for closes the run. In the step of a reference it is
    /// another one for the reference, unless the touch is left out and nothing follows.
    pub(super) fn closing(&mut self, seq: u64, facts: &SweepFacts) {
        let is_over = self.step.as_ref().is_some_and(|step| {
            step.is_done && !matches!(step.started.action, Action::NoLoad { .. })
        });
        self.free = Some(FreeSweep { seq, is_accepted: facts.outcome.is_ok(), is_over });
    }

    /// What closes a run is accepted, and is its end.
    pub(super) fn check_closed(&mut self, is_complete: bool, findings: &mut Findings) {
        let Some(FreeSweep { seq, is_accepted, is_over }) = self.free.take() else { return };
        if is_complete && !is_accepted {
            let what = "the last no-load sweep of a completed run";
            findings.add(Check::Reference, seq, what, "accepted", "refused");
        } else if !is_complete && is_over {
            let what = "a no-load sweep behind the outcome of a step";
            findings.add(Check::Sweep, seq, what, "none before another step", "one");
        }
    }

    /// The purpose, the address and the pose of a sweep are those of the step under way, and the probe
    /// is where the purpose needs it.
    fn check_step(&self, seq: u64, sweep: &Sweep, motion: &Motion, findings: &mut Findings) {
        // Nothing has moved the probe since its indentation.
        let indented = self.indented_mm.is_some() && self.indented_mm == motion.linear_mm;
        let probe = motion.probe;
        let started = self.step.as_ref().map(|step| &step.started);
        // Behind the last touch, the no-load resonance is measured if the impedance of the clear probe cannot be read.
        let is_over = self.step.as_ref().is_some_and(|step| step.is_done);
        let (purpose, pose) = match started.map(|started| &started.action) {
            None => ("manual", None),
            Some(Action::Prompt { .. }) if is_over => ("no_load", None),
            Some(Action::Prompt { .. }) => ("none", None),
            Some(Action::NoLoad { pose }) => ("no_load", Some(pose)),
            Some(Action::Touch { pose, .. }) if is_over || self.may_refer() => {
                ("no_load", Some(pose))
            }
            Some(Action::Touch { pose, .. }) => ("touch", Some(pose)),
        };
        if sweep.purpose != purpose {
            findings.add(Check::Sweep, seq, "the purpose of a sweep", purpose, &sweep.purpose);
        }
        if sweep.step.as_ref() != started.map(|started| &started.step) {
            let expected = started.map_or("none", |started| &started.step);
            let found = sweep.step.as_deref().unwrap_or("none");
            findings.add(Check::Sweep, seq, "the step of a sweep", expected, found);
        }
        if sweep.pose.as_ref() != pose {
            let found = format!("{:?}", sweep.pose);
            findings.add(Check::Pose, seq, "the pose of a sweep", format!("{pose:?}"), found);
        }
        let is_placed = match &*sweep.purpose {
            "no_load" => probe == Probe::Clear,
            "touch" => probe == Probe::Lowered && indented,
            _ => true,
        };
        if !is_placed {
            let what = format!("the probe during a sweep of the purpose {}", sweep.purpose);
            let expected = if sweep.purpose == "touch" { "indented" } else { "clear" };
            findings.add(Check::Pose, seq, what, expected, probe.name());
        }
    }

    /// Readings follow each other, after the last move and before the record of the sweep.
    fn check_times(&self, seq: u64, rig_us: u64, sweep: &Sweep, findings: &mut Findings) {
        let end_s = rig_us as f64 / 1e6;
        let mut last_s = self.free_s - CLOCK_SLACK_S;
        for (index, reading) in sweep.readings.iter().enumerate() {
            let (begin_s, done_s) = (reading.begin_s(), reading.end_s());
            if !(begin_s >= last_s && done_s <= end_s + CLOCK_SLACK_S) {
                let what =
                    format!("the time of reading {} of sweep {}, s", index + 1, sweep.number);
                let (expected, found) = (
                    format!("from {last_s:.3} to {end_s:.3}"),
                    format!("{begin_s:.3} to {done_s:.3}"),
                );
                let slack = Some(format!("{CLOCK_SLACK_S} s"));
                findings.within(Check::ReadingTime, seq, what, expected, found, slack);
            }
            last_s = begin_s;
        }
        // With a free decay the time is computed with the fit.
        let is_ringing = sweep.fit.as_ref().is_some_and(FitSettings::is_ringing);
        if let Outcome::Accepted { effective_time_s: Some(time_s), .. } = sweep.outcome
            && !is_ringing
        {
            let first_s = sweep.readings.first().map_or(f64::NAN, |reading| reading.started_s);
            // Weights can be negative, so that their mean can lie a little outside the sweep.
            let slack_s = end_s - first_s;
            if !(first_s - slack_s..=end_s + slack_s).contains(&time_s) {
                let what = "the time for which a resonance holds, s";
                let expected = format!("from {first_s:.3} to {end_s:.3}");
                let limit = Some(format!("{slack_s:.3} s beyond"));
                findings.within(Check::ReadingTime, seq, what, expected, time_s, limit);
            }
        }
    }

    /// Every reading counts, except flagged ones that were measured again, and one in five that was left
    /// out. A sweep whose time ends before its first reading is refused, and has none.
    fn check_readings(seq: u64, sweep: &Sweep, findings: &mut Findings) {
        let Sweep { readings, probe_readings, outcome, .. } = sweep;
        if readings.is_empty() && matches!(outcome, Outcome::Accepted { .. }) {
            findings.add(Check::Sweep, seq, "the number of readings of a sweep", "some", 0);
        }
        if *probe_readings > 0 {
            let what = "readings of a sweep that do not count";
            findings.add(Check::Sweep, seq, what, 0, probe_readings);
        }
        let Outcome::Accepted { left_out, .. } = *outcome else { return };
        let most = readings.len().div_ceil(READINGS_PER_OUTLIER);
        if left_out > most {
            let what = "readings that were left out";
            findings.within(Check::Sweep, seq, what, "few", left_out, Some(most.to_string()));
        }
        for (index, reading) in readings.iter().enumerate() {
            let next = readings.get(index + 1);
            if reading.flag != Flag::Normal && !next.is_some_and(|next| is_again(reading, next)) {
                let what = format!("the reading after the flagged reading {}, Hz", index + 1);
                let found = next.map_or("none".to_owned(), |next| next.frequency_hz.to_string());
                findings.add(Check::Sweep, seq, what, reading.frequency_hz, found);
            }
        }
    }

    pub(super) fn check_standstills(
        &self,
        seq: u64,
        readings: &[Reading],
        findings: &mut Findings,
    ) {
        for &(from_s, to_s) in &self.standstills {
            let is_of = |reading: &&Reading| reading.begin_s() < to_s && from_s < reading.end_s();
            if let Some(reading) = readings.iter().find(is_of) {
                let what = "a reading from a time in which the computer was held up, s";
                let expected = format!("none from {from_s:.3} to {to_s:.3}");
                findings.add(Check::ReadingTime, seq, what, expected, reading.begin_s());
            }
        }
    }
}

/// The window and the precision of an accepted sweep are those that the protocol asks for.
fn request(
    seq: u64,
    sweep: &Sweep,
    window: Option<[f64; 2]>,
    settings: &Settings,
    findings: &mut Findings,
) {
    let protocol = &settings.protocol;
    let asked = match &*sweep.purpose {
        "no_load" => &protocol.no_load_sweep,
        _ => &protocol.contact_sweep,
    };
    let Outcome::Accepted { resonance_hz, sigma_hz, .. } = sweep.outcome else { return };
    let [min_hz, max_hz] = window.unwrap_or([asked.min_hz, asked.max_hz]);
    // One that was refused may have ended early.
    let is_accepted = matches!(sweep.outcome, Outcome::Accepted { .. });
    if let Some(points) = asked.grid().filter(|_| is_accepted) {
        check_grid(seq, &sweep.readings, points, [min_hz, max_hz], findings);
    }
    let window = Some(format!("[{min_hz}, {max_hz}] Hz"));
    if !(min_hz..=max_hz).contains(&resonance_hz) {
        let what = "a resonance outside the window of the protocol";
        findings.within(Check::Request, seq, what, "within", resonance_hz, window.clone());
    }
    if let Some(fit) = &sweep.fit {
        let timing = asked.timing();
        if timing.is_some_and(|timing| timing != fit.timing) {
            let what = "what a fit knows of the times of the readings";
            findings.add(Check::Request, seq, what, timing.unwrap_or_default(), &fit.timing);
        }
        let [min, max] = fit.window_hz;
        if min < min_hz || max > max_hz {
            let what = "the window of a fit is wider than that of the protocol";
            findings.within(Check::Request, seq, what, "within", format!("[{min}, {max}]"), window);
        }
        if fit.target_sigma_hz != asked.target_sigma_hz() {
            let (expected, found) =
                (format!("{:?}", asked.target_sigma_hz()), format!("{:?}", fit.target_sigma_hz));
            findings.add(Check::Request, seq, "the precision asked for, Hz", expected, found);
        }
    } else {
        let what = "what the fit of an accepted sweep knew before it";
        findings.add(Check::Request, seq, what, "its window and its noise", "nothing");
    }
    if let Some(target) =
        asked.target_sigma_hz().filter(|target| sigma_hz.is_nan() || sigma_hz > *target)
    {
        let what = "an accepted resonance is less precise than the protocol asks for, Hz";
        findings.within(Check::Request, seq, what, "no more", sigma_hz, Some(target.to_string()));
    }
}

/// A uniform sweep has a reading at each of its points. Flagged ones were measured again.
fn check_grid(
    seq: u64,
    readings: &[Reading],
    points: u32,
    [min_hz, max_hz]: [f64; 2],
    findings: &mut Findings,
) {
    let normal: Vec<&Reading> =
        readings.iter().filter(|reading| reading.flag == Flag::Normal).collect();
    if normal.len() < points as usize {
        let what = "the number of readings of a uniform sweep";
        findings.add(Check::Request, seq, what, format!("at least {points}"), normal.len());
        return;
    }
    if normal.len() > points as usize {
        // Some were measured again.
        return;
    }
    let step_hz = (max_hz - min_hz) / f64::from(points.max(2) - 1);
    for (index, reading) in (0..points).zip(normal) {
        let (asked_hz, found_hz) = (min_hz + step_hz * f64::from(index), reading.frequency_hz);
        let what = format!("the frequency of point {} of a uniform sweep, Hz", index + 1);
        findings.agree(Check::Request, seq, &what, (asked_hz, found_hz), COARSE * asked_hz);
    }
}

/// Whether a reading was taken at the frequency of the one before it.
fn is_again(before: &Reading, next: &Reading) -> bool {
    // A change of the frequency begins another stay.
    let is_same_stay = next.started_s == before.started_s;
    let part = if is_same_stay { SAME_STAY } else { SAME_FREQUENCY };
    (next.frequency_hz - before.frequency_hz).abs() <= part * before.frequency_hz
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flagged_reading_is_measured_again_in_its_stay_or_at_its_frequency() {
        let reading = |frequency_hz: f64, started_s: f64| Reading {
            frequency_hz,
            resistance_ohm: None,
            reactance_ohm: None,
            started_s,
            settle_s: 1.5,
            integration_s: 0.15,
            flag: Flag::default(),
        };
        let flagged = reading(132.02, 13.8);
        for (next, expected) in [
            (reading(132.02, 13.8), true),
            // The reply to the flagged one had a wrong bit.
            (reading(132.0, 13.8), true),
            (reading(133.5, 13.8), false),
            // The frequency was set again.
            (reading(132.02, 15.5), true),
            (reading(132.0, 15.5), false),
        ] {
            assert_eq!(is_again(&flagged, &next), expected, "{next:?}");
        }
    }
}
