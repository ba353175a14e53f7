//! The reasons for refusing a fit.

use std::fmt;

use rig_model::{ReadingFlag, Window};

use super::Resonance;

/// A refused fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Refusal {
    /// The reason of the refusal.
    pub reason: Reason,
    /// The best estimate from the readings, as evidence only; not a valid result.
    pub estimate: Option<Resonance>,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.reason)
    }
}

/// The side of the window on which a resonance lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Below the lower end of the window.
    Below,
    /// Above the upper end of the window.
    Above,
}

impl fmt::Display for Side {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Below => "below",
            Self::Above => "above",
        })
    }
}

/// The reason of a refusal.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Reason {
    /// A reading is not a finite impedance at a positive frequency.
    #[error("reading {index} is not a finite impedance at a positive frequency")]
    NotFinite {
        /// Index of the reading, from 0.
        index: usize,
    },
    /// Too many readings were overloaded.
    #[error("{overloaded} of {readings} readings were overloaded")]
    Saturated {
        /// Number of overloaded readings.
        overloaded: usize,
        /// Number of all readings.
        readings: usize,
    },
    /// The analyzer flagged its readings as unreliable, so that nothing can be fitted.
    #[error("the analyzer flagged {} at {frequency_hz} Hz in {tries} of {tries} tries", flag.name())]
    Flagged {
        /// The flag of its last reading.
        flag: ReadingFlag,
        /// Frequency of the reading, Hz.
        frequency_hz: f64,
        /// Number of tries.
        tries: usize,
    },
    /// Too few readings for the number of unknowns.
    #[error("{found} readings at different frequencies, at least {needed} are needed")]
    TooFewPoints {
        /// Number of usable readings.
        found: usize,
        /// Number of readings needed.
        needed: usize,
    },
    /// A capacitor with loss explains the readings as well.
    #[error(
        "no resonance: a capacitor with loss explains the readings as well (a resonance adds \
         {found:.1} to twice the log-likelihood, a real one at least {needed:.0})"
    )]
    NoResonance {
        /// Twice the difference of the log-likelihoods.
        found: f64,
        /// The threshold that noise alone does not reach.
        needed: f64,
    },
    /// The resonance lies outside the measured window.
    #[error(
        "resonance near {estimate_hz:.3} Hz lies {side} the window [{:.3} Hz, {:.3} Hz]",
        window.min_hz, window.max_hz
    )]
    OutsideWindow {
        /// The side of the window.
        side: Side,
        /// Its approximate frequency, Hz.
        estimate_hz: f64,
        /// The window.
        window: Window,
    },
    /// The circuit that explains the readings best cannot be a piezoelectric sensor.
    #[error(
        "no resonance of a sensor: the best circuit has a {quantity} of {found:.3}, at {} \
         {limit:.3} is possible here",
        if found < limit { "least" } else { "most" }
    )]
    NotASensor {
        /// The name of the impossible quantity, with its unit.
        quantity: &'static str,
        /// Its fitted value.
        found: f64,
        /// Its largest possible value, or the smallest one if `found` lies below it.
        limit: f64,
    },
    /// The uncertainty is not small compared with the linewidth, so that it is itself unreliable.
    #[error(
        "too noisy: the standard deviation {sigma_hz:.3} Hz exceeds {limit_hz:.3} Hz, which is all \
         that the linewidth allows"
    )]
    TooNoisy {
        /// The standard deviation, Hz.
        sigma_hz: f64,
        /// The largest acceptable standard deviation, Hz.
        limit_hz: f64,
    },
    /// Too many readings are far from the rest.
    #[error(
        "{found} of {readings} readings are far from the rest; {}",
        if found <= allowed {
            "the rest alone does not determine one resonance without doubt".to_owned()
        } else {
            format!("at most {allowed} can be left out")
        }
    )]
    Outliers {
        /// Number of outliers.
        found: usize,
        /// Number of all readings.
        readings: usize,
        /// Largest number that may be excluded.
        allowed: usize,
    },
    /// Another resonance is too near to be separated.
    #[error("a second mode near {near_hz:.2} Hz")]
    SecondMode {
        /// Its frequency, Hz.
        near_hz: f64,
    },
    /// The resonance moved while it was measured.
    #[error("the resonance changed during the readings")]
    Drift,
    /// The transient of one point still disturbs the next.
    #[error("the readings had not settled")]
    NotSettled,
    /// The resonance depends on the amplitude.
    #[error("the resonance changes with the amplitude: the level of the drive is too high")]
    Nonlinear,
    /// The resonance depends on the direction of the sweep.
    #[error("the resonance is not the same for rising and for falling frequencies")]
    Hysteretic,
    /// There is a stray impedance in series with the sensor.
    #[error("a stray resistance or inductance in series: repeat the open and short correction")]
    Stray,
    /// The static capacitance changes over the sweep.
    #[error("the static capacitance changes over the sweep, with the frequency or with time")]
    Dispersion,
    /// All readings have the same error of the phase.
    #[error("all readings are rotated by about the same phase: repeat the load correction")]
    AnalyzerPhase,
    /// The peak is not that of one resonance, and no single cause was recognised.
    #[error("the peak does not look like a single resonance")]
    Distorted,
    /// The fit did not converge.
    #[error("the fit did not converge")]
    NotConverged,
    /// Another circuit explains the readings nearly as well.
    #[error(
        "resonances near {first_hz:.3} Hz and near {other_hz:.3} Hz explain the readings nearly equally well: allow more time, \
         or measure in a narrower window"
    )]
    Ambiguous {
        /// The resonance of the circuit that explains them best, Hz.
        first_hz: f64,
        /// That of the next one, Hz.
        other_hz: f64,
    },
    /// The readings do not follow the model, and no single cause was recognised.
    #[error(
        "the circuit does not describe the readings, or they are {:.1} times as noisy as expected: chi² \
         per degree of freedom is {found:.2}, at most {allowed:.2} is chance",
        .found.sqrt()
    )]
    Misfit {
        /// chi² per degree of freedom.
        found: f64,
        /// The threshold that noise alone does not exceed.
        allowed: f64,
    },
    /// A planned sweep ended before it reached the requested standard deviation.
    #[error(
        "the target was not reached: {} after {readings} readings, {target_hz} Hz was asked for, \
         and {limit}",
        Deviation(*sigma_hz)
    )]
    TargetNotReached {
        /// The standard deviation reached, Hz; `None` if there is no estimate yet.
        sigma_hz: Option<f64>,
        /// The requested standard deviation, Hz.
        target_hz: f64,
        /// Number of all readings.
        readings: usize,
        /// The bound that ended the sweep.
        limit: Limit,
    },
}

