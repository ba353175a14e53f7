//! The legend: named series and bands in rows.

use super::series::{Band, Series, Stroke};
use crate::{
    COLOURS, Marker,
    svg::{Coordinate, FONT_PX, Svg, width_of},
};

/// Left margin of title and legend, px, so that round line ends are not cut.
pub(super) const INSET: f64 = 2.0;
const ROW_HEIGHT: f64 = 20.0;
/// Width of the symbol before a name, px.
const SYMBOL_WIDTH: f64 = 30.0;
/// Space after a name, px.
const GAP: f64 = 18.0;

/// A separate legend for several charts with the same unnamed series, `width` pixels wide.
pub fn legend(series: &[Series], id: &str, width: u32) -> String {
    let legend = Legend::new(series, &[], f64::from(width), 2.0);
    // A few rows, in whole pixels.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let height = (legend.bottom + 4.0).max(1.0).ceil() as u32;
    let names: Vec<&str> = series.iter().filter_map(|series| series.name.as_deref()).collect();
    let mut svg = Svg::begin(id, (width, height), "Legend", &names.join(", "));
    legend.draw(&mut svg);
    svg.end()
}

/// A legend with the positions of its entries.
#[derive(Debug)]
pub(super) struct Legend {
    entries: Vec<Entry>,
    /// The lower edge of the last row, px.
    pub(super) bottom: f64,
}

#[derive(Debug)]
struct Entry {
    name: String,
    at: (f64, f64),
    colour: usize,
    marker: Option<Marker>,
    stroke: Option<Stroke>,
    is_band: bool,
}

impl Legend {
    /// Lays the entries out in rows of at most `width`, below `top`.
    pub(super) fn new(series: &[Series], bands: &[Band], width: f64, top: f64) -> Self {
        let of_series = series.iter().filter_map(|series| {
            let &Series { colour, marker, stroke, .. } = series;
            Some(Entry {
                name: series.name.clone()?,
                at: (0.0, 0.0),
                colour: colour % COLOURS,
                marker,
                stroke,
                is_band: false,
            })
        });
        let of_bands = bands.iter().filter_map(|band| {
            let (name, at, colour) = (band.name.clone()?, (0.0, 0.0), band.colour % COLOURS);
            Some(Entry { name, at, colour, marker: None, stroke: None, is_band: true })
        });
        let mut entries: Vec<Entry> = of_series.chain(of_bands).collect();
        let mut at = (INSET, top + 12.0);
        for entry in &mut entries {
            let needed = SYMBOL_WIDTH + width_of(&entry.name, FONT_PX);
            if at.0 > INSET && at.0 + needed > width {
                at = (INSET, at.1 + ROW_HEIGHT);
            }
            entry.at = at;
            at.0 += needed + GAP;
        }
        let bottom = if entries.is_empty() { top } else { at.1 + 8.0 };
        Self { entries, bottom }
    }

    pub(super) fn draw(&self, svg: &mut Svg) {
        for entry in &self.entries {
            let (x, y) = entry.at;
            let middle = (x + 11.0, y - 4.0);
            if entry.is_band {
                let (colour, left, top) = (entry.colour, Coordinate(x), Coordinate(y - 10.0));
                svg.add(format_args!(
                    "<rect class=\"band f{colour}\" x=\"{left}\" y=\"{top}\" width=\"22\" \
                     height=\"12\"/>\n"
                ));
            }
            if let Some(stroke) = entry.stroke {
                let attributes = stroke.attributes(entry.colour);
                let (from, to, y) = (Coordinate(x), Coordinate(x + 22.0), Coordinate(middle.1));
                svg.add(format_args!("<path {attributes} d=\"M{from} {y}L{to} {y}\"/>\n"));
            }
            if let Some(marker) = entry.marker {
                marker.draw(svg, entry.colour, middle, None);
            }
            svg.text("key", (x + SYMBOL_WIDTH, y), "start", &entry.name);
        }
    }
}
