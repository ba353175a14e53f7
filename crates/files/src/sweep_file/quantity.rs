//! The quantities of columns.

use std::ops::RangeInclusive;

use super::{FREQUENCY_HZ, IMPEDANCE_OHM};

/// The quantity of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Quantity {
    Frequency,
    Resistance,
    Reactance,
    Magnitude,
    Phase,
    Conductance,
    Susceptance,
    SeriesCapacitance,
    ParallelCapacitance,
    SeriesInductance,
    ParallelInductance,
    ParallelResistance,
    Dissipation,
    Quality,
    AdmittanceMagnitude,
    AdmittancePhase,
    ReflectionReal,
    ReflectionImaginary,
    ReflectionMagnitude,
    ReflectionDecibel,
    ReflectionPhase,
    Time,
    Settle,
    Integration,
    Flag,
    IsUsed,
    Sweep,
    FitMin,
    FitMax,
    FitNoise,
    FitNoiseDegrees,
    FitTiming,
    FitLoss,
    FitTarget,
    NearResonance,
    NearQuality,
    NearCapacitance,
    NearRatio,
    NearLoss,
    BenchPhase,
    BenchPhaseSigma,
    BenchFirstGap,
    BenchDispersion,
    BenchDispersionSigma,
    BenchMode,
    BenchMin,
    BenchMax,
}

impl Quantity {
    /// Number of quantities.
    pub(super) const COUNT: usize = Self::BenchMax as usize + 1;

    /// Whether it is an angle, which needs a unit.
    pub(super) const fn is_phase(self) -> bool {
        matches!(self, Self::Phase | Self::AdmittancePhase | Self::ReflectionPhase)
    }

    /// Whether it is one of the two quantities of an impedance.
    pub(super) const fn is_impedance(self) -> bool {
        matches!(
            self,
            Self::Resistance
                | Self::Reactance
                | Self::Magnitude
                | Self::Phase
                | Self::Conductance
                | Self::Susceptance
                | Self::SeriesCapacitance
                | Self::ParallelCapacitance
                | Self::SeriesInductance
                | Self::ParallelInductance
                | Self::ParallelResistance
                | Self::Dissipation
                | Self::Quality
                | Self::AdmittanceMagnitude
                | Self::AdmittancePhase
                | Self::ReflectionReal
                | Self::ReflectionImaginary
                | Self::ReflectionMagnitude
                | Self::ReflectionDecibel
                | Self::ReflectionPhase
        )
    }

