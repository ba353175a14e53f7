//! Tests that the gradient is that of the cost and that the fit recovers the circuit.

use std::{f64::consts::PI, time::Duration};

use rig_model::{Impedance, PointResult, RigTime};

use super::{model::Branch, *};
use crate::{
    Circuit, Extra, FitOptions, NoisePrior, Timing, circuit::trace::ExtraTerm,
    noise::PooledVariance,
};

/// Stays of a circuit whose readings are slightly late and slightly wrong.
fn stays(at: &ModelEstimate) -> Stays {
    moving(at, &[137.2, 140.9, 138.5, 143.0], |_| 0.0)
}

/// The same at these frequencies, with a resonance that differs by this much, Hz, at a time in s.
fn moving(at: &ModelEstimate, frequencies_hz: &[f64], off_hz: impl Fn(f64) -> f64) -> Stays {
    moving_in(at, (frequencies_hz, 6, 0.01), off_hz)
}

/// The same with this many readings in each stay, which are wrong by this much.
fn moving_in(
    at: &ModelEstimate,
    (frequencies_hz, readings, wrong): (&[f64], u32, f64),
    off_hz: impl Fn(f64) -> f64,
) -> Stays {
    let known = Known::with(2.5e-5).with_first_gap(1e-3);
    let (all, last, work) = (Vec::new(), None, Cell::new(0));
    let mut stays =
        Stays { all, unit_farad: 1.0, known, bench: None, drift: None, excluded: 0, last, work };
    let mut amplitude = Amplitude::new(at);
    for (n, &frequency_hz) in frequencies_hz.iter().enumerate() {
        let since_s = 0.016 * f64::from(readings) - 0.006;
        let square = amplitude.change(frequency_hz, since_s);
        let model = |s: f64| {
            let resonance_hz = at.resonance_hz + off_hz(since_s * n as f64 + s);
            Model::new(&ModelEstimate { resonance_hz, ..*at }, frequency_hz)
        };
        let unit = square.sqrt() * model(0.0).unit;
        let free = 0.7 * Complex64::from_polar(unit, 2.0 * n as f64);
        let mut motion = Motion { now_s: 0.0, admittance: model(0.0).steady + free };
        let samples = (0..readings)
            .map(|k| {
                let wave = |x: f64| (x + f64::from(k) + 1.7 * n as f64).sin();
                let (start_s, integration_s) = (0.016 * f64::from(k), 2.0 / frequency_hz);
                let late_s = if k == 0 { 0.0 } else { 0.7e-3 * wave(0.3) };
                motion.mean_until(start_s + late_s, model);
                let mean = motion.mean_until(start_s + late_s + integration_s, model);
                let error = 1.0 + wrong * Complex64::new(wave(1.0), wave(2.0));
                let impedance = Some(error / mean);
                Sample { start_s, integration_s, impedance, length: 0.2 }
            })
            .collect();
        stays.all.push(Stay { frequency_hz, since_s, samples });
    }
    stays
}

/// The motion of a sensor whose resonance may move, integrated in small steps. It is the admittance Y of which the
/// deviation from the steady state Y0 decays: Y' = (s − jω)(Y − Y0).
struct Motion {
    now_s: f64,
    admittance: Complex64,
}

impl Motion {
    /// Goes on to this time, and returns the mean admittance until then.
    fn mean_until(&mut self, end_s: f64, model: impl Fn(f64) -> Model) -> Complex64 {
        const STEPS: u32 = 60;
        let step_s = (end_s - self.now_s) / f64::from(STEPS);
        let mut sum = Complex64::ZERO;
        for _ in 0..STEPS {
            // Exact for a resonance that rests at its value in the middle of the step.
            let Model { rate, steady, .. } = model(self.now_s + 0.5 * step_s);
            let away = self.admittance - steady;
            let grown = (rate * step_s).exp();
            sum += steady + away * (grown - 1.0) / (rate * step_s);
            (self.now_s, self.admittance) = (self.now_s + step_s, steady + away * grown);
        }
        sum / f64::from(STEPS)
    }
}

const AT: ModelEstimate = ModelEstimate {
    resonance_hz: 140.0,
    q: 60.0,
    c0: 1.0,
    c1: 0.05,
    g: 0.018,
    extra_term: ExtraTerm::Nothing,
    extra: [0.0; 3],
};

