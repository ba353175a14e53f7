//! How well the last no-load resonance knows the change of the impedance between the frequencies of the self-test.
//!
//! A loose sweep of some ten readings knows its quality factor to ten percent. What the self-test expects is then as
//! uncertain, and so is the time for which the sensor rings after a change of frequency.

use rig_resonance::{Circuit, Resonance};

use super::{TEST_LINEWIDTHS, impedance, less, size_ohm};

/// The change of the impedance from one frequency of the self-test to the other may deviate from the expected change by
/// this part of it: the rest of the ring, the noise, and what the circuit leaves out.
pub(super) const TOLERANCE: f64 = 0.5;

/// And by this many standard deviations of the expected change: one self-test in a few hundred deviates by more, and
/// only one with the largest rest of the ring then uses up the tolerance too.
const SIGMAS: f64 = 3.0;

/// Both together at most. The readings of an analyzer that does not follow the frequency deviate by all of the expected
/// change, whatever that is, but for their noise.
const TOLERANCE_MAX: f64 = 0.8;

/// A quality factor this many standard deviations higher than the fitted one is possible, and the sensor then rings longer.
const RING_SIGMAS: f64 = 2.0;

/// The change of the impedance from one frequency to the other may deviate from the expected one by this part of it. A
/// reference that says nothing although it was measured again makes no allowance: a rig that latches for nothing is better
/// than one that trusts an analyzer which does not follow the frequency.
pub(super) fn tolerance(no_load: &Resonance, from_hz: f64, to_hz: f64) -> f64 {
    match allowance(no_load, from_hz, to_hz) {
        part if part < 1.0 => part.min(TOLERANCE_MAX),
        _ => TOLERANCE,
    }
}

/// Whether the circuit of a no-load resonance is so uncertain that its self-test says nothing: tolerance and standard
/// deviations together reach the change itself, by which an analyzer that does not follow the frequency deviates.
pub(crate) fn says_nothing(no_load: &Resonance) -> bool {
    let at_hz = no_load.resonance_hz;
    let test_hz = at_hz * (1.0 - TEST_LINEWIDTHS / no_load.q);
    allowance(no_load, test_hz, at_hz) >= 1.0
}

/// Tolerance and standard deviations together, as a part of the expected change.
fn allowance(no_load: &Resonance, from_hz: f64, to_hz: f64) -> f64 {
    SIGMAS.mul_add(sigma(no_load, from_hz, to_hz), TOLERANCE)
}

/// The longest time constant of the ring that is likely, s.
pub(crate) fn ring_time_constant_s(no_load: &Resonance) -> f64 {
    let sigma_q = no_load.covariance[1][1].max(0.0).sqrt();
    RING_SIGMAS.mul_add(sigma_q, no_load.q) / (std::f64::consts::PI * no_load.resonance_hz)
}

/// The standard deviation of the expected change, of both parts together, relative to the change: that of resonance,
/// quality factor, capacitances and loss as the fit states them, with their correlations.
fn sigma(no_load: &Resonance, from_hz: f64, to_hz: f64) -> f64 {
    let circuit = no_load.circuit();
    let change = |circuit: &Circuit| less(impedance(circuit, to_hz), impedance(circuit, from_hz));
    let moved = |by: [f64; 5]| Circuit {
        resonance_hz: circuit.resonance_hz + by[0],
        q: circuit.q + by[1],
        c0_farad: circuit.c0_farad + by[2],
        c1_farad: circuit.c1_farad + by[3],
        loss_tangent: circuit.loss_tangent + by[4],
    };
    let variance: f64 = causes(&no_load.covariance)
        .map(|by| {
            let (more, less_by) = (change(&moved(by)), change(&moved(by.map(|value| -value))));
            (0.5 * size_ohm(less(more, less_by))).powi(2)
        })
        .iter()
        .sum();
    let relative = variance.sqrt() / size_ohm(change(&circuit));
    // A deviation that cannot be computed is no knowledge.
    if relative.is_finite() { relative } else { f64::INFINITY }
}

/// Independent causes whose sum has this covariance, each with one standard deviation: the columns of its Cholesky
/// factor. A value that was not fitted has none.
fn causes(covariance: &[[f64; 5]; 5]) -> [[f64; 5]; 5] {
    let mut causes = [[0.0; 5]; 5];
    for cause in 0..5 {
        let known = |row: usize| (0..cause).map(|k| causes[k][row] * causes[k][cause]).sum::<f64>();
        let left = covariance[cause][cause] - known(cause);
        if left <= ROUNDING * covariance[cause][cause] {
            continue;
        }
        let sigma = left.sqrt();
        let mut column = [0.0; 5];
        for row in cause..5 {
            column[row] = (covariance[row][cause] - known(row)) / sigma;
        }
        causes[cause] = column;
    }
    causes
}

/// A part of a variance that others explain but for this is rounding.
const ROUNDING: f64 = 1e-9;
