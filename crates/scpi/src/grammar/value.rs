//! Answers of an instrument and how they are written.

use std::{borrow::Cow, io::Write};

use crate::grammar::mnemonic::short_form;

/// +∞ on the wire, also for a reading that is too large.
pub(crate) const INFINITY: f64 = 9.9e37;
/// "Not a number" on the wire, also for a missing reading.
pub(crate) const NOT_A_NUMBER: f64 = 9.91e37;

/// One datum of an answer.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// An integer in the format NR1.
    Integer(i64),
    /// In the format of the dialect. Infinities and NaN become their special numbers.
    Real(f64),
    /// In a format of its own.
    Formatted(f64, RealFormat),
    /// `1` or `0`.
    Boolean(bool),
    /// `#HFF`.
    Hex(u64),
    /// `#Q17`.
    Octal(u64),
    /// `#B101`.
    Binary(u64),
    /// Character data in the notation of manuals (`MEASure`); the answer is its short form.
    Characters(&'static str),
    /// A string, which is quoted. Only ASCII is legal on the wire.
    Text(Cow<'static, str>),
    /// A block of known length.
    Block(Vec<u8>),
    /// A block that the end of the message ends. Nothing may follow it.
    IndefiniteBlock(Vec<u8>),
    /// Arbitrary ASCII response data, such as the identity. Nothing may follow it in the same
    /// message.
    ArbitraryAscii(Cow<'static, str>),
    /// Text that is written unchanged.
    Verbatim(Cow<'static, str>),
}

/// The format of real numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RealFormat {
    /// The shortest digits that give the same number back: `200`, `0.1`, `1E-7`.
    #[default]
    Shortest,
    /// NR2: a fixed number of decimals.
    Fixed {
        /// Digits behind the point.
        n_decimals: u8,
    },
    /// NR3: `+1.23450E-03`.
    Scientific {
        /// Digits behind the point.
        n_decimals: u8,
        /// Least digits of the exponent, which always has a sign.
        n_exponent: u8,
        /// Whether positive numbers have a sign.
        has_plus: bool,
    },
}

impl Value {
    /// Whether nothing may follow in the same message, because its end is the end of the message.
    pub(crate) const fn is_indefinite(&self) -> bool {
        matches!(self, Self::IndefiniteBlock(_) | Self::ArbitraryAscii(_))
    }

    /// Appends the datum in wire format.
    ///
    /// # Panics
    /// With a block of 10⁹ bytes or more, whose length does not fit its header.
    pub fn write(&self, format: RealFormat, out: &mut Vec<u8>) {
        match self {
            Self::Integer(value) => put(out, format_args!("{value}")),
            Self::Real(value) => write_real(*value, format, out),
            Self::Formatted(value, format) => write_real(*value, *format, out),
            Self::Boolean(value) => out.push(if *value { b'1' } else { b'0' }),
            Self::Hex(value) => put(out, format_args!("#H{value:X}")),
            Self::Octal(value) => put(out, format_args!("#Q{value:o}")),
            Self::Binary(value) => put(out, format_args!("#B{value:b}")),
            Self::Characters(word) => {
                out.extend_from_slice(short_form(word).to_ascii_uppercase().as_bytes());
            }
            Self::Text(text) => write_quoted(text, out),
            Self::Block(bytes) => write_block(bytes, out),
            Self::IndefiniteBlock(bytes) => {
                out.extend_from_slice(b"#0");
                out.extend_from_slice(bytes);
            }
            Self::ArbitraryAscii(text) | Self::Verbatim(text) => {
                out.extend_from_slice(text.as_bytes());
            }
        }
    }
}

fn put(out: &mut Vec<u8>, text: std::fmt::Arguments<'_>) {
    out.write_fmt(text).expect("writing to memory cannot fail");
}

/// `"` doubled inside, quotes around.
pub(crate) fn write_quoted(text: &str, out: &mut Vec<u8>) {
    out.push(b'"');
    for byte in text.bytes() {
        if byte == b'"' {
            out.push(b'"');
        }
        out.push(byte);
    }
    out.push(b'"');
}

/// `#15hello`.
pub(crate) fn write_block(bytes: &[u8], out: &mut Vec<u8>) {
    let length = bytes.len().to_string();
    assert!(length.len() <= 9, "a block of {length} bytes does not fit its header");
    put(out, format_args!("#{}{length}", length.len()));
    out.extend_from_slice(bytes);
}

/// The shortest decimal that reads back as `value`, with an exponent when that is shorter to read.
/// The shortest decimal form that reads back as the same number, as [`Program::number`] writes it. The
/// number is finite.
///
/// [`Program::number`]: crate::Program::number
pub fn shortest(value: f64) -> String {
    let mut bytes = Vec::new();
    write_shortest(value, &mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

pub(crate) fn write_shortest(value: f64, out: &mut Vec<u8>) {
    if value == 0.0 || (1e-4..1e15).contains(&value.abs()) {
        put(out, format_args!("{value}"));
    } else {
        put(out, format_args!("{value:E}"));
    }
}

fn write_real(value: f64, format: RealFormat, out: &mut Vec<u8>) {
    let value = match value {
        _ if value.is_nan() => NOT_A_NUMBER,
        f64::INFINITY => INFINITY,
        f64::NEG_INFINITY => -INFINITY,
        _ => value,
    };
    match format {
        RealFormat::Shortest => write_shortest(value, out),
        RealFormat::Fixed { n_decimals } => {
            put(out, format_args!("{value:.*}", usize::from(n_decimals)));
        }
        RealFormat::Scientific { n_decimals, n_exponent, has_plus } => {
            if has_plus && value.is_sign_positive() {
                out.push(b'+');
            }
            put(out, format_args!("{value:.*E}", usize::from(n_decimals)));
            widen_exponent(usize::from(n_exponent), out);
        }
    }
}

/// Gives the exponent at the end of `out` a sign and at least `n_digits` digits.
fn widen_exponent(n_digits: usize, out: &mut Vec<u8>) {
    let letter = out.iter().rposition(|byte| *byte == b'E').expect("`E` was just written");
    let start = letter + 1;
    if out.get(start) != Some(&b'-') {
        out.insert(start, b'+');
    }
    while out.len() < start + 1 + n_digits {
        out.insert(start + 1, b'0');
    }
}
