//! Normal equations of least squares with unknowns that concern everything and unknowns that concern
//! one part of the data: the latter are eliminated part by part.

/// Unknowns that concern everything: those of the circuit, and three of what is beside it.
pub(crate) const GLOBAL: usize = 8;

/// Symmetric positive definite equations, as their lower triangular factor.
pub(crate) struct Factor(Vec<Vec<f64>>);

impl Factor {
    /// `None` if the matrix is not positive definite.
    pub(crate) fn new(mut a: Vec<Vec<f64>>) -> Option<Self> {
        for i in 0..a.len() {
            for j in 0..=i {
                let sum: f64 = (0..j).map(|k| a[i][k] * a[j][k]).sum();
                let rest = a[i][j] - sum;
                a[i][j] =
                    if i == j { Some(rest).filter(|r| *r > 0.0)?.sqrt() } else { rest / a[j][j] };
            }
        }
        Some(Self(a))
    }

    /// The logarithm of the determinant of the matrix.
    pub(crate) fn log_determinant(&self) -> f64 {
        2.0 * self.0.iter().enumerate().map(|(index, row)| row[index].ln()).sum::<f64>()
    }

    /// The inverse of the matrix.
    pub(crate) fn inverse(&self) -> Vec<Vec<f64>> {
        let unit = |column: usize| {
            (0..self.0.len()).map(|row| f64::from(u8::from(row == column))).collect::<Vec<_>>()
        };
        (0..self.0.len()).map(|column| self.solve(&unit(column))).collect()
    }

    pub(crate) fn solve(&self, b: &[f64]) -> Vec<f64> {
        let (l, mut x) = (&self.0, b.to_vec());
        for i in 0..x.len() {
            let sum: f64 = (0..i).map(|k| l[i][k] * x[k]).sum();
            x[i] = (x[i] - sum) / l[i][i];
        }
        for i in (0..x.len()).rev() {
            let sum: f64 = (i + 1..x.len()).map(|k| l[k][i] * x[k]).sum();
            x[i] = (x[i] - sum) / l[i][i];
        }
        x
    }
}

/// The part of the equations that concerns one part of the data.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    local: Vec<Vec<f64>>,
    mixed: Vec<[f64; GLOBAL]>,
    right: Vec<f64>,
}

impl Part {
    pub(crate) fn new(unknowns: usize) -> Self {
        let local = vec![vec![0.0; unknowns]; unknowns];
        Self { local, mixed: vec![[0.0; GLOBAL]; unknowns], right: vec![0.0; unknowns] }
    }

    /// An unknown that is expected to be 0 with the standard deviation `sigma`.
    pub(crate) fn expect(&mut self, unknown: usize, value: f64, sigma: f64) -> f64 {
        self.local[unknown][unknown] += sigma.powi(-2);
        self.right[unknown] -= value * sigma.powi(-2);
        (value / sigma).powi(2)
    }
}

/// The equations J'J x = −J'r.
#[derive(Debug, Clone, Default)]
pub(crate) struct Normal {
    matrix: [[f64; GLOBAL]; GLOBAL],
    right: [f64; GLOBAL],
    parts: Vec<Part>,
    /// The sum of the squares of all residuals.
    pub(crate) cost: f64,
}

/// The equations of the unknowns of everything, and the factors of the eliminated parts.
struct Reduced {
    matrix: Vec<Vec<f64>>,
    right: Vec<f64>,
    factors: Vec<Factor>,
}

/// A step of all unknowns.
#[derive(Debug, Clone)]
pub(crate) struct Step {
    pub(crate) global: [f64; GLOBAL],
    pub(crate) local: Vec<Vec<f64>>,
}

impl Normal {
    /// Adds a residual with its slopes by the unknowns of everything and of `part`.
    pub(crate) fn add(&mut self, part: &mut Part, r: f64, global: &[f64; GLOBAL], local: &[f64]) {
        self.cost += r * r;
        for i in 0..GLOBAL {
            self.right[i] -= global[i] * r;
            for j in 0..GLOBAL {
                self.matrix[i][j] += global[i] * global[j];
            }
        }
        for (i, slope) in local.iter().enumerate().filter(|(_, slope)| **slope != 0.0) {
            part.right[i] -= slope * r;
            for (sum, other) in part.local[i].iter_mut().zip(local) {
                *sum += slope * other;
            }
            for (sum, other) in part.mixed[i].iter_mut().zip(global) {
                *sum += slope * other;
            }
        }
    }

