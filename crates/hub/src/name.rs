//! Names of benches.

use std::{fmt, str::FromStr};

/// Longest name of a role of PostgreSQL, bytes.
const ROLE_MAX: usize = 63;

/// The laboratory and the name of a bench, as `LAB/NAME`. It is also the name of its role, and of its certificate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BenchName {
    /// The laboratory.
    pub lab: String,
    /// The bench in it.
    pub name: String,
}

/// A text that cannot name a bench.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{text}` cannot name a bench: give LAB/NAME with at most {ROLE_MAX} characters, each part of letters from a to z, \
     digits, `.`, `_` or `-`, the first a letter or a digit"
)]
pub struct NameError {
    text: String,
}

impl FromStr for BenchName {
    type Err = NameError;

    fn from_str(text: &str) -> Result<Self, NameError> {
        let is_kept = |byte: u8| byte.is_ascii_alphanumeric() || b"._-".contains(&byte);
        let is_label = |label: &str| {
            label.bytes().all(is_kept)
                && label.bytes().next().is_some_and(|first| first.is_ascii_alphanumeric())
        };
        match text.split_once('/') {
            Some((lab, name)) if is_label(lab) && is_label(name) && text.len() <= ROLE_MAX => {
                Ok(Self { lab: lab.to_owned(), name: name.to_owned() })
            }
            _ => Err(NameError { text: text.to_owned() }),
        }
    }
}

impl fmt::Display for BenchName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.lab, self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_a_laboratory_and_a_bench() {
        let name: BenchName = "soft-matter/left.2".parse().unwrap();
        assert_eq!((name.lab.as_str(), name.name.as_str()), ("soft-matter", "left.2"));
        assert_eq!(name.to_string(), "soft-matter/left.2");
        let long = format!("{}/b", "a".repeat(62));
        for wrong in
            ["", "left", "/left", "lab/", "a/b/c", "lab/le ft", "lab/\"", "lab/é", "_a/b", &long]
        {
            assert!(wrong.parse::<BenchName>().is_err(), "{wrong}");
        }
    }
}
