//! The number of classes, estimated from the values.
//!
//! Each number of classes is tried with its best partition. The cost counts the parameters of the
//! classes and the label of each value; without the labels, two halves would always cost less than
//! one class.

use crate::cluster::{ClusterError, Clustering, optimal};

/// The estimated number of classes and the partition into them.
#[derive(Debug, Clone, PartialEq)]
pub struct Classes {
    /// Number of classes.
    pub count: usize,
    /// The partition of the logarithms.
    pub clustering: Clustering,
    /// `costs[k − 1]` is the cost of k classes; the lowest wins. Differences below about six are not
    /// significant.
    pub costs: Vec<f64>,
}

/// The classes of positive values on a logarithmic scale, at most `max` of them.
///
/// `sigma_rel` is the relative standard deviation of a single value from its measurement alone. It is
/// the smallest width of a class.
///
/// # Errors
/// [`ClusterError`] when a value is not a positive number or the list is empty.
///
/// # Source
/// The classification likelihood of classes with a common variance (Symons, Biometrics 37 (1981)
/// 35) with the penalty of Schwarz's criterion, as in Biernacki, Celeux and Govaert, IEEE TPAMI 22
/// (2000) 719.
pub fn count_classes(values: &[f64], sigma_rel: f64, max: usize) -> Result<Classes, ClusterError> {
    // The logarithm of a value that is not positive is not finite, and is refused as such.
    let logs: Vec<f64> = values.iter().map(|value| value.ln()).collect();
    let one = optimal(&logs, 1)?;
    let mut costs = vec![cost(&one, 1, sigma_rel)];
    let (mut least, mut best) = (costs[0], (1, one));
    for count in 2..=max {
        // More classes than different values.
        let Ok(clustering) = optimal(&logs, count) else { break };
        let cost = cost(&clustering, count, sigma_rel);
        costs.push(cost);
        if cost < least {
            (least, best) = (cost, (count, clustering));
        }
    }
    let (count, clustering) = best;
    Ok(Classes { count, clustering, costs })
}

/// Minus twice the logarithm of the classification likelihood, plus the penalty.
fn cost(clustering: &Clustering, count: usize, sigma_rel: f64) -> f64 {
    let n = clustering.clusters.len() as f64;
    let floor = (sigma_rel * sigma_rel).max(f64::MIN_POSITIVE);
    let variance = (clustering.sum_of_squares / n).max(floor);
    let mut sizes = vec![0.0_f64; count];
    for &cluster in &clustering.clusters {
        sizes[cluster] += 1.0;
    }
    let labels: f64 =
        sizes.iter().filter(|&&size| size > 0.0).map(|size| size * (size / n).ln()).sum();
    // Centres, shares and the common variance.
    let parameters = 2.0 * count as f64;
    n * variance.ln() + clustering.sum_of_squares / variance - 2.0 * labels + parameters * n.ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values around each centre, evenly over a relative width.
    fn around(centres: &[f64], width: f64, each: u32) -> Vec<f64> {
        let share = |i: u32| (f64::from(i) + 0.5) / f64::from(each) - 0.5;
        centres
            .iter()
            .flat_map(|centre| (0..each).map(move |i| centre * (1.0 + width * share(i))))
            .collect()
    }

    #[track_caller]
    fn check(values: &[f64], expected: usize) {
        let found = count_classes(values, 0.01, 10).unwrap();
        assert_eq!(found.count, expected, "{:?}", found.costs);
    }

    #[test]
    fn as_many_classes_are_found_as_there_are() {
        let shifts = [7.0, 15.6, 33.3, 44.2, 80.0];
        for count in 1..=5 {
            check(&around(&shifts[..count], 0.2, 10), count);
        }
    }

    #[test]
    fn one_wide_class_is_not_two() {
        check(&around(&[50.0], 0.6, 50), 1);
    }

    /// On both sides of the distance at which two classes merge.
    #[test]
    fn two_classes_are_two_until_they_touch() {
        check(&around(&[30.0, 45.0], 0.2, 25), 2);
        check(&around(&[30.0, 31.0], 0.2, 25), 1);
    }

    #[test]
    fn equal_values_are_one_class_and_no_values_are_refused() {
        check(&[3.0; 20], 1);
        assert_eq!(
            count_classes(&[], 0.01, 5),
            Err(ClusterError::TooFewValues { distinct: 0, wanted: 1 })
        );
        assert!(matches!(
            count_classes(&[1.0, -1.0], 0.01, 5),
            Err(ClusterError::NotFinite { .. })
        ));
    }
}
