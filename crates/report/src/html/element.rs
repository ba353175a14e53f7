//! HTML text.

use std::fmt::{self, Write as _};

use rig_chart::Escaped;

/// A table: what it shows, the heads of its columns, its rows.
///
/// The first column names the rows. Cells are HTML already; everything else is text.
pub(crate) fn table(caption: &str, heads: &[String], rows: &[Vec<String>]) -> String {
    let mut html = format!("<table>\n<caption>{}</caption>\n<thead><tr>", Escaped(caption));
    for head in heads {
        add(&mut html, format_args!("<th scope=\"col\">{}</th>", Escaped(head)));
    }
    html.push_str("</tr></thead>\n<tbody>\n");
    for row in rows {
        html.push_str("<tr>");
        for (column, cell) in row.iter().enumerate() {
            if column == 0 {
                add(&mut html, format_args!("<th scope=\"row\">{cell}</th>"));
            } else {
                add(&mut html, format_args!("<td>{cell}</td>"));
            }
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</tbody>\n</table>\n");
    // A wide table scrolls by itself on a small screen, and by keyboard too.
    let label = Escaped(caption);
    format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{label}\">\n{html}</div>\n"
    )
}

/// Appends formatted text.
pub(crate) fn add(text: &mut String, more: fmt::Arguments<'_>) {
    text.write_fmt(more).expect("a string takes all text");
}
