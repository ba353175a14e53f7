//! The bytes of a file as text.

use crate::{Complaint, Faults, Location};

/// Reasons why bytes are not text.
#[derive(Debug, thiserror::Error)]
enum NoText {
    #[error("the file is UTF-16")]
    Utf16,
    #[error("the byte 0x{byte:02X} is not UTF-8; in Latin-1 it is `{}`", char::from(*byte))]
    Latin1 { byte: u8 },
    #[error("the byte 0x{byte:02X} is not UTF-8")]
    NoUtf8 { byte: u8 },
    #[error("the file is not text: it has a zero byte here")]
    Binary,
}

impl Complaint for NoText {
    fn suggestion(&self) -> Option<String> {
        Some(match self {
            Self::Binary => "give the file that was written by hand".into(),
            _ => "save it as UTF-8".into(),
        })
    }
}

/// The text of a `file` with these bytes, without the byte order mark of some editors.
///
/// # Errors
/// One fault at the first byte that is not UTF-8.
pub fn text<'a>(file: &str, bytes: &'a [u8]) -> Result<&'a str, Faults> {
    let refused = |at: usize, complaint: NoText| {
        let mut faults = Faults::new(file);
        faults.refuse(location(bytes, at), &complaint);
        Err(faults)
    };
    // In UTF-16, every second byte of Latin letters is zero, also without a mark.
    let is_wide = matches!(bytes, [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..])
        || matches!(bytes, [0, b, ..] | [b, 0, ..] if b.is_ascii() && *b != 0);
    if is_wide {
        return refused(0, NoText::Utf16);
    }
    if let Some(at) = bytes.iter().position(|byte| *byte == 0) {
        return refused(at, NoText::Binary);
    }
    match str::from_utf8(bytes) {
        Ok(text) => Ok(text.strip_prefix('\u{feff}').unwrap_or(text)),
        Err(error) => {
            let at = error.valid_up_to();
            let byte = bytes[at];
            // Lower bytes are control characters of Latin-1, which are not used in text.
            let is_letter = byte >= 0xA0;
            refused(at, if is_letter { NoText::Latin1 { byte } } else { NoText::NoUtf8 { byte } })
        }
    }
}

/// The location of a byte after valid UTF-8.
fn location(bytes: &[u8], at: usize) -> Location {
    let before = String::from_utf8_lossy(&bytes[..at]);
    let start = before.rfind('\n').map_or(0, |newline| newline + 1);
    Location {
        line: 1 + before.matches('\n').count(),
        column: 1 + before[start..].trim_start_matches('\u{feff}').chars().count(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(bytes: &[u8], expected: Result<&str, &str>) {
        let found = text("x.toml", bytes).map_err(|faults| faults.to_string());
        assert_eq!(found, expected.map_err(|message| format!("x.toml:{message}")));
    }

    #[test]
    fn bytes_that_are_no_utf8_are_refused_at_their_place() {
        check("a = \"µ°\"\n".as_bytes(), Ok("a = \"µ°\"\n"));
        check("\u{feff}a = 1".as_bytes(), Ok("a = 1"));
        check(b"", Ok(""));
        let wide: Vec<u8> = "a = 1".encode_utf16().flat_map(u16::to_le_bytes).collect();
        let utf16 = Err("1:1: the file is UTF-16; save it as UTF-8");
        check(&wide, utf16);
        check(&[&[0xFF, 0xFE], &wide[..]].concat(), utf16);
        let wide: Vec<u8> = "a = 1".encode_utf16().flat_map(u16::to_be_bytes).collect();
        check(&wide, utf16);
        check(&[&[0xFE, 0xFF], &wide[..]].concat(), utf16);
        check(
            b"a = 1\nb = \"30\xb0\"",
            Err("2:8: the byte 0xB0 is not UTF-8; in Latin-1 it is `°`; save it as UTF-8"),
        );
        check(b"a\x80", Err("1:2: the byte 0x80 is not UTF-8; save it as UTF-8"));
        check(
            b"SQLite format 3\0",
            Err("1:16: the file is not text: it has a zero byte here; give the file that was \
                 written \
                 by hand"),
        );
    }
}
