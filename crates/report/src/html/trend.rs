//! The trend of the daily checks of a bench as one HTML file.

use maud::{Markup, html};
use rig_chart::{Axis, Band, BandEdge, Chart, Marker, Point, Series};

use super::{
    document::document,
    element::{drawn, figure_row, note, table, text},
};

/// The daily checks of a bench that can be compared with each other, the oldest first.
#[derive(Debug, Clone, PartialEq)]
pub struct Trend {
    /// Name of the rig.
    pub rig: String,
    /// A chart for each quantity.
    pub panels: Vec<TrendPanel>,
    /// The checks.
    pub checks: Vec<TrendCheck>,
}

/// The chart of a quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct TrendPanel {
    /// Name of the quantity.
    pub title: String,
    /// Its unit; 1 for a logarithm.
    pub unit: String,
    /// A difference that matters to nobody, in its unit: a chart shows no smaller range than some of it.
    pub least: f64,
    /// What gives a value each time, such as `check`.
    pub each: &'static str,
    /// Its values.
    pub points: Vec<TrendPoint>,
}

/// A value of a quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct TrendPoint {
    /// The value.
    pub value: f64,
    /// When it was measured, for a person.
    pub made: String,
    /// Between which values it was expected; `None` for the first ones.
    pub limits: Option<(f64, f64)>,
    /// The moving average of the scores.
    pub average: Option<f64>,
    /// Whether the chart has an alarm.
    pub is_alarm: bool,
}

/// A check.
#[derive(Debug, Clone, PartialEq)]
pub struct TrendCheck {
    /// When it was made, for a person.
    pub made: String,
    /// Name of the person.
    pub person: String,
    /// `accepted`, `look` or `not to be trusted`.
    pub verdict: String,
    /// Why it is not accepted; empty if it is.
    pub reason: String,
}

/// Width and height of a chart, pixels: two in a row.
const PANEL_PX: (u32, u32) = (446, 260);

impl Trend {
    /// The page. It asks no host for anything.
    pub fn html(&self) -> String {
        let last = self.checks.last();
        let body = html! {
            main {
                header {
                    p.eyebrow { "Daily checks" }
                    h1 { (self.rig) }
                    @if let Some(last) = last { (verdict(last)) }
                }
                section {
                    h2 { "Trend" }
                    @if self.panels.is_empty() { (note("No check was made yet.")) }
                    @else { (self.charts()) }
                }
                section {
                    h2 { "Checks" }
                    (self.table())
                }
            }
        };
        let title = html! { (self.rig) " – daily checks" };
        let styles = [include_str!("style.css"), rig_chart::STYLE];
        let page = document(&title, &styles, None, &body);
        page.into_string()
    }

    fn charts(&self) -> Markup {
        let charts = html! {
            @for (index, panel) in self.panels.iter().enumerate() {
                (panel.drawn(&format!("fig-trend-{index}")))
            }
        };
        let caption = "Each quantity by number of the check. The band is where a check was expected by those before \
                       it; a ring marks an alarm: a value beyond the band, or a small change that stays.";
        figure_row(&charts, caption)
    }

    fn table(&self) -> Markup {
        let row = |(index, check): (usize, &TrendCheck)| {
            let TrendCheck { made, person, verdict, reason } = check;
            vec![text(index + 1), text(made), text(person), text(verdict), text(reason)]
        };
        let rows: Vec<_> = self.checks.iter().enumerate().rev().map(row).collect();
        let heads = ["check", "made", "person", "verdict", "reason"];
        html! { div.words { (table("Every check since the bench was changed, the last one first.", &heads, &rows)) } }
    }
}

fn verdict(last: &TrendCheck) -> Markup {
    let class = match last.verdict.as_str() {
        "accepted" => "completed",
        "look" => "partial",
        _ => "failed",
    };
    html! {
        p.meta { span.status.(class) { (last.verdict) } " " (last.made) " · " (last.person) }
        @if !last.reason.is_empty() { p.alarm { (last.reason) } }
    }
}

impl TrendPanel {
    /// The chart as a drawing whose parts have ids that begin with `id`.
    pub fn drawn(&self, id: &str) -> Markup {
        drawn(&self.chart(), id)
    }

    /// The axis of the values. Values that are all alike do not fill it.
    fn values(&self, label: &str) -> Axis {
        let around = |axis: Axis, point: &TrendPoint| {
            axis.including(point.value - 4.0 * self.least).including(point.value + 4.0 * self.least)
        };
        self.points.iter().fold(Axis::linear(label), around)
    }

    fn chart(&self) -> Chart {
        let unit = if self.unit == "1" { String::new() } else { format!(" ({})", self.unit) };
        let each = self.each;
        let mut chart = Chart::new(
            &self.title,
            &format!("{} of each {each}, with the limits by each {each} before.", self.title),
            Axis::linear(each),
            self.values(&format!("value{unit}")),
        );
        chart.size_px = PANEL_PX;
        let numbered = || self.points.iter().zip(1_u32..).map(|(point, n)| (f64::from(n), point));
        let edges = numbered()
            .filter_map(|(x, point)| point.limits.map(|(low, high)| BandEdge { x, low, high }));
        let edges: Vec<_> = edges.collect();
        if edges.len() > 1 {
            chart.bands.push(Band { name: None, edges, colour: 0 });
        }
        let mark = |(x, point): (f64, &TrendPoint)| Point {
            x,
            y: point.value,
            error: None,
            note: Some(format!("{}: {}{unit}", point.made, point.value)),
        };
        let all = Series::joined("", 0, numbered().map(mark));
        chart.series.push(Series { name: None, ..all });
        let alarms: Vec<_> = numbered().filter(|(_, point)| point.is_alarm).map(mark).collect();
        if !alarms.is_empty() {
            let rings = Series::scatter("alarm", 1, alarms);
            chart.series.push(Series { marker: Some(Marker::Ring), ..rings });
        }
        chart
    }
}
