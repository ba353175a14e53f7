//! The circuits that explain readings of a free decay nearly equally well.

use super::{Hypothesis, Stays, start::Trials};
use crate::{
    grid::{CircuitPrior, are_apart},
    scatter::{self, PooledVariance},
    trace::ModelEstimate,
};

/// Trials that are followed to their minimum, and circuits that are kept.
pub(crate) const STARTS: usize = 6;
pub(crate) const KEPT: usize = 4;
/// Twice the log-likelihood by which the best circuit must beat every other.
const LEAD: f64 = 16.0;
/// Circuits whose resonances differ by less than this many standard deviations are the same.
const SAME_SIGMAS: f64 = 3.0;
/// Linewidths beside a circuit that does not describe the readings, where others are tried, and by what
/// factor another quality is.
const BESIDE: [f64; 6] = [-0.8, -0.4, -0.15, 0.15, 0.4, 0.8];
const OTHER_Q: [f64; 2] = [0.75, 1.33];
/// Descents of a search among trials and of one beside the best.
pub(crate) const DESCENTS_MAX: usize = 2 * KEPT + STARTS + BESIDE.len() * OTHER_Q.len() + 1;
/// χ² may exceed its mean by this many of its standard deviations.
const CHI_SQUARED_SIGMAS: f64 = 3.1;
/// Noise that comes from no more errors than these is a guess: analyzers differ by a factor of five
/// from it, which half an error stands for.
const GUESSED_DEGREES: f64 = 4.0;
const DEGREES_OF_A_GUESS: f64 = 0.5;
/// … once the readings leave so many degrees of freedom that a wrong circuit shows otherwise.
const ENOUGH_DEGREES: f64 = 30.0;

/// Further starts of a search, beyond the circuits found before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Effort {
    /// Nowhere.
    Follow,
    /// The starts given by the trials.
    Trials,
    /// Beside the best circuit: beats that were counted wrong lead into a valley beside the right one.
    Beside,
}

/// The criteria of a search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Search<'a> {
    pub(crate) stays: &'a Stays,
    pub(crate) trials: &'a Trials,
    pub(crate) expected: &'a CircuitPrior,
    pub(crate) noise: PooledVariance,
}

/// Largest χ² per degree of freedom for this noise.
pub(crate) fn allowed(degrees: f64, noise: PooledVariance) -> f64 {
    let mut prior = noise.prior();
    if prior.degrees_of_freedom <= GUESSED_DEGREES && degrees > ENOUGH_DEGREES {
        prior.degrees_of_freedom = DEGREES_OF_A_GUESS;
    }
    scatter::allowed(degrees, Some(&prior), CHI_SQUARED_SIGMAS)
}

impl Search<'_> {
    /// Whether readings scatter more about this circuit than their noise allows.
    pub(crate) fn is_misfit(&self, one: &Hypothesis) -> bool {
        let degrees = self.stays.degrees();
        let found = one.normal.cost / degrees * self.stays.known.variance;
        degrees > 0.0 && found > allowed(degrees, self.noise) * self.noise.variance()
    }

    /// The best circuits, the best first, none near a better one.
    pub(crate) fn run(
        &self,
        earlier: Vec<Hypothesis>,
        last: Option<ModelEstimate>,
        effort: Effort,
    ) -> Vec<Hypothesis> {
        let is_circuit = |one: &Hypothesis| {
            one.at.c1 > 0.0
                && one.at.c0 > 0.0
                && one.normal.cost.is_finite()
                && one.variance().is_finite()
        };
        let from = |start| Some(self.stays.minimum(start, self.expected)).filter(is_circuit);
        let mut found: Vec<Hypothesis> = earlier
            .into_iter()
            .map(|one| self.stays.follow(one, self.expected))
            .filter(is_circuit)
            .collect();
        if effort == Effort::Beside
            && let Some(at) = found.first().map(|one| one.at)
        {
            for (step, by) in BESIDE.iter().flat_map(|step| OTHER_Q.map(|by| (step, by))) {
                let resonance_hz = at.resonance_hz * (1.0 + step / at.q);
                found.extend(from(ModelEstimate { resonance_hz, q: by * at.q, ..at }));
            }
        }
        if effort == Effort::Trials {
            let mut starts = self.trials.best(self.expected, &self.stays.known, STARTS);
            starts.extend(last.filter(|_| found.is_empty()));
            for start in starts {
                if found.iter().all(|one| are_apart(&one.at, &start, 1.0)) {
                    found.extend(from(start));
                }
            }
        }
        found.sort_by(|a, b| a.normal.cost.total_cmp(&b.normal.cost));
        let mut kept: Vec<Hypothesis> = Vec::new();
        for one in found {
            let is_near = kept.first().is_none_or(|best| one.normal.cost < best.normal.cost + LEAD);
            let is_new = kept.iter().all(|other| {
                let off_hz = (one.at.resonance_hz - other.at.resonance_hz).abs();
                off_hz > SAME_SIGMAS * one.sigma_hz().min(other.sigma_hz())
            });
            if is_near && is_new && kept.len() < KEPT {
                kept.push(one);
            }
        }
        kept
    }
}
