use num_complex::Complex64;

use super::*;
use crate::normal::{GLOBAL, Step};

/// Readings of a sensor at rest before each, one frequency after the other.
fn steady(resonance_hz: f64, q: f64, c0: f64, ratio: f64, loss: f64) -> Vec<Reading> {
    let reading = |k: u32| {
        let frequency_hz = 130.0 + f64::from(k);
        let (omega, u) = (TAU * frequency_hz, frequency_hz / resonance_hz);
        let branch = Complex64::new(1.0 - u * u, u / q).inv() * ratio;
        let y = Complex64::new(0.0, omega * c0) * (Complex64::new(1.0, -loss) + branch);
        let z = y.inv();
        Reading {
            frequency_hz,
            resistance_ohm: Some(z.re),
            reactance_ohm: Some(z.im),
            started_s: f64::from(k),
            settle_s: 0.5,
            integration_s: 20.0 / frequency_hz,
            flag: Flag::Normal,
        }
    };
    (0..25).map(reading).collect()
}

const STATED: Circuit = Circuit {
    quality_factor: 30.0,
    static_capacitance_f: 20e-9,
    capacitance_ratio: 0.1,
    loss_tangent: 0.02,
};

#[test]
fn the_circuit_behind_steady_readings_is_found_from_a_wrong_start() {
    let readings = steady(141.3, 34.0, 21e-9, 0.09, 0.01);
    let found = fit(&readings, Motion::Settled, None, Stated::alone(140.9, &STATED)).unwrap();
    assert!((found.resonance_hz - 141.3).abs() < 2e-3, "{found:?}");
    assert!((found.circuit.quality_factor - 34.0).abs() < 0.05, "{found:?}");
    assert!(found.scatter < 0.2 && found.sigma_hz > 0.0, "{found:?}");
}

#[test]
fn settled_readings_tell_their_noise_alone_where_nothing_is_known_of_it() {
    for noise in [1e-2, 1e-4, 1e-6] {
        let sign = |k: usize| if k.is_multiple_of(3) { 1.0 } else { -1.0 };
        let disturbed = |(k, reading): (usize, &Reading)| {
            let z = measured(reading) * (1.0 + noise * sign(k));
            // So long that nothing rings.
            let (re, im) = (Some(z.re), Some(z.im));
            Reading { resistance_ohm: re, reactance_ohm: im, settle_s: 5.0, ..*reading }
        };
        let exact = steady(141.3, 34.0, 21e-9, 0.09, 0.01);
        let readings: Vec<Reading> = exact.iter().enumerate().map(disturbed).collect();
        let found = fit(&readings, Motion::Settled, None, Stated::alone(141.3, &STATED)).unwrap();
        // Half a linewidth times the noise, over the root of some readings near the resonance.
        let expected_hz = 141.3 / 34.0 * noise / 4.0;
        assert!((0.2..5.0).contains(&(found.sigma_hz / expected_hz)), "{noise}: {found:?}");
    }
}

/// The same readings as an analyzer shows them that sees this too.
fn with_extra(readings: &[Reading], resonance_hz: f64, c0: f64, extra: Extra) -> Vec<Reading> {
    let last = readings.len() - 1;
    let seen = |(k, reading): (usize, &Reading)| {
        let omega = TAU * reading.frequency_hz;
        let drive = Complex64::new(0.0, omega);
        let mut reading = *reading;
        let mut z = measured(&reading);
        match extra {
            Extra::Drift { change } => {
                let when = 2.0 * k as f64 / last as f64 - 1.0;
                reading = steady(resonance_hz * (1.0 + change * when), 34.0, c0, 0.09, 0.01)[k];
                z = measured(&reading);
            }
            Extra::Relaxation { .. } => unreachable!("settled readings are fitted without one"),
            Extra::Stray { resistance_ohm, inductance_h } => {
                z += resistance_ohm + drive * inductance_h;
            }
            Extra::SecondMode { resonance_hz, quality_factor, capacitance_f } => {
                let u = reading.frequency_hz / resonance_hz;
                let branch = Complex64::new(1.0 - u * u, u / quality_factor).inv();
                z = (z.inv() + drive * capacitance_f * branch).inv();
            }
            Extra::Dispersion { slope } => {
                let folds = (reading.frequency_hz / resonance_hz).ln();
                z = (z.inv() + drive * c0 * slope * folds).inv();
            }
            Extra::AnalyzerPhase { phase_rad } => z *= Complex64::cis(phase_rad),
        }
        Reading { resistance_ohm: Some(z.re), reactance_ohm: Some(z.im), ..reading }
    };
    readings.iter().enumerate().map(seen).collect()
}

