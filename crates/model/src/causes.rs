//! An error as a person reads it.

use std::{any::Any, error::Error, fmt::Write};

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

/// The message of a panic that was caught.
pub fn panic_message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();
    let text = text.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    text.unwrap_or("without a message")
}
