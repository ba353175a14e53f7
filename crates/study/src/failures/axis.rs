//! The axes of the maps, from harmless to hopeless.

use rig_resonance::{NoisePrior, Timing};
use serde::{Deserialize, Serialize};

use super::scene::{Dielectric, Scene, SecondMode};
use crate::analyzer::WINDOW;

/// A cause of failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Axis {
    Noise,
    NoiseStated,
    FigureOfMerit,
    Quality,
    WindowOffset,
    PointsPerLinewidth,
    Target,
    Drift,
    DriftBothWays,
    Relaxation,
    CapacitanceDrift,
    SecondMode,
    SecondModeSmall,
    SecondModeLarge,
    Outliers,
    DriveLevel,
    DriveLevelStep,
    Settling,
    SettlingUnknown,
    SettlingAnyPhase,
    DielectricLoss,
    ConstantPhase,
    AnalyzerPhase,
    Digits,
    Gap,
    ClockError,
    Contact,
    NothingConstantPhase,
    NothingCapacitanceDrift,
    NothingOutliers,
}

/// Quality factor and coupling of the sensors on every axis.
pub(super) const SENSORS: [(f64, f64); 6] =
    [(10.0, 0.02), (10.0, 0.1), (30.0, 0.02), (30.0, 0.1), (100.0, 0.02), (100.0, 0.1)];

/// Time constants of settling.
const SETTLINGS: &[f64] = &[10.0, 5.0, 3.0, 2.0, 1.5, 1.0, 0.5, 0.0];
/// Softening at the peak over the linewidth.
const SOFTENINGS: &[f64] = &[0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 1.6, 3.0];
/// Places of a second mode, linewidths from the first.
const PLACES: &[f64] = &[-2.0, -1.0, -0.5, 0.5, 1.0, 2.0];

impl Axis {
    pub(super) const ALL: [Self; 30] = [
        Self::Noise,
        Self::NoiseStated,
        Self::FigureOfMerit,
        Self::Quality,
        Self::WindowOffset,
        Self::PointsPerLinewidth,
        Self::Target,
        Self::Drift,
        Self::DriftBothWays,
        Self::Relaxation,
        Self::CapacitanceDrift,
        Self::SecondMode,
        Self::SecondModeSmall,
        Self::SecondModeLarge,
        Self::Outliers,
        Self::DriveLevel,
        Self::DriveLevelStep,
        Self::Settling,
        Self::SettlingUnknown,
        Self::SettlingAnyPhase,
        Self::DielectricLoss,
        Self::ConstantPhase,
        Self::AnalyzerPhase,
        Self::Digits,
        Self::Gap,
        Self::ClockError,
        Self::Contact,
        Self::NothingConstantPhase,
        Self::NothingCapacitanceDrift,
        Self::NothingOutliers,
    ];

