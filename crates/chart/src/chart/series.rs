//! The contents of a chart: series, bands and rules.

use crate::Marker;

/// One data series.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend; `None` omits the entry.
    pub name: Option<String>,
    /// Name beside the plot, at the last point; `None` omits it.
    pub end: Option<String>,
    /// The points, in drawing order.
    pub points: Vec<Point>,
    /// Index of the colour.
    pub colour: usize,
    /// Shape of the points; `None` draws no points.
    pub marker: Option<Marker>,
    /// Style of the line through the points; `None` draws no line.
    pub stroke: Option<Stroke>,
}

/// The style of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// A solid line.
    Solid,
    /// A dashed line.
    Dashed,
    /// A dotted line.
    Dotted,
}

impl Stroke {
    /// The attributes of a line but its path.
    pub(crate) fn attributes(self, colour: usize) -> String {
        match self {
            Self::Solid => format!("class=\"line s{colour}\""),
            Self::Dashed => format!("class=\"line dashed s{colour}\""),
            Self::Dotted => format!("class=\"line s{colour}\" stroke-dasharray=\"1 4.5\""),
        }
    }
}

/// A data point.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Value on the horizontal axis.
    pub x: f64,
    /// Value on the vertical axis.
    pub y: f64,
    /// Half the length of the error bar; `None` draws no bar.
    pub error: Option<f64>,
    /// Tooltip of the point.
    pub note: Option<String>,
}

impl From<(f64, f64)> for Point {
    fn from((x, y): (f64, f64)) -> Self {
        Self { x, y, error: None, note: None }
    }
}

/// A vertical cut through a band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BandEdge {
    /// Horizontal value.
    pub x: f64,
    /// Lower vertical value.
    pub low: f64,
    /// Upper vertical value.
    pub high: f64,
}

/// A shaded area between two curves.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// Name in the legend; `None` omits the entry.
    pub name: Option<String>,
    /// Edges of the area, in rising order of `x`.
    pub edges: Vec<BandEdge>,
    /// Index of the colour.
    pub colour: usize,
}

/// A dashed line across the chart.
#[derive(Debug, Clone, PartialEq)]
pub enum Rule {
    /// At one value of the horizontal axis.
    AtX {
        /// Value on the horizontal axis.
        value: f64,
        /// Text beside the line.
        label: String,
    },
    /// At one value of the vertical axis.
    AtY {
        /// Value on the vertical axis.
        value: f64,
        /// Text above the line.
        label: String,
    },
}

impl Series {
    /// Points without a line, with the marker of the colour.
    pub fn scatter<P: Into<Point>>(
        name: &str,
        colour: usize,
        points: impl IntoIterator<Item = P>,
    ) -> Self {
        Self {
            name: Some(name.to_owned()),
            end: None,
            points: points.into_iter().map(Into::into).collect(),
            colour,
            marker: Some(Marker::of(colour)),
            stroke: None,
        }
    }

    /// A line without points.
    pub fn line<P: Into<Point>>(
        name: &str,
        colour: usize,
        points: impl IntoIterator<Item = P>,
    ) -> Self {
        let stroke = Some(Stroke::Solid);
        Self { marker: None, stroke, ..Self::scatter(name, colour, points) }
    }

    /// This series with its name beside the plot instead of in the legend.
    #[must_use]
    pub fn named_at_end(mut self) -> Self {
        self.end = self.name.take();
        self
    }

    /// This series in another colour.
    #[must_use]
    pub const fn coloured(mut self, colour: usize) -> Self {
        self.colour = colour;
        self
    }

    /// An entry of the legend alone, in grey.
    pub fn key(name: &str, marker: Option<Marker>, stroke: Option<Stroke>) -> Self {
        const GREY: usize = 6;
        Self { marker, stroke, ..Self::scatter(name, GREY, Vec::<Point>::new()) }
    }

    /// A line through points, with the marker of the colour.
    pub fn joined<P: Into<Point>>(
        name: &str,
        colour: usize,
        points: impl IntoIterator<Item = P>,
    ) -> Self {
        Self { stroke: Some(Stroke::Solid), ..Self::scatter(name, colour, points) }
    }
}
