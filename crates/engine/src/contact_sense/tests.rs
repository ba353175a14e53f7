use std::time::Duration;

use num_complex::Complex64;
use rig_model::{
    Clearance, ContactAngle, Direction, DriveLevel, RigTime, SweepMethod, SweepRequest, Window,
};
use rig_protocol::{NoLoadPolicy, Plan, Pose, RefusalPolicy, TouchSettings};
use rig_resonance::{
    Bench, FitOptions, FitOutcome, ModelOrder, NoisePrior, Reason, Refusal, Timing, fit,
};

use super::*;
use crate::{
    FinishedSweep, Operation, SweepPurpose,
    drift::Drift,
    interlock::{Proven, bench::limits},
    listening::Listening,
    machine::{MachineContext, MachineStep},
    no_load::{NoLoad, in_order, is_vague},
    sweep::SweepStep,
};

/// What a sweep of fourteen readings found, in a run on a simulated bench with seed 3: its static capacitance is
/// 3.3 of its standard deviations too large, and the motional one and the loss go along. `part` is the part of
/// that standard deviation that is stated.
fn short_sweep(part: f64) -> Resonance {
    let mut covariance = [
        [3.08e-4, 3.97e-3, 1.28e-11, 3.24e-13, -3.29e-4],
        [3.97e-3, 1.154, 4.1e-11, -3.32e-11, 7.91e-3],
        [1.28e-11, 4.1e-11, 1.537e-17, 5.637e-19, -1.507e-10],
        [3.24e-13, -3.32e-11, 5.637e-19, 2.185e-20, -5.829e-12],
        [-3.29e-4, 7.91e-3, -1.507e-10, -5.829e-12, 1.858e-3],
    ];
    covariance[2] = covariance[2].map(|cell| cell * part);
    for row in &mut covariance {
        row[2] *= part;
    }
    Resonance {
        resonance_hz: 140.516_8,
        sigma_hz: 0.0176,
        q: 65.67,
        c0_farad: 39.81e-9,
        k_eff_squared: 0.068_92 / 1.068_92,
        loss_tangent: 0.0,
        figure_of_merit: 4.5,
        chi_squared_per_dof: 1.0,
        noise_at_ten_cycles: 0.005,
        noise_degrees_of_freedom: 20.0,
        model_order: ModelOrder::RingUp,
        extra: None,
        mains_hz: None,
        points: 14,
        covariance,
        condition: 100.0,
    }
}

fn reading(frequency_hz: f64, resistance_ohm: f64, reactance_ohm: f64) -> Reading {
    let measured = PointResult::Value(Impedance { resistance_ohm, reactance_ohm });
    Reading { frequency_hz, measured, started: RigTime::ZERO, settle_s: 1.0, integration_s: 0.014 }
}

/// What was read of the clear probe.
fn clear() -> [Reading; 2] {
    [reading(134.1, 3752.18, -25307.6), reading(140.52, 7357.37, -1002.53)]
}

#[test]
fn a_clear_probe_is_clear_although_a_short_sweep_has_missed_its_capacitance() {
    assert!(check_free(&short_sweep(1.0), &clear()).is_ok());
    // Refused if the sweep states a small standard deviation; the message names the frequency that differs.
    let refused = check_free(&short_sweep(0.1), &clear()).unwrap_err();
    let ContactSenseFault::NotFree { frequency_hz, .. } = refused else { panic!("{refused}") };
    assert_eq!(frequency_hz, 134.1);
}

#[test]
fn a_contact_is_no_clear_probe_although_a_short_sweep_has_missed_its_capacitance() {
    let [off, _] = clear();
    let free = Circuit { c0_farad: 27e-9, c1_farad: 2.2e-9, ..short_sweep(1.0).circuit() };
    for shift_hz in [7.0, 15.0, 40.0, 86.0] {
        let touching = Circuit { resonance_hz: free.resonance_hz + shift_hz, ..free };
        let z = touching.impedance_ohm(140.52);
        let refused = check_free(&short_sweep(1.0), &[off, reading(140.52, z.re, z.im)]);
        assert!(
            matches!(refused, Err(ContactSenseFault::NotFree { .. })),
            "{shift_hz}: {refused:?}"
        );
    }
}

