//! What one further term for each cause would explain of the residuals.
//!
//! Each term is a column of the residuals, tested by Rao's score. Touches at one place of the stages share
//! a part of their depth error, so that rows are first made independent by the Cholesky factor of their
//! covariance. Then what the means of the samples and the learnt terms explain is taken out. The tests of one
//! cause are taken [together](super::joint).

use super::{
    Term, Terms,
    fit::{Fit, State, Usable},
    joint::{self, Side, Test},
    judge::{Evidence, Pattern, SlipNoticed, above},
    linear::{self, Matrix},
    shared::Chi2Expected,
};

/// A column that is left with less than this part of its length does not differ from the fitted ones.
const LEFT_OVER: f64 = 0.01;
/// Numbers of touches that slip while the others stick, as far as they are tried. A touch more or less changes little.
const SLIPPING: [usize; 5] = [1, 2, 4, 8, 16];
/// The share of the runs in which a departure from the model is to be noticed.
const NOTICED: f64 = 0.95;
/// A normal variable exceeds this five times in a hundred.
const NORMAL_OF_FIVE_PERCENT: f64 = 1.644_854;

/// The residuals as independent rows of unit variance.
pub(super) struct Rows<'a> {
    touches: &'a Usable<'a>,
    fit: &'a Fit,
    factor: Matrix,
    /// Orthonormal columns of what was fitted.
    fitted: Matrix,
    residuals: Vec<f64>,
    /// The friction that each touch needs.
    needed: Vec<f64>,
    /// The terms that are tried.
    columns: Vec<Column>,
}

/// A column of a term.
#[derive(Clone)]
struct Column {
    pattern: Pattern,
    side: Side,
    /// The part that it has of the chance of its cause.
    weight: f64,
    values: Vec<f64>,
}

impl<'a> Rows<'a> {
    /// `None` when the covariance is singular.
    pub(super) fn new(touches: &'a Usable<'a>, fit: &'a Fit) -> Option<Self> {
        let factor = linear::cholesky(&touches.covariance(&fit.state))?;
        let residuals = linear::forward(&factor, &fit.state.residuals);
        let needed = touches.needed_friction(&fit.state);
        let columns = columns(touches, fit, &needed);
        let fitted = Vec::new();
        let mut rows = Self { touches, fit, factor, fitted, residuals, needed, columns };
        let samples = 0..touches.main.known_mpa.len();
        let free =
            fit.learnt.iter().zip(&fit.slopes).filter(|(term, _)| !term.is_at_end(&fit.terms));
        let taken: Matrix = samples
            .map(|sample| touches.is_of(sample))
            .chain(free.map(|(_, slope)| slope.clone()))
            .collect();
        for column in &taken {
            if let Some(column) = rows.beyond_fitted(column) {
                rows.fitted.push(column);
            }
        }
        rows.residuals = rows.rest(rows.residuals.clone());
        Some(rows)
    }

    /// χ² of the independent rows.
    pub(super) fn chi2(&self) -> f64 {
        dot(&self.residuals, &self.residuals)
    }

    /// What is left of independent rows beyond the fitted columns.
    fn rest(&self, mut rows: Vec<f64>) -> Vec<f64> {
        for fitted in &self.fitted {
            let along = dot(fitted, &rows);
            rows.iter_mut().zip(fitted).for_each(|(row, fitted)| *row -= along * fitted);
        }
        rows
    }

    /// The direction of a column beyond the fitted ones; `None` when nothing is left.
    fn beyond_fitted(&self, column: &[f64]) -> Option<Vec<f64>> {
        Some(self.left_of(column)?.0)
    }

    /// The direction of a column beyond the fitted ones, and the length that is left.
    fn left_of(&self, column: &[f64]) -> Option<(Vec<f64>, f64)> {
        let rows = linear::forward(&self.factor, column);
        let before = dot(&rows, &rows);
        let rest = self.rest(rows);
        let after = dot(&rest, &rest);
        let left = after.sqrt();
        (after > LEFT_OVER * before).then(|| (rest.iter().map(|row| row / left).collect(), left))
    }

    /// The standard deviation of the score in a direction. Without a common depth error the same weights give
    /// another one; it is the larger of both.
    fn score_sigma(&self, direction: &[f64]) -> f64 {
        let weights = linear::backward(&self.factor, direction);
        let State { weights: own, shared, .. } = &self.fit.state;
        let alone: f64 = weights.iter().zip(own).map(|(by, weight)| by * by / weight).sum();
        (alone + linear::form(&weights, shared, &weights)).max(1.0).sqrt()
    }

    /// The test of a term; `None` when nothing is left of it.
    fn test(&self, column: &Column) -> Option<Test> {
        let direction = self.beyond_fitted(&column.values)?;
        Some(Test { side: column.side, weight: column.weight, direction })
    }

