//! Charts with two axes.

mod draw;
mod ends;
mod legend;
mod series;
#[cfg(test)]
mod tests;

pub use legend::legend;
pub use series::{Band, BandEdge, Point, Rule, Series, Stroke};

use crate::Axis;

/// A chart with two axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// The title, drawn above the chart.
    pub title: String,
    /// Description for screen readers.
    pub description: String,
    /// Width and height in pixels; a page scales the chart to its column.
    pub size_px: (u32, u32),
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// Shaded areas, drawn first.
    pub bands: Vec<Band>,
    /// Dashed lines at one value.
    pub rules: Vec<Rule>,
    /// The data, drawn in order.
    pub series: Vec<Series>,
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
}
