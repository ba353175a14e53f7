//! The least χ² of the main touches over the terms that they identify.
//!
//! The unknowns are the terms and one stiffness for each sample. A touch gives a stiffness for every
//! choice of the terms, so that the stiffness of a sample is the weighted mean of its touches and
//! only the terms are searched for, by Gauss and Newton.

use std::f64::consts::PI;

use super::{
    LAW_EXPONENT_SIGMA, LearntTerm, MainTouches, ModelSource, RunModel, Term, Terms, TouchErrors,
    judge,
    known::Known,
    linear::{self, Matrix},
    pair::Difference,
    shared::sharing,
};
use crate::stiffness::{Compensation, Halfway, PosedTouch};

/// Steps of a fit at most; it needs three to six.
const STEPS_MAX: usize = 12;
/// Times that a step is halved until χ² falls.
const HALVINGS_MAX: usize = 6;
/// The largest last step, in units of [`Term::step`].
const STEP_TOLERANCE: f64 = 0.02;
/// A term with a larger standard deviation is not identified: the information matrix has no rank for
/// it. The tangential ratio is between 0 and 1 for most contacts.
const RATIO_SIGMA_MAX: f64 = 0.2;
/// The same limit for an arm, relative to the one described.
const ARM_SIGMA_MAX_REL: f64 = 0.35;
/// The share of the variance of the depth that touches at one place of the stages may have in common:
/// a screw repeats its error.
const SHARED_DEPTH: f64 = 0.5;

/// The touches that give a stiffness by the described model.
pub(super) struct Usable<'a> {
    pub(super) described: &'a Compensation,
    pub(super) touches: Vec<PosedTouch>,
    /// Where each of them is in the list of the caller.
    pub(super) indices: Vec<usize>,
    /// The touches that were also measured halfway. Each adds a row behind those of all touches: the
    /// logarithm of its stiffness less that halfway, which is zero under a model that holds.
    pub(super) pairs: Vec<usize>,
    pub(super) main: &'a MainTouches<'a>,
}

/// A fit at its least χ².
#[derive(Debug, Clone)]
pub(super) struct Fit {
    pub(super) terms: Terms,
    pub(super) learnt: Vec<Term>,
    pub(super) covariance: Matrix,
    /// The change of each learnt term with the error of each row.
    gains: Matrix,
    pub(super) state: State,
    /// The slope of each residual over each learnt term.
    pub(super) slopes: Matrix,
}

/// The model that holds the depth in the other way.
struct Rival {
    terms: Terms,
    /// Its probability beside the model of the run.
    probability: f64,
}

/// The touches under given terms.
#[derive(Debug, Clone)]
pub(super) struct State {
    /// Logarithm of each stiffness, and the difference of each pair.
    pub(super) logs: Vec<f64>,
    /// Reciprocal variance of each row, with that from point to point.
    pub(super) weights: Vec<f64>,
    /// The part of that variance from the depth.
    pub(super) depth_variances: Vec<f64>,
    /// The covariance of different rows by their references. The difference of a pair shares nothing with touches.
    pub(super) shared: Matrix,
    /// Each logarithm less the mean of its sample; the differences as they are.
    pub(super) residuals: Vec<f64>,
    pub(super) chi2: f64,
}