/// The free resonance of a blind sense drifts by many standard deviations of two good sweeps.
#[test]
fn a_shift_that_changes_the_impedance_by_less_than_the_contact_is_none() {
    let free = Resonance { sigma_hz: 0.002, ..short_sweep(1.0) };
    let shifted = |hz: f64| Resonance { resonance_hz: free.resonance_hz + hz, ..free };
    let check = |hz: f64| check_shift(&free, &shifted(hz), 0.1);
    for hz in [-5.0, 0.0, 0.01, 0.03] {
        let Err(TouchRefusal::NoShift { shift_hz, percent, .. }) = check(hz) else {
            panic!("{hz} Hz")
        };
        assert!((shift_hz - hz).abs() < 1e-9 && (percent < 5.0 || hz < 0.0), "{hz} {percent}");
    }
    for hz in [0.3, 5.0, 100.0] {
        assert_eq!(check(hz), Ok(()), "{hz}");
    }
    let vague = Resonance { sigma_hz: 0.1, ..shifted(0.3) };
    assert!(check_shift(&free, &vague, 0.1).is_err());
}

#[test]
fn a_reading_integrates_as_many_cycles_as_the_noise_asks_for_and_too_much_noise_is_refused() {
    let noisy = |noise| Resonance { noise_at_ten_cycles: noise, ..short_sweep(1.0) };
    for (noise, threshold, cycles) in [(0.005, 0.1, 1.6), (0.01, 0.1, 6.4), (0.005, 0.05, 6.4)] {
        let needed = cycles_needed(&noisy(noise), threshold);
        assert!((needed - cycles).abs() < 1e-9, "{noise}, {threshold}: {needed}");
    }
    let approach = Approach {
        start_above_mm: 0.4,
        give_up_below_mm: 0.6,
        coarse_step_mm: 0.1,
        fine_step_mm: 0.005,
        contact_threshold: 0.1,
        settle_s: 0.1,
        cycles: 2,
        slip_mm: 0.05,
        descent_mm_per_s: None,
        slow_descent_mm_per_s: None,
    };
    let check = |noise| check_reference(None, &noisy(noise), &approach);
    assert_eq!(check(0.055), Ok(()));
    let patient = Approach { cycles: 300, ..approach };
    assert_eq!(check_reference(None, &noisy(0.06), &patient), Ok(()));
    assert_eq!(
        check(0.06).unwrap_err().to_string(),
        "contact sense: the noise of ten cycles is 6.00 % of the impedance, and a change by 10.0 % needs \
         readings of 230 cycles to be told from it, where at most 200 are allowed"
    );
}

/// The surface may lie 0.5 mm too low, and a touch be 0.6 mm deep.
#[test]
fn a_surface_whose_touch_would_end_below_the_floor_is_refused_with_where_it_was() {
    let (limits, expected) = (limits(), Position::new(10.0));
    let level = ContactAngle::new(0.0).unwrap();
    let check = |found| check_depth(Position::new(found), expected, (0.5, level), &limits);
    assert_eq!(check(9.42), Ok(()));
    assert_eq!(
        check(9.4).unwrap_err().to_string(),
        "the surface was found at 9.400 mm, and the geometry of the rig file expects it at 10.000 mm: a touch of \
         0.500 mm needs it at 9.410 mm or above"
    );
}

/// A no-load sweep with a standard deviation of 0.04 Hz as its target, on the shipped scene with a walk of 1 Hz in an
/// hour: frequency in Hz, resistance and reactance in ohm, begin, settling and integration in s.
const LOOSE_SWEEP: [(f64, f64, f64, f64, f64, f64); 9] = [
    (141.37, 6968.17, -1756.37, 0.189968, 0.0, 0.014147273),
    (141.37, 6986.26, -1328.65, 0.189968, 0.005886, 0.014147273),
    (141.37, 7233.03, -773.793, 0.189968, 0.020886, 0.014147273),
    (141.37, 7243.1, -454.2, 0.189968, 0.035886, 0.014147273),
    (141.37, 7543.61, -205.217, 0.189968, 0.050886, 0.014147273),
    (138.38, 8072.4, 1850.31, 0.263927, 0.0, 0.043358867),
    (138.38, 6452.21, -3085.75, 0.263927, 0.035927, 0.043358867),
    (138.38, 5159.58, -4609.7, 0.263927, 0.083312, 0.014452956),
    (138.38, 4384.69, -5183.64, 0.263927, 0.094927, 0.014452956),
];

