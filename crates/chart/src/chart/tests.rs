use super::*;
use crate::ChartError;

fn chart() -> Chart {
    let mut chart = Chart::new(
        "shift <Δf>",
        "Two samples at two angles.",
        Axis::linear("angle (°)").with_ticks(&[0.0, 45.0]),
        Axis::linear("Δf (Hz)").including(0.0),
    );
    chart.size_px = (300, 200);
    let point = |x, y| Point { x, y, error: Some(1.0), note: Some(format!("{y} Hz")) };
    chart.series.push(Series::joined("soft", 0, [point(0.0, 8.0), point(45.0, 6.0)]));
    chart.series.push(Series::scatter("stiff", 1, [(0.0, 18.0), (45.0, 15.0)]));
    chart.rules.push(Rule::AtY { value: 12.0, label: "limit".to_owned() });
    let edge = |x, low, high| BandEdge { x, low, high };
    chart.bands.push(Band {
        name: None,
        edges: vec![edge(0.0, 7.0, 9.0), edge(45.0, 5.0, 7.0)],
        colour: 0,
    });
    chart
}

#[test]
fn a_chart_is_plain_text_that_does_not_change() {
    insta::assert_snapshot!(chart().svg("c").unwrap());
}

#[test]
fn a_file_has_the_style_sheet_and_a_part_of_a_page_has_not() {
    let file = chart().file().unwrap();
    assert_eq!(file.matches("<style>").count(), 1);
    assert!(file.starts_with("<svg ") && file.ends_with("</svg>\n"));
    assert!(!chart().svg("c").unwrap().contains("<style>"));
}

#[test]
fn points_outside_the_range_are_left_out() {
    let mut chart = chart();
    chart.y = Axis::linear("Δf (Hz)").with_range(0.0, 10.0);
    chart.rules.clear();
    let svg = chart.svg("c").unwrap();
    // The legend keeps its symbol.
    assert_eq!(svg.matches("class=\"mark f1\"").count(), 1);
    assert_eq!(svg.matches("class=\"mark f0\"").count(), 3);
}

#[test]
fn an_error_bar_that_reaches_zero_ends_at_a_logarithmic_axis() {
    let mut chart = Chart::new("e", "e", Axis::linear("x"), Axis::log("y"));
    let point = Point { x: 0.0, y: 1.0, error: Some(2.0), note: None };
    chart.series.push(Series::scatter("s", 0, [point]));
    let svg = chart.svg("c").unwrap();
    let bottom = 400.0 - 46.0;
    assert!(svg.contains(&format!("{bottom}L")), "{svg}");
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
}

#[test]
fn a_value_that_no_axis_can_show_is_refused() {
    #[track_caller]
    fn check(change: impl Fn(&mut Chart)) {
        let mut chart = chart();
        change(&mut chart);
        let refusal = chart.svg("c").unwrap_err();
        assert!(matches!(refusal, ChartError::Unshowable { .. }), "{refusal}");
    }
    check(|chart| chart.series[0].points[0].x = f64::NAN);
    check(|chart| chart.series[0].points[0].y = f64::INFINITY);
    check(|chart| chart.bands[0].edges[0].low = f64::NAN);
    check(|chart| chart.rules[0] = Rule::AtX { value: f64::NAN, label: String::new() });
    check(|chart| {
        chart.y = Axis::linear("y").with_range(0.0, 10.0);
        chart.series[1].points[1].y = f64::NAN;
    });
    let mut empty = chart();
    (empty.series, empty.bands) = (Vec::new(), Vec::new());
    let refusal = empty.svg("c").unwrap_err();
    assert_eq!(refusal, ChartError::Empty { axis: "angle (°)".to_owned() });
}