    /// An unknown of everything that is expected to differ by nothing from `value` = 0.
    pub(crate) fn expect(&mut self, unknown: usize, value: f64, sigma: f64) {
        self.matrix[unknown][unknown] += sigma.powi(-2);
        self.right[unknown] -= value * sigma.powi(-2);
        self.cost += (value / sigma).powi(2);
    }

    /// All rows of a part have been added; `cost` is what its expectations add.
    pub(crate) fn finish(&mut self, part: Part, cost: f64) {
        self.cost += cost;
        self.parts.push(part);
    }

    /// The equations of the unknowns of everything after the elimination of the others, with the
    /// diagonal raised by the part `damping`.
    fn reduced(&self, damping: f64) -> Option<Reduced> {
        let damp = |a: &mut Vec<Vec<f64>>| {
            for (i, row) in a.iter_mut().enumerate() {
                row[i] *= 1.0 + damping;
            }
        };
        let mut matrix: Vec<Vec<f64>> = self.matrix.iter().map(|row| row.to_vec()).collect();
        damp(&mut matrix);
        let mut right = self.right.to_vec();
        let mut factors = Vec::new();
        for part in &self.parts {
            let mut local = part.local.clone();
            damp(&mut local);
            let factor = Factor::new(local)?;
            let solved = factor.solve(&part.right);
            for i in 0..GLOBAL {
                let column: Vec<f64> = part.mixed.iter().map(|row| row[i]).collect();
                if column.iter().all(|cell| *cell == 0.0) {
                    continue;
                }
                right[i] -= column.iter().zip(&solved).map(|(a, b)| a * b).sum::<f64>();
                let solved = factor.solve(&column);
                for (j, cell) in matrix[i].iter_mut().enumerate() {
                    *cell -= part.mixed.iter().zip(&solved).map(|(row, b)| row[j] * b).sum::<f64>();
                }
            }
            factors.push(factor);
        }
        Some(Reduced { matrix, right, factors })
    }

    /// The step to the minimum of the linear problem.
    pub(crate) fn step(&self, damping: f64) -> Option<Step> {
        let Reduced { matrix, right, factors } = self.reduced(damping)?;
        let solved = Factor::new(matrix)?.solve(&right);
        let mut global = [0.0; GLOBAL];
        global.copy_from_slice(&solved);
        let back = |(part, factor): (&Part, Factor)| {
            let known =
                |row: &[f64; GLOBAL]| row.iter().zip(&global).map(|(a, b)| a * b).sum::<f64>();
            let right: Vec<f64> =
                part.right.iter().zip(&part.mixed).map(|(b, row)| b - known(row)).collect();
            factor.solve(&right)
        };
        let local = self.parts.iter().zip(factors).map(back).collect();
        Some(Step { global, local })
    }

    /// The right side of an unknown of everything.
    #[cfg(test)]
    pub(crate) const fn right(&self, unknown: usize) -> f64 {
        self.right[unknown]
    }

    /// The right side of an unknown of a part.
    #[cfg(test)]
    pub(crate) fn right_of_part(&self, part: usize, unknown: usize) -> f64 {
        self.parts[part].right[unknown]
    }

    /// What an undamped step saves of the sum of squares of the linear problem; a damped one saves more
    /// than this.
    pub(crate) fn promise(&self, step: &Step) -> f64 {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let of_parts = self.parts.iter().zip(&step.local).map(|(part, own)| dot(&part.right, own));
        dot(&self.right, &step.global) + of_parts.sum::<f64>()
    }

    /// The variance of an unknown of everything, in units of the variance of a residual.
    pub(crate) fn variance(&self, unknown: usize) -> Option<f64> {
        let Reduced { matrix, .. } = self.reduced(0.0)?;
        let mut unit = vec![0.0; GLOBAL];
        unit[unknown] = 1.0;
        Some(Factor::new(matrix)?.solve(&unit)[unknown])
    }
}
