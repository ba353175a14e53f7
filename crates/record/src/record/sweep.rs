//! Impedance sweeps and what was fitted to them.

use serde::{Deserialize, Serialize};

use super::Pose;

/// What a sweep was for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SweepPurpose {
    /// The reference with the probe clear.
    NoLoad,
    /// In contact.
    Touch,
    /// Asked for by itself.
    Manual,
}

impl SweepPurpose {
    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoLoad => "no_load",
            Self::Touch => "touch",
            Self::Manual => "manual",
        }
    }
}

/// What the instrument said against a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReadingFlag {
    /// Nothing.
    #[default]
    Normal,
    /// The input was overloaded: there is no value.
    Overload,
    /// The signal was too small for the range, or not at the level asked for.
    LowSignal,
}

impl ReadingFlag {
    /// The word in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal",
            Self::Overload => "overload",
            Self::LowSignal => "low_signal",
        }
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
    fn is_normal(&self) -> bool {
        *self == Self::Normal
    }
}

/// One impedance reading.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ReadingRecord {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Real part of the impedance, ohm; none where there was no value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resistance_ohm: Option<f64>,
    /// Imaginary part of the impedance, ohm; likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reactance_ohm: Option<f64>,
    /// When the frequency was set, on the rig's clock, s.
    pub started_s: f64,
    /// Settling before the integration, s.
    pub settle_s: f64,
    /// Integration, s.
    pub integration_s: f64,
    /// What the instrument said against it.
    #[serde(default, skip_serializing_if = "ReadingFlag::is_normal")]
    pub flag: ReadingFlag,
}

impl ReadingRecord {
    /// Real and imaginary part of the impedance, ohm, where there is a value.
    pub fn impedance_ohm(&self) -> Option<(f64, f64)> {
        self.resistance_ohm.zip(self.reactance_ohm)
    }

    /// Whether the instrument stands by it.
    pub fn is_normal(&self) -> bool {
        self.flag == ReadingFlag::Normal
    }
}

/// The equivalent circuit that was fitted.
///
/// Its admittance at ω = 2πf is `jωC₀ [(1 − j tan δ) + m / (1 − u² + j u/Q)]` with u = f/fᵣ.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Circuit {
    /// Q of the motional branch.
    pub quality_factor: f64,
    /// C₀, F.
    pub static_capacitance_f: f64,
    /// m, the motional capacitance in units of C₀.
    pub capacitance_ratio: f64,
    /// tan δ of C₀, never below 0.
    pub loss_tangent: f64,
    /// Its standard deviation, if it was fitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loss_tangent_sigma: Option<f64>,
}

/// The outcome of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "status", rename_all = "snake_case")]
pub enum SweepOutcome {
    /// A resonance was found.
    Accepted {
        /// Series resonance, Hz.
        resonance_hz: f64,
        /// Its standard deviation, Hz.
        sigma_hz: f64,
        /// The time for which it holds, s since the rig was opened.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        effective_time_s: Option<f64>,
        /// The circuit, when one was fitted.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        circuit: Option<Circuit>,
    },
    /// None that can be trusted.
    Refused {
        /// Why.
        reason: String,
    },
}

/// What is known of the times of readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FitTiming {
    /// Nothing.
    Unknown,
    /// How long each point was waited for and integrated.
    Waited,
    /// Everything; the drive went on from point to point.
    Exact,
    /// The same, and the sensor was at rest before.
    ExactFromRest,
}

impl FitTiming {
    /// The word in exports, which `rigd fit --timing` takes too.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Waited => "waited",
            Self::Exact => "exact",
            Self::ExactFromRest => "exact-from-rest",
        }
    }
}

/// What the fit of a sweep was told besides its readings. Told the same, it says the same again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FitSettings {
    /// Where the resonance was sought, Hz.
    pub window_hz: [f64; 2],
    /// What was known of the noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<FitNoise>,
    /// What was known of the times.
    pub timing: FitTiming,
    /// Whether dielectric loss was a free parameter whatever the readings asked for.
    pub always_loss: bool,
    /// The standard deviation without which no resonance was accepted, Hz.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_sigma_hz: Option<f64>,
    /// The circuit for which readings that had not settled were weighed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub near: Option<NearCircuit>,
}

/// The circuit that was believed in before the last fit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NearCircuit {
    /// Its series resonance, Hz.
    pub resonance_hz: f64,
    /// The rest of it.
    pub circuit: Circuit,
}

/// Noise known from earlier readings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FitNoise {
    /// Standard deviation of the relative error of a reading of ten cycles.
    pub at_ten_cycles: f64,
    /// How many independent errors this came from.
    pub degrees_of_freedom: f64,
}

/// A sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sweep {
    /// Its number in the run, from 1.
    pub number: u64,
    /// What it was for.
    pub purpose: SweepPurpose,
    /// The step in which it was taken, in a run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<String>,
    /// How the surface stood, where that is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<Pose>,
    /// Every reading, in the order in which it was taken.
    pub readings: Vec<ReadingRecord>,
    /// Number of readings at the beginning that only located the resonance. The outcome rests on
    /// the others.
    pub probe_readings: usize,
    /// The settings of the fit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit: Option<FitSettings>,
    /// What was fitted to them.
    pub outcome: SweepOutcome,
}
