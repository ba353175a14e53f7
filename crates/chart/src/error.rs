//! Errors of drawing.

/// A chart that cannot be drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ChartError {
    /// An axis has no values and no range.
    #[error("chart: the axis `{axis}` has no values and no range")]
    Empty {
        /// Label of the axis.
        axis: String,
    },
    /// The axis cannot show a value or a bound.
    #[error("chart: the axis `{axis}` cannot show {value}")]
    Unshowable {
        /// Label of the axis.
        axis: String,
        /// The value or bound.
        value: f64,
    },
    /// The ends of a range do not rise.
    #[error("chart: the axis `{axis}` cannot go from {from} to {to}")]
    Range {
        /// Label of the axis.
        axis: String,
        /// Lower end of the range.
        from: f64,
        /// Upper end of the range.
        to: f64,
    },
    /// The cells of a heat map do not fill its rows and columns.
    #[error("heat map: {found} cells do not fill {rows} rows of {columns} columns")]
    Cells {
        /// Number of cells.
        found: usize,
        /// Number of rows.
        rows: usize,
        /// Number of columns.
        columns: usize,
    },
    /// A cell has a category that does not exist.
    #[error("heat map: cell {cell} has category {found}, but there are {categories}")]
    Category {
        /// Index of the cell.
        cell: usize,
        /// Category of the cell.
        found: usize,
        /// Number of categories.
        categories: usize,
    },
}
