//! Program data that an instrument receives, and their meaning for a command.

use std::ops::RangeInclusive;

use crate::{grammar::error::ScpiError, grammar::mnemonic::Mnemonic, grammar::unit::Unit};

/// One parameter of a command.
#[derive(Debug, Clone, PartialEq)]
pub enum Param {
    /// A decimal number with its suffix, unconverted.
    Number {
        /// The number before the suffix is applied; always finite.
        value: f64,
        /// Unit with multiplier, in the letters of the sender.
        suffix: Option<Box<str>>,
    },
    /// `#H1F`, `#Q17`, `#B101`.
    NonDecimal(u64),
    /// Character data such as `MIN` or `BUS`.
    Characters(Box<str>),
    /// A quoted string, without its quotes.
    Text(Box<str>),
    /// A block of arbitrary bytes.
    Block(Box<[u8]>),
    /// The text between parentheses, such as a channel list.
    Expression(Box<str>),
}

/// The value of a numeric parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Numeric {
    /// A number in the unit of the command.
    Value(f64),
    /// `MINimum`.
    Minimum,
    /// `MAXimum`.
    Maximum,
    /// `DEFault`.
    Default,
    /// `UP`: one step up.
    Up,
    /// `DOWN`: one step down.
    Down,
    /// `INFinity`.
    Infinity,
    /// `NINFinity`.
    NegativeInfinity,
    /// `NAN`.
    NotANumber,
}

/// The values that a numeric setting may take, in its own unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// The value of `MIN`.
    pub min: f64,
    /// The value of `MAX`.
    pub max: f64,
    /// The value of `DEF`.
    pub default: f64,
}

impl Param {
    /// The parameter as a number in `unit`, or a name for a number such as `MIN`.
    ///
    /// # Errors
    /// −138 and −131 for a suffix that is not allowed here, −224 for unknown character data, and
    /// the "not allowed" number of its type for everything else.
    pub(crate) fn numeric(&self, unit: Unit) -> Result<Numeric, ScpiError> {
        const WORDS: &[(Mnemonic<'static>, Numeric)] = &[
            (Mnemonic::new("MINimum"), Numeric::Minimum),
            (Mnemonic::new("MAXimum"), Numeric::Maximum),
            (Mnemonic::new("DEFault"), Numeric::Default),
            (Mnemonic::new("UP"), Numeric::Up),
            (Mnemonic::new("DOWN"), Numeric::Down),
            (Mnemonic::new("INFinity"), Numeric::Infinity),
            (Mnemonic::new("NINFinity"), Numeric::NegativeInfinity),
            (Mnemonic::new("NAN"), Numeric::NotANumber),
        ];
        match self {
            Self::Number { value, suffix: None } => Ok(Numeric::Value(*value)),
            Self::Number { suffix: Some(_), .. } if unit == Unit::NONE => Err(ScpiError::new(-138)),
            Self::Number { value, suffix: Some(suffix) } => match unit.apply(*value, suffix) {
                Some(value) if value.is_finite() => Ok(Numeric::Value(value)),
                Some(_) => Err(ScpiError::new(-222)),
                None => Err(ScpiError::new(-131).with_info(&**suffix)),
            },
            Self::NonDecimal(value) => Ok(Numeric::Value(*value as f64)),
            Self::Characters(word) => WORDS
                .iter()
                .find(|(mnemonic, _)| mnemonic.matches(word.as_bytes()))
                .map(|(_, numeric)| *numeric)
                .ok_or_else(|| ScpiError::new(-224).with_info(&**word)),
            other => Err(other.not_allowed()),
        }
    }

    /// The number within `limits`, in `unit`; `MIN`, `MAX` and `DEF` give the limits.
    ///
    /// # Errors
    /// −222 outside the limits, −224 for another word, −138 and −131 for a suffix that is not allowed,
    /// and the "not allowed" number of the type for everything else.
    pub fn real(&self, unit: Unit, limits: Limits) -> Result<f64, ScpiError> {
        match self.numeric(unit)? {
            Numeric::Value(value) if limits.min <= value && value <= limits.max => Ok(value),
            Numeric::Value(_) | Numeric::Infinity | Numeric::NegativeInfinity => {
                Err(ScpiError::new(-222))
            }
            Numeric::Minimum => Ok(limits.min),
            Numeric::Maximum => Ok(limits.max),
            Numeric::Default => Ok(limits.default),
            Numeric::Up | Numeric::Down | Numeric::NotANumber => Err(ScpiError::new(-224)),
        }
    }

    /// A whole number within `range`; a fraction is rounded, as IEEE 488.2 requires for registers.
    ///
    /// # Errors
    /// −222 outside the range, and for a decimal number of 2⁵³ or more, whose last digits are not
    /// known; −224 for character data other than `MIN` and `MAX`, −138 with a suffix.
    pub fn integer(&self, range: RangeInclusive<i64>) -> Result<i64, ScpiError> {
        let found = match self {
            Self::NonDecimal(value) => i64::try_from(*value).ok(),
            _ => match self.numeric(Unit::NONE)? {
                Numeric::Value(value) => whole(value.round()),
                Numeric::Minimum => Some(*range.start()),
                Numeric::Maximum => Some(*range.end()),
                Numeric::Infinity | Numeric::NegativeInfinity => None,
                _ => return Err(ScpiError::new(-224)),
            },
        };
        found.filter(|value| range.contains(value)).ok_or(ScpiError::new(-222))
    }

    /// `ON`, `OFF`, or a number; any number that does not round to zero is on.
    ///
    /// # Errors
    /// −224 for other character data, −138 for a suffix, and the "not allowed" number of other
    /// types.
    pub fn boolean(&self) -> Result<bool, ScpiError> {
        match self {
            Self::Characters(word) if word.eq_ignore_ascii_case("ON") => Ok(true),
            Self::Characters(word) if word.eq_ignore_ascii_case("OFF") => Ok(false),
            _ => match self.numeric(Unit::NONE)? {
                Numeric::Value(value) => Ok(value.round() != 0.0),
                _ => Err(ScpiError::new(-224)),
            },
        }
    }

    /// The entry of `choices` whose short or long form this word is.
    ///
    /// Choices are written as in a manual: `("IMMediate", Source::Immediate)`.
    ///
    /// # Errors
    /// −224 for another word, and the "not allowed" number of other types.
    pub fn choice<T: Copy>(&self, choices: &[(&str, T)]) -> Result<T, ScpiError> {
        let Self::Characters(word) = self else { return Err(self.not_allowed()) };
        choices
            .iter()
            .find(|(pattern, _)| Mnemonic::new(pattern).matches(word.as_bytes()))
            .map(|(_, choice)| *choice)
            .ok_or_else(|| ScpiError::new(-224).with_info(&**word))
    }

    /// The content of a quoted string.
    ///
    /// # Errors
    /// The "not allowed" number of the type that was found.
    pub fn text(&self) -> Result<&str, ScpiError> {
        match self {
            Self::Text(text) => Ok(text),
            other => Err(other.not_allowed()),
        }
    }

    /// The bytes of a block.
    ///
    /// # Errors
    /// The "not allowed" number of the type that was found.
    pub fn block(&self) -> Result<&[u8], ScpiError> {
        match self {
            Self::Block(bytes) => Ok(bytes),
            other => Err(other.not_allowed()),
        }
    }

    /// "This type of data is not allowed here": −128, −148, −158, −168 or −178.
    pub(crate) fn not_allowed(&self) -> ScpiError {
        ScpiError::new(match self {
            Self::Number { .. } | Self::NonDecimal(_) => -128,
            Self::Characters(_) => -148,
            Self::Text(_) => -158,
            Self::Block(_) => -168,
            Self::Expression(_) => -178,
        })
    }
}

/// The integer that `value` is. `None` for a fraction, and from ±2⁵³ on, where floats cannot
/// distinguish integers.
pub(crate) fn whole(value: f64) -> Option<i64> {
    const FIRST_AMBIGUOUS: f64 = (1_i64 << f64::MANTISSA_DIGITS) as f64;
    let is_exact = value.fract() == 0.0 && value.abs() < FIRST_AMBIGUOUS;
    #[expect(clippy::cast_possible_truncation, reason = "whole, and below 2^53")]
    is_exact.then_some(value as i64)
}

#[cfg(test)]
mod tests {
    use crate::grammar::parse;

