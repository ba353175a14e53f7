//! Surfaces and touches.

use super::{Labels, SurfaceFacts, pose_is_taken};
use crate::{
    descent,
    finding::{Check, Findings},
    motion::{Motion, Probe, ROUNDING},
    record::{
        Action, Indented, Pose, Reading, RefusalAnswered, SurfaceFound, SurfaceTrail, Touch,
        TouchRefused, TouchResult, Tried,
    },
    settings::Settings,
    surface,
};

/// Numbers that a record repeats from another are the same but for their last digits.
const COPY: f64 = 1e-9;
/// A refused sweep in contact is repeated once before the touch is refused because of it.
const SWEEPS_REFUSED: u32 = 2;
/// Readings of a search are at the free resonance within this part of it: an analyzer that rounds frequencies coarsely
/// takes one within a hundredth.
const OFF_RESONANCE: f64 = 0.015;
/// Begins of the reason if what was measured after the sweep speaks against the touch.
const CONTRADICTED: &str = "it is contradicted by what was measured next: ";
const SLIPPED: &str = "after the sweep the probe ";
const HIGHER: &str = "after the sweep the probe touches";
const LOWER: &str = "after the sweep the probe is free";

impl Labels {
    pub(crate) fn surface_found(
        &mut self,
        seq: u64,
        rig_us: u64,
        found: &SurfaceFound,
        motion: &Motion,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let SurfaceFound { step, pose, position_mm, sigma_mm, trail } = found;
        let search = ("approach", &**step, pose, &**trail);
        self.searched(seq, rig_us, search, motion, settings, findings);
        let descended = self.descended.take();
        let clear = match (&descended, settings) {
            (Some(descended), _) => descent::clear_impedance(descended),
            (None, Some(settings)) => {
                surface::check(seq, found, (&settings.protocol, self.noise.last()), findings);
                surface::clear_impedance(trail)
            }
            (None, None) => surface::clear_impedance(trail),
        };
        if let (Some(descended), Some(settings)) = (&descended, settings) {
            self.surface_of_descent(seq, found, descended, settings, findings);
        }
        let (position_mm, sigma_mm) = (*position_mm, *sigma_mm);
        self.surface = Some(SurfaceFacts { step: step.clone(), position_mm, sigma_mm, clear });
        (self.indented_mm, self.again) = (None, None);
    }

    /// The surface was looked for again after the sweep.
    pub(crate) fn surface_checked(
        &mut self,
        seq: u64,
        rig_us: u64,
        SurfaceTrail { step, pose, trail }: &SurfaceTrail,
        motion: &Motion,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        self.searched(seq, rig_us, ("indent", step, pose, trail), motion, settings, findings);
        let (Some(surface), Some(settings)) = (&self.surface, settings) else { return };
        let (protocol, tolerance_mm) = (&settings.protocol, settings.rig.linear.tolerance_mm);
        let found = (surface.position_mm, surface.clear);
        let again = surface::check_again(
            seq,
            found,
            trail,
            (protocol, self.noise.last()),
            tolerance_mm,
            findings,
        );
        self.again = Some(again);
    }

    /// A search belongs to the touch under way, and its readings to the places of the probe.
    pub(crate) fn searched(
        &self,
        seq: u64,
        rig_us: u64,
        (what, step, pose, trail): (&str, &str, &Pose, &[Tried]),
        motion: &Motion,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let started = self.step.as_ref().map(|under_way| &under_way.started);
        let is_of_step = started.is_some_and(|started| {
            let is_same = matches!(&started.action, Action::Touch { pose: of, .. } if of == pose);
            started.step == step && is_same
        });
        if !is_of_step {
            let what = "a search that is not that of the touch under way";
            let expected = format!("{started:?}");
            findings.add(Check::Pose, seq, what, expected, format!("{step}, {pose:?}"));
        }
        if let Some(settings) = settings {
            pose_is_taken(seq, pose, motion, settings, findings);
        }
        let descent = motion.descent.as_ref().filter(|descent| descent.what == what);
        // The readings at rest after a descent follow it without a wait.
        let approach = settings.map(|all| &all.protocol.approach);
        let approach = approach.filter(|_| self.descended.is_none());
        surface::check_trail(seq, rig_us, trail, (descent, approach), findings);
        let readings: Vec<_> = trail.iter().map(|tried| tried.reading).collect();
        self.check_frequencies(seq, &readings, findings);
        self.check_standstills(seq, &readings, findings);
    }

