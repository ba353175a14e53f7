//! Planned sweeps of an analyzer that sometimes gives wrong readings, or whose noise nobody knows.

#[expect(dead_code, reason = "each test file uses its part")]
mod support;

use rig_model::{Reading, RigTime, SweepMethod, SweepRequest};
use rig_resonance::{Circuit, FitOutcome, Next, NoisePrior, Planner, Prior};
use support::{Plant, Random, WAYS, circuit, impedance, measured, request, wrong};

const NOISE: f64 = 0.005;

/// A sensor, and the noise of its analyzer.
struct Scene {
    q: f64,
    k_eff_squared: f64,
    noise: f64,
    /// Whether the planner knows the noise.
    is_known: bool,
    /// Share of the readings that are wrong.
    wrong: f64,
    target_sigma_hz: f64,
}

/// A sweep; the verdict and the truth in Hz.
fn sweep(scene: &Scene, seed: u64) -> (FitOutcome, f64) {
    let &Scene { q, k_eff_squared, noise, is_known, wrong: share, target_sigma_hz } = scene;
    let mut random = Random::new(seed);
    let resonance_hz = random.between(130.0, 150.0);
    let request = SweepRequest { target_sigma_hz, ..request(SweepMethod::Adaptive) };
    let known = NoisePrior { at_ten_cycles: noise, degrees_of_freedom: 1000.0 };
    let known = is_known.then_some(known);
    let prior = Prior { noise: known, ..Prior::anywhere(request.window, None) };
    let mut planner = Planner::new(&request, Some(&prior));
    let mut plant = Plant::at_rest(Circuit { resonance_hz, ..circuit(q, k_eff_squared) });
    let (mut now, mut last_hz) = (RigTime::from_micros(1_000_000), 0.0);
    let mut before: Option<Reading> = None;
    for _ in 0..1000 {
        let points = match planner.next() {
            Next::Measure(points) => points,
            Next::Finished(verdict) => return (verdict, resonance_hz),
        };
        let mut readings = Vec::new();
        for point in points {
            if point.frequency_hz.total_cmp(&last_hz).is_ne() {
                plant.jump(random.between(0.0, 1.0));
                last_hz = point.frequency_hz;
            }
            let (mut reading, after) = plant.visit(&point, now, noise, &mut random);
            now = after;
            if random.between(0.0, 1.0) < share {
                let right = impedance(&reading);
                let before = before.as_ref().map_or(right, impedance);
                let way = random.below(WAYS);
                reading.measured = measured(wrong(way, right, before, noise, &mut random));
            }
            before = Some(reading);
            readings.push(reading);
        }
        planner.add(&readings);
    }
    panic!("no end after 1000 rounds");
}

/// Checks how many of a hundred sweeps are accepted, and that these are right.
#[track_caller]
fn check(share: f64, accepted_min: usize) {
    let mut accepted = 0;
    let sensors = [(30.0, 0.1), (30.0, 0.02), (100.0, 0.02), (100.0, 0.1)];
    for (seed, (q, k_eff_squared)) in (0..100).zip(sensors.into_iter().cycle()) {
        let (noise, target_sigma_hz) = (NOISE, request(SweepMethod::Adaptive).target_sigma_hz);
        let scene =
            Scene { q, k_eff_squared, noise, is_known: true, wrong: share, target_sigma_hz };
        let (verdict, resonance_hz) = sweep(&scene, seed);
        let Some(found) = verdict.accepted() else { continue };
        let sigmas = (found.resonance_hz - resonance_hz).abs() / found.sigma_hz;
        assert!(sigmas < 5.0, "seed {seed}: {sigmas} standard deviations");
        accepted += 1;
    }
    assert!(accepted >= accepted_min, "accepted {accepted} of 100");
}

#[test]
fn wrong_readings_are_left_out_of_a_planned_sweep() {
    check(0.01, 97);
    check(0.03, 93);
}

/// An analyzer with four times the noise that is assumed of one: good readings are not taken for wrong ones, which
/// once led one first sweep in seven to a second mode.
#[test]
fn no_good_reading_is_left_out_where_the_noise_is_guessed() {
    let scene = Scene {
        q: 30.0,
        k_eff_squared: 0.02,
        noise: 4.0 * NOISE,
        is_known: false,
        wrong: 0.0,
        target_sigma_hz: 0.04,
    };
    let (mut accepted, mut within) = (0, 0);
    for seed in 0..100 {
        let (verdict, resonance_hz) = sweep(&scene, seed);
        let Some(found) = verdict.accepted() else { continue };
        accepted += 1;
        within += usize::from((found.resonance_hz - resonance_hz).abs() < 1.96 * found.sigma_hz);
    }
    assert!(accepted >= 93, "accepted {accepted} of 100");
    assert!(
        within * 100 >= accepted * 91,
        "{within} of {accepted} within 1.96 standard deviations"
    );
}
