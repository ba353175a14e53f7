//! Excludes wrong readings among those of a free decay.
//!
//! A wrong reading misleads the circuit and the free decay of its stay, so that good readings deviate
//! too. So each of the readings that deviate most is left out by itself, the circuit is fitted or
//! searched again, and the reading whose omission explains the rest best is excluded. This is repeated
//! while the rest is not described, up to one reading in ten.
//!
//! Where the circuit is known roughly, each stay is first compared with itself: a reading that lies far
//! from the others of its stay is excluded for every likely circuit.

use std::f64::consts::PI;

use num_complex::Complex64;
use rig_model::Window;

use super::{
    Hypothesis, Modelled, Stay, Stays,
    search::{Effort, Search},
    start::Trials,
    stay::State,
};
use crate::{circuit::trace::ModelEstimate, fit::grid::CircuitPrior, noise::PooledVariance};

/// One reading in ten may be excluded; a plan has fewer readings than a grid.
const READINGS_PER_OUTLIER: usize = 10;

/// Number of readings that are left out by themselves in a round.
const CANDIDATES: usize = 10;
/// The same of a stay that is compared with itself within limits.
const CANDIDATES_OF_STAY: usize = 4;
/// Largest number of rows of such comparisons for a verdict.
const ROWS_OF_STAYS_MAX: u64 = 20_000;
/// Number of them without which the circuit is searched again.
const SEARCHED: usize = 2;
/// Twice the log-likelihood that an excluded reading must gain, which is also the largest weighted |r|²
/// of a usual one. One good reading in fifty thousand exceeds it, and its loss is harmless.
const GAIN_MIN: f64 = 22.0;
/// Median of the weighted |r|² of usual readings.
const MEDIAN: f64 = 1.386;
/// Largest ratio of the noise variance to a guessed one.
const LOUDEST: f64 = 25.0;
/// Number of rows after which no further reading is left out at once, a few milliseconds.
pub(crate) const ROWS_MAX: u64 = 30_000;
/// Largest number of readings, once for each trial of a grid, in the searches of a step: ten milliseconds.
const TRIALS_MAX: usize = 200_000;
/// Largest number of readings of a planned sweep. Sweeps that reach their target take up to 180, and up to twice as many with
/// a wrong reading, on the sensors with the weakest resonance.
pub(crate) const READINGS_OF_PLAN_MAX: usize = 360;
/// Largest number of readings that are excluded at once.
const ROUNDS: usize = 8;
/// Standard deviation in linewidths. Above it other circuits are searched for, but no second mode.
pub(crate) const CERTAIN: f64 = 0.1;

/// The criteria of the search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Criteria<'a> {
    pub(crate) expected: &'a CircuitPrior,
    pub(crate) noise: PooledVariance,
    /// The window of the trials.
    pub(crate) within: Window,
}

/// The readings without outliers, and what describes them.
#[derive(Debug)]
pub(crate) struct Rest {
    pub(crate) stays: Stays,
    pub(crate) found: Vec<Hypothesis>,
}

/// Factor of the standard deviation after readings were excluded: where some are wrong, others are too,
/// by less than can be seen.
const WIDENING: f64 = 1.25;

/// The factor of the standard deviation for readings that were excluded.
pub(crate) const fn widening(stays: &Stays) -> f64 {
    if stays.excluded > 0 { WIDENING } else { 1.0 }
}

/// How far the comparison of the readings within their stays may go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Comparison {
    /// As far as a step of a planned sweep has time for.
    Limited,
    /// Without a limit: a survey has more readings, many of them in one stay, and is judged once.
    Full,
}

impl Comparison {
    /// That of this many readings.
    pub(super) const fn of(readings: usize) -> Self {
        if readings > READINGS_OF_PLAN_MAX { Self::Full } else { Self::Limited }
    }

    /// The number of rows at which a comparison ends that starts at `rows`.
    pub(super) const fn rows_max(self, rows: u64) -> u64 {
        match self {
            Self::Limited => rows.saturating_add(ROWS_OF_STAYS_MAX),
            Self::Full => u64::MAX,
        }
    }

    /// Largest number of readings of a stay that are left out by themselves.
    const fn candidates(self) -> usize {
        match self {
            Self::Limited => CANDIDATES_OF_STAY,
            Self::Full => usize::MAX,
        }
    }
}

impl Hypothesis {
    /// Whether a reading deviates more than usual ones.
    pub(crate) fn has_far(&self, noise: PooledVariance) -> bool {
        let gain_min = self.gain_min(noise);
        self.states.iter().any(|state| state.sizes().any(|size| size > gain_min))
    }