impl Reason {
    /// A stable code for programs, independent of the message.
    pub const fn code(&self) -> &'static str {
        match self {
            Self::NotFinite { .. } => "not_finite",
            Self::Saturated { .. } => "saturated",
            Self::Flagged { .. } => "flagged",
            Self::TooFewPoints { .. } => "too_few_points",
            Self::NoResonance { .. } => "no_resonance",
            Self::OutsideWindow { .. } => "outside_window",
            Self::NotASensor { .. } => "not_a_sensor",
            Self::TooNoisy { .. } => "too_noisy",
            Self::Outliers { .. } => "outliers",
            Self::SecondMode { .. } => "second_mode",
            Self::Drift => "drift",
            Self::NotSettled => "not_settled",
            Self::Nonlinear => "nonlinear",
            Self::Hysteretic => "hysteretic",
            Self::Stray => "stray",
            Self::Dispersion => "dispersion",
            Self::AnalyzerPhase => "analyzer_phase",
            Self::Distorted => "distorted",
            Self::NotConverged => "not_converged",
            Self::Ambiguous { .. } => "ambiguous",
            Self::Misfit { .. } => "misfit",
            Self::TargetNotReached { .. } => "target_not_reached",
        }
    }
}

/// The bound that ended a planned sweep before its target.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Limit {
    /// The time limit leaves no time for a further reading.
    #[error(
        "the time limit of {limit_s} s leaves no time for another: allow more time or ask for less"
    )]
    Time {
        /// The time limit, s.
        limit_s: f64,
    },
    /// The sweep reached its largest number of readings.
    #[error("no more than {max} are taken in one sweep: ask for less")]
    Readings {
        /// Largest number of readings of one sweep.
        max: usize,
    },
    /// The sweep reached its largest number of judgements without an accepted result.
    #[error("they were judged {max} times without being enough: ask for less")]
    Verdicts {
        /// Largest number of judgements.
        max: usize,
    },
    /// The sweep reached its largest number of steps.
    #[error("no more than {max} steps are made in one sweep: ask for less")]
    Steps {
        /// Largest number of steps of one sweep.
        max: usize,
    },
    /// The survey was continued as often as it may be.
    #[error("the survey was made {rounds} times: survey for longer, or ask for less")]
    Survey {
        /// How often it was made.
        rounds: u32,
    },
    /// The estimate lies outside of the window, where no reading is.
    #[error(
        "the estimate of {estimate_hz:.3} Hz lies outside of the window: measure in a wider one"
    )]
    Window {
        /// The estimate, Hz.
        estimate_hz: f64,
    },
    /// The readings were recorded earlier, so that no more can be taken.
    #[error("no more were made: measure again and ask for less, or allow more time")]
    Past,
}

/// Formats a standard deviation for messages.
pub(crate) struct Deviation(pub(crate) Option<f64>);

impl fmt::Display for Deviation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(hz) => write!(f, "the standard deviation is {hz:.3} Hz"),
            None => f.write_str("there is no resonance yet"),
        }
    }
}
