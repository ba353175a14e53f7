//! Common estimators of a resonance frequency, for comparison and for interpreting published values.
//!
//! They return a frequency without an uncertainty and do not check for unusual readings. Use
//! [`fit`](crate::fit()) for results.

mod circle;
mod definition;
mod half_power;
mod lorentzian;
mod peaks;

#[cfg(test)]
mod tests;

use num_complex::Complex64;
use rig_model::{Reading, Window};

use crate::{
    FitOptions, FitOutcome, Reason, Side, Timing, circuit::points::Points,
    circuit::trace::complex_ohm, fit, fit::solve::rational_start,
};

pub use definition::Definition;

/// A method to estimate a resonance frequency.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Estimator {
    /// The reading with the smallest magnitude of the impedance.
    MagnitudeMinimum,
    /// The vertex of a parabola through that reading and its neighbours, on a logarithmic scale.
    MagnitudeParabola,
    /// The reading with the largest magnitude of the impedance.
    MagnitudeMaximum,
    /// The first rising zero of the phase, interpolated linearly between the readings.
    PhaseZero,
    /// The vertex of a parabola through the reading with the highest phase and its neighbours.
    PhaseMaximum,
    /// The reading with the largest conductance.
    ConductancePeak,
    /// The vertex of a parabola through that reading and its neighbours.
    ConductanceParabola,
    /// The resonance curve of a series circuit, with a loss proportional to the frequency, fitted to
    /// the conductance.
    ConductanceLorentzian,
    /// A circle fitted to the admittance minus that of the static capacitance, then a fit of the phase
    /// around its centre.
    CircleFit,
    /// A parabola fitted to 1/G within the half-power points.
    RobinsonClegg,
    /// A ratio of two polynomials; the start value of the maximum-likelihood fit.
    Rational,
    /// The maximum-likelihood fit with its checks.
    MaximumLikelihood,
}

/// The reason why an estimator returns no frequency.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NoEstimate {
    /// Too few readings at different frequencies within the window.
    #[error(
        "{found} readings at different frequencies in the window, at least {needed} are needed"
    )]
    TooFewPoints {
        /// Number of readings found.
        found: usize,
        /// Number of readings needed.
        needed: usize,
    },
    /// A reading is not a finite impedance at a positive frequency.
    #[error("reading {index} is not a finite impedance at a positive frequency")]
    NotFinite {
        /// Index of the reading, from 0.
        index: usize,
    },
    /// The extreme is the first or last reading, so that the true one may lie outside the window.
    #[error("the extreme is the last reading of the window, at {frequency_hz:.3} Hz")]
    AtEdge {
        /// The frequency of that reading, Hz.
        frequency_hz: f64,
    },
    /// The phase does not rise through zero.
    #[error("the phase does not rise through zero")]
    NoCrossing,
    /// Too few readings are above half of the peak, or they have no peak.
    #[error("{found} readings above half of the peak make no peak")]
    NoPeak {
        /// Number of readings found.
        found: usize,
    },
    /// The fit did not converge.
    #[error("the fit did not converge")]
    NotConverged,
    /// The estimate lies outside the window.
    #[error(
        "estimate {estimate_hz:.3} Hz lies {side} the window [{:.3} Hz, {:.3} Hz]",
        window.min_hz, window.max_hz
    )]
    OutsideWindow {
        /// The side of the window.
        side: Side,
        /// The estimate, Hz.
        estimate_hz: f64,
        /// The window.
        window: Window,
    },
    /// The maximum-likelihood fit refuses the readings.
    #[error(transparent)]
    Refused(Reason),
}

/// A reading, or the mean of several at one frequency.
#[derive(Debug, Clone, Copy)]
struct Point {
    frequency_hz: f64,
    impedance: Complex64,
    admittance: Complex64,
}

impl Estimator {
    /// All estimators, the simplest first.
    pub const ALL: [Self; 12] = [
        Self::MagnitudeMinimum,
        Self::MagnitudeParabola,
        Self::MagnitudeMaximum,
        Self::PhaseZero,
        Self::PhaseMaximum,
        Self::ConductancePeak,
        Self::ConductanceParabola,
        Self::ConductanceLorentzian,
        Self::CircleFit,
        Self::RobinsonClegg,
        Self::Rational,
        Self::MaximumLikelihood,
    ];

