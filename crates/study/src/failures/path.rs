//! The two ways to a resonance.

use serde::{Deserialize, Serialize};

use super::axis::Axis;

/// A way to a resonance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Path {
    /// The fit of a sweep of points chosen in advance.
    Fit,
    /// The planner of the daemon: it chooses the points.
    Planner,
}

impl Path {
    pub(super) const ALL: [Self; 2] = [Self::Fit, Self::Planner];

    /// The name in tables.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Fit => "maximum-likelihood",
            Self::Planner => "planner",
        }
    }

    /// Whether the axis has an effect on this path.
    pub(super) const fn has(self, axis: Axis) -> bool {
        match self {
            Self::Fit => !matches!(
                axis,
                Axis::Target | Axis::Relaxation | Axis::Gap | Axis::ClockError | Axis::Contact
            ),
            Self::Planner => !matches!(
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
