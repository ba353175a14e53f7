//! The planner in a closed loop with a circuit in time.

#[expect(dead_code, reason = "each test file uses its part")]
mod support;

use std::time::Duration;

use num_complex::Complex64;
use rig_model::{Impedance, PointResult, Reading, RigTime, SweepMethod, SweepRequest, Window};
use rig_resonance::{
    Circuit, FitOutcome, Limit, Next, NoisePrior, Planner, Prior, Reason, Resonance,
};
use support::{Plant, Random, circuit, circuit_scores, request};

const NOISE: f64 = 0.005;

/// Runs a sweep from rest; gives the verdict, the time it took and the number of readings.
#[track_caller]
fn run(
    circuit: &Circuit,
    request: &SweepRequest,
    prior: Option<&Prior>,
    seed: u64,
) -> (FitOutcome, f64, usize) {
    run_disturbed(circuit, request, prior, seed, |_, _, _| ())
}

/// The same with an unrecorded disturbance at every change of frequency.
#[track_caller]
fn run_disturbed(
    circuit: &Circuit,
    request: &SweepRequest,
    prior: Option<&Prior>,
    seed: u64,
    mut disturb: impl FnMut(&mut Plant, f64, &mut Random),
) -> (FitOutcome, f64, usize) {
    let mut random = Random::new(seed);
    let mut plant = Plant::at_rest(*circuit);
    let mut planner = Planner::new(request, prior);
    let start = RigTime::from_micros(3_000_000);
    let mut now = start;
    let mut before_hz = None;
    for _ in 0..1000 {
        match planner.next() {
            Next::Measure(points) => {
                assert!(!points.is_empty());
                for point in points {
                    assert!(request.window.contains(point.frequency_hz), "{point:?}");
                    assert!(point.settle_s >= 0.0, "{point:?}");
                    // Where the frequency stays, nothing is sent to an analyzer.
                    if let Some(before_hz) = before_hz.replace(point.frequency_hz)
                        && before_hz != point.frequency_hz
                    {
                        disturb(&mut plant, before_hz, &mut random);
                    }
                    let (reading, after) = plant.visit(&point, now, NOISE, &mut random);
                    planner.add(&[reading]);
                    now = after;
                }
            }
            Next::Finished(verdict) => {
                return (verdict, now.since(start).as_secs_f64(), planner.readings().len());
            }
        }
    }
    panic!("no end after 1000 rounds");
}

fn known_noise() -> Prior {
    let noise = NoisePrior { at_ten_cycles: NOISE, degrees_of_freedom: 1000.0 };
    let within = request(SweepMethod::Adaptive).window;
    Prior { noise: Some(noise), ..Prior::anywhere(within, None) }
}

/// Runs cold sweeps at several resonances; every one must be right, and nineteen of twenty must
/// take no longer than `seconds`.
#[track_caller]
fn check((q, k_eff_squared): (f64, f64), target_sigma_hz: f64, seconds: f64) {
    let request = SweepRequest { target_sigma_hz, ..request(SweepMethod::Adaptive) };
    let mut times = Vec::new();
    let trials = 20;
    // Noise looks like a second mode to the end in one sweep of five hundred.
    let mut refused = 0;
    for seed in 0..trials {
        let resonance_hz = 138.0 + 0.2 * seed as f64;
        let circuit = Circuit { resonance_hz, loss_tangent: 0.015, ..circuit(q, k_eff_squared) };
        let (verdict, seconds, _) = run(&circuit, &request, Some(&known_noise()), seed);
        let Some(found) = verdict.accepted() else {
            refused += 1;
            continue;
        };
        assert!(found.sigma_hz <= target_sigma_hz, "seed {seed}: {found:?}");
        let error = found.resonance_hz - resonance_hz;
        assert!(error.abs() < 4.5 * found.sigma_hz, "seed {seed}: {error} {}", found.sigma_hz);
        times.push(seconds);
    }
    assert!(refused <= 1, "{refused} refused");
    times.sort_by(f64::total_cmp);
    assert!(times[times.len() - 2] <= seconds, "{times:?}");
}

#[track_caller]
fn accepted(verdict: &FitOutcome) -> &Resonance {
    verdict.accepted().unwrap_or_else(|| panic!("{verdict:?}"))
}