    #[test]
    fn an_integer_is_the_one_that_was_sent_or_refused() {
        let found = |text: &str, range| {
            let params = parse::params(text.as_bytes()).and_then(|params| params[0].integer(range));
            params.map_err(|error| error.number())
        };
        let all = i64::MIN..=i64::MAX;
        let rows = [
            ("9007199254740991", Ok(9_007_199_254_740_991)),
            ("-9007199254740991", Ok(-9_007_199_254_740_991)),
            ("2.5", Ok(3)),
            ("#H7FFFFFFFFFFFFFFF", Ok(i64::MAX)),
            ("#H20000000000001", Ok(9_007_199_254_740_993)),
            ("MAX", Ok(i64::MAX)),
            // The next float is that of another integer as well.
            ("9007199254740992", Err(-222)),
            ("9007199254740993", Err(-222)),
            ("-9007199254740992", Err(-222)),
            ("9223372036854775807", Err(-222)),
            ("9223372036854775808", Err(-222)),
            ("18446744073709551616", Err(-222)),
            ("1E300", Err(-222)),
            ("#H8000000000000000", Err(-222)),
            ("#HFFFFFFFFFFFFFFFF", Err(-222)),
            ("#H10000000000000000", Err(-222)),
            ("INF", Err(-222)),
            ("DEF", Err(-224)),
        ];
        for (text, expected) in rows {
            assert_eq!(found(text, all.clone()), expected, "{text}");
        }
        for text in ["-1", "256", "#H100", "9223372036854775808"] {
            assert_eq!(found(text, 0..=255), Err(-222), "{text}");
        }
        assert_eq!(found("255.4", 0..=255), Ok(255));
    }
}
