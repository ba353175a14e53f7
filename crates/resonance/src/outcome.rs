//! The outcome of a fit: a resonance with its uncertainty, or a refusal with its reason.

use std::fmt;

use rig_model::{ReadingFlag, Window};

use crate::{
    Circuit, NoisePrior,
    planner::{Deviation, Limit},
    scatter::student_factor,
};

/// The outcome of a fit.
#[derive(Debug, Clone, PartialEq)]
pub enum FitOutcome {
    /// A resonance that can be relied on within its stated uncertainty.
    Accepted(Resonance),
    /// No number to rely on.
    Refused(Refusal),
}

impl FitOutcome {
    /// The resonance, when there is one to rely on.
    pub fn accepted(&self) -> Option<&Resonance> {
        match self {
            Self::Accepted(resonance) => Some(resonance),
            Self::Refused(_) => None,
        }
    }
}

/// A resonance as it was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resonance {
    /// Series resonance 1/(2π√(L1 C1)), Hz.
    pub resonance_hz: f64,
    /// Standard deviation of `resonance_hz`, Hz. With few readings it is widened so that ±1.96 of
    /// it is a 95 % interval although the noise, too, was only estimated.
    pub sigma_hz: f64,
    /// Quality of the series branch.
    pub q: f64,
    /// Static capacitance, F.
    pub c0_farad: f64,
    /// Effective coupling factor squared, C1/(C0 + C1).
    pub k_eff_squared: f64,
    /// Dielectric loss tangent; 0 where it was not fitted, its estimate being within its standard
    /// deviation, and where the readings are best explained by one below 0, which no dielectric has.
    /// The other quantities are those of the fit without that bound: an analyzer whose phase is off
    /// makes the loss come out wrong, and nothing else.
    pub loss_tangent: f64,
    /// Q·C1/C0.
    pub figure_of_merit: f64,
    /// Residuals against the noise known beforehand, per degree of freedom; against the scatter
    /// between neighbouring readings where no noise was known.
    pub chi_squared_per_dof: f64,
    /// Standard deviation of the real and of the imaginary part of the relative error of a reading
    /// of ten cycles.
    pub noise_at_ten_cycles: f64,
    /// Its degrees of freedom, from this and earlier sweeps.
    pub noise_degrees_of_freedom: f64,
    /// The model order that the readings needed.
    pub model_order: ModelOrder,
    /// The multiple of the mains frequency near which readings were disturbed and count for less,
    /// Hz.
    pub mains_hz: Option<f64>,
    /// Readings used.
    pub points: usize,
    /// Covariance of (resonance in Hz, Q, C0 in F, C1 in F, loss tangent).
    pub covariance: [[f64; 5]; 5],
    /// Condition number of the correlation matrix of the free parameters: how near the readings
    /// come to not telling the parameters apart.
    pub condition: f64,
}

impl Resonance {
    /// Standard deviation of `loss_tangent`; `None` where it was not fitted.
    pub fn loss_tangent_sigma(&self) -> Option<f64> {
        let variance = self.covariance[4][4];
        (variance > 0.0).then(|| variance.sqrt())
    }

    /// The circuit behind it.
    pub fn circuit(&self) -> Circuit {
        let c1_farad = self.c0_farad * self.k_eff_squared / (1.0 - self.k_eff_squared);
        Circuit {
            resonance_hz: self.resonance_hz,
            q: self.q,
            c0_farad: self.c0_farad,
            c1_farad,
            loss_tangent: self.loss_tangent,
        }
    }

    /// The same with this added to its variance, Hz².
    pub(crate) fn widened(&self, more: f64) -> Self {
        let mut covariance = self.covariance;
        covariance[0][0] += more;
        let sigma_hz = covariance[0][0].sqrt() * student_factor(self.noise_degrees_of_freedom);
        Self { sigma_hz, covariance, ..*self }
    }
}

