//! Heat maps of categories, such as right, refused and wrong.

use crate::{
    ChartError,
    svg::{self, Coordinate, Escaped, FONT_PX, Svg, width_of},
};

/// The rating of a category; it gives the colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// A correct result.
    Good,
    /// Not correct, but detected.
    Fair,
    /// Not correct and not detected.
    Bad,
    /// No rating.
    None,
}

/// A category of cells.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Category {
    /// Name in the legend.
    pub name: String,
    /// Rating, which gives the colour.
    pub tone: Tone,
    /// Symbol in each cell, so that the map can be read without colour; may be empty.
    pub symbol: String,
}

/// A map of cells, each of one category.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HeatMap {
    /// The title, drawn above the map.
    pub title: String,
    /// Description for screen readers.
    pub description: String,
    /// Label of the columns.
    pub x_label: String,
    /// Label of the rows.
    pub y_label: String,
    /// Names of the columns, from the left.
    pub columns: Vec<String>,
    /// Names of the rows, from the top.
    pub rows: Vec<String>,
    /// Categories of the cells, in the order of the legend.
    pub categories: Vec<Category>,
    /// Index of the category of each cell, row by row.
    pub cells: Vec<usize>,
}

const CELL_HEIGHT: f64 = 24.0;

impl HeatMap {
    /// The map for an HTML page. `id` must be unique there.
    ///
    /// # Errors
    /// [`ChartError`] when the cells do not fit the rows, columns and categories.
    pub fn svg(&self, id: &str) -> Result<String, ChartError> {
        self.check()?;
        let widest =
            |names: &[String]| names.iter().map(|name| width_of(name, FONT_PX)).fold(0.0, f64::max);
        let cell_width = (widest(&self.columns) + 10.0).max(30.0);
        let (left, top) = (widest(&self.rows) + 34.0, 56.0);
        let (n_columns, n_rows) = (self.columns.len() as f64, self.rows.len() as f64);
        let (right, bottom) = (left + n_columns * cell_width, top + n_rows * CELL_HEIGHT);
        let keys: f64 = self.categories.iter().map(|key| key_width(&key.name)).sum();
        let title = width_of(&self.title, 14.0) * 1.05;
        let width = (right + 14.0).max(keys).max(title);
        // Rounded up to whole pixels; far below the range of the integers.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let size_px = (width.ceil() as u32, (bottom + 46.0).ceil() as u32);

        let mut svg = Svg::begin(id, size_px, &self.title, &self.description);
        svg.text("title", (2.0, 15.0), "start", &self.title);
        self.draw_keys(&mut svg);
        for (index, &category) in self.cells.iter().enumerate() {
            let (row, column) = (index / self.columns.len(), index % self.columns.len());
            let x = left + column as f64 * cell_width;
            let y = top + row as f64 * CELL_HEIGHT;
            let note = format!(
                "{}, {}: {}",
                self.rows[row], self.columns[column], self.categories[category].name
            );
            draw_cell(&mut svg, (x, y), cell_width, &self.categories[category], &note);
        }
        for (row, name) in self.rows.iter().enumerate() {
            let y = top + (row as f64 + 0.5) * CELL_HEIGHT + 4.0;
            svg.text("tick", (left - 7.0, y), "end", name);
        }
        for (column, name) in self.columns.iter().enumerate() {
            let x = left + (column as f64 + 0.5) * cell_width;
            svg.text("tick", (x, bottom + 16.0), "middle", name);
        }
        svg.text("label", (f64::midpoint(left, right), bottom + 37.0), "middle", &self.x_label);
        let (middle, label) = (Coordinate(f64::midpoint(top, bottom)), Escaped(&self.y_label));
        svg.add(format_args!(
            "<text class=\"label\" transform=\"translate(13 {middle}) rotate(-90)\" \
             text-anchor=\"middle\">{label}</text>\n"
        ));
        Ok(svg.end())
    }

    /// The map as an SVG file with its own style sheet.
    ///
    /// # Errors
    /// [`ChartError`] when the cells do not fit the rows, columns and categories.
    pub fn file(&self) -> Result<String, ChartError> {
        Ok(svg::file(&self.svg("map")?))
    }