const fn with<'a>(resonance_hz: f64, circuit: &'a Circuit, extra: &'a Extra) -> Stated<'a> {
    Stated { extra: Some(extra), ..Stated::alone(resonance_hz, circuit) }
}

/// What can be beside a circuit, and the same with other values.
fn extras() -> [[Extra; 2]; 5] {
    let second = |resonance_hz, quality_factor, capacitance_f| Extra::SecondMode {
        resonance_hz,
        quality_factor,
        capacitance_f,
    };
    let stray = |resistance_ohm, inductance_h| Extra::Stray { resistance_ohm, inductance_h };
    [
        [Extra::Drift { change: 0.004 }, Extra::Drift { change: 0.012 }],
        [stray(1500.0, 0.5), stray(500.0, 3.5)],
        [second(147.0, 60.0, 0.3e-9), second(150.0, 20.0, 0.5e-9)],
        [Extra::Dispersion { slope: 0.08 }, Extra::Dispersion { slope: -0.08 }],
        [Extra::AnalyzerPhase { phase_rad: 0.04 }, Extra::AnalyzerPhase { phase_rad: -0.03 }],
    ]
}

#[test]
fn what_is_beside_the_circuit_is_fitted_with_it_and_a_wrong_statement_of_it_shows() {
    let (resonance_hz, q, c0) = (141.3, 34.0, 21e-9);
    let stated = Circuit { static_capacitance_f: c0, ..STATED };
    for [extra, other] in extras() {
        let readings = steady(resonance_hz, q, c0, 0.09, 0.01);
        let readings = with_extra(&readings, resonance_hz, c0, extra);
        let plain =
            fit(&readings, Motion::Settled, None, Stated::alone(resonance_hz, &stated)).unwrap();
        let found =
            fit(&readings, Motion::Settled, None, with(resonance_hz, &stated, &extra)).unwrap();
        let context = format!("{extra:?}: {found:?}; without: {plain:?}");
        assert!((found.resonance_hz - resonance_hz).abs() < 5e-3, "{context}");
        assert!(found.beside_sigmas < 2.0 && found.scatter < 0.2, "{context}");
        assert!(plain.scatter > 4.0 * found.scatter, "{context}");
        if let Some(found) =
            fit(&readings, Motion::Settled, None, with(resonance_hz, &stated, &other))
        {
            assert!(found.beside_sigmas > 5.0, "{other:?}: {found:?}");
        }
    }
}

#[test]
fn slopes_by_what_is_beside_the_circuit_agree_with_differences() {
    let readings: Vec<Reading> =
        steady(141.3, 34.0, 21e-9, 0.09, 0.01).iter().step_by(5).copied().collect();
    for [extra, _] in extras() {
        let (kind, beside) = Beside::of(&extra, &STATED, 20e-9).unwrap();
        let stays = stays(&readings, 20e-9, 0.0);
        let count = stays.len();
        let trace = Trace { stays, is_ringing: false, first_gap_s: 0.0, beside: Some(kind) };
        let at = Unknowns {
            circuit: [141.0_f64.ln(), 30.0_f64.ln(), 1.0, 0.1, 0.02],
            beside,
            amplitudes: vec![Complex64::ZERO; count],
            steps: vec![Vec::new(); count],
        };
        let weights = trace.weights(&at, 0.005 * 0.005);
        let normal = trace.normal(&at, &weights, None);
        for unknown in 0..CIRCUIT + kind.count() {
            let scale = if kind == Beside::Stray && unknown >= CIRCUIT { 1e-6 } else { 1.0 };
            let cost = |h: f64| {
                let mut step = Step { global: [0.0; GLOBAL], local: vec![Vec::new(); count] };
                step.global[unknown] = h * scale;
                trace.normal(&at.moved(&step, &weights), &weights, None).cost
            };
            let h = 1e-6;
            let found = (cost(h) - cost(-h)) / (2.0 * h);
            let slope = normal.right(unknown) * scale;
            assert!(
                (found + 2.0 * slope).abs() < 1e-3 * slope.abs().max(1.0),
                "{extra:?} {unknown}: {found} {slope}"
            );
        }
    }
}

