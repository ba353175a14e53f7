//! The chain of digests.

use std::fmt;

use sha2::{Digest as _, Sha256};

/// SHA-256 over a record and the digest before it.
///
/// It is taken over the 32 bytes of the digest before (zeros before the first record), the number
/// of the record in its run, its time in µs, and its kind and its JSON. Numbers enter as eight
/// big-endian bytes, texts behind their length in bytes, so that no two different records give the
/// same input.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Digest([u8; 32]);

impl Digest {
    /// The digest before the first record of a run.
    pub const START: Self = Self([0; 32]);

    /// A stored digest.
    pub const fn from_bytes(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// The 32 bytes of the digest.
    pub const fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }

    /// The digest of the record that follows this one.
    pub fn next(&self, seq: u64, rig_us: u64, kind: &str, payload: &str) -> Self {
        use DigestPart::{Digest, Number, Text};
        Self::of([Digest(*self), Number(seq), Number(rig_us), Text(kind), Text(payload)])
    }

    /// SHA-256 over the parts, in this order.
    pub fn of<'a>(parts: impl IntoIterator<Item = DigestPart<'a>>) -> Self {
        let mut hash = Sha256::new();
        for part in parts {
            match part {
                DigestPart::Digest(digest) => hash.update(digest.0),
                DigestPart::Number(number) => hash.update(number.to_be_bytes()),
                DigestPart::Text(text) => {
                    hash.update((text.len() as u64).to_be_bytes());
                    hash.update(text);
                }
            }
        }
        Self(hash.finalize().into())
    }
}

/// An input of a digest.
#[derive(Debug, Clone, Copy)]
pub enum DigestPart<'a> {
    /// The 32 bytes of a digest.
    Digest(Digest),
    /// A whole number, as eight big-endian bytes.
    Number(u64),
    /// A text, behind its length in bytes.
    Text(&'a str),
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Digest({self})")
    }
}
