//! Impedance sweeps and their outcomes.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Pose;

/// The purpose of a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SweepPurpose {
    /// The reference with the probe clear.
    NoLoad,
    /// In contact.
    Touch,
    /// A single sweep of a person or a program.
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

/// The flag of a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReadingFlag {
    /// No flag.
    #[default]
    Normal,
    /// The input was overloaded: there is no value.
    Overload,
    /// The signal was too small for the range, or not at the requested level.
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
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ReadingRecord {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Real part of the impedance, ohm; `None` without a value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resistance_ohm: Option<f64>,
    /// Imaginary part of the impedance, ohm; `None` without a value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reactance_ohm: Option<f64>,
    /// When the frequency was set, on the rig's clock, s.
    pub started_s: f64,
    /// Settling before the integration, s.
    pub settle_s: f64,
    /// Integration, s.
    pub integration_s: f64,
    /// Flag of the instrument.
    #[serde(default, skip_serializing_if = "ReadingFlag::is_normal")]
    pub flag: ReadingFlag,
}

impl ReadingRecord {
    /// Real and imaginary part of the impedance, ohm; `None` without a value.
    pub fn impedance_ohm(&self) -> Option<(f64, f64)> {
        self.resistance_ohm.zip(self.reactance_ohm)
    }

    /// Whether the reading has no flag.
    pub fn is_normal(&self) -> bool {
        self.flag == ReadingFlag::Normal
    }
}

/// The equivalent circuit that was fitted.
///
/// Its admittance at ω = 2πf is `jωC₀ [(1 − j tan δ) + m / (1 − u² + j u/Q)]` with u = f/fᵣ.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
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
    /// Standard deviation of `quality_factor`, in journals that have it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quality_factor_sigma: Option<f64>,
    /// Standard deviation of `static_capacitance_f`, F, in journals that have it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub static_capacitance_sigma_f: Option<f64>,
    /// Standard deviation of `capacitance_ratio`, in journals that have it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capacitance_ratio_sigma: Option<f64>,
}

/// What readings showed beside the circuit; it was fitted together with it. Settled ones on a given grid can show any of
/// these but the second, those with a free decay the first two.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Extra {
    /// The resonance changed evenly with time.
    Drift {
        /// Its relative change from the middle of the sweep to the last reading.
        change: f64,
    },
    /// The resonance approached a final value exponentially, as a tissue relaxes. It is stated for its effective time.
    Relaxation {
        /// Its relative change from the begin of the first reading to the end of the last.
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
    /// A second resonance, in parallel.
    SecondMode {
        /// Its series resonance, Hz.
        resonance_hz: f64,
        /// Its quality factor.
        quality_factor: f64,
        /// Its motional capacitance, F.
        capacitance_f: f64,
    },
    /// The static capacitance changes with the frequency; C₀ is that at the resonance.
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

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
const fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// The outcome of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
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
        /// What was fitted together with the circuit.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        extra: Option<Extra>,
        /// Number of readings that were left out because they are far from the rest.
        #[serde(default, skip_serializing_if = "is_zero")]
        left_out: usize,
    },
    /// No trusted resonance.
    Refused {
        /// Why there is no trusted resonance, as a sentence.
        reason: String,
    },
}

/// The known timing of readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FitTiming {
    /// Nothing is known about settling.
    Unknown,
    /// Settling and integration of each point.
    Waited,
    /// All times; the drive continued from point to point.
    Exact,
    /// All times, and the sensor was at rest before.
    ExactFromRest,
    /// To a millisecond; the phase of the drive at each change of frequency is not known.
    AnyPhase,
}

impl FitTiming {
    /// The word in exports, which `rigd fit --timing` takes too.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Waited => "waited",
            Self::Exact => "exact",
            Self::ExactFromRest => "exact-from-rest",
            Self::AnyPhase => "any-phase",
        }
    }
}

/// The settings of the fit of a sweep. With the same settings and readings, the fit has the same
/// result.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FitSettings {
    /// Window of the resonance, Hz.
    pub window_hz: [f64; 2],
    /// Noise known from earlier readings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<FitNoise>,
    /// Known timing of the readings.
    pub timing: FitTiming,
    /// Whether dielectric loss was always a free parameter.
    pub always_loss: bool,
    /// Largest standard deviation of an accepted resonance, Hz.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_sigma_hz: Option<f64>,
    /// Circuit by which unsettled readings were weighted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub near: Option<NearCircuit>,
    /// What a survey found on the bench.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bench: Option<BenchSettings>,
}

/// What stays the same on a bench from sweep to sweep.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BenchSettings {
    /// Phase error of the analyzer, rad; it is subtracted from each impedance.
    pub phase_rad: f64,
    /// Its standard deviation, rad.
    pub phase_sigma_rad: f64,
    /// By how much the time from the begin of the first reading of a stay to that of the second is longer
    /// than recorded, s; it varies by as much.
    #[serde(default)]
    pub first_gap_s: f64,
    /// Change of the static capacitance for each factor e of the frequency, F, from the middle of the surveyed
    /// frequencies on; its admittance is subtracted from that of each reading.
    #[serde(default)]
    pub dispersion_f: f64,
    /// Its standard deviation, F.
    #[serde(default)]
    pub dispersion_sigma_f: f64,
    /// Standard deviation of the capacitance of a possible second mode, relative to that of the first.
    pub mode_sigma: f64,
    /// The frequencies at which a second mode would have been noticed, Hz.
    pub surveyed_hz: [f64; 2],
}

/// The estimated circuit before the last fit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NearCircuit {
    /// Its series resonance, Hz.
    pub resonance_hz: f64,
    /// The other parameters.
    pub circuit: Circuit,
}

/// Noise known from earlier readings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FitNoise {
    /// Standard deviation of the relative error of a reading of ten cycles.
    pub at_ten_cycles: f64,
    /// Number of independent errors behind the estimate.
    pub degrees_of_freedom: f64,
}

/// A sweep with its readings and its outcome.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Sweep {
    /// Its number in the run, from 1.
    pub number: u64,
    /// Purpose of the sweep.
    pub purpose: SweepPurpose,
    /// The step in which it was taken, in a run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<String>,
    /// Pose of the surface, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<Pose>,
    /// Level of the drive, as the analyzer was programmed (open circuit), V, in journals that have it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub level_v: Option<f64>,
    /// Every reading, in the order in which it was taken.
    pub readings: Vec<ReadingRecord>,
    /// Number of readings at the beginning that only located the resonance. The outcome rests on
    /// the others.
    pub probe_readings: usize,
    /// The settings of the fit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit: Option<FitSettings>,
    /// Outcome of the sweep.
    pub outcome: SweepOutcome,
}
