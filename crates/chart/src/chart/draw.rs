//! Drawing of a chart as SVG.

use std::fmt::Write as _;

use super::{
    Chart,
    ends::Ends,
    legend::{INSET, Legend},
    series::{Band, Point, Rule, Series},
};
use crate::{
    COLOURS, ChartError,
    axis::FittedAxis,
    svg::{self, Coordinate, Escaped, FONT_PX, Svg, width_of},
};

const TITLE_HEIGHT: f64 = 26.0;
const TICK_LENGTH: f64 = 4.0;
/// Space of a tick with its text along each axis, px.
const X_TICK_PX: f64 = 46.0;
const Y_TICK_PX: f64 = 30.0;

impl Chart {
    /// The chart for an HTML page. `id` must be unique there.
    ///
    /// # Errors
    /// [`ChartError`] when an axis has no values or cannot show one.
    pub fn svg(&self, id: &str) -> Result<String, ChartError> {
        draw(self, id)
    }

    /// The chart as an SVG file with its own style sheet.
    ///
    /// # Errors
    /// [`ChartError`] when an axis has no values or cannot show one.
    pub fn file(&self) -> Result<String, ChartError> {
        Ok(svg::file(&self.svg("chart")?))
    }
}

fn draw(chart: &Chart, id: &str) -> Result<String, ChartError> {
    let plot = Plot::new(chart)?;
    let mut svg = Svg::begin(id, chart.size_px, &chart.title, &chart.description);
    svg.text("title", (INSET, 15.0), "start", &chart.title);
    plot.legend.draw(&mut svg);
    plot.draw_grid(&mut svg);
    let (left, top) = (Coordinate(plot.left), Coordinate(plot.top));
    let (width, height) = (Coordinate(plot.width()), Coordinate(plot.height()));
    svg.add(format_args!(
        "<clipPath id=\"{id}-c\"><rect x=\"{left}\" y=\"{top}\" width=\"{width}\" \
         height=\"{height}\"/></clipPath>\n<g clip-path=\"url(#{id}-c)\">\n"
    ));
    for band in &chart.bands {
        plot.draw_band(&mut svg, band);
    }
    for rule in &chart.rules {
        plot.draw_rule(&mut svg, rule);
    }
    for series in &chart.series {
        plot.draw_line(&mut svg, series);
    }
    svg.add(format_args!("</g>\n"));
    plot.draw_axes(&mut svg, chart);
    // Points are drawn after the axes, so that those at the edge are whole.
    for series in &chart.series {
        plot.draw_points(&mut svg, series);
    }
    Ends::of(&chart.series).draw(&mut svg, plot.right, |value| plot.y_of(value));
    Ok(svg.end())
}

/// The plot area with its axes.
struct Plot {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
    x: FittedAxis,
    y: FittedAxis,
    legend: Legend,
}

impl Plot {
    fn new(chart: &Chart) -> Result<Self, ChartError> {
        let (width, height) = (f64::from(chart.size_px.0), f64::from(chart.size_px.1));
        let legend = Legend::new(&chart.series, &chart.bands, width, TITLE_HEIGHT);
        let (top, bottom) = (legend.bottom + 8.0, height - 46.0);

        let ends = |point: &Point| {
            let error = point.error.unwrap_or(0.0);
            [point.y, point.y + error, point.y - error]
        };
        let points = || chart.series.iter().flat_map(|series| &series.points);
        let edges = || chart.bands.iter().flat_map(|band| &band.edges);
        let mut ys: Vec<f64> = edges().flat_map(|edge| [edge.low, edge.high]).collect();
        for point in points() {
            let [y, above, below] = ends(point);
            ys.extend([y, above]);
            // The lower end of an error bar may be zero or less on a logarithmic axis.
            ys.extend(chart.y.check(below).is_ok().then_some(below));
        }
        let y = chart.y.fit(ys, (bottom - top) / Y_TICK_PX)?;
        let texts = y.ticks.iter().filter_map(|tick| tick.text.as_deref());
        let widest = texts.map(|text| width_of(text, FONT_PX)).fold(0.0, f64::max);
        let left = 22.0 + widest + TICK_LENGTH + 6.0;
        let right = width - 14.0 - Ends::of(&chart.series).width();
        let xs = points().map(|point| point.x).chain(edges().map(|edge| edge.x));
        let x = chart.x.fit(xs, (right - left) / X_TICK_PX)?;
        for rule in &chart.rules {
            match rule {
                Rule::AtX { value, .. } => chart.x.check(*value)?,
                Rule::AtY { value, .. } => chart.y.check(*value)?,
            }
        }
        Ok(Self { left, right, top, bottom, x, y, legend })
    }

    fn width(&self) -> f64 {
        self.right - self.left
    }

    fn height(&self) -> f64 {
        self.bottom - self.top
    }

    fn x_of(&self, value: f64) -> f64 {
        self.left + self.x.fraction(value) * self.width()
    }

