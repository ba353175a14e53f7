//! Tests of the estimators with known circuits.

use num_complex::Complex64;
use rand_core::Rng;
use rand_pcg::Pcg64;
use rig_model::{Impedance, PointResult, Reading, RigTime, Window};

use super::{Definition, Estimator, NoEstimate};
use crate::{Circuit, Reason, Side};

const WINDOW: Window = Window { min_hz: 112.0, max_hz: 168.0 };
const STEP_HZ: f64 = 0.28;

fn circuit(q: f64, k_eff_squared: f64) -> Circuit {
    let c1_farad = 27e-9 * k_eff_squared / (1.0 - k_eff_squared);
    // This frequency is not on the grid.
    Circuit { resonance_hz: 140.1, q, c0_farad: 27e-9, c1_farad, loss_tangent: 0.0 }
}

/// Equally spaced readings with very little noise; without noise, the maximum-likelihood fit would
/// judge rounding.
fn sweep(circuit: &Circuit, window: Window) -> Vec<Reading> {
    let mut random = Pcg64::new(11, 13);
    // The sum of twelve uniform numbers is normal enough here.
    let mut error = || {
        let sum: f64 = (0..12).map(|_| random.next_u64() as f64 / 2_f64.powi(64)).sum();
        1e-7 * (sum - 6.0)
    };
    let frequencies = (0..).map(|i| window.min_hz + STEP_HZ * f64::from(i));
    let reading = |frequency_hz: f64| {
        let impedance =
            circuit.impedance_ohm(frequency_hz) * Complex64::new(1.0 + error(), error());
        Reading {
            frequency_hz,
            measured: PointResult::Value(Impedance {
                resistance_ohm: impedance.re,
                reactance_ohm: impedance.im,
            }),
            started: RigTime::ZERO,
            settle_s: 60.0,
            integration_s: 10.0 / frequency_hz,
        }
    };
    frequencies.take_while(|hz| *hz < window.max_hz + 1e-6).map(reading).collect()
}

#[track_caller]
fn check_error(estimator: Estimator, circuit: &Circuit, allowed_hz: f64) {
    let window = Window { min_hz: 100.0, max_hz: 220.0 };
    let meant_hz = estimator.definition().frequency_hz(circuit).unwrap();
    let found = estimator.estimate(&sweep(circuit, window), window);
    let error_hz = found.unwrap_or_else(|fault| panic!("{estimator:?}: {fault}")) - meant_hz;
    assert!(error_hz.abs() < allowed_hz, "{estimator:?} in {circuit:?} errs by {error_hz} Hz");
}

#[test]
fn each_finds_what_it_means_in_clean_readings() {
    for circuit in [circuit(100.0, 0.1), circuit(30.0, 0.1), circuit(100.0, 0.05)] {
        for estimator in Estimator::ALL {
            let allowed_hz = match estimator {
                Estimator::MagnitudeMinimum
                | Estimator::MagnitudeMaximum
                | Estimator::ConductancePeak => 0.5 * STEP_HZ + 1e-9,
                Estimator::MagnitudeParabola
                | Estimator::PhaseMaximum
                | Estimator::ConductanceParabola => 0.12 * STEP_HZ,
                Estimator::PhaseZero => 0.05 * STEP_HZ,
                // A parabola only approximates the curve.
                Estimator::RobinsonClegg => 0.3 * circuit.linewidth_hz() / circuit.q,
                Estimator::ConductanceLorentzian
                | Estimator::CircleFit
                | Estimator::Rational
                | Estimator::MaximumLikelihood => 1e-5,
            };
            check_error(estimator, &circuit, allowed_hz);
        }
    }
}

#[test]
fn a_model_finds_the_series_resonance_where_the_phase_is_never_zero() {
    for circuit in [circuit(10.0, 0.02), circuit(30.0, 0.02), circuit(10.0, 0.1)] {
        for estimator in [
            Estimator::ConductanceLorentzian,
            Estimator::CircleFit,
            Estimator::Rational,
            Estimator::MaximumLikelihood,
        ] {
            check_error(estimator, &circuit, 1e-5);
        }
        let readings = sweep(&circuit, WINDOW);
        assert_eq!(Estimator::PhaseZero.estimate(&readings, WINDOW), Err(NoEstimate::NoCrossing));
        assert_eq!(Definition::PhaseZero.frequency_hz(&circuit), None);
    }
}

#[test]
fn loss_moves_what_does_not_know_of_it() {
    let circuit = Circuit { loss_tangent: 0.02, ..circuit(10.0, 0.02) };
    let readings = sweep(&circuit, WINDOW);
    let error_hz = |estimator: Estimator| {
        estimator.estimate(&readings, WINDOW).unwrap() - circuit.resonance_hz
    };
    assert!(error_hz(Estimator::ConductanceLorentzian).abs() < 1e-5);
    assert!(error_hz(Estimator::MaximumLikelihood).abs() < 1e-5);
    let circle = error_hz(Estimator::CircleFit).abs();
    assert!((0.01..1.0).contains(&circle), "{circle}");
}

