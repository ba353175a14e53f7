//! The grammar of one program message unit: a header and its data.
//!
//! # Source
//! IEEE 488.2, section 7 (program messages, as restated in SCPI-99, volume 1, chapters 5 to 8). The
//! error numbers follow the examples in SCPI-99, volume 2, 21.8.

use nom::{
    IResult, Parser,
    branch::alt,
    bytes::complete::{tag, take, take_while, take_while1},
    character::complete::{char, digit0, digit1, one_of, satisfy},
    combinator::{opt, recognize, rest, verify},
    sequence::{delimited, pair, preceded},
};

use crate::{grammar::error::ScpiError, grammar::param::Param, grammar::scan::is_blank};

/// Longest mnemonic, in characters.
const MNEMONIC_MAX: usize = 12;
/// Largest exponent of ten, and most digits of a mantissa.
const EXPONENT_MAX: i64 = 32_000;
const DIGITS_MAX: usize = 255;

/// The header of a unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Header<'a> {
    /// The mnemonics with colons between them; without the leading `:` or `*`, without the `?`.
    pub(crate) text: &'a [u8],
    pub(crate) is_common: bool,
    /// It began with a colon.
    pub(crate) is_absolute: bool,
    pub(crate) is_query: bool,
}

type Parsed<'a, T> = IResult<&'a [u8], T, Fault<'a>>;

/// The input that could not be understood, and the number that says why.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fault<'a> {
    rest: &'a [u8],
    number: i16,
}

impl<'a> nom::error::ParseError<&'a [u8]> for Fault<'a> {
    fn from_error_kind(rest: &'a [u8], _: nom::error::ErrorKind) -> Self {
        Self { rest, number: -102 }
    }

    fn append(_: &'a [u8], _: nom::error::ErrorKind, other: Self) -> Self {
        other
    }
}

/// A fault that no other branch can mend.
fn refuse<T>(rest: &[u8], number: i16) -> Parsed<'_, T> {
    Err(nom::Err::Failure(Fault { rest, number }))
}

/// Splits a unit into its header and its data. `None` when the unit is blank, which is legal.
pub(crate) fn unit(bytes: &[u8]) -> Result<Option<(Header<'_>, &[u8])>, ScpiError> {
    let bytes = skip_blank(bytes);
    if bytes.is_empty() {
        return Ok(None);
    }
    let (rest, header) = header(bytes).map_err(|fault| report(&fault))?;
    Ok(Some((header, rest)))
}

/// The data of a unit, in order.
pub(crate) fn params(bytes: &[u8]) -> Result<Vec<Param>, ScpiError> {
    let mut params = Vec::new();
    let mut rest = skip_blank(bytes);
    if rest.is_empty() {
        return Ok(params);
    }
    loop {
        let (tail, param) = param(rest).map_err(|fault| report(&fault))?;
        params.push(param);
        rest = skip_blank(tail);
        match rest.split_first() {
            None => return Ok(params),
            Some((b',', tail)) => rest = skip_blank(tail),
            Some((byte, _)) => return Err(ScpiError::new(number_for_stray(*byte))),
        }
    }
}

fn report(fault: &nom::Err<Fault<'_>>) -> ScpiError {
    match fault {
        nom::Err::Error(fault) | nom::Err::Failure(fault) => ScpiError::new(fault.number),
        // Only streaming parsers ask for more, and there are none here.
        nom::Err::Incomplete(_) => ScpiError::new(-102),
    }
}

fn skip_blank(bytes: &[u8]) -> &[u8] {
    let n_blank = bytes.iter().take_while(|byte| is_blank(**byte)).count();
    &bytes[n_blank..]
}

/// A character where a separator belongs: −101 when it belongs nowhere, else −103.
const fn number_for_stray(byte: u8) -> i16 {
    match byte {
        b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'_' => -103,
        b'+' | b'-' | b'.' | b'"' | b'\'' | b'(' | b')' | b'#' | b':' | b'*' | b'?' | b',' => -103,
        _ => -101,
    }
}

fn is_mnemonic_char(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_'
}

/// A letter, then letters, digits and underscores.
fn mnemonic(input: &[u8]) -> Parsed<'_, &[u8]> {
    recognize(pair(satisfy(|c| c.is_ascii_alphabetic()), take_while(is_mnemonic_char))).parse(input)
}

fn header_mnemonic(input: &[u8]) -> Parsed<'_, &[u8]> {
    match mnemonic(input) {
        Ok((_, found)) if MNEMONIC_MAX < found.len() => refuse(input, -112),
        Ok(found) => Ok(found),
        // White space around a colon is the classic slip; everything else is a wrong character.
        Err(_) => match input.first() {
            Some(byte) if !is_blank(*byte) => refuse(input, -101),
            _ => refuse(input, -102),
        },
    }
}

