//! Where an object store is, as a person writes it.

use std::{fmt, path::PathBuf, str::FromStr};

/// The address of an object store.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// `folder:DIR`: a directory of this computer, or one that it has mounted.
    Folder(PathBuf),
}

/// A text that is no address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{text}` is no object store: give `folder:DIR`")]
pub struct AddressError {
    text: String,
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        match text.split_once(':') {
            Some(("folder", directory)) if !directory.is_empty() => {
                Ok(Self::Folder(directory.into()))
            }
            _ => Err(AddressError { text: text.to_owned() }),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(directory) => write!(f, "folder:{}", directory.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_read_as_it_is_written() {
        for text in ["folder:/archive", "folder:a b", "folder:c:d"] {
            assert_eq!(
                text.parse::<Address>().map(|address| address.to_string()).as_deref(),
                Ok(text)
            );
        }
        for wrong in ["", "folder:", "/archive", "ftp://x", "folder"] {
            assert!(wrong.parse::<Address>().is_err(), "{wrong}");
        }
    }
}