    fn check(&self) -> Result<(), ChartError> {
        let (rows, columns) = (self.rows.len(), self.columns.len());
        if self.cells.is_empty() || self.cells.len() != rows * columns {
            return Err(ChartError::Cells { found: self.cells.len(), rows, columns });
        }
        let categories = self.categories.len();
        match self.cells.iter().position(|&category| category >= categories) {
            Some(cell) => Err(ChartError::Category { cell, found: self.cells[cell], categories }),
            None => Ok(()),
        }
    }

    fn draw_keys(&self, svg: &mut Svg) {
        let mut x = 2.0;
        for key in &self.categories {
            draw_cell(svg, (x, 25.0), 22.0, key, "");
            svg.text("key", (x + 28.0, 41.0), "start", &key.name);
            x += key_width(&key.name);
        }
    }
}

fn key_width(name: &str) -> f64 {
    28.0 + width_of(name, FONT_PX) + 18.0
}

fn draw_cell(svg: &mut Svg, (x, y): (f64, f64), width: f64, category: &Category, note: &str) {
    let (tone, glyph) = match category.tone {
        Tone::Good => ("good", "glyph"),
        Tone::Fair => ("fair", "glyph"),
        Tone::Bad => ("bad", "on-bad"),
        Tone::None => ("none", "glyph"),
    };
    let (left, top, wide) = (Coordinate(x), Coordinate(y), Coordinate(width));
    let note =
        if note.is_empty() { String::new() } else { format!("<title>{}</title>", Escaped(note)) };
    svg.add(format_args!(
        "<rect class=\"cell {tone}\" x=\"{left}\" y=\"{top}\" width=\"{wide}\" \
         height=\"{CELL_HEIGHT}\">{note}</rect>\n"
    ));
    if !category.symbol.is_empty() {
        let middle = (x + width / 2.0, y + CELL_HEIGHT / 2.0 + 4.0);
        svg.text(glyph, middle, "middle", &category.symbol);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map() -> HeatMap {
        let category = |name: &str, tone, symbol: &str| Category {
            name: name.to_owned(),
            tone,
            symbol: symbol.to_owned(),
        };
        HeatMap {
            title: "where it fails".to_owned(),
            description: "a map".to_owned(),
            x_label: "x".to_owned(),
            y_label: "y".to_owned(),
            columns: vec!["a".to_owned(), "b".to_owned()],
            rows: vec!["1".to_owned(), "2".to_owned(), "3".to_owned()],
            categories: vec![category("right", Tone::Good, ""), category("wrong", Tone::Bad, "×")],
            cells: vec![0, 0, 0, 1, 1, 1],
        }
    }

    #[test]
    fn each_cell_has_its_category_in_colour_symbol_and_words() {
        let svg = map().svg("m").unwrap();
        assert_eq!(svg.matches("class=\"cell good\"").count(), 3 + 1, "and one in the legend");
        assert_eq!(svg.matches("class=\"cell bad\"").count(), 3 + 1);
        assert_eq!(svg.matches(">×</text>").count(), 3 + 1);
        assert_eq!(svg.matches("<title>2, b: wrong</title>").count(), 1);
        assert_eq!(svg.matches("<title>2, a: right</title>").count(), 1);
    }

    #[test]
    fn cells_that_do_not_fit_are_refused() {
        let refusal = HeatMap { cells: vec![0; 5], ..map() }.svg("m").unwrap_err();
        assert_eq!(refusal, ChartError::Cells { found: 5, rows: 3, columns: 2 });
        let nothing = HeatMap { cells: vec![], rows: vec![], ..map() }.svg("m").unwrap_err();
        assert_eq!(nothing, ChartError::Cells { found: 0, rows: 0, columns: 2 });
        let refusal = HeatMap { cells: vec![0, 0, 0, 0, 2, 0], ..map() }.svg("m").unwrap_err();
        assert_eq!(refusal, ChartError::Category { cell: 4, found: 2, categories: 2 });
    }
}