/// The model of a run.
pub(super) fn model(
    described: &Compensation,
    main: &MainTouches<'_>,
    source: ModelSource,
) -> RunModel {
    let start = Terms::of(described, main.touches);
    let touches = Usable::new(described, main);
    let errors = TouchErrors::of_touches(main.touches.len(), main.sample_rel.powi(2));
    let found = match source {
        ModelSource::Learnt => touches.learn(&start),
        ModelSource::Described => touches.fit(&start, &[]).map(|fit| (fit, None)),
    };
    let Some((fit, rival)) = found else {
        return RunModel {
            compensation: described.clone(),
            terms: start,
            described: start,
            learnt: Vec::new(),
            covariance: Vec::new(),
            sides: Vec::new(),
            rival: None,
            errors,
            check: None,
        };
    };
    let check = judge::judge(&touches, &fit);
    let is_described = fit.terms == start;
    let with = |terms: &Terms| described.with(terms).map(|model| (*terms, model));
    let side = |term: &Term| {
        let at = |by: f64| with(&term.set(&fit.terms, term.of(&fit.terms) + by));
        Some([at(-term.step())?, at(term.step())?])
    };
    let sides: Vec<_> = fit.learnt.iter().filter_map(side).collect();
    let learnt = |(index, &term): (usize, &Term)| LearntTerm {
        term,
        described: term.of(&start),
        value: term.of(&fit.terms),
        sigma: fit.covariance[index][index].sqrt(),
    };
    let mut covariance = fit.covariance.clone();
    if fit.terms.deflects {
        extend(&mut covariance, LAW_EXPONENT_SIGMA.powi(2));
    }
    let rival = rival.and_then(|Rival { terms, probability }| Some((with(&terms)?, probability)));
    if let Some((_, probability)) = rival {
        extend(&mut covariance, probability);
    }
    let compensation = if is_described { None } else { described.with(&fit.terms) };
    RunModel {
        compensation: compensation.unwrap_or_else(|| described.clone()),
        terms: fit.terms,
        described: start,
        learnt: fit.learnt.iter().enumerate().map(learnt).collect(),
        covariance,
        sides,
        rival: rival.map(|(model, _)| model),
        errors: errors.of_fit(&touches.indices, &touches.covariance(&fit.state), &fit.gains),
        check,
    }
}

/// Adds a term that is independent of the others.
fn extend(covariance: &mut Matrix, variance: f64) {
    for row in covariance.iter_mut() {
        row.push(0.0);
    }
    let mut own = vec![0.0; covariance.len() + 1];
    own[covariance.len()] = variance;
    covariance.push(own);
}

impl<'a> Usable<'a> {
    fn new(described: &'a Compensation, main: &'a MainTouches<'a>) -> Self {
        let usable = |(_, touch): &(usize, &PosedTouch)| described.of_touch(touch).is_ok();
        let usable = main.touches.iter().enumerate().filter(usable);
        let (indices, touches): (Vec<usize>, Vec<PosedTouch>) =
            usable.map(|(index, touch)| (index, *touch)).unzip();
        let is_pair = |(index, touch): (usize, &PosedTouch)| {
            let halfway = touch.at_halfway()?;
            described.of_touch(&halfway).is_ok().then_some(index)
        };
        let pairs = touches.iter().enumerate().filter_map(is_pair).collect();
        Self { described, touches, indices, pairs, main }
    }

    /// The touch of each row.
    pub(super) fn rows(&self) -> impl Iterator<Item = usize> {
        (0..self.touches.len()).chain(self.pairs.iter().copied())
    }

    /// A value of each row: of the touch, and of the touch less that of halfway.
    fn values(&self, of: impl Fn(&PosedTouch) -> Option<f64>) -> Option<Vec<f64>> {
        let mut values: Vec<f64> = self.touches.iter().map(&of).collect::<Option<_>>()?;
        for &pair in &self.pairs {
            values.push(values[pair] - of(&self.touches[pair].at_halfway()?)?);
        }
        Some(values)
    }

    /// The logarithm of the depth along the normal, as a value of each row.
    pub(super) fn log_depths(&self) -> Option<Vec<f64>> {
        self.values(|touch| Some(touch.normal_depth_mm().ln()))
    }

    /// Number of samples with a touch.
    fn samples(&self) -> usize {
        let mut samples: Vec<usize> = self.touches.iter().map(|touch| touch.sample).collect();
        samples.sort_unstable();
        samples.dedup();
        samples.len()
    }

    /// Touches less unknowns; `None` when nothing is left.
    pub(super) fn freedom(&self, learnt: usize) -> Option<usize> {
        self.touches.len().checked_sub(self.samples() + learnt).filter(|freedom| *freedom > 0)
    }

    /// The model with the terms that the touches identify.
    ///
    /// The tangential ratio depends on friction, of which no description knows, and is always learnt.
    /// Schwarz's criterion decides whether the arm is learnt, and between the two ways of holding the
    /// depth. Samples of known stiffness take part in the second decision. The way that is not taken stays a
    /// rival with the probability that the criterion gives it.
    fn learn(&self, start: &Terms) -> Option<(Fit, Option<Rival>)> {
        let described = self.best(start)?;
        let other = Terms { deflects: !start.deflects, ..*start };
        let Some(other) = self.best(&other) else { return Some((described, None)) };
        let cost = |fit: &Fit| {
            let penalty = (self.touches.len() as f64).ln() * fit.learnt.len() as f64;
            fit.state.chi2 + penalty + Known::of(self, &fit.state).chi2()
        };
        let (of_described, of_other) = (cost(&described), cost(&other));
        let (fit, rival) =
            if of_other < of_described { (other, described) } else { (described, other) };
        let probability = (1.0 + (0.5 * (of_described - of_other).abs()).exp()).recip();
        Some((fit, Some(Rival { terms: rival.terms, probability })))
    }

