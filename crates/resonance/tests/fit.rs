//! The fit against circuits that are known: accuracy, calibration, refusals.

#[expect(dead_code, reason = "each test file uses its part")]
mod support;

use num_complex::Complex64;
use rig_model::{PointResult, Reading};
use rig_resonance::{
    Circuit, FitOptions, FitOutcome, ModelOrder, NoisePrior, Reason, Side, Timing, fit,
};
use support::{Random, circuit, circuit_scores, impedance, measured, reading, sweep};

const WINDOW: (f64, f64) = (112.0, 168.0);

#[track_caller]
fn check_refused(readings: &[Reading], is_expected: impl Fn(&Reason) -> bool) {
    match fit(readings, &FitOptions::default()) {
        FitOutcome::Refused(refusal) => assert!(is_expected(&refusal.reason), "{refusal:?}"),
        FitOutcome::Accepted(found) => panic!("accepted: {found:?}"),
    }
}

#[test]
fn the_error_reaches_the_cramer_rao_bound_and_is_what_is_claimed() {
    // √N/σ times the bound in Hz for 101 even points, four parameters.
    let bounds = [
        (10.0, 0.02, 79.56),
        (10.0, 0.1, 18.85),
        (30.0, 0.02, 16.39),
        (30.0, 0.1, 7.20),
        (100.0, 0.02, 4.34),
        (100.0, 0.1, 3.61),
    ];
    let mut random = Random::new(1);
    let (mut all, mut refused) = (0, 0);
    for (q, k_eff_squared, bound) in bounds {
        for noise in [0.001, 0.005, 0.02] {
            let trials = 400;
            let (mut squared, mut scores) = (0.0, 0.0);
            for _ in 0..trials {
                let mut circuit = circuit(q, k_eff_squared);
                circuit.resonance_hz += random.between(-0.56, 0.56);
                let readings = sweep(WINDOW, 101, noise, &mut random, |f| circuit.impedance_ohm(f));
                all += 1;
                let FitOutcome::Accepted(found) = fit(&readings, &FitOptions::default()) else {
                    refused += 1;
                    continue;
                };
                let error = found.resonance_hz - circuit.resonance_hz;
                squared += error * error;
                scores += (error / found.sigma_hz).powi(2);
            }
            let ratio = (squared / f64::from(trials)).sqrt() / (noise * bound / 101_f64.sqrt());
            let score = (scores / f64::from(trials)).sqrt();
            // 400 trials know a standard deviation to 3.5 %; three of that.
            assert!((0.89..1.11).contains(&ratio), "Q {q}, k² {k_eff_squared}, {noise}: {ratio}");
            // A phase error or a second mode that the readings do not exclude widens the standard
            // deviation.
            assert!((0.8..1.11).contains(&score), "Q {q}, k² {k_eff_squared}, {noise}: {score}");
        }
    }
    assert!(1000 * refused <= all, "{refused} of {all} good sweeps refused");
}

#[test]
fn the_circuit_is_as_uncertain_as_stated() {
    let mut random = Random::new(2);
    for (q, k_eff_squared) in [(10.0, 0.1), (30.0, 0.05), (100.0, 0.02)] {
        let truth = Circuit { loss_tangent: 0.015, ..circuit(q, k_eff_squared) };
        let (mut squares, mut accepted) = ([0.0; 3], 0);
        for _ in 0..400 {
            let readings = sweep(WINDOW, 101, 0.005, &mut random, |f| truth.impedance_ohm(f));
            let verdict = fit(&readings, &FitOptions::default());
            let Some(found) = verdict.accepted() else { continue };
            accepted += 1;
            for (sum, score) in squares.iter_mut().zip(circuit_scores(found, &truth)) {
                *sum += score * score;
            }
        }
        assert!(accepted > 390, "{accepted}");
        for sum in squares {
            let score = (sum / f64::from(accepted)).sqrt();
            assert!((0.89..1.11).contains(&score), "Q {q}, k² {k_eff_squared}: {score}");
        }
    }
}

#[test]
fn every_parameter_comes_out_of_noiseless_readings() {
    for loss_tangent in [0.0, 0.02] {
        let mut circuit = circuit(30.0, 0.05);
        circuit.loss_tangent = loss_tangent;
        let readings = sweep(WINDOW, 21, 0.0, &mut Random::new(1), |f| circuit.impedance_ohm(f));
        let verdict = fit(&readings, &FitOptions::default());
        let FitOutcome::Accepted(found) = verdict else { panic!("{verdict:?}") };
        let pairs = [
            (found.resonance_hz, 140.0),
            (found.q, 30.0),
            (found.c0_farad, 27e-9),
            (found.k_eff_squared, 0.05),
            (found.loss_tangent + 1.0, loss_tangent + 1.0),
        ];
        for (found, expected) in pairs {
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        }
        let model_order = if loss_tangent > 0.0 { ModelOrder::Loss } else { ModelOrder::Circuit };
        assert_eq!(found.model_order, model_order);
    }
}

