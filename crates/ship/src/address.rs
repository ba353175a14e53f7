//! Where an object store is, as a person writes it.

use std::{fmt, path::PathBuf, str::FromStr};

/// The address of an object store.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// `folder:DIR`: a directory of this computer, or one that it has mounted.
    Folder(PathBuf),
    /// `s3://BUCKET` or `s3://BUCKET/PREFIX`: a bucket of S3, or the objects in it whose keys begin so. The characters are
    /// those that no program writes in another way: letters, digits, `.`, `_`, `-`, `=` and `/`.
    S3 {
        /// Name of the bucket.
        bucket: String,
        /// The beginning of all keys, without a slash at its end; empty without one.
        prefix: String,
    },
}

/// A text that is no address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{text}` is no object store: give `folder:DIR` or `s3://BUCKET/PREFIX`, in letters, digits, `.`, `_`, `-`, `=` and `/`"
)]
pub struct AddressError {
    text: String,
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        if let Some(place) = text.strip_prefix("s3://") {
            let (bucket, prefix) = place.split_once('/').unwrap_or((place, ""));
            let is_kept = |byte: u8| byte.is_ascii_alphanumeric() || b".-".contains(&byte);
            let is_kept_in_key = |byte: u8| is_kept(byte) || b"_=/".contains(&byte);
            let prefix = prefix.trim_matches('/');
            let is_key = prefix.bytes().all(is_kept_in_key)
                && (prefix.is_empty()
                    || !prefix.split('/').any(|part| ["", ".", ".."].contains(&part)));
            if !bucket.is_empty() && bucket.bytes().all(is_kept) && is_key {
                let prefix = prefix.to_owned();
                return Ok(Self::S3 { bucket: bucket.to_owned(), prefix });
            }
        }
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
            Self::S3 { bucket, prefix } if prefix.is_empty() => write!(f, "s3://{bucket}"),
            Self::S3 { bucket, prefix } => write!(f, "s3://{bucket}/{prefix}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_read_as_it_is_written() {
        for text in ["folder:/archive", "folder:a b", "folder:c:d", "s3://a-b.c", "s3://b/c/d"] {
            assert_eq!(
                text.parse::<Address>().map(|address| address.to_string()).as_deref(),
                Ok(text)
            );
        }
        for wrong in [
            "",
            "folder:",
            "/archive",
            "ftp://x",
            "folder",
            "s3://",
            "s3:///a",
            "s3://a b",
            "s3://a/b c",
            "s3://a/b//c",
            "s3://a/../c",
            "s3://a/%20",
        ] {
            assert!(wrong.parse::<Address>().is_err(), "{wrong}");
        }
    }
}
