//! What became of the aim of the protocol: each part of a touch, expected and as it came.

use maud::{Markup, html};

use super::element::{dash, table, text};
use crate::{
    results::{RunResults, aim::AimSummary},
    units::fixed,
};

/// The sentence about the aim, and the table of its parts.
pub(super) fn section(results: &RunResults, aim: &AimSummary) -> Markup {
    let heads = ["part", "time, s", "expected", "standard deviation, %", "expected"];
    let cell = |value: Option<f64>| value.map_or_else(dash, |value| text(fixed(value, 2)));
    let row = |name: &str, cells: [Option<f64>; 4]| {
        let mut row = vec![text(name)];
        row.extend(cells.map(cell));
        row
    };
    let of_part = aim.parts.iter().map(|part| {
        let cells = [part.seconds, part.expected_seconds, part.percent, part.expected_percent];
        row(&part.part, cells)
    });
    let together =
        [aim.seconds, Some(aim.expected_seconds), aim.percent, Some(aim.expected_percent)];
    let worst = [None, None, aim.worst_percent, Some(aim.expected_worst_percent)];
    let rows: Vec<_> =
        of_part.chain([row("together", together), row("widest touch", worst)]).collect();
    let caption = "Means over the touches, and root mean squares of the standard deviations of their stiffness. \
                   Sensor and model, which the touches share, are not in them.";
    let is_missed = aim.is_reached == Some(false);
    let sentence = format!("Aim: {}.", aim.sentence(results.run.status));
    let settings = [
        format!("contact_sweep.target_sigma_hz = {}", aim.contact_sigma_hz),
        format!("no_load_sweep.target_sigma_hz = {}", aim.no_load_sigma_hz),
        format!("approach.fine_step_mm = {}", aim.fine_step_mm),
        format!("no_load = \"{}\"", aim.no_load),
    ];
    let stated = if aim.stated.is_empty() {
        "all chosen for the aim.".to_owned()
    } else {
        format!("of which the protocol states {}.", aim.stated.join(", "))
    };
    html! {
        @if is_missed { p.alarm { (sentence) } } @else { p { (sentence) } }
        (table(caption, &heads, &rows))
        p { "Settings: " (settings.join(", ")) "; " (stated) }
    }
}
