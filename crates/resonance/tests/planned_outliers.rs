//! Planned sweeps of an analyzer that sometimes gives wrong readings.

#[expect(dead_code, reason = "each test file uses its part")]
mod support;

use rig_model::{Reading, RigTime, SweepMethod};
use rig_resonance::{Circuit, FitOutcome, Next, NoisePrior, Planner, Prior};
use support::{Plant, Random, WAYS, circuit, impedance, measured, request, wrong};

const NOISE: f64 = 0.005;

/// A sweep in which this share of the readings is wrong; the verdict and the truth in Hz.
fn sweep(q: f64, k_eff_squared: f64, share: f64, seed: u64) -> (FitOutcome, f64) {
    let mut random = Random::new(seed);
    let resonance_hz = random.between(130.0, 150.0);
    let request = request(SweepMethod::Adaptive);
    let noise = Some(NoisePrior { at_ten_cycles: NOISE, degrees_of_freedom: 1000.0 });
    let prior = Prior { circuit: None, within: request.window, noise, bench: None };
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
            let (mut reading, after) = plant.visit(&point, now, NOISE, &mut random);
            now = after;
            if random.between(0.0, 1.0) < share {
                let right = impedance(&reading);
                let before = before.as_ref().map_or(right, impedance);
                let way = random.below(WAYS);
                reading.measured = measured(wrong(way, right, before, NOISE, &mut random));
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
        let (verdict, resonance_hz) = sweep(q, k_eff_squared, share, seed);
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
