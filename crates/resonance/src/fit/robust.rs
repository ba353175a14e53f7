//! A start value that is robust against a few wrong readings.
//!
//! One reading ten times too large outweighs all others in a least-squares fit. So the circuit is
//! fitted repeatedly to the readings that it describes best, until these no longer change. The initial
//! sets are all readings, those that agree with few or with more neighbours, and every third one.
//!
//! # Source
//! Rousseeuw and Van Driessen, Data Mining and Knowledge Discovery 12 (2006) 29 (concentration
//! steps of the least trimmed squares).

use std::f64::consts::TAU;

use num_complex::Complex64;
use rig_model::Reading;

use crate::{
    Circuit,
    circuit::kernel::PARAMETERS,
    circuit::points::Points,
    circuit::points::weight,
    circuit::trace::complex_ohm,
    diagnose::outliers::CAUCHY_MEANS,
    fit::solve::{rational_start, solve},
    fit::steady::circuit_of,
    noise::VARIANCE_MIN,
};

/// Fraction of the readings that a set keeps. It leaves out more outliers than the fifth that is accepted,
/// so that a sweep with a few too many is refused because of them.
const KEPT: f64 = 0.7;
/// Largest number of rounds that select the best-fitting readings again.
const ROUNDS: usize = 10;
/// Number of initial sets that are spread over the sweep.
const SPREAD_SETS: usize = 3;
/// Numbers of neighbours on each side with which a reading is compared: few for a narrow resonance, more
/// for bursts of wrong readings.
const NEIGHBOURS: [usize; 2] = [3, 7];
/// A reading is excluded from a start if its deviation in logarithms exceeds `OFF` and `OFF_TIMES`
/// times the scatter of its neighbours.
const OFF: f64 = 0.05;
const OFF_TIMES: f64 = 4.0;

/// The circuit that describes most of the readings, with dielectric loss. `None` if no subset of them
/// shows a resonance.
pub(crate) fn circuit(readings: &[Reading]) -> Option<Circuit> {
    let mut readings: Vec<Reading> =
        readings.iter().filter(|reading| reading.impedance().is_some()).copied().collect();
    readings.sort_by(|a, b| a.frequency_hz.total_cmp(&b.frequency_hz));
    let everything: Vec<usize> = (0..readings.len()).collect();
    let mut sets: Vec<Vec<usize>> =
        NEIGHBOURS.iter().map(|&neighbours| agreeing(&readings, neighbours)).collect();
    sets.push(everything.clone());
    let every = |first: usize| everything.iter().copied().skip(first).step_by(SPREAD_SETS);
    sets.extend((0..SPREAD_SETS).map(|first| every(first).collect()));
    let found: Vec<(Circuit, f64)> =
        sets.into_iter().filter_map(|set| concentrate(&readings, set)).collect();
    let least = found.iter().map(|(_, cost)| *cost).fold(f64::INFINITY, f64::min);
    let usual = (least / (KEPT * readings.len() as f64)).max(VARIANCE_MIN);
    // A narrow resonance is seen by fewer readings than are left out, so that a capacitor describes the
    // rest as well. All readings count, each by the logarithm of its deviation.
    let deviation = |circuit: &Circuit| -> f64 {
        readings.iter().map(|one| (size(one, circuit) / (CAUCHY_MEANS * usual)).ln_1p()).sum()
    };
    found
        .into_iter()
        .map(|(circuit, _)| (deviation(&circuit), circuit))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, circuit)| circuit)
}

/// Iterates until a set of readings is the best-fitting one for its own circuit; returns the circuit
/// and the cost.
fn concentrate(readings: &[Reading], mut set: Vec<usize>) -> Option<(Circuit, f64)> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below a count")]
    let kept = (KEPT * readings.len() as f64).ceil() as usize;
    let mut points = Points::default();
    let mut best: Option<(Circuit, f64)> = None;
    for _ in 0..ROUNDS {
        let chosen: Vec<Reading> = set.iter().map(|&i| readings[i]).collect();
        points.load(&chosen).ok()?;
        let Some(start) = rational_start(&points) else { break };
        let solution = solve(&points, start, PARAMETERS);
        let Some(circuit) = circuit_of(&points, &solution) else { break };
        let mut sizes: Vec<(f64, usize)> =
            readings.iter().enumerate().map(|(i, one)| (size(one, &circuit), i)).collect();
        sizes.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        sizes.truncate(kept);
        let cost = sizes.iter().map(|(size, _)| size).sum();
        if best.is_some_and(|(_, least)| cost >= least) {
            break;
        }
        best = Some((circuit, cost));
        set = sizes.into_iter().map(|(_, i)| i).collect();
        set.sort_unstable();
    }
    best
}

/// Deviation of a reading from a circuit: its weight times the squared relative error, defined as in
/// [`crate::circuit::trace`], which is symmetric for values too large and too small.
fn size(reading: &Reading, circuit: &Circuit) -> f64 {
    let Some(impedance) = complex_ohm(reading) else { return f64::INFINITY };
    let x = impedance * circuit.admittance_siemens(reading.frequency_hz);
    weight(reading) * (2.0 * (x - 1.0) / (x + 1.0)).norm_sqr()
}

/// The readings, sorted by frequency, whose values are near the median of their neighbours.
fn agreeing(readings: &[Reading], neighbours: usize) -> Vec<usize> {
    // Capacitance hardly changes far from the resonance.
    let capacitances: Vec<Complex64> = readings
        .iter()
        .map(|one| {
            let turn = Complex64::new(0.0, TAU * one.frequency_hz);
            complex_ohm(one).map_or(Complex64::ZERO, |impedance| 1.0 / (turn * impedance))
        })
        .collect();
    let agrees = |&i: &usize| {
        let first = i.saturating_sub(neighbours);
        let around: Vec<Complex64> = capacitances[first..]
            .iter()
            .take(neighbours + i - first + 1)
            .enumerate()
            .filter(|(n, _)| first + n != i)
            .map(|(_, &one)| one)
            .collect();
        let middle = Complex64::new(
            median(around.iter().map(|one| one.re).collect()),
            median(around.iter().map(|one| one.im).collect()),
        );
        let off = |one: Complex64| (one / middle).ln().norm();
        let usual = median(around.iter().map(|&one| off(one)).collect());
        off(capacitances[i]) < OFF + OFF_TIMES * usual
    };
    (0..readings.len()).filter(agrees).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
