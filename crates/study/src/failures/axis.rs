//! The axes of the maps, from harmless to hopeless.

use rig_resonance::{ModelOrder, Reason, Timing};

use super::simulated_sweep::SimulatedSweep;
use crate::analyzer::WINDOW;

/// A cause of failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Axis {
    Noise,
    FigureOfMerit,
    WindowOffset,
    PointsPerLinewidth,
    Drift,
    DriftBothWays,
    SecondMode,
    Outliers,
    DriveLevel,
    DriveLevelStep,
    Settling,
    SettlingUnknown,
    DielectricLoss,
    Digits,
}

/// Quality factor and coupling of the sensors on every axis.
pub(super) const SENSORS: [(f64, f64); 6] =
    [(10.0, 0.02), (10.0, 0.1), (30.0, 0.02), (30.0, 0.1), (100.0, 0.02), (100.0, 0.1)];

impl Axis {
    pub(super) const ALL: [Self; 14] = [
        Self::Noise,
        Self::FigureOfMerit,
        Self::WindowOffset,
        Self::PointsPerLinewidth,
        Self::Drift,
        Self::DriftBothWays,
        Self::SecondMode,
        Self::Outliers,
        Self::DriveLevel,
        Self::DriveLevelStep,
        Self::Settling,
        Self::SettlingUnknown,
        Self::DielectricLoss,
        Self::Digits,
    ];

