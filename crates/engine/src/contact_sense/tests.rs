use rig_model::RigTime;
use rig_resonance::ModelOrder;

use super::*;
use crate::interlock::bench::limits;

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
