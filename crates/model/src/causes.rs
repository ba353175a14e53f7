//! An error as a person reads it.

use std::{error::Error, fmt::Write};

/// An error and all that caused it, in one line: `a: b: c`.
///
/// No message repeats its cause: an error of rigd has its cause as its source, or is transparent.
pub fn with_causes(error: &(dyn Error + 'static)) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(source) = cause {
        // Writing to a string cannot fail.
        _ = write!(text, ": {source}");
        cause = source.source();
    }
    text
}