    /// A contact is felt by the change of the impedance at the resonance of the free sensor. Elsewhere the impedance is
    /// another one without any contact.
    pub(super) fn check_frequencies(
        &self,
        seq: u64,
        readings: &[Reading],
        findings: &mut Findings,
    ) {
        let Some(Ok((free_hz, _))) = self.reference.as_ref().map(|reference| &reference.outcome)
        else {
            return;
        };
        for (index, reading) in readings.iter().enumerate() {
            let (found_hz, limit_hz) = (reading.frequency_hz, OFF_RESONANCE * free_hz);
            if limit_hz < (found_hz - free_hz).abs() || found_hz.is_nan() {
                let what = format!("the frequency of reading {} of a search, Hz", index + 1);
                let limit = Some(limit_hz.to_string());
                findings.within(Check::Surface, seq, what, free_hz, found_hz, limit);
            }
        }
    }

    /// The readings after the sweep allow that the surface has moved as the reason says.
    fn slipped(&self, seq: u64, reason: &str, findings: &mut Findings) {
        let again = self.again.unwrap_or_default();
        let may_be = [(HIGHER, again.may_be_higher), (LOWER, again.may_be_lower)];
        if !may_be.iter().any(|(begin, may_be)| *may_be && reason.starts_with(begin)) {
            let what = "a surface that is said to have moved after the sweep";
            findings.add(Check::Surface, seq, what, "where the search found it", reason);
        }
    }

    /// A fault, which may contradict the last touch.
    pub(crate) fn faulted(&mut self, cause: &str) {
        self.contradiction.take_if(|(_, contradiction)| contradiction == cause);
        self.fault = Some(cause.to_owned());
    }

    /// A run ends, or goes on to the next step: what contradicts a touch is a fault.
    pub(crate) fn check_contradiction(&mut self, findings: &mut Findings) {
        if let Some((seq, cause)) = self.contradiction.take() {
            let what = "a touch that is said to be contradicted";
            findings.add(Check::Row, seq, what, format!("the fault: {cause}"), "no such fault");
        }
    }

    /// A refused touch is repeated, kept or the last one.
    pub(crate) fn decided(
        &mut self,
        (seq, rig_us): (u64, u64),
        answered: &RefusalAnswered,
        motion: &mut Motion,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        motion.is_waiting = false;
        let RefusalAnswered { step, answer, window_hz, .. } = answered;
        let under_way = self.step.as_ref().map(|under_way| under_way.started.step.as_str());
        let is_known = ["widen", "repeat", "skip", "abort"].contains(&answer.as_str());
        if under_way != Some(step) || !is_known {
            let what = "an answer about a refused touch that is not the one under way";
            findings.add(Check::StepOrder, seq, what, format!("{under_way:?}"), step);
        }
        self.answered_attempt(seq, answered, settings, findings);
        self.references.may_follow(rig_us, findings);
        let Some([min, max]) = *window_hz else { return };
        // Each answer widens by half of the width on each side, at most.
        let protocol = settings.map(|all| &all.protocol.contact_sweep);
        let before = self.window.or(protocol.map(|asked| [asked.min_hz, asked.max_hz]));
        let [low, high] = before.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let more = 0.5 * (high - low) + ROUNDING;
        if answer != "widen" || min < low - more || max > high + more {
            let what = "the window of a repeated sweep, Hz";
            let limit = Some(format!("[{}, {}]", low - more, high + more));
            findings.within(Check::Request, seq, what, "within", format!("[{min}, {max}]"), limit);
        }
        self.window = Some([min, max]);
    }

