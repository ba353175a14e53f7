//! Benches whose drift is drawn from seeds: with a walk, a warm-up and a jump.

use std::time::Duration;

use rig_model::random::Stream;

use super::*;

/// The drift of a bench.
#[derive(Debug, Clone, Copy)]
struct Bench {
    /// Standard deviation after an hour, Hz.
    walk_hz: f64,
    /// At the end, Hz, and its time, s.
    warm_up_hz: f64,
    warm_up_s: f64,
}

const QUIET: Bench = Bench { walk_hz: 0.1, warm_up_hz: 0.3, warm_up_s: 3600.0 };
const SIGMA_HZ: f64 = 0.02;
const TOUCH_S: f64 = 5.0;
/// Touches between two references.
const TOUCHES: u32 = 5;

/// The free resonance at a time after the last reference.
#[derive(Debug, Clone, Copy)]
struct Forecast {
    hz: f64,
    /// The half-width of the 95 % interval over 1.96.
    sigma_hz: f64,
}

fn forecast(drift: &Drift, at: RigTime) -> Forecast {
    let since_s = at.since(drift.at.unwrap()).as_secs_f64();
    let then: Vec<Pair> = drift.pairs.iter().map(|pair| pair.after(since_s)).collect();
    let parts: Vec<Part> = then.iter().map(|pair| part(pair, 0.0)).collect();
    let all: f64 = parts.iter().map(|part| part.weight).sum();
    let hz = parts.iter().map(|part| part.weight * part.mean_hz).sum::<f64>() / all;
    Forecast { hz, sigma_hz: width(&parts, hz, 0.95) / 1.96 }
}

/// The resonance at every moment of a run, in steps of a touch.
fn path(bench: Bench, stream: &mut Stream) -> Vec<f64> {
    let step_hz = bench.walk_hz * (TOUCH_S / HOUR_S).sqrt();
    let mut walk_hz = 0.0;
    let value = |step: u32| {
        let part = 1.0 - (-f64::from(step) * TOUCH_S / bench.warm_up_s).exp();
        walk_hz += step_hz * stream.normal();
        140.0 + bench.warm_up_hz * part + walk_hz
    };
    (0..20 * (TOUCHES + 1)).map(value).collect()
}

fn at(step: u32) -> RigTime {
    RigTime::ZERO + Duration::from_secs_f64(TOUCH_S * f64::from(step))
}

/// Errors of the forecasts at the touches of a run in their standard deviations, and these, Hz; and the number of
/// references that were taken for jumps.
fn play(path: &[f64], stream: &mut Stream) -> (Vec<(f64, f64)>, usize) {
    let mut drift = Drift::default();
    let (mut forecasts, mut jumps) = (Vec::new(), 0);
    for (step, hz) in (0..).zip(path) {
        // The first one is the survey, after which the level is checked.
        if step == 1 || step % (TOUCHES + 1) == 0 {
            jumps += usize::from(
                drift.measured(at(step), hz + SIGMA_HZ * stream.normal(), SIGMA_HZ).is_some(),
            );
        } else {
            let Forecast { hz: expected, sigma_hz } = forecast(&drift, at(step));
            forecasts.push(((hz - expected) / sigma_hz, sigma_hz));
        }
    }
    (forecasts, jumps)
}

/// Runs of each bench.
const SEEDS: u64 = 60;

/// What the seeds of a bench give.
fn seeds(bench: Bench) -> (Vec<(f64, f64)>, usize) {
    let (mut forecasts, mut jumps) = (Vec::new(), 0);
    for seed in 0..SEEDS {
        let mut stream = Stream::of_seed(seed);
        let path = path(bench, &mut stream);
        let (of_run, of_jumps) = play(&path, &mut stream);
        forecasts.extend(of_run);
        jumps += of_jumps;
    }
    (forecasts, jumps)
}

#[test]
fn the_interval_of_a_forecast_holds_the_resonance_on_benches_that_drift_little_and_much() {
    let walk = |walk_hz| Bench { walk_hz, ..QUIET };
    let warm = |warm_up_hz, warm_up_s| Bench { warm_up_hz, warm_up_s, ..QUIET };
    let benches = [
        QUIET,
        walk(0.5),
        walk(5.0),
        walk(20.0),
        warm(0.5, 3600.0),
        warm(5.0, 3600.0),
        warm(20.0, 3600.0),
        warm(20.0, 600.0),
    ];
    for bench in benches {
        let (forecasts, jumps) = seeds(bench);
        let all = forecasts.len() as f64;
        let held = forecasts.iter().filter(|(sigmas, _)| sigmas.abs() < 1.96).count() as f64 / all;
        let median_hz = {
            let mut sigmas: Vec<f64> = forecasts.iter().map(|(_, sigma_hz)| *sigma_hz).collect();
            sigmas.sort_by(f64::total_cmp);
            sigmas[sigmas.len() / 2]
        };
        println!("{bench:?}: {held:.3} within, median {median_hz:.3} Hz, {jumps} jumps");
        assert!((0.92..0.997).contains(&held), "{bench:?}: {held}");
        // Of 1,200 references. On a bench that drifts much, the first are farther off than its touches state.
        let is_quiet = bench.walk_hz < 1.0 && bench.warm_up_hz < 1.0;
        let most = if is_quiet { 2 } else { 60 };
        assert!(jumps <= most, "{bench:?}: {jumps}");
    }
}