    /// The exponent of the depth, by which the contact would deviate from its law, that these touches show in
    /// 95 % of the runs, if a run is called strained when the tests of one cause have less than this probability; `None`
    /// if nothing is left of it beyond the fitted terms.
    pub(super) fn exponent_noticed(&self, strained_below: f64) -> Option<f64> {
        let tests = || self.columns.iter().filter(|column| column.pattern == Pattern::Depth);
        let tests: Vec<Test> = tests().filter_map(|column| self.test(column)).collect();
        // The column of the logarithm is the last one for a depth.
        let beyond_sigmas = *joint::limits_of(&tests, strained_below).last()?;
        let (direction, left) = self.left_of(&self.touches.log_depths()?)?;
        Some((beyond_sigmas + NORMAL_OF_FIVE_PERCENT) * self.score_sigma(&direction) / left)
    }

    /// The evidence for each cause but the samples, by all of its terms together.
    pub(super) fn evidence(&self) -> Vec<Evidence> {
        let of = |pattern: Pattern| {
            let mut tests = Vec::new();
            let (mut scores, mut chi2_removed) = (Vec::new(), 0.0_f64);
            for column in self.columns.iter().filter(|column| column.pattern == pattern) {
                let Some(test) = self.test(column) else { continue };
                let score = dot(&test.direction, &self.residuals);
                let is_for = test.side == Side::Either || score > 0.0;
                chi2_removed = chi2_removed.max(if is_for { score * score } else { 0.0 });
                scores.push(score / self.score_sigma(&test.direction));
                tests.push(test);
            }
            let probability = joint::probability(&tests, &scores);
            (!tests.is_empty()).then_some(Evidence { pattern, chi2_removed, probability })
        };
        [Pattern::Friction, Pattern::Arm, Pattern::Depth].into_iter().filter_map(of).collect()
    }
}

/// The columns of the causes.
fn columns(touches: &Usable<'_>, fit: &Fit, needed: &[f64]) -> Vec<Column> {
    let (terms, state) = (&fit.terms, &fit.state);
    // Terms of the readings themselves would be drawn by the same noise as the residuals.
    let Some(smooth) = touches.smoothed(terms, state) else { return Vec::new() };
    let slope = |term: Term| smooth.slope(terms, term);
    let either =
        |pattern: Pattern, values| Column { pattern, side: Side::Either, weight: 1.0, values };
    let mut columns = slope(Term::TangentialRatio)
        .map_or_else(Vec::new, |ratio| of_friction(touches, ratio, needed));
    columns.extend(slope(Term::Arm).map(|column| either(Pattern::Arm, column)));
    let other = Terms { deflects: !terms.deflects, ..*terms };
    if let (Some(logs), Some(others)) = (smooth.logs(terms), smooth.logs(&other)) {
        let change = others.iter().zip(&logs).map(|(other, log)| other - log).collect();
        columns.push(either(Pattern::Depth, change));
    }
    columns.extend(touches.log_depths().map(|column| either(Pattern::Depth, column)));
    columns
}

/// The columns of a contact that is softer or stiffer along the surface, by the slope of each row over the tangential
/// ratio.
///
/// A slip in a few touches has the weight of the coefficients of friction under which these touches slide and no
/// others, as a part of the largest one that any touch needs. The other terms share the rest.
fn of_friction(touches: &Usable<'_>, ratio: Vec<f64>, needed: &[f64]) -> Vec<Column> {
    let column =
        |side: Side, values| Column { pattern: Pattern::Friction, side, weight: 1.0, values };
    let mut slips = Vec::new();
    let mut most = needed.to_vec();
    most.sort_by(|a, b| b.total_cmp(a));
    let counts: Vec<usize> = SLIPPING.into_iter().filter(|count| *count < most.len()).collect();
    for (at, &count) in counts.iter().enumerate() {
        // A number of touches stands for all up to the next one that is tried.
        let (least, next) =
            (most[count - 1], most[counts.get(at + 1).map_or(count, |next| next - 1)]);
        let rows = touches.rows().zip(&ratio);
        let slipping = rows.map(|(touch, slope)| if needed[touch] >= least { *slope } else { 0.0 });
        let weight = (least - next) / most[0];
        if weight > 0.0 {
            slips.push(Column { weight, ..column(Side::Positive, slipping.collect()) });
        }
    }
    let angles: Vec<f64> =
        touches.rows().map(|index| touches.touches[index].pose.angle_rad()).collect();
    let mut splits = angles.clone();
    splits.sort_by(f64::total_cmp);
    splits.dedup();
    // A contact that slips from some angle on sticks at the angles below.
    let below = |split: &f64| {
        let below = ratio.iter().zip(&angles);
        below.map(|(slope, angle)| if angle < split { -*slope } else { 0.0 }).collect()
    };
    let mut others: Vec<Column> =
        splits.iter().skip(1).map(|split| column(Side::Positive, below(split))).collect();
    others.push(column(Side::Either, ratio));
    let rest = 1.0 - slips.iter().map(|slip| slip.weight).sum::<f64>();
    let share = rest / others.len() as f64;
    slips.extend(others.into_iter().map(|other| Column { weight: share, ..other }));
    slips
}

