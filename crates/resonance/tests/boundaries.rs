//! Both sides of every boundary between a reported resonance and a refused one.

#[expect(dead_code, reason = "each test file uses its part")]
#[path = "support/scenes.rs"]
mod scenes;
#[expect(dead_code, reason = "each test file uses its part")]
mod support;

use rig_resonance::{FitOptions, FitOutcome, ModelOrder, Reason, Resonance, Side, Timing, fit};
use scenes::{Kind, Rounding, Scene};
use support::Random;

const SENSOR: Scene = Scene {
    resonance_hz: 140.0,
    q: 30.0,
    capacitance_ratio: 0.05,
    loss_tangent: 0.01,
    noise: 0.002,
    points: 101,
    window: (112.0, 168.0),
    falls: false,
    is_timed: false,
};

/// What a sweep must come to.
enum CircuitPrior {
    /// The truth within four standard deviations, and something about it.
    Told(fn(&Resonance) -> bool),
    Refused(fn(&Reason) -> bool),
}
use CircuitPrior::{Refused, Told};

/// Fits sweeps up and down, with and without times, with several noises each.
#[track_caller]
fn check(rows: &[(Scene, Kind, CircuitPrior)]) {
    for (row, (sensor, kind, expected)) in rows.iter().enumerate() {
        for seed in 0..12 {
            let mut random = Random::new(seed);
            let is_timed = sensor.is_timed || seed % 4 < 2;
            let sensor = Scene { falls: seed % 2 == 0, is_timed, ..*sensor };
            let (readings, truth) = sensor.sweep(*kind, &mut random);
            let verdict = fit(&readings, &sensor.options());
            let is_expected = match (expected, &verdict) {
                (Told(is_right), FitOutcome::Accepted(found)) => {
                    let (low, high) = truth.expect("there is a resonance");
                    let off_hz = found.resonance_hz - found.resonance_hz.clamp(low, high);
                    off_hz.abs() < 4.0 * found.sigma_hz && is_right(found)
                }
                (Refused(is_right), FitOutcome::Refused(refusal)) => is_right(&refusal.reason),
                _ => false,
            };
            assert!(is_expected, "row {row}, seed {seed}, {kind:?}: {verdict:?}");
        }
    }
}

const PLAIN: CircuitPrior = Told(|found| found.model_order <= ModelOrder::Loss);

#[test]
fn the_edge_of_the_window() {
    check(&[
        (SENSOR, Kind::Place(0.99), PLAIN),
        (SENSOR, Kind::Place(-0.99), PLAIN),
        (
            SENSOR,
            Kind::Place(1.01),
            Refused(|reason| matches!(reason, Reason::OutsideWindow { side: Side::Above, .. })),
        ),
        (
            SENSOR,
            Kind::Place(-1.01),
            Refused(|reason| matches!(reason, Reason::OutsideWindow { side: Side::Below, .. })),
        ),
    ]);
}

#[test]
fn the_strength_of_the_resonance() {
    let with = |capacitance_ratio| Scene { capacitance_ratio, ..SENSOR };
    check(&[
        (with(0.004), Kind::Nominal, PLAIN),
        (
            with(0.0001),
            Kind::Nominal,
            Refused(|reason| matches!(reason, Reason::NoResonance { .. })),
        ),
        (SENSOR, Kind::NoResonance, Refused(|reason| matches!(reason, Reason::NoResonance { .. }))),
    ]);
}

#[test]
fn the_noise() {
    let with = |noise| Scene { noise, capacitance_ratio: 0.02, q: 10.0, ..SENSOR };
    check(&[
        (with(0.02), Kind::Nominal, PLAIN),
        (
            with(0.3),
            Kind::Nominal,
            Refused(|reason| {
                matches!(reason, Reason::NoResonance { .. } | Reason::TooNoisy { .. })
            }),
        ),
    ]);
}

