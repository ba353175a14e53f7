//! Control charts of a quantity that a bench shows again and again.
//!
//! The mean and the scatter of a bench are not known; they are those of its own earlier values. A chart that takes the
//! first few values for the truth alarms too often, and nobody knows how often. These charts are self-starting: each
//! value is compared with those before it, and becomes a score that is normal with mean 0 and variance 1, however few the
//! values are. After [`COMPARED`] values the comparison stays as it is, because one that goes on would take a small change
//! that stays for the mean.
//!
//! A score beyond [`SCORE_LIMIT`] is one value far off (Shewhart). A moving average of the scores beyond
//! [`AVERAGE_LIMIT`] is a small change that stays (EWMA). A value with an alarm is not taken for the later comparison, and
//! enters the average as one at the limit, so that one bad check leaves no alarm behind.
//!
//! # Source
//! D. M. Hawkins, Self-starting cusum charts, The Statistician 36 (1987) 299. S. W. Roberts, Technometrics 1 (1959) 239.

mod student;
#[cfg(test)]
mod tests;

use student::normal_score;

/// Values before the first score.
pub const BASELINE: usize = 10;

/// Values with which the later ones are compared, at most.
pub const COMPARED: usize = 40;

/// Weight of the last score in the moving average.
pub const WEIGHT: f64 = 0.2;

/// Largest score without an alarm.
pub const SCORE_LIMIT: f64 = 3.5;

/// Largest moving average of the scores without an alarm: 3.5 of its standard deviations, √(w/(2 − w)) = 1/3.
pub const AVERAGE_LIMIT: f64 = 3.5 / 3.0;

/// A value on its chart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Charted {
    /// The value.
    pub value: f64,
    /// What was expected of it by the values before; `None` for the first [`BASELINE`] ones.
    pub against: Option<Comparison>,
}

/// A value compared with those before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Mean of the values before.
    pub mean: f64,
    /// Their standard deviation, or the least one that counts.
    pub sigma: f64,
    /// The score of the value.
    pub score: f64,
    /// The moving average of the scores.
    pub average: f64,
}

impl Comparison {
    /// Whether the chart says that something has changed.
    pub fn is_alarm(&self) -> bool {
        self.score.abs() > SCORE_LIMIT || self.average.abs() > AVERAGE_LIMIT
    }

    /// Whether the score has the sign of an alarm before it.
    pub(crate) fn has_sign_of(&self, before: &Self) -> bool {
        let of = |one: &Self| if one.score.abs() > SCORE_LIMIT { one.score } else { one.average };
        self.score * of(before) > 0.0
    }
}

/// A chart of the values of a quantity, which come one after the other.
#[derive(Debug, Clone)]
pub struct Chart {
    least_sigma: f64,
    before: Before,
    average: f64,
}

impl Chart {
    /// A chart without values. A smaller standard deviation than `least_sigma`, in the unit of the values, counts as that
    /// one: a difference that matters to nobody is no alarm.
    pub fn new(least_sigma: f64) -> Self {
        Self { least_sigma, before: Before::default(), average: 0.0 }
    }

    /// The next value.
    pub fn take(&mut self, value: f64) -> Charted {
        let before = &self.before;
        let against = (before.count >= BASELINE).then(|| {
            let sigma = before.sigma().max(self.least_sigma);
            let n = before.count as f64;
            let student = (value - before.mean) / sigma * (n / (n + 1.0)).sqrt();
            let score = normal_score(student, n - 1.0);
            self.average += WEIGHT * (score.clamp(-SCORE_LIMIT, SCORE_LIMIT) - self.average);
            Comparison { mean: before.mean, sigma, score, average: self.average }
        });
        if before.count < COMPARED && !against.is_some_and(|against| against.is_alarm()) {
            self.before.take(value);
        }
        Charted { value, against }
    }
}

/// Mean and scatter of values, updated one at a time (Welford).
#[derive(Debug, Clone, Default)]
struct Before {
    count: usize,
    mean: f64,
    squares: f64,
}

impl Before {
    fn take(&mut self, value: f64) {
        self.count += 1;
        let off = value - self.mean;
        self.mean += off / self.count as f64;
        self.squares += off * (value - self.mean);
    }

    /// Of two or more values.
    fn sigma(&self) -> f64 {
        (self.squares / (self.count as f64 - 1.0)).sqrt()
    }
}
