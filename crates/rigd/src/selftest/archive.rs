//! The archive of a self-test: one JSON file to send, with the checks and the transcripts. It has no names of
//! persons, and serial numbers are hashes.

use std::fmt::Write as _;

use jiff::Timestamp;
use serde::Serialize;
use sha2::{Digest, Sha256};

use super::{Check, Quantity, Report};
use crate::{rig::SOFTWARE, transcripts::Recorded};

/// A shorter text is no serial number that tells a device apart, and may be part of any other word.
const SECRET_CHARS_MIN: usize = 4;

/// Everything of a self-test that leaves the computer.
#[derive(Debug, Serialize)]
pub(crate) struct Archive {
    format: &'static str,
    made: String,
    software: &'static str,
    pub(crate) checks: Vec<CheckView>,
    transcripts: Vec<TranscriptView>,
}

#[derive(Debug, Serialize)]
pub(crate) struct CheckView {
    part: &'static str,
    check: String,
    level: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    value: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    uncertainty: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    limit: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    unit: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    text: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    advice: Option<&'static str>,
}

#[derive(Debug, Serialize)]
struct TranscriptView {
    device: &'static str,
    instrument: &'static str,
    /// As `rigd instrument check --transcript` reads it.
    text: String,
}

impl Archive {
    /// The archive of a report.
    pub(crate) fn of(report: &Report) -> Self {
        let hide = |text: &str| hidden(text, &report.secrets);
        let check = |check: &Check| CheckView::of(check, hide);
        let transcript = |Recorded { device, instrument, file, .. }: &Recorded| TranscriptView {
            device,
            instrument: instrument.name(),
            text: hide(&file.text()),
        };
        Self {
            format: "rigd-selftest-1",
            made: Timestamp::now().strftime("%Y-%m-%dT%H:%M:%SZ").to_string(),
            software: SOFTWARE,
            checks: report.checks.iter().map(check).collect(),
            transcripts: report.recorded.iter().map(transcript).collect(),
        }
    }
}

impl CheckView {
    fn of(check: &Check, hide: impl Fn(&str) -> String) -> Self {
        let Check { part, name, level, quantity, text, advice } = check;
        let of = |value: fn(&Quantity) -> f64| quantity.as_ref().map(value);
        Self {
            part,
            check: name.clone(),
            level: level.name(),
            value: of(|quantity| quantity.value),
            uncertainty: quantity.and_then(|quantity| quantity.uncertainty),
            limit: of(|quantity| quantity.limit),
            unit: quantity.map(|quantity| quantity.unit),
            text: text.as_deref().map(hide),
            advice: *advice,
        }
    }
}

/// A text with the beginning of the hash of each serial number in its place.
fn hidden(text: &str, secrets: &[String]) -> String {
    let is_long = |secret: &&String| SECRET_CHARS_MIN <= secret.chars().count();
    secrets.iter().filter(is_long).fold(text.to_owned(), |text, secret| {
        let hash = Sha256::digest(secret.as_bytes());
        let beginning = hash.iter().take(6).fold(String::new(), |mut text, byte| {
            _ = write!(text, "{byte:02x}");
            text
        });
        text.replace(secret.as_str(), &format!("sha256-{beginning}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_serial_number_leaves_as_its_hash() {
        let secrets = ["A50285BI".to_owned(), "1".to_owned()];
        let text = hidden("usb-FTDI_A50285BI-if00, address 1", &secrets);
        let hash = text.strip_prefix("usb-FTDI_sha256-").unwrap().split_once('-').unwrap().0;
        assert!(hash.len() == 12 && hash.chars().all(|digit| digit.is_ascii_hexdigit()), "{text}");
        assert!(!text.contains("A50285BI") && text.ends_with("address 1"), "{text}");
        assert_eq!(text, hidden("usb-FTDI_A50285BI-if00, address 1", &secrets));
    }
}
