//! Tests that the gradient is that of the cost and that the fit recovers the circuit.

use super::{model::Branch, *};
use crate::circuit::trace::ExtraTerm;

/// Stays of a circuit whose readings are slightly late and slightly wrong.
fn stays(at: &ModelEstimate) -> Stays {
    moving(at, &[137.2, 140.9, 138.5, 143.0], |_| 0.0)
}

/// The same at these frequencies, with a resonance that differs by this much, Hz, at a time in s.
fn moving(at: &ModelEstimate, frequencies_hz: &[f64], off_hz: impl Fn(f64) -> f64) -> Stays {
    let known = Known::with(2.5e-5).with_first_gap(1e-3);
    let (all, last, work) = (Vec::new(), None, Cell::new(0));
    let mut stays =
        Stays { all, unit_farad: 1.0, known, bench: None, drift: None, excluded: 0, last, work };
    let mut amplitude = Amplitude::new(at);
    for (n, &frequency_hz) in frequencies_hz.iter().enumerate() {
        let since_s = 0.09;
        let square = amplitude.change(frequency_hz, since_s);
        let resonance_hz = at.resonance_hz + off_hz(0.045 + since_s * n as f64);
        let at = &ModelEstimate { resonance_hz, ..*at };
        let model = Model::new(at, frequency_hz);
        let a = 0.7 * Complex64::from_polar(square.sqrt() * model.unit, 2.0 * n as f64);
        let samples = (0..6)
            .map(|k| {
                let wave = |x: f64| (x + f64::from(k) + 1.7 * n as f64).sin();
                let (start_s, integration_s) = (0.016 * f64::from(k), 2.0 / frequency_hz);
                let late_s = if k == 0 { 0.0 } else { 0.7e-3 * wave(0.3) };
                let e = model.decayed(start_s + late_s, integration_s, &mut None).value;
                let error = 1.0 + 0.01 * Complex64::new(wave(1.0), wave(2.0));
                let impedance = error / (model.steady + a * e);
                Sample { start_s, integration_s, impedance: Some(impedance), length: 0.2 }
            })
            .collect();
        stays.all.push(Stay { frequency_hz, since_s, samples });
    }
    stays
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

/// Both flanks in turn, for three seconds.
fn flanks_hz() -> Vec<f64> {
    (0..34).map(|n| 140.0 + [-1.2, 0.9, -0.4, 1.6, 0.2][n % 5]).collect()
}

/// The stays with the drift that they require, and the resonance at the effective time with its standard deviation, Hz;
/// `None` if they require none.
fn followed(stays: &Stays) -> Option<(Stays, Hypothesis)> {
    let expected = CircuitPrior::any(30.0);
    let constant = stays.minimum(AT, &expected);
    let noise = crate::noise::PooledVariance::known(&crate::NoisePrior {
        at_ten_cycles: stays.known.variance.sqrt(),
        degrees_of_freedom: 1000.0,
    });
    let window = rig_model::Window { min_hz: 125.0, max_hz: 160.0 };
    stays.following(&constant, &expected, (noise, window))
}

#[test]
fn a_resonance_that_moves_is_followed_and_stated_for_its_effective_time() {
    for time_s in [0.7, 2.0, f64::INFINITY] {
        for change_hz in [-1.0, -0.3, 0.3, 1.0] {
            let off_hz = |s: f64| {
                let part = if time_s.is_finite() { 1.0 - (-s / time_s).exp() } else { s / 3.0 };
                change_hz * part
            };
            let stays = moving(&AT, &flanks_hz(), off_hz);
            let (found, best) = followed(&stays).expect("it moves by many standard deviations");
            let at_s = found.drift.expect("a drift").effective_s();
            let sigma_hz = best.sigma_hz().hypot(best.at.resonance_hz * found.sigma_by_drift());
            let error_hz = best.at.resonance_hz - AT.resonance_hz - off_hz(at_s);
            let context =
                format!("{change_hz} Hz in {time_s} s: {error_hz} ± {sigma_hz} at {at_s}");
            assert!(error_hz.abs() < 3.5 * sigma_hz && sigma_hz < 0.05, "{context}");
            assert!((0.0..3.1).contains(&at_s), "{context}");
            // Without it, the readings are not described.
            assert!(
                best.normal.cost < 0.9 * stays.minimum(AT, &CircuitPrior::any(30.0)).normal.cost
            );
        }
    }
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