/// The fit of that sweep. It states a quality factor of 51 and no loss; in truth they are 66 and 0.018.
pub(crate) fn loose_sweep() -> Resonance {
    let reading = |&(frequency_hz, r, x, started_s, settle_s, integration_s): &_| Reading {
        started: RigTime::ZERO + Duration::from_secs_f64(started_s),
        settle_s,
        integration_s,
        ..reading(frequency_hz, r, x)
    };
    let options = FitOptions {
        window: Some(Window { min_hz: 125.0, max_hz: 160.0 }),
        noise: Some(NoisePrior { at_ten_cycles: 0.005_022, degrees_of_freedom: 451.7 }),
        timing: Timing::AnyPhase,
        always_loss: true,
        near: Some(Circuit {
            resonance_hz: 140.687,
            q: 51.42,
            c0_farad: 29.96e-9,
            c1_farad: 3.078e-9,
            loss_tangent: -0.1296,
        }),
        bench: Some(Bench {
            phase_rad: -0.000_54,
            phase_sigma_rad: 0.001_71,
            first_gap_s: -0.000_43,
            dispersion_farad: 0.0,
            dispersion_sigma_farad: 0.0,
            mode_sigma: 0.013_66,
            surveyed: Window { min_hz: 127.1, max_hz: 157.9 },
        }),
    };
    let readings = LOOSE_SWEEP.each_ref().map(reading);
    *fit(&readings, &options).accepted().expect("the sweep is accepted")
}

/// The sensor of that scene.
fn of_scene() -> Circuit {
    Circuit {
        resonance_hz: 140.67,
        q: 66.5,
        c0_farad: 28.3e-9,
        c1_farad: 2.302e-9,
        loss_tangent: 0.0178,
    }
}

fn read_of(circuit: &Circuit, frequency_hz: f64) -> Reading {
    let z = circuit.impedance_ohm(frequency_hz);
    reading(frequency_hz, z.re, z.im)
}

/// The readings of a self-test three stated time constants, or what `time_constant_s` says, after the frequency was
/// changed from that of the baseline: what is left of the vibration adds to the current, at any `phase`.
fn self_test(no_load: &Resonance, time_constant_s: f64, phase: f64) -> [Reading; 2] {
    use std::f64::consts::{PI, TAU};
    let (sensor, to_hz) = (of_scene(), no_load.resonance_hz);
    let from_hz = to_hz * (1.0 - TEST_LINEWIDTHS / no_load.q);
    let still = Circuit { c0_farad: 1e-30, ..sensor };
    // The motional branch alone, and the whole sensor.
    let branch = |hz: f64| still.impedance_ohm(hz).inv();
    let left = (-3.0 * time_constant_s * PI * sensor.resonance_hz / sensor.q).exp();
    let vibration = branch(to_hz) * left * Complex64::from_polar(1.0, phase * TAU);
    let z = (sensor.impedance_ohm(from_hz).inv() + vibration - branch(from_hz) * left).inv();
    [reading(from_hz, z.re, z.im), read_of(&sensor, to_hz)]
}

/// On the shipped scene with a walk of 1 Hz in an hour and references by drift, the run was latched with 58 %.
#[test]
fn a_loose_reference_latches_no_sound_analyzer() {
    let no_load = loose_sweep();
    assert!((no_load.q - 51.0).abs() < 1.0 && of_scene().q > 66.0, "{}", no_load.q);
    let stated_s = no_load.q / (std::f64::consts::PI * no_load.resonance_hz);
    let (mut refused, mut latched) = (0, 0);
    for phase in (0..64).map(|part| f64::from(part) / 64.0) {
        let check = |time_constant_s| {
            let readings = self_test(&no_load, time_constant_s, phase);
            let strict = check_free_within(&no_load, &readings, |_, _| response::TOLERANCE);
            (strict, check_free(&no_load, &readings))
        };
        let (strict, _) = check(stated_s);
        refused += u32::from(matches!(strict, Err(ContactSenseFault::NoResponse { .. })));
        let (_, now) = check(response::ring_time_constant_s(&no_load));
        latched += u32::from(now.is_err());
    }
    // As it was before, so that the test is about the case.
    assert!(refused > 0);
    assert_eq!(latched, 0);
}

