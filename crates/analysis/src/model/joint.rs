//! The chance of several tests of one cause together.
//!
//! Tests of one cause have much in common: two forms of a slip differ in a few touches. Adding their probabilities
//! (Bonferroni) counts twice what two tests share.

use super::judge::{above, one_sided};

/// Which scores speak for a term.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// Large ones of either sign.
    Either,
    /// Positive ones.
    Positive,
}

/// A test by a score, which is normal with variance one if the model holds.
#[derive(Debug, Clone)]
pub(super) struct Test {
    pub(super) side: Side,
    /// The part that this test has of the chance of all tests. The weights of all tests have any sum.
    pub(super) weight: f64,
    /// The scores of two tests have the product of their directions as correlation.
    pub(super) direction: Vec<f64>,
}

impl Test {
    /// The probability of a score that speaks at least as much for the term.
    pub(super) fn probability(&self, score: f64) -> f64 {
        match self.side {
            Side::Either => (2.0 * above(score.abs())).min(1.0),
            Side::Positive => above(score),
        }
    }

    /// The score with this probability.
    fn limit(&self, probability: f64) -> f64 {
        match self.side {
            Side::Either => one_sided(0.5 * probability),
            Side::Positive => one_sided(probability),
        }
    }
}

/// The probability that chance makes one of these tests speak at least as much as the strongest of these scores; each
/// test counts by its weight.
pub(super) fn probability(tests: &[Test], scores: &[f64]) -> f64 {
    let sum: f64 = tests.iter().map(|test| test.weight).sum();
    let strength = |(test, score): (&Test, &f64)| test.probability(*score) * sum / test.weight;
    let least = tests.iter().zip(scores).map(strength).fold(f64::INFINITY, f64::min);
    // Beyond, the limits are on the wrong side of zero.
    if least > 0.5 { least.min(1.0) } else { of_any(tests, &limits(tests, least)).min(least) }
}

/// The score that each test must exceed for all tests together to have this probability of chance.
pub(super) fn limits_of(tests: &[Test], chance: f64) -> Vec<f64> {
    // Each halving adds a bit; the sum of the probabilities is never less than that of any, and never more than all
    // of them times that of any.
    const HALVINGS: usize = 40;
    let (mut low, mut high) = (chance, chance * tests.len().max(1) as f64);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if of_any(tests, &limits(tests, middle)) < chance { low = middle } else { high = middle }
    }
    limits(tests, low)
}

/// The limits of the tests when their probabilities have this sum.
fn limits(tests: &[Test], sum_of_all: f64) -> Vec<f64> {
    let sum: f64 = tests.iter().map(|test| test.weight).sum();
    tests.iter().map(|test| test.limit((sum_of_all * test.weight / sum).min(0.5))).collect()
}

/// A bound of the probability that any score exceeds its limit: the sum of all, less what pairs along a tree have in
/// common. The tree is the one that takes most.
///
/// # Source
/// Hunter, J. Appl. Prob. 13 (1976) 597; Worsley, Biometrika 69 (1982) 297.
fn of_any(tests: &[Test], limits: &[f64]) -> f64 {
    let alone = |(test, limit): (&Test, &f64)| test.probability(*limit);
    let sum: f64 = tests.iter().zip(limits).map(alone).sum();
    let common = |i: usize, j: usize| {
        let correlation: f64 =
            tests[i].direction.iter().zip(&tests[j].direction).map(|(a, b)| a * b).sum();
        let both = |sign: f64| both_above(limits[i], limits[j], sign * correlation);
        match (tests[i].side, tests[j].side) {
            (Side::Positive, Side::Positive) => both(1.0),
            (Side::Either, Side::Either) => 2.0 * (both(1.0) + both(-1.0)),
            _ => both(1.0) + both(-1.0),
        }
    };
    // Prim's tree: for each test outside of it, the most that it has in common with one inside.
    let mut outside: Vec<(usize, f64)> = (1..tests.len()).map(|j| (j, common(0, j))).collect();
    let mut taken = 0.0;
    while let Some(next) = (0..outside.len()).max_by(|a, b| outside[*a].1.total_cmp(&outside[*b].1))
    {
        let (inside, most) = outside.swap_remove(next);
        taken += most;
        for (j, most) in &mut outside {
            *most = most.max(common(inside, *j));
        }
    }
    (sum - taken).max(0.0)
}