    /// Twice the log-likelihood that an excluded reading must gain. Where the noise is a guess, the readings
    /// themselves say how large it is.
    fn gain_min(&self, noise: PooledVariance) -> f64 {
        if !noise.is_guess() {
            return GAIN_MIN;
        }
        let sizes = self.states.iter().flat_map(State::sizes);
        GAIN_MIN * (median_of_used(sizes) / MEDIAN).clamp(1.0, LOUDEST)
    }
}

/// The median of the weighted |r|² of the readings in use; 0 if there is none.
fn median_of_used(sizes: impl Iterator<Item = f64>) -> f64 {
    let mut sizes: Vec<f64> = sizes.filter(|size| *size > 0.0).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    sizes.get(sizes.len() / 2).copied().unwrap_or(0.0)
}

/// How often a step may search the circuit again, at most `most` times: each grid takes time with every reading.
pub(crate) fn searches_of_step(stays: &Stays, within: Window, most: usize) -> usize {
    let each = SEARCHED * Trials::count(within) * stays.count();
    most.min(TRIALS_MAX / each.max(1))
}

/// The readings that are left when those are excluded that `found` does not describe, one after
/// another; `None` if no few readings are to blame. `searches` is the largest number of them for which
/// the circuit is searched again.
pub(crate) fn without(
    stays: &Stays,
    found: &[Hypothesis],
    criteria: &Criteria<'_>,
    mut searches: usize,
) -> Option<Rest> {
    let mut rest = Rest { stays: stays.clone(), found: found.to_vec() };
    let rows_max = stays.work.get() + ROWS_MAX;
    for _ in 0..ROUNDS {
        let one = rest.without_one(criteria, searches > 0, rows_max);
        stays.work.set(rest.stays.work.get());
        let Some((next, is_new)) = one else { break };
        searches -= usize::from(is_new);
        rest = next;
        if rest.is_described(criteria) {
            break;
        }
    }
    (rest.stays.excluded > stays.excluded).then_some(rest)
}

impl Stays {
    /// Those without the readings that lie far from the others of their stay, for a circuit near this
    /// one. An error of the circuit shifts all readings, so that it raises the limit. After `rows_max` rows of work the
    /// rest stays.
    pub(super) fn without_far(&self, at: &ModelEstimate, how: Comparison, rows_max: u64) -> Self {
        let alone = |of: &Modelled<'_>| {
            let mut state = State::default();
            let normal = self.computed(of, of.model.prior(of.square), &mut state);
            (normal.cost, state)
        };
        let states: Vec<(f64, State)> = self.models(at).map(|of| alone(&of)).collect();
        let mut rest = self.clone();
        let median = median_of_used(states.iter().flat_map(|(_, state)| state.sizes()));
        let limit = GAIN_MIN * (median / MEDIAN).max(1.0);
        let readings = self.count() + self.excluded;
        let mut left = readings.div_ceil(READINGS_PER_OUTLIER).saturating_sub(self.excluded);
        for (n, (of, (mut cost, mut state))) in self.models(at).zip(states).enumerate() {
            let mut stay = of.stay.clone();
            for _ in 0..left.min(stay.samples.len() / 2) {
                let is_usual = state.sizes().all(|size| size <= limit);
                if is_usual || self.work.get() > rows_max {
                    break;
                }
                let without = |sample: usize| {
                    let mut stay = stay.clone();
                    stay.samples[sample].exclude();
                    let (rest, state) = alone(&Modelled { stay: &stay, ..of });
                    (rest, sample, state)
                };
                let sizes = state.sizes().enumerate().map(|(sample, size)| (size, sample));
                let far = largest(sizes.filter(|(size, _)| *size > 0.0), how.candidates());
                let all = far.into_iter().map(without);
                let Some((least, sample, next)) = all.min_by(|a, b| a.0.total_cmp(&b.0)) else {
                    break;
                };
                if cost - least <= limit {
                    break;
                }
                stay.samples[sample].exclude();
                (cost, state) = (least, next);
                rest.exclude(n, sample);
                left -= 1;
            }
        }
        rest.work.set(self.work.get());
        rest
    }

    /// Whether the same readings are in use.
    pub(super) fn has_same_readings(&self, other: &Self) -> bool {
        let used = |stays: &Self| -> Vec<bool> {
            stays.all.iter().flat_map(|stay| &stay.samples).map(|one| one.length > 0.0).collect()
        };
        self.excluded == other.excluded && used(self) == used(other)
    }
}