    /// The name in files, the label of the values, and the values from harmless to hopeless. A drift of a
    /// planned sweep is per second, because its duration is not known in advance.
    #[expect(clippy::too_many_lines, reason = "a table")]
    const fn about(self) -> (&'static str, &'static str, &'static [f64]) {
        match self {
            Self::Noise => (
                "noise",
                "noise of a reading (%)",
                &[0.01, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0],
            ),
            Self::NoiseStated => (
                "noise-stated",
                "noise of a reading over the stated noise",
                &[0.5, 0.7, 1.0, 1.2, 1.5, 2.0, 3.0, 5.0],
            ),
            Self::FigureOfMerit => (
                "figure-of-merit",
                "figure of merit Q·C1/C0",
                &[25.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.0],
            ),
            Self::Quality => {
                ("quality", "quality factor", &[100.0, 30.0, 10.0, 5.0, 3.0, 2.0, 1.5, 1.0, 0.7])
            }
            Self::WindowOffset => (
                "window-offset",
                "resonance from the middle of the window (half spans)",
                &[0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.01, 1.05, 1.1, 1.2, 1.5],
            ),
            Self::PointsPerLinewidth => (
                "points-per-linewidth",
                "points per linewidth",
                &[10.0, 5.0, 3.0, 2.0, 1.5, 1.0, 0.75, 0.5, 0.25],
            ),
            Self::Target => (
                "target",
                "target standard deviation (mHz)",
                &[1000.0, 300.0, 100.0, 50.0, 20.0, 10.0, 5.0, 3.0],
            ),
            Self::Drift => (
                "drift",
                "drift in a rising sweep (Hz; planned: Hz/s)",
                &[0.0, 0.01, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0],
            ),
            Self::DriftBothWays => (
                "drift-up-and-down",
                "drift in a sweep up and down (Hz)",
                &[0.0, 0.01, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0],
            ),
            Self::Relaxation => (
                "relaxation",
                "resonance that approaches its final value with 2 s, planned (Hz)",
                &[0.0, 0.03, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0],
            ),
            Self::CapacitanceDrift => (
                "capacitance-drift",
                "drift of the static capacitance in a rising sweep (%; planned: %/s)",
                &[0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0],
            ),
            Self::SecondMode => (
                "second-mode",
                "second mode a linewidth above, of the first (%)",
                &[0.0, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 50.0],
            ),
            Self::SecondModeSmall => {
                ("second-mode-5", "place of a second mode of 5 % (linewidths above)", PLACES)
            }
            Self::SecondModeLarge => {
                ("second-mode-20", "place of a second mode of 20 % (linewidths above)", PLACES)
            }
            Self::Outliers => (
                "outliers",
                "outliers among the readings (%)",
                &[0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 50.0],
            ),
            Self::DriveLevel => {
                ("drive-level", "softening at the peak over the linewidth, one level", SOFTENINGS)
            }
            Self::DriveLevelStep => (
                "drive-level-step",
                "softening at the peak over the linewidth, with a step of the level",
                SOFTENINGS,
            ),
            Self::Settling => ("settling", "time constants of settling", SETTLINGS),
            Self::SettlingUnknown => {
                ("settling-unknown", "time constants of settling, unknown to the fit", SETTLINGS)
            }
            Self::SettlingAnyPhase => (
                "settling-any-phase",
                "time constants of settling, with a drive of any phase",
                SETTLINGS,
            ),
            Self::DielectricLoss => {
                ("dielectric-loss", "dielectric loss tangent", &[0.0, 0.01, 0.02, 0.05, 0.1, 0.2])
            }
            Self::ConstantPhase => (
                "constant-phase",
                "exponent by which the permittivity falls with the frequency",
                &[0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2],
            ),
            Self::AnalyzerPhase => (
                "analyzer-phase",
                "phase error of the analyzer (degrees)",
                &[0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0],
            ),
            Self::Digits => ("digits", "digits of the readings", &[6.0, 5.0, 4.0, 3.0, 2.0]),
            Self::Gap => (
                "gap",
                "longest gap before a reading (ms), with a longest error of 1 ms",
                &[0.0, 3.0, 10.0, 30.0, 100.0],
            ),
            Self::ClockError => (
                "clock-error",
                "longest error of the length of a gap (ms), of which 1 is expected",
                &[0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0],
            ),
            Self::Contact => (
                "contact",
                "rise of the resonance since the reference at 120 Hz (Hz), with 0.7 of the quality",
                &[-5.0, -2.0, -1.0, 0.0, 1.0, 5.0, 20.0, 40.0],
            ),
            Self::NothingConstantPhase => (
                "nothing-constant-phase",
                "no resonance: exponent by which the permittivity falls with the frequency",
                &[0.0, 0.01, 0.02, 0.05, 0.1, 0.2],
            ),
            Self::NothingCapacitanceDrift => (
                "nothing-capacitance-drift",
                "no resonance: drift of the capacitance in a rising sweep (%; planned: %/s)",
                &[0.02, 0.1, 0.5, 1.0, 2.0, 5.0],
            ),
            Self::NothingOutliers => (
                "nothing-outliers",
                "no resonance: outliers among the readings (%)",
                &[1.0, 2.0, 5.0, 10.0, 20.0],
            ),
        }
    }

