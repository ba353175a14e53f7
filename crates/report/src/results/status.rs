//! The status of planned touches, and counts of it.

use schemars::JsonSchema;
use serde::Serialize;

use crate::data::{Outcome, PlannedTouch};

/// The result of a planned touch.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TouchStatus {
    /// It gave a shift.
    Measured,
    /// It was made and gave none.
    Refused,
    /// A person left it out.
    Skipped,
    /// It was not made, or not to its end.
    #[default]
    NotReached,
}

impl TouchStatus {
    /// The name in JSON and CSV.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Refused => "refused",
            Self::Skipped => "skipped",
            Self::NotReached => "not_reached",
        }
    }

    /// The words for people.
    pub(crate) const fn describe(self) -> &'static str {
        match self {
            Self::NotReached => "not reached",
            status => status.name(),
        }
    }
}

/// Counts of planned touches by their status.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Tally {
    pub(crate) planned: usize,
    pub(crate) measured: usize,
    pub(crate) refused: usize,
    pub(crate) skipped: usize,
    pub(crate) not_reached: usize,
}

impl Tally {
    pub(crate) fn add(&mut self, status: TouchStatus) {
        self.planned += 1;
        *match status {
            TouchStatus::Measured => &mut self.measured,
            TouchStatus::Refused => &mut self.refused,
            TouchStatus::Skipped => &mut self.skipped,
            TouchStatus::NotReached => &mut self.not_reached,
        } += 1;
    }

    pub(crate) fn of(statuses: impl IntoIterator<Item = TouchStatus>) -> Self {
        let mut tally = Self::default();
        for status in statuses {
            tally.add(status);
        }
        tally
    }

    /// That of all touches together: the best of those that were made, or why there is none.
    pub(crate) const fn status(self) -> TouchStatus {
        match self {
            Self { measured: 1.., .. } => TouchStatus::Measured,
            Self { refused: 1.., .. } => TouchStatus::Refused,
            Self { not_reached: 1.., .. } => TouchStatus::NotReached,
            Self { skipped: 1.., .. } => TouchStatus::Skipped,
            _ => TouchStatus::NotReached,
        }
    }

    /// The words in place of a value when nothing was measured.
    pub(crate) const fn missing(self) -> &'static str {
        if self.planned == 0 { "–" } else { self.status().describe() }
    }

    /// `2 of 3`; `None` when all planned touches were measured.
    pub(crate) fn shortfall(self) -> Option<String> {
        let Self { planned, measured, .. } = self;
        (measured < planned).then(|| format!("{measured} of {planned}"))
    }
}

impl PlannedTouch {
    pub(crate) const fn status(&self) -> TouchStatus {
        match self.outcome {
            Some(Outcome::Measured(_)) => TouchStatus::Measured,
            Some(Outcome::Refused(_)) => TouchStatus::Refused,
            Some(Outcome::Skipped(_)) => TouchStatus::Skipped,
            None => TouchStatus::NotReached,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::TouchStatus::{Measured, NotReached, Refused, Skipped};
    use super::*;

    #[test]
    fn what_stands_in_place_of_a_value_is_why_there_is_none() {
        let missing = |statuses: &[TouchStatus]| Tally::of(statuses.iter().copied()).missing();
        assert_eq!(missing(&[]), "–");
        assert_eq!(missing(&[Skipped, Skipped]), "skipped");
        assert_eq!(missing(&[Skipped, NotReached]), "not reached");
        assert_eq!(missing(&[NotReached, Refused, Skipped]), "refused");
        assert_eq!(Tally::of([Refused, Measured]).status(), Measured);
    }
}
