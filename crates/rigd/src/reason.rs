//! The reason that a person gives for the journal.

use serde::{Deserialize, Deserializer, de};

/// A text without a reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the reason is empty; write why, for those who read the journal")]
pub(crate) struct NoReason;

/// The reason in a text, without the blanks around it.
///
/// # Errors
/// [`NoReason`] for a blank text.
pub(crate) fn reason(text: &str) -> Result<String, NoReason> {
    let reason = text.trim();
    if reason.is_empty() { Err(NoReason) } else { Ok(reason.to_owned()) }
}

/// Reads the reason in a form of a client; a blank one is refused.
pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    reason(&String::deserialize(deserializer)?).map_err(de::Error::custom)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blank_text_is_no_reason() {
        assert_eq!(reason(" a crack\n"), Ok("a crack".to_owned()));
        for blank in ["", " ", "\t\n"] {
            assert_eq!(reason(blank), Err(NoReason));
        }
    }
}
