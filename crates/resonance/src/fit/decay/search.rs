//! Searches for the circuits that explain readings of a free decay nearly equally well.

use super::{Hypothesis, Stays, start::Trials};
use crate::{
    circuit::trace::ModelEstimate,
    fit::grid::{CircuitPrior, are_apart},
    noise::{self, PooledVariance},
};

/// Number of trials that are refined to their minimum, and number of circuits that are kept.
const STARTS: usize = 6;
const KEPT: usize = 4;
/// Twice the log-likelihood by which the best circuit must beat every other.
const LEAD: f64 = 16.0;
/// Circuits whose resonances differ by less than this many standard deviations are the same.
const SAME_SIGMAS: f64 = 3.0;
/// Offsets of alternatives to a circuit that does not describe the readings, in linewidths, and factors
/// of their quality factor.
const BESIDE: [f64; 6] = [-0.8, -0.4, -0.15, 0.15, 0.4, 0.8];
const OTHER_Q: [f64; 2] = [0.75, 1.33];
/// A descent is abandoned if this many more steps with the savings of the last would not reach the best
/// circuit.
const PACE: f64 = 2.0;
/// A descent is abandoned near a better circuit: with a resonance within its standard deviations and a
/// logarithm of the quality factor within this.
const SAME_LN_Q: f64 = 0.3;
/// Largest number of rows of a search, about a millisecond; one search in two hundred would take more. Circuits found before and
/// a descent below the best circuit so far are still refined to their minima, and later descents are omitted.
pub(crate) const ROWS_MAX: u64 = 9000;
/// Descents that a search completes regardless of its rows: those from circuits found before, the first that finds a
/// circuit and those before it without one, or the one that is below the best when the rows end, and the step of the last.
pub(crate) const DESCENTS_MAX: usize = KEPT + STARTS + 2;
/// χ² may exceed its mean by this many of its standard deviations.
const CHI_SQUARED_SIGMAS: f64 = 2.7;
/// The same from which on a wrong reading is looked for.
const SUSPECT_SIGMAS: f64 = 1.5;
/// Analyzers differ from a guessed noise by up to a factor of five, which corresponds to half a degree of
/// freedom.
const DEGREES_OF_A_GUESS: f64 = 0.5;
/// Residual degrees of freedom above which a guess has `DEGREES_OF_A_GUESS`; a wrong circuit is then
/// detected in other ways.
const ENOUGH_DEGREES: f64 = 30.0;

/// Further starts of a search, beyond the circuits found before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Effort {
    /// No further starts.
    Follow,
    /// The starts given by the trials.
    Trials,
    /// Starts near the best circuit, because miscounted beats lead to a minimum near the right one.
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
    allowed_within(CHI_SQUARED_SIGMAS, degrees, noise)
}

fn allowed_within(sigmas: f64, degrees: f64, noise: PooledVariance) -> f64 {
    let mut prior = noise.prior();
    if noise.is_guess() && degrees > ENOUGH_DEGREES {
        prior.degrees_of_freedom = DEGREES_OF_A_GUESS;
    }
    noise::allowed(degrees, Some(&prior), sigmas)
}

impl Hypothesis {
    /// Whether another circuit has nearly this resonance and quality factor.
    fn is_beside(&self, other: &ModelEstimate) -> bool {
        let off_hz = (self.at.resonance_hz - other.resonance_hz).abs();
        off_hz <= SAME_SIGMAS * self.sigma_hz() && (self.at.q / other.q).ln().abs() < SAME_LN_Q
    }
}

impl Search<'_> {
    /// Whether the residuals of this circuit exceed the allowed noise.
    pub(crate) fn is_misfit(&self, one: &Hypothesis) -> bool {
        self.is_misfit_even_less(one, 0.0)
    }

    /// The same if its cost were less by `saved`.
    pub(crate) fn is_misfit_even_less(&self, one: &Hypothesis, saved: f64) -> bool {
        self.exceeds(CHI_SQUARED_SIGMAS, one.normal.cost - saved)
    }

    /// Whether a wrong reading may be among them: one sweep in fifteen without any looks like this.
    pub(crate) fn is_suspect(&self, one: &Hypothesis) -> bool {
        self.exceeds(SUSPECT_SIGMAS, one.normal.cost) || one.has_far(self.noise)
    }

    fn exceeds(&self, sigmas: f64, cost: f64) -> bool {
        let degrees = self.stays.degrees();
        let found = cost / degrees * self.stays.known.variance;
        degrees > 0.0 && found > allowed_within(sigmas, degrees, self.noise) * self.noise.variance()
    }

    /// The best circuits, sorted from the best, without duplicates.
    pub(crate) fn run(
        &self,
        earlier: Vec<Hypothesis>,
        last: Option<ModelEstimate>,
        effort: Effort,
    ) -> Vec<Hypothesis> {
        let is_circuit = |one: &Hypothesis| {
            one.at.c1 > 0.0
                && one.at.c0 > 0.0
                && one.evidence().is_finite()
                && one.variance().is_finite()
        };
        let rows_max = self.stays.work.get() + ROWS_MAX;
        let mut found: Vec<Hypothesis> = Vec::new();
        let descend = |found: &mut Vec<Hypothesis>, start, states, is_known: bool| {
            let least = found.iter().map(Hypothesis::evidence).fold(f64::INFINITY, f64::min);
            let is_needed = is_known || found.is_empty();
            let is_wanted = |at: &ModelEstimate, cost: f64, saved: f64| {
                let is_within_reach = cost - PACE * saved < least + LEAD;
                let is_there = found.iter().any(|one| one.is_beside(at) && cost >= one.normal.cost);
                let is_affordable = is_needed || cost < least || self.stays.work.get() < rows_max;
                is_within_reach && !is_there && is_affordable
            };
            if is_needed || self.stays.work.get() < rows_max {
                let one = self.stays.minimum_while(start, states, self.expected, is_wanted);
                found.extend(one.filter(is_circuit));
            }
        };
        for one in earlier {
            // A rival is not forgotten without evidence against it.
            descend(&mut found, one.at, one.states, true);
        }
        if effort == Effort::Beside
            && let Some(at) = found.first().map(|one| one.at)
        {
            for (step, by) in BESIDE.iter().flat_map(|step| OTHER_Q.map(|by| (step, by))) {
                let resonance_hz = at.resonance_hz * (1.0 + step / at.q);
                let start = ModelEstimate { resonance_hz, q: by * at.q, ..at };
                descend(&mut found, start, Vec::new(), false);
            }
        }
        if effort == Effort::Trials {
            let mut starts = self.trials.best(self.expected, &self.stays.known, STARTS);
            starts.extend(last.filter(|_| found.is_empty()));
            for start in starts {
                if found.iter().all(|one| are_apart(&one.at, &start, 1.0)) {
                    descend(&mut found, start, Vec::new(), false);
                }
            }
        }
        found.sort_by(|a, b| a.evidence().total_cmp(&b.evidence()));
        let mut kept: Vec<Hypothesis> = Vec::new();
        for one in found {
            let is_near = kept.first().is_none_or(|best| one.evidence() < best.evidence() + LEAD);
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