    /// The fit with this way of holding the depth.
    fn best(&self, start: &Terms) -> Option<Fit> {
        let held = self.fit(start, &[])?;
        let Some(ratio) = self.identified(start, &[Term::TangentialRatio]) else {
            return Some(held);
        };
        let penalty = (self.touches.len() as f64).ln();
        let both = self.identified(start, &[Term::TangentialRatio, Term::Arm]);
        let both = both.filter(|both| both.state.chi2 + penalty < ratio.state.chi2);
        Some(both.unwrap_or(ratio))
    }

    /// A fit of these terms, if the touches identify all of them.
    fn identified(&self, start: &Terms, terms: &[Term]) -> Option<Fit> {
        let fit = self.fit(start, terms)?;
        let is_identified = |(index, term): (usize, &Term)| {
            let limit = match term {
                Term::TangentialRatio => RATIO_SIGMA_MAX,
                Term::Arm => ARM_SIGMA_MAX_REL * start.arm_mm,
            };
            fit.covariance[index][index].sqrt() < limit
        };
        terms.iter().enumerate().all(is_identified).then_some(fit)
    }

    /// The least χ² over these terms; `None` when a touch has no stiffness or nothing is free.
    fn fit(&self, start: &Terms, learnt: &[Term]) -> Option<Fit> {
        self.freedom(learnt.len())?;
        let mut terms = *start;
        let mut state = self.state(&terms)?;
        let mut slopes = self.slopes(&terms, learnt, &state.weights)?;
        for _ in 0..STEPS_MAX {
            let inverse = linear::inverse(&information(&slopes, &state.weights))?;
            let pull: Vec<f64> = slopes
                .iter()
                .map(|slope| -weighted(slope, &state.residuals, &state.weights))
                .collect();
            let step: Vec<f64> =
                inverse.iter().map(|row| row.iter().zip(&pull).map(|(a, b)| a * b).sum()).collect();
            let mut factor = 1.0;
            let mut next = None;
            for _ in 0..HALVINGS_MAX {
                let moved = learnt.iter().zip(&step).fold(terms, |moved, (term, step)| {
                    term.set(&moved, term.of(&terms) + factor * step)
                });
                if let Some(logs) = self.logs(&moved)
                    && chi2(&self.centred(&logs, &state.weights), &state.weights) <= state.chi2
                {
                    next = Some(moved);
                    break;
                }
                factor *= 0.5;
            }
            let Some(next) = next else { break };
            let far = |term: &Term| (term.of(&next) - term.of(&terms)).abs() / term.step();
            let is_there = learnt.iter().all(|term| far(term) <= STEP_TOLERANCE);
            terms = next;
            state = self.state(&terms)?;
            slopes = self.slopes(&terms, learnt, &state.weights)?;
            if is_there {
                break;
            }
        }
        let inverse = linear::inverse(&information(&slopes, &state.weights))?;
        // The next step of the fit after an error of one row.
        let gain = |row: usize, of_term: &Vec<f64>| {
            let along: f64 = of_term.iter().zip(&slopes).map(|(by, slope)| by * slope[row]).sum();
            -along * state.weights[row]
        };
        let rows = 0..state.weights.len();
        let gains: Matrix =
            inverse.iter().map(|term| rows.clone().map(|row| gain(row, term)).collect()).collect();
        let errors = self.covariance(&state);
        let entry = |a: &Vec<f64>, b: &Vec<f64>| linear::form(a, &errors, b);
        let covariance =
            gains.iter().map(|a| gains.iter().map(|b| entry(a, b)).collect()).collect();
        Some(Fit { terms, learnt: learnt.to_vec(), covariance, gains, state, slopes })
    }

