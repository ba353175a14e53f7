//! The quantities of columns, with the names and units of people and instruments.

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
}

/// Names of the quantities, in the form of [`plain`].
const NAMES: [(Quantity, &[&str]); 30] = [
    (Quantity::Frequency, &["frequency", "freq", "f"]),
    (
        Quantity::Resistance,
        &["resistance", "r", "rs", "re(z)", "rez", "real(z)", "zreal", "realz", "zre", "z'"],
    ),
    (
        Quantity::Reactance,
        &[
            "reactance",
            "x",
            "xs",
            "im(z)",
            "imz",
            "imag(z)",
            "zimag",
            "imagz",
            "zim",
            "zimg",
            "z''",
        ],
    ),
    (
        Quantity::Magnitude,
        &[
            "impedancemagnitude",
            "impedance",
            "|z|",
            "z",
            "zmag",
            "mag(z)",
            "abs(z)",
            "zabs",
            "zmod",
        ],
    ),
    (
        Quantity::Phase,
        &[
            "phase", "theta", "th", "thetaz", "θ", "θz", "φ", "ϕ", "phi", "phasez", "zphase",
            "phase(z)", "arg(z)",
        ],
    ),
    (Quantity::Conductance, &["conductance", "g", "re(y)", "yre", "yreal"]),
    (Quantity::Susceptance, &["susceptance", "b", "im(y)", "yim", "yimag"]),
    (Quantity::ReflectionReal, &["s11(real)", "s11(re)", "s11real", "s11re", "re(s11)"]),
    (Quantity::ReflectionImaginary, &["s11(imag)", "s11(im)", "s11imag", "s11im", "im(s11)"]),
    (Quantity::ReflectionMagnitude, &["s11(mag)", "s11(lin)", "s11mag", "s11linmag", "|s11|"]),
    (Quantity::ReflectionDecibel, &["s11logmag"]),
    (Quantity::ReflectionPhase, &["s11phase", "s11ang", "phase(s11)"]),
    (Quantity::Time, &["time", "started", "t"]),
    (Quantity::Settle, &["settle", "settling"]),
    (Quantity::Integration, &["integration", "integrationtime"]),
    (Quantity::Flag, &["flag"]),
    (Quantity::IsUsed, &["isused"]),
    (Quantity::Sweep, &["sweep"]),
    (Quantity::FitMin, &["fitmin"]),
    (Quantity::FitMax, &["fitmax"]),
    (Quantity::FitNoise, &["fitnoiseattencycles"]),
    (Quantity::FitNoiseDegrees, &["fitnoisedegreesoffreedom"]),
    (Quantity::FitTiming, &["fittiming"]),
    (Quantity::FitLoss, &["fitalwaysloss"]),
    (Quantity::FitTarget, &["fittargetsigma"]),
    (Quantity::NearResonance, &["fitnearresonance"]),
    (Quantity::NearQuality, &["fitnearqualityfactor"]),
    (Quantity::NearCapacitance, &["fitnearstaticcapacitance"]),
    (Quantity::NearRatio, &["fitnearcapacitanceratio"]),
    (Quantity::NearLoss, &["fitnearlosstangent"]),
];

/// Units with their factors to the unit without a prefix.
const HERTZ: [(&str, f64); 4] = [("hz", 1.0), ("khz", 1e3), ("mhz", 1e6), ("ghz", 1e9)];
const SECOND: [(&str, f64); 5] =
    [("s", 1.0), ("sec", 1.0), ("ms", 1e-3), ("us", 1e-6), ("µs", 1e-6)];
const ANGLE: [(&str, f64); 5] = [
    ("deg", 1.0),
    ("°", 1.0),
    ("degrees", 1.0),
    ("rad", 180.0 / std::f64::consts::PI),
    ("radians", 180.0 / std::f64::consts::PI),
];