    /// Its name in a message.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Frequency => "frequency",
            Self::Resistance => "resistance",
            Self::Reactance => "reactance",
            Self::Magnitude => "magnitude of the impedance",
            Self::Phase => "phase",
            Self::Conductance => "conductance",
            Self::Susceptance => "susceptance",
            Self::SeriesCapacitance => "series capacitance",
            Self::ParallelCapacitance => "parallel capacitance",
            Self::SeriesInductance => "series inductance",
            Self::ParallelInductance => "parallel inductance",
            Self::ParallelResistance => "parallel resistance",
            Self::Dissipation => "dissipation factor",
            Self::Quality => "quality factor",
            Self::AdmittanceMagnitude => "magnitude of the admittance",
            Self::AdmittancePhase => "phase of the admittance",
            Self::ReflectionReal => "real part of the reflection",
            Self::ReflectionImaginary => "imaginary part of the reflection",
            Self::ReflectionMagnitude | Self::ReflectionDecibel => "magnitude of the reflection",
            Self::ReflectionPhase => "phase of the reflection",
            Self::Time => "time",
            Self::Settle => "settling",
            Self::Integration => "integration time",
            Self::Flag => "flag",
            Self::IsUsed => "use",
            Self::Sweep => "sweep",
            Self::FitMin => "lower end of the window of the fit",
            Self::FitMax => "upper end of the window of the fit",
            Self::FitNoise => "noise for the fit",
            Self::FitNoiseDegrees => "degrees of freedom of the noise for the fit",
            Self::FitTiming => "timing for the fit",
            Self::FitLoss => "loss for the fit",
            Self::FitTarget => "standard deviation that the fit must reach",
            Self::NearResonance => "resonance for the weights of the fit",
            Self::NearQuality => "quality factor for the weights of the fit",
            Self::NearCapacitance => "static capacitance for the weights of the fit",
            Self::NearRatio => "ratio of capacitances for the weights of the fit",
            Self::NearLoss => "loss tangent for the weights of the fit",
            Self::BenchPhase => "phase error of the analyzer",
            Self::BenchPhaseSigma => "standard deviation of the phase error of the analyzer",
            Self::BenchFirstGap => "error of the first gap",
            Self::BenchDispersion => "dispersion of the dielectric",
            Self::BenchDispersionSigma => "standard deviation of the dispersion of the dielectric",
            Self::BenchMode => "standard deviation of a second mode",
            Self::BenchMin => "lower end of the surveyed frequencies",
            Self::BenchMax => "upper end of the surveyed frequencies",
        }
    }

    /// Its key, which the header of `rigd` has.
    pub(super) const fn key(self) -> &'static str {
        match self {
            Self::Frequency => "frequency_hz",
            Self::Resistance => "resistance_ohm",
            Self::Reactance => "reactance_ohm",
            Self::Magnitude => "impedance_magnitude_ohm",
            Self::Phase => "phase_deg",
            Self::Conductance => "conductance_s",
            Self::Susceptance => "susceptance_s",
            Self::SeriesCapacitance => "cs_f",
            Self::ParallelCapacitance => "cp_f",
            Self::SeriesInductance => "ls_h",
            Self::ParallelInductance => "lp_h",
            Self::ParallelResistance => "rp_ohm",
            Self::Dissipation => "d",
            Self::Quality => "q",
            Self::AdmittanceMagnitude => "admittance_magnitude_s",
            Self::AdmittancePhase => "admittance_phase_deg",
            Self::ReflectionReal => "s11_real",
            Self::ReflectionImaginary => "s11_imag",
            Self::ReflectionMagnitude => "s11_mag",
            Self::ReflectionDecibel => "s11_db",
            Self::ReflectionPhase => "s11_deg",
            Self::Time => "time_s",
            Self::Settle => "settle_s",
            Self::Integration => "integration_s",
            Self::Flag => "flag",
            Self::IsUsed => "is_used",
            Self::Sweep => "sweep",
            Self::FitMin => "fit_min_hz",
            Self::FitMax => "fit_max_hz",
            Self::FitNoise => "fit_noise_at_ten_cycles",
            Self::FitNoiseDegrees => "fit_noise_degrees_of_freedom",
            Self::FitTiming => "fit_timing",
            Self::FitLoss => "fit_always_loss",
            Self::FitTarget => "fit_target_sigma_hz",
            Self::NearResonance => "fit_near_resonance_hz",
            Self::NearQuality => "fit_near_quality_factor",
            Self::NearCapacitance => "fit_near_static_capacitance_f",
            Self::NearRatio => "fit_near_capacitance_ratio",
            Self::NearLoss => "fit_near_loss_tangent",
            Self::BenchPhase => "fit_bench_phase_rad",
            Self::BenchPhaseSigma => "fit_bench_phase_sigma_rad",
            Self::BenchFirstGap => "fit_bench_first_gap_s",
            Self::BenchDispersion => "fit_bench_dispersion_f",
            Self::BenchDispersionSigma => "fit_bench_dispersion_sigma_f",
            Self::BenchMode => "fit_bench_mode_sigma",
            Self::BenchMin => "fit_bench_min_hz",
            Self::BenchMax => "fit_bench_max_hz",
        }
    }

    /// Whether it is a setting of the fit. A row may leave it out.
    pub(super) const fn is_fit_setting(self) -> bool {
        matches!(
            self,
            Self::FitMin
                | Self::FitMax
                | Self::FitNoise
                | Self::FitNoiseDegrees
                | Self::FitTiming
                | Self::FitLoss
                | Self::FitTarget
                | Self::NearResonance
                | Self::NearQuality
                | Self::NearCapacitance
                | Self::NearRatio
                | Self::NearLoss
                | Self::BenchPhase
                | Self::BenchPhaseSigma
                | Self::BenchFirstGap
                | Self::BenchDispersion
                | Self::BenchDispersionSigma
                | Self::BenchMode
                | Self::BenchMin
                | Self::BenchMax
        )
    }

    /// Its range, in the unit of its key.
    pub(super) const fn range(self) -> RangeInclusive<f64> {
        match self {
            Self::Frequency
            | Self::FitMin
            | Self::FitMax
            | Self::FitTarget
            | Self::NearResonance
            | Self::BenchMin
            | Self::BenchMax => FREQUENCY_HZ,
            // A reading whose noise exceeds its value is useless.
            Self::FitNoise => 1e-12..=1.0,
            Self::FitNoiseDegrees => 0.1..=1e9,
            Self::NearQuality => 1e-3..=1e12,
            Self::NearCapacitance => 1e-18..=1.0,
            Self::NearRatio => 1e-12..=1e6,
            Self::NearLoss => -1e3..=1e3,
            Self::BenchPhase => -1.0..=1.0,
            Self::BenchPhaseSigma => 1e-12..=1.0,
            Self::BenchFirstGap => -1.0..=1.0,
            Self::BenchDispersion => -1.0..=1.0,
            Self::BenchDispersionSigma => 0.0..=1.0,
            Self::BenchMode => 1e-12..=1e6,
            Self::Magnitude | Self::AdmittanceMagnitude => 0.0..=*IMPEDANCE_OHM.end(),
            Self::Phase | Self::AdmittancePhase | Self::ReflectionPhase => -3600.0..=3600.0,
            Self::ReflectionReal | Self::ReflectionImaginary => -1e3..=1e3,
            Self::ReflectionMagnitude => 0.0..=1e3,
            Self::ReflectionDecibel => -1e3..=60.0,
            // A time may be in seconds since 1970.
            Self::Time => -1e10..=1e10,
            Self::Settle => 0.0..=1e5,
            Self::Integration => 1e-9..=1e5,
            _ => IMPEDANCE_OHM,
        }
    }
}