    fn y_of(&self, value: f64) -> f64 {
        self.bottom - self.y.fraction(value) * self.height()
    }

    fn draw_grid(&self, svg: &mut Svg) {
        let class = |is_written| if is_written { "grid" } else { "minor" };
        for tick in &self.y.ticks {
            let y = self.y_of(tick.value);
            svg.line(class(tick.text.is_some()), (self.left, y), (self.right, y));
        }
        for tick in &self.x.ticks {
            let x = self.x_of(tick.value);
            svg.line(class(tick.text.is_some()), (x, self.top), (x, self.bottom));
        }
    }

    fn draw_axes(&self, svg: &mut Svg, chart: &Chart) {
        svg.line("axis", (self.left, self.bottom), (self.right, self.bottom));
        svg.line("axis", (self.left, self.top), (self.left, self.bottom));
        for tick in &self.x.ticks {
            let Some(text) = &tick.text else { continue };
            let x = self.x_of(tick.value);
            svg.line("axis", (x, self.bottom), (x, self.bottom + TICK_LENGTH));
            svg.text("tick", (x, self.bottom + TICK_LENGTH + 13.0), "middle", text);
        }
        for tick in &self.y.ticks {
            let Some(text) = &tick.text else { continue };
            let y = self.y_of(tick.value);
            svg.line("axis", (self.left - TICK_LENGTH, y), (self.left, y));
            svg.text("tick", (self.left - TICK_LENGTH - 4.0, y + 4.0), "end", text);
        }
        let middle = f64::midpoint(self.left, self.right);
        let bottom = f64::from(chart.size_px.1) - 8.0;
        svg.text("label", (middle, bottom), "middle", &self.x.label);
        let (middle, label) =
            (Coordinate(f64::midpoint(self.top, self.bottom)), Escaped(&self.y.label));
        svg.add(format_args!(
            "<text class=\"label\" transform=\"translate(13 {middle}) rotate(-90)\" \
             text-anchor=\"middle\">{label}</text>\n"
        ));
    }

    fn draw_band(&self, svg: &mut Svg, band: &Band) {
        let upper = band.edges.iter().map(|edge| (edge.x, edge.high));
        let lower = band.edges.iter().rev().map(|edge| (edge.x, edge.low));
        let path = self.path(upper.chain(lower));
        let colour = band.colour % COLOURS;
        svg.add(format_args!("<path class=\"band f{colour}\" d=\"{path}Z\"/>\n"));
    }

    fn draw_rule(&self, svg: &mut Svg, rule: &Rule) {
        match rule {
            Rule::AtX { value, label } => {
                let x = self.x_of(*value);
                svg.line("rule", (x, self.top), (x, self.bottom));
                svg.text("label", (x + 5.0, self.top + 12.0), "start", label);
            }
            Rule::AtY { value, label } => {
                let y = self.y_of(*value);
                svg.line("rule", (self.left, y), (self.right, y));
                svg.text("label", (self.right - 4.0, y - 5.0), "end", label);
            }
        }
    }

    fn draw_line(&self, svg: &mut Svg, series: &Series) {
        let Some(stroke) = series.stroke else { return };
        if series.points.len() > 1 {
            let path = self.path(series.points.iter().map(|point| (point.x, point.y)));
            let attributes = stroke.attributes(series.colour % COLOURS);
            svg.add(format_args!("<path {attributes} d=\"{path}\"/>\n"));
        }
    }

    fn draw_points(&self, svg: &mut Svg, series: &Series) {
        let colour = series.colour % COLOURS;
        let shown = series.points.iter().filter(|point| self.holds(point));
        for point in shown.clone() {
            let Some(error) = point.error else { continue };
            let x = self.x_of(point.x);
            let (low, high) = (self.y_of(point.y - error), self.y_of(point.y + error));
            let (low, high) = (low.min(self.bottom), high.max(self.top));
            let class = format!("bar s{colour}");
            svg.line(&class, (x, low), (x, high));
            for end in [low, high] {
                svg.line(&class, (x - 3.0, end), (x + 3.0, end));
            }
        }
        let Some(marker) = series.marker else { return };
        for point in shown {
            let at = (self.x_of(point.x), self.y_of(point.y));
            marker.draw(svg, colour, at, point.note.as_deref());
        }
    }

    fn holds(&self, point: &Point) -> bool {
        let is_inside = |fraction: f64| (0.0..=1.0).contains(&fraction);
        is_inside(self.x.fraction(point.x)) && is_inside(self.y.fraction(point.y))
    }

    fn path(&self, values: impl Iterator<Item = (f64, f64)>) -> String {
        let mut path = String::new();
        for (index, (x, y)) in values.enumerate() {
            let verb = if index == 0 { 'M' } else { 'L' };
            write!(path, "{verb}{} {}", Coordinate(self.x_of(x)), Coordinate(self.y_of(y)))
                .expect("a string takes all text");
        }
        path
    }
}
