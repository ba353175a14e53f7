//! The Cramér–Rao bound: the smallest standard deviation of any unbiased estimator of the resonance
//! for the given readings.
//!
//! The derivatives of the readings by the five circuit elements are differences of the simulated
//! plant. The bound therefore includes settling and ring-up, and shares no code with an estimator.

use num_complex::Complex64;
use rig_contact::Circuit;
use rig_model::SweepPoint;
use rig_sim::plant::Plant;

/// Elements of the circuit: ln resonance first, ln quality, ln C0, ln C1/C0, loss tangent.
const ELEMENTS: usize = 5;
/// Half the step of a central difference. Its error is the square of this; rounding is far below.
const STEP: f64 = 1e-5;

/// Fisher information of the elements, for noise of variance 1 at ten cycles.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Information([[f64; ELEMENTS]; ELEMENTS]);

impl Information {
    /// The information of points measured in sequence from rest.
    pub(crate) fn in_time(circuit: &Circuit, points: &[SweepPoint]) -> Self {
        let mut plants =
            PerturbedPlants::at_rest(circuit, points.first().map_or(1.0, |p| p.frequency_hz));
        points.iter().fold(Self::default(), |sum, point| sum.plus(1.0, &plants.visit(point)))
    }

    /// The information of settled points.
    pub(crate) fn settled(circuit: &Circuit, points: &[SweepPoint]) -> Self {
        let pairs: [[Circuit; 2]; ELEMENTS] =
            std::array::from_fn(|element| [STEP, -STEP].map(|by| moved(circuit, element, by)));
        points.iter().fold(Self::default(), |sum, point| {
            let settled = |circuit: Circuit| circuit.impedance_ohm(point.frequency_hz);
            sum.plus(1.0, &Self::of(point, &pairs.map(|pair| pair.map(settled))))
        })
    }

    /// The information of one point, from its impedance with each element one step larger and one
    /// step smaller.
    fn of(point: &SweepPoint, pairs: &[[Complex64; 2]; ELEMENTS]) -> Self {
        let slopes = pairs.map(|[up, down]| (up / down).ln() / (2.0 * STEP));
        let weight = 0.1 * f64::from(point.cycles);
        Self(slopes.map(|one| slopes.map(|other| weight * (one.conj() * other).re)))
    }

    /// The sum of this information and `times` times the other.
    pub(crate) fn plus(&self, times: f64, other: &Self) -> Self {
        let mut sum = *self;
        for (row, other) in sum.0.iter_mut().zip(&other.0) {
            for (cell, other) in row.iter_mut().zip(other) {
                *cell += times * other;
            }
        }
        sum
    }

    /// The bound of the relative standard deviation of the resonance for noise 1 at ten cycles;
    /// infinite when the readings do not determine it.
    pub(crate) fn relative_bound(&self) -> f64 {
        let column = self.inverse_column();
        column.map_or(f64::INFINITY, |column| column[0].sqrt())
    }

    /// The rate at which the variance of ln resonance falls when this other information is added.
    pub(crate) fn gain(&self, other: &Self) -> f64 {
        let Some(column) = self.inverse_column() else { return 0.0 };
        let mut sum = 0.0;
        for i in 0..ELEMENTS {
            for j in 0..ELEMENTS {
                sum += column[i] * other.0[i][j] * column[j];
            }
        }
        sum
    }

    /// The first column of the inverse, by elimination from the last element to the first.
    fn inverse_column(&self) -> Option<[f64; ELEMENTS]> {
        // A pivot below this share of its diagonal element is rounding.
        const SINGULAR: f64 = 1e-13;
        let mut rest = self.0;
        for k in (0..ELEMENTS).rev() {
            let is_determined = rest[k][k] > SINGULAR * self.0[k][k];
            if !is_determined {
                return None;
            }
            for i in 0..k {
                let factor = rest[i][k] / rest[k][k];
                let pivot = rest[k];
                for (cell, pivot) in rest[i][..k].iter_mut().zip(pivot) {
                    *cell -= factor * pivot;
                }
            }
        }
        // Forward substitution L x = e₁; the columns right of the diagonal are no longer needed.
        let mut column = [0.0; ELEMENTS];
        column[0] = 1.0 / rest[0][0];
        for k in 1..ELEMENTS {
            let sum: f64 = (0..k).map(|j| rest[k][j] * column[j]).sum();
            column[k] = -sum / rest[k][k];
        }
        Some(column)
    }
}

/// Simulated plants that see the same drive and differ by one step of one element.
struct PerturbedPlants([[Plant; 2]; ELEMENTS]);

impl PerturbedPlants {
    fn at_rest(circuit: &Circuit, frequency_hz: f64) -> Self {
        let plant = |element, by| {
            let circuit = moved(circuit, element, by);
            Plant::at_rest(circuit, frequency_hz).expect("sensors near one that rings ring")
        };
        Self(std::array::from_fn(|element| [STEP, -STEP].map(|by| plant(element, by))))
    }