#[test]
fn an_extreme_at_the_edge_is_none() {
    let circuit = circuit(30.0, 0.1);
    let check = |min_hz, max_hz, edge_hz: f64, estimator: Estimator| {
        let window = Window { min_hz, max_hz };
        match estimator.estimate(&sweep(&circuit, window), window) {
            Err(NoEstimate::AtEdge { frequency_hz }) => {
                assert!((frequency_hz - edge_hz).abs() < STEP_HZ, "{estimator:?} {frequency_hz}");
            }
            other => panic!("{estimator:?}: {other:?}"),
        }
    };
    for estimator in [Estimator::ConductancePeak, Estimator::ConductanceParabola] {
        check(142.0, 168.0, 142.0, estimator);
        check(112.0, 138.0, 138.0, estimator);
    }
    for estimator in [Estimator::MagnitudeMinimum, Estimator::MagnitudeParabola] {
        // Above the antiresonance the impedance of the capacitor decreases steadily.
        check(150.0, 220.0, 220.0, estimator);
        check(112.0, 138.0, 138.0, estimator);
    }
    check(112.0, 145.0, 145.0, Estimator::MagnitudeMaximum);
    check(112.0, 141.0, 141.0, Estimator::PhaseMaximum);
}

#[test]
fn a_model_says_on_which_side_the_resonance_lies() {
    let circuit = circuit(30.0, 0.1);
    for (min_hz, max_hz, expected) in [(142.0, 168.0, Side::Below), (112.0, 138.0, Side::Above)] {
        let window = Window { min_hz, max_hz };
        let readings = sweep(&circuit, window);
        for estimator in
            [Estimator::ConductanceLorentzian, Estimator::CircleFit, Estimator::Rational]
        {
            match estimator.estimate(&readings, window) {
                Err(NoEstimate::OutsideWindow { side, estimate_hz, .. }) => {
                    assert_eq!(side, expected, "{estimator:?}");
                    assert!((estimate_hz - 140.1).abs() < 1e-4, "{estimator:?} {estimate_hz}");
                }
                other => panic!("{estimator:?}: {other:?}"),
            }
        }
        let refused = Estimator::MaximumLikelihood.estimate(&readings, window).unwrap_err();
        assert!(
            matches!(
                refused,
                NoEstimate::Refused(Reason::OutsideWindow { side, .. }) if side == expected
            ),
            "{refused}"
        );
    }
}

#[test]
fn too_few_or_unusable_readings_are_refused() {
    let circuit = circuit(30.0, 0.1);
    let readings = sweep(&circuit, WINDOW);
    for estimator in Estimator::ALL {
        let few = estimator.estimate(&readings[..1], WINDOW).unwrap_err();
        assert!(
            matches!(
                few,
                NoEstimate::TooFewPoints { found: 1, .. }
                    | NoEstimate::Refused(Reason::TooFewPoints { found: 1, .. })
            ),
            "{estimator:?}: {few}"
        );
        let mut bad = readings.clone();
        let not_finite = Impedance { resistance_ohm: f64::NAN, reactance_ohm: -1000.0 };
        bad[7].measured = PointResult::Value(not_finite);
        assert_eq!(
            estimator.estimate(&bad, WINDOW),
            Err(NoEstimate::NotFinite { index: 7 }),
            "{estimator:?}"
        );
        bad[7].measured = PointResult::Overload;
        let (with, without) =
            (estimator.estimate(&readings, WINDOW), estimator.estimate(&bad, WINDOW));
        let (with, without) = (with.unwrap_or(0.0), without.unwrap_or(0.0));
        assert!((with - without).abs() < 1e-6, "{estimator:?} {with} {without}");
    }
    // The half-power points of a narrow peak lie between two readings.
    let narrow = Circuit { q: 800.0, ..circuit };
    let coarse: Vec<_> = sweep(&narrow, WINDOW).into_iter().step_by(4).collect();
    let found = Estimator::RobinsonClegg.estimate(&coarse, WINDOW);
    assert!(matches!(found, Err(NoEstimate::NoPeak { found: 1..=3 })), "{found:?}");
}

#[test]
fn order_and_repetition_of_the_readings_have_no_influence() {
    let circuit = circuit(30.0, 0.1);
    let readings = sweep(&circuit, WINDOW);
    let mut twice: Vec<_> = readings.iter().rev().chain(&readings).copied().collect();
    twice.rotate_left(37);
    // The maximum-likelihood fit is excluded: it detects that both halves have identical noise.
    let is_fit = |estimator: &Estimator| *estimator == Estimator::MaximumLikelihood;
    for estimator in Estimator::ALL.into_iter().filter(|estimator| !is_fit(estimator)) {
        let (once, again) =
            (estimator.estimate(&readings, WINDOW), estimator.estimate(&twice, WINDOW));
        let error_hz = once.unwrap_or(0.0) - again.unwrap_or(0.0);
        assert!(error_hz.abs() < 1e-6, "{estimator:?} {once:?} {again:?}");
    }
}

#[test]
fn names_are_different_and_stay() {
    let names: std::collections::BTreeSet<_> = Estimator::ALL.map(Estimator::name).into();
    assert_eq!(names.len(), Estimator::ALL.len());
    assert!(names.contains("robinson-clegg"));
}
