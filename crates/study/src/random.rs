//! Where the studies' chance comes from: named streams of one seed.

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

    /// Another stream that starts from here.
    pub(crate) fn aside(&mut self) -> Self {
        let (seed, name) = (self.0.next_u64(), self.0.next_u64());
        Self::new(seed, name)
    }

    /// The stream of one trial of a name, of which there are many.
    pub(crate) fn of_trial(seed: u64, name: u64, trial: u64) -> Self {
        let mut state = Pcg64::new(u128::from(seed), u128::from(name));
        // Neighbouring states give neighbouring numbers at first: scatter them.
        let scattered = u128::from(trial).wrapping_mul(0x9E37_79B9_7F4A_7C15_F39C_C060_5CED_C835);
        let offset = u128::from(state.next_u64()) << 64 | u128::from(state.next_u64());
        let mut stream = Pcg64::new(scattered ^ offset, u128::from(name));
        stream.next_u64();
        Self(stream)
    }

    /// Even in [0, 1).
    pub(crate) fn uniform(&mut self) -> f64 {
        // The 53 bits that a float between 1/2 and 1 can hold.
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Normal with mean 0 and variance 1 (Box and Muller).
    pub(crate) fn normal(&mut self) -> f64 {
        let (radius, angle) = (1.0 - self.uniform(), self.uniform());
        (-2.0 * radius.ln()).sqrt() * (TAU * angle).cos()
    }

    /// What the numbers are made of, for those who draw by themselves.
    pub(crate) const fn bits(&mut self) -> &mut Pcg64 {
        &mut self.0
    }

    /// One of a few.
    pub(crate) fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        let index = (self.uniform() * of.len() as f64).floor();
        // Below the length, because the draw is below one.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        of[index as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
