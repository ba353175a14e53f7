//! A message as an e-mail.
//!
//! # Source
//! RFC 5322 for the headers; RFC 2047, section 4.2 (`Q`), for a subject that is not ASCII.

use std::fmt::Write as _;

use jiff::{Timestamp, fmt::rfc2822, tz::TimeZone};

use super::outbox::Message;

/// Payload of an encoded word: the whole word must not be longer than 75 characters.
const WORD_MAX: usize = 60;

/// The whole mail, headers and text, with lines that end in LF as sendmail takes them.
pub(super) fn text(message: &Message, from: &str, to: &[String]) -> String {
    let note = &message.note;
    let host = from.rsplit('@').next().unwrap_or_default();
    let at = i64::try_from(note.unix_ms).ok().and_then(|ms| Timestamp::from_millisecond(ms).ok());
    let at = at.map(|at| at.to_zoned(TimeZone::system()));
    let date = at.and_then(|at| rfc2822::to_string(&at).ok());
    let date = date.map(|date| format!("Date: {date}\n")).unwrap_or_default();
    format!(
        "From: {from}\nTo: {}\nSubject: {}\n{date}Message-ID: <{}.{}.{}@{host}>\n\
         Auto-Submitted: auto-generated\nMIME-Version: 1.0\n\
         Content-Type: text/plain; charset=utf-8\nContent-Transfer-Encoding: 8bit\n\n{}\n",
        to.join(", "),
        subject(&note.title),
        message.number,
        note.journal_event,
        note.unix_ms,
        note.text,
    )
}

/// A header value of one line: control characters become spaces, and what is not ASCII is encoded.
fn subject(title: &str) -> String {
    let line: String =
        title.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect();
    if line.is_ascii() {
        return line;
    }
    let mut words = vec![String::new()];
    for letter in line.chars() {
        let mut encoded = String::new();
        if letter.is_ascii_alphanumeric() {
            encoded.push(letter);
        } else {
            for byte in letter.to_string().bytes() {
                _ = write!(encoded, "={byte:02X}");
            }
        }
        match words.last_mut() {
            // A character is not cut.
            Some(word) if word.len() + encoded.len() <= WORD_MAX => word.push_str(&encoded),
            _ => words.push(encoded),
        }
    }
    let words: Vec<_> = words.iter().map(|word| format!("=?utf-8?Q?{word}?=")).collect();
    words.join("\n ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_subject_is_one_header_of_ascii() {
        assert_eq!(subject("bench: fault"), "bench: fault");
        // No other header can be written into it.
        assert_eq!(subject("a\r\nBcc: eve@example"), "a  Bcc: eve@example");
        assert_eq!(subject("30° off"), "=?utf-8?Q?30=C2=B0=20off?=");
        let long = subject(&"°".repeat(40));
        for line in long.split('\n') {
            assert!(line.trim_start().len() <= 75, "{line}");
            let payload = line.trim().strip_prefix("=?utf-8?Q?").unwrap();
            assert_eq!(payload.strip_suffix("?=").unwrap().len() % 6, 0, "{line}");
        }
        assert_eq!(long.matches("=C2=B0").count(), 40);
    }
}