#[test]
fn slopes_agree_with_differences() {
    let readings = steady(141.3, 34.0, 21e-9, 0.09, 0.01);
    let mut two: Vec<Reading> = readings.iter().step_by(9).copied().collect();
    // Two more at the same frequency, so that there are steps of time.
    for (k, after_s) in [(1, 0.15), (2, 0.31)] {
        let first = two[0];
        two.insert(k, Reading { settle_s: first.settle_s + after_s, ..first });
    }
    let course = |time_s| Beside::Moving(Course { span_s: 18.0, time_s, stated_s: 7.0 });
    for beside in [None, Some(course(f64::INFINITY)), Some(course(5.0))] {
        let stays = stays(&two, 20e-9, 0.0);
        let trace = Trace { stays, is_ringing: true, first_gap_s: 0.0, beside };
        let at = Unknowns {
            circuit: [141.0_f64.ln(), 30.0_f64.ln(), 1.0, 0.1, 0.02],
            beside: [0.01, 0.0, 0.0],
            amplitudes: trace.stays.iter().map(|_| Complex64::new(300.0, -200.0)).collect(),
            steps: trace.stays.iter().map(|stay| vec![0.3; stay.samples.len() - 1]).collect(),
        };
        let weights = trace.weights(&at, 0.005 * 0.005);
        let cost = |step: Step| trace.normal(&at.moved(&step, &weights), &weights, None).cost;
        let still = || Step {
            global: [0.0; GLOBAL],
            local: trace.stays.iter().map(|stay| vec![0.0; stay.samples.len() + 1]).collect(),
        };
        let normal = trace.normal(&at, &weights, None);
        let check = |what: String, slope: f64, change: &dyn Fn(&mut Step, f64)| {
            let h = 1e-6;
            let [mut up, mut down] = [still(), still()];
            change(&mut up, h);
            change(&mut down, -h);
            let found = (cost(up) - cost(down)) / (2.0 * h);
            assert!(
                (found + 2.0 * slope).abs() < 1e-3 * slope.abs().max(1.0),
                "{beside:?} {what}: {found} {slope}"
            );
        };
        for unknown in 0..CIRCUIT + beside.map_or(0, Beside::count) {
            let change = |step: &mut Step, h: f64| step.global[unknown] = h;
            check(format!("{unknown}"), normal.right(unknown), &change);
        }
        for unknown in 0..4 {
            let slope = normal.right_of_part(0, unknown);
            check(format!("local {unknown}"), slope, &|step, h| step.local[0][unknown] = h);
        }
    }
}

