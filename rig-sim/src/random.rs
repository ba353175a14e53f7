//! Where the simulator's chance comes from: streams and single draws, all from the scene's seed.

use std::f64::consts::TAU;

use rand_core::Rng;
use rand_pcg::Pcg64;

/// A sequence of random numbers.
#[derive(Debug, Clone)]
pub(crate) struct Stream(Pcg64);

impl Stream {
    /// The stream of this name. Streams of one seed do not depend on how much of another was used.
    pub(crate) fn new(seed: u64, name: u64) -> Self {
        Self(Pcg64::new(u128::from(seed), u128::from(name)))
    }

    /// Evenly distributed in [0, 1).
    pub(crate) fn uniform(&mut self) -> f64 {
        // The 53 bits that a float between 1/2 and 1 can hold.
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Normally distributed with mean 0 and variance 1 (Box and Muller).
    pub(crate) fn normal(&mut self) -> f64 {
        let (radius, angle) = (1.0 - self.uniform(), self.uniform());
        (-2.0 * radius.ln()).sqrt() * (TAU * angle).cos()
    }
}

/// A normal draw that depends on nothing but the seed and the key.
///
/// What belongs to a place or a mounting has to be the same whenever it is looked at, however often
/// and in whatever order.
pub(crate) fn normal_at(seed: u64, key: [u64; 3]) -> f64 {
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
}
