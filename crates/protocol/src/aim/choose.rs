//! The settings of a protocol with an aim: the candidates, what each costs and gives, and the choice.

use rig_files::{Faults, Location};
use rig_model::{RigLimits, SweepMethod};

use super::{
    AIM_KEYS, AimKeys, AimPlan, AimSettings, NoSensitivity, PartTimes, Sensitivity, TouchModel,
    Wanted,
    error::{Errors, Expected, Unexpected, sensitivities},
    split::{OutOfReach, Value, best, preferred},
};
use crate::{Action, NoLoadPolicy, Plan, Protocol, fault::ProtocolFault, sweep::SweepKeys};

/// Targets of a sweep in contact, Hz. A finer one takes longer than the rest of a touch; a coarser one leaves
/// too few readings to judge the resonance by, and is measured twice.
const CONTACT_HZ: (f64, f64) = (0.01, 0.2);

/// Targets of a reference, Hz. With a coarser one the search compares the impedance beside the resonance.
const NO_LOAD_HZ: (f64, f64) = (0.01, 0.1);

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
    let candidates = Candidates::of(protocol, limits);
    let plans: Vec<Plan> = candidates.plans(protocol, limits);
    let assumed_mpa = aim.softest_mpa.as_ref().map(|mpa| mpa.value);
    let sensitivities = match sensitivities(&plans[0], model, assumed_mpa) {
        Ok(sensitivities) => sensitivities,
        Err(unexpected) => {
            faults.refuse(wanted.location, &no_expectation(&plans[0], &unexpected));
            return None;
        }
    };
    // The sweeps do not change the rest of a touch: their targets are tried without the rest.
    let searches: Vec<_> = plans
        .iter()
        .flat_map(|plan| candidates.fine_step_mm.iter().map(move |fine_mm| (plan, *fine_mm)))
        .map(|(plan, fine_step_mm)| {
            let settings = AimSettings { no_load: plan.no_load, fine_step_mm, ..candidates.first };
            let touch = protocol.with(&settings).touch_settings(limits);
            let expected = Expectation::of(&Plan { touch, ..plan.clone() }, limits, &sensitivities);
            (settings, plan, expected)
        })
        .collect();
    let of_grid = searches.iter().flat_map(|(settings, plan, expected)| {
        candidates.sigmas().map(move |(contact_sigma_hz, no_load_sigma_hz)| {
            let settings = AimSettings { contact_sigma_hz, no_load_sigma_hz, ..*settings };
            let times = plan.with_targets((contact_sigma_hz, no_load_sigma_hz), expected.times);
            let Expected { together, .. } = expected.errors.at(&settings);
            let seconds = times.together_s();
            (settings, Value { seconds, percent: together.all, worst_percent: together.worst })
        })
    });
    let (settings, missed) = match best(wanted.value, of_grid) {
        Ok(settings) => (settings, None),
        Err(OutOfReach { nearest, value }) => (nearest, Some(value)),
    };
    let plan = Plan::of(&protocol.with(&settings), limits);
    let Expectation { times, errors } = Expectation::of(&plan, limits, &sensitivities);
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

/// What is expected of a plan.
struct Expectation {
    times: PartTimes,
    errors: Errors,
}

impl Expectation {
    fn of(plan: &Plan, limits: &RigLimits, sensitivities: &[Sensitivity]) -> Self {
        let (times, durations_s) = plan.times_and_durations_s(limits);
        Self { times, errors: Errors::of(plan, &durations_s, sensitivities) }
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
    for (section, sweep) in [
        ("no_load_sweep", &protocol.no_load_sweep.sweep),
        ("contact_sweep", &protocol.contact_sweep),
    ] {
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

impl Candidates {
    fn of(protocol: &Protocol, limits: &RigLimits) -> Self {
        let sigmas = |sweep: &SweepKeys, (least, most): (f64, f64)| {
            stated_hz(sweep).map_or_else(|| preferred(least, most), |hz| vec![hz])
        };
        let approach = &protocol.approach;
        let fine_mm = approach.fine_step_mm.sound();
        let slip_mm = approach.slip_mm.as_ref().map(|slip_mm| slip_mm.value);
        let longest_mm = FINE_STEP_MM
            .min(approach.coarse_step_mm.value)
            .min(slip_mm.filter(|slip_mm| *slip_mm > 0.0).unwrap_or(FINE_STEP_MM));
        let contact_hz = sigmas(&protocol.contact_sweep, CONTACT_HZ);
        let no_load_hz = sigmas(&protocol.no_load_sweep.sweep, NO_LOAD_HZ);
        let fine_step_mm = fine_mm
            .map_or_else(|| preferred(limits.linear.tolerance(), longest_mm), |mm| vec![*mm]);
        // Not "once": a person who turns the sensor changes its resonance.
        let no_load = if protocol.states_no_load {
            vec![protocol.no_load]
        } else {
            vec![NoLoadPolicy::EverySample, NoLoadPolicy::EveryTouch]
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
                contact_sigma_hz: contact_hz[0],
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

    /// A plan for each policy of the reference.
    fn plans(&self, protocol: &Protocol, limits: &RigLimits) -> Vec<Plan> {
        let of = |&no_load: &NoLoadPolicy| {
            Plan::of(&protocol.with(&AimSettings { no_load, ..self.first }), limits)
        };
        self.no_load.iter().map(of).collect()
    }

    /// Each pair of targets, Hz: in contact and without.
    fn sigmas(&self) -> impl Iterator<Item = (f64, f64)> + use<'_> {
        let with = |contact_hz: &f64| {
            let contact_hz = *contact_hz;
            self.no_load_hz.iter().map(move |no_load_hz| (contact_hz, *no_load_hz))
        };
        self.contact_hz.iter().flat_map(with)
    }
}