impl Rest {
    /// The rest without one more reading, and whether its circuit was searched again.
    fn without_one(
        &self,
        criteria: &Criteria<'_>,
        may_search: bool,
        rows_max: u64,
    ) -> Option<(Self, bool)> {
        let Self { stays, found } = self;
        let readings = stays.count() + stays.excluded;
        let is_most = stays.excluded >= readings.div_ceil(READINGS_PER_OUTLIER);
        if is_most || stays.work.get() > rows_max {
            return None;
        }
        let evidence = found.first().map_or(f64::INFINITY, Hypothesis::evidence);
        // The best, or the first that describes the rest.
        let best = |all: &mut dyn Iterator<Item = Self>| {
            let mut best: Option<Self> = None;
            for rest in all {
                stays.work.set(rest.stays.work.get());
                let Some(gained) = rest.found.first().map(|one| evidence - one.evidence()) else {
                    continue;
                };
                let gain_min = rest.found[0].gain_min(criteria.noise);
                if gained > gain_min && rest.is_described(criteria) {
                    return Some(rest);
                }
                let least =
                    best.as_ref().map_or(gain_min, |best| evidence - best.found[0].evidence());
                if gained > least {
                    best = Some(rest);
                }
                if stays.work.get() > rows_max {
                    break;
                }
            }
            best
        };
        let suspects = suspects(stays, found);
        let near = best(&mut suspects.iter().filter_map(|&(stay, sample)| {
            near_without(stays, stay, sample, found.first()?, criteria)
        }));
        // One wrong reading among many hardly moves a circuit.
        let is_certain =
            matches!(&found[..], [one] if one.sigma_hz() < CERTAIN * one.linewidth_hz());
        if let Some(near) = near.filter(|rest| is_certain || rest.is_described(criteria)) {
            return Some((near, false));
        }
        if is_certain || !may_search {
            return None;
        }
        let anywhere = best(
            &mut suspects
                .iter()
                .take(SEARCHED)
                .map(|&(stay, sample)| search_without(stays, stay, sample, criteria)),
        );
        Some((anywhere?, true))
    }

    fn is_described(&self, criteria: &Criteria<'_>) -> bool {
        let Criteria { expected, noise, .. } = *criteria;
        let trials = &Trials::none();
        let search = Search { stays: &self.stays, trials, expected, noise };
        let best = self.found.first();
        best.is_some_and(|best| !search.is_misfit(best) && !best.has_far(noise))
    }
}

/// The readings that deviate most from the best circuit or, without one, from the usual capacitance:
/// stay and place in it.
fn suspects(stays: &Stays, found: &[Hypothesis]) -> Vec<(usize, usize)> {
    let used = || {
        let all = stays.all.iter().enumerate();
        all.flat_map(|(stay, one)| (0..one.samples.len()).map(move |sample| (stay, sample)))
            .filter(|&(stay, sample)| stays.all[stay].samples[sample].length > 0.0)
    };
    if let Some(best) = found.first() {
        let sizes: Vec<Vec<f64>> =
            best.states.iter().map(|state| state.sizes().collect()).collect();
        let used = used().map(|(stay, sample)| (sizes[stay][sample], (stay, sample)));
        largest(used, CANDIDATES)
    } else {
        let logarithm = |&(stay, sample): &(usize, usize)| {
            let Stay { frequency_hz, samples, .. } = &stays.all[stay];
            (samples[sample].impedance.unwrap_or_default() * *frequency_hz).ln()
        };
        let mut all: Vec<f64> = used().map(|place| logarithm(&place).re).collect();
        all.sort_unstable_by(f64::total_cmp);
        let middle = all.get(all.len() / 2).copied().unwrap_or_default();
        let turned = -0.5 * PI;
        let away = |place| (logarithm(&place) - Complex64::new(middle, turned)).norm();
        largest(used().map(|place| (away(place), place)), CANDIDATES)
    }
}

/// The places of the largest deviations, from the largest.
fn largest<P>(sizes: impl Iterator<Item = (f64, P)>, count: usize) -> Vec<P> {
    let mut sizes: Vec<(f64, P)> = sizes.collect();
    sizes.sort_by(|a, b| b.0.total_cmp(&a.0));
    sizes.truncate(count);
    sizes.into_iter().map(|(_, place)| place).collect()
}

/// The circuit near this one that describes the readings without this reading.
fn near_without(
    stays: &Stays,
    stay: usize,
    sample: usize,
    best: &Hypothesis,
    criteria: &Criteria<'_>,
) -> Option<Rest> {
    let mut stays = stays.clone();
    stays.exclude(stay, sample);
    let mut states = best.states.clone();
    states[stay] = State::default();
    let found = stays.minimum_while(best.at, states, criteria.expected, |_, _, _| true)?;
    Some(Rest { stays, found: vec![found] })
}

/// The circuits that describe the readings without this one.
fn search_without(stays: &Stays, stay: usize, sample: usize, criteria: &Criteria<'_>) -> Rest {
    let mut stays = stays.clone();
    stays.exclude(stay, sample);
    let Criteria { expected, noise, within } = *criteria;
    let mut trials = Trials::new(within);
    trials.add_all(&stays);
    let search = Search { stays: &stays, trials: &trials, expected, noise };
    let found = search.run(Vec::new(), None, Effort::Trials);
    Rest { stays, found }
}
