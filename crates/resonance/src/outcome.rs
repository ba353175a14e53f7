//! The outcome of a fit: a resonance with its uncertainty, or a refusal with its reason.

pub(crate) mod refusal;

use refusal::Refusal;

use crate::{
    Circuit,
    noise::{NoisePrior, student_factor},
};

/// The outcome of a fit.
#[derive(Debug, Clone, PartialEq)]
pub enum FitOutcome {
    /// A resonance, valid within its stated uncertainty.
    Accepted(Resonance),
    /// No valid resonance.
    Refused(Refusal),
}

impl FitOutcome {
    /// The resonance, if the fit was accepted.
    pub fn accepted(&self) -> Option<&Resonance> {
        match self {
            Self::Accepted(resonance) => Some(resonance),
            Self::Refused(_) => None,
        }
    }
}

/// A measured resonance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resonance {
    /// Series resonance 1/(2π√(L1 C1)), Hz.
    pub resonance_hz: f64,
    /// Standard deviation of `resonance_hz`, Hz. With few readings it is widened so that ±1.96
    /// `sigma_hz` is a 95 % interval even though the noise is estimated too.
    pub sigma_hz: f64,
    /// Quality factor of the series branch.
    pub q: f64,
    /// Static capacitance, F.
    pub c0_farad: f64,
    /// Effective coupling factor squared, C1/(C0 + C1).
    pub k_eff_squared: f64,
    /// Dielectric loss tangent. It is 0 if it was not fitted because its estimate lies within its
    /// standard deviation, and if its best estimate is negative, which is unphysical. The other
    /// quantities come from the fit without that bound, because a phase error of the analyzer biases
    /// only the loss.
    pub loss_tangent: f64,
    /// Q·C1/C0.
    pub figure_of_merit: f64,
    /// χ² per degree of freedom, relative to the prior noise or, without a prior, to the scatter
    /// between neighbouring readings.
    pub chi_squared_per_dof: f64,
    /// Standard deviation of the real and of the imaginary part of the relative error of a reading
    /// of ten cycles.
    pub noise_at_ten_cycles: f64,
    /// Degrees of freedom of `noise_at_ten_cycles`, from this and earlier sweeps.
    pub noise_degrees_of_freedom: f64,
    /// The model order that the readings require.
    pub model_order: ModelOrder,
    /// What was fitted together with the circuit.
    pub extra: Option<Extra>,
    /// The multiple of the mains frequency near which readings were disturbed and are down-weighted,
    /// Hz.
    pub mains_hz: Option<f64>,
    /// Readings used.
    pub points: usize,
    /// Covariance of (resonance in Hz, Q, C0 in F, C1 in F, loss tangent).
    pub covariance: [[f64; 5]; 5],
    /// Condition number of the correlation matrix of the free parameters; large if the readings barely
    /// separate them.
    pub condition: f64,
}

impl Resonance {
    /// Standard deviation of `q`.
    pub fn q_sigma(&self) -> f64 {
        self.covariance[1][1].max(0.0).sqrt()
    }

    /// Standard deviation of `c0_farad`, F.
    pub fn c0_sigma_farad(&self) -> f64 {
        self.covariance[2][2].max(0.0).sqrt()
    }

    /// Standard deviation of C1/C0, to first order.
    pub fn capacitance_ratio_sigma(&self) -> f64 {
        let Circuit { c0_farad: c0, c1_farad: c1, .. } = self.circuit();
        let covariance = &self.covariance;
        let variance = covariance[3][3] / c1.powi(2) + covariance[2][2] / c0.powi(2)
            - 2.0 * covariance[2][3] / (c0 * c1);
        c1 / c0 * variance.max(0.0).sqrt()
    }

    /// Standard deviation of `loss_tangent`; `None` if it was not fitted.
    pub fn loss_tangent_sigma(&self) -> Option<f64> {
        let variance = self.covariance[4][4];
        (variance > 0.0).then(|| variance.sqrt())
    }

