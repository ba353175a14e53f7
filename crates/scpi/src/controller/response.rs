//! Answers as a controller reads them. Markers in place of numbers end here: outside this module a
//! missing or overloaded reading is a variant, never 9.9E37.

use nom::{
    IResult, Parser,
    branch::alt,
    bytes::complete::{tag, tag_no_case, take, take_while, take_while1},
    character::complete::{char, digit0, digit1, one_of, satisfy},
    combinator::{all_consuming, opt, recognize, rest, verify},
    multi::separated_list1,
    sequence::{preceded, terminated},
};

use crate::{
    grammar::param::whole,
    grammar::value::{INFINITY, NOT_A_NUMBER},
};

/// Instruments also print the two special numbers in single precision.
const SENTINEL_TOLERANCE_REL: f64 = 1e-6;

/// One whole answer, without its ending.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Response {
    bytes: Vec<u8>,
}

/// The answer to one query of a message.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseUnit {
    /// The header in front of the data, for instruments that repeat it, such as `:FREQUENCY`.
    pub header: Option<String>,
    /// Data of the unit, without its header.
    pub data: Vec<Datum>,
}

/// One datum of an answer.
#[derive(Debug, Clone, PartialEq)]
pub enum Datum {
    /// NR1 that fits.
    Integer(i64),
    /// NR2, NR3, and NR1 that does not fit.
    Real(f64),
    /// `#HFF`, `#Q17`, `#B101`.
    NonDecimal(u64),
    /// A string, without its quotes.
    Text(String),
    /// Character data, or other unrecognised text.
    Characters(String),
    /// The bytes of a block, without its header.
    Block(Vec<u8>),
    /// The reading is too large (9.9E37, or infinite).
    Overload {
        /// It is too far below zero.
        is_negative: bool,
    },
    /// There is no reading (9.91E37, a field of asterisks, `1.#QNB`).
    Missing,
}

/// The reason why an answer has the wrong type or form.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DataError {
    /// A field is not one datum.
    #[error("an answer cannot be read from offset {offset}")]
    Malformed {
        /// Offset at which reading stopped.
        offset: usize,
    },
    /// Another number of answers than queries.
    #[error("{found} answers came where {expected} was expected")]
    UnitCount {
        /// The number expected.
        expected: usize,
        /// The number received.
        found: usize,
    },
    /// A different number of data than requested.
    #[error("{found} fields came where {expected} were expected")]
    FieldCount {
        /// The number expected.
        expected: usize,
        /// The number received.
        found: usize,
    },
    /// Another type of data.
    #[error("a field is {found}, where {expected} was expected")]
    Type {
        /// The type expected.
        expected: &'static str,
        /// The received type.
        found: &'static str,
    },
    /// The reading is too large to be one.
    #[error("a reading is overloaded")]
    Overload,
    /// There is no reading.
    #[error("a reading is missing")]
    Missing,
}

impl Response {
    pub(crate) const fn new(bytes: Vec<u8>) -> Self {
        Self { bytes }
    }

    /// The received bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The whole answer as text.
    ///
    /// # Errors
    /// [`DataError::Malformed`] at the first byte beyond ASCII, which only a block may hold.
    pub fn text(&self) -> Result<&str, DataError> {
        match self.bytes.iter().position(|byte| !byte.is_ascii()) {
            Some(offset) => Err(DataError::Malformed { offset }),
            None => str::from_utf8(&self.bytes).map_err(|_| DataError::Malformed { offset: 0 }),
        }
    }

    /// The answers to the queries of one message, in order.
    ///
    /// # Errors
    /// [`DataError::Malformed`] where a field is not one datum.
    pub fn units(&self) -> Result<Vec<ResponseUnit>, DataError> {
        all_consuming(separated_list1(char(';'), unit))
            .parse(&self.bytes)
            .map(|(_, units)| units)
            .map_err(|error| {
                let n_left = match error {
                    nom::Err::Error(error) | nom::Err::Failure(error) => error.input.len(),
                    nom::Err::Incomplete(_) => 0,
                };
                DataError::Malformed { offset: self.bytes.len() - n_left }
            })
    }

    /// The data of the answer to one query.
    ///
    /// # Errors
    /// As [`Self::units`], and [`DataError::UnitCount`] for several answers.
    pub fn data(&self) -> Result<Vec<Datum>, DataError> {
        let mut units = self.units()?;
        match (units.pop(), units.len()) {
            (Some(unit), 0) => Ok(unit.data),
            (_, n_others) => Err(DataError::UnitCount { expected: 1, found: n_others + 1 }),
        }
    }

    /// The only datum of the answer to one query.
    ///
    /// # Errors
    /// As [`Self::data`], and [`DataError::FieldCount`] for several data.
    pub fn datum(&self) -> Result<Datum, DataError> {
        let mut data = self.data()?;
        match (data.pop(), data.len()) {
            (Some(datum), 0) => Ok(datum),
            (_, n_others) => Err(DataError::FieldCount { expected: 1, found: n_others + 1 }),
        }
    }
}