#[test]
fn the_gradient_is_that_of_the_cost() {
    let stays = stays(&AT);
    let here = ModelEstimate { resonance_hz: 140.02, q: 61.0, ..AT };
    let mut states = Vec::new();
    let again = |at: &ModelEstimate, states: &mut Vec<State>| {
        states.iter_mut().for_each(State::thaw);
        stays.normal(at, states)
    };
    let normal = (0..5).map(|_| again(&here, &mut states)).last().unwrap();
    let cost = |at: &ModelEstimate| {
        // The same prior on both sides.
        let mut states = states.clone();
        (0..5).fold(0.0, |_, _| again(at, &mut states).cost)
    };
    let moved = |i: usize, h: f64| match i {
        0 => ModelEstimate { resonance_hz: here.resonance_hz * h.exp(), ..here },
        1 => ModelEstimate { q: here.q * h.exp(), ..here },
        2 => ModelEstimate { c0: here.c0 + h, ..here },
        3 => ModelEstimate { c1: here.c1 + h, ..here },
        _ => ModelEstimate { g: here.g + h, ..here },
    };
    for i in 0..CIRCUIT {
        let step = 0.02 / normal.matrix[i][i].sqrt();
        let found = (cost(&moved(i, step)) - cost(&moved(i, -step))) / (4.0 * step);
        let error = (found - normal.gradient[i]).abs() / normal.matrix[i][i].sqrt();
        assert!(error < 0.02, "{i}: {found} {} {error}", normal.gradient[i]);
    }
}

/// The first readings of all stays are wrong by the same time, so that it is not between them.
#[test]
fn a_wrong_first_gap_is_between_the_readings_of_a_stay_and_not_between_stays() {
    let bench = Bench {
        phase_rad: 0.0,
        phase_sigma_rad: 1e-3,
        first_gap_s: 2e-3,
        dispersion_farad: 0.0,
        dispersion_sigma_farad: 1e-11,
        mode_sigma: 0.01,
        surveyed: rig_model::Window { min_hz: 125.0, max_hz: 161.0 },
    };
    let readings: Vec<Reading> = [138.0, 141.0, 141.0, 141.0, 139.0, 139.0]
        .into_iter()
        .zip(0_u64..)
        .map(|(frequency_hz, n)| Reading {
            frequency_hz,
            measured: PointResult::Value(Impedance { resistance_ohm: 1e3, reactance_ohm: -4e4 }),
            started: RigTime::from_micros(100_000 * n),
            settle_s: 0.0,
            integration_s: 0.07,
        })
        .collect();
    let stays = Stays::of(Known::with(2.5e-5), Some(bench), &readings).unwrap();
    let since_s: Vec<f64> = stays.all.iter().map(|stay| stay.since_s).collect();
    let starts_s: Vec<f64> = stays.all[1].samples.iter().map(|sample| sample.start_s).collect();
    for (found, right) in
        since_s.into_iter().chain(starts_s).zip([0.0, 0.1, 0.3, 0.0, 0.102, 0.202])
    {
        assert!((found - right).abs() < 1e-9, "{found} s, not {right} s");
    }
}

/// As by a fit of readings that are wrong by one standard deviation of each.
#[test]
fn the_uncertainty_of_the_bench_moves_the_resonance_as_a_refit_does() {
    let expected = CircuitPrior::any(30.0);
    let surveyed = rig_model::Window { min_hz: 125.0, max_hz: 161.0 };
    let bench = Bench {
        phase_rad: 0.0,
        phase_sigma_rad: 1e-2,
        first_gap_s: 0.0,
        dispersion_farad: 0.0,
        dispersion_sigma_farad: 0.05,
        mode_sigma: 0.01,
        surveyed,
    };
    for frequencies_hz in [[128.0, 140.9, 138.5, 157.0], [141.2, 142.9, 150.0, 158.0]] {
        let stays = Stays { bench: Some(bench), ..moving(&AT, &frequencies_hz, |_| 0.0) };
        let found = stays.minimum(AT, &expected);
        let moved_hz = |phase_rad: f64, dispersion_farad: f64| {
            let fitted = |sign: f64| {
                let (phase_rad, dispersion_farad) = (sign * phase_rad, sign * dispersion_farad);
                let mut other = stays.clone();
                other.correct(&Bench { phase_rad, dispersion_farad, ..bench });
                other.minimum(found.at, &expected).at.resonance_hz
            };
            0.5 * (fitted(1.0) - fitted(-1.0))
        };
        let by_phase_hz = moved_hz(bench.phase_sigma_rad, 0.0);
        let by_dispersion_hz = moved_hz(0.0, bench.dispersion_sigma_farad);
        let shift_hz = stays.shift_by_bench_hz(&found, &expected).unwrap();
        let ratio = shift_hz / by_phase_hz.hypot(by_dispersion_hz);
        assert!((ratio - 1.0).abs() < 0.03, "{ratio}: {by_phase_hz} {by_dispersion_hz}");
        assert!(by_phase_hz.abs() > 1e-3 && by_dispersion_hz.abs() > 1e-3, "{by_dispersion_hz}");
    }
}

