//! Calibration of inferred stiffness with samples of known stiffness.
//!
//! A sensor that is stiffer than its description makes every sample look softer by about the same
//! factor, because a shift depends mainly on the ratio of the two stiffnesses. Samples of known
//! stiffness give this one factor; differences between samples stay as measured.

/// An inferred stiffness beside the known one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Index of the sample.
    pub sample: usize,
    /// Inferred Young's modulus, MPa.
    pub young_mpa: f64,
    /// Standard deviation of the inferred modulus, MPa.
    pub sigma_mpa: f64,
    /// Known Young's modulus, MPa.
    pub known_mpa: f64,
}

/// The calibration factor from samples of known stiffness.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Geometric mean of inferred over known stiffness. An inferred stiffness is divided by it.
    pub factor: f64,
    /// Relative standard deviation of the factor: the larger of the one from the inferred stiffnesses
    /// and the one from the scatter between samples.
    pub sigma_rel: f64,
    /// Number of samples used.
    pub samples: usize,
    /// The variance of the mean logarithm of each of them, by its index.
    of_samples: Vec<(usize, f64)>,
    /// Variance of the factor's logarithm by the scatter between samples.
    scatter: f64,
}

impl Calibration {
    /// The part of `sigma_rel` that is due to samples other than this one.
    pub fn sigma_rel_of_others(&self, sample: usize) -> f64 {
        let n = self.samples as f64;
        let others = || self.of_samples.iter().filter(|one| one.0 != sample);
        let propagated = others().map(|(_, variance)| variance).sum::<f64>() / (n * n);
        let scatter = self.scatter * others().count() as f64 / n;
        propagated.max(scatter).sqrt()
    }
}

/// The calibration factor, with the same weight for each sample; `None` without a usable comparison.
pub fn calibrate(comparisons: &[Comparison]) -> Option<Calibration> {
    let is_usable = |one: &Comparison| {
        let all = [one.young_mpa, one.known_mpa];
        all.iter().all(|stiffness| stiffness.is_finite() && *stiffness > 0.0)
    };
    let mut usable: Vec<Comparison> = comparisons.iter().copied().filter(is_usable).collect();
    usable.sort_by_key(|one| one.sample);
    let samples: Vec<(f64, f64)> =
        usable.chunk_by(|a, b| a.sample == b.sample).map(of_sample).collect();
    let indices = usable.chunk_by(|a, b| a.sample == b.sample).map(|of_one| of_one[0].sample);
    if samples.is_empty() {
        return None;
    }
    let n = samples.len() as f64;
    let mean = samples.iter().map(|(log, _)| log).sum::<f64>() / n;
    let propagated = samples.iter().map(|(_, variance)| variance).sum::<f64>() / (n * n);
    let squares = samples.iter().map(|(log, _)| (log - mean).powi(2)).sum::<f64>();
    let scatter = if samples.len() > 1 { squares / (n - 1.0) / n } else { 0.0 };
    Some(Calibration {
        factor: mean.exp(),
        sigma_rel: propagated.max(scatter).sqrt(),
        samples: samples.len(),
        of_samples: indices.zip(samples.iter().map(|(_, variance)| *variance)).collect(),
        scatter,
    })
}

/// The mean logarithm of the ratios of one sample, and its variance.
fn of_sample(comparisons: &[Comparison]) -> (f64, f64) {
    let n = comparisons.len() as f64;
    let logs = comparisons.iter().map(|one| (one.young_mpa / one.known_mpa).ln());
    let variances = comparisons.iter().map(|one| (one.sigma_mpa / one.young_mpa).powi(2));
    (logs.sum::<f64>() / n, variances.sum::<f64>() / (n * n))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(sample: usize, young_mpa: f64, known_mpa: f64) -> Comparison {
        Comparison { sample, young_mpa, sigma_mpa: 0.02 * young_mpa, known_mpa }
    }

    #[track_caller]
    fn check(comparisons: &[Comparison], factor: f64, sigma_rel: f64) {
        let found = calibrate(comparisons).unwrap();
        assert!((found.factor / factor - 1.0).abs() < 1e-12, "{found:?}");
        assert!((found.sigma_rel - sigma_rel).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn a_common_factor_is_found_and_is_as_uncertain_as_the_inferred_stiffness() {
        check(&[one(0, 0.11, 0.1)], 1.1, 0.02);
        let four = [one(0, 0.11, 0.1), one(1, 0.44, 0.4), one(0, 0.11, 0.1), one(1, 0.44, 0.4)];
        check(&four, 1.1, 0.02 / 2.0);
    }

    #[test]
    fn a_sample_touched_more_often_has_no_more_weight_and_scatter_between_samples_counts() {
        // The logarithms of the samples are 0.1 above and below those of the readings.
        let (up, down) = (0.1_f64.exp(), (-0.1_f64).exp());
        check(&[one(0, up, 1.0), one(0, up, 1.0), one(1, down, 1.0)], 1.0, 0.1);
    }

    #[test]
    fn what_cannot_be_compared_is_left_out() {
        assert_eq!(calibrate(&[]), None);
        assert_eq!(calibrate(&[one(0, f64::NAN, 1.0), one(1, 1.0, 0.0)]), None);
        assert_eq!(calibrate(&[one(0, 1.0, 0.0), one(1, 2.0, 1.0)]).unwrap().samples, 1);
    }
}