#[test]
fn the_order_of_the_readings_has_no_influence() {
    let circuit = circuit(30.0, 0.05);
    let mut readings = sweep(WINDOW, 40, 0.005, &mut Random::new(7), |f| circuit.impedance_ohm(f));
    let forward = fit(&readings, &FitOptions::default());
    readings.reverse();
    let backward = fit(&readings, &FitOptions::default());
    let (a, b) = (forward.accepted().unwrap(), backward.accepted().unwrap());
    assert!((a.resonance_hz - b.resonance_hz).abs() < 1e-4 * a.sigma_hz, "{a:?} {b:?}");
}

/// With six digits, as an analyzer writes them.
fn rounded(reading: &Reading) -> Reading {
    let digits = |x: f64| format!("{x:.5e}").parse().expect("a number");
    let found = impedance(reading);
    Reading { measured: measured(Complex64::new(digits(found.re), digits(found.im))), ..*reading }
}

#[test]
fn a_wrong_reading_is_left_out_whatever_it_says() {
    let truth = Circuit { resonance_hz: 210.6, loss_tangent: 0.015, ..circuit(16.0, 0.03) };
    let noise = Some(NoisePrior { at_ten_cycles: 0.005, degrees_of_freedom: 21.0 });
    for seed in 0..20 {
        let mut random = Random::new(seed);
        let good = sweep((170.0, 262.0), 15, 0.005, &mut random, |f| truth.impedance_ohm(f));
        for factor in [-1e10, -10.0, 0.0001, 0.1, 2.0, 10.0, 1e4, 1e7, 1e10] {
            for (at, noise, is_rounded) in [
                (0, noise, true),
                (4, noise, true),
                (0, None, true),
                (0, noise, false),
                (14, None, false),
            ] {
                let mut readings = good.clone();
                readings[at].measured = measured(factor * impedance(&good[at]));
                if is_rounded {
                    readings = readings.iter().map(rounded).collect();
                }
                let options = FitOptions { timing: Timing::Waited, noise, ..FitOptions::default() };
                let verdict = fit(&readings, &options);
                let what =
                    format!("seed {seed}, {factor} at {at}, {noise:?}, {is_rounded}: {verdict:?}");
                let found = verdict.accepted().unwrap_or_else(|| panic!("{what}"));
                assert!((13..15).contains(&found.points) && found.sigma_hz < 1.0, "{what}");
                let error = found.resonance_hz - truth.resonance_hz;
                assert!(error.abs() < 5.0 * found.sigma_hz, "{what}");
            }
        }
    }
}

#[test]
fn outliers_are_left_out_and_too_many_refuse() {
    let circuit = circuit(30.0, 0.05);
    let mut random = Random::new(3);
    let mut readings = sweep(WINDOW, 101, 0.005, &mut random, |f| circuit.impedance_ohm(f));
    for (index, factor) in [(20, 1.3), (51, 0.4), (80, 2.0)] {
        readings[index].measured = measured(factor * impedance(&readings[index]));
    }
    let verdict = fit(&readings, &FitOptions::default());
    let found = verdict.accepted().unwrap();
    assert_eq!(found.points, 98);
    assert!((found.resonance_hz - 140.0).abs() < 4.0 * found.sigma_hz, "{found:?}");
    for reading in readings.iter_mut().step_by(5) {
        let z = impedance(reading);
        reading.measured = measured(Complex64::new(1.5 * z.re, 0.7 * z.im));
    }
    check_refused(&readings, |reason| matches!(reason, Reason::Outliers { .. }));
}

/// Of thirteen readings one is wrong, as by a bit in its reply: it pulls the circuit towards itself.
#[test]
fn one_wrong_reading_of_few_is_left_out_or_refused() {
    let circuit = circuit(66.0, 0.075);
    let window = (132.0, 150.0);
    let options = FitOptions { timing: Timing::Waited, always_loss: true, ..FitOptions::default() };
    let (mut far, mut all) = (0, 0);
    for seed in 0..20 {
        let mut random = Random::new(seed);
        let good = sweep(window, 13, 0.004, &mut random, |f| circuit.impedance_ohm(f));
        for index in 0..good.len() {
            for (real, imaginary) in [(1.0, 2.6), (1.0, -1.0), (1.3, 1.0), (0.4, 0.4), (10.0, 10.0)]
            {
                let mut readings = good.clone();
                let z = impedance(&good[index]);
                readings[index].measured = measured(Complex64::new(real * z.re, imaginary * z.im));
                let verdict = fit(&readings, &options);
                all += 1;
                far += u32::from(verdict.accepted().is_some_and(|found| {
                    found.sigma_hz > 0.05 || (found.resonance_hz - 140.0).abs() > 0.1
                }));
            }
        }
    }
    assert_eq!(far, 0, "of {all}");
}

