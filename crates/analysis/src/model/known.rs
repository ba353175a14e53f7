//! The samples of known stiffness about one common factor.
//!
//! One factor corrects all stiffnesses. Known samples that ask for different factors show an error that no angle
//! and no direction shows: a contact law that differs from sample to sample, or a wrong known stiffness.

use super::{
    fit::{State, Usable},
    judge::{Evidence, Pattern, chi2_probability},
};

/// Relative standard deviation of a known stiffness. Indentation and stage differ by a third over the
/// samples of the paper.
const KNOWN_REL: f64 = 0.03;

/// A known sample with touches.
struct Compared {
    sample: usize,
    /// Logarithm of its mean stiffness over the known one.
    log: f64,
    /// The variance of that mean.
    own_variance: f64,
}

impl Compared {
    /// The variance of `log`.
    fn variance(&self) -> f64 {
        self.own_variance + KNOWN_REL.powi(2)
    }
}

/// The known samples of a run.
pub(super) struct Known(Vec<Compared>);

impl Known {
    pub(super) fn of(touches: &Usable<'_>, state: &State) -> Self {
        let compared = |(sample, known): (usize, &Option<f64>)| {
            let known_mpa = (*known)?;
            let own =
                || (0..touches.touches.len()).filter(|&i| touches.touches[i].sample == sample);
            let weight: f64 = own().map(|i| state.weights[i]).sum();
            let mean = own().map(|i| state.weights[i] * state.logs[i]).sum::<f64>() / weight;
            let log = mean - known_mpa.ln();
            (weight > 0.0).then(|| Compared { sample, log, own_variance: 1.0 / weight })
        };
        Self(touches.main.known_mpa.iter().enumerate().filter_map(compared).collect())
    }

    /// χ² about the common factor.
    pub(super) fn chi2(&self) -> f64 {
        self.parts().sum()
    }

    /// The part of each sample in χ².
    fn parts(&self) -> impl Iterator<Item = f64> {
        let weight: f64 = self.0.iter().map(|one| 1.0 / one.variance()).sum();
        let mean = self.0.iter().map(|one| one.log / one.variance()).sum::<f64>() / weight;
        self.0.iter().map(move |one| (one.log - mean).powi(2) / one.variance())
    }

    /// Samples less the factor; `None` with fewer than two.
    fn freedom(&self) -> Option<f64> {
        self.0.len().checked_sub(1).filter(|freedom| *freedom > 0).map(|freedom| freedom as f64)
    }

    /// The evidence that the samples do not have one factor, with the sample that differs most.
    pub(super) fn evidence(&self) -> Option<Evidence> {
        let (freedom, chi2) = (self.freedom()?, self.chi2());
        let (worst, _) = self.0.iter().zip(self.parts()).max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(Evidence {
            pattern: Pattern::Known(worst.sample),
            chi2_removed: chi2 - freedom,
            probability: chi2_probability(chi2, freedom),
        })
    }

    /// The relative standard deviation of one sample about the common factor beyond that of its touches.
    pub(super) fn scatter(&self) -> f64 {
        let Some(freedom) = self.freedom() else { return 0.0 };
        let n = self.0.len() as f64;
        let mean = self.0.iter().map(|one| one.log).sum::<f64>() / n;
        let squares: f64 = self.0.iter().map(|one| (one.log - mean).powi(2)).sum();
        let own = self.0.iter().map(|one| one.own_variance).sum::<f64>() / n;
        (squares / freedom - own).max(0.0).sqrt()
    }
}
