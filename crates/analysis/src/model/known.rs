//! The samples of known stiffness about one common factor.
//!
//! One factor corrects all stiffnesses. Known samples that ask for different factors show an error that no angle
//! and no direction shows: a contact law that differs from sample to sample, or a wrong known stiffness.

use super::{
    fit::{State, Usable},
    judge::{Evidence, Pattern, chi2_probability},
    linear::{self, Matrix},
};

/// Relative standard deviation of a known stiffness. Indentation and stage differ by a third over the
/// samples of the paper.
const KNOWN_REL: f64 = 0.03;

/// A known sample with touches.
struct Compared {
    sample: usize,
    /// Logarithm of its mean stiffness over the known one.
    log: f64,
    /// The weight of its touches together.
    weight: f64,
    /// How each touch enters the mean.
    entering: Vec<f64>,
}

/// The known samples of a run.
pub(super) struct Known {
    samples: Vec<Compared>,
    /// The covariance of the means. References that samples share are in it.
    own: Matrix,
}

impl Known {
    pub(super) fn of(touches: &Usable<'_>, state: &State) -> Self {
        let compared = |(sample, known): (usize, &Option<f64>)| {
            let known_mpa = (*known)?;
            let own =
                || (0..touches.touches.len()).filter(|&i| touches.touches[i].sample == sample);
            let weight: f64 = own().map(|i| state.weights[i]).sum();
            let mean = own().map(|i| state.weights[i] * state.logs[i]).sum::<f64>() / weight;
            let log = mean - known_mpa.ln();
            let mut entering = vec![0.0; state.weights.len()];
            own().for_each(|i| entering[i] = state.weights[i] / weight);
            (weight > 0.0).then_some(Compared { sample, log, weight, entering })
        };
        let samples: Vec<Compared> =
            touches.main.known_mpa.iter().enumerate().filter_map(compared).collect();
        let entry = |(i, a): (usize, &Compared), (j, b): (usize, &Compared)| {
            let alone = if i == j { 1.0 / a.weight } else { 0.0 };
            alone + linear::form(&a.entering, &state.shared, &b.entering)
        };
        let all = || samples.iter().enumerate();
        let own = all().map(|a| all().map(|b| entry(a, b)).collect()).collect();
        Self { samples, own }
    }

    /// The inverse of the covariance of the logarithms, in which the known stiffness has its part.
    fn information(&self) -> Matrix {
        let mut covariance = self.own.clone();
        for (i, row) in covariance.iter_mut().enumerate() {
            row[i] += KNOWN_REL.powi(2);
        }
        linear::inverse(&covariance).unwrap_or_default()
    }

    /// χ² about the common factor.
    pub(super) fn chi2(&self) -> f64 {
        self.parts().iter().sum()
    }

    /// The part of each sample in χ².
    fn parts(&self) -> Vec<f64> {
        let information = self.information();
        let logs: Vec<f64> = self.samples.iter().map(|one| one.log).collect();
        let ones = vec![1.0; logs.len()];
        let mean =
            linear::form(&ones, &information, &logs) / linear::form(&ones, &information, &ones);
        let off: Vec<f64> = logs.iter().map(|log| log - mean).collect();
        let pulled = |row: &Vec<f64>| row.iter().zip(&off).map(|(by, off)| by * off).sum::<f64>();
        off.iter().zip(&information).map(|(off, row)| off * pulled(row)).collect()
    }

    /// Samples less the factor; `None` with fewer than two.
    fn freedom(&self) -> Option<f64> {
        self.samples
            .len()
            .checked_sub(1)
            .filter(|freedom| *freedom > 0)
            .map(|freedom| freedom as f64)
    }

    /// The evidence that the samples do not have one factor, with the sample that differs most.
    pub(super) fn evidence(&self) -> Option<Evidence> {
        let (freedom, chi2) = (self.freedom()?, self.chi2());
        let (worst, _) =
            self.samples.iter().zip(self.parts()).max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(Evidence {
            pattern: Pattern::Known(worst.sample),
            chi2_removed: chi2 - freedom,
            probability: chi2_probability(chi2, freedom),
        })
    }

    /// The relative standard deviation of one sample about the common factor beyond that of its touches.
    pub(super) fn scatter(&self) -> f64 {
        let Some(freedom) = self.freedom() else { return 0.0 };
        let n = self.samples.len() as f64;
        let mean = self.samples.iter().map(|one| one.log).sum::<f64>() / n;
        let squares: f64 = self.samples.iter().map(|one| (one.log - mean).powi(2)).sum();
        // What all samples share does not scatter.
        let whole = self.own.iter().flatten().sum::<f64>() / n;
        let own = self.own.iter().enumerate().map(|(i, row)| row[i]).sum::<f64>();
        let expected = (own - whole) / freedom;
        (squares / freedom - expected).max(0.0).sqrt()
    }
}
