//! The best partition, by dynamic programming.

use super::{ClusterError, Clustering, distinct, means};

/// The partition into `clusters` clusters with the smallest sum of squares.
///
/// On a line the best clusters are intervals. The best partition of the first j values into k
/// clusters is therefore the best partition of the first i into k − 1 clusters, for some i, and one
/// cluster of the rest. The best i grows with j, which brings the cost to O(k n log n).
///
/// # Errors
/// [`ClusterError`].
///
/// # Source
/// Wang and Song 2011, "Ckmeans.1d.dp: Optimal k-means Clustering in One Dimension by Dynamic
/// Programming", The R Journal 3/2, 29–33; the division of the range as in Grønlund et al. 2017,
/// arXiv:1701.07204, section 2.
pub fn optimal(values: &[f64], clusters: usize) -> Result<Clustering, ClusterError> {
    let distinct = distinct(values, clusters)?;
    let intervals = Intervals::new(values, &distinct);
    let n = distinct.len();

    // After round k, entry j is the cost of the best partition of the first j values into k clusters.
    let mut costs: Vec<f64> = (0..=n).map(|end| intervals.cost(0, end)).collect();
    // The start of the last cluster, for each further round and each j.
    let mut starts = Vec::new();
    for round in 2..=clusters {
        let mut next = Round {
            intervals: &intervals,
            before: &costs,
            first: round - 1,
            costs: vec![f64::INFINITY; n + 1],
            starts: vec![0; n + 1],
        };
        next.solve(round..n + 1, round - 1..n);
        let Round { costs: solved, starts: found, .. } = next;
        costs = solved;
        starts.push(found);
    }

    let mut bounds = Vec::new();
    let mut end = n;
    for starts in starts.iter().rev() {
        end = starts[end];
        bounds.push(distinct[end]);
    }
    bounds.reverse();
    let cluster_of = |&value: &f64| bounds.partition_point(|&bound| bound <= value);
    let found: Vec<usize> = values.iter().map(cluster_of).collect();
    // Every interval holds a value, so that every mean exists.
    let centres = means(values, &found, clusters).into_iter().flatten().collect();
    Ok(Clustering::new(values, found, centres))
}

/// Sums over intervals of the distinct values.
struct Intervals {
    // Number, sum and sum of squares of the values below each index. The values are taken relative to
    // their middle, so that little cancels.
    count: Vec<f64>,
    sum: Vec<f64>,
    squares: Vec<f64>,
}

impl Intervals {
    fn new(values: &[f64], distinct: &[f64]) -> Self {
        let middle = 0.5 * distinct[0] + 0.5 * distinct[distinct.len() - 1];
        let mut counts = vec![0.0; distinct.len()];
        for &value in values {
            counts[distinct.partition_point(|&other| other < value)] += 1.0;
        }
        let mut sums = Self { count: vec![0.0], sum: vec![0.0], squares: vec![0.0] };
        for (value, times) in distinct.iter().zip(counts) {
            let x = value - middle;
            for (sums, term) in [
                (&mut sums.count, times),
                (&mut sums.sum, times * x),
                (&mut sums.squares, times * x * x),
            ] {
                sums.push(sums[sums.len() - 1] + term);
            }
        }
        sums
    }

    /// Sum of the squared distances from the mean of all values from distinct value `start` up to but
    /// not including distinct value `end`.
    fn cost(&self, start: usize, end: usize) -> f64 {
        if end - start < 2 {
            return 0.0;
        }
        let over = |sums: &[f64]| sums[end] - sums[start];
        let (count, sum) = (over(&self.count), over(&self.sum));
        (over(&self.squares) - sum * sum / count).max(0.0)
    }
}

/// One more cluster.
struct Round<'a> {
    intervals: &'a Intervals,
    before: &'a [f64],
    // The earliest start that leaves a value for each earlier cluster.
    first: usize,
    costs: Vec<f64>,
    starts: Vec<usize>,
}

