//! What a run is expected to know of the drift of its free resonance.

/// Walk of the free resonance after an hour that a run on a good bench states, Hz: with its first references, and
/// when it has learnt from more of them. On the shipped bench it is 0.2 in the end.
const FIRST_WALK_HZ: f64 = 1.2;
const LEARNT_WALK_HZ: f64 = 0.3;

/// A run knows little of its drift before it has more references than this.
const FIRST_REFERENCES: u32 = 2;

const HOUR_S: f64 = 3600.0;

/// The drift that a run states, step by step.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ExpectedDrift {
    /// References so far, and the time since the last one, s.
    references: u32,
    since_s: f64,
}

impl ExpectedDrift {
    /// A reference has been measured.
    pub(crate) const fn measured(&mut self) {
        (self.references, self.since_s) = (self.references + 1, 0.0);
    }

    /// Time passes.
    pub(crate) const fn passed(&mut self, seconds: f64) {
        self.since_s += seconds;
    }

    /// Variance of the drift since the last reference at this time from now on, Hz².
    pub(crate) fn variance_hz2(&self, seconds: f64) -> f64 {
        let is_first = self.references <= FIRST_REFERENCES;
        let walk_hz = if is_first { FIRST_WALK_HZ } else { LEARNT_WALK_HZ };
        walk_hz * walk_hz * (self.since_s + seconds) / HOUR_S
    }
}
