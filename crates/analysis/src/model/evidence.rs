//! What one further term for each cause would explain of the residuals.
//!
//! Each term is a column of the residuals, tested by Rao's score. Touches at one place of the stages share
//! a part of their depth error, so that rows are first made independent by the Cholesky factor of their
//! covariance. Then what the means of the samples and the learnt terms explain is taken out.

use super::{
    Term, Terms,
    fit::{Fit, State, Usable},
    judge::{Evidence, Pattern, SlipNoticed, above, chi2_probability, one_sided},
    linear::{self, Matrix},
};

/// A column that is left with less than this part of its length does not differ from the fitted ones.
const LEFT_OVER: f64 = 0.01;
/// Numbers of touches that slip while the others stick, as far as they are tried. A touch more or less changes little.
const SLIPPING: [usize; 5] = [1, 2, 4, 8, 16];
/// The share of the runs in which a departure from the model is to be noticed.
const NOTICED: f64 = 0.95;
/// A normal variable exceeds this five times in a hundred.
const NORMAL_OF_FIVE_PERCENT: f64 = 1.644_854;
/// Terms by which the evidence for a depth is looked for.
pub(super) const DEPTH_TERMS: f64 = 2.0;

/// The residuals as independent rows of unit variance.
pub(super) struct Rows<'a> {
    touches: &'a Usable<'a>,
    fit: &'a Fit,
    factor: Matrix,
    /// Orthonormal columns of what was fitted.
    fitted: Matrix,
    residuals: Vec<f64>,
}

/// A column of a term that may lie in either direction, or in one.
enum Column {
    Either(Pattern, Vec<f64>),
    Positive(Pattern, Vec<f64>),
}