#[test]
fn a_drive_of_any_phase_costs_the_flanks_and_a_little_time() {
    check((30.0, 0.1), 0.03, 1.2);
    check((10.0, 0.1), 0.03, 1.2);
    check((30.0, 0.1), 0.01, 1.5);
    check((100.0, 0.1), 0.01, 1.5);
}

#[test]
fn the_circuit_of_a_planned_sweep_is_about_as_uncertain_as_stated() {
    let request = SweepRequest { target_sigma_hz: 0.01, ..request(SweepMethod::Adaptive) };
    for (q, k_eff_squared) in [(30.0, 0.1), (100.0, 0.02)] {
        let truth = Circuit { loss_tangent: 0.015, ..circuit(q, k_eff_squared) };
        let (mut squares, mut accepted) = ([0.0; 3], 0);
        for seed in 0..60 {
            let (verdict, ..) = run(&truth, &request, Some(&known_noise()), seed);
            let Some(found) = verdict.accepted() else { continue };
            accepted += 1;
            for (sum, score) in squares.iter_mut().zip(circuit_scores(found, &truth)) {
                *sum += score * score;
            }
        }
        assert!(accepted > 55, "{accepted}");
        for sum in squares {
            let score = (sum / f64::from(accepted)).sqrt();
            assert!((0.6..1.5).contains(&score), "Q {q}, k² {k_eff_squared}: {score}");
        }
    }
}

/// Sweeps from nothing, and sweeps of the same sensor after it has moved a little, when the phase of
/// the drive is another after every change of frequency.
#[test]
fn a_circuit_that_is_nearly_known_is_not_searched_for_and_not_assumed() {
    let request = SweepRequest { target_sigma_hz: 0.03, ..request(SweepMethod::Adaptive) };
    let jump = |plant: &mut Plant, _: f64, random: &mut Random| {
        plant.jump(random.between(0.0, 1.0));
    };
    let (mut cold_s, mut warm_s, mut squares) = (0.0, 0.0, 0.0);
    let trials = 20;
    for seed in 0..trials {
        let free = circuit(30.0, 0.1);
        let cold = known_noise();
        let (verdict, seconds, _) = run_disturbed(&free, &request, Some(&cold), seed, jump);
        cold_s += seconds;
        let last = *accepted(&verdict);
        let (min_hz, max_hz) = (last.resonance_hz - 1.0, last.resonance_hz + 1.0);
        let prior =
            Prior { noise: cold.noise, ..Prior::moved(&last, Window { min_hz, max_hz }, None) };
        let resonance_hz = 139.2 + 0.08 * seed as f64;
        let moved = Circuit { resonance_hz, q: 28.0, ..circuit(30.0, 0.1) };
        let (verdict, seconds, _) = run_disturbed(&moved, &request, Some(&prior), seed, jump);
        warm_s += seconds;
        let found = accepted(&verdict);
        assert!(found.sigma_hz <= request.target_sigma_hz, "seed {seed}: {found:?}");
        let sigmas = (found.resonance_hz - resonance_hz) / found.sigma_hz;
        assert!(sigmas.abs() < 4.5, "seed {seed}: {sigmas}");
        squares += sigmas * sigmas;
    }
    assert!(warm_s < 1.2 * cold_s, "{warm_s} s, {cold_s} s from nothing");
    // χ² of twenty: one in a thousand is beyond either.
    assert!((5.9..45.3).contains(&squares), "{squares}");
}

#[test]
fn a_resonance_anywhere_in_two_decades_is_found() {
    for (resonance_hz, target_sigma_hz) in [(23.0, 0.05), (140.0, 0.05), (1700.0, 0.5)] {
        let window = Window { min_hz: 20.0, max_hz: 2000.0 };
        let request = SweepRequest { window, target_sigma_hz, ..request(SweepMethod::Adaptive) };
        let circuit = Circuit { resonance_hz, ..circuit(30.0, 0.1) };
        let (verdict, ..) = run(&circuit, &request, None, 5);
        let found = accepted(&verdict);
        let error = found.resonance_hz - resonance_hz;
        assert!(error.abs() < 4.5 * found.sigma_hz, "{resonance_hz}: {error}");
    }
}

