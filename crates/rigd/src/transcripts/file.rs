//! The file of a transcript: what was asked, and the frames of each role with their times.
//!
//! ```text
//! # rigd transcript 1: ms since the port was opened, direction, bytes
//! instrument = lab-bridge
//! level_v = 1
//! [identity]
//! 500.120 -> *CLS;*IDN?\n
//! 512.003 <- Example Instruments,LB-1,7,1.0\n
//! = Example Instruments LB-1, serial number 7
//! ```

use std::{
    fmt::Write as _,
    fs, io,
    path::{Path, PathBuf},
};

use rig_link::{Flow, Frame};
use rig_model::RigTime;

use super::Role;

const TITLE: &str = "# rigd transcript 1: ms since the port was opened, direction, bytes";

/// Largest transcript that is read, bytes: the record of all roles is far smaller.
const BYTES_MAX: u64 = 5_000_000;

/// A transcript.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct TranscriptFile {
    /// What was asked of the instrument, by name.
    pub(crate) head: Vec<(String, String)>,
    /// The roles in the order in which they were recorded.
    pub(crate) sections: Vec<Section>,
}

/// The exchange of a role.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Section {
    pub(crate) role: Role,
    pub(crate) frames: Vec<Frame>,
    /// What the driver made of it, a line for each part.
    pub(crate) result: Vec<String>,
}

/// An unusable transcript.
#[derive(Debug, thiserror::Error)]
pub(crate) enum TranscriptError {
    #[error("{}", path.display())]
    Unreadable { path: PathBuf, source: io::Error },
    #[error("{} has {bytes} bytes, above the limit of {BYTES_MAX} for a transcript", path.display())]
    TooLong { path: PathBuf, bytes: u64 },
    #[error("{}:{line}: {fault}", path.display())]
    Line { path: PathBuf, line: usize, fault: &'static str },
    #[error("the transcript has no `{key}`, or a value there that cannot be used")]
    Head { key: &'static str },
    #[error("the transcript is of the instrument {found}, and this one is {expected}")]
    OtherInstrument { found: String, expected: String },
    #[error("the thread of the replay cannot be started")]
    Thread { source: io::Error },
}

impl TranscriptFile {
    /// Reads the transcript at `path`.
    pub(crate) fn load(path: &Path) -> Result<Self, TranscriptError> {
        let unreadable = |source| TranscriptError::Unreadable { path: path.to_owned(), source };
        let bytes = fs::metadata(path).map_err(unreadable)?.len();
        if BYTES_MAX < bytes {
            return Err(TranscriptError::TooLong { path: path.to_owned(), bytes });
        }
        let text = fs::read_to_string(path).map_err(unreadable)?;
        Self::parse(&text).map_err(|(line, fault)| TranscriptError::Line {
            path: path.to_owned(),
            line,
            fault,
        })
    }

    /// The transcript of a text, or the number of a line and its fault.
    pub(crate) fn parse(text: &str) -> Result<Self, (usize, &'static str)> {
        let mut file = Self::default();
        if text.lines().next() != Some(TITLE) {
            return Err((1, "not a transcript of rigd"));
        }
        for (index, line) in text.lines().enumerate().skip(1) {
            file.take(line).map_err(|fault| (index + 1, fault))?;
        }
        Ok(file)
    }

    fn take(&mut self, line: &str) -> Result<(), &'static str> {
        if line.is_empty() || line.starts_with('#') {
            return Ok(());
        }
        if let Some(name) = line.strip_prefix('[').and_then(|line| line.strip_suffix(']')) {
            let role = Role::named(name).ok_or("not the name of a role")?;
            if self.sections.iter().any(|section| section.role == role) {
                return Err("this role is recorded twice");
            }
            self.sections.push(Section { role, frames: Vec::new(), result: Vec::new() });
            return Ok(());
        }
        let Some(section) = self.sections.last_mut() else {
            let (key, value) = line.split_once(" = ").ok_or("not of the form key = value")?;
            self.head.push((key.to_owned(), value.to_owned()));
            return Ok(());
        };
        if let Some(result) = line.strip_prefix("= ") {
            section.result.push(result.to_owned());
            return Ok(());
        }
        section.frames.push(frame(line)?);
        Ok(())
    }

    /// The text of the file.
    pub(crate) fn text(&self) -> String {
        let mut text = format!("{TITLE}\n");
        for (key, value) in &self.head {
            _ = writeln!(text, "{key} = {value}");
        }
        for Section { role, frames, result } in &self.sections {
            _ = writeln!(text, "\n[{}]", role.name());
            for Frame { at, flow, bytes } in frames {
                let (ms, arrow) = (at.as_seconds() * 1e3, arrow(*flow));
                _ = writeln!(text, "{ms:.3} {arrow} {}", bytes.escape_ascii());
            }
            for line in result {
                _ = writeln!(text, "= {line}");
            }
        }
        text
    }

    /// A value of the head.
    pub(crate) fn value(&self, key: &str) -> Option<&str> {
        self.head.iter().find(|(known, _)| known == key).map(|(_, value)| value.as_str())
    }

    /// A number of the head.
    pub(crate) fn number(&self, key: &'static str) -> Result<f64, TranscriptError> {
        let value = self.value(key).and_then(|value| value.parse().ok());
        value.filter(|value: &f64| value.is_finite()).ok_or(TranscriptError::Head { key })
    }
}

const fn arrow(flow: Flow) -> &'static str {
    match flow {
        Flow::Sent => "->",
        Flow::Received => "<-",
        Flow::Discarded => "<x",
    }
}