#[test]
fn the_circuit_comes_out_although_times_are_a_little_wrong() {
    let stays = stays(&AT);
    let start = ModelEstimate { resonance_hz: 140.3, q: 45.0, c1: 0.04, ..AT };
    let expected = CircuitPrior::any(30.0);
    let found = stays.minimum(start, &expected);
    let sigma_hz = stays.profile_sigma_hz(&found, &expected);
    let off_hz = found.at.resonance_hz - AT.resonance_hz;
    assert!(off_hz.abs() < 4.0 * sigma_hz && sigma_hz < 0.1, "{off_hz} {sigma_hz}");
    assert!((found.at.q / AT.q).ln().abs() < 0.2, "{:?}", found.at);
}

/// Readings short and long against the decay, one at once and one later.
#[test]
fn a_reading_of_a_resonance_that_moves_is_that_of_the_integrated_motion() {
    for (frequency_hz, relaxation_per_s) in
        [139.2, 140.0, 141.5].into_iter().flat_map(|hz| [0.0, 0.5, 1.5, 3.0].map(|r| (hz, r)))
    {
        let still = Model::new(&AT, frequency_hz);
        let amplitude = Complex64::from_polar(20.0 * still.unit, 1.0);
        for (start_s, integration_s) in [(0.0, 0.02), (0.3, 0.02), (0.0, 0.2), (0.2, 0.2)] {
            let middle_s = 0.25;
            let mean = |per_s: f64| {
                let past_s = |s: f64| {
                    if relaxation_per_s > 0.0 {
                        -(-relaxation_per_s * (s - middle_s)).exp_m1() / relaxation_per_s
                    } else {
                        s - middle_s
                    }
                };
                let model = |s: f64| {
                    let resonance_hz = AT.resonance_hz * (per_s * past_s(s)).exp();
                    Model::new(&ModelEstimate { resonance_hz, ..AT }, frequency_hz)
                };
                // The amplitude is that beside the forced motion, which is late.
                let (past_s, rate) = (past_s(0.0), still.rate);
                let late_s = (rate * past_s + 1.0) / (rate + relaxation_per_s);
                let admittance = still.steady + per_s * still.by[0] * late_s + amplitude;
                let mut motion = Motion { now_s: 0.0, admittance };
                (0..20).for_each(|n| {
                    motion.mean_until(start_s / 20.0 * f64::from(n + 1), model);
                });
                let steps = (0..20).map(|n| {
                    motion.mean_until(start_s + integration_s / 20.0 * f64::from(n + 1), model)
                });
                steps.sum::<Complex64>() / 20.0
            };
            let per_s = 1e-5;
            let slope = (mean(per_s) - mean(-per_s)) / (2.0 * per_s);
            let decayed = still.decayed(start_s, integration_s, &mut None);
            let moving = Moving { per_s: 1.0, middle_s, relaxation_per_s };
            let found = still.by_motion(&moving, amplitude, &decayed);
            let error = (found - slope).norm() / slope.norm();
            assert!(
                error < 1e-5,
                "{frequency_hz} {relaxation_per_s} {start_s}: {found}, not {slope}"
            );
        }
    }
}

/// Both flanks in turn, for three seconds.
fn flanks_hz() -> Vec<f64> {
    (0..34).map(|n| 140.0 + [-1.2, 0.9, -0.4, 1.6, 0.2][n % 5]).collect()
}

/// The stays with the drift that they require, and the resonance at the effective time with its standard deviation, Hz;
/// `None` if they require none.
fn followed(stays: &Stays) -> Option<(Stays, Hypothesis)> {
    followed_from(stays, &stays.minimum(AT, &CircuitPrior::any(30.0)))
}