#[test]
fn a_resonance_is_given_inside_the_window_and_refused_outside() {
    let request =
        SweepRequest { time_limit_s: 5.0, target_sigma_hz: 0.03, ..request(SweepMethod::Adaptive) };
    for (resonance_hz, is_inside) in [(111.0, false), (113.0, true), (167.0, true), (169.0, false)]
    {
        let circuit = Circuit { resonance_hz, ..circuit(30.0, 0.1) };
        let (verdict, ..) = run(&circuit, &request, Some(&known_noise()), 2);
        let found = verdict.accepted();
        assert_eq!(found.is_some(), is_inside, "{resonance_hz}: {verdict:?}");
        let error = found.map_or(0.0, |found| (found.resonance_hz - resonance_hz).abs());
        assert!(error < 0.15, "{resonance_hz}: {error}");
    }
}

/// A drive that does something unknown whenever its frequency changes: a fit of the free decay must not
/// mind.
#[track_caller]
fn check_disturbed(disturb: impl Fn(&mut Plant, f64, &mut Random)) {
    for (q, k_eff_squared) in [(30.0, 0.1), (100.0, 0.02)] {
        for seed in 0..4 {
            let circuit = circuit(q, k_eff_squared);
            let prior = known_noise();
            let request = SweepRequest {
                target_sigma_hz: 0.03,
                time_limit_s: 12.0,
                ..request(SweepMethod::Adaptive)
            };
            let (verdict, ..) = run_disturbed(&circuit, &request, Some(&prior), seed, &disturb);
            let found = accepted(&verdict);
            let error = found.resonance_hz - 140.0;
            assert!(error.abs() < 4.5 * found.sigma_hz, "Q {q}, seed {seed}: {error}");
        }
    }
}

#[test]
fn a_phase_that_jumps_does_no_harm() {
    check_disturbed(|plant, _, random| plant.jump(random.between(0.0, 1.0)));
}

#[test]
fn gaps_of_a_third_of_a_millisecond_do_no_harm() {
    check_disturbed(|plant, before_hz, random| {
        let gap_s = -3e-4 * random.between(f64::MIN_POSITIVE, 1.0).ln();
        plant.drive(before_hz, gap_s);
    });
}

#[test]
fn the_sigma_asked_for_is_reached_at_any_place_and_quality() {
    for (q, k_eff_squared) in [(10.0, 0.1), (30.0, 0.02), (30.0, 0.1), (100.0, 0.02)] {
        for resonance_hz in [121.0, 140.3, 163.7] {
            let circuit = Circuit { resonance_hz, ..circuit(q, k_eff_squared) };
            let request = request(SweepMethod::Adaptive);
            let (verdict, seconds, _) = run(&circuit, &request, None, 1);
            let found = accepted(&verdict);
            assert!(found.sigma_hz <= request.target_sigma_hz, "Q {q} {found:?}");
            let error = found.resonance_hz - resonance_hz;
            assert!(error.abs() < 4.5 * found.sigma_hz, "Q {q} {resonance_hz}: {error}");
            assert!(seconds < 40.0, "Q {q} {resonance_hz}: {seconds} s");
        }
    }
}

#[test]
fn a_resonance_that_moved_is_found_within_where_it_may_be() {
    let request = request(SweepMethod::Adaptive);
    let free = circuit(100.0, 0.08);
    let (verdict, _, _) = run(&free, &request, Some(&known_noise()), 1);
    let within = Window { min_hz: 139.0, ..request.window };
    let prior = Prior::moved(accepted(&verdict), within, None);
    let touched = Circuit { resonance_hz: 157.3, ..circuit(22.0, 0.05) };
    let (verdict, _, _) = run(&touched, &request, Some(&prior), 2);
    let found = accepted(&verdict);
    assert!((found.resonance_hz - 157.3).abs() < 4.5 * found.sigma_hz, "{found:?}");
}

#[test]
fn the_uniform_sweep_asks_once_for_the_whole_window() {
    let request = request(SweepMethod::Uniform { points: 41 });
    let circuit = circuit(30.0, 0.1);
    let (verdict, seconds, readings) = run(&circuit, &request, None, 1);
    let found = accepted(&verdict);
    assert_eq!((found.points, readings), (41, 41));
    assert!((found.resonance_hz - 140.0).abs() < 4.5 * found.sigma_hz);
    assert!((41.0 * 0.5..41.0 * 0.6).contains(&seconds));
}