/// Readings of this time during the free decay of a sensor whose resonance moves, eight in each stay. The motion is
/// integrated: q' = (s − jω)q + drive, whose forced part at rest is the motional admittance.
fn moving(at_hz: impl Fn(f64) -> f64, q: f64, integration_s: f64) -> Vec<Reading> {
    const STEPS: u32 = 400;
    const READINGS: u32 = 8;
    let (c0, ratio, loss, gap_s) = (21e-9, 0.09, 0.01, integration_s / 14.0);
    let mut readings = Vec::new();
    let mut begin_s = 0.0;
    for n in 0..10_u32 {
        let frequency_hz = 141.0 + [-2.0, 1.5, -0.7, 2.6, 0.3][n as usize % 5];
        let omega = TAU * frequency_hz;
        let motional = |s: f64| {
            let resonance_hz = at_hz(s);
            let u = frequency_hz / resonance_hz;
            let gain = ratio * Complex64::new(1.0 - u * u, u / q).inv();
            let omega_s = TAU * resonance_hz;
            let pole = omega_s * Complex64::new(-0.5 / q, (1.0 - 0.25 / (q * q)).sqrt());
            (Complex64::new(0.0, omega * c0) * gain, pole - Complex64::new(0.0, omega))
        };
        let mut motion = motional(begin_s).0 * Complex64::from_polar(2.0, 2.0 * f64::from(n));
        for k in 0..READINGS {
            let started_s = begin_s + f64::from(k) * (integration_s + gap_s);
            let mut sum = Complex64::ZERO;
            for (span_s, from_s, is_read) in
                [(integration_s, started_s, true), (gap_s, started_s + integration_s, false)]
            {
                let step_s = span_s / f64::from(STEPS);
                for i in 0..STEPS {
                    // Exact for a resonance that rests during the step.
                    let (rest, lambda) = motional(from_s + step_s * (f64::from(i) + 0.5));
                    let (away, grown) = (motion - rest, (lambda * step_s).exp());
                    if is_read {
                        sum += rest + away * (grown - 1.0) / (lambda * step_s);
                    }
                    motion = rest + away * grown;
                }
            }
            let of_capacitance = Complex64::new(0.0, omega * c0) * Complex64::new(1.0, -loss);
            let z = (of_capacitance + sum / f64::from(STEPS)).inv();
            let (resistance_ohm, reactance_ohm) = (Some(z.re), Some(z.im));
            let flag = Flag::Normal;
            let settle_s = started_s - begin_s;
            readings.push(Reading {
                frequency_hz,
                resistance_ohm,
                reactance_ohm,
                started_s: begin_s,
                settle_s,
                integration_s,
                flag,
            });
        }
        begin_s += f64::from(READINGS) * (integration_s + gap_s);
    }
    readings
}

/// The forced motion is late by up to the time constant of the free decay, 0.14 s, in which the slowest of these moves by
/// eight times the tolerance, and the free decay is turned meanwhile. The last of them moves by a tenth of a linewidth
/// in that time.
#[test]
fn readings_of_an_integrated_motion_have_the_resonance_of_their_time() {
    let (q, change) = (60.0, 0.005);
    let stated_circuit = Circuit { quality_factor: q, ..STATED };
    let slow = [0.8, 4.0, f64::INFINITY].map(|time_s| (0.14, time_s));
    for (integration_s, time_s) in slow.into_iter().chain([(0.014, f64::INFINITY)]) {
        let span_s = 11.99 * integration_s / 0.14;
        let course = Course { span_s, time_s, stated_s: 0.0 };
        let at_hz = |s: f64| 141.3 * (change * course.done(s)).exp();
        let readings = moving(at_hz, q, integration_s);
        let extra = if time_s.is_finite() {
            Extra::Relaxation { change, time_s }
        } else {
            Extra::Drift { change: 0.5 * change }
        };
        for stated_s in [0.15 * span_s, 0.75 * span_s] {
            let (extra, circuit) = (Some(&extra), &stated_circuit);
            let effective_time_s = Some(stated_s);
            let resonance_hz = at_hz(stated_s);
            let stated = Stated { resonance_hz, circuit, extra, effective_time_s };
            let found = fit(&readings, Motion::RINGING, None, stated).unwrap();
            let error_hz = found.resonance_hz - resonance_hz;
            let context = format!("{time_s} s, at {stated_s} s: {error_hz} Hz, {found:?}");
            assert!(error_hz.abs() < 1e-3 && found.beside_sigmas < 0.5, "{context}");
            assert!(found.scatter < 0.3, "{context}");
        }
    }
}

#[test]
fn no_fit_is_made_of_nothing() {
    assert!(fit(&[], Motion::RINGING, None, Stated::alone(140.0, &STATED)).is_none());
    let one = steady(141.3, 34.0, 21e-9, 0.09, 0.01)[0];
    // What is known beforehand decides then; it must not be called precise.
    if let Some(found) = fit(&[one], Motion::RINGING, None, Stated::alone(140.0, &STATED)) {
        assert!(found.sigma_hz > 1.0, "{found:?}");
    }
}