    /// Depth and places of an indentation that is about to be declared.
    pub(crate) fn indents(
        &self,
        seq: u64,
        to_mm: f64,
        settings: &Settings,
        findings: &mut Findings,
    ) {
        let Some(SurfaceFacts { position_mm, .. }) = &self.surface else {
            let what = "an indentation without a surface";
            findings.add(Check::Indentation, seq, what, "a surface before it", to_mm);
            return;
        };
        let (depth, most) = (position_mm - to_mm, settings.max_indentation_mm());
        if depth > most + ROUNDING {
            let what = "an indentation deeper than permitted, mm";
            findings.within(Check::Depth, seq, what, "less", depth, Some(most.to_string()));
        }
        let asked = settings.protocol.touch.indentation_mm;
        let what = "the indentation that the protocol asks for, mm";
        findings.agree(Check::Indentation, seq, what, (asked, depth), ROUNDING);
    }

    pub(crate) fn measured(
        &mut self,
        seq: u64,
        result: &TouchResult,
        motion: &Motion,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let TouchResult { touch, surface_mm, surface_sigma_mm, indentation_mm, linear_mm, .. } =
            result;
        self.row(seq, touch, motion, findings);
        self.outcome_of_attempt(seq, None, findings);
        let (surface_mm, surface_sigma_mm) = (*surface_mm, *surface_sigma_mm);
        let indented = Indented {
            sweep: result.sweep,
            surface_mm,
            surface_sigma_mm,
            indentation_mm: *indentation_mm,
            linear_mm: *linear_mm,
        };
        self.place(seq, &indented, settings, findings);
        let asks = settings.is_some_and(|all| all.protocol.slip_mm().is_some());
        // Older journals do not say it.
        let is_marked = result.is_slip_checked.is_none_or(|said| said == asks);
        if settings.is_some() && !is_marked {
            let what = "whether the surface was looked for again after the sweep of a result";
            findings.add(Check::Row, seq, what, asks, !asks);
        }
        if asks && !self.again.is_some_and(|again| again.is_still_there) {
            let what = "a result without a surface that was still there after the sweep";
            let found = format!("{:?}", self.again);
            findings.add(Check::Surface, seq, what, "clear above it, contact below it", found);
        }
        let mut copy = |what, expected, found| {
            findings.agree(Check::Copy, seq, what, (expected, found), COPY);
        };
        let stands = motion.rotary_deg.unwrap_or(f64::NAN);
        copy("the tilt of the sample, °", stands, result.rotary_deg);
        let sweep = self.sweep.as_ref().filter(|sweep| sweep.purpose == "touch");
        match sweep.map(|sweep| &sweep.outcome) {
            Some(&Ok((hz, sigma_hz))) => {
                copy("the resonance in contact, Hz", hz, result.resonance_hz);
                copy("its standard deviation, Hz", sigma_hz, result.sigma_hz);
            }
            other => {
                let found = format!("{other:?}");
                let what = "a result whose sweep was not accepted";
                findings.add(Check::Copy, seq, what, "an accepted sweep in contact", found);
            }
        }
        self.halfway(seq, result, settings, findings);
        let of = (result.no_load_sweep, result.no_load_hz, result.no_load_sigma_hz);
        self.reference(seq, of, findings);
        let (shift, sigma) = check_shift(seq, result, findings);
        self.references.drifted(seq, self.swept_s, result, findings);
        self.felt(seq, true, (shift, sigma), settings, findings);
        self.last = Some(result.clone());
    }