/// Two readings of an analyzer that gives the same impedance at both frequencies, but for some noise.
fn deaf(no_load: &Resonance, z: Complex64, noise: f64) -> [Reading; 2] {
    let (to_hz, more) = (no_load.resonance_hz, 1.0 + noise);
    let from_hz = to_hz * (1.0 - TEST_LINEWIDTHS / no_load.q);
    [reading(from_hz, z.re, z.im), reading(to_hz, z.re * more, z.im * more)]
}

/// An analyzer that stays at a frequency, or reads one impedance always, is noticed in each case in which half of the
/// expected change was the limit, however uncertain the reference is.
#[test]
fn an_analyzer_that_does_not_follow_the_frequency_is_noticed_by_any_reference() {
    let (mut cases, mut widened) = (0, 0);
    for no_load in [loose_sweep(), short_sweep(1.0)] {
        for scale in [0.0, 1.0, 3.5, 25.0, 1e4] {
            let covariance = no_load.covariance.map(|row| row.map(|cell| scale * cell));
            let no_load = Resonance { covariance, ..no_load };
            let stuck = (0..12).map(|step| of_scene().impedance_ohm(125.0 + 3.0 * f64::from(step)));
            let dead = [1e2, 1e3, 1e4, 1e5].map(|ohm| Complex64::new(ohm, -ohm));
            for z in stuck.chain(dead) {
                for noise in [0.0, -0.02, 0.02] {
                    let readings = deaf(&no_load, z, noise);
                    let strict = check_free_within(&no_load, &readings, |_, _| response::TOLERANCE);
                    let now = check_free(&no_load, &readings);
                    assert_eq!(strict.is_err(), now.is_err(), "{scale} {z} {noise}: {now:?}");
                    cases += u32::from(now.is_err());
                }
            }
            let of_test = deaf(&no_load, Complex64::new(1.0, 0.0), 0.0).map(|one| one.frequency_hz);
            let limit = response::tolerance(&no_load, of_test[0], of_test[1]);
            widened += u32::from(response::TOLERANCE < limit);
        }
    }
    // All are noticed, and the references that say something make an allowance.
    assert_eq!((cases, widened), (2 * 5 * 16 * 3, 4));
}

#[test]
fn a_reference_says_nothing_when_its_expected_change_is_uncertain_by_a_sixth() {
    let no_load = loose_sweep();
    assert!(!response::says_nothing(&no_load));
    let scaled = |scale: f64| {
        let covariance = no_load.covariance.map(|row| row.map(|cell| scale * scale * cell));
        Resonance { covariance, ..no_load }
    };
    // The loose sweep knows the change to 8 %.
    assert!(!response::says_nothing(&scaled(1.7)));
    assert!(response::says_nothing(&scaled(2.5)));
    // The free sensor is then measured once more.
    assert!(is_vague(None, &scaled(2.5)) && !is_vague(None, &no_load));
    let [from_hz, to_hz] = [132.39, 140.69];
    let limits = [0.0, 1.0, 10.0].map(|scale| response::tolerance(&scaled(scale), from_hz, to_hz));
    // One that was measured again, and says nothing, makes no allowance.
    assert_eq!((limits[0], limits[2]), (0.5, 0.5));
    assert!((limits[1] - 0.747).abs() < 0.01, "{limits:?}");
}