/// The uncertainty of a fit for noise of variance 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spread {
    /// Covariance of (resonance in Hz, Q, C0 in F, C1 in F, loss tangent).
    pub(crate) covariance: [[f64; 5]; 5],
    pub(crate) condition: f64,
    /// The weighted sum of |r|².
    pub(crate) cost: f64,
    /// The variance of one part of a reading of ten cycles by the differences of neighbours.
    pub(crate) neighbours: f64,
    /// Ratio of the variance to that of independent errors.
    pub(crate) correlation: f64,
    /// Readings used.
    pub(crate) count: usize,
    /// Degrees of freedom left.
    pub(crate) degrees: f64,
    /// Cost and degrees of freedom of the readings that tell of the noise.
    pub(crate) settled: (f64, f64),
    /// Variance of the resonance to be added, Hz².
    pub(crate) widened: f64,
}

impl Resonance {
    /// A circuit with its uncertainty.
    #[inline]
    pub(crate) fn new(
        circuit: &Circuit,
        spread: &Spread,
        model_order: ModelOrder,
        noise: Option<&NoisePrior>,
    ) -> Self {
        let found = spread.cost / spread.degrees;
        let (variance, against, degrees) = match noise {
            None => (found, spread.neighbours, spread.degrees),
            Some(prior) => {
                let (known, weight) = (prior.at_ten_cycles.powi(2), prior.degrees_of_freedom);
                let (cost, degrees) = spread.settled;
                let all = weight + degrees;
                // Infinitely many degrees of freedom leave nothing to be pooled.
                let pooled = if all.is_finite() { (weight * known + cost) / all } else { known };
                (pooled, known, all)
            }
        };
        let mut covariance =
            spread.covariance.map(|row| row.map(|x| x * variance * spread.correlation));
        covariance[0][0] += spread.widened;
        Self {
            resonance_hz: circuit.resonance_hz,
            sigma_hz: covariance[0][0].sqrt() * student_factor(degrees),
            q: circuit.q,
            c0_farad: circuit.c0_farad,
            k_eff_squared: circuit.k_eff_squared(),
            loss_tangent: circuit.loss_tangent.max(0.0),
            figure_of_merit: circuit.figure_of_merit(),
            chi_squared_per_dof: found / against,
            noise_at_ten_cycles: variance.sqrt(),
            noise_degrees_of_freedom: degrees,
            model_order,
            mains_hz: None,
            points: spread.count,
            covariance,
            condition: spread.condition,
        }
    }
}

/// The model order that the readings need.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ModelOrder {
    /// A capacitor with loss, and no resonance.
    Capacitor,
    /// The circuit of four elements.
    Circuit,
    /// … with dielectric loss.
    Loss,
    /// … and a resonance that moves evenly with time; it is given for the middle of the time.
    Drift,
    /// … and the motion that has not settled yet.
    RingUp,
    /// … and something in series.
    Stray,
    /// … and a second resonance.
    SecondMode,
}

/// Twice the log-likelihood that dielectric loss must gain to be fitted: its estimate exceeds its
/// standard deviation. To leave out what is larger errs by more than fitting it does.
pub(crate) const LOSS_GAIN_MIN: f64 = 1.0;

impl ModelOrder {
    /// Whether this number of readings needs dielectric loss, by the Bayesian information criterion.
    pub(crate) fn by_loss(gain: f64, readings: usize) -> Self {
        if gain > (2.0 * readings as f64).ln() { Self::Loss } else { Self::Circuit }
    }

    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Capacitor => "capacitor",
            Self::Circuit => "circuit",
            Self::Loss => "dielectric loss",
            Self::Drift => "drift",
            Self::RingUp => "ring-up",
            Self::Stray => "stray",
            Self::SecondMode => "second mode",
        }
    }
}

/// A refused fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Refusal {
    /// Why.
    pub reason: Reason,
    /// The best that could be made of the readings, as evidence; not to be used as a result.
    pub estimate: Option<Resonance>,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.reason)
    }
}