impl Round<'_> {
    /// Finds the best starts for all `ends`, which lie within `starts`.
    fn solve(&mut self, ends: std::ops::Range<usize>, starts: std::ops::Range<usize>) {
        if ends.is_empty() {
            return;
        }
        let end = usize::midpoint(ends.start, ends.end - 1);
        for start in starts.start.max(self.first)..starts.end.min(end) {
            let cost = self.before[start] + self.intervals.cost(start, end);
            if cost < self.costs[end] {
                self.costs[end] = cost;
                self.starts[end] = start;
            }
        }
        let best = self.starts[end];
        self.solve(ends.start..end, starts.start..best + 1);
        self.solve(end + 1..ends.end, best..starts.end);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[track_caller]
    fn check(values: &[f64], count: usize, expected: &[usize]) {
        let found = optimal(values, count).unwrap();
        assert_eq!(found.clusters, expected, "{found:?}");
        assert!(found.centres.is_sorted(), "{found:?}");
    }

    #[test]
    fn neighbouring_values_stay_together() {
        check(&[5.0, 1.0, 9.0, 1.1, 5.2, 8.9], 3, &[1, 0, 2, 0, 1, 2]);
        check(&[5.0, 1.0, 9.0], 1, &[0, 0, 0]);
        check(&[5.0, 1.0, 9.0], 3, &[1, 0, 2]);
        // Equal values are never separated.
        check(&[2.0, 2.0, 2.0, 3.0], 2, &[0, 0, 0, 1]);
        check(&[-0.0, 0.0, 1.0], 2, &[0, 0, 1]);
    }

    #[test]
    fn a_wide_cluster_is_split_and_two_near_ones_are_merged_when_that_costs_less() {
        // Why k-means fails on frequency shifts: stiff samples scatter more than soft ones differ.
        check(&[8.0, 8.1, 17.8, 17.9, 66.0, 70.0, 85.0, 89.0], 3, &[0, 0, 0, 0, 1, 1, 2, 2]);
    }

    #[test]
    fn clusters_that_cannot_be_filled_are_refused() {
        assert_eq!(optimal(&[1.0], 0), Err(ClusterError::NoClusters));
        let refusal = ClusterError::TooFewValues { distinct: 2, wanted: 3 };
        assert_eq!(optimal(&[1.0, 2.0, 1.0, 2.0], 3), Err(refusal));
        let refusal = ClusterError::NotFinite { index: 1 };
        assert_eq!(optimal(&[1.0, f64::INFINITY], 1), Err(refusal));
    }

    #[test]
    fn a_large_offset_does_not_drown_the_clusters() {
        let values = [1e8 + 1.0, 1e8 + 1.001, 1e8 + 2.0, 1e8 + 2.001];
        check(&values, 2, &[0, 0, 1, 1]);
    }

    /// The smallest sum of squares over all ways to cut the sorted values.
    fn by_trying_all(sorted: &[f64], count: usize) -> f64 {
        let cost = |part: &[f64]| {
            let mean = part.iter().sum::<f64>() / part.len() as f64;
            part.iter().map(|value| (value - mean).powi(2)).sum::<f64>()
        };
        if count == 1 {
            return cost(sorted);
        }
        (count - 1..sorted.len())
            .map(|cut| by_trying_all(&sorted[..cut], count - 1) + cost(&sorted[cut..]))
            .fold(f64::INFINITY, f64::min)
    }

    proptest! {
        #[test]
        fn no_other_partition_costs_less(
            values in prop::collection::vec(-50..50_i32, 5..13),
            count in 1..5_usize,
        ) {
            let mut values: Vec<f64> = values.into_iter().map(f64::from).collect();
            let Ok(found) = optimal(&values, count) else { return Ok(()) };
            values.sort_by(f64::total_cmp);
            let best = by_trying_all(&values, count);
            prop_assert!((found.sum_of_squares - best).abs() < 1e-9 * (1.0 + best), "{found:?} {best}");
        }
    }
}