/// The probability that two normal variables of this correlation both exceed their limits.
///
/// # Source
/// Drezner and Wesolowsky, Journal of Statistical Computation and Simulation 35 (1990) 101, equation 3.
fn both_above(h: f64, k: f64, correlation: f64) -> f64 {
    // The middles of so many parts leave an error below one part in 10,000 of the result.
    const PARTS: u32 = 64;
    let width = correlation.clamp(-1.0, 1.0).asin() / f64::from(PARTS);
    let at = |part: u32| {
        let (sin, cos) = (width * (f64::from(part) + 0.5)).sin_cos();
        (-(h * h + k * k - 2.0 * h * k * sin) / (2.0 * cos * cos)).exp()
    };
    let integral: f64 = (0..PARTS).map(at).sum::<f64>() * width;
    (above(h) * above(k) + integral / std::f64::consts::TAU).max(0.0)
}

#[cfg(test)]
mod tests {
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Two variables with a correlation of one half are both positive in a third of all cases (Sheppard). A variable and
    /// itself exceed both limits when it exceeds the larger one.
    #[test]
    fn two_normal_variables_exceed_their_limits_as_often_as_is_known() {
        #[track_caller]
        fn check(limits: [f64; 2], correlation: f64, expected: f64) {
            let found = both_above(limits[0], limits[1], correlation);
            assert!((found - expected).abs() < 2e-4 * expected + 1e-6, "{found}, not {expected}");
        }
        check([0.0, 0.0], 0.5, 1.0 / 3.0);
        check([1.0, 2.0], 0.0, above(1.0) * above(2.0));
        check([2.0, 2.0], 1.0, above(2.0));
        check([2.5, 3.0], 1.0, above(3.0));
        check([2.0, 2.0], -1.0, 0.0);
        // The sum over all signs of the second is the first alone.
        let both = [1.0, -1.0].map(|sign| both_above(2.0, sign * 1.0, sign * 0.7));
        check([2.0, -40.0], 0.0, both.iter().sum());
    }

    fn test(side: Side, weight: f64, direction: [f64; 3]) -> Test {
        let length = direction.iter().map(|one| one * one).sum::<f64>().sqrt();
        Test { side, weight, direction: direction.iter().map(|one| one / length).collect() }
    }

    #[test]
    fn tests_that_are_one_count_as_one_and_independent_ones_add() {
        let one = test(Side::Positive, 1.0, [1.0, 0.0, 0.0]);
        let found = probability(&[one.clone(), one.clone()], &[3.0, 3.0]);
        // Each has half of the weight, and the second adds nothing.
        assert!((found / above(3.0) - 1.0).abs() < 1e-3, "{found}");
        let other = test(Side::Positive, 3.0, [0.0, 1.0, 0.0]);
        let found = probability(&[one.clone(), other], &[3.0, 0.0]);
        assert!((found / (4.0 * above(3.0)) - 1.0).abs() < 0.01, "{found}");
        assert_eq!(probability(&[one], &[-1.0]), 1.0_f64.min(above(-1.0)));
    }

    /// Of 40,000 draws of five tests, of either and of one side, as many exceed a limit as was asked for, or a few
    /// less: a bound may be too large by what three tests have in common.
    #[test]
    fn chance_exceeds_the_limits_as_often_as_was_asked_for() {
        const DRAWS: u32 = 40_000;
        let tests = [
            test(Side::Positive, 4.0, [1.0, 0.0, 0.2]),
            test(Side::Positive, 2.0, [1.0, 0.4, 0.2]),
            test(Side::Positive, 1.0, [1.0, 0.9, 0.0]),
            test(Side::Positive, 1.0, [-0.5, 0.0, 1.0]),
            test(Side::Either, 2.0, [0.0, 1.0, 0.5]),
        ];
        let limits = limits_of(&tests, 0.02);
        let mut random = Pcg64Mcg::seed_from_u64(5);
        // Box and Muller; the first is never zero.
        let mut normal = || {
            let [a, b] = [0, 1].map(|_| (random.next_u64() as f64 + 1.0) / 2.0_f64.powi(64));
            (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
        };
        let mut exceeds = || {
            let draw = [normal(), normal(), normal()];
            let score = |test: &Test| test.direction.iter().zip(draw).map(|(a, b)| a * b).sum();
            let scores: Vec<f64> = tests.iter().map(score).collect();
            let any = tests.iter().zip(&scores).zip(&limits).any(|((test, score), limit)| {
                let score = if test.side == Side::Either { score.abs() } else { *score };
                score > *limit
            });
            assert_eq!(any, probability(&tests, &scores) < 0.02, "{scores:?}");
            any
        };
        let found = f64::from((0..DRAWS).map(|_| u32::from(exceeds())).sum::<u32>());
        let expected = 0.02 * f64::from(DRAWS);
        assert!((0.85 * expected..1.1 * expected).contains(&found), "{found}, not {expected}");
    }
}