fn frame(line: &str) -> Result<Frame, &'static str> {
    const FORM: &str = "not of the form `ms -> bytes`";
    let (ms, rest) = line.split_once(' ').ok_or(FORM)?;
    let (arrow, bytes) = rest.split_once(' ').ok_or(FORM)?;
    let ms: f64 = ms.parse().map_err(|_| FORM)?;
    if !(0.0..=1e9).contains(&ms) {
        return Err("a time is from 0 to 1e9 ms");
    }
    let flow = match arrow {
        "->" => Flow::Sent,
        "<-" => Flow::Received,
        "<x" => Flow::Discarded,
        _ => return Err(FORM),
    };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked above")]
    let micros = (ms * 1e3).round() as u64;
    Ok(Frame { at: RigTime::from_micros(micros), flow, bytes: unescaped(bytes)? })
}

/// The bytes of a text that `escape_ascii` wrote.
fn unescaped(text: &str) -> Result<Vec<u8>, &'static str> {
    const FAULT: &str =
        "a byte is printable ASCII, \\n, \\r, \\t, \\\\, \\', \\\" or \\x with two digits";
    let (mut bytes, mut rest) = (Vec::new(), text.as_bytes());
    while let [first, more @ ..] = rest {
        rest = more;
        if *first != b'\\' {
            if !(first.is_ascii_graphic() || *first == b' ') {
                return Err(FAULT);
            }
            bytes.push(*first);
            continue;
        }
        let [kind, more @ ..] = rest else { return Err(FAULT) };
        rest = more;
        bytes.push(match kind {
            b'n' => b'\n',
            b'r' => b'\r',
            b't' => b'\t',
            b'\\' | b'\'' | b'"' => *kind,
            b'x' => {
                let (digits, more) = rest.split_at_checked(2).ok_or(FAULT)?;
                rest = more;
                let digits = str::from_utf8(digits).map_err(|_| FAULT)?;
                u8::from_str_radix(digits, 16).map_err(|_| FAULT)?
            }
            _ => return Err(FAULT),
        });
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transcript_is_read_as_it_was_written() {
        let all: Vec<u8> = (0..=255).collect();
        let frame = |micros, flow, bytes: &[u8]| Frame {
            at: RigTime::from_micros(micros),
            flow,
            bytes: bytes.to_vec(),
        };
        let frames = vec![
            frame(500_120, Flow::Sent, b"*IDN?\r\n"),
            frame(512_003, Flow::Received, &all),
            frame(600_000, Flow::Discarded, b"\xff"),
        ];
        let result = vec!["a b".to_owned(), "c".to_owned()];
        let file = TranscriptFile {
            head: vec![("instrument".to_owned(), "lab-bridge".to_owned())],
            sections: vec![Section { role: Role::Identity, frames, result }],
        };
        let text = file.text();
        assert!(text.contains("\n500.120 -> *IDN?\\r\\n\n"), "{text}");
        assert_eq!(TranscriptFile::parse(&text), Ok(file));
    }

    #[test]
    fn a_faulty_line_is_told_with_its_number() {
        let parse = |lines: &str| TranscriptFile::parse(&format!("{TITLE}\n{lines}")).unwrap_err();
        assert_eq!(TranscriptFile::parse("x").unwrap_err(), (1, "not a transcript of rigd"));
        assert_eq!(parse("x"), (2, "not of the form key = value"));
        assert_eq!(parse("[x]"), (2, "not the name of a role"));
        assert_eq!(parse("[identity]\n[identity]"), (3, "this role is recorded twice"));
        assert_eq!(parse("[identity]\n1 ->"), (3, "not of the form `ms -> bytes`"));
        assert_eq!(parse("[identity]\n-1 -> a"), (3, "a time is from 0 to 1e9 ms"));
        for bytes in ["\\", "\\x0", "\\q", "µ", "\\xzz"] {
            assert_eq!(parse(&format!("[identity]\n1 -> {bytes}")).0, 3, "{bytes}");
        }
    }
}