#[test]
fn a_second_mode_shifts_a_resonance_by_no_more_than_its_widened_deviation() {
    for (share, place) in [(0.02, 1.5), (0.05, 1.5), (0.05, -2.0), (0.1, 3.0)] {
        let (resonance_hz, q, c0) = (141.3, 34.0, 21e-9);
        let mut readings = steady(resonance_hz, q, c0, 0.09, 0.01);
        for reading in &mut readings {
            let omega = TAU * reading.frequency_hz;
            let u = reading.frequency_hz / (resonance_hz * (1.0 + place / q));
            let branch = Complex64::new(1.0 - u * u, u / q).inv() * 0.09 * share;
            let z = (measured(reading).inv() + Complex64::new(0.0, omega * c0) * branch).inv();
            (reading.resistance_ohm, reading.reactance_ohm) = (Some(z.re), Some(z.im));
        }
        let found =
            fit(&readings, Motion::RINGING, None, Stated::alone(resonance_hz, &STATED)).unwrap();
        let error_hz = (found.resonance_hz - resonance_hz).abs();
        let context = format!("{share} at {place}: {error_hz} {found:?}");
        assert!(found.sigma_hz < found.with_mode_hz, "{context}");
        assert!(error_hz < 3.0 * found.with_mode_hz, "{context}");
    }
}

#[test]
fn a_resonance_that_moves_evenly_has_the_value_of_the_fit_at_the_effective_time() {
    let middle_s = 12.5;
    for drift_hz_per_s in [-0.02, 0.002, 0.02] {
        let at = |time_s: f64| 141.3 + drift_hz_per_s * (time_s - middle_s);
        let moving = |k: usize| steady(at(k as f64 + 0.57), 34.0, 21e-9, 0.09, 0.01)[k];
        // A part of the sweep, so that the resonance is not passed in its middle.
        let readings: Vec<Reading> = (0..15).map(moving).collect();
        let found =
            fit(&readings, Motion::RINGING, None, Stated::alone(at(11.0), &STATED)).unwrap();
        let time_s = found.effective_time_s.unwrap();
        let error_hz = (found.resonance_hz - at(time_s)).abs();
        let by_drift_hz = (drift_hz_per_s * 14.0).abs();
        // What is expected of any sensor draws a little too.
        let allowed_hz = 0.1 * by_drift_hz + 0.01 * found.sigma_hz;
        assert!(error_hz < allowed_hz, "{drift_hz_per_s}: {time_s} {found:?}");
        assert!((time_s - 7.0).abs() > 2.0, "the middle would be as good: {time_s}");
    }
}

#[test]
fn a_resonance_that_moves_is_followed_from_any_stated_time() {
    let (span_s, time_s) = (24.14, 9.0);
    for is_even in [true, false] {
        let done = |s: f64| {
            let part = s / span_s;
            if is_even {
                part
            } else {
                (1.0 - (-s / time_s).exp()) / (1.0 - (-span_s / time_s).exp())
            }
        };
        let change = 0.02;
        let at = |s: f64| 141.3 * (change * done(s)).exp();
        // A sweep in one direction would not distinguish it from another resonance.
        let moving = |k: usize| {
            let reading = steady(at(k as f64 + 0.07), 34.0, 21e-9, 0.09, 0.01)[7 * k % 25];
            Reading { started_s: k as f64, ..reading }
        };
        let readings: Vec<Reading> = (0..25).map(moving).collect();
        let extra = if is_even {
            Extra::Drift { change: 0.5 * change }
        } else {
            Extra::Relaxation { change, time_s }
        };
        for stated_s in [5.0, 20.0] {
            let effective_time_s = Some(readings[0].begin_s() + stated_s);
            let (extra, circuit) = (Some(&extra), &STATED);
            let stated = Stated { resonance_hz: at(stated_s), circuit, extra, effective_time_s };
            let found = fit(&readings, Motion::RINGING, None, stated).unwrap();
            let error_hz = (found.resonance_hz - at(stated_s)).abs();
            let context = format!("{is_even} {stated_s} s: {error_hz} Hz, {found:?}");
            assert!(error_hz < 0.02 && found.beside_sigmas < 2.0, "{context}");
            assert!(found.effective_time_s.unwrap() < readings[24].end_s(), "{context}");
        }
    }
}