#[test]
fn what_is_no_resonance_in_the_window_is_refused_with_its_reason() {
    let mut random = Random::new(5);
    let capacitor = |f: f64| Complex64::new(30.0, -1.0 / (std::f64::consts::TAU * f * 27e-9));
    let empty = sweep(WINDOW, 101, 0.005, &mut random, capacitor);
    check_refused(&empty, |reason| matches!(reason, Reason::NoResonance { .. }));
    for (resonance_hz, side) in [(105.0, Side::Below), (175.0, Side::Above)] {
        let mut circuit = circuit(30.0, 0.05);
        circuit.resonance_hz = resonance_hz;
        let beside = sweep(WINDOW, 101, 0.002, &mut random, |f| circuit.impedance_ohm(f));
        check_refused(
            &beside,
            |reason| matches!(reason, Reason::OutsideWindow { side: found, .. } if *found == side),
        );
    }
}

#[test]
fn readings_that_cannot_be_used_are_refused_with_their_reason() {
    let circuit = circuit(30.0, 0.05);
    let good = sweep(WINDOW, 20, 0.005, &mut Random::new(9), |f| circuit.impedance_ohm(f));
    check_refused(&good[..6], |r| matches!(r, Reason::TooFewPoints { found: 6, needed: 7 }));
    check_refused(&[], |r| matches!(r, Reason::TooFewPoints { found: 0, .. }));
    for impedance in [f64::NAN, f64::INFINITY, 0.0] {
        let mut bad = good.clone();
        bad[4] = reading(130.0, Complex64::new(impedance, impedance));
        check_refused(&bad, |r| *r == Reason::NotFinite { index: 4 });
        bad[4].measured = PointResult::Overload;
        let verdict = fit(&bad, &FitOptions::default());
        assert_eq!(verdict.accepted().unwrap().points, 19);
    }
    let mut bad = good;
    bad[3].frequency_hz = -130.0;
    check_refused(&bad, |r| *r == Reason::NotFinite { index: 3 });
    for reading in &mut bad[3..] {
        reading.measured = PointResult::Overload;
    }
    check_refused(&bad, |r| *r == Reason::Saturated { overloaded: 17, readings: 20 });
}

#[test]
fn a_loss_below_zero_is_zero_with_its_uncertainty_and_costs_the_resonance_nothing() {
    // Without loss half of the estimates are below zero.
    let circuit = circuit(30.0, 0.05);
    let options = FitOptions { always_loss: true, ..FitOptions::default() };
    let (mut below, mut squares) = (0, 0.0);
    for seed in 0..200 {
        let mut random = Random::new(seed);
        let readings = sweep(WINDOW, 41, 0.005, &mut random, |f| circuit.impedance_ohm(f));
        let verdict = fit(&readings, &options);
        let found = verdict.accepted().unwrap_or_else(|| panic!("{seed}: {verdict:?}"));
        assert!(found.loss_tangent >= 0.0, "{seed}: {found:?}");
        let sigma = found.loss_tangent_sigma().expect("the loss was fitted");
        assert!(found.loss_tangent < 5.0 * sigma, "{seed}: {found:?}");
        if found.loss_tangent == 0.0 {
            below += 1;
            squares += ((found.resonance_hz - 140.0) / found.sigma_hz).powi(2);
        }
    }
    let rms = (squares / f64::from(below)).sqrt();
    assert!((60..140).contains(&below) && (0.8..1.2).contains(&rms), "{below}: {rms}");
}

/// A phase error of an analyzer makes a loss tangent of −0.1 at most.
#[test]
fn a_sensor_that_gives_power_to_the_drive_is_refused() {
    for (loss_tangent, is_possible) in [(-0.3, false), (-0.15, false), (-0.08, true)] {
        let circuit = Circuit { loss_tangent, ..circuit(30.0, 0.05) };
        let mut random = Random::new(5);
        let readings = sweep(WINDOW, 101, 0.005, &mut random, |f| circuit.impedance_ohm(f));
        if is_possible {
            let verdict = fit(&readings, &FitOptions::default());
            assert!(verdict.accepted().is_some(), "{verdict:?}");
            continue;
        }
        check_refused(&readings, |reason| {
            let says = reason.to_string();
            let is_below = says.contains("loss tangent of -0.") && says.contains("at least -0.100");
            matches!(reason, Reason::NotASensor { .. }) && is_below
        });
    }
}
