//! A run as it happens: a line for each touch that is done, and one line with the progress.

use rig_report::with_sigma;
use rig_store::Record;
use unicode_width::UnicodeWidthStr;

use super::screen::{self, Colour, painted};

/// Columns for the address of a touch, such as `main/5/left/45/1`.
const ADDRESS: usize = 18;
const RESONANCE: usize = 18;
const BAR: usize = 12;

/// The progress of a run.
#[derive(Debug, Clone)]
pub(super) struct Progress {
    /// Steps done.
    pub(super) step: usize,
    pub(super) steps: usize,
    /// The step under way, such as `sample 3 of 5, left, 30°`.
    pub(super) doing: String,
    /// Least and largest remaining time, s.
    pub(super) remaining_s: [f64; 2],
    /// Resonance and its standard deviation of the sweep under way, Hz.
    pub(super) estimate_hz: Option<[f64; 2]>,
    /// It pauses before the next step.
    pub(super) is_pausing: bool,
}

impl Progress {
    /// Draws the progress line, if stderr is a terminal.
    pub(super) fn draw(&self) {
        if let Some(columns) = screen::columns() {
            screen::show_progress(&self.line(columns));
        }
    }

    /// The line: of the parts, those that fit, the most important ones first.
    fn line(&self, columns: usize) -> String {
        let pausing = if self.is_pausing { "pausing after " } else { "" };
        let mut line = format!("{}/{} {pausing}{}", self.step, self.steps, self.doing);
        let [least_s, most_s] = self.remaining_s;
        let estimate = self.estimate_hz.map(|[hz, sigma_hz]| with_sigma(hz, sigma_hz));
        let after = [
            Some(format!("; {} to go", range(least_s, most_s))),
            estimate.map(|estimate| format!("; {estimate} Hz")),
        ];
        for part in after.into_iter().flatten() {
            if line.width() + part.width() < columns {
                line.push_str(&part);
            }
        }
        if line.width() + BAR + 1 < columns {
            let done = "█".repeat(BAR * self.step.min(self.steps) / self.steps.max(1));
            line = format!("{done:░<BAR$} {line}");
        }
        line
    }
}

/// A remaining time: `20 to 45 s`, `3 to 8 min`, `2.1 to 2.6 h`.
pub(super) fn range(least_s: f64, most_s: f64) -> String {
    let (unit, unit_s, decimals) = match most_s {
        ..120.0 => ("s", 1.0, 0),
        ..7200.0 => ("min", 60.0, 0),
        _ => ("h", 3600.0, 1),
    };
    let of = |seconds: f64| format!("{:.decimals$}", seconds.max(0.0) / unit_s);
    let (least, most) = (of(least_s), of(most_s));
    if least == most { format!("{most} {unit}") } else { format!("{least} to {most} {unit}") }
}

/// Says the outcome of a touch, if the record is one.
pub(super) fn say_touch(record: &Record) {
    match record {
        Record::TouchResult(touch) => {
            let resonance = format!("{} Hz", with_sigma(touch.resonance_hz, touch.sigma_hz));
            let shift = with_sigma(touch.shift_hz, touch.shift_sigma_hz);
            let address = screen::plain(&touch.touch.step);
            let unchecked =
                if touch.is_slip_checked == Some(false) { ", slip not checked" } else { "" };
            screen::say(&format!(
                "{} {address:<ADDRESS$}  {resonance:>RESONANCE$}  shift {shift:>14} Hz{unchecked}",
                painted("✓", Colour::Green),
            ));
        }
        Record::TouchRefused(refused) => {
            let text = format!("{:<ADDRESS$}  refused: {}", refused.touch.step, refused.reason);
            let text = screen::indented(&screen::plain(&text), 2);
            screen::say(&format!("{} {text}", painted("✕", Colour::Red)));
        }
        Record::ReferenceJumped(jumped) => {
            let touches = jumped.touches.join(", ");
            let text = format!(
                "the no-load resonance jumped by {:+.2} Hz; touched since the reference before: {touches}",
                jumped.off_hz
            );
            let text = screen::indented(&screen::plain(&text), 2);
            screen::say(&format!("{} {text}", painted("!", Colour::Red)));
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_progress_line_has_what_fits_and_the_time_first() {
        let progress = Progress {
            step: 59,
            steps: 118,
            doing: "sample 3 of 5, left, 30°".to_owned(),
            remaining_s: [1200.0, 1800.0],
            estimate_hz: Some([142.3181, 0.0123]),
            is_pausing: false,
        };
        for columns in 32..120 {
            let line = progress.line(columns);
            assert!(line.width() < columns, "{columns}: {line}");
            assert!(line.contains("59/118 sample 3 of 5, left, 30°"), "{columns}: {line}");
        }
        let time = "59/118 sample 3 of 5, left, 30°; 20 to 30 min to go";
        assert_eq!(progress.line(60), time);
        assert_eq!(progress.line(80), format!("{time}; 142.318 ± 0.012 Hz"));
        let whole = format!("██████░░░░░░ {time}; 142.318 ± 0.012 Hz");
        assert_eq!(progress.line(100), whole);
    }

    #[test]
    fn a_remaining_time_has_one_unit() {
        for (least_s, most_s, text) in [
            (20.0, 45.0, "20 to 45 s"),
            (44.6, 45.0, "45 s"),
            (180.0, 480.0, "3 to 8 min"),
            (7560.0, 9360.0, "2.1 to 2.6 h"),
        ] {
            assert_eq!(range(least_s, most_s), text);
        }
    }
}
