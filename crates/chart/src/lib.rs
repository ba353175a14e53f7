//! Charts as SVG text: lines and points with error bars, bands, rules, categorical heat maps.
//!
//! The same chart gives the same bytes. Colours come from CSS classes, so that a chart follows the
//! light or dark theme of its page. Series differ in marker and colour, and the palette suits
//! colour-blind readers. Each chart has a title and a description for screen readers.
//!
//! `svg` gives a chart for an HTML page with [`STYLE`] in its head; `file` gives a file of its own.

#![deny(clippy::disallowed_methods)]

mod axis;
mod chart;
mod error;
mod heat_map;
mod marker;
mod svg;

pub use axis::{Axis, Scale};
pub use chart::{Band, BandEdge, Chart, Point, Rule, Series, Stroke, legend};
pub use error::ChartError;
pub use heat_map::{Category, HeatMap, Tone};
pub use marker::{COLOURS, Marker};
pub use svg::STYLE;
