//! The no-load resonance: rotates to the pose, and measures the free sensor there. At the end of a run it is measured where the
//! stage stands, if the impedance of the clear probe cannot be read.

use rig_model::{DriveLevel, RigTime, SweepMethod, SweepRequest, Window};
use rig_protocol::Pose;
use rig_resonance::{Bench, FitOutcome, Prior, Reason, Refusal, Resonance};

use crate::{
    Fault, FinishedSweep, SweepPurpose,
    contact_sense::{check_free, response::says_nothing},
    level::{LevelCheck, Levels},
    machine::{MachineContext, MachineEvent, MachineStep},
    sweep::{DRIFT, Sweep, SweepStep},
};

/// Refused sweeps of the free sensor before the run gives up.
const REFUSED_MAX: u32 = 2;

/// Largest ratio of the static capacitances of a free sensor in two sweeps: a short one knows it to some ten percent.
const CAPACITANCE_RATIO_MAX: f64 = 2.0;

/// Whether a sweep knows too little of the circuit for the checks of the contact sense, which compare impedances with it.
///
/// Another frequency of the self-test would not do instead: where the sweep measured, the change is known better, but it is a
/// smaller one, and waits, thresholds and the surface of a descent rest on the same circuit.
pub(crate) fn is_vague(last: Option<&Resonance>, now: &Resonance) -> bool {
    let ratio = last.map_or(1.0, |last| now.c0_farad / last.c0_farad);
    let is_other = !(1.0 / CAPACITANCE_RATIO_MAX..=CAPACITANCE_RATIO_MAX).contains(&ratio);
    is_other || says_nothing(now)
}

/// Whether this sweep is a survey after which the resonance is measured at half the level.
fn is_to_be_checked(sweep: &FinishedSweep, context: &MachineContext<'_>) -> bool {
    context.plan.level_check && context.bench.is_none() && sweep.fit.bench.is_some()
}

/// All resonances of the free sensor in the order in which they were measured: the vague ones tell of its drift too.
pub(crate) fn in_order(
    vague: &[(RigTime, Resonance)],
    mut found: Vec<(RigTime, Resonance)>,
) -> Vec<(RigTime, Resonance)> {
    found.extend_from_slice(vague);
    found.sort_by_key(|(at, _)| *at);
    found
}

/// Rotates to the pose and measures the free sensor there.
#[derive(Debug)]
pub(crate) struct NoLoad {
    /// Where the sample turns first.
    pose: Option<Pose>,
    sweep: Option<Sweep>,
    /// When it began.
    begun: RigTime,
    /// Sweeps refused so far.
    refused: u32,
    /// A sweep that was too vague is being measured again; what follows is the reference as it is.
    is_again: bool,
    /// The check of the level after a survey.
    level: Option<LevelCheck>,
    /// Resonances whose sweeps were too vague to be the reference.
    vague: Vec<(RigTime, Resonance)>,
}

/// What the free sensor was measured for.
#[derive(Debug)]
pub(crate) struct Reference {
    /// The resonances, each with the middle of its sweep. The last one is the reference of the touches that follow.
    pub(crate) found: Vec<(RigTime, Resonance)>,
    /// From the survey, if there was one.
    pub(crate) bench: Option<Bench>,
}

impl NoLoad {
    pub(crate) const fn new(pose: Pose) -> Self {
        Self::at(Some(pose))
    }

    /// Without a turn.
    pub(crate) const fn here() -> Self {
        Self::at(None)
    }

    const fn at(pose: Option<Pose>) -> Self {
        Self {
            pose,
            sweep: None,
            begun: RigTime::ZERO,
            refused: 0,
            is_again: false,
            level: None,
            vague: Vec::new(),
        }
    }

    /// Whether the sweep has begun.
    pub(crate) const fn is_sweeping(&self) -> bool {
        self.sweep.is_some()
    }