    /// The covariance of the rows, with what the depths and the references of touches have in common.
    pub(super) fn covariance(&self, state: &State) -> Matrix {
        let touch: Vec<usize> = self.rows().collect();
        let is_pair = |row: usize| row >= self.touches.len();
        let entry = |i: usize, j: usize| {
            if i == j {
                1.0 / state.weights[i]
            } else if is_pair(i) == is_pair(j) {
                let variance = (state.depth_variances[i] * state.depth_variances[j]).sqrt();
                self.shared_depth(touch[i], touch[j]) * variance + state.shared[i][j]
            } else {
                0.0
            }
        };
        (0..touch.len()).map(|i| (0..touch.len()).map(|j| entry(i, j)).collect()).collect()
    }

    /// One in the rows of a sample, zero elsewhere. The differences of pairs have no mean of their own.
    pub(super) fn is_of(&self, sample: usize) -> Vec<f64> {
        let of_touch = self.touches.iter().map(|touch| f64::from(u8::from(touch.sample == sample)));
        of_touch.chain(self.pairs.iter().map(|_| 0.0)).collect()
    }

    /// The correlation of the depths of two touches: by the map of the screw, or that of one place of the stages.
    pub(super) fn shared_depth(&self, i: usize, j: usize) -> f64 {
        let is_on_map = |touch: usize| self.touches[touch].stage_sigma_mm.is_some();
        match self.main.depth_correlation.filter(|_| is_on_map(i) && is_on_map(j)) {
            Some(correlation) => correlation[self.indices[i]][self.indices[j]],
            None if self.is_one_place(i, j) => SHARED_DEPTH,
            None => 0.0,
        }
    }

    /// Whether the stages are at one place for both touches.
    fn is_one_place(&self, i: usize, j: usize) -> bool {
        let tilt = |touch: &PosedTouch| {
            let is_back = (touch.pose.azimuth_rad().abs() - PI).abs() < 1e-6;
            let angle_rad = touch.pose.angle_rad();
            if is_back { -angle_rad } else { angle_rad }
        };
        (tilt(&self.touches[i]) - tilt(&self.touches[j])).abs() < 1e-6
    }

    /// The slope of the residuals over each term.
    fn slopes(&self, terms: &Terms, of: &[Term], weights: &[f64]) -> Option<Matrix> {
        of.iter().map(|term| Some(self.centred(&self.slope(terms, *term)?, weights))).collect()
    }

    /// The slope of each logarithm over a term.
    pub(super) fn slope(&self, terms: &Terms, term: Term) -> Option<Vec<f64>> {
        let at = |by: f64| term.set(terms, term.of(terms) + by);
        let (low, high) = (at(-term.step()), at(term.step()));
        let width = term.of(&high) - term.of(&low);
        let (below, above) = (self.logs(&low)?, self.logs(&high)?);
        Some(above.iter().zip(&below).map(|(above, below)| (above - below) / width).collect())
    }

    /// The touches with the shifts that the model gives for the mean stiffness of their samples.
    pub(super) fn smoothed(&self, terms: &Terms, state: &State) -> Option<Self> {
        let model = self.described.with(terms)?;
        let smooth = |(index, touch): (usize, &PosedTouch)| {
            let young_mpa = (state.logs[index] - state.residuals[index]).exp();
            let shift_hz = |touch: &PosedTouch| model.shift_hz(&terms.touch(touch), young_mpa);
            let halfway = match (touch.halfway, touch.at_halfway()) {
                (Some(before), Some(at)) => Some(Halfway { shift_hz: shift_hz(&at)?, ..before }),
                _ => None,
            };
            Some(PosedTouch { shift_hz: shift_hz(touch)?, halfway, ..*touch })
        };
        let touches: Option<Vec<PosedTouch>> =
            self.touches.iter().enumerate().map(smooth).collect();
        let (indices, pairs) = (self.indices.clone(), self.pairs.clone());
        Some(Self { touches: touches?, indices, pairs, ..*self })
    }

    /// The friction that each touch needs to stick, by the described model and the mean stiffness of its sample.
    pub(super) fn needed_friction(&self, state: &State) -> Vec<f64> {
        let needed = |(index, touch): (usize, &PosedTouch)| {
            let young_mpa = (state.logs[index] - state.residuals[index]).exp();
            self.described.needed_friction(touch, young_mpa).unwrap_or(0.0)
        };
        self.touches.iter().enumerate().map(needed).collect()
    }

