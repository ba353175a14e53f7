//! Random draws that a seed repeats on every machine and in every later version.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// What a stream of draws is for. Streams of one seed are independent, so that a change in one
/// part of a protocol leaves the draws of the other as they were.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Stream {
    /// The order of the main phase.
    Order = 1,
    /// The trials of the blind phase.
    Blind = 2,
}

#[derive(Debug)]
pub(crate) struct Random(Pcg64);

impl Random {
    /// `seed` has at most 53 bits; the bits above tell the streams apart.
    pub(crate) fn new(seed: u64, stream: Stream) -> Self {
        Self(Pcg64::seed_from_u64(seed | (stream as u64) << 53))
    }

    /// One of 0, 1, …, `count` − 1, all equally likely. `count` is not zero.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        let count = count as u64;
        // Draws from the incomplete last block are thrown away: they would favour small numbers.
        let excess = (u64::MAX % count + 1) % count;
        loop {
            let draw = self.0.next_u64();
            if draw <= u64::MAX - excess {
                return usize::try_from(draw % count).expect("it is below a usize");
            }
        }
    }

    /// Every order is equally likely (Durstenfeld, Communications of the ACM 7, 1964, 420).
    pub(crate) fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, self.below(last + 1));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_draws_what_it_has_always_drawn() {
        let draws = |stream| {
            let mut random = Random::new(1, stream);
            std::array::from_fn::<_, 6, _>(|_| random.below(1000))
        };
        assert_eq!(draws(Stream::Order), [361, 728, 315, 785, 329, 329]);
        assert_eq!(draws(Stream::Blind), [661, 764, 214, 272, 457, 385]);
    }

    #[test]
    fn every_order_of_three_is_equally_likely() {
        let mut random = Random::new(7, Stream::Order);
        let mut seen = [0_u32; 6];
        for _ in 0..6000 {
            let mut items = [0, 1, 2];
            random.shuffle(&mut items);
            seen[2 * items[0] + usize::from(items[1] > items[2])] += 1;
        }
        // Five standard deviations of a count of mean 1000 are 144.
        assert!(seen.iter().all(|count| count.abs_diff(1000) < 144), "{seen:?}");
    }
}
