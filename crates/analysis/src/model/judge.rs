//! Whether a model holds, by the residuals of the main touches.
//!
//! χ² notices any misfit. For each pattern the touches are also compared with one further term; that
//! finds a misfit that χ² alone would not, and names it.

use super::{
    evidence::{Rows, samples},
    fit::{Fit, State, Usable, weighted},
    known::Known,
    linear,
    shared::Chi2Expected,
};
use crate::stiffness::Young;

/// The judgement on a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The touches agree with the model.
    Holds,
    /// They would disagree as much by chance in a few runs of a hundred.
    Strained,
    /// They disagree beyond chance.
    Rejected,
}

impl Verdict {
    /// By the probability of chance, in all tests of a run together.
    fn of(probability: f64) -> Self {
        if probability < REJECTED_BELOW {
            Self::Rejected
        } else if probability < STRAINED_BELOW {
            Self::Strained
        } else {
            Self::Holds
        }
    }

    /// The word in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::Strained => "strained",
            Self::Rejected => "rejected",
        }
    }
}

/// A cause of misfit with a term of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pattern {
    /// The contact along the surface: it is softer or stiffer than assumed, or from some angle on.
    Friction,
    /// The length of the probe's arm.
    Arm,
    /// The way in which the depth is held, or the growth of the contact with it.
    Depth,
    /// One sample does not agree with itself; the index of the sample.
    Sample(usize),
    /// The samples of known stiffness do not have one factor; the index of the one that differs most.
    Known(usize),
}

impl Pattern {
    /// The word in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Friction => "friction",
            Self::Arm => "arm",
            Self::Depth => "depth",
            Self::Sample(_) => "sample",
            Self::Known(_) => "known",
        }
    }
}

/// What one further term would change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evidence {
    /// The cause that the term is of.
    pub pattern: Pattern,
    /// χ² that the term removes; for a sample, the excess of its own χ²; for known samples, that of theirs.
    pub chi2_removed: f64,
    /// Probability of as much under a model that holds.
    pub probability: f64,
}

/// The residual of a main touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Index of the touch in the list of the caller.
    pub touch: usize,
    /// Logarithm of its stiffness less the mean of its sample.
    pub log: f64,
    /// The residual in standard deviations.
    pub sigmas: f64,
}

/// What touches show of a contact that slips at some coefficient of friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlipNoticed {
    /// The coefficient below which the touch that needs most friction slides.
    pub begins_below: f64,
    /// The share of the runs in which a slide of this touch alone is noticed.
    pub share_of_first: f64,
    /// A slip that begins below this coefficient is noticed in 95 % of the runs. `None` if no slip is.
    pub below: Option<f64>,
}

/// The judgement with its evidence.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelCheck {
    /// The judgement.
    pub verdict: Verdict,
    /// χ² of the residuals.
    pub chi2: f64,
    /// Touches less unknowns.
    pub freedom: usize,
    /// χ² of touches and differences as independent rows: what touches at one place share is taken out, and
    /// so is a learnt term unless it is at the end of its range.
    pub independent_chi2: f64,
    /// The cause that explains most of the misfit, when there is one.
    pub pattern: Option<Pattern>,
    /// The evidence for each cause, largest first; that of the known samples at the end.
    pub evidence: Vec<Evidence>,
    /// The residuals, in the order of the touches.
    pub residuals: Vec<Residual>,
    /// The least exponent of the depth, by which the contact deviates from its law, that these touches show
    /// in 95 % of the runs. Hertz's law and Sneddon's differ by about 0.1. `None` if they cannot show any, and unless the
    /// model holds.
    pub exponent_noticed: Option<f64>,
    /// What these touches show of a contact that slips. `None` if they cannot show any, and unless the model holds.
    pub slip_noticed: Option<SlipNoticed>,
    /// Relative standard deviation that the residuals ask for in addition: that of their scatter beyond
    /// what was stated, and of a misfit that all samples share under a model that does not hold.
    pub added_rel: f64,
}

impl ModelCheck {
    /// χ² for each degree of freedom.
    pub fn chi2_per_dof(&self) -> f64 {
        self.chi2 / self.freedom as f64
    }

    /// The chance of the best test of any kind to notice what is behind these residuals when they are free of
    /// noise, if it calls as many true models false as the verdict may: one in fifty.
    ///
    /// # Source
    /// Neyman and Pearson, Phil. Trans. R. Soc. A 231 (1933) 289: the ratio of the likelihoods is the most
    /// powerful test, and for normal errors it is normal with the root of this χ² as its mean.
    pub fn noticed_at_most(&self) -> f64 {
        above(NORMAL_OF_STRAINED - self.independent_chi2.max(0.0).sqrt())
    }
}