    /// The name in files.
    pub(super) const fn file(self) -> &'static str {
        self.about().0
    }

    /// The label of the values.
    pub(super) const fn label(self) -> &'static str {
        self.about().1
    }

    /// The values, from harmless to hopeless.
    pub(super) const fn values(self) -> &'static [f64] {
        self.about().2
    }

    /// The scene of a sensor with this value; `None` for too few readings, and for more than two sensors
    /// without a resonance, which do not differ.
    pub(super) fn scene(self, (q, coupling): (f64, f64), value: f64) -> Option<Scene> {
        let good = Scene::good(q, coupling);
        let nothing = Scene { coupling: 0.0, ..good };
        let part = 0.01 * value;
        let half_span_hz = 0.5 * (WINDOW.max_hz - WINDOW.min_hz);
        // A quarter span from the middle: a drift has no effect on a resonance at the middle of a
        // sweep.
        let aside = Scene { resonance_hz: good.resonance_hz + 0.5 * half_span_hz, ..good };
        let second = |part, place| Some(SecondMode { part, place });
        let scene = match self {
            Self::Noise => Scene { noise: part, ..good },
            Self::NoiseStated => {
                let stated =
                    NoisePrior { at_ten_cycles: good.noise / value, degrees_of_freedom: 1000.0 };
                Scene { stated_noise: Some(stated), ..good }
            }
            Self::FigureOfMerit => {
                let ratio = value / q;
                Scene { coupling: ratio / (1.0 + ratio), ..good }
            }
            Self::Quality => Scene::good(value, coupling),
            Self::WindowOffset => {
                Scene { resonance_hz: good.resonance_hz + value * half_span_hz, ..good }
            }
            Self::PointsPerLinewidth => {
                let linewidth_hz = good.resonance_hz / q;
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "at most a few thousand points"
                )]
                let points = (value * 2.0 * half_span_hz / linewidth_hz).round() as u32 + 1;
                Scene { points, ..good }
            }
            Self::Target => Scene { target_hz: 1e-3 * value, ..good },
            Self::Drift => Scene { drift_hz: value, ..aside },
            Self::DriftBothWays => Scene { drift_hz: value, is_both_ways: true, ..aside },
            Self::Relaxation => Scene { relaxation_hz: value, ..aside },
            Self::CapacitanceDrift => Scene { capacitance_drift: part, ..aside },
            Self::SecondMode => Scene { second: second(part, 1.0), ..good },
            Self::SecondModeSmall => Scene { second: second(0.05, value), ..good },
            Self::SecondModeLarge => Scene { second: second(0.2, value), ..good },
            Self::Outliers => Scene { outliers: part, ..good },
            Self::DriveLevel | Self::DriveLevelStep => Scene { softening: value, ..good },
            Self::Settling | Self::SettlingUnknown => Scene { waited: Some(value), ..good },
            Self::SettlingAnyPhase => Scene { waited: Some(value), is_any_phase: true, ..good },
            Self::DielectricLoss => Scene { dielectric: Dielectric::Loss(value), ..good },
            Self::ConstantPhase => Scene { dielectric: Dielectric::ConstantPhase(value), ..good },
            Self::AnalyzerPhase => Scene { phase_rad: value.to_radians(), ..good },
            #[expect(clippy::cast_possible_truncation, reason = "a digit or a few")]
            Self::Digits => Scene { digits: Some(value as i32), ..good },
            Self::Gap => Scene { gap_s: 1e-3 * value, ..good },
            Self::ClockError => Scene { clock_error_s: 1e-3 * value, ..good },
            Self::Contact => {
                let reference_hz = 120.0;
                let loaded = Scene::good(0.7 * q, coupling);
                let resonance_hz = reference_hz + value;
                Scene { resonance_hz, reference: Some((reference_hz, q)), ..loaded }
            }
            Self::NothingConstantPhase => {
                Scene { dielectric: Dielectric::ConstantPhase(value), ..nothing }
            }
            Self::NothingCapacitanceDrift => Scene { capacitance_drift: part, ..nothing },
            Self::NothingOutliers => Scene { outliers: part, ..nothing },
        };
        let is_other = scene.coupling > 0.0 || q <= 10.0 || matches!(self, Self::FigureOfMerit);
        (scene.points >= 5 && is_other).then_some(scene)
    }

    /// Whether the axis of a chart is linear.
    pub(super) const fn is_linear(self) -> bool {
        matches!(
            self,
            Self::WindowOffset
                | Self::SecondModeSmall
                | Self::SecondModeLarge
                | Self::Settling
                | Self::SettlingUnknown
                | Self::SettlingAnyPhase
                | Self::Digits
                | Self::Contact
        )
    }

    /// Whether one sweep cannot detect the cause, because it changes the readings as another
    /// resonance does. Such an axis is not part of the count of silently wrong results.
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
}