    /// The name on the command line and in results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::MagnitudeMinimum => "magnitude-minimum",
            Self::MagnitudeParabola => "magnitude-parabola",
            Self::MagnitudeMaximum => "magnitude-maximum",
            Self::PhaseZero => "phase-zero",
            Self::PhaseMaximum => "phase-maximum",
            Self::ConductancePeak => "conductance-peak",
            Self::ConductanceParabola => "conductance-parabola",
            Self::ConductanceLorentzian => "conductance-lorentzian",
            Self::CircleFit => "circle-fit",
            Self::RobinsonClegg => "robinson-clegg",
            Self::Rational => "rational",
            Self::MaximumLikelihood => "maximum-likelihood",
        }
    }

    /// The definition of resonance that it estimates.
    pub const fn definition(self) -> Definition {
        match self {
            Self::MagnitudeMinimum | Self::MagnitudeParabola => Definition::MagnitudeMinimum,
            Self::MagnitudeMaximum => Definition::MagnitudeMaximum,
            Self::PhaseZero => Definition::PhaseZero,
            Self::PhaseMaximum => Definition::PhaseMaximum,
            Self::ConductancePeak | Self::ConductanceParabola => Definition::ConductanceMaximum,
            Self::ConductanceLorentzian
            | Self::CircleFit
            | Self::RobinsonClegg
            | Self::Rational
            | Self::MaximumLikelihood => Definition::SeriesResonance,
        }
    }

    /// The estimate, Hz. Readings that are overloaded or outside the window are not used.
    ///
    /// # Errors
    /// [`NoEstimate`].
    pub fn estimate(self, readings: &[Reading], window: Window) -> Result<f64, NoEstimate> {
        let is_used = |reading: &Reading| {
            reading.impedance().is_some() && window.contains(reading.frequency_hz)
        };
        let points = points(readings, is_used)?;
        let estimate_hz = match self {
            Self::MagnitudeMinimum => peaks::highest(&points, |point| -point.impedance.norm()),
            Self::MagnitudeParabola => {
                peaks::parabola(&points, |point| -point.impedance.norm().ln())
            }
            Self::MagnitudeMaximum => peaks::highest(&points, |point| point.impedance.norm()),
            Self::PhaseZero => peaks::zero_phase(&points),
            Self::PhaseMaximum => peaks::parabola(&points, |point| point.impedance.arg()),
            Self::ConductancePeak => peaks::highest(&points, |point| point.admittance.re),
            Self::ConductanceParabola => peaks::parabola(&points, |point| point.admittance.re),
            Self::ConductanceLorentzian => lorentzian::resonance_hz(&points),
            Self::CircleFit => circle::resonance_hz(&points),
            Self::RobinsonClegg => half_power::resonance_hz(&points),
            Self::Rational => rational(readings, is_used),
            Self::MaximumLikelihood => most_likely(readings, window),
        }?;
        let side = if window.contains(estimate_hz) {
            return Ok(estimate_hz);
        } else if estimate_hz > window.max_hz {
            Side::Above
        } else if estimate_hz < window.min_hz {
            Side::Below
        } else {
            return Err(NoEstimate::NotConverged);
        };
        Err(NoEstimate::OutsideWindow { side, estimate_hz, window })
    }
}

/// The readings sorted by frequency, averaged at equal frequencies.
fn points(
    readings: &[Reading],
    is_used: impl Fn(&Reading) -> bool,
) -> Result<Vec<Point>, NoEstimate> {
    let mut points = Vec::with_capacity(readings.len());
    for (index, reading) in readings.iter().enumerate() {
        let Some(impedance) = complex_ohm(reading).filter(|_| is_used(reading)) else { continue };
        let admittance = 1.0 / impedance;
        if !(reading.frequency_hz > 0.0 && impedance.is_finite() && admittance.is_finite()) {
            return Err(NoEstimate::NotFinite { index });
        }
        points.push(Point { frequency_hz: reading.frequency_hz, impedance, admittance });
    }
    points.sort_by(|a, b| a.frequency_hz.total_cmp(&b.frequency_hz));
    let merged = points.chunk_by(|a, b| a.frequency_hz == b.frequency_hz).map(|same| {
        let impedance = same.iter().map(|point| point.impedance).sum::<Complex64>();
        let impedance = impedance / same.len() as f64;
        Point { impedance, admittance: 1.0 / impedance, ..same[0] }
    });
    Ok(merged.collect())
}

/// # Errors
/// [`NoEstimate::TooFewPoints`] if there are fewer than `needed` points.
fn at_least(needed: usize, points: &[Point]) -> Result<(), NoEstimate> {
    let found = points.len();
    if found < needed { Err(NoEstimate::TooFewPoints { found, needed }) } else { Ok(()) }
}

fn rational(readings: &[Reading], is_used: impl Fn(&Reading) -> bool) -> Result<f64, NoEstimate> {
    let used: Vec<_> = readings.iter().copied().filter(is_used).collect();
    let (found, needed) = (used.len(), crate::circuit::kernel::PARAMETERS);
    if found < needed {
        return Err(NoEstimate::TooFewPoints { found, needed });
    }
    let mut points = Points::default();
    points.load(&used).map_err(|fault| NoEstimate::NotFinite { index: fault.index })?;
    let theta = rational_start(&points).ok_or(NoEstimate::NotConverged)?;
    Ok(points.reference_hz * (1.0 + theta.nu).sqrt())
}

fn most_likely(readings: &[Reading], window: Window) -> Result<f64, NoEstimate> {
    let is_timed = readings.iter().all(|reading| reading.integration_s > 0.0);
    let timing = if is_timed { Timing::Waited } else { Timing::Unknown };
    let options = FitOptions { window: Some(window), timing, ..FitOptions::default() };
    match fit(readings, &options) {
        FitOutcome::Accepted(found) => Ok(found.resonance_hz),
        FitOutcome::Refused(refusal) => Err(NoEstimate::Refused(refusal.reason)),
    }
}