impl<'a> Rows<'a> {
    /// What these rows show of a slip, if a run is called strained when a test of one cause has less than this
    /// probability.
    ///
    /// A coefficient of friction below what a touch needs lets it slide, and with it all that need more. The score
    /// of every test for friction then has the mean that this pattern has along its column. A run may take a slip
    /// for another arm and learn that, so that what an arm explains is left out.
    pub(super) fn slip_noticed(&self, strained_below: f64) -> Option<SlipNoticed> {
        let Self { touches, fit, .. } = *self;
        let smooth = touches.smoothed(&fit.terms, &fit.state)?;
        let arm = self.beyond_fitted(&smooth.slope(&fit.terms, Term::Arm)?);
        self.beside(arm).of_slips(&smooth, strained_below)
    }

    /// The same rows with one more fitted column.
    fn beside(&self, column: Option<Vec<f64>>) -> Self {
        let fitted = self.fitted.iter().cloned().chain(column).collect();
        let (factor, residuals) = (self.factor.clone(), self.residuals.clone());
        let (needed, columns) = (self.needed.clone(), self.columns.clone());
        Self { factor, fitted, residuals, needed, columns, ..*self }
    }

    /// What these fitted columns let smoothed touches show of a slip.
    fn of_slips(&self, smooth: &Usable<'a>, strained_below: f64) -> Option<SlipNoticed> {
        let Self { touches, fit, ref needed, .. } = *self;
        let changes = smooth.changes_by_sliding(&fit.terms)?;
        let mut most = needed.clone();
        most.sort_by(|a, b| b.total_cmp(a));
        let is_of_friction = |column: &&Column| column.pattern == Pattern::Friction;
        let tests: Vec<Test> = (self.columns.iter().filter(is_of_friction))
            .filter_map(|column| self.test(column))
            .collect();
        if tests.is_empty() {
            return None;
        }
        let limits = joint::limits_of(&tests, strained_below);
        let share = |least: f64| {
            let slips = |(row, touch)| if needed[touch] >= least { changes[row] } else { 0.0 };
            let pattern: Vec<f64> = touches.rows().enumerate().map(slips).collect();
            let pattern = self.rest(linear::forward(&self.factor, &pattern));
            let beyond = |(test, limit): (&Test, &f64)| {
                let score = dot(&test.direction, &pattern) / self.score_sigma(&test.direction);
                score - limit
            };
            let tests = tests.iter().zip(&limits).filter(|(test, _)| test.side == Side::Positive);
            above(-tests.map(beyond).fold(f64::NEG_INFINITY, f64::max))
        };
        let first = most.first().copied().filter(|needed| *needed > 0.0)?;
        let enough = most.iter().copied().find(|least| share(*least) >= NOTICED);
        Some(SlipNoticed { begins_below: first, share_of_first: share(first), below: enough })
    }
}

/// The evidence that one sample does not agree with itself, for the worst one.
pub(super) fn samples(touches: &Usable<'_>, state: &State) -> Option<Evidence> {
    let samples = touches.main.known_mpa.len();
    let of_sample = |sample: usize| {
        let of_sample: Vec<usize> =
            (0..touches.touches.len()).filter(|&i| touches.touches[i].sample == sample).collect();
        let freedom = of_sample.len().checked_sub(1).filter(|freedom| *freedom > 0)? as f64;
        let chi2: f64 =
            of_sample.iter().map(|&i| state.weights[i] * state.residuals[i].powi(2)).sum();
        let weights: Vec<f64> = of_sample.iter().map(|&i| state.weights[i]).collect();
        let shared: Matrix = (of_sample.iter())
            .map(|&i| of_sample.iter().map(|&j| state.shared[i][j]).collect())
            .collect();
        let expected = Chi2Expected::of_freedom(freedom, 1.0);
        let expected = expected.sharing(&vec![0; weights.len()], &weights, &shared);
        Some((sample, chi2 - expected.mean, expected.probability(chi2)))
    };
    let all: Vec<_> = (0..samples).filter_map(of_sample).collect();
    let (sample, excess, probability) = *all.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let probability = (probability * all.len() as f64).min(1.0);
    Some(Evidence { pattern: Pattern::Sample(sample), chi2_removed: excess, probability })
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
