//! The sums of the readings of a stay as normal equations, and the elimination of the unknowns of that stay.

use num_complex::Complex64;

use super::{
    Known, Sample,
    model::{Decayed, Model, Moving},
};
use crate::{circuit::trace::CIRCUIT, numeric::descent::Normal};

/// Indices of the unknowns of a stay: the circuit, the amplitude, the timing error, further ones.
const A: usize = CIRCUIT;
const TIME: usize = CIRCUIT + 2;
/// Number of unknowns without further ones.
pub(super) const ALONE: usize = CIRCUIT + 3;

/// The dependence of a reading on the amplitude and on its time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub(super) residual: Complex64,
    pub(super) by_amplitude: Complex64,
    pub(super) in_time: Complex64,
    pub(super) weight: f64,
}

/// The derivative of the admittance of a reading with respect to a disturbance.
#[derive(Debug, Clone, Copy)]
pub(super) enum Column {
    Admittance(Complex64),
    /// A phase error of the analyzer turns the whole admittance.
    Phase,
    /// An error of the first gap delays all readings of a stay but the first.
    FirstGap,
    /// A change of the logarithm of the resonance by a drift, which has this size in the middle of the stay.
    Drift {
        size: f64,
        moving: Moving,
    },
}

/// Accumulated sums of the readings of a stay.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sums<const N: usize> {
    normal: Normal<N>,
    /// |a|².
    square: f64,
    /// Known delay of the last reading after its recorded time, s; `None` before the first reading.
    late_s: Option<f64>,
}

impl<const N: usize> Sums<N> {
    pub(super) fn new(amplitude: Complex64, prior: f64, square: f64) -> Self {
        let mut normal = Normal::default();
        let precision = 1.0 / prior.max(f64::MIN_POSITIVE);
        for (k, part) in [amplitude.re, amplitude.im].into_iter().enumerate() {
            normal.matrix[A + k][A + k] = precision;
            normal.gradient[A + k] = precision * part;
            normal.cost += precision * part * part;
        }
        Self { normal, square, late_s: None }
    }

    /// Advances to a reading that started this much after its recorded time.
    pub(super) fn wait_until(&mut self, late_s: f64, known: &Known) {
        // The time axis starts with the first reading.
        if let Some(before_s) = self.late_s.replace(late_s) {
            self.wait(late_s - before_s, known);
        }
    }

    /// Adds a reading with this free decay and these disturbances; without an impedance it is assumed to
    /// agree with the model.
    pub(super) fn add(
        &mut self,
        model: &Model,
        sample: &Sample,
        amplitude: Complex64,
        decayed: &Decayed,
        known: &Known,
        disturbances: impl Iterator<Item = Column>,
    ) -> Row {
        let Decayed { value: e, by_rate: e_by, mirrored, .. } = *decayed;
        let by_motion = |moving: &Moving| model.by_motion(moving, amplitude, decayed);
        let mut admittance = model.steady + amplitude * e;
        if model.moving.per_s != 0.0 {
            admittance += by_motion(&model.moving);
        }
        let x = sample.impedance.map_or(Complex64::ONE, |impedance| impedance * admittance);
        let more = 1.0 / (x + 1.0);
        let slope = 4.0 * x * more * more / admittance;
        let mut columns = [Complex64::ZERO; N];
        columns[..CIRCUIT].copy_from_slice(&model.by);
        for (column, by_rate) in columns.iter_mut().zip(&model.rate_by) {
            *column += amplitude * e_by * by_rate;
        }
        columns[A] = e;
        columns[A + 1] = Complex64::I * e;
        let has_waited = self.normal.matrix[TIME][TIME] > 0.0;
        if has_waited {
            columns[TIME] = amplitude * model.rate * e;
        }
        let (by_resonance, in_time) = (columns[0], columns[TIME]);
        for (column, disturbance) in columns.iter_mut().skip(ALONE).zip(disturbances) {
            *column = match disturbance {
                Column::Admittance(of_mode) => of_mode,
                Column::Phase => -Complex64::I * admittance,
                Column::FirstGap => in_time,
                Column::Drift { size, moving } => size * by_resonance + by_motion(&moving),
            };
        }
        let counter = 0.5 * self.square * mirrored / admittance.norm_sqr();
        let weight = 1.0 / (known.variance / sample.length + counter);
        let residual = 2.0 * (x - 1.0) * more;
        let columns = columns.map(|by| by * slope);
        self.normal.add(residual, &columns, weight);
        Row { residual, by_amplitude: columns[A], in_time: columns[TIME], weight }
    }

