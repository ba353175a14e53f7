//! Requests to an impedance analyzer, and its readings.

use std::ops::RangeInclusive;

use crate::RigTime;

/// A frequency interval in Hz, with `min_hz` below `max_hz`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Lower end, Hz.
    pub min_hz: f64,
    /// Upper end, Hz.
    pub max_hz: f64,
}

impl Window {
    /// Whether `frequency_hz` lies inside.
    pub fn contains(&self, frequency_hz: f64) -> bool {
        self.min_hz <= frequency_hz && frequency_hz <= self.max_hz
    }

    /// Equally spaced points, including both ends; one point lies at the lower end.
    pub fn evenly(&self, points: u32, settle_s: f64, cycles: u32) -> Vec<SweepPoint> {
        let step_hz = (self.max_hz - self.min_hz) / f64::from(points.max(2) - 1);
        (0..points)
            .map(|index| SweepPoint {
                // Rounding must not lead beyond the end.
                frequency_hz: (self.min_hz + step_hz * f64::from(index)).min(self.max_hz),
                settle_s,
                cycles,
            })
            .collect()
    }
}

/// The level of the drive signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveLevel {
    /// Open-circuit voltage as the instrument is programmed, V.
    pub volt: f64,
}

/// One frequency to measure at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweepPoint {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Settling time after the frequency is set, s.
    pub settle_s: f64,
    /// Whole cycles of integration.
    pub cycles: u32,
}

impl SweepPoint {
    /// Settling and integration together, s.
    pub fn duration_s(&self) -> f64 {
        self.settle_s + f64::from(self.cycles) / self.frequency_hz
    }
}

/// The choice of the points of a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SweepMethod {
    /// The planner chooses each next stay at one frequency from the readings so far. It does not
    /// wait for settling: the free decay after each change of frequency is fitted, with any phase
    /// of the drive. For any analyzer whose readings follow each other at times known to a
    /// millisecond.
    Adaptive,
    /// An adaptive sweep, and then as many readings around the resonance as this time allows: they tell what
    /// stays the same on the bench.
    Survey {
        /// Duration of these readings, s.
        seconds: u32,
    },
    /// Evenly spaced points over the whole window.
    Uniform {
        /// Number of points.
        points: u32,
    },
}

impl SweepMethod {
    /// Possible durations of a survey, s.
    pub const SURVEY_S: RangeInclusive<u32> = 10..=600;
}

/// A resonance to be found: where, how well, and at what cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweepRequest {
    /// Range of the resonance.
    pub window: Window,
    /// The choice of the points.
    pub method: SweepMethod,
    /// The requested standard deviation, Hz.
    pub target_sigma_hz: f64,
    /// The time allowed on the rig's clock, s; of a survey, for the adaptive sweep before it.
    pub time_limit_s: f64,
    /// Whole cycles integrated at each point of a uniform sweep; the adaptive ones choose.
    pub cycles: u32,
    /// Settling at each point of a uniform sweep, s.
    pub settle_s: f64,
    /// Level of the drive.
    pub level: DriveLevel,
}

/// Why a requested sweep is impossible.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SweepRequestError {
    /// The window is empty or not a range of positive numbers.
    #[error(
        "sweep window [{min_hz} Hz, {max_hz} Hz]: {}min_hz must be positive and below max_hz",
        if max_hz.is_finite() { "" } else { "both must be finite, and " }
    )]
    Window {
        /// Requested lower end, Hz.
        min_hz: f64,
        /// Requested upper end, Hz.
        max_hz: f64,
    },
    /// A quantity is outside its range.
    #[error("sweep {what} = {found} is outside [{min}, {max}]")]
    OutOfRange {
        /// Key of the protocol file.
        what: &'static str,
        /// The requested value.
        found: f64,
        /// Smallest value allowed.
        min: f64,
        /// Largest value allowed.
        max: f64,
    },
    /// A uniform sweep takes longer than it may.
    #[error("{points} points take {takes_s:.0} s, longer than time_limit_s = {limit_s}")]
    TooLong {
        /// Number of points.
        points: u32,
        /// The time that they take, s.
        takes_s: f64,
        /// The time allowed, s.
        limit_s: f64,
    },
}

/// Finest target, relative to the frequency, as 1 in this number: no analyzer keeps its own
/// frequency more accurately.
const FINEST_PARTS: f64 = 1e6;