#[test]
fn a_jump_is_noticed_on_a_quiet_bench_and_a_drift_is_learnt_after_it() {
    let mut noticed = 0;
    for seed in 0..SEEDS {
        let mut stream = Stream::of_seed(seed);
        let mut path = path(QUIET, &mut stream);
        let behind = path.len() / 2;
        path[behind..].iter_mut().for_each(|hz| *hz += 0.3);
        noticed += usize::from(play(&path, &mut stream).1 == 1);
    }
    assert!(57 <= noticed, "{noticed}");
    // From half of the run on the bench drifts fifty times as much.
    let mut jumps = Vec::new();
    for seed in 0..SEEDS {
        let mut stream = Stream::of_seed(seed);
        let quiet = path(QUIET, &mut stream);
        let wild = self::path(Bench { walk_hz: 5.0, ..QUIET }, &mut stream);
        let (half, end) = (quiet.len() / 2, quiet[quiet.len() / 2]);
        let all: Vec<f64> =
            quiet[..half].iter().copied().chain(wild.iter().map(|hz| hz - 140.0 + end)).collect();
        jumps.push(play(&all, &mut stream).1);
    }
    let most = jumps.iter().max().unwrap();
    assert!(*most <= 4, "{jumps:?}");
    assert!(jumps.iter().any(|jumps| *jumps > 0), "{jumps:?}");
}

#[test]
fn a_jump_is_marked_before_much_is_known_of_the_drift() {
    const SIGMA_HZ: f64 = 0.045;
    let mut marked = 0;
    for seed in 0..SEEDS {
        let mut stream = Stream::of_seed(seed);
        let mut drift = Drift::default();
        let mut measured = |n: u64, hz: f64| {
            let at = RigTime::from_micros(n * 15_000_000);
            drift.measured(at, hz + SIGMA_HZ * stream.normal(), SIGMA_HZ)
        };
        assert_eq!([0, 1, 2].map(|n| measured(n, 140.0)), [None; 3], "{seed}");
        marked += usize::from(measured(3, 140.45).is_some());
    }
    assert!(45 <= marked, "{marked}");
}

#[test]
fn a_sensor_that_was_turned_may_have_another_resonance() {
    let mut drift = Drift::default();
    for step in 0..5 {
        assert_eq!(drift.measured(at(6 * step), 140.0, SIGMA_HZ), None);
    }
    let before_hz = forecast(&drift, at(25)).sigma_hz;
    assert!(before_hz < 0.05, "{before_hz}");
    let jump = drift.clone().measured(at(30), 140.6, SIGMA_HZ).unwrap();
    assert!((jump.off_hz - 0.6).abs() < 0.05 && jump.sigma_hz < 0.1, "{jump:?}");
    drift.turned();
    assert!(forecast(&drift, at(25)).sigma_hz > 0.4);
    assert_eq!(drift.measured(at(30), 140.6, SIGMA_HZ), None);
}

#[test]
fn a_difference_is_told_from_a_walk_on_a_quiet_bench_and_not_on_one_that_drifts() {
    let mut quiet = Drift::default();
    let mut wild = Drift::default();
    for (step, hz) in (0..).zip([140.0, 140.4, 139.9]) {
        quiet.measured(at(step), 140.0 + 0.01 * f64::from(step), SIGMA_HZ);
        wild.measured(at(step), hz, SIGMA_HZ);
    }
    assert!(quiet.is_beyond_walk(0.5, SIGMA_HZ, 0.4));
    assert!(!wild.is_beyond_walk(0.5, SIGMA_HZ, 0.4));
    assert!(!quiet.is_beyond_walk(0.02, SIGMA_HZ, 0.4));
    assert!(wild.moves_hz(5.0) > 10.0 * quiet.moves_hz(5.0));
}

#[test]
fn a_reference_is_due_after_many_touches_on_a_quiet_bench_and_after_few_on_one_that_drifts() {
    /// References of 120 touches.
    fn references(bench: Bench, seed: u64) -> u64 {
        let mut stream = Stream::of_seed(seed);
        let path = path(bench, &mut stream);
        let touch = Duration::from_secs_f64(TOUCH_S);
        let (mut drift, mut count) = (Drift::default(), 0);
        for (step, hz) in (0..).zip(&path) {
            if drift.asks_for_reference(at(step), touch, 2.0 * SIGMA_HZ) {
                drift.measured(at(step), hz + SIGMA_HZ * stream.normal(), SIGMA_HZ);
                count += 1;
            }
        }
        count
    }
    let mean = |bench| (0..SEEDS).map(|seed| references(bench, seed)).sum::<u64>() / SEEDS;
    let counts = [0.1, 0.5, 5.0].map(|walk_hz| mean(Bench { walk_hz, ..QUIET }));
    println!("{counts:?}");
    assert!(counts[0] < 40 && counts[0] < counts[1] && 100 < counts[2], "{counts:?}");
}

#[test]
fn the_normal_distribution_has_its_printed_values() {
    for (x, expected) in [(0.0, 0.5), (1.0, 0.841_345), (-1.96, 0.024_998), (3.0, 0.998_650)] {
        assert!((normal(x) - expected).abs() < 1e-6, "{x}: {}", normal(x));
    }
}
