//! Estimators of the resonance from a sweep.

use rig_resonance::Estimator;

use super::method::{Measured, Method};
use crate::analyzer::WINDOW;

/// An estimator of the resonance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SweepEstimator {
    /// The fit of the daemon, with the known timing.
    Production,
    /// An estimator in use elsewhere.
    Baseline(Estimator),
}

/// A resonance with its standard deviation, which baselines do not state.
pub(super) struct EstimatedResonance {
    pub(super) resonance_hz: f64,
    pub(super) sigma_hz: Option<f64>,
}

impl SweepEstimator {
    /// The baselines on the charts; the tables have all of them.
    pub(super) const SHOWN: [Self; 2] = [
        Self::Baseline(Estimator::ConductanceParabola),
        Self::Baseline(Estimator::ConductanceLorentzian),
    ];

    /// The estimators for this method. Baselines need settled readings on an even grid.
    pub(super) fn of(method: Method) -> Vec<Self> {
        let baselines: &[Estimator] = match method {
            Method::Even { .. } => &Estimator::ALL,
            Method::Steady { .. }
            | Method::Fast { .. }
            | Method::Decay { .. }
            | Method::Unsurveyed { .. } => &[],
        };
        let baselines = baselines.iter().filter(|&&one| one != Estimator::MaximumLikelihood);
        let baselines = baselines.map(|&estimator| Self::Baseline(estimator));
        [Self::Production].into_iter().chain(baselines).collect()
    }

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Production => Estimator::MaximumLikelihood.name(),
            Self::Baseline(estimator) => estimator.name(),
        }
    }

    /// The estimated resonance; `None` for a refusal.
    pub(super) fn estimate(self, measured: &Measured) -> Option<EstimatedResonance> {
        match self {
            Self::Production => {
                let found = measured.verdict.accepted()?;
                let sigma_hz = Some(found.sigma_hz);
                Some(EstimatedResonance { resonance_hz: found.resonance_hz, sigma_hz })
            }
            Self::Baseline(estimator) => {
                let resonance_hz = estimator.estimate(&measured.readings, WINDOW).ok()?;
                Some(EstimatedResonance { resonance_hz, sigma_hz: None })
            }
        }
    }
}
