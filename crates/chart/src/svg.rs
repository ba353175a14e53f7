//! Output of SVG text.

use std::fmt::{self, Write as _};

/// The style sheet of all charts.
pub const STYLE: &str = include_str!("style.css");

/// Font size of all texts but titles, px.
pub(crate) const FONT_PX: f64 = 12.0;

/// A chart under construction.
#[derive(Debug, Default)]
pub(crate) struct Svg(String);

impl Svg {
    /// Begins a chart of this size with its title and description.
    ///
    /// `id` must be unique in the page, and a letter followed by letters, digits and `-`.
    pub(crate) fn begin(id: &str, (width, height): (u32, u32), title: &str, text: &str) -> Self {
        let mut svg = Self::default();
        svg.add(format_args!(
            "<svg class=\"chart\" xmlns=\"http://www.w3.org/2000/svg\" \
             width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" role=\"img\" aria-labelledby=\"{id}-t {id}-d\">\n\
             <title id=\"{id}-t\">{}</title>\n<desc id=\"{id}-d\">{}</desc>\n",
            Escaped(title),
            Escaped(text),
        ));
        svg
    }

    /// Appends SVG source without escaping.
    pub(crate) fn add(&mut self, text: fmt::Arguments<'_>) {
        self.0.write_fmt(text).expect("a string takes all text");
    }

    /// Appends a text at a position; `anchor` is `start`, `middle` or `end`.
    pub(crate) fn text(&mut self, class: &str, (x, y): (f64, f64), anchor: &str, text: &str) {
        let (x, y, text) = (Coordinate(x), Coordinate(y), Escaped(text));
        self.add(format_args!(
            "<text class=\"{class}\" x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\">{text}</text>\n"
        ));
    }

    /// Appends a straight line.
    pub(crate) fn line(&mut self, class: &str, from: (f64, f64), to: (f64, f64)) {
        let (x1, y1, x2, y2) =
            (Coordinate(from.0), Coordinate(from.1), Coordinate(to.0), Coordinate(to.1));
        self.add(format_args!("<path class=\"{class}\" d=\"M{x1} {y1}L{x2} {y2}\"/>\n"));
    }

    /// Ends the chart.
    pub(crate) fn end(mut self) -> String {
        self.0.push_str("</svg>\n");
        self.0
    }
}

/// A chart as a file: its text with the style sheet inside.
pub(crate) fn file(svg: &str) -> String {
    let head = svg.find(">\n").map_or(0, |end| end + 2);
    let (open, rest) = svg.split_at(head);
    format!("{open}<style>\n{STYLE}</style>\n{rest}")
}

/// A coordinate, to a hundredth of a pixel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Coordinate(pub(crate) f64);

impl fmt::Display for Coordinate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Adding zero turns minus zero into zero.
        let rounded = (self.0 * 100.0).round() / 100.0 + 0.0;
        write!(f, "{rounded}")
    }
}

/// A text with escaped markup, for XML and HTML.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Escaped<'a>(pub(crate) &'a str);

impl fmt::Display for Escaped<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for character in self.0.chars() {
            match character {
                '&' => f.write_str("&amp;")?,
                '<' => f.write_str("&lt;")?,
                '>' => f.write_str("&gt;")?,
                '"' => f.write_str("&quot;")?,
                other => f.write_char(other)?,
            }
        }
        Ok(())
    }
}

/// Approximate width of a text in the widest font of the style sheet, px.
pub(crate) fn width_of(text: &str, font_px: f64) -> f64 {
    let ems = text.chars().map(|character| match character {
        'i' | 'j' | 'l' | 'I' | '.' | ',' | ':' | ';' | '\'' | '|' | '!' | ' ' => 0.34,
        'm' | 'w' | 'M' | 'W' | '%' => 0.94,
        'A'..='Z' | 'Δ' => 0.7,
        _ => 0.62,
    });
    ems.sum::<f64>() * font_px
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_are_short_and_have_no_minus_zero() {
        let written = [1.0, 0.125, -0.001, 12.3456, 1e4].map(|x| Coordinate(x).to_string());
        assert_eq!(written, ["1", "0.13", "0", "12.35", "10000"]);
    }

    #[test]
    fn text_cannot_become_markup() {
        let text = "<script>\"a\" & b</script>";
        let expected = "&lt;script&gt;&quot;a&quot; &amp; b&lt;/script&gt;";
        assert_eq!(Escaped(text).to_string(), expected);
    }
}
