//! Agreement of clusters with the true labels.

mod assignment;

use assignment::best_assignment;

/// The agreement of clusters with labels.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// Number of classified trials.
    pub trials: u32,
    /// Trials in the cluster that represents their label.
    pub correct: u32,
    /// The label of each cluster; `None` for a cluster without a trial of the label that is left for it.
    pub label_of: Vec<Option<usize>>,
    /// `counts[label][cluster]`: trials of each label in each cluster.
    pub counts: Vec<Vec<u32>>,
}

impl Score {
    /// The share of correct trials; `None` without trials.
    pub fn rate(&self) -> Option<f64> {
        (self.trials > 0).then(|| f64::from(self.correct) / f64::from(self.trials))
    }

    /// The 95 % confidence interval of the rate.
    pub fn interval(&self) -> (f64, f64) {
        wilson_95(self.correct, self.trials)
    }
}

/// Matches clusters to labels so that the number of correct trials is largest, and counts.
///
/// `labels[i]` and `clusters[i]` belong to the same trial; the labels are below `n_labels`, the
/// clusters below `n_clusters`. The best matching is optimistic: with few trials it beats a
/// classifier that commits itself beforehand. A person who reads the chart afterwards does the same,
/// and the paper's 46 of 50 is such a count.
///
/// # Panics
/// When the two lists differ in length, or hold an index out of range.
pub fn score(labels: &[usize], clusters: &[usize], n_labels: usize, n_clusters: usize) -> Score {
    assert_eq!(labels.len(), clusters.len(), "one cluster for each label");
    let mut counts = vec![vec![0; n_clusters]; n_labels];
    for (&label, &cluster) in labels.iter().zip(clusters) {
        counts[label][cluster] += 1;
    }
    let mut label_of = vec![None; n_clusters];
    for (label, cluster) in best_assignment(&counts, n_clusters).into_iter().enumerate() {
        if let Some(cluster) = cluster.filter(|cluster| counts[label][*cluster] > 0) {
            label_of[cluster] = Some(label);
        }
    }
    let agreed = |(cluster, label): (usize, &Option<usize>)| {
        label.map_or(0, |label: usize| counts[label][cluster])
    };
    let correct = label_of.iter().enumerate().map(agreed).sum();
    let trials = counts.iter().flatten().sum();
    Score { trials, correct, label_of, counts }
}

/// The 95 % interval of Wilson for a rate of `correct` in `trials`; (0, 1) without trials.
///
/// # Source
/// Wilson 1927, "Probable inference, the law of succession, and statistical inference", J. Am.
/// Stat. Assoc. 22, 209–212.
pub fn wilson_95(correct: u32, trials: u32) -> (f64, f64) {
    /// The 97.5 % quantile of the normal distribution.
    const Z: f64 = 1.959963984540054;
    if trials == 0 {
        return (0.0, 1.0);
    }
    let n = f64::from(trials);
    let rate = f64::from(correct) / n;
    let shrink = 1.0 + Z * Z / n;
    let middle = (rate + Z * Z / (2.0 * n)) / shrink;
    let half = Z * (rate * (1.0 - rate) / n + Z * Z / (4.0 * n * n)).sqrt() / shrink;
    ((middle - half).max(0.0), (middle + half).min(1.0))
}

/// The 95 % confidence interval of a rate from groups of `trials` trials each, which within a group may depend on each other: by
/// the scatter of the groups, or Wilson's if there is none.
pub fn grouped_95(correct: &[u32], trials: u32) -> (f64, f64) {
    const Z: f64 = 1.959963984540054;
    let groups = correct.len() as f64;
    let rates = || correct.iter().map(|one| f64::from(*one) / f64::from(trials));
    let mean = rates().sum::<f64>() / groups;
    let scatter = rates().map(|rate| (rate - mean).powi(2)).sum::<f64>() / (groups - 1.0);
    if scatter > 0.0 {
        let half = Z * (scatter / groups).sqrt();
        return ((mean - half).max(0.0), (mean + half).min(1.0));
    }
    let count = u32::try_from(correct.len()).unwrap_or(u32::MAX);
    wilson_95(correct.iter().sum(), trials.saturating_mul(count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trials_that_depend_on_each_other_widen_an_interval() {
        // Half of the groups are all right, and half all wrong: each group is one trial.
        let groups: Vec<u32> = (0..100).map(|group| 10 * (group % 2)).collect();
        let (low, high) = grouped_95(&groups, 10);
        let (narrow_low, narrow_high) = wilson_95(500, 1000);
        assert!((high - low) / (narrow_high - narrow_low) > 3.0, "{low} {high}");
        assert!((0.5 * (low + high) - 0.5).abs() < 1e-12);
        assert_eq!(grouped_95(&[10; 100], 10), wilson_95(1000, 1000));
    }

    #[test]
    fn clusters_are_matched_to_labels_so_that_most_agree() {
        let labels = [0, 0, 0, 1, 1, 1, 2, 2];
        // Cluster 2 holds label 0, cluster 0 label 1, cluster 1 label 2; one of each of two strays.
        let found = score(&labels, &[2, 2, 0, 0, 0, 1, 1, 1], 3, 3);
        assert_eq!(found.label_of, [Some(1), Some(2), Some(0)]);
        assert_eq!((found.correct, found.trials), (6, 8));
        assert_eq!(found.counts, [[1, 0, 2], [2, 1, 0], [0, 2, 0]]);
        assert_eq!(found.rate(), Some(0.75));
    }

    #[test]
    fn a_greedy_choice_is_not_the_best() {
        // Label 0 has most in cluster 0, but label 1 has nothing anywhere else.
        let labels = [0, 0, 0, 0, 0, 1, 1, 1, 1];
        let found = score(&labels, &[0, 0, 0, 1, 1, 0, 0, 0, 0], 2, 2);
        assert_eq!(found.label_of, [Some(1), Some(0)]);
        assert_eq!(found.correct, 6);
    }

    #[test]
    fn numbers_of_clusters_and_labels_may_differ() {
        let found = score(&[0, 0, 1, 1], &[0, 1, 2, 2], 2, 3);
        assert_eq!(found.label_of, [Some(0), None, Some(1)]);
        assert_eq!(found.correct, 3);
        let found = score(&[0, 1, 2, 2], &[0, 0, 1, 1], 3, 2);
        assert_eq!(found.correct, 3);
        // No trial of label 2 was classified: it is not what cluster 2 represents.
        let found = score(&[0, 0, 0, 1], &[0, 0, 2, 1], 3, 3);
        assert_eq!((found.label_of.as_slice(), found.correct), (&[Some(0), Some(1), None][..], 3));
        let found = score(&[], &[], 2, 2);
        assert_eq!((found.correct, found.rate(), found.interval()), (0, None, (0.0, 1.0)));
    }

    #[test]
    fn the_interval_is_that_of_the_tables() {
        #[track_caller]
        fn check(correct: u32, trials: u32, expected: (f64, f64)) {
            let found = wilson_95(correct, trials);
            let is_near = |a: f64, b: f64| (a - b).abs() < 5e-5;
            assert!(is_near(found.0, expected.0) && is_near(found.1, expected.1), "{found:?}");
        }
        // Newcombe 1998, Stat. Med. 17, 857-872, table I, method 3.
        check(81, 263, (0.2553, 0.3662));
        check(15, 148, (0.0624, 0.1605));
        check(0, 20, (0.0, 0.1611));
        check(1, 29, (0.0061, 0.1718));
    }
}
