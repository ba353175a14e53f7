//! The output on stderr: lines that stay, and below them one line with the progress of a run.
//!
//! The cursor never goes up. At any width of the terminal, drawing can damage only the progress
//! line.

use std::{
    borrow::Cow,
    env,
    io::{self, IsTerminal, Write},
    sync::{Mutex, MutexGuard, PoisonError},
};

use rig_system::terminal;
use unicode_width::{UnicodeWidthChar, UnicodeWidthStr};

/// Width if the system does not report one.
const COLUMNS: usize = 80;
/// Clears the line of the cursor.
const ERASE: &str = "\r\x1b[K";

static SCREEN: Mutex<Screen> = Mutex::new(Screen { progress: String::new() });

struct Screen {
    /// The last progress line; empty if there is none.
    progress: String,
}

/// Columns of the terminal, if stderr is one on which a line can be drawn again.
pub(super) fn columns() -> Option<usize> {
    let stderr = io::stderr();
    let is_dumb = env::var_os("TERM").is_some_and(|term| term == "dumb");
    if !stderr.is_terminal() || is_dumb || !terminal::can_redraw() {
        return None;
    }
    Some(terminal::columns().unwrap_or(COLUMNS))
}

/// A colour of the terminal. It repeats what a word or a mark says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Colour {
    Red,
    Green,
}

/// Whether stderr is a terminal with colours, and `NO_COLOR` is not set.
pub(super) fn is_coloured() -> bool {
    let is_plain = env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    !is_plain && columns().is_some()
}

/// A text for stderr, in a colour where there are colours.
pub(super) fn painted(text: &str, colour: Colour) -> String {
    if !is_coloured() {
        return text.to_owned();
    }
    let code = match colour {
        Colour::Red => 31,
        Colour::Green => 32,
    };
    format!("\x1b[{code}m{text}\x1b[0m")
}

/// Texts of other people and of devices, which must not give orders to the terminal: what is neither a letter nor the
/// end of a line or of a column is shown as `�`.
pub(super) fn plain(text: &str) -> Cow<'_, str> {
    let is_order = |letter: char| {
        let is_direction = matches!(letter, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        is_direction || letter.is_control() && !matches!(letter, '\n' | '\t')
    };
    if text.contains(is_order) {
        Cow::Owned(text.replace(is_order, "\u{fffd}"))
    } else {
        Cow::Borrowed(text)
    }
}

/// Says something that stays. A terminal that has gone needs no word.
pub(super) fn say(text: &str) {
    write(&format!("{text}\n"));
}

/// Says something that a person must not miss: on a terminal it is broken between clauses where it
/// is too long for a line, and between words where a clause is.
pub(super) fn say_clearly(text: &str) {
    match columns() {
        Some(columns) => say(&plain(&broken(text, columns))),
        None => say(&plain(text)),
    }
}

/// Draws the line that tells how far a run has come, cut to the width of the terminal; an empty text
/// takes it away.
pub(super) fn show_progress(text: &str) {
    let Some(columns) = columns() else { return };
    let mut screen = lock();
    // A character in the last column would move the cursor to the next line on some terminals.
    let text = cut(&plain(text), columns - 1);
    if screen.progress != text {
        _ = write!(io::stderr(), "{ERASE}{text}");
        screen.progress = text;
    }
}

/// The log, which must not be drawn over either.
pub(super) struct Log;

impl Write for Log {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        write(&String::from_utf8_lossy(bytes));
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Writes whole lines above the line of progress.
fn write(lines: &str) {
    let progress = &lock().progress;
    let erase = if progress.is_empty() { "" } else { ERASE };
    _ = write!(io::stderr(), "{erase}{lines}{progress}");
}

fn lock() -> MutexGuard<'static, Screen> {
    // The text is complete even after a panic of another thread.
    SCREEN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// As much of a text as fits.
fn cut(text: &str, columns: usize) -> String {
    if text.width() <= columns {
        return text.to_owned();
    }
    let mut left = columns.saturating_sub(1);
    let fits = |character: &char| match left.checked_sub(character.width().unwrap_or(0)) {
        Some(rest) => {
            left = rest;
            true
        }
        None => false,
    };
    let cut: String = text.chars().take_while(fits).collect();
    if columns == 0 { cut } else { format!("{cut}…") }
}

/// A text in lines that fit.
fn broken(text: &str, columns: usize) -> String {
    if text.width() <= columns {
        return text.to_owned();
    }
    let mut clauses = vec![String::new()];
    for word in text.split_inclusive(' ') {
        if let Some(clause) = clauses.last_mut() {
            clause.push_str(word);
        }
        // A point within a number ends no clause.
        if word.trim_end().ends_with([';', '.']) {
            clauses.push(String::new());
        }
    }
    let lines = clauses.iter().flat_map(|clause| words_in_lines(clause, columns));
    lines.collect::<Vec<_>>().join("\n")
}

/// A text in lines that fit the terminal, all but the first one indented.
pub(super) fn indented(text: &str, indent: usize) -> String {
    let columns = columns().unwrap_or(usize::MAX);
    if text.width() + indent <= columns {
        return text.to_owned();
    }
    let lines = words_in_lines(text, columns.saturating_sub(indent));
    lines.join(&format!("\n{}", " ".repeat(indent)))
}

/// A text in lines of at most this number of columns, broken between words.
pub(super) fn words_in_lines(text: &str, columns: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.width() + 1 + word.width() <= columns => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_is_too_long_is_cut_and_never_wraps() {
        let text = "12/118 sample 3 of 5, left, 30°; rig time 2 min 04 s, about 20 min 00 s to go";
        for columns in 0..=text.chars().count() + 1 {
            let cut = cut(text, columns);
            assert!(cut.width() <= columns, "{columns}: {cut}");
            assert_eq!(cut == text, columns >= text.chars().count());
        }
        assert_eq!(cut("a\u{5bd2}\u{5929}b", 5), "a\u{5bd2}…");
        assert_eq!(cut("a\u{5bd2}\u{5929}b", 3), "a…");
        assert_eq!(cut("a\u{5bd2}\u{5929}b", 6), "a\u{5bd2}\u{5929}b");
    }

    #[test]
    fn a_text_gives_no_orders_to_the_terminal() {
        assert_eq!(plain("a\tb\n30\u{b0} \u{5bd2}"), "a\tb\n30\u{b0} \u{5bd2}");
        for order in ["\u{1b}[2J", "\u{9b}2J", "\r", "\u{7}", "\u{8}", "\u{7f}", "\u{202e}"] {
            let shown = plain(order).into_owned();
            assert!(shown.starts_with('\u{fffd}') && !shown.contains('\u{1b}'), "{shown:?}");
        }
    }

    #[test]
    fn what_must_be_read_is_broken_between_clauses_and_words() {
        let text = "Put sample 3 under the probe. Press Enter when that is done.";
        assert_eq!(broken(text, 60), text);
        let clauses = "Put sample 3 under the probe.\nPress Enter when that is done.";
        assert_eq!(broken(text, 59), clauses);
        assert_eq!(broken(text, 30), clauses);
        let number = "It was refused: 148.709 Hz lies above the window; skip it or abort.";
        assert_eq!(broken(number, 60), number.replace("; ", ";\n"));
        let words = "Put sample 3\nunder the\nprobe.\nPress Enter\nwhen that is\ndone.";
        assert_eq!(broken(text, 12), words);
        assert_eq!(broken("unbreakable", 3), "unbreakable");
    }
}