fn compound(input: &[u8]) -> Parsed<'_, (bool, &[u8])> {
    let (mut rest, colon) = opt(char(':')).parse(input)?;
    let start = rest;
    loop {
        (rest, _) = header_mnemonic(rest)?;
        match rest.strip_prefix(b":") {
            Some(tail) => rest = tail,
            None => return Ok((rest, (colon.is_some(), &start[..start.len() - rest.len()]))),
        }
    }
}

fn header(input: &[u8]) -> Parsed<'_, Header<'_>> {
    let (rest, (text, is_common, is_absolute)) = alt((
        preceded(char('*'), header_mnemonic).map(|text| (text, true, false)),
        compound.map(|(is_absolute, text)| (text, false, is_absolute)),
    ))
    .parse(input)?;
    let (rest, question) = opt(char('?')).parse(rest)?;
    match rest.first() {
        Some(b',') => return refuse(rest, -103),
        Some(b'"' | b'\'' | b'#' | b'(' | b'+' | b'-' | b'.') => return refuse(rest, -111),
        Some(byte) if byte.is_ascii_alphanumeric() => return refuse(rest, -111),
        Some(byte) if !is_blank(*byte) => return refuse(rest, -101),
        _ => {}
    }
    Ok((rest, Header { text, is_common, is_absolute, is_query: question.is_some() }))
}

fn param(input: &[u8]) -> Parsed<'_, Param> {
    match input.first() {
        Some(b'"' | b'\'') => text(input),
        Some(b'#') => match input.get(1) {
            Some(b'0'..=b'9') => block(input),
            Some(b'h' | b'H' | b'q' | b'Q' | b'b' | b'B') => non_decimal(input),
            _ => refuse(input, -101),
        },
        Some(b'(') => expression(input),
        Some(b'+' | b'-' | b'.' | b'0'..=b'9') => number(input),
        Some(byte) if byte.is_ascii_alphabetic() => characters(input),
        None | Some(b',' | b':') => refuse(input, -102),
        Some(_) => refuse(input, -101),
    }
}

fn characters(input: &[u8]) -> Parsed<'_, Param> {
    let (rest, found) = mnemonic(input)?;
    if MNEMONIC_MAX < found.len() {
        return refuse(input, -144);
    }
    Ok((rest, Param::Characters(ascii(found))))
}

/// `NRf`, then a suffix. Blanks are allowed around the exponent and before the suffix.
fn number(input: &[u8]) -> Parsed<'_, Param> {
    let Ok((rest, (mantissa, exponent))) = decimal(input) else { return refuse(input, -121) };
    let digits = mantissa.iter().filter(|byte| byte.is_ascii_digit());
    if DIGITS_MAX < digits.skip_while(|byte| **byte == b'0').count() {
        return refuse(input, -124);
    }
    let Some(value) = scaled(mantissa, exponent) else { return refuse(input, -123) };
    if value.is_infinite() {
        return refuse(input, -222);
    }
    if let Some(b'.') = rest.first() {
        return refuse(rest, -121);
    }
    let (rest, found) = opt(preceded(take_while(is_blank), suffix)).parse(rest)?;
    if found.is_some_and(|found| MNEMONIC_MAX < found.len()) {
        return refuse(rest, -134);
    }
    Ok((rest, Param::Number { value, suffix: found.map(ascii) }))
}

type Decimal<'a> = (&'a [u8], Option<(Option<char>, &'a [u8])>);

fn decimal(input: &[u8]) -> Parsed<'_, Decimal<'_>> {
    let digits =
        alt((recognize((digit1, opt((char('.'), digit0)))), recognize((char('.'), digit1))));
    let mantissa = recognize((opt(one_of("+-")), digits));
    let exponent = preceded(
        (take_while(is_blank), one_of("eE"), take_while(is_blank)),
        (opt(one_of("+-")), digit1),
    );
    (mantissa, opt(exponent)).parse(input)
}

/// `None` when the exponent is larger than the standard allows.
fn scaled(mantissa: &[u8], exponent: Option<(Option<char>, &[u8])>) -> Option<f64> {
    let mantissa = str::from_utf8(mantissa).ok()?;
    let Some((sign, digits)) = exponent else { return mantissa.parse().ok() };
    let digits = str::from_utf8(digits).ok()?;
    let magnitude: i64 = digits.parse().ok()?;
    if EXPONENT_MAX < magnitude {
        return None;
    }
    let sign = if sign == Some('-') { "-" } else { "" };
    format!("{mantissa}e{sign}{magnitude}").parse().ok()
}

/// `V`, `KHZ`, `M/S-2`, `KOHM.M/S-2`: IEEE 488.2, 7.7.3.
fn suffix(input: &[u8]) -> Parsed<'_, &[u8]> {
    let unit = |input| -> Parsed<'_, &[u8]> {
        recognize((
            take_while1(|byte: u8| byte.is_ascii_alphabetic()),
            opt((opt(char('-')), satisfy(|c| c.is_ascii_digit()))),
        ))
        .parse(input)
    };
    let more = nom::multi::many0_count(preceded(one_of("./"), unit));
    recognize((opt(char('/')), unit, more)).parse(input)
}

