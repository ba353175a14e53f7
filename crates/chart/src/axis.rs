//! Axes: their ranges and ticks.

mod ticks;

use crate::ChartError;

pub(crate) use ticks::Tick;

/// The scale of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Equal distances for equal differences.
    Linear,
    /// Equal distances for equal ratios; positive values only.
    Log,
}

/// An axis before its values are known.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    label: String,
    scale: Scale,
    range: Option<(f64, f64)>,
    include: Vec<f64>,
    ticks: Option<Vec<(f64, Option<String>)>>,
}

impl Axis {
    /// An axis with a linear scale. The label names the unit.
    pub fn linear(label: &str) -> Self {
        Self::new(label, Scale::Linear)
    }

    /// An axis with a logarithmic scale. The label names the unit.
    pub fn log(label: &str) -> Self {
        Self::new(label, Scale::Log)
    }

    fn new(label: &str, scale: Scale) -> Self {
        Self { label: label.to_owned(), scale, range: None, include: Vec::new(), ticks: None }
    }

    /// Sets the exact range. The default is a range that contains all values.
    pub fn with_range(mut self, from: f64, to: f64) -> Self {
        self.range = Some((from, to));
        self
    }

    /// Extends the range to `value`, such as zero.
    pub fn including(mut self, value: f64) -> Self {
        self.include.push(value);
        self
    }

    /// Sets the ticks.
    pub fn with_ticks(mut self, ticks: &[f64]) -> Self {
        self.ticks = Some(ticks.iter().map(|&value| (value, None)).collect());
        self
    }

    /// Sets ticks with names, for an axis of things that have no values.
    pub fn with_names<'a>(mut self, ticks: impl IntoIterator<Item = (f64, &'a str)>) -> Self {
        let named = |(value, name): (f64, &str)| (value, Some(name.to_owned()));
        self.ticks = Some(ticks.into_iter().map(named).collect());
        self
    }

    /// The axis for these values, with room for `room` labelled ticks.
    pub(crate) fn fit(
        &self,
        values: impl IntoIterator<Item = f64>,
        room: f64,
    ) -> Result<FittedAxis, ChartError> {
        let range_of_values = self.range_of(values);
        let (from, to) = match (self.range, range_of_values) {
            (Some(range), Ok(_) | Err(ChartError::Empty { .. })) => range,
            (None, Ok(range)) => range,
            (_, Err(error)) => return Err(error),
        };
        for end in [from, to] {
            self.check(end)?;
        }
        if from >= to {
            return Err(ChartError::Range { axis: self.label.clone(), from, to });
        }
        let ticks = match (&self.ticks, self.scale) {
            (Some(ticks), _) => ticks::given(ticks, from, to),
            (None, Scale::Linear) => ticks::linear(from, to, room),
            (None, Scale::Log) => ticks::log(from, to, room),
        };
        Ok(FittedAxis { label: self.label.clone(), scale: self.scale, from, to, ticks })
    }

    /// Refuses a value that the axis cannot show.
    pub(crate) fn check(&self, value: f64) -> Result<(), ChartError> {
        let is_shown = value.is_finite() && (self.scale == Scale::Linear || value > 0.0);
        if is_shown {
            Ok(())
        } else {
            Err(ChartError::Unshowable { axis: self.label.clone(), value })
        }
    }

    /// A range that contains all values, with a margin at each end that a value determines.
    fn range_of(&self, values: impl IntoIterator<Item = f64>) -> Result<(f64, f64), ChartError> {
        /// Margin at an end as a share of the range.
        const MARGIN: f64 = 0.05;
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values {
            self.check(value)?;
            (low, high) = (low.min(value), high.max(value));
        }
        let (value_low, value_high) = (low, high);
        for &value in &self.include {
            self.check(value)?;
            (low, high) = (low.min(value), high.max(value));
        }
        if low > high {
            return Err(ChartError::Empty { axis: self.label.clone() });
        }
        let is_log = self.scale == Scale::Log;
        let (start, end) = if is_log { (low.log10(), high.log10()) } else { (low, high) };
        let margin = if end > start {
            MARGIN * (end - start)
        } else if is_log {
            // A single value: a third of a decade about it.
            1.0 / 6.0
        } else {
            0.1 * start.abs().max(1.0)
        };
        let back = |end: f64| if is_log { 10.0_f64.powf(end) } else { end };
        let from = if low < value_low && start < end { low } else { back(start - margin) };
        let to = if high > value_high && start < end { high } else { back(end + margin) };
        Ok((from, to))
    }
}