    /// The measurement halfway is that of the first accepted sweep in contact, at the depth that the
    /// protocol asks for.
    fn halfway(
        &self,
        seq: u64,
        result: &TouchResult,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let Some(settings) = settings else { return };
        let asked_mm = settings.protocol.touch.halfway_mm;
        let (Some(asked_mm), Some(stated)) = (asked_mm, result.halfway) else {
            if asked_mm.is_some() != result.halfway.is_some() {
                let what = "the measurement halfway of a touch";
                let (expected, found) = (format!("{asked_mm:?}"), format!("{:?}", result.halfway));
                findings.add(Check::Row, seq, what, expected, found);
            }
            return;
        };
        let what = "the depth halfway that the protocol asks for, mm";
        findings.agree(
            Check::Indentation,
            seq,
            what,
            (asked_mm, stated.indentation_mm),
            ROUNDING + settings.rig.linear.tolerance_mm,
        );
        let mut copy = |what, expected, found| {
            findings.agree(Check::Copy, seq, what, (expected, found), COPY);
        };
        let depth = result.surface_mm - stated.linear_mm;
        copy("the depth halfway, mm: surface less position", depth, stated.indentation_mm);
        let Some((sweep, linear_mm)) = &self.halfway else {
            let what = "a measurement halfway whose sweep was not accepted";
            findings.add(Check::Copy, seq, what, "an accepted sweep in contact", "none");
            return;
        };
        copy("the position halfway, mm", *linear_mm, stated.linear_mm);
        copy("the number of the sweep halfway", sweep.number as f64, stated.sweep as f64);
        if let Ok((hz, sigma_hz)) = sweep.outcome {
            copy("the resonance halfway, Hz", hz, stated.resonance_hz);
            copy("its standard deviation, Hz", sigma_hz, stated.sigma_hz);
        }
    }

    pub(crate) fn refused(
        &mut self,
        seq: u64,
        refused: &TouchRefused,
        motion: &Motion,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        self.refused.insert(refused.touch.step.clone());
        if let Some(cause) = refused.reason.strip_prefix(CONTRADICTED)
            && self.fault.as_deref() != Some(cause)
        {
            self.contradiction = Some((seq, cause.to_owned()));
        }
        // The last touch of a run is confirmed while its step is still the last one.
        let is_over = self
            .step
            .as_ref()
            .is_none_or(|step| step.is_done || step.started.step != refused.touch.step);
        if let Some(result) = self.last.take_if(|last| is_over && last.touch == refused.touch) {
            contradicted(seq, &result, refused, findings);
            return;
        }
        self.is_ended_by_refusal =
            settings.is_some_and(|all| all.protocol.touch.ends_with_refusal());
        self.row(seq, &refused.touch, motion, findings);
        let stands = motion.rotary_deg.unwrap_or(f64::NAN);
        let what = "the tilt of the sample, °";
        findings.agree(Check::Copy, seq, what, (stands, refused.rotary_deg), COPY);
        let of = (refused.no_load_sweep, refused.no_load_hz, refused.no_load_sigma_hz);
        self.reference(seq, of, findings);
        self.outcome_of_attempt(seq, Some(&refused.reason), findings);
        let Some(indented) = &refused.indented else {
            self.refused_above(seq, &refused.reason, findings);
            return;
        };
        self.place(seq, indented, settings, findings);
        let reference = (refused.no_load_hz, refused.no_load_sigma_hz);
        self.refused_in_contact(seq, &refused.reason, reference, settings, findings);
    }

    /// A refusal after the probe was in the sample: because of the sweep, or of what was measured after it.
    pub(super) fn refused_in_contact(
        &self,
        seq: u64,
        reason: &str,
        (no_load_hz, no_load_sigma_hz): (f64, f64),
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let sweep = self.sweep.as_ref().filter(|sweep| sweep.purpose == "touch");
        match sweep.map(|sweep| &sweep.outcome) {
            Some(Err(of_sweep)) if of_sweep == reason => {
                if self.refused_sweeps < SWEEPS_REFUSED {
                    let what = "the refused sweeps of a touch that is refused because of them";
                    let expected = format!("at least {SWEEPS_REFUSED}");
                    findings.add(Check::Sweep, seq, what, expected, self.refused_sweeps);
                }
            }
            // The surface was no longer where it had been found, or could not be looked for.
            Some(Ok(_)) if self.again.is_some_and(|again| !again.is_still_there) => {}
            // What was measured after the sweep speaks against the touch, whatever the shift.
            Some(Ok(_)) if reason.starts_with(CONTRADICTED) => {}
            Some(Ok(_)) if reason.starts_with(SLIPPED) => {
                self.slipped(seq, reason, findings);
            }
            Some(&Ok((hz, sigma_hz))) => {
                let sigma_hz = sigma_hz.hypot(no_load_sigma_hz);
                let shift_hz = hz - no_load_hz;
                self.felt(seq, false, (shift_hz, sigma_hz), settings, findings);
            }
            other => {
                let expected = other.map_or_else(
                    || "a sweep in contact".to_owned(),
                    |of_sweep| format!("{of_sweep:?}"),
                );
                let what = "the reason of a refused touch";
                findings.add(Check::Copy, seq, what, expected, reason);
            }
        }
    }

