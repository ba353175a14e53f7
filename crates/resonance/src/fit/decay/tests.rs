//! Tests that the gradient is that of the cost and that the fit recovers the circuit.

use super::*;
use crate::circuit::trace::ExtraTerm;

/// Stays of a circuit whose readings are slightly late and slightly wrong.
fn stays(at: &ModelEstimate) -> Stays {
    let known = Known::with(2.5e-5).with_first_gap(1e-3);
    let (all, last, work) = (Vec::new(), None, Cell::new(0));
    let mut stays = Stays { all, unit_farad: 1.0, known, bench: None, excluded: 0, last, work };
    let mut amplitude = Amplitude::new(at);
    for (n, frequency_hz) in [137.2, 140.9, 138.5, 143.0].into_iter().enumerate() {
        let since_s = 0.09;
        let square = amplitude.change(frequency_hz, since_s);
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