impl SweepRequest {
    /// Every reason for which this sweep cannot be run.
    pub fn faults(&self) -> Vec<SweepRequestError> {
        let mut faults = Vec::new();
        let Window { min_hz, max_hz } = self.window;
        if !(min_hz > 0.0 && max_hz > min_hz && max_hz.is_finite()) {
            faults.push(SweepRequestError::Window { min_hz, max_hz });
        }
        let mut within = |what, found: f64, min: f64, max: f64| {
            if !(min <= found && found <= max) {
                faults.push(SweepRequestError::OutOfRange { what, found, min, max });
            }
        };
        if let SweepMethod::Uniform { points } = self.method {
            // Five circuit parameters need five points; two more leave something to judge by.
            within("points", f64::from(points), 7.0, 10_001.0);
        }
        if let SweepMethod::Survey { seconds } = self.method {
            let (min, max) = (*SweepMethod::SURVEY_S.start(), *SweepMethod::SURVEY_S.end());
            within("survey_s", f64::from(seconds), f64::from(min), f64::from(max));
        }
        let finest_hz = (min_hz / FINEST_PARTS).clamp(1e-6, 1.0);
        within("target_sigma_hz", self.target_sigma_hz, finest_hz, 100.0);
        within("time_limit_s", self.time_limit_s, 0.01, 86_400.0);
        within("cycles", f64::from(self.cycles), 1.0, 100_000.0);
        within("settle_s", self.settle_s, 0.0, 60.0);
        within("level_v", self.level.volt, 1e-3, 100.0);
        if let (SweepMethod::Uniform { points }, true) = (self.method, faults.is_empty()) {
            // The mean of 1/f over the window.
            let period_s = (max_hz / min_hz).ln() / (max_hz - min_hz);
            let takes_s = f64::from(points) * (self.settle_s + f64::from(self.cycles) * period_s);
            let limit_s = self.time_limit_s;
            if takes_s > limit_s {
                faults.push(SweepRequestError::TooLong { points, takes_s, limit_s });
            }
        }
        faults
    }
}

/// An impedance, ohm. Both parts are finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Impedance {
    /// Series resistance, the real part.
    pub resistance_ohm: f64,
    /// Series reactance, the imaginary part.
    pub reactance_ohm: f64,
}

impl Impedance {
    /// Its magnitude, ohm.
    pub fn magnitude_ohm(self) -> f64 {
        self.resistance_ohm.hypot(self.reactance_ohm)
    }
}

/// The result of an instrument at one point of a sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PointResult {
    /// An impedance.
    Value(Impedance),
    /// A value with a warning: the signal was too small for the range, or not at the requested
    /// level.
    LowSignal(Impedance),
    /// No value: the input was overloaded.
    Overload,
}

/// The reason why an instrument flags a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReadingFlag {
    /// The input was overloaded; there is no value.
    Overload,
    /// The signal was too small for the range, or not at the requested level.
    LowSignal,
}

impl ReadingFlag {
    /// The words in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Overload => "overload",
            Self::LowSignal => "low signal",
        }
    }
}

/// One measurement at one frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Frequency at which the instrument says it measured, Hz.
    pub frequency_hz: f64,
    /// Result at the point.
    pub measured: PointResult,
    /// When the frequency was set: settling starts here.
    pub started: RigTime,
    /// Settling before the integration, s.
    pub settle_s: f64,
    /// The integration time, s.
    pub integration_s: f64,
}

impl Reading {
    /// The impedance; `None` after an overload.
    pub const fn impedance(&self) -> Option<Impedance> {
        match self.measured {
            PointResult::Value(impedance) | PointResult::LowSignal(impedance) => Some(impedance),
            PointResult::Overload => None,
        }
    }

    /// Flag of the instrument, if there is one.
    pub const fn flag(&self) -> Option<ReadingFlag> {
        match self.measured {
            PointResult::Value(_) => None,
            PointResult::LowSignal(_) => Some(ReadingFlag::LowSignal),
            PointResult::Overload => Some(ReadingFlag::Overload),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_points_include_both_ends_and_never_leave_the_window() {
        for (window, points) in [((112.0, 168.0), 101), ((0.1, 0.7), 7), ((5.0, 5.0), 3)] {
            let window = Window { min_hz: window.0, max_hz: window.1 };
            let even = window.evenly(points, 0.1, 10);
            assert_eq!(even.len(), points as usize);
            assert_eq!(even[0].frequency_hz, window.min_hz);
            let last_hz = even[even.len() - 1].frequency_hz;
            assert!((last_hz - window.max_hz).abs() < 1e-12 * window.max_hz, "{last_hz}");
            assert!(even.iter().all(|point| window.contains(point.frequency_hz)), "{even:?}");
            let steps: Vec<f64> =
                even.windows(2).map(|two| two[1].frequency_hz - two[0].frequency_hz).collect();
            assert!(steps.iter().all(|step| (step - steps[0]).abs() < 1e-9), "{steps:?}");
        }
        assert_eq!(Window { min_hz: 1.0, max_hz: 2.0 }.evenly(1, 0.0, 1)[0].frequency_hz, 1.0);
    }
}