impl Datum {
    /// The datum as a number.
    ///
    /// # Errors
    /// [`DataError::Overload`] and [`DataError::Missing`] for a marker in place of a number, and
    /// [`DataError::Type`] for data of another type.
    pub fn number(&self) -> Result<f64, DataError> {
        match self {
            Self::Integer(value) => Ok(*value as f64),
            Self::Real(value) => Ok(*value),
            Self::NonDecimal(value) => Ok(*value as f64),
            Self::Overload { .. } => Err(DataError::Overload),
            Self::Missing => Err(DataError::Missing),
            other => Err(DataError::Type { expected: "a number", found: other.type_name() }),
        }
    }

    /// The whole number. Instruments that know only reals answer `+1.0E+00` for 1.
    ///
    /// # Errors
    /// As [`Self::number`]; a fraction is [`DataError::Type`], and so is a number that is too large
    /// for every digit of it to be known.
    pub fn integer(&self) -> Result<i64, DataError> {
        match self {
            Self::Integer(value) => Ok(*value),
            Self::NonDecimal(value) if i64::try_from(*value).is_ok() => Ok(value.cast_signed()),
            other => {
                let value = other.number()?;
                let is_fraction = value.fract() != 0.0;
                let found = if is_fraction { "a fraction" } else { "too large for one" };
                whole(value).ok_or(DataError::Type { expected: "a whole number", found })
            }
        }
    }

    /// `1`, `0`, `ON` or `OFF`.
    ///
    /// # Errors
    /// [`DataError::Type`] for everything else.
    pub fn boolean(&self) -> Result<bool, DataError> {
        match self {
            Self::Integer(0) => Ok(false),
            Self::Integer(1) => Ok(true),
            Self::Characters(word) if word.eq_ignore_ascii_case("ON") => Ok(true),
            Self::Characters(word) if word.eq_ignore_ascii_case("OFF") => Ok(false),
            other => Err(DataError::Type { expected: "ON or OFF", found: other.type_name() }),
        }
    }

    /// The text of a string or of character data.
    ///
    /// # Errors
    /// [`DataError::Type`] for everything else.
    pub fn text(&self) -> Result<&str, DataError> {
        match self {
            Self::Text(text) | Self::Characters(text) => Ok(text),
            other => Err(DataError::Type { expected: "text", found: other.type_name() }),
        }
    }

    /// The bytes of a block.
    ///
    /// # Errors
    /// [`DataError::Type`] for everything else.
    pub fn block(&self) -> Result<&[u8], DataError> {
        match self {
            Self::Block(bytes) => Ok(bytes),
            other => Err(DataError::Type { expected: "a block", found: other.type_name() }),
        }
    }

    const fn type_name(&self) -> &'static str {
        match self {
            Self::Integer(_) | Self::Real(_) | Self::NonDecimal(_) => "a number",
            Self::Text(_) => "a string",
            Self::Characters(_) => "a word",
            Self::Block(_) => "a block",
            Self::Overload { .. } => "an overload",
            Self::Missing => "missing",
        }
    }
}

type Parsed<'a, T> = IResult<&'a [u8], T>;

fn unit(input: &[u8]) -> Parsed<'_, ResponseUnit> {
    let (input, header) = opt(terminated(header, take_while1(is_blank))).parse(input)?;
    let (input, data) = separated_list1(char(','), datum).parse(input)?;
    Ok((input, ResponseUnit { header, data }))
}

/// `:SENSE:FREQUENCY` or `*ESR`. Without the colon or asterisk it could not be distinguished from
/// character data.
fn header(input: &[u8]) -> Parsed<'_, String> {
    let word = || {
        (
            satisfy(|c| c.is_ascii_alphabetic()),
            take_while(|byte: u8| byte.is_ascii_alphanumeric() || b"_-".contains(&byte)),
        )
    };
    alt((recognize((char('*'), word())), recognize(nom::multi::many1_count((char(':'), word())))))
        .map(ascii)
        .parse(input)
}

fn datum(input: &[u8]) -> Parsed<'_, Datum> {
    let (input, _) = take_while(is_blank).parse(input)?;
    let (input, datum) = match input.first() {
        Some(b'"') => text(input)?,
        Some(b'#') => alt((block, non_decimal, characters)).parse(input)?,
        _ => alt((number, stand_in, characters)).parse(input)?,
    };
    let (input, _) = take_while(is_blank).parse(input)?;
    Ok((input, datum))
}

/// A quoted string; a doubled `"` is one `"`.
fn text(input: &[u8]) -> Parsed<'_, Datum> {
    let mut inside = recognize(nom::multi::many0_count(alt((
        tag("\"\""),
        take_while1(|byte: u8| byte != b'"' && byte.is_ascii()),
    ))));
    let (input, _) = char('"').parse(input)?;
    let (input, found) = inside.parse(input)?;
    let (input, _) = char('"').parse(input)?;
    Ok((input, Datum::Text(ascii(found).replace("\"\"", "\""))))
}

