//! The planner in a closed loop with a circuit that answers at once.

#[expect(dead_code, reason = "each test file uses its part")]
mod support;

use std::time::Duration;

use rig_model::{Reading, RigTime, SweepMethod, SweepPoint, SweepRequest};
use rig_resonance::{Circuit, Next, Planner, Prior, Resonance, Verdict};
use support::{Random, circuit, reading, request};

/// Readings of a circuit that has always settled.
fn measure(
    circuit: &Circuit,
    points: &[SweepPoint],
    now: &mut RigTime,
    random: &mut Random,
) -> Vec<Reading> {
    let mut readings = Vec::new();
    for point in points {
        let noise = 0.005 * (10.0 / f64::from(point.cycles)).sqrt();
        let impedance = circuit.impedance_ohm(point.frequency_hz) * (1.0 + noise * random.normal());
        let mut reading = reading(point.frequency_hz, impedance);
        reading.started = *now;
        reading.settle_s = point.settle_s;
        reading.integration_s = f64::from(point.cycles) / point.frequency_hz;
        *now = *now + Duration::from_secs_f64(point.duration_s());
        readings.push(reading);
    }
    readings
}

#[track_caller]
fn run(
    circuit: &Circuit,
    request: &SweepRequest,
    prior: Option<&Prior>,
    seed: u64,
) -> (Verdict, f64) {
    let mut random = Random::new(seed);
    let mut planner = Planner::new(request, prior);
    let mut now = RigTime::from_micros(3_000_000);
    let start = now;
    for _ in 0..1000 {
        match planner.next() {
            Next::Measure(points) => {
                assert!(!points.is_empty());
                assert!(points.iter().all(|p| request.window.contains(p.frequency_hz)));
                let readings = measure(circuit, &points, &mut now, &mut random);
                planner.add(&readings);
            }
            Next::Finished(verdict) => return (verdict, now.since(start).as_secs_f64()),
        }
    }
    panic!("no end after 1000 rounds");
}

fn accepted(verdict: &Verdict) -> &Resonance {
    verdict.accepted().unwrap_or_else(|| panic!("{verdict:?}"))
}

#[test]
fn the_adaptive_planner_reaches_the_sigma_asked_for_in_a_part_of_the_time_of_a_sweep() {
    for (q, k_eff_squared) in [(10.0, 0.1), (30.0, 0.02), (30.0, 0.1), (100.0, 0.02)] {
        for resonance_hz in [121.0, 140.3, 163.7] {
            for seed in 0..8 {
                let circuit = Circuit { resonance_hz, ..circuit(q, k_eff_squared) };
                let request = request(SweepMethod::Adaptive);
                let (verdict, seconds) = run(&circuit, &request, None, seed);
                let found = accepted(&verdict);
                assert!(found.sigma_hz <= request.target_sigma_hz, "Q {q} {found:?}");
                let error = found.resonance_hz - resonance_hz;
                assert!(error.abs() < 4.5 * found.sigma_hz, "Q {q} {resonance_hz} {seed}: {error}");
                assert!(seconds < 30.0, "Q {q} {resonance_hz} {seed}: {seconds} s");
            }
        }
    }
}

#[test]
fn the_uniform_sweep_asks_once_for_the_whole_window() {
    let request = request(SweepMethod::Uniform { points: 41 });
    let circuit = circuit(30.0, 0.1);
    let (verdict, seconds) = run(&circuit, &request, None, 1);
    let found = accepted(&verdict);
    assert_eq!(found.points, 41);
    assert!((found.resonance_hz - 140.0).abs() < 4.5 * found.sigma_hz);
    assert!((41.0 * 0.5..41.0 * 0.6).contains(&seconds));
}

#[test]
fn a_planner_without_readings_ends_with_a_refusal() {
    for method in [SweepMethod::Adaptive, SweepMethod::Uniform { points: 20 }] {
        let mut planner = Planner::new(&request(method), None);
        let end = (0..100).find_map(|_| match planner.next() {
            Next::Finished(verdict) => Some(verdict),
            Next::Measure(_) => None,
        });
        assert!(matches!(end, Some(Verdict::Refused(_))), "{end:?}");
    }
}

#[test]
fn time_is_never_far_overrun() {
    let mut request = request(SweepMethod::Adaptive);
    (request.target_sigma_hz, request.time_limit_s) = (1e-4, 3.0);
    let (_, seconds) = run(&circuit(30.0, 0.1), &request, None, 1);
    assert!(seconds < 3.0 + 2.0, "{seconds}");
}
