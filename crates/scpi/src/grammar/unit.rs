//! Units of program data and their multipliers.

/// A unit that a parameter may carry as a suffix.
///
/// A controller may write the unit alone or with a multiplier in front (`200`, `0.2KHZ`). A third
/// party may define its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// The unit in upper case, such as `HZ`; empty when no suffix is allowed.
    pub symbol: &'static str,
    /// `M` means mega instead of milli. So it is for hertz and ohm.
    pub m_is_mega: bool,
    /// Other suffixes that mean the same quantity, with their factors: `("MIN", 60.0)` for seconds.
    pub also: &'static [(&'static str, f64)],
}

impl Unit {
    /// No suffix is allowed.
    pub const NONE: Self = Self::new("");
    /// Hertz; `MHZ` is a megahertz.
    pub const HERTZ: Self = Self { m_is_mega: true, ..Self::new("HZ") };
    /// Volt.
    pub const VOLT: Self = Self::new("V");
    /// Ampere.
    pub const AMPERE: Self = Self::new("A");
    /// Ohm; `MOHM` is a megohm.
    pub const OHM: Self = Self { m_is_mega: true, ..Self::new("OHM") };
    /// Second.
    pub const SECOND: Self = Self { also: &[("MIN", 60.0), ("HR", 3600.0)], ..Self::new("S") };

    /// A unit that takes the usual multipliers.
    pub const fn new(symbol: &'static str) -> Self {
        Self { symbol, m_is_mega: false, also: &[] }
    }

    /// `value` times the multiplier of `suffix`, in this unit. `None` when the suffix is not one of
    /// this unit.
    pub(crate) fn apply(&self, value: f64, suffix: &str) -> Option<f64> {
        if self.symbol.is_empty() {
            return None;
        }
        let suffix = suffix.to_ascii_uppercase();
        if let Some((_, factor)) = self.also.iter().find(|(symbol, _)| *symbol == suffix) {
            return Some(value * factor);
        }
        match suffix.strip_suffix(self.symbol)? {
            "" => Some(value),
            "M" if self.m_is_mega => Some(shift(value, 6)),
            multiplier => {
                let (_, exponent) = MULTIPLIERS.iter().find(|(name, _)| *name == multiplier)?;
                Some(shift(value, *exponent))
            }
        }
    }
}

/// IEEE 488.2, table 7-2.
const MULTIPLIERS: [(&str, i32); 12] = [
    ("EX", 18),
    ("PE", 15),
    ("T", 12),
    ("G", 9),
    ("MA", 6),
    ("K", 3),
    ("M", -3),
    ("U", -6),
    ("N", -9),
    ("P", -12),
    ("F", -15),
    ("A", -18),
];

/// `value`·10^`exponent`, rounded once: `1.1MHZ` is the number that `1.1E6` is.
fn shift(value: f64, exponent: i32) -> f64 {
    let shortest = format!("{value:e}");
    let (mantissa, old) = shortest.split_once('e').unwrap_or((&shortest, "0"));
    let old: i32 = old.parse().unwrap_or(0);
    format!("{mantissa}e{}", old + exponent).parse().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_multiplier_shifts_the_decimal_point_and_m_is_mega_for_hertz_and_ohm() {
        let rows = [
            (Unit::HERTZ, 200.0, "HZ", Some(200.0)),
            (Unit::HERTZ, 0.2, "kHz", Some(200.0)),
            (Unit::HERTZ, 1.1, "MHZ", Some(1.1e6)),
            (Unit::HERTZ, 1.1, "MAHZ", Some(1.1e6)),
            (Unit::OHM, 4.7, "MOHM", Some(4.7e6)),
            (Unit::VOLT, 5.0, "MV", Some(5e-3)),
            (Unit::VOLT, 5.0, "MAV", Some(5e6)),
            (Unit::VOLT, 3.3, "UV", Some(3.3e-6)),
            (Unit::AMPERE, 7.0, "MA", Some(7e-3)),
            (Unit::AMPERE, 7.0, "A", Some(7.0)),
            (Unit::new("F"), 1.0, "PF", Some(1e-12)),
            (Unit::new("F"), 1.0, "F", Some(1.0)),
            (Unit::SECOND, 2.0, "MIN", Some(120.0)),
            (Unit::VOLT, 1.0, "HZ", None),
            (Unit::VOLT, 1.0, "XV", None),
            (Unit::NONE, 1.0, "V", None),
        ];
        for (unit, value, suffix, expected) in rows {
            assert_eq!(unit.apply(value, suffix), expected, "{value}{suffix}");
        }
    }
}