/// An axis whose range is known.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FittedAxis {
    pub(crate) label: String,
    scale: Scale,
    from: f64,
    to: f64,
    pub(crate) ticks: Vec<Tick>,
}

impl FittedAxis {
    /// The position of a value: 0 at the lower end, 1 at the upper. A value outside the range lies
    /// outside [0, 1]. A value that a logarithmic axis cannot show lies below.
    pub(crate) fn fraction(&self, value: f64) -> f64 {
        let share = match self.scale {
            Scale::Linear => (value - self.from) / (self.to - self.from),
            Scale::Log if value > 0.0 => (value / self.from).ln() / (self.to / self.from).ln(),
            Scale::Log => -1.0,
        };
        // A value far outside is drawn a little outside, which keeps the coordinates short.
        share.clamp(-1.0, 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(axis: &Axis, values: &[f64], expected: (f64, f64)) {
        let fitted = axis.fit(values.iter().copied(), 6.0).unwrap();
        let is_near = |a: f64, b: f64| (a - b).abs() < 1e-9 * (1.0 + b.abs());
        assert!(
            is_near(fitted.from, expected.0) && is_near(fitted.to, expected.1),
            "{} to {}, expected {expected:?}",
            fitted.from,
            fitted.to
        );
    }

    #[test]
    fn the_range_contains_all_values_with_a_margin() {
        check(&Axis::linear("y"), &[10.0, 20.0], (9.5, 20.5));
        check(&Axis::linear("y").including(0.0), &[10.0, 20.0], (0.0, 21.0));
        check(&Axis::linear("y").including(15.0), &[10.0, 20.0], (9.5, 20.5));
        check(&Axis::linear("y"), &[5.0], (4.5, 5.5));
        check(&Axis::linear("y").with_range(1.0, 2.0), &[10.0, 20.0], (1.0, 2.0));
        let decade = 10.0_f64.powf(0.1);
        check(&Axis::log("y"), &[1.0, 100.0], (1.0 / decade, 100.0 * decade));
    }

    #[test]
    fn values_that_cannot_be_shown_are_refused() {
        let axis = Axis::log("cost (s)");
        let refusal = axis.fit([1.0, 0.0], 6.0).unwrap_err();
        assert_eq!(refusal.to_string(), "chart: the axis `cost (s)` cannot show 0");
        for axis in [Axis::linear("x"), Axis::linear("x").with_range(0.0, 1.0)] {
            assert!(axis.fit([0.5, f64::NAN], 6.0).is_err());
        }
        let refusal = Axis::linear("x").fit([], 6.0).unwrap_err();
        assert_eq!(refusal, ChartError::Empty { axis: "x".to_owned() });
        let refusal = Axis::linear("x").with_range(2.0, 2.0).fit([], 6.0).unwrap_err();
        assert!(matches!(refusal, ChartError::Range { .. }), "{refusal}");
    }

    #[test]
    fn fractions_run_from_zero_to_one() {
        let linear = Axis::linear("x").with_range(10.0, 20.0).fit([], 6.0).unwrap();
        assert_eq!([10.0, 15.0, 20.0].map(|value| linear.fraction(value)), [0.0, 0.5, 1.0]);
        let log = Axis::log("x").with_range(0.01, 1.0).fit([], 6.0).unwrap();
        let fractions = [0.01, 0.1, 1.0].map(|value| log.fraction(value));
        assert!((fractions[1] - 0.5).abs() < 1e-12, "{fractions:?}");
        assert_eq!(log.fraction(-3.0), -1.0);
    }
}
