//! The settings of a protocol with an aim: the candidates, what each costs and gives, and the choice.

use rig_files::{Faults, Location};
use rig_model::{RigLimits, SweepMethod, SweepRequest};

use super::{
    AIM_KEYS, AimKeys, AimPlan, AimSettings, NoSensitivity, PartTimes, Sensitivity, TouchModel,
    Wanted,
    error::{Errors, Expected, Unexpected, sensitivities},
    split::{OutOfReach, Value, best, preferred},
};
use crate::{
    Action, NoLoadPolicy, Plan, Protocol,
    fault::ProtocolFault,
    protocol::ApproachKeys,
    summary::{Course, to_target_s},
    sweep::SweepKeys,
};

/// Targets of a sweep in contact, Hz. For a finer one, a planned sweep has too few readings on most samples; a coarser one
/// leaves too few to judge the resonance by, and is measured twice.
const CONTACT_HZ: (f64, f64) = (0.02, 0.2);

/// The target with which a plan is expected before one is chosen, Hz. A finer one takes longer, so that the resonance drifts more.
const CONTACT_BEFORE_HZ: f64 = 0.01;

/// Targets of a reference, Hz. With a coarser one the search compares the impedance beside the resonance.
const NO_LOAD_HZ: (f64, f64) = (0.01, 0.1);

/// Of the targets of a reference by drift, one in this number is tried: each needs a plan of its own.
const BY_DRIFT_EVERY: usize = 3;

/// Another policy of the reference than the first one is worth it if the first one takes longer than this many times as
/// long: what is expected of it rests on a drift that the bench may not have.
const POLICY_GAIN: f64 = 1.05;

/// The longest fine step, mm. With a longer one the search takes no less time.
const FINE_STEP_MM: f64 = 0.05;

/// The settings of a protocol in which nothing is left out but what its aim chooses. Faults are added where they are.
pub(crate) fn choose(
    protocol: &Protocol,
    aim: &AimKeys,
    limits: &RigLimits,
    model: &dyn TouchModel,
    faults: &mut Faults,
) -> Option<Plan> {
    let wanted = aim.wanted.as_ref()?;
    if !is_there_a_choice(protocol, limits, faults) {
        return None;
    }
    let candidates = Candidates::of(protocol, limits);
    let plans = candidates.plans(protocol, limits);
    let assumed_mpa = aim.softest_mpa.as_ref().map(|mpa| mpa.value);
    let sensitivities = match sensitivities(&plans[0].0, &limits.geometry, model, assumed_mpa) {
        Ok(sensitivities) => sensitivities,
        Err(unexpected) => {
            faults.refuse(wanted.location, &no_expectation(&plans[0].0, &unexpected));
            return None;
        }
    };
    let mut searches = candidates.searches(protocol, limits, &plans, &sensitivities);
    let (settings, missed, plan, expected) = loop {
        let (settings, missed) = match candidates.best(wanted.value, limits, &searches) {
            Ok(settings) => (settings, None),
            Err(OutOfReach { nearest, value }) => (nearest, Some(value)),
        };
        let plan = Plan::of(&protocol.with(&settings), limits);
        let expected = Expectation::of(&plan, limits, &sensitivities);
        if missed.is_some() || settings.no_load != NoLoadPolicy::ByDrift {
            break (settings, missed, plan, expected);
        }
        // Other targets of the sweeps move the references by drift: the plan may not be what was expected of it.
        let value = expected.value(&settings);
        let is_reached = value.limited_by(wanted.value) <= wanted.value.value();
        if is_reached || searches.len() == 1 {
            break (settings, (!is_reached).then_some(value), plan, expected);
        }
        searches.retain(|search| !search.is_of(&settings));
    };
    let Expectation { times, errors, .. } = expected;
    let Expected { parts, together, worst_step } = errors.at(&settings);
    let worst = plan.steps[worst_step].id.clone();
    if let Some(value) = missed {
        let fixed_percent = Expected { parts, together, worst_step }.fixed_percent();
        let fault = match wanted.value {
            Wanted::StiffnessPercent(found) => ProtocolFault::AimTooAccurate {
                found,
                limit: value.worst_percent,
                fixed_percent,
                step: worst,
            },
            Wanted::SecondsPerTouch(found) => {
                let PartTimes { rest_s, .. } = times;
                ProtocolFault::AimTooFast { found, limit: value.seconds, rest_s }
            }
        };
        faults.refuse(wanted.location, &fault);
        return None;
    }
    let stated = candidates.stated;
    let aim = AimPlan { wanted: wanted.value, settings, stated, times, parts, together, worst };
    Some(Plan { aim: Some(aim), ..plan })
}

