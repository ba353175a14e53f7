//! Progress of a study on standard error.

use indicatif::{ProgressBar, ProgressStyle};

/// A progress bar.
pub(crate) fn bar(pieces: usize, what: &str) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {pos} of {len} {msg}, {eta} left")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(pieces as u64).with_style(style).with_message(what.to_owned())
}