    /// The circuit with these values.
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

    /// A copy with `more`, Hz², added to the variance of the resonance.
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
    /// Variance of the real or imaginary part of a ten-cycle reading, from the differences of
    /// neighbours.
    pub(crate) neighbours: f64,
    /// Ratio of the variance to that of independent errors.
    pub(crate) correlation: f64,
    /// Readings used.
    pub(crate) count: usize,
    /// Residual degrees of freedom.
    pub(crate) degrees: f64,
    /// Cost and degrees of freedom of the readings that determine the noise.
    pub(crate) settled: (f64, f64),
    /// Additional variance of the resonance, Hz².
    pub(crate) widened: f64,
}

impl Resonance {
    /// Combines a circuit with its uncertainty.
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
                // A prior with infinitely many degrees of freedom is not pooled.
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
            extra: None,
            mains_hz: None,
            points: spread.count,
            covariance,
            condition: spread.condition,
        }
    }
}

/// The model order that the readings require. Each order includes the ones before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ModelOrder {
    /// A capacitor with loss, without a resonance.
    Capacitor,
    /// The circuit of four elements.
    Circuit,
    /// Adds dielectric loss.
    Loss,
    /// Adds a resonance that drifts linearly with time; its value is that at mid-time.
    Drift,
    /// Adds motion that has not settled yet.
    RingUp,
    /// Adds a stray impedance in series.
    Stray,
    /// Adds a second resonance.
    SecondMode,
    /// Adds a static capacitance that changes with the frequency.
    Dispersion,
    /// Adds a phase error of the analyzer.
    AnalyzerPhase,
}

/// What readings show beside the circuit, with its fitted values: settled ones on a given grid any of
/// these but the second, and those with a free decay the first two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Extra {
    /// A resonance that drifts linearly with time: its relative change from the middle of the first and
    /// last reading to the last, or, of readings with a free decay, half of that from the begin of the first to the end of the
    /// last.
    Drift {
        /// As a part of the resonance.
        change: f64,
    },
    /// A resonance that approaches a final value exponentially, because the tissue relaxes: its relative
    /// change from the begin of the first reading to the end of the last, and the time constant.
    Relaxation {
        /// As a part of the resonance.
        change: f64,
        /// Time constant, s.
        time_s: f64,
    },
    /// An impedance in series with the sensor.
    Stray {
        /// Its resistance, ohm.
        resistance_ohm: f64,
        /// Its inductance, H.
        inductance_h: f64,
    },
    /// A second series branch.
    SecondMode {
        /// Its series resonance, Hz.
        resonance_hz: f64,
        /// Its quality factor.
        q: f64,
        /// Its capacitance, F.
        capacitance_farad: f64,
    },
    /// A static capacitance that changes with the frequency.
    Dispersion {
        /// Its relative change for each factor e of the frequency.
        slope: f64,
    },
    /// A phase error of the analyzer.
    AnalyzerPhase {
        /// By how much measured phases are too large, rad.
        phase_rad: f64,
    },
}

/// Twice the log-likelihood that dielectric loss must gain to be fitted. At 1 its estimate equals its
/// standard deviation; omitting a larger loss causes more error than fitting it.
pub(crate) const LOSS_GAIN_MIN: f64 = 1.0;

impl ModelOrder {
    /// The order with or without dielectric loss, by the Bayesian information criterion.
    pub(crate) fn by_loss(gain: f64, readings: usize) -> Self {
        if gain > (2.0 * readings as f64).ln() { Self::Loss } else { Self::Circuit }
    }

    /// The name in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Capacitor => "capacitor",
            Self::Circuit => "circuit",
            Self::Loss => "dielectric loss",
            Self::Drift => "drift",
            Self::RingUp => "ring-up",
            Self::Stray => "stray",
            Self::SecondMode => "second mode",
            Self::Dispersion => "dispersion",
            Self::AnalyzerPhase => "analyzer phase",
        }
    }
}