impl Quantity {
    /// Number of quantities.
    pub(super) const COUNT: usize = Self::NearLoss as usize + 1;

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
        )
    }

    /// Its range, in the unit of its key.
    pub(super) const fn range(self) -> RangeInclusive<f64> {
        match self {
            Self::Frequency
            | Self::FitMin
            | Self::FitMax
            | Self::FitTarget
            | Self::NearResonance => FREQUENCY_HZ,
            // A reading whose noise exceeds its value is useless.
            Self::FitNoise => 1e-12..=1.0,
            Self::FitNoiseDegrees => 0.1..=1e9,
            Self::NearQuality => 1e-3..=1e12,
            Self::NearCapacitance => 1e-18..=1.0,
            Self::NearRatio => 1e-12..=1e6,
            Self::NearLoss => -1e3..=1e3,
            Self::Magnitude => 0.0..=*IMPEDANCE_OHM.end(),
            Self::Phase | Self::ReflectionPhase => -3600.0..=3600.0,
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

    const fn is_time(self) -> bool {
        matches!(self, Self::Time | Self::Settle | Self::Integration)
    }

    /// The factor from this unit to the unit of the key.
    fn factor(self, unit: &str) -> Option<f64> {
        let lower = unit.trim_end_matches('.').to_lowercase();
        let among = |units: &[(&str, f64)]| {
            units.iter().find(|(name, _)| *name == lower).map(|(_, factor)| *factor)
        };
        match self {
            // Only this spelling surely means a thousandth.
            Self::Frequency if unit == "mHz" => Some(1e-3),
            Self::Frequency => among(&HERTZ),
            Self::FitMin | Self::FitMax | Self::FitTarget | Self::NearResonance => {
                (lower == "hz").then_some(1.0)
            }
            Self::NearCapacitance => (lower == "f").then_some(1.0),
            Self::Resistance | Self::Reactance | Self::Magnitude => {
                prefixed(unit, &["ohm", "ohms", "ω"])
            }
            Self::Conductance | Self::Susceptance => prefixed(unit, &["s", "siemens"]),
            Self::Phase | Self::ReflectionPhase => among(&ANGLE),
            Self::ReflectionDecibel => (lower == "db").then_some(1.0),
            Self::Time | Self::Settle | Self::Integration => among(&SECOND),
            Self::ReflectionReal
            | Self::ReflectionImaginary
            | Self::ReflectionMagnitude
            | Self::Flag
            | Self::IsUsed
            | Self::Sweep
            | Self::FitNoise
            | Self::FitNoiseDegrees
            | Self::FitTiming
            | Self::FitLoss
            | Self::NearQuality
            | Self::NearRatio
            | Self::NearLoss => None,
        }
    }
}

/// The factor of a unit with one of these names, with or without a prefix.
fn prefixed(unit: &str, names: &[&str]) -> Option<f64> {
    let is_name = |text: &str| names.contains(&text.to_lowercase().as_str());
    if is_name(unit) {
        return Some(1.0);
    }
    let mut rest = unit.chars();
    let factor = match rest.next()? {
        'M' => 1e6,
        'k' | 'K' => 1e3,
        'm' => 1e-3,
        'u' | 'µ' | 'μ' => 1e-6,
        'n' => 1e-9,
        _ => return None,
    };
    is_name(rest.as_str()).then_some(factor)
}

/// The name and the unit at the head of a column.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ColumnHead {
    pub(super) quantity: Quantity,
    /// Factor to the unit of the key; `None` for a unit of another quantity.
    pub(super) factor: Option<f64>,
    /// The unit in the file.
    pub(super) unit: Option<String>,
}

impl ColumnHead {
    /// The head in this cell, if it names a known quantity.
    pub(super) fn of(cell: &str) -> Option<Self> {
        let cell = cell.trim();
        // `Trace |Z| (Ohm)` of Digilent, `theta-z(deg)-data` of Keysight.
        let cell = cell.strip_prefix("Trace ").unwrap_or(cell);
        let cell = cell.strip_suffix("-data").unwrap_or(cell);
        if let Some((quantity, sign)) = named(cell).filter(|(quantity, _)| !quantity.is_time()) {
            return Some(Self { quantity, factor: Some(sign), unit: None });
        }
        let (name, unit) = name_and_unit(cell)?;
        let (quantity, sign) = match name {
            // Some files name only the unit.
            "" if Quantity::Frequency.factor(unit).is_some() => (Quantity::Frequency, 1.0),
            "" if Quantity::Phase.factor(unit).is_some() => (Quantity::Phase, 1.0),
            // The unit of a reflection names its part.
            "S11" | "s11" if Quantity::ReflectionDecibel.factor(unit).is_some() => {
                (Quantity::ReflectionDecibel, 1.0)
            }
            "S11" | "s11" => (Quantity::ReflectionPhase, 1.0),
            name => named(name)?,
        };
        let factor = quantity.factor(unit).map(|factor| sign * factor);
        // `Phase margin` is another quantity, and a time without a unit is a date.
        let is_marked = cell.ends_with([')', ']']) || cell.contains('/');
        let is_meant = factor.is_some() || (is_marked && !quantity.is_time());
        is_meant.then(|| Self { quantity, factor, unit: Some(unit.to_owned()) })
    }
}

/// `Freq. (kHz)`, `|Z| [Ohm]`, `Z' / Ω`, `phase_deg`, `Freq Hz`, `Hz`.
fn name_and_unit(cell: &str) -> Option<(&str, &str)> {
    let (name, unit) = match cell.strip_suffix([')', ']']) {
        Some(open) => open.rsplit_once(['(', '['])?,
        None => cell.rsplit_once(['/', '_', ' ']).unwrap_or(("", cell)),
    };
    Some((name.trim().trim_end_matches('/'), unit.trim()))
}

/// The quantity of this name, with −1 for a minus before the name and 1 otherwise.
fn named(name: &str) -> Option<(Quantity, f64)> {
    let plain = plain(name);
    let find = |name: &str| {
        let found = NAMES.iter().find(|(_, names)| names.contains(&name));
        found.map(|(quantity, _)| *quantity)
    };
    if let Some(quantity) = find(&plain) {
        return Some((quantity, 1.0));
    }
    // Diagrams of capacitors often show the negative reactance or phase, and are exported so.
    let is_turned = |quantity: &Quantity| matches!(quantity, Quantity::Reactance | Quantity::Phase);
    plain.strip_prefix('-').and_then(find).filter(is_turned).map(|quantity| (quantity, -1.0))
}

/// A name in lower case, without blanks and punctuation.
fn plain(name: &str) -> String {
    let mut plain = String::new();
    for character in name.trim().chars().flat_map(char::to_lowercase) {
        match character {
            ' ' | '_' | '.' | ':' => {}
            '−' | '-' if plain.is_empty() => plain.push('-'),
            '−' | '-' => {}
            '′' | '’' => plain.push('\''),
            '″' | '"' => plain.push_str("''"),
            other => plain.push(other),
        }
    }
    plain
}