    /// The name in files.
    pub(super) const fn file(self) -> &'static str {
        match self {
            Self::Noise => "noise",
            Self::FigureOfMerit => "figure-of-merit",
            Self::WindowOffset => "window-offset",
            Self::PointsPerLinewidth => "points-per-linewidth",
            Self::Drift => "drift",
            Self::DriftBothWays => "drift-up-and-down",
            Self::SecondMode => "second-mode",
            Self::Outliers => "outliers",
            Self::DriveLevel => "drive-level",
            Self::DriveLevelStep => "drive-level-step",
            Self::Settling => "settling",
            Self::SettlingUnknown => "settling-unknown",
            Self::DielectricLoss => "dielectric-loss",
            Self::Digits => "digits",
        }
    }

    /// The label of the values.
    pub(super) const fn label(self) -> &'static str {
        match self {
            Self::Noise => "noise of a reading (%)",
            Self::FigureOfMerit => "figure of merit Q·C1/C0",
            Self::WindowOffset => "resonance from the middle of the window (half spans)",
            Self::PointsPerLinewidth => "points per linewidth",
            Self::Drift => "drift during a rising sweep (Hz)",
            Self::DriftBothWays => "drift during a sweep up and down (Hz)",
            Self::SecondMode => "second mode a linewidth above, of the first (%)",
            Self::Outliers => "outliers among the readings (%)",
            Self::DriveLevel => "softening at the peak over the linewidth, one level",
            Self::DriveLevelStep => {
                "softening at the peak over the linewidth, with a step of the level"
            }
            Self::Settling => "time constants of settling",
            Self::SettlingUnknown => "time constants of settling, unknown to the fit",
            Self::DielectricLoss => "dielectric loss tangent",
            Self::Digits => "digits of the readings",
        }
    }

    /// The values, from harmless to hopeless.
    pub(super) const fn values(self) -> &'static [f64] {
        match self {
            Self::Noise => &[0.01, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0],
            Self::FigureOfMerit => &[25.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.0],
            Self::WindowOffset => &[0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.01, 1.05, 1.1, 1.2, 1.5],
            Self::PointsPerLinewidth => &[10.0, 5.0, 3.0, 2.0, 1.5, 1.0, 0.75, 0.5, 0.25],
            Self::Drift | Self::DriftBothWays => &[0.0, 0.01, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0],
            Self::SecondMode => &[0.0, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 50.0],
            Self::Outliers => &[0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 50.0],
            Self::DriveLevel | Self::DriveLevelStep => {
                &[0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 1.6, 3.0]
            }
            Self::Settling | Self::SettlingUnknown => &[10.0, 5.0, 3.0, 2.0, 1.5, 1.0, 0.5, 0.0],
            Self::DielectricLoss => &[0.0, 0.01, 0.02, 0.05, 0.1, 0.2],
            Self::Digits => &[6.0, 5.0, 4.0, 3.0, 2.0],
        }
    }

    /// The sweep of a sensor with this value; `None` for too few readings, or for an axis without
    /// effect on this sensor.
    pub(super) fn simulated(self, (q, coupling): (f64, f64), value: f64) -> Option<SimulatedSweep> {
        let good = SimulatedSweep::good(q, coupling);
        let half_span_hz = 0.5 * (WINDOW.max_hz - WINDOW.min_hz);
        // A quarter span from the middle: a drift has no effect on a resonance at the middle of a
        // sweep.
        let aside = SimulatedSweep { resonance_hz: good.resonance_hz + 0.5 * half_span_hz, ..good };
        let simulated = match self {
            Self::Noise => SimulatedSweep { noise: 0.01 * value, ..good },
            Self::FigureOfMerit => {
                let ratio = value / q;
                SimulatedSweep { coupling: ratio / (1.0 + ratio), ..good }
            }
            Self::WindowOffset => {
                SimulatedSweep { resonance_hz: good.resonance_hz + value * half_span_hz, ..good }
            }
            Self::PointsPerLinewidth => {
                let linewidth_hz = good.resonance_hz / q;
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "at most a few thousand points"
                )]
                let points = (value * 2.0 * half_span_hz / linewidth_hz).round() as u32 + 1;
                SimulatedSweep { points, ..good }
            }
            Self::Drift => SimulatedSweep { drift_hz: value, ..aside },
            Self::DriftBothWays => SimulatedSweep { drift_hz: value, is_both_ways: true, ..aside },
            Self::SecondMode => SimulatedSweep { second: 0.01 * value, ..good },
            Self::Outliers => SimulatedSweep { outliers: 0.01 * value, ..good },
            Self::DriveLevel | Self::DriveLevelStep => SimulatedSweep { softening: value, ..good },
            Self::Settling | Self::SettlingUnknown => {
                SimulatedSweep { waited: Some(value), ..good }
            }
            Self::DielectricLoss => SimulatedSweep { dielectric_loss: value, ..good },
            #[expect(clippy::cast_possible_truncation, reason = "a digit or a few")]
            Self::Digits => SimulatedSweep { digits: Some(value as i32), ..good },
        };
        (simulated.points >= 5).then_some(simulated)
    }

    /// Whether the axis of a chart is linear.
    pub(super) const fn is_linear(self) -> bool {
        matches!(self, Self::WindowOffset | Self::Settling | Self::SettlingUnknown | Self::Digits)
    }

    /// Whether one sweep cannot detect the cause, because it changes the readings as another
    /// resonance does. Such an axis is outside the grid on which the production fit may never be
    /// silently wrong.
    pub(super) const fn is_beyond_one_sweep(self) -> bool {
        matches!(self, Self::DriveLevel)
    }

    /// The timing that the production fit gets.
    pub(super) const fn timing(self) -> Timing {
        match self {
            Self::SettlingUnknown => Timing::Unknown,
            _ => Timing::Waited,
        }
    }

    /// Whether a refusal for this reason names the cause.
    pub(super) const fn is_named_by(self, reason: &Reason) -> bool {
        match self {
            Self::Noise => matches!(reason, Reason::TooNoisy { .. }),
            Self::FigureOfMerit => {
                matches!(reason, Reason::NoResonance { .. } | Reason::TooNoisy { .. })
            }
            Self::WindowOffset => matches!(reason, Reason::OutsideWindow { .. }),
            Self::PointsPerLinewidth => matches!(reason, Reason::TooFewPoints { .. }),
            Self::Drift | Self::DriftBothWays => matches!(reason, Reason::Drift),
            Self::SecondMode => matches!(reason, Reason::SecondMode { .. }),
            Self::Outliers => matches!(reason, Reason::Outliers { .. }),
            Self::DriveLevel | Self::DriveLevelStep => {
                matches!(reason, Reason::Nonlinear | Reason::Hysteretic)
            }
            Self::Settling | Self::SettlingUnknown => matches!(reason, Reason::NotSettled),
            Self::DielectricLoss | Self::Digits => false,
        }
    }

    /// Whether an accepted model of this order includes the cause.
    pub(super) const fn is_modelled_by(self, model_order: ModelOrder) -> bool {
        match self {
            Self::Drift | Self::DriftBothWays => matches!(model_order, ModelOrder::Drift),
            Self::SecondMode => matches!(model_order, ModelOrder::SecondMode),
            Self::DielectricLoss => matches!(model_order, ModelOrder::Loss),
            _ => false,
        }
    }
}