/// The probability of chance below which a model is strained; in all tests of a run together.
const STRAINED_BELOW: f64 = 0.02;
/// A model is rejected when chance makes as much in fewer runs than this.
const REJECTED_BELOW: f64 = 1e-4;
/// The part that friction has of that probability: no rig file knows the friction of a sample, and what one touch of
/// sixty shows must be told from chance. The other causes and χ² share the rest.
const SHARE_OF_FRICTION: f64 = 0.5;

/// A scatter beyond what was stated counts if chance makes as much in fewer runs: it is more than one standard
/// deviation beyond. Below, it would widen one true run in two.
pub(crate) const BY_CHANCE: f64 = 0.16;

/// A normal variable exceeds this with the probability `STRAINED_BELOW`.
const NORMAL_OF_STRAINED: f64 = 2.053_749;

/// The judgement on a fit; `None` when nothing is free.
pub(super) fn judge(touches: &Usable<'_>, fit: &Fit) -> Option<ModelCheck> {
    let freedom = touches.freedom(fit.learnt.len())?;
    let state = &fit.state;
    let rows = Rows::new(touches, fit);
    let mut evidence = rows.as_ref().map_or_else(Vec::new, Rows::evidence);
    evidence.extend(samples(touches, state));
    let has_friction = evidence.iter().any(|one| one.pattern == Pattern::Friction);
    let of_friction = if has_friction { SHARE_OF_FRICTION } else { 0.0 };
    // χ² is one of the others.
    let others = 1.0 + evidence.len() as f64 - f64::from(u8::from(has_friction));
    let of_other = (1.0 - of_friction) / others;
    let share = |one: &Evidence| {
        if one.pattern == Pattern::Friction { of_friction } else { of_other }
    };
    let main = touches.touches.len();
    let chi2 = weighted(&state.residuals[..main], &state.residuals[..main], &state.weights);
    let samples_of: Vec<usize> = touches.touches.iter().map(|touch| touch.sample).collect();
    let expected = Chi2Expected::of_freedom(freedom as f64, touches.overlap(state));
    let expected = expected.sharing(&samples_of, &state.weights[..main], &state.shared);
    let by_chi2 = expected.probability(chi2);
    let by_cause = evidence.iter().map(|one| one.probability / share(one));
    let least = by_cause.fold(by_chi2 / of_other, f64::min);
    evidence.sort_by(|a, b| b.chi2_removed.total_cmp(&a.chi2_removed));
    // A wrong friction, arm or depth also sets known samples apart, and says more. The samples have three per cent
    // beyond their scatter, so that chance alone hardly alarms this test: it takes nothing from the others.
    let known = Known::of(touches, state);
    evidence.extend(known.evidence());
    let of_known = known.evidence().map_or(1.0, |one| one.probability);
    let verdict = Verdict::of(least.min(of_known / of_other));
    let is_evident = |one: &&Evidence| one.probability < share(one) * STRAINED_BELOW;
    let pattern = evidence.iter().find(is_evident).map(|one| one.pattern);
    let residual = |i: usize| Residual {
        touch: touches.indices[i],
        log: state.residuals[i],
        sigmas: state.residuals[i] * state.weights[i].sqrt(),
    };
    let is_beyond = by_chi2 < BY_CHANCE;
    let scatter =
        if is_beyond { touches.excess_scatter(chi2, state, freedom, expected.mean) } else { 0.0 };
    let added_rel = match verdict {
        Verdict::Holds => scatter,
        Verdict::Strained | Verdict::Rejected => {
            let misfits = [touches.common_misfit(state), touches.depth_misfit(state)];
            misfits.into_iter().fold(scatter.max(known.scatter()), f64::max)
        }
    };
    // What touches can show is computed by their model.
    let if_it_holds = rows.as_ref().filter(|_| verdict == Verdict::Holds);
    Some(ModelCheck {
        verdict,
        chi2,
        freedom,
        independent_chi2: rows.as_ref().map_or(chi2, Rows::chi2),
        pattern: pattern.filter(|_| verdict != Verdict::Holds),
        evidence,
        residuals: (0..touches.touches.len()).map(residual).collect(),
        exponent_noticed: if_it_holds
            .and_then(|rows| rows.exponent_noticed(of_other * STRAINED_BELOW)),
        slip_noticed: if_it_holds.and_then(|rows| rows.slip_noticed(of_friction * STRAINED_BELOW)),
        added_rel,
    })
}

/// The value that a normal variable exceeds with this probability, of at most one half.
pub(super) fn one_sided(probability: f64) -> f64 {
    let (mut low, mut high) = (0.0, 40.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if above(middle) > probability { low = middle } else { high = middle }
    }
    low
}