fn non_decimal(input: &[u8]) -> Parsed<'_, Param> {
    let (rest, letter) = preceded(char('#'), one_of("hHqQbB")).parse(input)?;
    let radix = match letter {
        'h' | 'H' => 16,
        'q' | 'Q' => 8,
        _ => 2,
    };
    let (rest, digits) = take_while(|byte: u8| byte.is_ascii_alphanumeric()).parse(rest)?;
    let is_number =
        !digits.is_empty() && digits.iter().all(|byte| char::from(*byte).is_digit(radix));
    if !is_number {
        return refuse(input, -121);
    }
    let value = str::from_utf8(digits).ok().and_then(|text| u64::from_str_radix(text, radix).ok());
    match value {
        Some(value) => Ok((rest, Param::NonDecimal(value))),
        None => refuse(input, -222),
    }
}

fn block(input: &[u8]) -> Parsed<'_, Param> {
    let (tail, _) = char('#').parse(input)?;
    if let Ok((tail, _)) = tag::<_, _, Fault<'_>>("0").parse(tail) {
        return rest.map(|bytes: &[u8]| Param::Block(bytes.into())).parse(tail);
    }
    match counted(tail) {
        Ok((tail, bytes)) => Ok((tail, Param::Block(bytes.into()))),
        Err(_) => refuse(input, -161),
    }
}

fn counted(input: &[u8]) -> Parsed<'_, &[u8]> {
    let (tail, n_digits) = one_of("123456789").parse(input)?;
    let n_digits = n_digits.to_digit(10).unwrap_or(0) as usize;
    let (tail, digits) =
        verify(take(n_digits), |digits: &[u8]| digits.iter().all(u8::is_ascii_digit))
            .parse(tail)?;
    let n_bytes = digits.iter().fold(0, |sum: usize, digit| sum * 10 + usize::from(digit - b'0'));
    take(n_bytes).parse(tail)
}

/// A quoted string; a doubled quote is one quote. Only ASCII, as the standard requires.
fn text(input: &[u8]) -> Parsed<'_, Param> {
    let quote = input[0];
    let mut text = String::new();
    let mut bytes = input[1..].iter().enumerate();
    while let Some((index, &byte)) = bytes.next() {
        if !byte.is_ascii() {
            return refuse(input, -151);
        }
        if byte == quote {
            if input.get(index + 2) != Some(&quote) {
                return Ok((&input[index + 2..], Param::Text(text.into())));
            }
            bytes.next();
        }
        text.push(char::from(byte));
    }
    refuse(input, -151)
}

/// Balanced parentheses; quoted strings inside may hold any of them.
fn expression(input: &[u8]) -> Parsed<'_, Param> {
    match delimited(char('('), balanced, char(')')).parse(input) {
        Ok((tail, inside)) if inside.is_ascii() => Ok((tail, Param::Expression(ascii(inside)))),
        _ => refuse(input, -171),
    }
}

/// Everything up to the parenthesis that closes the one before `input`.
fn balanced(input: &[u8]) -> Parsed<'_, &[u8]> {
    let mut depth = 0_usize;
    let mut quote = None;
    let end = input.iter().position(|&byte| {
        match (quote, byte) {
            (Some(open), _) if open == byte => quote = None,
            (Some(_), _) => {}
            (None, b'"' | b'\'') => quote = Some(byte),
            (None, b'(') => depth += 1,
            (None, b')') if depth == 0 => return true,
            (None, b')') => depth -= 1,
            _ => {}
        }
        false
    });
    take(end.unwrap_or(input.len())).parse(input)
}

/// Callers pass ASCII only, where every byte is a character of its own.
fn ascii(bytes: &[u8]) -> Box<str> {
    bytes.iter().map(|&byte| char::from(byte)).collect::<String>().into()
}
