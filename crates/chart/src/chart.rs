//! Charts with two axes.

mod draw;
mod legend;
#[cfg(test)]
mod tests;

pub use legend::legend;

use crate::{Axis, ChartError, Marker, svg};

/// A chart with two axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// The title, drawn above the chart.
    pub title: String,
    /// What there is to see, for those who do not see it.
    pub description: String,
    /// Width and height in pixels; a page scales the chart to its column.
    pub size_px: (u32, u32),
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// Shaded areas, drawn first.
    pub bands: Vec<Band>,
    /// Lines at one value.
    pub rules: Vec<Rule>,
    /// The data, drawn in order.
    pub series: Vec<Series>,
}

/// Points that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// What the legend says; without a name it is left out there.
    pub name: Option<String>,
    /// The points, in the order in which they are joined.
    pub points: Vec<Point>,
    /// Which colour, from 0.
    pub colour: usize,
    /// The shape of the points, when they are drawn.
    pub marker: Option<Marker>,
    /// The line through the points, when there is one.
    pub stroke: Option<Stroke>,
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// Solid.
    Solid,
    /// Dashed.
    Dashed,
}

/// A point.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Value on the horizontal axis.
    pub x: f64,
    /// Value on the vertical axis.
    pub y: f64,
    /// Half the length of the error bar, when there is one.
    pub error: Option<f64>,
    /// What is said when the pointer rests on it.
    pub note: Option<String>,
}

impl From<(f64, f64)> for Point {
    fn from((x, y): (f64, f64)) -> Self {
        Self { x, y, error: None, note: None }
    }
}

/// A shaded area between two curves.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// What the legend says; without a name it is left out there.
    pub name: Option<String>,
    /// Horizontal value, lower and upper vertical value, in rising order of the first.
    pub edges: Vec<(f64, f64, f64)>,
    /// Which colour, from 0.
    pub colour: usize,
}

/// A dashed line across the chart.
#[derive(Debug, Clone, PartialEq)]
pub enum Rule {
    /// At one value of the horizontal axis.
    AtX {
        /// The value.
        value: f64,
        /// What is written beside it.
        label: String,
    },
    /// At one value of the vertical axis.
    AtY {
        /// The value.
        value: f64,
        /// What is written above it.
        label: String,
    },
}

impl Series {
    /// Points without a line, in the shape that goes with the colour.
    pub fn scatter<P: Into<Point>>(
        name: &str,
        colour: usize,
        points: impl IntoIterator<Item = P>,
    ) -> Self {
        Self {
            name: Some(name.to_owned()),
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

    /// A line through points, in the shape that goes with the colour.
    pub fn joined<P: Into<Point>>(
        name: &str,
        colour: usize,
        points: impl IntoIterator<Item = P>,
    ) -> Self {
        Self { stroke: Some(Stroke::Solid), ..Self::scatter(name, colour, points) }
    }
}

impl Chart {
    /// A chart without data, 720 by 400 pixels.
    pub fn new(title: &str, description: &str, x: Axis, y: Axis) -> Self {
        Self {
            title: title.to_owned(),
            description: description.to_owned(),
            size_px: (720, 400),
            x,
            y,
            bands: Vec::new(),
            rules: Vec::new(),
            series: Vec::new(),
        }
    }

    /// The chart, to be put into a page. `id` must be unique there.
    ///
    /// # Errors
    /// [`ChartError`] when an axis cannot show a value or has none.
    pub fn svg(&self, id: &str) -> Result<String, ChartError> {
        draw::draw(self, id)
    }

    /// The chart as a file by itself.
    ///
    /// # Errors
    /// [`ChartError`] when an axis cannot show a value or has none.
    pub fn file(&self) -> Result<String, ChartError> {
        Ok(svg::file(&self.svg("chart")?))
    }
}