/// Chance makes some noisy sweep look a little like everything. That goes into its uncertainty, and
/// refuses hardly any.
#[test]
fn noise_that_leaves_the_resonance_in_sight_is_no_reason_to_refuse() {
    const SWEEPS: u64 = 500;
    let strong = Scene { capacitance_ratio: 0.0204, q: 10.0, ..SENSOR };
    let weak = Scene { capacitance_ratio: 0.005, q: 50.0, ..SENSOR };
    // Far from the middle of the window nothing but the resonance tells where to start.
    for sensor in [strong, weak, Scene { resonance_hz: 131.0, loss_tangent: 0.02, ..weak }] {
        let noisy = Scene { noise: 0.05, is_timed: true, ..sensor };
        let (mut answers, mut covered) = (0, 0);
        for seed in 0..SWEEPS {
            let (readings, _) = noisy.sweep(Kind::Nominal, &mut Random::new(seed));
            if let FitOutcome::Accepted(found) = fit(&readings, &noisy.options()) {
                let off_hz = (found.resonance_hz - noisy.resonance_hz).abs();
                answers += 1;
                covered += u64::from(off_hz < 1.96 * found.sigma_hz);
            }
        }
        assert!(answers + 5 >= SWEEPS, "{noisy:?}: {answers} of {SWEEPS}");
        // With this number of sweeps the share of 95 % has a standard deviation of 1 %.
        let share = 92 * answers..=98 * answers;
        assert!(share.contains(&(100 * covered)), "{noisy:?}: {covered} of {answers}");
    }
}

#[test]
fn the_number_of_points() {
    let with = |points| Scene { points, ..SENSOR };
    check(&[
        (with(7), Kind::Nominal, PLAIN),
        (
            with(6),
            Kind::Nominal,
            Refused(|reason| matches!(reason, Reason::TooFewPoints { found: 6, needed: 7 })),
        ),
    ]);
}

/// Scaled by 0.01 to 100, mirrored, stuck, alone and in bursts. The campaign, with more sweeps than
/// a test has time for, accepts 99 % and 96 %.
#[test]
fn few_wrong_readings_hardly_ever_cost_the_sweep_and_never_the_truth() {
    const SWEEPS: u64 = 300;
    for (shares, needed) in [((0.0, 0.05), 0.97), ((0.05, 0.1), 0.92)] {
        let mut accepted = 0;
        for seed in 0..SWEEPS {
            let mut random = Random::new(seed);
            let sensor = Scene::random(&mut random);
            let kind = Kind::Outliers(random.between(shares.0, shares.1));
            let (readings, _) = sensor.sweep(kind, &mut random);
            if let FitOutcome::Accepted(found) = fit(&readings, &sensor.options()) {
                let sigmas = (found.resonance_hz - sensor.resonance_hz) / found.sigma_hz;
                assert!(sigmas.abs() < 5.0, "seed {seed}: {sigmas} of {found:?}");
                accepted += 1;
            }
        }
        let share = f64::from(accepted) / SWEEPS as f64;
        assert!(share >= needed, "{shares:?}: {share}");
    }
}

#[test]
fn wrong_readings_of_a_capacitor_are_no_resonance() {
    for seed in 0..2000 {
        let mut random = Random::new(seed);
        let capacitor = Scene { capacitance_ratio: 1e-9, ..Scene::random(&mut random) };
        let kind = Kind::Outliers(random.between(0.02, 0.2));
        let (readings, _) = capacitor.sweep(kind, &mut random);
        let verdict = fit(&readings, &capacitor.options());
        assert!(matches!(verdict, FitOutcome::Refused(_)), "seed {seed}: {verdict:?}");
    }
}

#[test]
fn the_share_of_wrong_readings() {
    let is_outliers = |reason: &Reason| matches!(reason, Reason::Outliers { .. });
    check(&[(SENSOR, Kind::Nominal, PLAIN), (SENSOR, Kind::Outliers(0.25), Refused(is_outliers))]);
}