    /// The information of one more point.
    fn visit(&mut self, point: &SweepPoint) -> Information {
        let pairs = self.0.each_mut().map(|pair| {
            pair.each_mut().map(|plant| {
                plant.set_frequency(point.frequency_hz);
                plant.advance(point.settle_s);
                plant.measure(point.cycles)
            })
        });
        Information::of(point, &pairs)
    }
}

/// The bound times the square root of the integration time, for noise 1 at ten cycles, without
/// waiting and with the best frequencies: Hz·√s.
///
/// # Source
/// The multiplicative algorithm for optimal designs: Silvey, Titterington and Torsney,
/// Communications in Statistics A 7 (1978) 1379.
pub(crate) fn integration_floor(circuit: &Circuit, frequencies_hz: &[f64]) -> f64 {
    const ROUNDS: usize = 400;
    let per_second: Vec<Information> = frequencies_hz
        .iter()
        .map(|&frequency_hz| {
            let point = SweepPoint { frequency_hz, settle_s: 0.0, cycles: 1 };
            let one_cycle = Information::settled(circuit, &[point]);
            Information::default().plus(frequency_hz, &one_cycle)
        })
        .collect();
    let mut shares = vec![1.0 / per_second.len() as f64; per_second.len()];
    let all = |shares: &[f64]| {
        let add = |sum: Information, (share, one): (&f64, &Information)| sum.plus(*share, one);
        shares.iter().zip(&per_second).fold(Information::default(), add)
    };
    for _ in 0..ROUNDS {
        let design = all(&shares);
        for (share, one) in shares.iter_mut().zip(&per_second) {
            *share *= design.gain(one).sqrt();
        }
        let total: f64 = shares.iter().sum();
        for share in &mut shares {
            *share /= total;
        }
    }
    circuit.series_resonance_hz * all(&shares).relative_bound()
}

/// The circuit with one element a little larger.
fn moved(circuit: &Circuit, element: usize, by: f64) -> Circuit {
    let mut circuit = *circuit;
    match element {
        0 => circuit.series_resonance_hz *= by.exp(),
        1 => circuit.q *= by.exp(),
        2 => circuit.capacitance_f *= by.exp(),
        3 => circuit.capacitance_ratio *= by.exp(),
        _ => circuit.dielectric_loss += by,
    }
    circuit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analyzer::{WINDOW, sensor};

    /// σ√N/noise of a uniform sweep with all four elements unknown, and of the best design, for the
    /// resonance at 140 Hz, computed independently. Dielectric loss costs a uniform sweep at most a
    /// thousandth and the best design at most a tenth.
    #[test]
    fn the_bound_is_that_of_an_independent_computation() {
        for (q, coupling, uniform, best) in [
            (10.0, 0.02, 79.56, 53.36),
            (10.0, 0.1, 18.85, 12.28),
            (30.0, 0.02, 16.39, 6.39),
            (30.0, 0.1, 7.20, 2.65),
            (100.0, 0.02, 4.34, 0.91),
            (100.0, 0.1, 3.61, 0.71),
        ] {
            let circuit = sensor(140.0, q, coupling);
            let points = WINDOW.evenly(401, 0.0, 10);
            let found = Information::settled(&circuit, &points).relative_bound();
            let found = 140.0 * found * 401.0_f64.sqrt();
            assert!((found / uniform - 1.0).abs() < 0.01, "{q} {coupling}: {found} {uniform}");
            let frequencies: Vec<f64> = points.iter().map(|point| point.frequency_hz).collect();
            // Ten cycles last one fourteenth of a second.
            let floor = integration_floor(&circuit, &frequencies) * 14.0_f64.sqrt();
            assert!((0.97..1.12).contains(&(floor / best)), "{q} {coupling}: {floor} {best}");
        }
    }

    #[test]
    fn the_information_of_settled_readings_is_that_of_the_settled_circuit() {
        let circuit = sensor(140.0, 30.0, 0.1);
        let bounds = |settle_s: f64| {
            let points = WINDOW.evenly(21, settle_s, 10);
            let in_time = Information::in_time(&circuit, &points).relative_bound();
            in_time / Information::settled(&circuit, &points).relative_bound()
        };
        assert!((bounds(2.0) - 1.0).abs() < 1e-6, "{}", bounds(2.0));
        assert!((bounds(0.0) - 1.0).abs() > 0.01, "{}", bounds(0.0));
    }

    #[test]
    fn five_unknowns_are_not_determined_by_two_frequencies() {
        let circuit = sensor(140.0, 30.0, 0.1);
        let two = WINDOW.evenly(2, 0.0, 10);
        let two = Information::settled(&circuit, &two).relative_bound();
        let three = WINDOW.evenly(3, 0.0, 10);
        let three = Information::settled(&circuit, &three).relative_bound();
        // The former is finite only by the rounding of the slopes.
        assert!(three < 10.0 && two > 1e4, "{two} {three}");
    }
}