/// The run did so with two refused sweeps, and gave up after the vague one and a refused one.
#[test]
fn a_vague_reference_is_measured_again_although_a_sweep_is_refused() {
    let good = loose_sweep();
    let covariance = good.covariance.map(|row| row.map(|cell| 6.25 * cell));
    let vague = Resonance { covariance, ..good };
    assert!(is_vague(None, &vague) && !is_vague(None, &good));
    let refused = FitOutcome::Refused(Refusal { reason: Reason::NotConverged, estimate: None });
    let sweep = |outcome| FinishedSweep {
        purpose: SweepPurpose::NoLoad,
        level: plan().no_load_sweep.level,
        readings: Vec::new(),
        probe_readings: 0,
        outcome,
        effective_time_s: None,
        fit: FitOptions::default(),
        target_hz: None,
    };
    let end = |outcomes: &[FitOutcome]| {
        let (plan, limits, drift) = (plan(), limits(), Drift::default());
        let mut context = MachineContext {
            now: RigTime::ZERO,
            plan: &plan,
            limits: &limits,
            probe: Proven { clearance: Clearance::Clear, height: None, tilt: None },
            bench: None,
            drift: &drift,
            driven: None,
            notes: &mut Vec::new(),
        };
        let angle = ContactAngle::new(0.0).expect("an angle");
        let mut no_load = NoLoad::new(Pose { direction: Direction::Front, angle });
        let ends = outcomes.iter().map(|outcome| {
            let step = SweepStep::Finished(Box::new(sweep(outcome.clone())));
            no_load.follow(step, None, &mut context)
        });
        match ends.last() {
            Some(MachineStep::Done(reference)) => Ok(reference.found.len()),
            Some(MachineStep::Fault(fault)) => Err(fault.to_string()),
            other => panic!("{other:?}"),
        }
    };
    let [good, vague] = [good, vague].map(FitOutcome::Accepted);
    let all = [vague.clone(), refused.clone(), good];
    assert_eq!(end(&all), Ok(2));
    // A second vague one is the reference as it is.
    assert_eq!(end(&[vague.clone(), refused.clone(), vague.clone()]), Ok(2));
    let said = "the no-load resonance was refused 2 times: the fit did not converge";
    assert_eq!(end(&[vague, refused.clone(), refused]), Err(said.to_owned()));
}

/// It counts for the drift, as the checker counts every accepted sweep of the free sensor.
#[test]
fn a_reference_that_was_measured_again_keeps_its_place_among_the_others() {
    let (found, at) = (loose_sweep(), |seconds| RigTime::ZERO + Duration::from_secs(seconds));
    let all = in_order(&[(at(2), found)], vec![(at(1), found), (at(3), found)]);
    assert_eq!(all.iter().map(|(at, _)| *at).collect::<Vec<_>>(), [at(1), at(2), at(3)]);
}

/// A plan without steps.
pub(crate) fn plan() -> Plan {
    let sweep = SweepRequest {
        window: Window { min_hz: 125.0, max_hz: 160.0 },
        method: SweepMethod::Adaptive,
        target_sigma_hz: 0.04,
        time_limit_s: 30.0,
        cycles: 20,
        settle_s: 0.0,
        level: DriveLevel { volt: 5.0 },
    };
    let approach = Approach {
        start_above_mm: 0.4,
        give_up_below_mm: 0.6,
        coarse_step_mm: 0.1,
        fine_step_mm: 0.005,
        contact_threshold: 0.1,
        settle_s: 0.005,
        cycles: 2,
        slip_mm: 0.025,
        descent_mm_per_s: None,
        slow_descent_mm_per_s: None,
    };
    Plan {
        no_load: NoLoadPolicy::ByDrift,
        name: "self-test".to_owned(),
        samples: Vec::new(),
        steps: Vec::new(),
        touch: TouchSettings {
            indentation_mm: 0.5,
            halfway_mm: None,
            dwell_s: 0.5,
            approach,
            on_refusal: RefusalPolicy::Record,
        },
        no_load_sweep: sweep,
        survey_s: None,
        level_check: false,
        contact_sweep: sweep,
        classes: None,
        seed: 0,
        aim: None,
    }
}

#[test]
fn the_reading_of_the_self_test_waits_for_the_ring_that_is_possible() {
    let (no_load, plan, sensor) = (loose_sweep(), plan(), of_scene());
    let listening = Listening { now: RigTime::ZERO, no_load: &no_load, plan: &plan, driven: None };
    let time_constant_s = sensor.q / (std::f64::consts::PI * sensor.resonance_hz);
    for operation in [listening.test(), listening.both()] {
        let Operation::Measure { points, .. } = operation else { panic!("{operation:?}") };
        let waits = points[0].settle_s / time_constant_s;
        assert!((2.7..3.5).contains(&waits), "{waits} time constants");
    }
}
