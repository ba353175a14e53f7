//! Calibration of inferred stiffness with samples of known stiffness.
//!
//! A sensor that is stiffer than its description makes every sample look softer by about the same
//! factor, because a shift depends mainly on the ratio of the two stiffnesses. Samples of known
//! stiffness give this one factor; differences between samples stay as measured.

use std::collections::BTreeMap;

/// An inferred stiffness beside the known one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Index of the sample.
    pub sample: usize,
    /// Inferred Young's modulus, MPa.
    pub young_mpa: f64,
    /// Known Young's modulus, MPa.
    pub known_mpa: f64,
}

/// The calibration factor from samples of known stiffness.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Geometric mean of inferred over known stiffness. An inferred stiffness is divided by it.
    pub factor: f64,
    /// Number of samples used.
    pub samples: usize,
    /// Relative standard deviation of the factor by the scatter between samples; `None` for a single one.
    pub scatter_rel: Option<f64>,
}

impl Comparison {
    /// The logarithm of inferred over known stiffness; `None` unless both are positive and finite.
    fn log(&self) -> Option<f64> {
        let is_usable =
            [self.young_mpa, self.known_mpa].iter().all(|mpa| mpa.is_finite() && *mpa > 0.0);
        is_usable.then(|| (self.young_mpa / self.known_mpa).ln())
    }
}

/// The weight of each comparison in the logarithm of the factor: each sample has the same weight, and so has each
/// comparison of a sample. A comparison that is not usable has none.
pub fn weights(comparisons: &[Comparison]) -> Vec<f64> {
    let usable = || comparisons.iter().filter(|one| one.log().is_some()).map(|one| one.sample);
    let mut samples: Vec<usize> = usable().collect();
    samples.sort_unstable();
    samples.dedup();
    let weight = |one: &Comparison| {
        let of_sample = usable().filter(|sample| *sample == one.sample).count();
        one.log().map_or(0.0, |_| 1.0 / (samples.len() * of_sample) as f64)
    };
    comparisons.iter().map(weight).collect()
}

/// The calibration factor; `None` without a usable comparison.
pub fn calibrate(comparisons: &[Comparison]) -> Option<Calibration> {
    let weights = weights(comparisons);
    // Of each sample: the weight and the weighted sum of its logarithms.
    let mut samples: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
    for (one, weight) in comparisons.iter().zip(weights) {
        let Some(log) = one.log() else { continue };
        let (sum_of_weights, sum) = samples.entry(one.sample).or_default();
        *sum_of_weights += weight;
        *sum += weight * log;
    }
    let n = samples.len() as f64;
    let mean = samples.values().map(|(_, sum)| sum).sum::<f64>();
    let squares: f64 = samples.values().map(|(weight, sum)| (sum / weight - mean).powi(2)).sum();
    (!samples.is_empty()).then(|| Calibration {
        factor: mean.exp(),
        samples: samples.len(),
        scatter_rel: (samples.len() > 1).then(|| (squares / (n - 1.0) / n).sqrt()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(sample: usize, young_mpa: f64, known_mpa: f64) -> Comparison {
        Comparison { sample, young_mpa, known_mpa }
    }

    #[track_caller]
    fn check(comparisons: &[Comparison], factor: f64, scatter_rel: Option<f64>) {
        let found = calibrate(comparisons).unwrap();
        assert!((found.factor / factor - 1.0).abs() < 1e-12, "{found:?}");
        let is_same = match (found.scatter_rel, scatter_rel) {
            (Some(found), Some(expected)) => (found - expected).abs() < 1e-12,
            (found, expected) => found == expected,
        };
        assert!(is_same, "{found:?}");
    }

    #[test]
    fn a_common_factor_is_found() {
        check(&[one(0, 0.11, 0.1)], 1.1, None);
        let four = [one(0, 0.11, 0.1), one(1, 0.44, 0.4), one(0, 0.11, 0.1), one(1, 0.44, 0.4)];
        check(&four, 1.1, Some(0.0));
        assert_eq!(weights(&four), [0.25; 4]);
    }

    #[test]
    fn a_sample_touched_more_often_has_no_more_weight_and_scatter_between_samples_is_told() {
        // The logarithms of the samples are 0.1 above and below those of the readings.
        let (up, down) = (0.1_f64.exp(), (-0.1_f64).exp());
        let three = [one(0, up, 1.0), one(0, up, 1.0), one(1, down, 1.0)];
        check(&three, 1.0, Some(0.1));
        assert_eq!(weights(&three), [0.25, 0.25, 0.5]);
    }

    #[test]
    fn what_cannot_be_compared_is_left_out() {
        assert_eq!(calibrate(&[]), None);
        assert_eq!(calibrate(&[one(0, f64::NAN, 1.0), one(1, 1.0, 0.0)]), None);
        let two = [one(0, 1.0, 0.0), one(1, 2.0, 1.0)];
        assert_eq!(calibrate(&two).unwrap().samples, 1);
        assert_eq!(weights(&two), [0.0, 1.0]);
    }
}