#[test]
fn a_sensor_without_a_resonance_in_the_window_is_refused() {
    let request = SweepRequest { time_limit_s: 5.0, ..request(SweepMethod::Adaptive) };
    for resonance_hz in [80.0, 240.0] {
        let circuit = Circuit { resonance_hz, ..circuit(30.0, 0.05) };
        let (verdict, seconds, _) = run(&circuit, &request, None, 3);
        assert!(matches!(verdict, FitOutcome::Refused(_)), "{verdict:?}");
        assert!(seconds < 10.0, "{seconds}");
    }
}

/// Far above the resonance there are a capacitor and noise: a second mode or the place of a resonance would be invented.
/// Nearer, a place is stated if it is right.
#[test]
fn far_from_the_resonance_no_other_one_is_named() {
    let mut bad = 0;
    let found = Circuit { resonance_hz: 140.44, ..circuit(60.0, 0.1) };
    for (min_hz, max_hz) in [(150.0, 200.0), (170.0, 220.0), (300.0, 360.0), (400.0, 450.0)] {
        let window = Window { min_hz, max_hz };
        for seed in 0..5 {
            let request = SweepRequest { window, ..request(SweepMethod::Adaptive) };
            let (verdict, ..) = run(&found, &request, None, seed);
            let FitOutcome::Refused(refusal) = verdict else { panic!("{min_hz} Hz: accepted") };
            bad += match refusal.reason {
                Reason::OutsideWindow { estimate_hz, .. } => {
                    u32::from((estimate_hz - found.resonance_hz).abs() > 2.0)
                }
                Reason::SecondMode { .. } => 1,
                _ => 0,
            };
        }
    }
    assert_eq!(bad, 0);
}

#[test]
fn a_planner_without_readings_ends_with_a_refusal() {
    for method in [SweepMethod::Adaptive, SweepMethod::Uniform { points: 20 }] {
        let mut planner = Planner::new(&request(method), None);
        let end = (0..100).find_map(|_| match planner.next() {
            Next::Finished(verdict) => Some(verdict),
            Next::Measure(_) => None,
        });
        assert!(matches!(end, Some(FitOutcome::Refused(_))), "{end:?}");
    }
}

/// A place that had been read was taken for new whenever the resonance was thought to be elsewhere: it
/// seemed informative, was not, and was read again and again.
#[test]
fn a_place_that_was_read_promises_nothing_new() {
    let window = Window { min_hz: 130.0, max_hz: 260.0 };
    let base = SweepRequest { window, target_sigma_hz: 0.05, ..request(SweepMethod::Adaptive) };
    for seed in [1388, 1629, 2630] {
        let resonance_hz = Random::new(seed + 1000).between(141.0, 152.0);
        let touched = Circuit { resonance_hz, loss_tangent: 0.018, ..circuit(35.0, 0.08) };
        let within = Window { min_hz: 138.6, ..window };
        let prior = Prior { circuit: Some(circuit(40.0, 0.1)), within, ..known_noise() };
        let mut random = Random::new(seed);
        let mut plant = Plant::at_rest(touched);
        let mut planner = Planner::new(&base, Some(&prior));
        let (mut now, mut before_hz) = (RigTime::from_micros(3_000_000), None);
        while let Next::Measure(points) = planner.next() {
            for mut point in points {
                // As finely as an analyzer can be set.
                point.frequency_hz = (point.frequency_hz * 100.0).round() / 100.0;
                if before_hz.replace(point.frequency_hz).is_some_and(|hz| hz != point.frequency_hz)
                {
                    plant.jump(random.between(0.0, 1.0));
                }
                let (reading, after) = plant.visit(&point, now, NOISE, &mut random);
                planner.add(&[reading]);
                now = after;
            }
            assert!(planner.readings().len() < 60, "seed {seed}: {:?}", planner.readings().last());
        }
    }
}

