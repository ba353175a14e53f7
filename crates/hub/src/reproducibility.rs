//! Repeatability on one bench and reproducibility between benches, by analysis of variance in one way.
//!
//! # Source
//! ISO 5725-2, 7.4: the standard deviations of repeatability `s_r`, between laboratories `s_L`, and of reproducibility
//! `s_R`, for laboratories with different numbers of results. Uncertainties: F. E. Satterthwaite, Biometrics Bulletin 2
//! (1946) 110.

use serde::Serialize;

/// A standard deviation with its own one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Deviation {
    /// The standard deviation, in the unit of the results.
    pub value: f64,
    /// Its standard uncertainty.
    pub sigma: f64,
}

/// The scatter of results of one sample on several benches.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Reproducibility {
    /// Number of benches.
    pub benches: usize,
    /// Number of results.
    pub results: usize,
    /// Mean of all results.
    pub mean: f64,
    /// Of results of one bench, `s_r`.
    pub repeatability: Deviation,
    /// Of the means that benches have in the long run, `s_L`; 0 if the benches differ less than their results scatter.
    pub between: Deviation,
    /// Of results of any benches, `s_R`.
    pub reproducibility: Deviation,
}

impl Reproducibility {
    /// From the results of each bench. `None` for fewer than two benches with results, or if no bench has two.
    pub fn of(benches: &[Vec<f64>]) -> Option<Self> {
        let groups: Vec<_> = benches.iter().filter(|results| !results.is_empty()).collect();
        let counts = || groups.iter().map(|results| results.len() as f64);
        let (p, n) = (groups.len() as f64, counts().sum::<f64>());
        if groups.len() < 2 || n <= p {
            return None;
        }
        let mean_of = |results: &[f64]| results.iter().sum::<f64>() / results.len() as f64;
        let mean = groups.iter().copied().flatten().sum::<f64>() / n;
        let square = |value: f64| value * value;
        let within = groups.iter().flat_map(|results| {
            let mean = mean_of(results);
            results.iter().map(move |result| square(result - mean))
        });
        let within = within.sum::<f64>() / (n - p);
        let apart =
            groups.iter().map(|results| results.len() as f64 * square(mean_of(results) - mean));
        let apart = apart.sum::<f64>() / (p - 1.0);
        // The number of results of a bench; of different numbers, this mean.
        let each = (n - counts().map(square).sum::<f64>() / n) / (p - 1.0);
        let between = (apart - within) / each;
        // A mean square with f degrees of freedom has the relative variance 2/f.
        let variance_within = 2.0 * square(within) / (n - p);
        let variance_apart = 2.0 * square(apart) / (p - 1.0);
        let shared = 1.0 - 1.0 / each;
        let sigmas = [
            variance_within.sqrt(),
            (variance_apart + variance_within).sqrt() / each,
            (variance_apart / square(each) + variance_within * square(shared)).sqrt(),
        ];
        // Where the benches do not differ, s_R is s_r.
        let all = within + between.max(0.0);
        Some(Self {
            benches: groups.len(),
            results: groups.iter().map(|results| results.len()).sum(),
            mean,
            repeatability: Deviation::of(within, sigmas[0]),
            between: Deviation::of(between.max(0.0), sigmas[1]),
            reproducibility: Deviation::of(all, sigmas[2]),
        })
    }
}

impl Deviation {
    /// From a variance and the standard deviation of that. Near 0, where the root has no slope, its uncertainty is the
    /// root of that standard deviation.
    fn of(variance: f64, sigma: f64) -> Self {
        let value = variance.sqrt();
        Self { value, sigma: (sigma / (2.0 * value)).min(sigma.sqrt()) }
    }
}

#[cfg(test)]
mod tests {
    use rig_model::random::Stream;

    use super::*;

    #[track_caller]
    fn assert_near(found: f64, wanted: f64, relative: f64) {
        assert!((found / wanted - 1.0).abs() < relative, "{found} is not {wanted}");
    }

    /// Yields of dyestuff, 5 preparations from each of 6 batches: O. L. Davies and P. L. Goldsmith, Statistical Methods in
    /// Research and Production, 4th edition 1972, table 6.2. The components of variance that are printed: 2451 within and
    /// 1764 between the batches.
    #[test]
    fn published_components_of_variance_come_out() {
        let batches = [
            [1545.0, 1440.0, 1440.0, 1520.0, 1580.0],
            [1540.0, 1555.0, 1490.0, 1560.0, 1495.0],
            [1595.0, 1550.0, 1605.0, 1510.0, 1560.0],
            [1445.0, 1440.0, 1595.0, 1465.0, 1545.0],
            [1595.0, 1630.0, 1515.0, 1635.0, 1625.0],
            [1520.0, 1455.0, 1450.0, 1480.0, 1445.0],
        ];
        let found = Reproducibility::of(&batches.map(Vec::from)).unwrap();
        assert_eq!((found.benches, found.results), (6, 30));
        assert_near(found.mean, 1527.5, 1e-12);
        assert_near(found.repeatability.value, 2451.25_f64.sqrt(), 1e-12);
        assert_near(found.between.value, 1764.05_f64.sqrt(), 1e-12);
        assert_near(found.reproducibility.value, (2451.25_f64 + 1764.05).sqrt(), 1e-12);
    }

    /// Benches with different numbers of results, by the hundred: the variances are right in the mean, and the stated
    /// uncertainties are the scatter.
    #[test]
    fn variances_are_unbiased_and_scatter_as_stated() {
        const TRIALS: u32 = 4000;
        let (within, between) = (0.3, 0.5);
        let mut stream = Stream::new(1, 161);
        let mut sums = [[0.0_f64; 3]; 3];
        for _ in 0..TRIALS {
            let bench = |results: &usize| {
                let mean = 5.0 + between * stream.normal();
                (0..*results).map(|_| mean + within * stream.normal()).collect()
            };
            let benches: Vec<Vec<f64>> =
                [2, 3, 5, 8, 13, 4, 6, 3, 9, 7, 12, 5].iter().map(bench).collect();
            let found = Reproducibility::of(&benches).unwrap();
            for (sum, one) in
                sums.iter_mut().zip([found.repeatability, found.between, found.reproducibility])
            {
                let [variances, values, sigmas] = sum;
                *variances += one.value * one.value;
                *values += one.value;
                *sigmas += one.sigma;
            }
        }
        let truth = [within * within, between * between, within * within + between * between];
        for ([variances, values, sigmas], truth) in sums.into_iter().zip(truth) {
            let n = f64::from(TRIALS);
            assert_near(variances / n, truth, 0.02);
            let scatter = (variances / n - (values / n).powi(2)).sqrt();
            assert_near(sigmas / n, scatter, 0.15);
        }
    }

    #[test]
    fn one_bench_or_single_results_say_nothing_of_benches() {
        assert_eq!(Reproducibility::of(&[]), None);
        assert_eq!(Reproducibility::of(&[vec![1.0, 2.0], vec![]]), None);
        assert_eq!(Reproducibility::of(&[vec![1.0], vec![2.0]]), None);
        let alike = Reproducibility::of(&[vec![1.0, 3.0], vec![1.0, 3.0]]).unwrap();
        assert_eq!(alike.between.value, 0.0);
        assert!(alike.between.sigma > 0.0);
        assert_eq!(alike.reproducibility.value, alike.repeatability.value);
        let exact = Reproducibility::of(&[vec![1.0, 1.0], vec![1.0, 1.0]]).unwrap();
        assert_eq!((exact.reproducibility.value, exact.reproducibility.sigma), (0.0, 0.0));
    }
}
