//! The sweep in progress. The journal holds a sweep once it is finished.

use rig_engine::SweepPurpose;
use rig_model::{Reading, SweepRequest};
use rig_resonance::{Circuit, Estimate};

/// A sweep as far as it has come.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveSweep {
    /// Counts the sweeps since the rig was opened, from 1.
    pub serial: u64,
    /// Purpose of the sweep.
    pub purpose: SweepPurpose,
    /// Window, method and target of the sweep.
    pub request: SweepRequest,
    /// The readings so far, in the order taken.
    pub readings: Vec<Reading>,
    /// The estimates of the resonance, oldest first.
    pub estimates: Vec<LiveEstimate>,
    /// The circuit that explains the readings so far.
    pub circuit: Option<Circuit>,
}

/// An estimate of a resonance after some of its readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LiveEstimate {
    /// After how many readings.
    pub readings: usize,
    /// The resonance, Hz.
    pub resonance_hz: f64,
    /// Its standard deviation, Hz.
    pub sigma_hz: f64,
}

impl LiveSweep {
    pub(super) fn begin(serial: u64, purpose: SweepPurpose, request: SweepRequest) -> Self {
        let (readings, estimates, circuit) = (Vec::new(), Vec::new(), None);
        Self { serial, purpose, request, readings, estimates, circuit }
    }

    pub(super) fn add(&mut self, readings: &[Reading], estimate: Option<&Estimate>) {
        self.readings.extend_from_slice(readings);
        if let Some(&Estimate { circuit, sigma_hz }) = estimate {
            let (readings, resonance_hz) = (self.readings.len(), circuit.resonance_hz);
            self.estimates.push(LiveEstimate { readings, resonance_hz, sigma_hz });
            self.circuit = Some(circuit);
        }
    }
}