    /// Adds a gap of uncertain length: the timing error takes another random step, of which `taken_s`
    /// is already included.
    fn wait(&mut self, taken_s: f64, times: &Known) {
        let Normal { matrix, gradient, cost } = &mut self.normal;
        let known = matrix[TIME][TIME];
        if known == 0.0 {
            let square = times.first_gap_sigma_s * times.first_gap_sigma_s;
            matrix[TIME][TIME] = 1.0 / square;
            gradient[TIME] = taken_s / square;
            *cost += taken_s * taken_s / square;
            return;
        }
        let square = times.gap_sigma_s * times.gap_sigma_s;
        *cost += taken_s * (2.0 * gradient[TIME] + known * taken_s);
        for (element, by_time) in gradient.iter_mut().zip(&matrix[TIME]) {
            *element += by_time * taken_s;
        }
        let kept = 1.0 / (1.0 + known * square);
        let (column, right) = (matrix[TIME], gradient[TIME]);
        for i in (0..N).filter(|i| *i != TIME) {
            let factor = column[i] * square * kept;
            for (element, other) in matrix[i].iter_mut().zip(&column) {
                *element -= factor * other;
            }
            gradient[i] -= factor * right;
            matrix[i][TIME] = column[i] * kept;
            matrix[TIME][i] = column[i] * kept;
        }
        *cost -= right * right * square * kept;
        matrix[TIME][TIME] = known * kept;
        gradient[TIME] = right * kept;
    }

    /// The equations with the timing error eliminated.
    pub(super) fn without_time(&self) -> Normal<N> {
        let mut normal = self.normal;
        let known = normal.matrix[TIME][TIME];
        if known > 0.0 {
            let (column, right) = (normal.matrix[TIME], normal.gradient[TIME]);
            for (i, row) in normal.matrix.iter_mut().enumerate() {
                let factor = column[i] / known;
                for (element, other) in row.iter_mut().zip(&column) {
                    *element -= factor * other;
                }
                normal.gradient[i] -= factor * right;
            }
            normal.cost -= right * right / known;
        }
        normal
    }
}

/// Step of the amplitude to its best value for this circuit, and the cost that it saves.
pub(super) fn amplitude_step<const N: usize>(normal: &Normal<N>) -> (Complex64, f64) {
    let Some(inverse) = inverse(normal) else { return (Complex64::ZERO, 0.0) };
    let right = [normal.gradient[A], normal.gradient[A + 1]];
    let step = times(&inverse, &right);
    (Complex64::new(step[0], step[1]), step[0] * right[0] + step[1] * right[1])
}

/// The block of the amplitude.
fn amplitude<const N: usize>(normal: &Normal<N>) -> [[f64; 2]; 2] {
    std::array::from_fn(|i| std::array::from_fn(|k| normal.matrix[A + i][A + k]))
}

pub(super) fn determinant<const N: usize>(normal: &Normal<N>) -> f64 {
    let [[a, b], [c, d]] = amplitude(normal);
    a * d - b * c
}

/// The inverse of the block of the amplitude.
fn inverse<const N: usize>(normal: &Normal<N>) -> Option<[[f64; 2]; 2]> {
    let [[a, b], [c, d]] = amplitude(normal);
    let determinant = determinant(normal);
    (determinant > 0.0).then(|| [[d, -b], [-c, a]].map(|row| row.map(|x| x / determinant)))
}

fn times(matrix: &[[f64; 2]; 2], [x, y]: &[f64; 2]) -> [f64; 2] {
    matrix.map(|[a, b]| a * x + b * y)
}

/// The equations of the circuit and the second modes after it, with the amplitude eliminated.
pub(super) fn eliminated<const N: usize, const K: usize>(normal: &Normal<N>) -> Normal<K> {
    let mut rest = Normal::<K>::default();
    let Some(inverse) = inverse(normal) else { return rest };
    let right = [normal.gradient[A], normal.gradient[A + 1]];
    let kept = || (0..CIRCUIT).chain(ALONE..N).enumerate();
    for (i, from) in kept() {
        let solved = times(&inverse, &[normal.matrix[from][A], normal.matrix[from][A + 1]]);
        for (k, to) in kept() {
            let less = solved[0] * normal.matrix[to][A] + solved[1] * normal.matrix[to][A + 1];
            rest.matrix[i][k] = normal.matrix[from][to] - less;
        }
        rest.gradient[i] = normal.gradient[from] - solved[0] * right[0] - solved[1] * right[1];
    }
    let solved = times(&inverse, &right);
    rest.cost = normal.cost - solved[0] * right[0] - solved[1] * right[1];
    rest
}