/// The judgement on the stiffness of sites by χ² alone, without a cause; `None` when no sample has two.
pub(super) fn of_sites(sites: &[(usize, Young)], shared: &[Vec<f64>]) -> Option<ModelCheck> {
    let log = |young: &Young| (young.mpa.ln(), (young.mpa / young.sigma_mpa).powi(2));
    let residual = |(touch, (sample, young)): (usize, &(usize, Young))| {
        let of_sample = || sites.iter().filter(|site| site.0 == *sample).map(|site| log(&site.1));
        let weight: f64 = of_sample().map(|(_, weight)| weight).sum();
        let mean = of_sample().map(|(log, weight)| weight * log).sum::<f64>() / weight;
        let (log, weight) = log(young);
        Residual { touch, log: log - mean, sigmas: (log - mean) * weight.sqrt() }
    };
    let residuals: Vec<Residual> = sites.iter().enumerate().map(residual).collect();
    let mut samples: Vec<usize> = sites.iter().map(|site| site.0).collect();
    samples.sort_unstable();
    samples.dedup();
    let freedom = sites.len().checked_sub(samples.len()).filter(|freedom| *freedom > 0)?;
    let chi2: f64 = residuals.iter().map(|one| one.sigmas.powi(2)).sum();
    let weights: Vec<f64> = sites.iter().map(|site| log(&site.1).1).collect();
    let mean_weight = weights.iter().sum::<f64>() / sites.len() as f64;
    let of_sites: Vec<usize> = sites.iter().map(|site| site.0).collect();
    let expected = Chi2Expected::of_freedom(freedom as f64, 1.0);
    let expected = expected.sharing(&of_sites, &weights, shared);
    let by_chi2 = expected.probability(chi2);
    let is_beyond = by_chi2 < BY_CHANCE;
    let beyond = if is_beyond { chi2 - expected.mean } else { 0.0 };
    Some(ModelCheck {
        verdict: Verdict::of(by_chi2),
        chi2,
        freedom,
        independent_chi2: chi2,
        pattern: None,
        evidence: Vec::new(),
        residuals,
        exponent_noticed: None,
        slip_noticed: None,
        added_rel: (beyond / freedom as f64 / mean_weight).max(0.0).sqrt(),
    })
}

impl Usable<'_> {
    /// The variance of χ² over that of independent touches, when the depth errors are shared.
    fn overlap(&self, state: &State) -> f64 {
        let n = self.touches.len();
        let shared = |i: usize, j: usize| {
            let variances = state.depth_variances[i] * state.depth_variances[j];
            self.shared_depth(i, j).powi(2) * state.weights[i] * state.weights[j] * variances
        };
        let pairs = |i: usize| {
            let others = (0..n).filter(move |&j| j != i && self.shared_depth(i, j) != 0.0);
            others.map(|j| shared(i, j)).sum::<f64>()
        };
        1.0 + (0..n).map(pairs).sum::<f64>() / n as f64
    }

    /// The root mean square over the poses of the misfit that all samples share, against the pose of
    /// the smallest angle, where the stiffness is calibrated.
    fn common_misfit(&self, state: &State) -> f64 {
        let mut poses: Vec<(f64, f64)> = Vec::new();
        let key = |i: usize| {
            let pose = &self.touches[i].pose;
            (pose.angle_rad(), if pose.angle_rad() > 0.0 { pose.azimuth_rad() } else { 0.0 })
        };
        for i in 0..self.touches.len() {
            if !poses.contains(&key(i)) {
                poses.push(key(i));
            }
        }
        // The mean at a pose, its variance without what touches share, and how each row enters it.
        let mean = |pose: &(f64, f64)| {
            let here = || (0..self.touches.len()).filter(|&i| key(i) == *pose);
            let weight: f64 = here().map(|i| state.weights[i]).sum();
            let sum: f64 = here().map(|i| state.weights[i] * state.residuals[i]).sum();
            let mut entering = vec![0.0; state.weights.len()];
            here().for_each(|i| entering[i] = state.weights[i] / weight);
            (sum / weight, 1.0 / weight, entering)
        };
        let Some(first) = poses.iter().min_by(|a, b| a.0.total_cmp(&b.0)) else { return 0.0 };
        let (at_first, variance, in_first) = mean(first);
        let excess = |pose: &(f64, f64)| {
            let (here, own, entering) = mean(pose);
            let apart: Vec<f64> = entering.iter().zip(&in_first).map(|(a, b)| a - b).collect();
            let shared = linear::form(&apart, &state.shared, &apart);
            (here - at_first).powi(2) - variance - own - shared
        };
        let others = poses.iter().filter(|pose| *pose != first);
        let excess: Vec<f64> = others.map(excess).collect();
        let common = excess.iter().sum::<f64>() / excess.len().max(1) as f64;
        common.max(0.0).sqrt()
    }

    /// The root mean square, over the main touches, of the change of the stiffness with the depth along the
    /// normal, from the smallest angle on, if it grows between two depths as the pairs show.
    fn depth_misfit(&self, state: &State) -> f64 {
        let Some(depths) = self.log_depths() else { return 0.0 };
        let main = self.touches.len();
        let of = |a: &[f64], b: &[f64]| weighted(&a[main..], &b[main..], &state.weights[main..]);
        let information = of(&depths, &depths);
        if information == 0.0 {
            return 0.0;
        }
        let exponent = of(&depths, &state.residuals) / information;
        let deepest = depths[..main].iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let squares: f64 = depths[..main].iter().map(|depth| (deepest - depth).powi(2)).sum();
        exponent.abs() * (squares / main as f64).sqrt()
    }

    /// The relative standard deviation that would bring χ² down to what is expected of it; 0 if it is not above that.
    fn excess_scatter(&self, chi2: f64, state: &State, freedom: usize, expected: f64) -> f64 {
        let (main, freedom) = (self.touches.len(), freedom as f64);
        let mean_weight = state.weights[..main].iter().sum::<f64>() / main as f64;
        ((chi2 / freedom - expected / freedom) / mean_weight).max(0.0).sqrt()
    }
}