fn block(input: &[u8]) -> Parsed<'_, Datum> {
    let (input, n_digits) = preceded(char('#'), one_of("0123456789")).parse(input)?;
    if n_digits == '0' {
        return rest.map(|bytes: &[u8]| Datum::Block(bytes.to_vec())).parse(input);
    }
    let n_digits = n_digits.to_digit(10).unwrap_or(0) as usize;
    let (input, digits) =
        verify(take(n_digits), |digits: &[u8]| digits.iter().all(u8::is_ascii_digit))
            .parse(input)?;
    let n_bytes = digits.iter().fold(0, |sum: usize, digit| sum * 10 + usize::from(digit - b'0'));
    take(n_bytes).map(|bytes: &[u8]| Datum::Block(bytes.to_vec())).parse(input)
}

fn non_decimal(input: &[u8]) -> Parsed<'_, Datum> {
    let (input, letter) = preceded(char('#'), one_of("hHqQbB")).parse(input)?;
    let radix = match letter {
        'h' | 'H' => 16,
        'q' | 'Q' => 8,
        _ => 2,
    };
    take_while1(|byte: u8| byte.is_ascii_alphanumeric())
        .map_opt(|digits| u64::from_str_radix(&ascii(digits), radix).ok())
        .map(Datum::NonDecimal)
        .parse(input)
}

fn number(input: &[u8]) -> Parsed<'_, Datum> {
    let digits =
        alt((recognize((digit1, opt((char('.'), digit0)))), recognize((char('.'), digit1))));
    let exponent = (one_of("eE"), opt(one_of("+-")), digit1);
    let (input, found) =
        terminated(recognize((opt(one_of("+-")), digits, opt(exponent))), end_of_field)
            .parse(input)?;
    let is_whole = !found.iter().any(|byte| b".eE".contains(byte));
    let found = str::from_utf8(found).unwrap_or_default();
    let value = match found.parse() {
        Ok(value) if is_whole => Datum::Integer(value),
        _ => real(found.parse().unwrap_or(f64::NAN)),
    };
    Ok((input, value))
}

/// A real number, or the variant for a special number.
fn real(value: f64) -> Datum {
    let magnitude = value.abs();
    let is_near = |sentinel: f64| (magnitude - sentinel).abs() <= sentinel * SENTINEL_TOLERANCE_REL;
    if value.is_nan() || is_near(NOT_A_NUMBER) {
        Datum::Missing
    } else if is_near(INFINITY) || INFINITY < magnitude {
        Datum::Overload { is_negative: value < 0.0 }
    } else {
        Datum::Real(value)
    }
}

/// Markers that instruments write in place of a number: words of SCPI, the C library of old Windows
/// (`1.#QNB`), and fields of asterisks.
fn stand_in(input: &[u8]) -> Parsed<'_, Datum> {
    let overload = |is_negative| move |_: &[u8]| Datum::Overload { is_negative };
    let word = alt((
        alt((tag_no_case("NINF"), tag_no_case("-INF"), tag("-1.#INF"))).map(overload(true)),
        alt((tag_no_case("INF"), tag_no_case("+INF"), tag("1.#INF"), tag("+1.#INF")))
            .map(overload(false)),
        alt((tag_no_case("NAN"), tag_no_case("+NAN"), tag_no_case("-NAN"))).map(|_| Datum::Missing),
        (opt(one_of("+-")), tag("1.#"), take_while1(|byte: u8| byte.is_ascii_alphabetic()))
            .map(|_| Datum::Missing),
    ));
    // The C library pads special values with zeros: `1.#QNB00E+000`.
    let padding = take_while(|byte: u8| byte.is_ascii_digit() || b"eE+-".contains(&byte));
    let asterisks = verify(plain, |field: &[u8]| field.contains(&b'*')).map(|_| Datum::Missing);
    alt((terminated(word, (padding, end_of_field)), asterisks)).parse(input)
}

fn characters(input: &[u8]) -> Parsed<'_, Datum> {
    plain.map(|field| Datum::Characters(ascii(field.trim_ascii_end()))).parse(input)
}

/// A field without quotes, up to its separator.
fn plain(input: &[u8]) -> Parsed<'_, &[u8]> {
    take_while1(|byte: u8| byte.is_ascii() && !b",;\"".contains(&byte)).parse(input)
}

fn end_of_field(input: &[u8]) -> Parsed<'_, ()> {
    match input.iter().find(|byte| !is_blank(**byte)) {
        None | Some(b',' | b';') => Ok((input, ())),
        Some(_) => {
            let kind = nom::error::ErrorKind::Eof;
            Err(nom::Err::Error(nom::error::Error::new(input, kind)))
        }
    }
}

const fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\r')
}

/// Callers pass ASCII only, where every byte is a character of its own.
fn ascii(bytes: &[u8]) -> String {
    bytes.iter().map(|&byte| char::from(byte)).collect()
}