/// The transients beside a narrow resonance look like outliers; left out, they would leave a wrong rest.
#[test]
fn transients_are_not_left_out_as_outliers() {
    let mut refused = 0;
    for seed in 0..400 {
        let mut random = Random::new(seed);
        let scene = Scene { is_timed: false, ..Scene::random(&mut random) };
        let kind = Kind::Unsettled(random.between(0.0, 4.0));
        let (readings, _) = scene.sweep(kind, &mut random);
        match fit(&readings, &scene.options()) {
            FitOutcome::Accepted(found) => {
                let sigmas = (found.resonance_hz - scene.resonance_hz) / found.sigma_hz;
                assert!(sigmas.abs() < 5.0, "seed {seed}: {sigmas} of {found:?}");
            }
            FitOutcome::Refused(refusal) => {
                refused += u64::from(refusal.reason == Reason::NotSettled);
            }
        }
    }
    assert!(refused > 100, "{refused}");
}

/// A second mode beside the first looks like transients.
#[test]
fn a_second_mode_is_not_refused_as_not_settled() {
    let mut accepted = 0;
    for seed in 0..300 {
        let mut random = Random::new(seed);
        let scene = Scene::random(&mut random);
        let kind = Kind::SecondMode(random.log_between(0.02, 0.3), random.between(2.0, 6.0));
        let (readings, _) = scene.sweep(kind, &mut random);
        match fit(&readings, &scene.options()) {
            FitOutcome::Accepted(_) => accepted += 1,
            FitOutcome::Refused(refusal) => {
                assert!(refusal.reason != Reason::NotSettled, "seed {seed}: {refusal:?}");
            }
        }
    }
    assert!(accepted > 250, "{accepted}");
}

#[test]
fn the_strength_of_a_second_mode() {
    let is_second = |reason: &Reason| matches!(reason, Reason::SecondMode { .. });
    check(&[
        (SENSOR, Kind::SecondMode(0.0005, 3.0), PLAIN),
        (
            SENSOR,
            Kind::SecondMode(0.2, 3.0),
            Told(|found| found.model_order == ModelOrder::SecondMode),
        ),
        (SENSOR, Kind::SecondMode(0.95, 3.0), Refused(is_second)),
    ]);
}

#[test]
fn the_rate_of_drift() {
    check(&[
        (SENSOR, Kind::DriftBothWays(0.001), PLAIN),
        (
            Scene { noise: 0.0003, resonance_hz: 132.0, ..SENSOR },
            Kind::DriftBothWays(0.2),
            Told(|found| found.model_order == ModelOrder::Drift),
        ),
    ]);
}

/// A dielectric of constant phase, a capacitance that drifts, and a phase error of the analyzer are
/// modelled or refused; never accepted with a wrong resonance.
#[test]
fn what_changes_all_readings_a_little() {
    let (mut wrong, mut named) = (Vec::new(), 0);
    for seed in 0..300 {
        let mut random = Random::new(seed);
        let strength = random.sign() * random.log_between(0.003, 0.05);
        let kind = match seed % 3 {
            0 => Kind::ConstantPhase(strength.abs()),
            1 => Kind::CapacitanceDrift(strength),
            _ => Kind::Phase(0.5 * strength),
        };
        let scene = Scene::random(&mut random);
        let (readings, truth) = scene.sweep(kind, &mut random);
        let (low, _) = truth.expect("there is a resonance");
        named += match fit(&readings, &scene.options()) {
            FitOutcome::Accepted(found) => {
                let sigmas = (found.resonance_hz - low) / found.sigma_hz;
                wrong.extend((sigmas.abs() > 5.0).then_some((seed, kind, sigmas)));
                let orders = [ModelOrder::Dispersion, ModelOrder::AnalyzerPhase];
                usize::from(orders.contains(&found.model_order))
            }
            FitOutcome::Refused(refusal) => {
                let reasons = [Reason::Dispersion, Reason::AnalyzerPhase];
                usize::from(reasons.contains(&refusal.reason))
            }
        };
    }
    assert!(wrong.is_empty(), "{wrong:?}");
    assert!(named > 60, "{named}");
}