/// Probability of a χ² at least as large whose variance is larger by this factor, and whose mean is that of
/// independent rows: a χ² of fewer degrees of freedom, times the factor.
///
/// # Source
/// Satterthwaite, Biometrics Bulletin 2 (1946) 110.
pub(super) fn shared_probability(chi2: f64, freedom: f64, overlap: f64) -> f64 {
    chi2_probability(chi2 / overlap, freedom / overlap)
}

/// Probability of a χ² at least as large, by the cube root of Wilson and Hilferty; exact for one degree
/// of freedom.
pub(crate) fn chi2_probability(chi2: f64, freedom: f64) -> f64 {
    if freedom <= 1.0 {
        return 2.0 * above(chi2.max(0.0).sqrt());
    }
    let part = 2.0 / (9.0 * freedom);
    above(((chi2 / freedom).cbrt() - (1.0 - part)) / part.sqrt())
}

/// The probability that a normal variable exceeds `x`.
///
/// # Source
/// Abramowitz and Stegun, Handbook of Mathematical Functions (1964), 26.2.17 up to 3, where it is within
/// 7.5e-8, and the continued fraction 26.2.14 beyond.
pub(super) fn above(x: f64) -> f64 {
    if x < 0.0 {
        return 1.0 - above(-x);
    }
    let density = (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    if x > 3.0 {
        let fraction = (1..=60).rev().fold(x, |tail, k| x + f64::from(k) / tail);
        return density / fraction;
    }
    let t = 1.0 / (1.0 + 0.231_641_9 * x);
    let coefficients =
        [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    density * coefficients.iter().rev().fold(0.0, |sum, coefficient| (sum + coefficient) * t)
}

#[cfg(test)]
mod tests {
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Sixty rows of which twelve each share a third of their variance: each pair of them has a squared
    /// correlation of 1/9, and χ² exceeds its twentieth as often as it should, within four deviations.
    #[test]
    fn a_shared_error_makes_chi2_wider_and_not_larger() {
        let overlap = 1.0 + 11.0 / 9.0;
        let mut random = Pcg64Mcg::seed_from_u64(7);
        // Box and Muller; the first is never zero.
        let mut normal = || {
            let [a, b] = [0, 1].map(|_| (random.next_u64() as f64 + 1.0) / 2.0_f64.powi(64));
            (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
        };
        let mut run = || {
            let mut chi2 = 0.0;
            for _ in 0..5 {
                let shared = normal();
                for _ in 0..12 {
                    let own = normal() * (2.0_f64 / 3.0).sqrt();
                    chi2 += (shared / 3.0_f64.sqrt() + own).powi(2);
                }
            }
            shared_probability(chi2, 60.0, overlap) < 0.05
        };
        let below = (0..4000).filter(|_| run()).count();
        assert!((145..=255).contains(&below), "{below} of 4000");
    }

    /// Tables of the normal and the χ² distribution.
    #[test]
    fn the_probabilities_are_those_of_the_tables() {
        #[track_caller]
        fn check(found: f64, expected: f64, relative: f64) {
            assert!((found / expected - 1.0).abs() < relative, "{found} is not {expected}");
        }
        check(above(0.0), 0.5, 1e-6);
        check(above(1.959_964), 0.025, 1e-5);
        check(above(-1.0), 0.841_344_7, 1e-6);
        check(above(4.0), 3.167_124e-5, 1e-6);
        check(one_sided(0.025), 1.959_964, 1e-6);
        check(above(3.0 + 1e-9), above(3.0), 1e-4);
        check(chi2_probability(3.841_459, 1.0), 0.05, 1e-5);
        check(chi2_probability(73.311, 54.0), 0.041, 0.03);
        check(chi2_probability(18.307, 10.0), 0.05, 0.01);
    }
}