fn followed_from(stays: &Stays, constant: &Hypothesis) -> Option<(Stays, Hypothesis)> {
    let expected = CircuitPrior::any(30.0);
    let noise = crate::noise::PooledVariance::known(&crate::NoisePrior {
        at_ten_cycles: stays.known.variance.sqrt(),
        degrees_of_freedom: 1000.0,
    });
    let window = rig_model::Window { min_hz: 125.0, max_hz: 160.0 };
    stays.following(constant, &expected, (noise, window))
}

#[test]
fn a_resonance_that_moves_is_followed_and_stated_for_its_effective_time() {
    for time_s in [0.7, 2.0, f64::INFINITY] {
        for change_hz in [-1.0, -0.3, -0.1, 0.1, 0.3, 1.0] {
            // A change of more than a hundred standard deviations is refused: the second order of it shows.
            let is_large = f64::abs(change_hz) > 0.3;
            let off_hz = |s: f64| {
                let part = if time_s.is_finite() { 1.0 - (-s / time_s).exp() } else { s / 3.0 };
                change_hz * part
            };
            let stays = moving_in(&AT, (&flanks_hz()[..10], 20, 0.01), off_hz);
            let Some((found, best)) = followed(&stays) else {
                assert!(is_large, "{change_hz} Hz in {time_s} s moves by many standard deviations");
                continue;
            };
            let at_s = found.drift.expect("a drift").effective_s();
            let sigma_hz = best.sigma_hz().hypot(best.at.resonance_hz * found.sigma_by_drift());
            let error_hz = best.at.resonance_hz - AT.resonance_hz - off_hz(at_s);
            // The errors of these readings hardly move it.
            let context =
                format!("{change_hz} Hz in {time_s} s: {error_hz} ± {sigma_hz} at {at_s}");
            let sigmas = if is_large { 1.0 } else { 0.5 };
            assert!(error_hz.abs() < sigmas * sigma_hz && sigma_hz < 0.05, "{context}");
            assert!((0.0..3.1).contains(&at_s), "{context}");
            // Without it, the readings are not described.
            assert!(
                best.normal.cost < 0.9 * stays.minimum(AT, &CircuitPrior::any(30.0)).normal.cost
            );
        }
    }
}

/// The readings follow it with a delay: without this the errors would be seven times as large.
#[test]
fn a_resonance_that_drifts_has_the_value_of_the_fit_at_the_effective_time() {
    let expected = CircuitPrior::any(30.0);
    // Too few stays for a drift to be told.
    let frequencies_hz = [138.8, 140.9, 139.6];
    let error_hz = |hz_per_s: f64| {
        let stays = moving_in(&AT, (&frequencies_hz, 20, 1e-4), |s| hz_per_s * s);
        let found = stays.minimum(AT, &expected);
        let at_s = stays.effective_time_s(&found, &expected).unwrap();
        found.at.resonance_hz - AT.resonance_hz - hz_per_s * at_s
    };
    // The other half is that of a resonance that rests.
    let by_drift_hz = 0.5 * (error_hz(0.1) - error_hz(-0.1));
    assert!(by_drift_hz.abs() < 1e-4, "{by_drift_hz}");
}

#[test]
fn a_sweep_that_is_short_against_the_decay_can_drift_only_steadily() {
    let at = ModelEstimate { q: 300.0, ..AT };
    let stays = moving(&at, &flanks_hz()[..5], |s| 2.0 * s);
    let expected = CircuitPrior::any(30.0);
    let constant = stays.minimum(at, &expected);
    assert!(stays.gain_by_drift(&constant, &expected) > 9.0);
    let (found, _) =
        followed_from(&stays, &constant).expect("it moves by many standard deviations");
    // No other shape is possible, and at the effective time the change adds nothing.
    assert_eq!(found.sigma_by_drift(), 0.0);
    assert!(matches!(found.drift.unwrap().extra(), Extra::Drift { .. }));
}