impl<'a> Rows<'a> {
    /// `None` when the covariance is singular.
    pub(super) fn new(touches: &'a Usable<'a>, fit: &'a Fit) -> Option<Self> {
        let factor = linear::cholesky(&touches.covariance(&fit.state))?;
        let residuals = linear::forward(&factor, &fit.state.residuals);
        let mut rows = Self { touches, fit, factor, fitted: Vec::new(), residuals };
        let samples = 0..touches.main.known_mpa.len();
        let free =
            fit.learnt.iter().zip(&fit.slopes).filter(|(term, _)| !term.is_at_end(&fit.terms));
        let columns: Matrix = samples
            .map(|sample| touches.is_of(sample))
            .chain(free.map(|(_, slope)| slope.clone()))
            .collect();
        for column in &columns {
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

    /// Rao's score of a term.
    fn score(&self, column: &Column) -> Option<Evidence> {
        let (Column::Either(pattern, values) | Column::Positive(pattern, values)) = column;
        let direction = self.beyond_fitted(values)?;
        let score = dot(&direction, &self.residuals);
        let sigmas = score / self.score_sigma(&direction);
        let (removed, probability) = match column {
            Column::Either(..) => (score * score, chi2_probability(sigmas * sigmas, 1.0)),
            Column::Positive(..) => (score.max(0.0).powi(2), above(sigmas)),
        };
        Some(Evidence { pattern: *pattern, chi2_removed: removed, probability })
    }

    /// The standard deviation of the score in a direction. Without a common depth error the same weights give
    /// another one; it is the larger of both.
    fn score_sigma(&self, direction: &[f64]) -> f64 {
        let weights = linear::backward(&self.factor, direction);
        let own = weights.iter().zip(&self.fit.state.weights);
        own.map(|(own, weight)| own * own / weight).sum::<f64>().max(1.0).sqrt()
    }

    /// The exponent of the depth, by which the contact would grow otherwise than its law, that a score beyond this
    /// many standard deviations shows in 95 % of the runs; `None` if nothing is left of it beyond the fitted terms.
    pub(super) fn exponent_noticed(&self, beyond_sigmas: f64) -> Option<f64> {
        let (direction, left) = self.left_of(&self.touches.log_depths()?)?;
        Some((beyond_sigmas + NORMAL_OF_FIVE_PERCENT) * self.score_sigma(&direction) / left)
    }

    /// The evidence for each cause but the samples: the best of its terms.
    pub(super) fn evidence(&self) -> Vec<Evidence> {
        let all: Vec<Evidence> =
            self.columns().iter().filter_map(|column| self.score(column)).collect();
        let of = |pattern: Pattern| {
            let tried: Vec<&Evidence> = all.iter().filter(|one| one.pattern == pattern).collect();
            let best = tried.iter().max_by(|a, b| a.chi2_removed.total_cmp(&b.chi2_removed))?;
            let least = tried.iter().map(|one| one.probability).fold(1.0, f64::min);
            Some(Evidence { probability: (least * tried.len() as f64).min(1.0), ..**best })
        };
        [Pattern::Friction, Pattern::Arm, Pattern::Depth].into_iter().filter_map(of).collect()
    }

    /// The columns of the causes.
    fn columns(&self) -> Vec<Column> {
        let Self { touches, fit, .. } = *self;
        let (terms, state) = (&fit.terms, &fit.state);
        // Terms of the readings themselves would be drawn by the same noise as the residuals.
        let Some(smooth) = touches.smoothed(terms, state) else { return Vec::new() };
        let slope = |term: Term| smooth.slope(terms, term);
        let angles: Vec<f64> =
            touches.rows().map(|index| touches.touches[index].pose.angle_rad()).collect();
        let mut splits = angles.clone();
        splits.sort_by(f64::total_cmp);
        splits.dedup();
        let mut columns: Vec<Column> = Vec::new();
        if let Some(ratio) = slope(Term::TangentialRatio) {
            // A contact that slips from some angle on sticks at the angles below.
            for split in splits.iter().skip(1) {
                let below = ratio.iter().zip(&angles);
                let below = below.map(|(slope, angle)| if angle < split { -*slope } else { 0.0 });
                columns.push(Column::Positive(Pattern::Friction, below.collect()));
            }
            // The touches that need most friction slip first.
            let needed = touches.needed_friction(state);
            let mut most = needed.clone();
            most.sort_by(|a, b| b.total_cmp(a));
            for least in SLIPPING.iter().filter_map(|&count| most.get(count - 1)) {
                let slips = |row: usize, touch: usize| {
                    if needed[touch] >= *least { ratio[row] } else { 0.0 }
                };
                let rows = touches.rows().enumerate();
                let slipping = rows.map(|(row, touch)| slips(row, touch)).collect();
                columns.push(Column::Positive(Pattern::Friction, slipping));
            }
            columns.push(Column::Either(Pattern::Friction, ratio));
        }
        columns.extend(slope(Term::Arm).map(|column| Column::Either(Pattern::Arm, column)));
        let other = Terms { deflects: !terms.deflects, ..*terms };
        if let (Some(logs), Some(others)) = (smooth.logs(terms), smooth.logs(&other)) {
            let change = others.iter().zip(&logs).map(|(other, log)| other - log).collect();
            columns.push(Column::Either(Pattern::Depth, change));
        }
        columns.extend(touches.log_depths().map(|column| Column::Either(Pattern::Depth, column)));
        columns
    }
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
        Self { factor: self.factor.clone(), fitted, residuals: self.residuals.clone(), ..*self }
    }

    /// The same for smoothed touches, and for these fitted columns.
    fn of_slips(&self, smooth: &Usable<'a>, strained_below: f64) -> Option<SlipNoticed> {
        let Self { touches, fit, .. } = *self;
        let changes = smooth.changes_by_sliding(&fit.terms)?;
        let needed = touches.needed_friction(&fit.state);
        let mut most = needed.clone();
        most.sort_by(|a, b| b.total_cmp(a));
        let test = |column: &Column| {
            let Column::Positive(Pattern::Friction, values) = column else { return None };
            let direction = self.beyond_fitted(values)?;
            let sigma = self.score_sigma(&direction);
            Some(direction.iter().map(|one| one / sigma).collect())
        };
        let tests: Vec<Vec<f64>> = self.columns().iter().filter_map(test).collect();
        if tests.is_empty() {
            return None;
        }
        let beyond_sigmas = one_sided(strained_below / tests.len() as f64);
        let share = |least: f64| {
            let slips = |(row, touch)| if needed[touch] >= least { changes[row] } else { 0.0 };
            let pattern: Vec<f64> = touches.rows().enumerate().map(slips).collect();
            let pattern = self.rest(linear::forward(&self.factor, &pattern));
            let score = tests.iter().map(|test| dot(test, &pattern)).fold(0.0, f64::max);
            above(beyond_sigmas - score)
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
        let of_sample =
            || (0..touches.touches.len()).filter(|&i| touches.touches[i].sample == sample);
        let freedom = of_sample().count().checked_sub(1).filter(|freedom| *freedom > 0)? as f64;
        let chi2: f64 = of_sample().map(|i| state.weights[i] * state.residuals[i].powi(2)).sum();
        Some((sample, chi2 - freedom, chi2_probability(chi2, freedom)))
    };
    let all: Vec<_> = (0..samples).filter_map(of_sample).collect();
    let (sample, excess, probability) = *all.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let probability = (probability * all.len() as f64).min(1.0);
    Some(Evidence { pattern: Pattern::Sample(sample), chi2_removed: excess, probability })
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
