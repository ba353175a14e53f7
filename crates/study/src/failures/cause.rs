//! The causes that refusals name, and those that accepted models include.

use rig_resonance::{ModelOrder, Reason};

use super::axis::Axis;

impl Axis {
    /// Whether a refusal for this reason names the cause.
    pub(super) const fn is_named_by(self, reason: &Reason) -> bool {
        match self {
            Self::Noise | Self::NoiseStated => matches!(reason, Reason::TooNoisy { .. }),
            Self::FigureOfMerit => {
                matches!(reason, Reason::NoResonance { .. } | Reason::TooNoisy { .. })
            }
            Self::Quality => {
                matches!(reason, Reason::NotASensor { .. } | Reason::TooNoisy { .. })
            }
            Self::WindowOffset => matches!(reason, Reason::OutsideWindow { .. }),
            Self::PointsPerLinewidth => matches!(reason, Reason::TooFewPoints { .. }),
            Self::Target => matches!(reason, Reason::TargetNotReached { .. }),
            Self::Drift | Self::DriftBothWays | Self::Relaxation => matches!(reason, Reason::Drift),
            Self::SecondMode | Self::SecondModeSmall | Self::SecondModeLarge => {
                matches!(reason, Reason::SecondMode { .. })
            }
            Self::Outliers => matches!(reason, Reason::Outliers { .. }),
            Self::DriveLevel | Self::DriveLevelStep => {
                matches!(reason, Reason::Nonlinear | Reason::Hysteretic)
            }
            Self::Settling | Self::SettlingUnknown | Self::SettlingAnyPhase => {
                matches!(reason, Reason::NotSettled)
            }
            Self::NothingConstantPhase | Self::NothingCapacitanceDrift => {
                matches!(reason, Reason::NoResonance { .. } | Reason::NotASensor { .. })
            }
            Self::NothingOutliers => matches!(
                reason,
                Reason::NoResonance { .. } | Reason::NotASensor { .. } | Reason::Outliers { .. }
            ),
            Self::CapacitanceDrift | Self::ConstantPhase => matches!(reason, Reason::Dispersion),
            Self::AnalyzerPhase => matches!(reason, Reason::AnalyzerPhase),
            Self::DielectricLoss | Self::Digits | Self::Gap | Self::ClockError | Self::Contact => {
                false
            }
        }
    }

    /// Whether an accepted model of this order includes the cause.
    pub(super) const fn is_modelled_by(self, model_order: ModelOrder) -> bool {
        match self {
            Self::Drift | Self::DriftBothWays | Self::Relaxation => {
                matches!(model_order, ModelOrder::Drift)
            }
            Self::SecondMode | Self::SecondModeSmall | Self::SecondModeLarge => {
                matches!(model_order, ModelOrder::SecondMode)
            }
            Self::DielectricLoss => matches!(model_order, ModelOrder::Loss),
            Self::CapacitanceDrift | Self::ConstantPhase => {
                matches!(model_order, ModelOrder::Dispersion)
            }
            Self::AnalyzerPhase => matches!(model_order, ModelOrder::AnalyzerPhase),
            _ => false,
        }
    }
}

/// Whether a refusal for this reason claims a particular cause, rather than a limit of the sweep or a
/// misfit of unknown cause.
pub(super) const fn claims_a_cause(reason: &Reason) -> bool {
    !matches!(
        reason,
        Reason::TooFewPoints { .. }
            | Reason::TooNoisy { .. }
            | Reason::Distorted
            | Reason::NotConverged
            | Reason::Ambiguous { .. }
            | Reason::Misfit { .. }
            | Reason::TargetNotReached { .. }
    )
}