/// The search begins with a decay that is too short, beside which these relaxations are slow ones.
#[test]
fn a_relaxation_that_is_followed_is_slow_beside_the_decay_of_the_circuit_found() {
    let at = ModelEstimate { q: 200.0, ..AT };
    let mut followed = 0;
    for (time_s, change_hz) in [(0.7, 0.3), (0.7, -0.3), (0.8, 0.2), (0.8, -0.2)] {
        let off_hz = |s: f64| change_hz * -(-s / time_s).exp_m1();
        let stays = moving_in(&at, (&flanks_hz()[..10], 20, 0.01), off_hz);
        let mut start = stays.minimum(at, &CircuitPrior::any(30.0));
        start.at.q *= 0.7;
        // One that is not followed is refused later.
        let Some((found, best)) = followed_from(&stays, &start) else { continue };
        let Extra::Relaxation { time_s: found_s, .. } = found.drift.unwrap().extra() else {
            panic!("{time_s} s, {change_hz} Hz: {:?}", found.drift);
        };
        let decay_s = best.at.q / (PI * best.at.resonance_hz);
        assert!(found_s > 1.8 * decay_s, "{time_s} s, {change_hz} Hz: {found_s} s, {decay_s} s");
        followed += 1;
    }
    assert!(followed >= 2, "{followed} of 4");
}

#[test]
fn a_resonance_that_rests_is_not_followed() {
    assert!(followed(&moving(&AT, &flanks_hz(), |_| 0.0)).is_none());
    // Too few stays to tell.
    assert!(followed(&moving(&AT, &flanks_hz()[..3], |s| 3.0 * s)).is_none());
}

#[test]
fn a_second_mode_is_not_taken_for_a_drift() {
    // From below to above, so that it looks like one.
    let frequencies_hz: Vec<f64> = (0..34).map(|n| 138.4 + 0.1 * f64::from(n)).collect();
    for part in [0.02, 0.05, 0.1, 0.2] {
        let mut stays = moving(&AT, &frequencies_hz, |_| 0.0);
        for stay in &mut stays.all {
            let mode_hz = AT.resonance_hz * (1.0 + 1.0 / AT.q);
            let mode = Branch::new(mode_hz, AT.q, stay.frequency_hz, 0.0.into());
            for sample in &mut stay.samples {
                let more = part * AT.c1 * mode.mean(sample.start_s + 10.0, sample.integration_s);
                sample.impedance = sample.impedance.map(|impedance| 1.0 / (1.0 / impedance + more));
            }
        }
        let found = followed(&stays).and_then(|(stays, _)| stays.drift);
        assert!(found.is_none(), "{part}: {found:?}");
    }
}

// Frequency, Hz; resistance and reactance, ohm; when the frequency was set, settling and integration, s.
const LATE: [[f64; 6]; 7] = [
    [152.6717557, 63519.8, -39464.6, 93.922, 0.0, 0.19008281762048657],
    [152.6717557, 95610.2, -74220.9, 93.922, 0.491, 0.19008281762048657],
    [152.6717557, 95915.8, -74891.6, 93.922, 0.982, 0.19008281762048657],
    [152.6717557, 96130.8, -74843.1, 93.922, 1.4729999999999999, 0.19008281762048657],
    [152.6717557, 95881.7, -74796.3, 93.922, 1.964, 0.19008281762048657],
    [151.8987342, 75720.8, -54341.1, 96.377, 0.0, 0.18454719298987896],
    [151.8987342, 113744.0, -31354.9, 96.377, 0.485, 0.18454719298987896],
];
const IN_TIME: [[f64; 6]; 13] = [
    [152.6717557, 92212.4, -19146.9, 386.035, 0.0, 0.1900991576765391],
    [152.6717557, 103429.0, -24258.7, 386.035, 0.191, 0.1900991576765391],
    [152.6717557, 105746.0, -25222.3, 386.035, 0.382, 0.1900991576765391],
    [152.6717557, 106045.0, -24710.6, 386.035, 0.573, 0.1900991576765391],
    [152.6717557, 105875.0, -24528.4, 386.035, 0.764, 0.1900991576765391],
    [151.5151515, 73367.6, -7246.55, 386.99, 0.0, 0.184994444433009],
    [151.5151515, 72448.5, 18979.4, 386.99, 0.186, 0.184994444433009],
    [151.5151515, 69544.5, 17282.6, 386.99, 0.371, 0.184994444433009],
    [151.5151515, 69174.0, 16708.0, 386.99, 0.556, 0.184994444433009],
    [151.5151515, 69527.4, 17249.1, 386.99, 0.741, 0.184994444433009],
    [151.5151515, 69476.9, 16606.4, 386.99, 0.926, 0.184994444433009],
    [151.5151515, 69372.2, 16969.9, 386.99, 1.111, 0.184994444433009],
    [151.5151515, 69966.2, 16457.6, 386.99, 1.296, 0.184994444433009],
];

