//! The resonance of the sensor without a sample: how good it is, and how far it has drifted.

/// An accepted resonance without a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reference {
    pub(super) resonance_hz: f64,
    pub(super) sigma_hz: f64,
    /// `None` if no circuit was fitted.
    pub(super) quality_factor: Option<f64>,
}

/// The first and the last resonance without a sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct NoLoad {
    first_hz: f64,
    last: Reference,
}

impl NoLoad {
    pub(super) const fn first(found: Reference) -> Self {
        Self { first_hz: found.resonance_hz, last: found }
    }

    pub(super) const fn add(&mut self, found: Reference) {
        self.last = found;
    }

    pub(super) const fn last(&self) -> Reference {
        self.last
    }

    /// How far the last one is above the first one, Hz.
    pub(super) fn drift_hz(&self) -> f64 {
        self.last.resonance_hz - self.first_hz
    }
}