/// A policy of the reference and a fine step, with what is expected of them.
struct Candidate<'a> {
    settings: AimSettings,
    plan: &'a Plan,
    /// The targets of the reference for which it holds, Hz.
    no_load_hz: &'a [f64],
    expected: Expectation,
}

impl Candidate<'_> {
    /// The settings with each pair of targets, and what they cost and give. The sweeps do not change the rest of a touch.
    fn values<'b>(
        &'b self,
        candidates: &'b Candidates,
        limits: &'b RigLimits,
    ) -> impl Iterator<Item = (AimSettings, Value)> + use<'b> {
        let Self { settings, plan, no_load_hz, expected } = self;
        let references = expected.course.references(plan);
        candidates.sigmas(no_load_hz).map(move |(contact_sigma_hz, no_load_sigma_hz)| {
            let settings = AimSettings { contact_sigma_hz, no_load_sigma_hz, ..*settings };
            let targets_hz = (contact_sigma_hz, no_load_sigma_hz);
            let times = plan.with_targets(limits, targets_hz, references, expected.times);
            let Expected { together, .. } = expected.errors.at(&settings);
            let seconds = times.together_s();
            (settings, Value { seconds, percent: together.all, worst_percent: together.worst })
        })
    }

    /// Whether these settings are among its own.
    fn is_of(&self, settings: &AimSettings) -> bool {
        self.settings.no_load == settings.no_load
            && self.settings.fine_step_mm == settings.fine_step_mm
            && self.no_load_hz.contains(&settings.no_load_sigma_hz)
    }
}

/// What is expected of a plan.
struct Expectation {
    course: Course,
    times: PartTimes,
    errors: Errors,
}

impl Expectation {
    fn of(plan: &Plan, limits: &RigLimits, sensitivities: &[Sensitivity]) -> Self {
        let course = plan.course(limits);
        let (times, errors) =
            (plan.times(limits, &course), Errors::of(plan, &course, sensitivities));
        Self { course, times, errors }
    }

    fn value(&self, settings: &AimSettings) -> Value {
        let Expected { together, .. } = self.errors.at(settings);
        let seconds = self.times.together_s();
        Value { seconds, percent: together.all, worst_percent: together.worst }
    }
}

fn no_expectation(plan: &Plan, unexpected: &Unexpected) -> ProtocolFault {
    let step = &plan.steps[unexpected.step];
    match (unexpected.why, step.action) {
        (NoSensitivity::UnknownSample, Action::Touch(touch)) => {
            ProtocolFault::AimOfUnknownSample { sample: plan.samples[touch.sample].clone() }
        }
        _ => ProtocolFault::AimOutsideModel { step: step.id.clone() },
    }
}

/// Checks that what the aim chooses can be chosen.
pub(crate) fn check(protocol: &Protocol, faults: &mut Faults) {
    if protocol.aim.is_none() {
        return;
    }
    for (section, sweep, ..) in sweeps(protocol) {
        let is_uniform = matches!(sweep.request.method, SweepMethod::Uniform { .. });
        if is_uniform && stated_hz(sweep).is_none() {
            let location = Location::from(&sweep.target_sigma_hz);
            faults.refuse(location, &ProtocolFault::AimNeedsAdaptive { section });
        }
    }
}

fn stated_hz(sweep: &SweepKeys) -> Option<f64> {
    sweep.target_sigma_hz.sound().copied()
}

