//! Knowledge of a resonance before and during a sweep.

use rig_model::{Reading, Window};

use crate::{Bench, Circuit, NoisePrior, Resonance};

/// Largest degrees of freedom of the noise from earlier sweeps, because noise may change.
const NOISE_DEGREES_MAX: f64 = 1000.0;

/// The knowledge before the first reading of a sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// The last fitted circuit.
    pub circuit: Option<Circuit>,
    /// The static capacitance of the sensor and its standard deviation, F, if known: it is the same in contact.
    pub capacitance_farad: Option<(f64, f64)>,
    /// The possible range of its resonance.
    pub within: Window,
    /// The noise of the analyzer, if known.
    pub noise: Option<NoisePrior>,
    /// The knowledge of the bench, if it was surveyed.
    pub bench: Option<Bench>,
}

impl Prior {
    /// A prior of any resonance in this window on a known bench.
    pub const fn anywhere(within: Window, bench: Option<Bench>) -> Self {
        Self { circuit: None, capacitance_farad: None, within, noise: None, bench }
    }

    /// Creates a prior from the last resonance, which may have moved anywhere in `within`.
    pub fn moved(last: &Resonance, within: Window, bench: Option<Bench>) -> Self {
        let noise = NoisePrior {
            at_ten_cycles: last.noise_at_ten_cycles,
            degrees_of_freedom: last.noise_degrees_of_freedom.min(NOISE_DEGREES_MAX),
        };
        let prior = Self::anywhere(within, bench).of_sensor(last);
        Self { circuit: Some(last.circuit()), noise: Some(noise), ..prior }
    }

    /// The prior for the sensor that had this resonance.
    #[must_use]
    pub fn of_sensor(self, last: &Resonance) -> Self {
        Self { capacitance_farad: Some((last.c0_farad, last.c0_sigma_farad())), ..self }
    }
}

/// The estimate of a resonance during its measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The circuit that explains the readings so far.
    pub circuit: Circuit,
    /// The standard deviation of its resonance, Hz.
    pub sigma_hz: f64,
}

/// Time from the first setting of a frequency to the end of the last integration, s.
pub(crate) fn elapsed_s(readings: &[Reading]) -> f64 {
    let (Some(first), Some(last)) = (readings.first(), readings.last()) else { return 0.0 };
    last.started.since(first.started).as_secs_f64() + last.settle_s + last.integration_s
}
