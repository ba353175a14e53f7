//! The ways to a resonance.

use serde::{Deserialize, Serialize};

use super::axis::Axis;

/// A way to a resonance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Path {
    /// The fit of a sweep of points chosen in advance.
    Fit,
    /// The planner of the daemon after a survey: it chooses the points.
    Planner,
    /// The same without a survey, as in a protocol that has none.
    Unsurveyed,
}

impl Path {
    pub(super) const ALL: [Self; 3] = [Self::Fit, Self::Planner, Self::Unsurveyed];

    /// The name in tables.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Fit => "maximum-likelihood",
            Self::Planner => "planner",
            Self::Unsurveyed => "planner without a survey",
        }
    }

    /// Whether it plans its sweeps.
    pub(super) const fn is_planned(self) -> bool {
        !matches!(self, Self::Fit)
    }

    /// Whether the axis has an effect on this path.
    pub(super) const fn has(self, axis: Axis) -> bool {
        match self {
            Self::Fit => !matches!(
                axis,
                Axis::Target | Axis::Relaxation | Axis::Gap | Axis::ClockError | Axis::Contact
            ),
            Self::Planner | Self::Unsurveyed => !matches!(
                axis,
                Axis::PointsPerLinewidth
                    | Axis::DriftBothWays
                    | Axis::DriveLevelStep
                    | Axis::Settling
                    | Axis::SettlingUnknown
                    | Axis::SettlingAnyPhase
                    // A survey of a bench at rest finds no resonance, and no sweep follows.
                    | Axis::NothingCapacitanceDrift
            ),
        }
    }
}
