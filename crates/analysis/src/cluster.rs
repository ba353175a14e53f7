//! k-means in one dimension: the paper's automatic classification.
//!
//! [`optimal`] gives the partition with the smallest sum of squares. [`lloyd`] does the same as common
//! k-means routines: it descends from a random start to a local optimum. The two differ exactly
//! where the paper's figure cannot be reproduced without its start values.

mod lloyd;
mod optimal;

pub use lloyd::{Lloyd, Stop, lloyd};
pub use optimal::optimal;

/// Values sorted into clusters.
#[derive(Debug, Clone, PartialEq)]
pub struct Clustering {
    /// Mean of each cluster, ascending. A cluster that [`lloyd`] leaves empty keeps its last centre.
    pub centres: Vec<f64>,
    /// Index of the cluster of each value, in the given order.
    pub clusters: Vec<usize>,
    /// Sum of the squared distances of the values from the centres of their clusters.
    pub sum_of_squares: f64,
}

/// A refused clustering.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ClusterError {
    /// The requested number of clusters is zero.
    #[error("clustering: the number of clusters must be at least 1")]
    NoClusters,
    /// There are fewer different values than clusters.
    #[error("clustering: {distinct} different values cannot fill {wanted} clusters")]
    TooFewValues {
        /// Number of different values.
        distinct: usize,
        /// Requested number of clusters.
        wanted: usize,
    },
    /// A value is infinite or not a number.
    #[error("clustering: value {index} is not finite")]
    NotFinite {
        /// Index of the value.
        index: usize,
    },
}

/// The different values, ascending.
fn distinct(values: &[f64], clusters: usize) -> Result<Vec<f64>, ClusterError> {
    if clusters == 0 {
        return Err(ClusterError::NoClusters);
    }
    if let Some(index) = values.iter().position(|value| !value.is_finite()) {
        return Err(ClusterError::NotFinite { index });
    }
    let mut distinct = values.to_vec();
    distinct.sort_by(f64::total_cmp);
    distinct.dedup();
    if distinct.len() < clusters {
        return Err(ClusterError::TooFewValues { distinct: distinct.len(), wanted: clusters });
    }
    Ok(distinct)
}

/// The mean of each cluster; `None` for an empty one.
fn means(values: &[f64], clusters: &[usize], count: usize) -> Vec<Option<f64>> {
    let mut sums = vec![(0.0, 0.0); count];
    for (&value, &cluster) in values.iter().zip(clusters) {
        sums[cluster].0 += value;
        sums[cluster].1 += 1.0;
    }
    sums.into_iter().map(|(sum, size)| (size > 0.0).then(|| sum / size)).collect()
}

impl Clustering {
    fn new(values: &[f64], clusters: Vec<usize>, centres: Vec<f64>) -> Self {
        let distances =
            values.iter().zip(&clusters).map(|(value, &cluster)| value - centres[cluster]);
        let sum_of_squares = distances.map(|distance| distance * distance).sum();
        Self { centres, clusters, sum_of_squares }
    }
}
