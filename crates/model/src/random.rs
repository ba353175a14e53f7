//! Random numbers that a seed repeats on every machine and in every later version.

use std::f64::consts::TAU;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// A sequence of random numbers.
#[derive(Debug, Clone)]
pub struct Stream(Pcg64);

impl Stream {
    /// The stream with this name. Streams of one seed are independent of each other.
    pub fn new(seed: u64, name: u64) -> Self {
        Self(Pcg64::new(u128::from(seed), u128::from(name)))
    }

    /// The stream of a seed alone, for files whose seed selects one stream.
    pub fn of_seed(seed: u64) -> Self {
        Self(Pcg64::seed_from_u64(seed))
    }

    /// The stream of one trial out of many with the same name.
    pub fn of_trial(seed: u64, name: u64, trial: u64) -> Self {
        let mut state = Pcg64::new(u128::from(seed), u128::from(name));
        // Neighbouring states give neighbouring numbers at first: scatter them.
        let scattered = u128::from(trial).wrapping_mul(0x9E37_79B9_7F4A_7C15_F39C_C060_5CED_C835);
        let offset = u128::from(state.next_u64()) << 64 | u128::from(state.next_u64());
        let mut stream = Pcg64::new(scattered ^ offset, u128::from(name));
        stream.next_u64();
        Self(stream)
    }

    /// An independent stream, seeded by the next two numbers of this one.
    pub fn fork(&mut self) -> Self {
        let (seed, name) = (self.0.next_u64(), self.0.next_u64());
        Self::new(seed, name)
    }

    /// Evenly distributed in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        // The 53 bits that a float between 1/2 and 1 can hold.
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Normally distributed with mean 0 and variance 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let (radius, angle) = (1.0 - self.uniform(), self.uniform());
        (-2.0 * radius.ln()).sqrt() * (TAU * angle).cos()
    }

    /// One of 0, 1, …, `count` − 1, all equally likely. `count` is not zero.
    #[expect(clippy::missing_panics_doc, reason = "the remainder is below a usize")]
    pub fn below(&mut self, count: usize) -> usize {
        let count = count as u64;
        // Draws from the incomplete last block are rejected, because they would favour small
        // numbers.
        let excess = (u64::MAX % count + 1) % count;
        loop {
            let draw = self.0.next_u64();
            if draw <= u64::MAX - excess {
                return usize::try_from(draw % count).expect("it is below a usize");
            }
        }
    }

    /// Every order is equally likely (Durstenfeld, Communications of the ACM 7, 1964, 420).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, self.below(last + 1));
        }
    }

    /// One of the items, all equally likely. There is at least one.
    pub fn pick<T: Copy>(&mut self, items: &[T]) -> T {
        let index = (self.uniform() * items.len() as f64).floor();
        // Below the length, because the draw is below one.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        items[index as usize]
    }

    /// The generator, for a library that draws its own numbers.
    pub const fn generator(&mut self) -> &mut Pcg64 {
        &mut self.0
    }
}

/// A normal draw that depends on the seed and the key only, not on the draws before it: a property
/// of a position or of a mounting is the same whenever it is read.
pub fn normal_at(seed: u64, key: [u64; 3]) -> f64 {
    let name = key.into_iter().fold(0x9E37_79B9_7F4A_7C15, |hash: u64, word| mix(hash ^ word));
    Stream::new(seed, name).normal()
}

/// The finaliser of `SplitMix64`.
fn mix(mut word: u64) -> u64 {
    word = word.wrapping_add(0x9E37_79B9_7F4A_7C15);
    word = (word ^ (word >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    word = (word ^ (word >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    word ^ (word >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_normal(draws: &[f64]) {
        let n = draws.len() as f64;
        let mean = draws.iter().sum::<f64>() / n;
        let variance = draws.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
        let kurtosis = draws.iter().map(|x| (x - mean).powi(4)).sum::<f64>() / n / variance.powi(2);
        assert!(mean.abs() < 4.0 / n.sqrt(), "mean {mean}");
        assert!((variance - 1.0).abs() < 4.0 * (2.0 / n).sqrt(), "variance {variance}");
        assert!((kurtosis - 3.0).abs() < 4.0 * (24.0 / n).sqrt(), "kurtosis {kurtosis}");
    }

    #[test]
    fn streams_and_single_draws_are_normal() {
        let mut stream = Stream::new(1, 2);
        check_normal(&(0..20_000).map(|_| stream.normal()).collect::<Vec<_>>());
        check_normal(&(0..20_000).map(|i| normal_at(1, [7, i, 0])).collect::<Vec<_>>());
        check_normal(&(0..20_000).map(|i| normal_at(i, [7, 0, 0])).collect::<Vec<_>>());
    }

    #[test]
    fn neighbouring_keys_are_not_related() {
        let product: f64 =
            (0..20_000).map(|i| normal_at(1, [7, i, 0]) * normal_at(1, [7, i + 1, 0])).sum();
        assert!((product / 20_000.0).abs() < 4.0 / 20_000_f64.sqrt(), "{product}");
    }

    #[test]
    fn a_trial_depends_on_its_seed_its_name_and_its_number_alone() {
        let numbers = |seed, name, trial| {
            let mut stream = Stream::of_trial(seed, name, trial);
            [stream.uniform(), stream.normal(), stream.uniform()]
        };
        assert_eq!(numbers(1, 2, 3), numbers(1, 2, 3));
        for other in [numbers(2, 2, 3), numbers(1, 3, 3), numbers(1, 2, 4)] {
            let apart = numbers(1, 2, 3).iter().zip(other).all(|(a, b)| (a - b).abs() > 1e-3);
            assert!(apart, "{other:?}");
        }
    }

    #[test]
    fn every_order_of_three_is_equally_likely() {
        let mut random = Stream::of_seed(7);
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
