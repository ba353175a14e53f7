//! Charts as SVG text: lines and points with error bars, bands, rules, categorical heat maps.
//!
//! The same chart gives the same bytes. Colours come from classes, so that a chart follows the
//! light or dark theme of the page it stands in; the markers differ as well as the colours, and the
//! colours can be told apart by colour-blind readers. Each chart carries its title and a
//! description for those who do not see it. What is drawn is left to the caller.
//!
//! An `svg` goes into an HTML page that has [`STYLE`] in its head; a `file` stands by itself.

mod axis;
mod chart;
mod error;
mod heat_map;
mod marker;
mod svg;

pub use axis::{Axis, Scale};
pub use chart::{Band, Chart, Point, Rule, Series, Stroke, legend};
pub use error::ChartError;
pub use heat_map::{Category, HeatMap, Tone};
pub use marker::Marker;
pub use svg::Escaped;

/// The style sheet of all charts.
pub const STYLE: &str = include_str!("style.css");

/// How many colours there are; larger indices begin again.
pub const COLOURS: usize = 7;
