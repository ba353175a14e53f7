//! The head of a column: a quantity with its unit, in the words of people and instruments.

use super::quantity::Quantity;

/// Names of the quantities, in the form of [`plain`].
const NAMES: [(Quantity, &[&str]); 47] = [
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
    (Quantity::SeriesCapacitance, &["cs", "seriescapacitance"]),
    (Quantity::ParallelCapacitance, &["cp", "parallelcapacitance"]),
    (Quantity::SeriesInductance, &["ls", "seriesinductance"]),
    (Quantity::ParallelInductance, &["lp", "parallelinductance"]),
    (Quantity::ParallelResistance, &["rp", "parallelresistance"]),
    (Quantity::Dissipation, &["d", "df", "dissipation", "dissipationfactor", "tand", "tanδ"]),
    (Quantity::Quality, &["q", "quality", "qualityfactor"]),
    (
        Quantity::AdmittanceMagnitude,
        &["admittancemagnitude", "admittance", "|y|", "y", "ymag", "mag(y)", "abs(y)"],
    ),
    (
        Quantity::AdmittancePhase,
        &["admittancephase", "thetay", "θy", "phasey", "yphase", "phase(y)", "arg(y)"],
    ),
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
    (Quantity::BenchPhase, &["fitbenchphase"]),
    (Quantity::BenchPhaseSigma, &["fitbenchphasesigma"]),
    (Quantity::BenchFirstGap, &["fitbenchfirstgap"]),
    (Quantity::BenchDispersion, &["fitbenchdispersion"]),
    (Quantity::BenchDispersionSigma, &["fitbenchdispersionsigma"]),
    (Quantity::BenchMode, &["fitbenchmodesigma"]),
    (Quantity::BenchMin, &["fitbenchmin"]),
    (Quantity::BenchMax, &["fitbenchmax"]),
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

/// Units of forces, lengths, voltages, currents, masses, pressures, powers and temperatures.
const OTHERS: [&str; 10] = ["n", "m", "v", "a", "g", "pa", "w", "k", "°c", "c"];

/// Marks around a unit.
const BRACKETS: [char; 5] = ['(', ')', '[', ']', ' '];

impl Quantity {
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
            // ZPlot marks the two parts so.
            Self::Resistance if unit == "a" => Some(1.0),
            Self::Reactance if unit == "b" => Some(1.0),
            Self::FitMin
            | Self::FitMax
            | Self::FitTarget
            | Self::NearResonance
            | Self::BenchMin
            | Self::BenchMax => (lower == "hz").then_some(1.0),
            Self::BenchPhase | Self::BenchPhaseSigma => (lower == "rad").then_some(1.0),
            Self::NearCapacitance | Self::BenchDispersion | Self::BenchDispersionSigma => {
                (lower == "f").then_some(1.0)
            }
            Self::Resistance | Self::Reactance | Self::Magnitude | Self::ParallelResistance => {
                prefixed(unit, &["ohm", "ohms", "ω"])
            }
            Self::Conductance | Self::Susceptance | Self::AdmittanceMagnitude => {
                prefixed(unit, &["s", "siemens"])
            }
            Self::SeriesCapacitance | Self::ParallelCapacitance => prefixed(unit, &["f", "farad"]),
            Self::SeriesInductance | Self::ParallelInductance => prefixed(unit, &["h", "henry"]),
            Self::Phase | Self::AdmittancePhase | Self::ReflectionPhase => among(&ANGLE),
            Self::ReflectionDecibel => (lower == "db").then_some(1.0),
            Self::Time | Self::Settle | Self::Integration | Self::BenchFirstGap => among(&SECOND),
            Self::Dissipation
            | Self::Quality
            | Self::ReflectionReal
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
            | Self::NearLoss
            | Self::BenchMode => None,
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
        'T' => 1e12,
        'G' => 1e9,
        'M' => 1e6,
        'k' | 'K' => 1e3,
        'm' => 1e-3,
        'u' | 'µ' | 'μ' => 1e-6,
        'n' => 1e-9,
        'p' => 1e-12,
        'f' => 1e-15,
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
        // `Trace 1 |Z| (Ohm)` of Digilent, with or without a number, `theta-z(deg)-data` of Keysight.
        let is_number = |character: char| character.is_ascii_digit() || character == ' ';
        let cell =
            cell.strip_prefix("Trace ").map_or(cell, |rest| rest.trim_start_matches(is_number));
        let cell = cell.strip_suffix("-data").unwrap_or(cell);
        if let Some(quantity) = part_of_trace(cell) {
            return Some(Self { quantity, factor: Some(1.0), unit: None });
        }
        if let Some((quantity, sign)) = named(cell).filter(|(quantity, _)| !quantity.is_time()) {
            return Some(Self { quantity, factor: Some(sign), unit: None });
        }
        let (name, unit) = name_and_unit(cell)?;
        // `D [ ]` and `Q (-)` say that there is no unit.
        if matches!(unit, "" | "-") && !name.is_empty() {
            let (quantity, sign) = named(name)?;
            return Some(Self { quantity, factor: Some(sign), unit: None });
        }
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
        // `F (N)` is a force, and `X (mm)` a place.
        let is_other = name.chars().count() == 1 && prefixed(unit, &OTHERS).is_some();
        let is_meant = factor.is_some() || (is_marked && !is_other && !quantity.is_time());
        is_meant.then(|| Self { quantity, factor, unit: Some(unit.to_owned()) })
    }
}

impl ColumnHead {
    /// Whether a cell has a unit of the quantity and nothing else, such as `kHz` or `[Ω]`.
    pub(super) fn is_unit(&self, cell: &str) -> bool {
        self.quantity.factor(cell.trim_matches(BRACKETS)).is_some()
    }

    /// Takes the unit from a cell of the row below the header. An empty cell changes nothing.
    pub(super) fn take_unit(&mut self, cell: &str) {
        let unit = cell.trim_matches(BRACKETS);
        if matches!(unit, "" | "-" | "--" | "1") {
            return;
        }
        let factor = self.quantity.factor(unit);
        self.factor = match (&self.unit, self.factor) {
            // The sign of a column such as `-Z''` stays.
            (None, Some(sign)) => factor.map(|factor| sign * factor),
            (Some(_), Some(named)) if factor == Some(named.abs()) => Some(named),
            _ => None,
        };
        self.unit = Some(unit.to_owned());
    }
}

/// The part of a reflection that `re:Trc1_S11` of Rohde & Schwarz names.
fn part_of_trace(cell: &str) -> Option<Quantity> {
    let (part, trace) = cell.split_once(':')?;
    let parameter = trace.rsplit_once('_').map_or(trace, |(_, parameter)| parameter);
    if !parameter.eq_ignore_ascii_case("S11") {
        return None;
    }
    match part.to_ascii_lowercase().as_str() {
        "re" => Some(Quantity::ReflectionReal),
        "im" => Some(Quantity::ReflectionImaginary),
        "mag" => Some(Quantity::ReflectionMagnitude),
        "db" => Some(Quantity::ReflectionDecibel),
        "ang" => Some(Quantity::ReflectionPhase),
        _ => None,
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
