//! Text for people: notes on stderr, results on stdout.

use std::{
    fmt::Write as _,
    io::{self, Write},
};

use rig_model::with_causes;

use super::{Failure, screen};

/// Lines for the person at the terminal, broken between words where they are too long for it.
pub(super) fn note(text: &str) {
    let lines: Vec<_> = text.split('\n').map(|line| screen::indented(line, 2)).collect();
    screen::say(&screen::plain(&lines.join("\n")));
}

/// Writes a result for people to stdout.
pub(super) fn print(text: &str) -> Result<(), Failure> {
    write(&screen::plain(text))
}

fn write(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    writeln!(out, "{text}")
        .and_then(|()| out.flush())
        .map_err(|source| Failure::System { what: "stdout", source })
}

/// A result as JSON.
pub(super) fn print_json(value: &impl serde::Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string(value)
        .map_err(|error| Failure::System { what: "stdout", source: error.into() })?;
    write(&text)
}

/// The end of a command whose results were printed: its verdict is that also where they could not be, such as to a pipe that was
/// closed.
pub(super) fn concluded(
    printed: Result<(), Failure>,
    verdict: Result<(), Failure>,
) -> Result<(), Failure> {
    if let (Err(trouble), Err(_)) = (&printed, &verdict) {
        note(&format!("the results are not printed: {}", with_causes(trouble)));
    }
    verdict.and(printed)
}

/// Names and values, one pair in a line.
pub(super) fn facts(rows: &[(&str, String)]) -> String {
    let width = rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let lines: Vec<_> = rows.iter().map(|(name, fact)| format!("{name:<width$}  {fact}")).collect();
    lines.join("\n")
}

/// Rows of a name and a text, in lines of at most 80 columns.
pub(super) fn wrapped(rows: &[(&str, String)]) -> String {
    let width = rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let mut text = Vec::new();
    for (name, fact) in rows {
        let lines = screen::words_in_lines(fact, COLUMNS - width - 2);
        let name = std::iter::once(*name).chain(std::iter::repeat(""));
        text.extend(name.zip(lines).map(|(name, line)| format!("{name:<width$}  {line}")));
    }
    text.join("\n")
}

/// Largest width of a first column that the other rows take part in.
const FIRST_MAX: usize = 60;

/// Width of a terminal as it is opened.
pub(super) const COLUMNS: usize = 80;

/// Rows under a header, each column as wide as its widest cell; the first column is text, the
/// others are right-aligned numbers.
pub(super) fn columns(header: &[&str], rows: &[Vec<String>]) -> String {
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count());
        cells.chain([header[column].chars().count()]).max().unwrap_or(0)
    };
    let mut widths: Vec<usize> = (0..header.len()).map(width).collect();
    if let Some(first) = widths.first_mut() {
        // A name that is much longer than usual moves its own row alone.
        *first = (*first).min(FIRST_MAX);
    }
    // Writing to a string cannot fail.
    let line = |cells: &mut dyn Iterator<Item = &str>| {
        let mut line = String::new();
        for (column, (cell, &width)) in cells.zip(&widths).enumerate() {
            if column == 0 {
                _ = write!(line, "{cell:<width$}");
            } else {
                _ = write!(line, "  {cell:>width$}");
            }
        }
        line.trim_end().to_owned()
    };
    let mut text = line(&mut header.iter().copied());
    for row in rows {
        text.push('\n');
        text.push_str(&line(&mut row.iter().map(String::as_str)));
    }
    text
}

/// Seconds as a person says them: `41 s`, `12 min 05 s`, `2 h 03 min`.
pub(super) fn duration(seconds: f64) -> String {
    let whole = seconds.max(0.0).round();
    let (hours, minutes) = ((whole / 3600.0).floor(), ((whole / 60.0).floor() % 60.0));
    if hours >= 1.0 {
        format!("{hours} h {minutes:02} min")
    } else if minutes >= 1.0 {
        format!("{minutes} min {:02} s", whole % 60.0)
    } else {
        format!("{whole} s")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_said_as_a_person_says_them() {
        for (seconds, text) in
            [(0.4, "0 s"), (59.6, "1 min 00 s"), (725.0, "12 min 05 s"), (7380.0, "2 h 03 min")]
        {
            assert_eq!(duration(seconds), text);
        }
    }

    #[test]
    fn columns_line_up() {
        let rows =
            [vec!["one".to_owned(), "1.0".to_owned()], vec!["b".to_owned(), "22.0".to_owned()]];
        assert_eq!(columns(&["name", "Hz"], &rows), "name    Hz\none    1.0\nb     22.0");
        let long = "n".repeat(200);
        let text = columns(&["name", "Hz"], &[vec![long.clone(), "1".into()], rows[0].clone()]);
        let lines: Vec<_> = text.lines().map(|line| line.chars().count()).collect();
        assert_eq!(lines, [FIRST_MAX + 5, 205, FIRST_MAX + 5]);
    }
}
