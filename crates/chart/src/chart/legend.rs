//! The legend: named series and bands in rows.

use super::{
    Band, Series, Stroke,
    draw::{FONT_PX, draw_marker, line_class},
};
use crate::{
    COLOURS, Marker,
    svg::{Number, Svg, width_of},
};

/// Of the title and the legend from the left edge, so that round line ends are not cut.
pub(super) const INSET: f64 = 2.0;
const ROW_HEIGHT: f64 = 20.0;
/// Between the sign of a series and its name, and behind the name.
const SIGN_WIDTH: f64 = 30.0;
const GAP: f64 = 18.0;

/// A legend by itself, for several charts with the same unnamed series, `width` pixels wide.
pub fn legend(series: &[Series], id: &str, width: u32) -> String {
    let keys = Keys::new(series, &[], f64::from(width), 2.0);
    // A few rows; whole pixels.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let height = (keys.bottom + 4.0).max(1.0).ceil() as u32;
    let names: Vec<&str> = series.iter().filter_map(|series| series.name.as_deref()).collect();
    let mut svg = Svg::begin(id, (width, height), "Legend", &names.join(", "));
    keys.draw(&mut svg);
    svg.end()
}

/// The signs of a legend, in their places.
#[derive(Debug)]
pub(super) struct Keys {
    keys: Vec<Key>,
    /// The lower edge of the last row.
    pub(super) bottom: f64,
}

#[derive(Debug)]
struct Key {
    name: String,
    at: (f64, f64),
    colour: usize,
    marker: Option<Marker>,
    stroke: Option<Stroke>,
    is_band: bool,
}

impl Keys {
    /// Puts the names into rows no wider than `width`, below `top`.
    pub(super) fn new(series: &[Series], bands: &[Band], width: f64, top: f64) -> Self {
        let of_series = series.iter().filter_map(|series| {
            let &Series { colour, marker, stroke, .. } = series;
            Some(Key {
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
            Some(Key { name, at, colour, marker: None, stroke: None, is_band: true })
        });
        let mut keys: Vec<Key> = of_series.chain(of_bands).collect();
        let mut at = (INSET, top + 12.0);
        for key in &mut keys {
            let needed = SIGN_WIDTH + width_of(&key.name, FONT_PX);
            if at.0 > INSET && at.0 + needed > width {
                at = (INSET, at.1 + ROW_HEIGHT);
            }
            key.at = at;
            at.0 += needed + GAP;
        }
        let bottom = if keys.is_empty() { top } else { at.1 + 8.0 };
        Self { keys, bottom }
    }

    pub(super) fn draw(&self, svg: &mut Svg) {
        for key in &self.keys {
            let (x, y) = key.at;
            let middle = (x + 11.0, y - 4.0);
            if key.is_band {
                let (colour, left, top) = (key.colour, Number(x), Number(y - 10.0));
                svg.add(format_args!(
                    "<rect class=\"band f{colour}\" x=\"{left}\" y=\"{top}\" width=\"22\" \
                     height=\"12\"/>\n"
                ));
            }
            if let Some(stroke) = key.stroke {
                let class = line_class(stroke, key.colour);
                svg.line(&class, (x, middle.1), (x + 22.0, middle.1));
            }
            if let Some(marker) = key.marker {
                draw_marker(svg, marker, key.colour, middle, None);
            }
            svg.text("key", (x + SIGN_WIDTH, y), "start", &key.name);
        }
    }
}