    /// The row of a touch: that of the step under way, once, with the probe clear again.
    fn row(&mut self, seq: u64, touch: &Touch, motion: &Motion, findings: &mut Findings) {
        if let Some(first) = self.results.insert(touch.step.clone(), seq) {
            let found = format!("a second one after record {first}");
            let what = format!("results of touch {}", touch.step);
            findings.add(Check::Row, seq, what, "one", found);
        }
        let planned = self.touches.checked_sub(1).and_then(|index| self.planned.get(index));
        let is_under_way = self.step.as_mut().is_some_and(|step| {
            let is_touch = matches!(step.started.action, Action::Touch { .. });
            let is_this = is_touch && step.started.step == touch.step;
            step.is_done |= is_this;
            is_this
        });
        if planned != Some(touch) && !self.is_unplanned() || !is_under_way {
            let what = "the label of a result is not that of the touch under way";
            let check = match planned {
                Some(planned) if planned.sample != touch.sample => Check::Sample,
                Some(planned) if planned.pose != touch.pose => Check::Pose,
                _ => Check::Row,
            };
            findings.add(check, seq, what, format!("{planned:?}"), format!("{touch:?}"));
        }
        if motion.probe != Probe::Clear {
            let what = "a touch ends with the probe clear";
            findings.add(Check::EndsClear, seq, what, "clear", motion.probe.name());
        }
        self.may_be_closed();
    }

    /// Where the probe was in the sample.
    fn place(
        &self,
        seq: u64,
        indented: &Indented,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let &Indented { sweep, surface_mm, surface_sigma_mm, indentation_mm, linear_mm } = indented;
        let last = self.sweep.as_ref().filter(|last| {
            let step = self.step.as_ref().map(|step| &step.started.step);
            last.purpose == "touch" && last.step.as_ref() == step
        });
        let number = last.map(|last| last.number);
        if number != Some(sweep) {
            let expected = number.map_or_else(|| "none".to_owned(), |number| number.to_string());
            let what = "the sweep of a touch is not the last one in contact";
            findings.add(Check::Copy, seq, what, expected, sweep);
        }
        let found = self.surface.as_ref().map_or([f64::NAN; 2], |s| [s.position_mm, s.sigma_mm]);
        let mut copy = |what, expected, found| {
            findings.agree(Check::Copy, seq, what, (expected, found), COPY);
        };
        copy("the surface, mm", found[0], surface_mm);
        copy("its standard deviation, mm", found[1], surface_sigma_mm);
        let stands = self.indented_mm.unwrap_or(f64::NAN);
        copy("the linear stage during the sweep, mm", stands, linear_mm);
        if let (Some(surface), Some(step)) = (&self.surface, &self.step)
            && surface.step != step.started.step
        {
            let what = "the surface of a touch is that of another one";
            findings.add(Check::Copy, seq, what, &step.started.step, &surface.step);
        }
        check_depth(seq, (surface_mm, linear_mm), indentation_mm, findings);
        if let Some(settings) = settings {
            let (asked, rig) = (settings.protocol.touch.indentation_mm, &settings.rig);
            let tolerance = rig.linear.tolerance_mm + ROUNDING;
            let what = "the depth that the protocol asks for, mm";
            findings.agree(Check::Indentation, seq, what, (asked, indentation_mm), tolerance);
            let most = settings.max_indentation_mm() + tolerance;
            if indentation_mm > most {
                let what = "the depth of a touch, mm";
                findings.within(
                    Check::Depth,
                    seq,
                    what,
                    "less",
                    indentation_mm,
                    Some(most.to_string()),
                );
            }
        }
    }

