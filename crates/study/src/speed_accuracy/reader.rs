//! Who reads a sweep.

use rig_resonance::Estimator;

use super::way::{Measured, Way};
use crate::analyzer::WINDOW;

/// What turns readings into a resonance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reader {
    /// The fit of the daemon, told what is known of the times.
    Production,
    /// One that is in use elsewhere.
    Baseline(Estimator),
}

impl Reader {
    /// The baselines that charts show besides; tables have them all.
    pub(super) const SHOWN: [Self; 2] = [
        Self::Baseline(Estimator::ConductanceParabola),
        Self::Baseline(Estimator::ConductanceLorentzian),
    ];

    /// The readers that can read sweeps of this way: baselines want settled readings on an even
    /// grid.
    pub(super) fn of(way: Way) -> Vec<Self> {
        let baselines: &[Estimator] = match way {
            Way::Even { .. } => &Estimator::ALL,
            Way::Steady { .. } | Way::Fast { .. } | Way::Settled { .. } | Way::Transient { .. } => {
                &[]
            }
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

    /// The resonance and, where the reader claims one, its standard deviation; both in Hz.
    pub(super) fn read(self, measured: &Measured) -> Option<(f64, Option<f64>)> {
        match self {
            Self::Production => {
                let found = measured.verdict.accepted()?;
                Some((found.resonance_hz, Some(found.sigma_hz)))
            }
            Self::Baseline(estimator) => {
                let found_hz = estimator.estimate(&measured.readings, WINDOW).ok()?;
                Some((found_hz, None))
            }
        }
    }
}