/// A sweep of something with this impedance, in whose readings nothing rings: a day takes no time to
/// simulate. Gives the planner at its end, the verdict, and the most work between two readings.
fn settled(
    request: &SweepRequest,
    impedance: impl Fn(f64) -> Complex64,
) -> (Planner, FitOutcome, u64) {
    let mut planner = Planner::new(request, None);
    let (mut random, mut now) = (Random::new(7), RigTime::ZERO);
    let (mut before, mut most) = (0, 0);
    loop {
        let next = planner.next();
        most = most.max(planner.work() - before);
        before = planner.work();
        let points = match next {
            Next::Measure(points) => points,
            Next::Finished(verdict) => return (planner, verdict, most),
        };
        for point in points {
            let error = NOISE * (10.0 / f64::from(point.cycles)).sqrt() * random.normal();
            let value = impedance(point.frequency_hz) * (1.0 + error);
            let mut reading = support::reading(point.frequency_hz, value);
            (reading.started, reading.settle_s) = (now, point.settle_s);
            reading.integration_s = f64::from(point.cycles) / point.frequency_hz;
            now = now + Duration::from_secs_f64(point.duration_s());
            planner.add(&[reading]);
        }
    }
}

/// What ended a sweep that did not reach its target.
#[track_caller]
fn limit(verdict: &FitOutcome) -> Limit {
    match verdict {
        FitOutcome::Refused(refusal) => match refusal.reason {
            Reason::TargetNotReached { limit, .. } => limit,
            _ => panic!("{refusal}"),
        },
        FitOutcome::Accepted(found) => panic!("{found:?}"),
    }
}

#[test]
fn a_sweep_that_may_take_days_ends_when_it_has_as_many_readings_as_are_taken() {
    let (target_sigma_hz, time_limit_s) = (1e-6, 1e9);
    let request = SweepRequest { target_sigma_hz, time_limit_s, ..request(SweepMethod::Adaptive) };
    let circuit = circuit(30.0, 0.1);
    let (planner, verdict, work) =
        settled(&request, |frequency_hz| circuit.impedance_ohm(frequency_hz));
    let Limit::Readings { max } = limit(&verdict) else { panic!("{verdict:?}") };
    assert_eq!(planner.readings().len(), max);
    assert!(work <= Planner::WORK_MAX, "{work}");
}

/// A second mode, too weak to be named and too strong to be left out, keeps the fit from agreeing with
/// the plan.
#[test]
fn a_sweep_whose_readings_never_suffice_is_judged_only_so_often() {
    let (target_sigma_hz, time_limit_s) = (0.001, 1e5);
    let request = SweepRequest { target_sigma_hz, time_limit_s, ..request(SweepMethod::Adaptive) };
    let first = circuit(30.0, 0.1);
    let second =
        Circuit { resonance_hz: 145.0, c0_farad: 1e-15, c1_farad: 1e-3 * first.c0_farad, ..first };
    let (planner, ..) = settled(&request, |frequency_hz| {
        let [first, second] = [first, second].map(|mode| mode.impedance_ohm(frequency_hz));
        first * second / (first + second)
    });
    // The last one is what the sweep ends with.
    assert!(planner.verdicts() <= Planner::VERDICTS_MAX + 1, "{}", planner.verdicts());
}

#[test]
fn the_work_for_a_reading_is_bounded_where_there_is_no_resonance() {
    for resonance_hz in [80.0, 175.0, 240.0] {
        let circuit = Circuit { resonance_hz, ..circuit(25.0, 0.05) };
        let (_, verdict, work) = settled(&request(SweepMethod::Adaptive), |frequency_hz| {
            circuit.impedance_ohm(frequency_hz)
        });
        assert!(matches!(verdict, FitOutcome::Refused(_)), "{verdict:?}");
        assert!(work <= Planner::WORK_MAX, "{resonance_hz}: {work}");
    }
}

/// The time between the readings counts, of which they say nothing.
#[test]
fn what_passes_between_the_readings_counts_against_the_limit() {
    let request = request(SweepMethod::Adaptive);
    let mut planner = Planner::new(&request, None);
    assert!(matches!(planner.next(), Next::Measure(_)));
    planner.pass(request.time_limit_s);
    let Next::Finished(verdict) = planner.next() else { panic!("it goes on") };
    assert_eq!(limit(&verdict), Limit::Time { limit_s: request.time_limit_s });
}

#[test]
fn a_target_that_cannot_be_reached_is_refused_within_the_time_allowed() {
    let mut request = request(SweepMethod::Adaptive);
    (request.target_sigma_hz, request.time_limit_s) = (1e-5, 3.0);
    let (verdict, seconds, _) = run(&circuit(30.0, 0.1), &request, None, 1);
    assert!((2.0..=3.0).contains(&seconds), "{seconds}");
    assert_eq!(limit(&verdict), Limit::Time { limit_s: 3.0 });
}