    /// The reference of a touch is the last no-load sweep, which was accepted.
    fn reference(&self, seq: u64, (sweep, hz, sigma_hz): (u64, f64, f64), findings: &mut Findings) {
        let Some((number, Ok((expected_hz, expected_sigma_hz)))) =
            self.reference.as_ref().map(|facts| (facts.number, facts.outcome.clone()))
        else {
            let what = "a touch without an accepted reference before it";
            findings.add(Check::Reference, seq, what, "a no-load sweep", format!("sweep {sweep}"));
            return;
        };
        if sweep != number {
            let what = "the reference of a touch is not the last no-load sweep before it";
            findings.add(Check::Reference, seq, what, number, sweep);
        }
        let mut agree = |what, pair| findings.agree(Check::Reference, seq, what, pair, COPY);
        agree("the reference, Hz", (expected_hz, hz));
        agree("the standard deviation of the reference, Hz", (expected_sigma_hz, sigma_hz));
    }
}

/// A refusal that takes the place of the result of the touch before, which a later measurement
/// contradicts: it repeats the numbers of the result.
fn contradicted(seq: u64, result: &TouchResult, refused: &TouchRefused, findings: &mut Findings) {
    let mut copy = |what, expected, found| {
        findings.agree(Check::Copy, seq, what, (expected, found), COPY);
    };
    copy("the tilt of a contradicted touch, °", result.rotary_deg, refused.rotary_deg);
    copy("the reference of a contradicted touch, Hz", result.no_load_hz, refused.no_load_hz);
    let sigmas_hz = (result.no_load_sigma_hz, refused.no_load_sigma_hz);
    copy("the standard deviation of that reference, Hz", sigmas_hz.0, sigmas_hz.1);
    let indented = refused.indented.as_ref();
    let place = indented.map_or([f64::NAN; 4], |one| {
        [one.surface_mm, one.surface_sigma_mm, one.indentation_mm, one.linear_mm]
    });
    copy("the surface of a contradicted touch, mm", result.surface_mm, place[0]);
    copy("its standard deviation, mm", result.surface_sigma_mm, place[1]);
    copy("the depth of a contradicted touch, mm", result.indentation_mm, place[2]);
    copy("the linear stage during its sweep, mm", result.linear_mm, place[3]);
    let sweeps = (result.no_load_sweep, Some(result.sweep));
    let found = (refused.no_load_sweep, indented.map(|one| one.sweep));
    if sweeps != found {
        let what = "the sweeps of a contradicted touch";
        findings.add(Check::Copy, seq, what, format!("{sweeps:?}"), format!("{found:?}"));
    }
}

/// Checks the shift of a result and its standard deviation. Returns what they are, without the drift, Hz.
pub(crate) fn check_shift(seq: u64, result: &TouchResult, findings: &mut Findings) -> (f64, f64) {
    let shift = result.resonance_hz - result.no_load_hz;
    let what = "the shift, Hz: loaded less reference";
    findings.agree(Check::Shift, seq, what, (shift, result.shift_hz), COPY);
    let sigma = result.sigma_hz.hypot(result.no_load_sigma_hz);
    let with_drift = sigma.hypot(result.drift_sigma_hz);
    let what = "the standard deviation of the shift, Hz: of both resonances and the drift";
    findings.agree(Check::Shift, seq, what, (with_drift, result.shift_sigma_hz), COPY);
    (shift, sigma)
}

/// Checks the depth of a touch by its surface and the linear stage, mm.
pub(crate) fn check_depth(
    seq: u64,
    (surface_mm, linear_mm): (f64, f64),
    indentation_mm: f64,
    findings: &mut Findings,
) {
    let what = "the depth, mm: surface less linear stage";
    let depth = surface_mm - linear_mm;
    findings.agree(Check::Indentation, seq, what, (depth, indentation_mm), COPY);
}