/// The impedances of the readings with this circuit and these free decays if the resonance drifts by this part per
/// second.
fn drifting(stays: &Stays, best: &Hypothesis, per_s: f64) -> Vec<Complex64> {
    let mut begin_s = 0.0;
    let mut all = Vec::new();
    for (n, (stay, state)) in stays.all.iter().zip(&best.states).enumerate() {
        begin_s += if n == 0 { 0.0 } else { stay.since_s };
        let model = |s: f64| {
            let resonance_hz = best.at.resonance_hz * (per_s * (begin_s + s)).exp();
            Model::new(&ModelEstimate { resonance_hz, ..best.at }, stay.frequency_hz)
        };
        let admittance = model(0.0).steady + state.amplitude();
        let mut motion = Motion { now_s: 0.0, admittance };
        for sample in &stay.samples {
            motion.mean_until(sample.start_s, model);
            all.push(motion.mean_until(sample.end_s(), model).inv());
        }
    }
    all
}

/// Two stays on one side of the resonance, read every 0.49 s and every 0.19 s. A slope of their readings looks like the
/// end of a free decay, so that the time of the first is extrapolated far beyond its sweep of 3 s, to 28 s. Its readings move
/// the fit by 20 s times the rate if they are made to drift.
#[test]
fn two_stays_beside_the_resonance_hold_for_the_time_at_which_a_drift_has_the_value_of_the_fit() {
    let window = rig_model::Window { min_hz: 136.0, max_hz: 166.0 };
    let late = [146.542, 44.031, 2.8598e-8, 2.1453e-9, 0.0103159, 0.0034593];
    let in_time = [147.560, 43.849, 2.8230e-8, 2.0411e-9, 0.0215042, 0.0056002];
    for (rows, near, tolerance_s) in [(&LATE[..], late, 12.0), (&IN_TIME[..], in_time, 0.1)] {
        let [resonance_hz, q, c0_farad, c1_farad, loss_tangent, at_ten_cycles] = near;
        let options = FitOptions {
            timing: Timing::AnyPhase,
            near: Some(Circuit { resonance_hz, q, c0_farad, c1_farad, loss_tangent }),
            ..FitOptions::default()
        };
        let noise = NoisePrior { at_ten_cycles, degrees_of_freedom: 22.333 };
        let noise = PooledVariance::known(&noise);
        let fitted = |readings: &[Reading]| {
            let mut stays = Stays::of(Known::with(noise.variance()), None, readings).unwrap();
            let (best, expected) = judge::best(&mut stays, window, noise, &options).unwrap();
            (stays, best, expected)
        };
        let measured = |z: Complex64| {
            PointResult::Value(Impedance { resistance_ohm: z.re, reactance_ohm: z.im })
        };
        let reading = |&[frequency_hz, re, im, started_s, settle_s, integration_s]: &[f64; 6]| {
            let started = RigTime::ZERO + Duration::from_secs_f64(started_s);
            let measured = measured(Complex64::new(re, im));
            Reading { frequency_hz, measured, started, settle_s, integration_s }
        };
        let readings: Vec<Reading> = rows.iter().map(reading).collect();
        let (stays, best, expected) = fitted(&readings);
        let time_s = stays.effective_time_s(&best, &expected).unwrap();
        let at_rest = drifting(&stays, &best, 0.0);
        let found_if = |per_s: f64| {
            let there = drifting(&stays, &best, per_s);
            let changed = |(reading, (rest, there)): (&Reading, (&Complex64, &Complex64))| {
                let z = complex_ohm(reading).unwrap() * there / rest;
                Reading { measured: measured(z), ..*reading }
            };
            let all = readings.iter().zip(at_rest.iter().zip(&there)).map(changed);
            fitted(&all.collect::<Vec<_>>()).1.at.resonance_hz.ln()
        };
        let per_s = 1e-5;
        let by_drift_s = (found_if(per_s) - found_if(-per_s)) / (2.0 * per_s);
        assert!((time_s - by_drift_s).abs() < tolerance_s, "{time_s} s, not {by_drift_s} s");
    }
}