    /// What a slide changes in the value of each row: the touches have the shifts of a contact without friction,
    /// and the model takes them as in these terms. The touches must be [smoothed](Self::smoothed).
    pub(super) fn changes_by_sliding(&self, terms: &Terms) -> Option<Vec<f64>> {
        let model = self.described.with(terms)?;
        let sliding = self.described.with(&Term::TangentialRatio.set(terms, 0.0))?;
        self.values(|touch| {
            let touch = terms.touch(touch);
            let log = model.log_young(&touch).ok()?;
            let shift_hz = sliding.shift_hz(&touch, log.exp())?;
            Some(model.log_young(&PosedTouch { shift_hz, ..touch }).ok()? - log)
        })
    }

    /// The logarithm of the stiffness of each touch, and the difference of each pair.
    pub(super) fn logs(&self, terms: &Terms) -> Option<Vec<f64>> {
        let model = self.described.with(terms)?;
        self.values(|touch| model.log_young(&terms.touch(touch)).ok())
    }

    fn state(&self, terms: &Terms) -> Option<State> {
        let model = self.described.with(terms)?;
        let (mut logs, mut weights, mut depth_variances) = (Vec::new(), Vec::new(), Vec::new());
        let mut per_hz = Vec::new();
        for touch in &self.touches {
            let one = model.of_touch(&terms.touch(touch)).ok()?;
            let relative = |sigma_mpa: f64| (sigma_mpa / one.young_mpa).powi(2);
            logs.push(one.young_mpa.ln());
            weights.push(1.0 / (relative(one.sigma_mpa) + self.main.sample_rel.powi(2)));
            depth_variances.push(relative(one.sigma_of_depth_mpa));
            per_hz.push(one.sigma_of_shift_mpa / one.young_mpa / touch.sigma_hz);
        }
        for &pair in &self.pairs {
            let touch = &self.touches[pair];
            let at = |touch: &PosedTouch| model.of_touch(&terms.touch(touch)).ok();
            let difference = Difference::of(&model, touch, &at(touch)?, &touch.at_halfway()?, at)?;
            logs.push(difference.log);
            weights.push(1.0 / difference.variance);
            depth_variances.push(difference.depth_variance);
            per_hz.push(difference.per_hz);
        }
        let residuals = self.centred(&logs, &weights);
        let chi2 = chi2(&residuals, &weights);
        let shared = self.shared_references(&per_hz);
        chi2.is_finite().then_some(State {
            logs,
            weights,
            depth_variances,
            shared,
            residuals,
            chi2,
        })
    }

    /// The covariance of different rows by their references, by the relative change of each row for 1 Hz of it.
    fn shared_references(&self, per_hz: &[f64]) -> Matrix {
        let touch: Vec<usize> = self.rows().collect();
        let is_pair = |row: usize| row >= self.touches.len();
        sharing(per_hz, |i, j| match self.main.reference_hz2 {
            Some(all) if is_pair(i) == is_pair(j) => {
                all[self.indices[touch[i]]][self.indices[touch[j]]]
            }
            _ => 0.0,
        })
    }

    /// Values less the weighted mean of their sample.
    pub(super) fn centred(&self, values: &[f64], weights: &[f64]) -> Vec<f64> {
        let samples = self.main.known_mpa.len();
        let (mut sums, mut all) = (vec![0.0; samples], vec![0.0; samples]);
        for ((value, weight), touch) in values.iter().zip(weights).zip(&self.touches) {
            sums[touch.sample] += weight * value;
            all[touch.sample] += weight;
        }
        let means = self.touches.iter().map(|touch| sums[touch.sample] / all[touch.sample]);
        // The differences of pairs have no mean of their own.
        let means = means.chain(std::iter::repeat(0.0));
        values.iter().zip(means).map(|(value, mean)| value - mean).collect()
    }
}

/// aᵀ W b.
pub(super) fn weighted(a: &[f64], b: &[f64], weights: &[f64]) -> f64 {
    a.iter().zip(b).zip(weights).map(|((a, b), weight)| a * b * weight).sum()
}

fn chi2(residuals: &[f64], weights: &[f64]) -> f64 {
    weighted(residuals, residuals, weights)
}

/// The information matrix of the terms.
fn information(slopes: &Matrix, weights: &[f64]) -> Matrix {
    let entry = |a: &Vec<f64>, b: &Vec<f64>| weighted(a, b, weights);
    slopes.iter().map(|a| slopes.iter().map(|b| entry(a, b)).collect()).collect()
}
