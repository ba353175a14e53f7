//! Lloyd's iteration from a random start.

use rand_core::Rng;

use super::{ClusterError, Clustering, distinct, means};

/// The result of one descent.
#[derive(Debug, Clone, PartialEq)]
pub struct Lloyd {
    /// The last partition; a local optimum if the iteration converged.
    pub clustering: Clustering,
    /// Reason for the stop.
    pub stop: Stop,
}

/// The reason for the end of the iteration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// No value changed its cluster.
    Settled {
        /// Number of moves of the centres.
        moves: usize,
    },
    /// The limit of moves was reached.
    Limit,
}

/// One dimension needs far fewer: descents over 50 values take about ten moves.
const MOVES_MAX: usize = 10_000;

/// One descent of Lloyd's iteration from randomly drawn different values as first centres.
///
/// Each value goes to its nearest centre, the lower one at equal distances, and each centre to the
/// mean of its values, until nothing changes. A cluster that loses its last value keeps its centre,
/// and may stay empty.
///
/// # Errors
/// [`ClusterError`].
///
/// # Source
/// Lloyd 1982, "Least squares quantization in PCM", IEEE Trans. Inf. Theory 28, 129–137.
pub fn lloyd(
    values: &[f64],
    clusters: usize,
    random: &mut impl Rng,
) -> Result<Lloyd, ClusterError> {
    let mut starts = distinct(values, clusters)?;
    for chosen in 0..clusters {
        let other = chosen + below(starts.len() - chosen, random);
        starts.swap(chosen, other);
    }
    starts.truncate(clusters);
    starts.sort_by(f64::total_cmp);

    Ok(descend(values, &starts))
}

fn descend(values: &[f64], starts: &[f64]) -> Lloyd {
    let mut clustering = moved(values, starts);
    for moves in 1..MOVES_MAX {
        let next = moved(values, &clustering.centres);
        if next.clusters == clustering.clusters {
            return Lloyd { clustering, stop: Stop::Settled { moves } };
        }
        clustering = next;
    }
    Lloyd { clustering, stop: Stop::Limit }
}

/// Each value with its nearest centre, and the centres moved to their means.
fn moved(values: &[f64], centres: &[f64]) -> Clustering {
    let bounds: Vec<f64> = centres.windows(2).map(|pair| f64::midpoint(pair[0], pair[1])).collect();
    let nearest = |&value: &f64| bounds.partition_point(|&bound| bound < value);
    let clusters: Vec<usize> = values.iter().map(nearest).collect();
    let means = means(values, &clusters, centres.len());
    let centres = means.into_iter().zip(centres).map(|(mean, &old)| mean.unwrap_or(old)).collect();
    Clustering::new(values, clusters, centres)
}

/// An evenly distributed number below `bound`. Draws from the incomplete last block are rejected.
fn below(bound: usize, random: &mut impl Rng) -> usize {
    let bound = bound as u64;
    let fair = u64::MAX - u64::MAX % bound;
    loop {
        let drawn = random.next_u64();
        if drawn < fair {
            return usize::try_from(drawn % bound).expect("below a usize");
        }
    }
}

#[cfg(test)]
mod tests {
    use rand_core::SeedableRng;
    use rand_pcg::Pcg64;

    use super::super::optimal;
    use super::*;

    /// Five groups of four, as the paper's samples would give them.
    fn values() -> Vec<f64> {
        let groups = [8.0, 18.0, 38.0, 49.0, 89.0];
        groups.iter().flat_map(|centre| [-0.6, -0.2, 0.2, 0.6].map(|off| centre + off)).collect()
    }

    #[test]
    fn some_starts_find_the_optimum_and_some_do_not() {
        let best = optimal(&values(), 5).unwrap();
        let mut random = Pcg64::seed_from_u64(1);
        let (mut found, mut missed) = (0, 0);
        for _ in 0..100 {
            let run = lloyd(&values(), 5, &mut random).unwrap();
            assert!(matches!(run.stop, Stop::Settled { .. }), "{run:?}");
            assert!(run.clustering.sum_of_squares > best.sum_of_squares - 1e-9, "{run:?}");
            assert!(run.clustering.centres.is_sorted(), "{run:?}");
            if run.clustering.clusters == best.clusters { found += 1 } else { missed += 1 }
        }
        assert!(found > 0 && missed > 0, "{found} found the optimum, {missed} did not");
    }

    #[test]
    fn the_same_seed_walks_the_same_way() {
        let walk = |seed| lloyd(&values(), 5, &mut Pcg64::seed_from_u64(seed)).unwrap();
        assert_eq!(walk(7), walk(7));
    }

    #[test]
    fn a_cluster_may_lose_all_its_values() {
        // The middle cluster first takes 0, 0.2 and 10. Its mean, 3.4, is then far from all three.
        let mut values = vec![-0.25, -0.1, 0.0, 0.2, 10.0, 19.9];
        values.extend((0..100).map(|index| 10.1 + 0.001 * f64::from(index)));
        let run = descend(&values, &[-0.25, 0.2, 19.9]);
        assert!(!run.clustering.clusters.contains(&1), "{run:?}");
        assert!(run.clustering.centres.is_sorted(), "{run:?}");
        assert!(matches!(run.stop, Stop::Settled { .. }), "{run:?}");
    }

    #[test]
    fn draws_are_even() {
        let mut random = Pcg64::seed_from_u64(3);
        let mut counts = [0_u32; 3];
        for _ in 0..30_000 {
            counts[below(3, &mut random)] += 1;
        }
        // Six standard deviations of a binomial count.
        assert!(counts.iter().all(|count| count.abs_diff(10_000) < 490), "{counts:?}");
    }
}