/// The end of the window beyond which a resonance lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Below its lower end.
    Below,
    /// Above its upper end.
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
        /// Its place, from 0.
        index: usize,
    },
    /// Too many readings were overloaded.
    #[error("{overloaded} of {readings} readings were overloaded")]
    Saturated {
        /// Readings with overload.
        overloaded: usize,
        /// All readings.
        readings: usize,
    },
    /// The analyzer does not stand by what it reads, so that nothing can be fitted.
    #[error("the analyzer flagged {} at {frequency_hz} Hz in {tries} of {tries} tries", flag.name())]
    Flagged {
        /// The flag of its last reading.
        flag: ReadingFlag,
        /// Where, Hz.
        frequency_hz: f64,
        /// Number of tries.
        tries: usize,
    },
    /// Too few readings for the number of unknowns.
    #[error("{found} readings at different frequencies, at least {needed} are needed")]
    TooFewPoints {
        /// Readings that can be used.
        found: usize,
        /// Readings needed.
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
        /// The threshold that chance does not reach.
        needed: f64,
    },
    /// The resonance lies where nothing was measured.
    #[error(
        "resonance near {estimate_hz:.3} Hz lies {side} the window [{:.3} Hz, {:.3} Hz]",
        window.min_hz, window.max_hz
    )]
    OutsideWindow {
        /// On which side.
        side: Side,
        /// Its approximate frequency, Hz.
        estimate_hz: f64,
        /// The window.
        window: Window,
    },
    /// The circuit that explains the readings best cannot be a piezoelectric sensor.
    #[error(
        "no resonance of a sensor: the best circuit has a {quantity} of {found:.3}, at most \
         {limit:.3} is possible here"
    )]
    NotASensor {
        /// The impossible value, with its unit.
        quantity: &'static str,
        /// Its value.
        found: f64,
        /// The largest possible.
        limit: f64,
    },
    /// The uncertainty is not small against the linewidth, so that it is not to be trusted either.
    #[error(
        "too noisy: the standard deviation {sigma_hz:.3} Hz exceeds {limit_hz:.3} Hz, which is all \
         that the linewidth allows"
    )]
    TooNoisy {
        /// The standard deviation, Hz.
        sigma_hz: f64,
        /// The largest that would do, Hz.
        limit_hz: f64,
    },
    /// Too many readings are far from the rest.
    #[error(
        "{found} of {readings} readings are far from the rest; at most {allowed} can be left out, \
         and only where the rest still determines the resonance"
    )]
    Outliers {
        /// Outliers.
        found: usize,
        /// All readings.
        readings: usize,
        /// Largest number that may be left out.
        allowed: usize,
    },
    /// Another resonance is near, and the two could not be told apart.
    #[error("a second mode near {near_hz:.2} Hz")]
    SecondMode {
        /// Its frequency, Hz.
        near_hz: f64,
    },
    /// The resonance moved while it was measured.
    #[error("the resonance drifted during the readings")]
    Drift,
    /// The motion at one point is still heard at the next.
    #[error("the readings had not settled")]
    NotSettled,
    /// The resonance depends on the amplitude.
    #[error("the resonance changes with the amplitude: the level of the drive is too high")]
    Nonlinear,
    /// The resonance depends on the direction of the sweep.
    #[error("the resonance is not the same for rising and for falling frequencies")]
    Hysteretic,
    /// Something in series with the sensor.
    #[error("a stray resistance or inductance in series: repeat the open and short correction")]
    Stray,
    /// The peak is not that of one resonance, and no single cause was recognised.
    #[error("the peak does not look like a single resonance")]
    Distorted,
    /// No best circuit was found.
    #[error("the fit did not converge")]
    NotConverged,
    /// The readings do not follow the model, and no single cause was recognised.
    #[error(
        "the circuit does not describe the readings: chi² per degree of freedom is {found:.2}, at \
         most {allowed:.2} is chance"
    )]
    Misfit {
        /// chi² per degree of freedom.
        found: f64,
        /// The threshold that chance does not exceed.
        allowed: f64,
    },
    /// A planned sweep ended before the standard deviation asked for was reached.
    #[error(
        "the target was not reached: {} after {readings} readings, {target_hz} Hz was asked for, \
         and {limit}",
        Deviation(*sigma_hz)
    )]
    TargetNotReached {
        /// The standard deviation reached, Hz; `None` where the readings say nothing yet.
        sigma_hz: Option<f64>,
        /// The one asked for, Hz.
        target_hz: f64,
        /// All readings.
        readings: usize,
        /// The bound that ended the sweep.
        limit: Limit,
    },
}

impl Reason {
    /// A word for programs: it stays as it is whatever becomes of the message.
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
            Self::Distorted => "distorted",
            Self::NotConverged => "not_converged",
            Self::Misfit { .. } => "misfit",
            Self::TargetNotReached { .. } => "target_not_reached",
        }
    }
}