/// Fewer cycles than an analyzer integrates take as long as those that it does.
#[test]
fn the_time_allowed_holds_on_an_analyzer_that_integrates_longer_than_asked() {
    const SHORTEST_S: f64 = 0.28;
    let circuit = circuit(30.0, 0.1);
    for time_limit_s in [0.2, 1.0, 2.0, 5.0] {
        let request =
            SweepRequest { target_sigma_hz: 1e-5, time_limit_s, ..request(SweepMethod::Adaptive) };
        let mut planner = Planner::new(&request, None).with_shortest_integration(SHORTEST_S);
        let mut now = RigTime::ZERO;
        while let Next::Measure(points) = planner.next() {
            for point in points {
                let value = circuit.impedance_ohm(point.frequency_hz);
                let mut reading = support::reading(point.frequency_hz, value);
                (reading.started, reading.settle_s) = (now, 0.0);
                reading.integration_s =
                    SHORTEST_S.max(f64::from(point.cycles) / point.frequency_hz);
                now = now + Duration::from_secs_f64(reading.integration_s);
                planner.add(&[reading]);
            }
        }
        let taken_s = now.since(RigTime::ZERO).as_secs_f64();
        assert!(taken_s <= time_limit_s, "{taken_s} of {time_limit_s} s");
        assert!(taken_s > 0.5 * (time_limit_s - SHORTEST_S), "{taken_s} of {time_limit_s} s");
    }
}

/// Readings of a campaign on an HP 4284A, whose frequencies are a hertz apart: all are beside the antiresonance of a sensor that
/// resonates 5 Hz lower.
#[test]
fn a_circuit_with_another_static_capacitance_than_that_of_the_free_sensor_needs_more_readings() {
    const READINGS: [(f64, f64, f64, f64, f64); 7] = [
        (67_916.0, -41_802.6, 180.419, 0.0, 0.190_082_551_467_465_36),
        (101_696.0, -29_635.2, 180.419, 0.191, 0.190_082_551_467_465_36),
        (105_413.0, -25_435.7, 180.419, 0.382, 0.190_082_551_467_465_36),
        (106_095.0, -24_575.2, 180.419, 0.573, 0.190_082_551_467_465_36),
        (106_719.0, -25_114.7, 180.419, 0.764, 0.190_082_551_467_465_36),
        (106_013.0, -25_100.3, 181.374, 0.0, 0.189_950_000_031_341_74),
        (106_389.0, -24_061.6, 181.374, 0.191, 0.189_950_000_031_341_74),
    ];
    let free = Circuit {
        resonance_hz: 140.446_943,
        q: 65.752,
        c0_farad: 27.892e-9,
        c1_farad: 0.083_70 * 27.892e-9,
        loss_tangent: 0.0,
    };
    let noise = NoisePrior { at_ten_cycles: 0.005_032, degrees_of_freedom: 22.333 };
    let within = Window { min_hz: 139.04, max_hz: 166.0 };
    let request = SweepRequest {
        window: Window { min_hz: 136.0, max_hz: 166.0 },
        target_sigma_hz: 0.2,
        ..request(SweepMethod::Adaptive)
    };
    let reading = |&(resistance_ohm, reactance_ohm, started_s, settle_s, integration_s)| Reading {
        frequency_hz: 152.671_755_7,
        measured: PointResult::Value(Impedance { resistance_ohm, reactance_ohm }),
        started: RigTime::ZERO + Duration::from_secs_f64(started_s),
        settle_s,
        integration_s,
    };
    let prior = Prior {
        circuit: Some(free),
        capacitance_farad: Some((free.c0_farad, 0.477e-9)),
        noise: Some(noise),
        ..Prior::anywhere(within, None)
    };
    let mut planner = Planner::new(&request, Some(&prior)).with_shortest_integration(0.19);
    let mut readings = READINGS.iter().map(reading);
    loop {
        match planner.next() {
            Next::Finished(verdict) => panic!("{verdict:?}"),
            Next::Measure(points) => {
                let stay: Vec<Reading> = readings.by_ref().take(points.len()).collect();
                if stay.len() < points.len() {
                    assert!(planner.readings().len() >= 7 && planner.verdicts() > 0);
                    return;
                }
                planner.add(&stay);
            }
        }
    }
}
