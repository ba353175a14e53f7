//! The moment for which a resonance holds that moves while it is measured.

#[expect(dead_code, reason = "each test file uses its part")]
mod support;

use std::time::Duration;

use rig_model::{Reading, RigTime, SweepMethod, SweepRequest};
use rig_resonance::{Circuit, FitOptions, Next, NoisePrior, Planner, Prior, Resonance, fit};
use support::{Plant, Random, circuit, reading, request};

const NOISE: f64 = 0.005;

/// A sweep of settled points, one a second, of a resonance that moves by `drift_hz` meanwhile; and the
/// resonance at a moment.
fn moving(
    frequencies_hz: &[f64],
    drift_hz: f64,
    seed: u64,
) -> (Vec<Reading>, impl Fn(f64) -> f64 + use<>) {
    let mut random = Random::new(seed);
    let points = frequencies_hz.len() as f64;
    let at = move |effective_time_s: f64| 154.0 + drift_hz * (effective_time_s / points - 0.5);
    let readings = (0_u32..).zip(frequencies_hz).map(|(index, &frequency_hz)| {
        let started = RigTime::ZERO + Duration::from_secs(index.into());
        let (integration_s, now_s) = (10.0 / frequency_hz, f64::from(index) + 1.0);
        let resonance_hz = at(now_s - 0.5 * integration_s);
        let moved = Circuit { resonance_hz, ..circuit(30.0, 0.1) };
        let impedance = 1.0 / moved.admittance_siemens(frequency_hz);
        let noisy = impedance * (1.0 + NOISE * random.normal());
        Reading { started, settle_s: 1.0 - integration_s, ..reading(frequency_hz, noisy) }
    });
    (readings.collect(), at)
}

fn evenly() -> Vec<f64> {
    (0..101).map(|point| 112.0 + 0.56 * f64::from(point)).collect()
}

#[track_caller]
fn found(readings: &[Reading]) -> (Resonance, f64) {
    let options = FitOptions::default();
    let verdict = fit(readings, &options);
    let found = *verdict.accepted().unwrap_or_else(|| panic!("{verdict:?}"));
    (found, found.effective_time_s(readings, &options).expect("the readings have times"))
}

/// What a steady sweep knows of the resonance it knows from passing it.
#[test]
fn a_sweep_one_way_holds_for_the_moment_of_passing_the_resonance() {
    let rising = evenly();
    let falling: Vec<_> = rising.iter().rev().copied().collect();
    for (frequencies_hz, passing_s) in [(&rising, 75.0), (&falling, 25.0)] {
        for drift_hz in [-2.0, -0.5, 0.5, 2.0] {
            for seed in 0..6 {
                let (readings, at) = moving(frequencies_hz, drift_hz, seed);
                let (found, effective_time_s) = found(&readings);
                let off =
                    |effective_time_s| (found.resonance_hz - at(effective_time_s)) / found.sigma_hz;
                assert!(
                    (effective_time_s - passing_s).abs() < 4.0,
                    "{drift_hz}: {effective_time_s}"
                );
                assert!(off(effective_time_s).abs() < 4.5, "{drift_hz}: {found:?}");
                assert!(off(50.0).abs() > 4.0, "{drift_hz}: {} {found:?}", off(50.0));
            }
        }
    }
}

/// Whether the drift is modelled or too small to be seen.
#[test]
fn a_sweep_up_and_down_holds_for_its_middle() {
    let mut frequencies_hz = evenly();
    frequencies_hz.extend(evenly().iter().rev());
    for drift_hz in [-1.0, 0.0, 0.002, 1.0] {
        let (readings, at) = moving(&frequencies_hz, drift_hz, 7);
        let (found, effective_time_s) = found(&readings);
        assert!((effective_time_s - 101.0).abs() < 2.0, "{drift_hz}: {effective_time_s}");
        let off_hz = found.resonance_hz - at(effective_time_s);
        assert!(off_hz.abs() < 4.5 * found.sigma_hz, "{drift_hz}: {off_hz} {found:?}");
    }
}

#[test]
fn readings_without_times_name_no_moment() {
    let (mut readings, _) = moving(&evenly(), 0.0, 1);
    let options = FitOptions::default();
    let found = *fit(&readings, &options).accepted().unwrap();
    for reading in &mut readings {
        reading.started = RigTime::ZERO;
    }
    assert_eq!(found.effective_time_s(&readings, &options), None);
}

/// 0.1 Hz/s is a thousand times what the simulated laboratory does. The motion follows it with a delay of its own.
#[test]
fn a_planned_sweep_of_a_moving_resonance_holds_for_its_moment() {
    let request = SweepRequest { target_sigma_hz: 0.02, ..request(SweepMethod::Adaptive) };
    let noise = Some(NoisePrior { at_ten_cycles: NOISE, degrees_of_freedom: 1000.0 });
    let prior = Prior { noise, ..Prior::anywhere(request.window, None) };
    let (mut answers, mut without_window, mut most_off) = (0, 0, 0.0_f64);
    for seed in 0..10 {
        let mut random = Random::new(seed);
        let mut plant = Plant::at_rest(circuit(100.0, 0.1));
        plant.drift_hz_per_s = 0.1;
        let mut planner = Planner::new(&request, Some(&prior));
        let mut now = RigTime::ZERO;
        let verdict = loop {
            match planner.next() {
                Next::Measure(points) => {
                    for point in points {
                        let (reading, after) = plant.visit(&point, now, NOISE, &mut random);
                        planner.add(&[reading]);
                        now = after;
                    }
                }
                Next::Finished(verdict) => break verdict,
            }
        };
        let Some(found) = verdict.accepted() else { continue };
        answers += 1;
        let effective_time_s = planner.effective_time_s(&verdict).unwrap();
        let off = |effective_time_s: f64| {
            (found.resonance_hz - 140.0 - 0.1 * effective_time_s) / found.sigma_hz
        };
        assert!(off(effective_time_s).abs() < 4.5, "seed {seed}: {effective_time_s} s: {found:?}");
        most_off = most_off.max(off(0.0).abs());
        // Readings without a window have a time too.
        let anywhere = FitOptions { window: None, ..planner.fit_options() };
        if let Some(found) = fit(planner.readings(), &anywhere).accepted() {
            let effective_time_s = found.effective_time_s(planner.readings(), &anywhere).unwrap();
            assert!(off(effective_time_s).abs() < 4.5, "seed {seed}: {effective_time_s} s");
            without_window += 1;
        }
    }
    assert!(answers >= 8 && most_off > 1.5, "{answers} {most_off}");
    assert!(without_window > 0, "none is accepted without a window");
}
