//! Why a chart cannot be drawn.

/// Why a chart cannot be drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ChartError {
    /// An axis has neither values nor a range.
    #[error("chart: the axis `{axis}` has no values and no range")]
    Empty {
        /// Label of the axis.
        axis: String,
    },
    /// A value or a bound that the axis cannot show.
    #[error("chart: the axis `{axis}` cannot show {value}")]
    Unshowable {
        /// Label of the axis.
        axis: String,
        /// The value.
        value: f64,
    },
    /// A range whose ends do not rise.
    #[error("chart: the axis `{axis}` cannot go from {from} to {to}")]
    Range {
        /// Label of the axis.
        axis: String,
        /// Its lower end.
        from: f64,
        /// Its upper end.
        to: f64,
    },
    /// A heat map whose cells do not fill its rows and columns.
    #[error("heat map: {found} cells do not fill {rows} rows of {columns} columns")]
    Cells {
        /// Cells given.
        found: usize,
        /// Rows named.
        rows: usize,
        /// Columns named.
        columns: usize,
    },
    /// A cell of a category that does not exist.
    #[error("heat map: cell {cell} has category {found}, but there are {categories}")]
    Category {
        /// Index of the cell.
        cell: usize,
        /// Its category.
        found: usize,
        /// How many categories there are.
        categories: usize,
    },
}