#[test]
fn the_wait_at_each_point() {
    let timed = Scene { is_timed: true, ..SENSOR };
    check(&[
        (timed, Kind::Unsettled(9.0), PLAIN),
        (SENSOR, Kind::Unsettled(0.5), Refused(|reason| *reason == Reason::NotSettled)),
    ]);
}

/// A weak sensor without a wait looks settled, and is several standard deviations off by the
/// noise alone. What the readings do not exclude must be in the uncertainty, and not much more.
#[test]
fn an_unknown_dwell_is_in_the_uncertainty() {
    let weak = Scene { q: 10.0, capacitance_ratio: 0.0204, noise: 0.005, ..SENSOR };
    let unknown = FitOptions { timing: Timing::Unknown, ..FitOptions::default() };
    let waited = FitOptions { timing: Timing::Waited, ..FitOptions::default() };
    let (mut answers, mut widest, mut widened) = (0, 0.0_f64, 0.0_f64);
    for seed in 0..40 {
        let (readings, _) = weak.sweep(Kind::Unsettled(0.0), &mut Random::new(seed));
        if let FitOutcome::Accepted(found) = fit(&readings, &unknown) {
            let sigmas = (found.resonance_hz - weak.resonance_hz) / found.sigma_hz;
            assert!(sigmas.abs() < 4.5, "seed {seed}: {sigmas} of {found:?}");
            (answers, widest) = (answers + 1, widest.max(found.sigma_hz));
        }
        let timed = Scene { is_timed: true, ..weak };
        let (readings, _) = timed.sweep(Kind::Nominal, &mut Random::new(seed));
        let sigma_hz = |options| fit(&readings, options).accepted().expect("it is good").sigma_hz;
        widened += sigma_hz(&unknown) / sigma_hz(&waited) / 40.0;
    }
    assert!(answers > 30 && widest > 0.15, "{answers}, {widest} Hz");
    assert!((1.1..1.6).contains(&widened), "{widened}");
}

#[test]
fn the_level_of_the_drive() {
    check(&[
        (SENSOR, Kind::Softening(-0.0003), PLAIN),
        (SENSOR, Kind::Softening(-0.2), Refused(|reason| *reason == Reason::Nonlinear)),
        (SENSOR, Kind::Softening(-3.0), Refused(|_| true)),
    ]);
}

/// A folded peak deviates over its whole width, and no reading of it is wrong.
#[test]
fn a_folded_peak_is_not_refused_because_of_outliers() {
    let is_other = |reason: &Reason| !matches!(reason, Reason::Outliers { .. });
    let narrow = Scene { q: 100.0, capacitance_ratio: 0.11, noise: 0.005, ..SENSOR };
    check(&[
        (SENSOR, Kind::Softening(-6.0), Refused(is_other)),
        (narrow, Kind::Softening(-6.0), Refused(is_other)),
    ]);
}

#[test]
fn pick_up_from_the_mains() {
    check(&[
        (SENSOR, Kind::Mains(0.0003, 50.0), Told(|found| found.mains_hz.is_none())),
        (SENSOR, Kind::Mains(0.05, 50.0), Told(|found| found.mains_hz == Some(150.0))),
        (SENSOR, Kind::Mains(0.05, 60.0), Told(|found| found.mains_hz == Some(120.0))),
    ]);
}

#[test]
fn the_fineness_of_the_digits() {
    let exact = Scene { noise: 0.0, ..SENSOR };
    check(&[
        (exact, Kind::Rounded(Rounding::Full), Told(|found| found.sigma_hz < 1e-6)),
        (exact, Kind::Rounded(Rounding::Digits(4)), Told(|found| found.sigma_hz < 0.01)),
        (exact, Kind::Rounded(Rounding::Polar(3, 0.1)), Told(|found| found.sigma_hz < 0.05)),
        (exact, Kind::Rounded(Rounding::Digits(2)), Told(|found| found.sigma_hz > 0.005)),
        (exact, Kind::Rounded(Rounding::Ohm(1e6)), Refused(|_| true)),
    ]);
}