/// The values that each setting may have: one if the file states it.
#[derive(Debug)]
struct Candidates {
    contact_hz: Vec<f64>,
    no_load_hz: Vec<f64>,
    fine_step_mm: Vec<f64>,
    no_load: Vec<NoLoadPolicy>,
    /// The first of each.
    first: AimSettings,
    /// The keys that the file states.
    stated: Vec<&'static str>,
}

/// The two sweeps of a protocol, each with its section, its possible targets, Hz, and whether it is that in contact.
fn sweeps(protocol: &Protocol) -> [(&'static str, &SweepKeys, (f64, f64), bool); 2] {
    [
        ("no_load_sweep", &protocol.no_load_sweep.sweep, NO_LOAD_HZ, false),
        ("contact_sweep", &protocol.contact_sweep, CONTACT_HZ, true),
    ]
}

/// Whether a sweep reaches this target within its time limit.
fn is_in_time(sweep: &SweepRequest, target_hz: f64, is_contact: bool, limits: &RigLimits) -> bool {
    let request = SweepRequest { target_sigma_hz: target_hz, ..*sweep };
    to_target_s(&request, is_contact, limits) <= sweep.time_limit_s
}

/// Whether there is a value for each setting that is left to the aim. Where there is none, a fault is added.
fn is_there_a_choice(protocol: &Protocol, limits: &RigLimits, faults: &mut Faults) -> bool {
    let mut is_there = true;
    for (section, sweep, (_, coarsest_hz), is_contact) in sweeps(protocol) {
        if stated_hz(sweep).is_none()
            && !is_in_time(&sweep.request, coarsest_hz, is_contact, limits)
        {
            let request = SweepRequest { target_sigma_hz: coarsest_hz, ..sweep.request };
            let limit = to_target_s(&request, is_contact, limits);
            let found = sweep.time_limit_s.value;
            faults.refuse(
                &sweep.time_limit_s,
                &ProtocolFault::AimNeedsTime { section, found, limit },
            );
            is_there = false;
        }
    }
    let ApproachKeys { coarse_step_mm, fine_step_mm, slip_mm, .. } = &protocol.approach;
    if fine_step_mm.sound().is_none() {
        let limit = limits.linear.tolerance();
        for step in [Some(coarse_step_mm), slip_mm.as_ref()].into_iter().flatten() {
            step.check(faults, |&found| {
                let is_below = 0.0 < found && found < limit;
                is_there &= !is_below;
                is_below.then_some(ProtocolFault::AimNeedsStep { key: step.key, found, limit })
            });
        }
    }
    is_there
}

impl Candidates {
    fn of(protocol: &Protocol, limits: &RigLimits) -> Self {
        let approach = &protocol.approach;
        let fine_mm = approach.fine_step_mm.sound();
        let slip_mm = approach.slip_mm.as_ref().map(|slip_mm| slip_mm.value);
        let finest_mm = limits.linear.tolerance();
        let longest_mm = FINE_STEP_MM
            .max(finest_mm)
            .min(approach.coarse_step_mm.value)
            .min(slip_mm.filter(|slip_mm| *slip_mm > 0.0).unwrap_or(f64::INFINITY));
        let [no_load_hz, contact_hz] =
            sweeps(protocol).map(|(_, sweep, (least, most), is_contact)| {
                let in_time = |hz: &f64| is_in_time(&sweep.request, *hz, is_contact, limits);
                let all = || preferred(least, most).into_iter().filter(in_time).collect();
                stated_hz(sweep).map_or_else(all, |hz| vec![hz])
            });
        let fine_step_mm = fine_mm.map_or_else(|| preferred(finest_mm, longest_mm), |mm| vec![*mm]);
        // Not "once": a person who turns the sensor changes its resonance.
        let no_load = if protocol.states_no_load {
            vec![protocol.no_load]
        } else {
            vec![NoLoadPolicy::EverySample, NoLoadPolicy::ByDrift, NoLoadPolicy::EveryTouch]
        };
        let is_stated = [
            stated_hz(&protocol.contact_sweep).is_some(),
            stated_hz(&protocol.no_load_sweep.sweep).is_some(),
            fine_mm.is_some(),
            protocol.states_no_load,
        ];
        let stated = AIM_KEYS.into_iter().zip(is_stated);
        Self {
            first: AimSettings {
                contact_sigma_hz: stated_hz(&protocol.contact_sweep).unwrap_or(CONTACT_BEFORE_HZ),
                no_load_sigma_hz: no_load_hz[0],
                fine_step_mm: fine_step_mm[0],
                no_load: no_load[0],
            },
            contact_hz,
            no_load_hz,
            fine_step_mm,
            no_load,
            stated: stated.filter_map(|(key, is_stated)| is_stated.then_some(key)).collect(),
        }
    }

    /// A plan for each policy of the reference, with the targets of the reference for which it holds, Hz.
    fn plans(&self, protocol: &Protocol, limits: &RigLimits) -> Vec<(Plan, &[f64])> {
        let of = |no_load: NoLoadPolicy, no_load_hz: &[f64]| {
            let no_load_sigma_hz = no_load_hz[0];
            let settings = AimSettings { no_load_sigma_hz, no_load, ..self.first };
            Plan::of(&protocol.with(&settings), limits)
        };
        let with = |&no_load: &NoLoadPolicy| {
            // By drift, the target says how often the reference is measured: one in three of them is tried.
            let is_by_drift = no_load == NoLoadPolicy::ByDrift;
            let (together, every) =
                if is_by_drift { (1, BY_DRIFT_EVERY) } else { (self.no_load_hz.len(), 1) };
            let targets = self.no_load_hz.chunks(together).step_by(every);
            targets.map(move |no_load_hz| (of(no_load, no_load_hz), no_load_hz))
        };
        self.no_load.iter().flat_map(with).collect()
    }

    /// The best of the candidates. A policy of the reference that rests on what a run learns, or that costs more
    /// references, must save enough against the first one.
    fn best(
        &self,
        wanted: Wanted,
        limits: &RigLimits,
        searches: &[Candidate<'_>],
    ) -> Result<AimSettings, OutOfReach> {
        let values = |search| Candidate::values(search, self, limits);
        let found = best(wanted, searches.iter().flat_map(values))?;
        let is_first = |search: &&Candidate<'_>| search.settings.no_load == self.first.no_load;
        let first: Vec<_> = searches.iter().filter(is_first).flat_map(values).collect();
        if first.is_empty() || matches!(wanted, Wanted::SecondsPerTouch(_)) {
            return Ok(found);
        }
        let seconds = |settings: &AimSettings| {
            let mut all = searches.iter().flat_map(values);
            all.find(|(other, _)| other == settings).map_or(0.0, |(_, value)| value.seconds)
        };
        let of_first = best(wanted, first.into_iter()).ok();
        let is_enough = |one: &AimSettings| seconds(one) <= POLICY_GAIN * seconds(&found);
        Ok(of_first.filter(is_enough).unwrap_or(found))
    }

    /// Each plan with each fine step.
    fn searches<'a>(
        &self,
        protocol: &Protocol,
        limits: &RigLimits,
        plans: &'a [(Plan, &'a [f64])],
        sensitivities: &[Sensitivity],
    ) -> Vec<Candidate<'a>> {
        let with = |(plan, no_load_hz): &'a (Plan, &'a [f64]), fine_step_mm: f64| {
            let settings = AimSettings { no_load: plan.no_load, fine_step_mm, ..self.first };
            let touch = protocol.with(&settings).touch_settings(limits);
            let expected = Expectation::of(&Plan { touch, ..plan.clone() }, limits, sensitivities);
            Candidate { settings, plan, no_load_hz, expected }
        };
        let of = |plan| self.fine_step_mm.iter().map(move |fine_mm| with(plan, *fine_mm));
        plans.iter().flat_map(of).collect()
    }

    /// Each pair of targets, Hz: in contact, and one of these without.
    fn sigmas<'a>(&'a self, no_load_hz: &'a [f64]) -> impl Iterator<Item = (f64, f64)> + use<'a> {
        let with = move |contact_hz: &f64| {
            let contact_hz = *contact_hz;
            no_load_hz.iter().map(move |no_load_hz| (contact_hz, *no_load_hz))
        };
        self.contact_hz.iter().flat_map(with)
    }
}