    pub(crate) fn advance(
        &mut self,
        event: MachineEvent,
        last: Option<&Resonance>,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<Reference> {
        let step = match (event, &mut self.sweep) {
            (MachineEvent::Begin, _) => match self.pose {
                Some(pose) => return context.rotate_to(pose),
                None => self.begin(last, context),
            },
            (MachineEvent::RotaryAt(_), _) => self.begin(last, context),
            (MachineEvent::Readings(readings), Some(sweep)) => {
                sweep.measured(context.now, &readings, context.notes)
            }
            (event, _) => return MachineStep::Fault(event.out_of_order("a no-load measurement")),
        };
        self.follow(step, last, context)
    }

    /// Begins a sweep; the first one starts near the last reference, if there is one.
    fn begin(&mut self, last: Option<&Resonance>, context: &mut MachineContext<'_>) -> SweepStep {
        self.begun = context.now;
        let planned = context.plan.no_load_sweep;
        let surveyed = self.level.as_ref().and_then(|level| level.bench);
        let bench = context.bench.or(surveyed);
        let method = match context.plan.survey_s {
            Some(seconds) if bench.is_none() => SweepMethod::Survey { seconds },
            _ => planned.method,
        };
        let level = if self.level.as_ref().is_some_and(LevelCheck::is_half_next) {
            DriveLevel { volt: 0.5 * planned.level.volt }
        } else {
            planned.level
        };
        let request = &SweepRequest { method, level, ..planned };
        let anywhere = Prior::anywhere(request.window, bench);
        let prior = last.map_or(anywhere, |last| {
            let (low_hz, high_hz) =
                (last.resonance_hz * (1.0 - DRIFT), last.resonance_hz * (1.0 + DRIFT));
            let min_hz = request.window.min_hz.max(low_hz);
            let max_hz = request.window.max_hz.min(high_hz);
            Prior::moved(last, Window { min_hz, max_hz }, bench)
        });
        let (sweep, step) = Sweep::begin(
            context.now,
            SweepPurpose::NoLoad,
            request,
            Some(&prior),
            (context.limits, context.notes),
        );
        self.sweep = Some(sweep);
        step
    }

    pub(crate) fn follow(
        &mut self,
        mut step: SweepStep,
        last: Option<&Resonance>,
        context: &mut MachineContext<'_>,
    ) -> MachineStep<Reference> {
        loop {
            let refusal = match step {
                SweepStep::Measure(operation) => return MachineStep::Do(operation),
                SweepStep::Fault(fault) => return MachineStep::Fault(fault),
                SweepStep::Finished(sweep) => match sweep.outcome {
                    FitOutcome::Accepted(resonance)
                        if is_vague(last, &resonance) && !self.is_again =>
                    {
                        self.is_again = true;
                        let middle = self.begun + context.now.since(self.begun) / 2;
                        self.vague.push((middle, resonance));
                        step = self.begin(None, context);
                        continue;
                    }
                    FitOutcome::Accepted(resonance) => {
                        let middle = self.begun + context.now.since(self.begun) / 2;
                        match self.levels(&sweep, &(middle, resonance), context) {
                            Ok(reference) => return MachineStep::Done(reference),
                            Err(Levels::Differ) => {
                                let estimate = Some(resonance);
                                let refusal = Refusal { reason: Reason::Nonlinear, estimate };
                                return self.give_up(&refusal);
                            }
                            Err(_) => {
                                (self.refused, self.is_again) = (0, false);
                                step = self.begin(Some(&resonance), context);
                                continue;
                            }
                        }
                    }
                    FitOutcome::Refused(refusal) => refusal,
                },
            };
            if self.refused + 1 >= REFUSED_MAX {
                return self.give_up(&refusal);
            }
            self.refused += 1;
            // Without the prior, which may be wrong.
            step = self.begin(None, context);
        }
    }

    /// After this refusal nothing is measured again.
    fn give_up(&self, refusal: &Refusal) -> MachineStep<Reference> {
        let (refused, reason) = (self.refused + 1, refusal.to_string());
        MachineStep::Fault(Fault::NoReference { refused, reason })
    }

    /// The reference, if the level needs no further sweep.
    fn levels(
        &mut self,
        sweep: &FinishedSweep,
        found: &(RigTime, Resonance),
        context: &MachineContext<'_>,
    ) -> Result<Reference, Levels> {
        let bench = sweep.fit.bench;
        let Some(level) = &mut self.level else {
            if is_to_be_checked(sweep, context) {
                self.level = Some(LevelCheck::new(bench, found));
                return Err(Levels::Open);
            }
            return Ok(Reference { found: in_order(&self.vague, vec![*found]), bench });
        };
        match level.take(found, context.drift) {
            Levels::Same => {
                let found = self.level.take().map_or_else(Vec::new, LevelCheck::into_found);
                Ok(Reference { found: in_order(&self.vague, found), bench })
            }
            levels => Err(levels),
        }
    }
}

/// Whether the impedance of the clear probe after the last touch confirms it. Readings that the analyzer flags say nothing.
///
/// # Errors
/// What speaks against the touch.
pub(crate) fn confirming(event: &MachineEvent, no_load: Option<&Resonance>) -> Result<bool, Fault> {
    let (MachineEvent::Readings(readings), Some(no_load)) = (event, no_load) else {
        return Err(event.out_of_order("the end of a run"));
    };
    let baseline = check_free(no_load, readings).map_err(Fault::ContactSense)?;
    Ok(baseline.is_some())
}
