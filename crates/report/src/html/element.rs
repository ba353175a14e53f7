//! The elements that every section of the report uses.

use maud::{Markup, PreEscaped, Render, html};
use rig_chart::{Chart, ChartError};

/// A table: its caption, the heads of its columns, its rows. The first column names the rows.
pub(super) fn table(caption: &str, heads: &[impl Render], rows: &[Vec<Markup>]) -> Markup {
    html! {
        // A wide table scrolls alone on a small screen, also by keyboard.
        div.scroll tabindex="0" role="region" aria-label=(caption) {
            table {
                caption { (caption) }
                thead { tr { @for head in heads { th scope="col" { (head) } } } }
                tbody {
                    @for row in rows {
                        tr {
                            @for (column, content) in row.iter().enumerate() {
                                @if column == 0 { th scope="row" { (content) } }
                                @else { td { (content) } }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Text in a table.
pub(super) fn text(text: impl Render) -> Markup {
    html! { (text) }
}

/// A missing value in a table.
pub(super) fn dash() -> Markup {
    text("–")
}

/// Text that a person should not overlook.
pub(super) fn fault(text: &str) -> Markup {
    html! { span.fault { (text) } }
}

/// A remark in the place of a missing figure or table.
pub(super) fn note(text: &str) -> Markup {
    html! { p.note { (text) } }
}

/// Charts with their caption.
pub(super) fn figure(charts: &Markup, caption: &str) -> Markup {
    html! { figure { (charts) figcaption { (caption) } } }
}

/// Charts side by side with their caption.
pub(super) fn figure_row(charts: &Markup, caption: &str) -> Markup {
    figure(&html! { div.row { (charts) } }, caption)
}

/// A chart, or the reason why it cannot be drawn: a report is never lost for a figure.
pub(super) fn drawn(chart: &Chart, id: &str) -> Markup {
    svg(chart.svg(id))
}

fn svg(svg: Result<String, ChartError>) -> Markup {
    // The chart escapes its texts.
    svg.map_or_else(|error| note(&error.to_string()), PreEscaped)
}
