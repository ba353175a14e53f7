//! The page on sensor designs.

use std::collections::BTreeSet;

use rig_chart::{Axis, Chart, Point, Series};

use super::{
    grid::{Design, Grid},
    merit::Merit,
};
use crate::{
    page::{Page, Table},
    paper_bench::{Control, INDENTATION_MM},
};

type Judged = (Design, Option<Merit>);

/// The sensor that the paper chooses, and the two that it compares with it.
const COMPARED: [(&str, f64, f64); 3] = [
    ("35 mm, 0.5 mm (chosen)", 35.0, 0.5),
    ("35 mm, 1 mm", 35.0, 1.0),
    ("20 mm, 0.5 mm", 20.0, 0.5),
];
/// Length of the probe arm of the reference sensor, mm.
const ARM_MM: f64 = 8.0;

/// The page: the paper's sensors among all designs, the ends of the front, and its charts.
pub(super) fn page(grid: &Grid, designs: &[Judged], front: &[usize]) -> Page {
    let mut page = Page { title: "Sensor designs".to_owned(), parts: Vec::new() };
    let usable = designs.iter().filter(|(_, merit)| merit.is_some()).count();
    page.text(format!(
        "This page is written by `cargo run --release -p rig-study -- design --out docs/studies`, \
         in a few seconds on two cores: {} designs ({grid}, all in mm), of which {usable} are \
         within the models. All designs go to `target/study/design.csv` as they are judged, so \
         that an interrupted study can continue; the {} on the front go to `front.csv` beside it.",
        designs.len(),
        front.len()
    ));
    page.text(
        "Four merits compete. Angle influence is the largest relative fall of a shift from upright \
         to 45°, over samples and directions; less is better. Discrimination is the smallest gap \
         between the shifts of neighbouring samples over all angles and directions, relative to \
         the softer one; more is better, and it is negative for overlapping ranges. Sensitivity is \
         the slope from the softest to the stiffest sample. Time is that of one frequency: \
         settling to a hundredth and ten cycles. A design is on the front if no other design is at \
         least as good in all four and better in one. All other dimensions are those of the \
         reference sensor.",
    );
    page.heading("The paper's choice");
    compared(&mut page, grid.control, designs);
    page.heading("The front");
    ends(&mut page, designs, front);
    for (name, chart) in charts(grid.control, designs, front) {
        page.chart(name, chart);
    }
    page.heading("Indentation and arm");
    indentation_and_arm(&mut page, grid.control);
    page
}

fn design(length_mm: f64, radius_mm: f64, control: Control) -> Design {
    Design { length_mm, radius_mm, indentation_mm: INDENTATION_MM, arm_mm: ARM_MM, control }
}

fn merits(merit: &Merit) -> [String; 4] {
    [
        format!("{:.1}", 100.0 * merit.angle_influence),
        format!("{:.1}", 100.0 * merit.discrimination),
        format!("{:.1}", merit.sensitivity_hz_per_mpa),
        format!("{:.3}", merit.point_s),
    ]
}

fn table(first: &[&str]) -> Table {
    let merits = ["angle influence, %", "discrimination, %", "sensitivity, Hz/MPa", "time, s"];
    Table::new(&[first, &merits].concat())
}

fn compared(page: &mut Page, control: Control, designs: &[Judged]) {
    page.text(
        "The paper's sensors, the number of designs of the grid that are at least as good in every \
         merit and better in one, and the best of these by its smallest gain. A ball larger than \
         the indentation and a shorter sensor improve speed and discrimination without loss of \
         sensitivity: the paper's R = Δ is not on the front.",
    );
    let mut rows = table(&["sensor", "beaten by"]);
    for (name, length_mm, radius_mm) in COMPARED {
        let Some(merit) = Merit::of(&design(length_mm, radius_mm, control)) else { continue };
        let better: Vec<(&Design, &Merit)> = designs
            .iter()
            .filter_map(|(design, other)| Some((design, other.as_ref()?)))
            .filter(|(_, other)| other.beats(&merit))
            .collect();
        let head = [name.to_owned(), better.len().to_string()];
        rows.row(head.into_iter().chain(merits(&merit)));
        let most = better
            .into_iter()
            .max_by(|a, b| a.1.least_gain_over(&merit).total_cmp(&b.1.least_gain_over(&merit)));
        if let Some((design, other)) = most {
            let head = [design.to_string(), String::new()];
            rows.row(head.into_iter().chain(merits(other)));
        }
    }
    page.table(rows);
}

/// The best design by each merit.
fn ends(page: &mut Page, designs: &[Judged], front: &[usize]) {
    page.text("The ends of the front, each the best by one merit:");
    let mut rows = table(&["best", "design"]);
    let on_front: Vec<(&Design, &Merit)> = front
        .iter()
        .filter_map(|&index| Some((&designs[index].0, designs[index].1.as_ref()?)))
        .collect();
    // For each merit, less is better.
    let costs = |merit: &Merit| {
        let Merit { angle_influence, discrimination, sensitivity_hz_per_mpa, point_s } = *merit;
        [angle_influence, -discrimination, -sensitivity_hz_per_mpa, point_s]
    };
    for (index, name) in
        ["angle influence", "discrimination", "sensitivity", "time"].into_iter().enumerate()
    {
        let best = on_front.iter().min_by(|a, b| costs(a.1)[index].total_cmp(&costs(b.1)[index]));
        let Some((design, merit)) = best else { continue };
        rows.row([name.to_owned(), design.to_string()].into_iter().chain(merits(merit)));
    }
    page.table(rows);
}

/// Arms through which the direction acts little, mm.
const SHORT_ARM_MM: std::ops::RangeInclusive<f64> = 1.0..=2.0;

fn indentation_and_arm(page: &mut Page, control: Control) {
    let mut rows = table(&["arm, mm", "indentation, mm"]);
    let (mut short, mut overlapping) = (0, 0);
    for arm_mm in [0.0, 1.0, 2.0, 4.0, 8.0] {
        for indentation_mm in [0.25, 0.5, 0.75] {
            let design = Design { indentation_mm, arm_mm, ..design(35.0, 0.5, control) };
            let Some(merit) = Merit::of(&design) else { continue };
            if SHORT_ARM_MM.contains(&arm_mm) {
                short += 1;
                overlapping += i32::from(merit.discrimination < 0.0);
            }
            let head = [arm_mm.to_string(), indentation_mm.to_string()];
            rows.row(head.into_iter().chain(merits(&merit)));
        }
    }
    page.text(format!(
        "The paper's sensor with other arms and indentations, which the paper does not discuss. The direction acts through \
         the arm. With 1 to 2 mm, neighbouring samples overlap in {overlapping} of the {short} rows: their discrimination \
         is below 0."
    ));
    page.table(rows);
}

/// Two views of the front: influence against sensitivity, and discrimination against time.
fn charts(control: Control, designs: &[Judged], front: &[usize]) -> [(&'static str, Chart); 2] {
    let view = |title: &str, x: Axis, y: Axis, of: fn(&Merit) -> (f64, f64)| {
        let description = "Each point is a design that no other beats in angle influence, discrimination, \
            sensitivity and time together, beside the three sensors of the paper.";
        let mut chart = Chart::new(title, description, x, y);
        let on_front = front.iter().filter_map(|&index| {
            let (design, merit) = &designs[index];
            let (x, y) = of(merit.as_ref()?);
            Some(Point { x, y, error: None, note: Some(design.to_string()) })
        });
        chart.series.push(Series::scatter("front", 6, thinned(on_front.collect())));
        for (colour, (name, length_mm, radius_mm)) in COMPARED.into_iter().enumerate() {
            let merit = Merit::of(&design(length_mm, radius_mm, control));
            let point = merit.iter().map(|merit| Point::from(of(merit)));
            chart.series.push(Series::scatter(name, colour, point));
        }
        chart
    };
    [
        (
            "influence-sensitivity.svg",
            view(
                "Angle influence and sensitivity of the designs on the front",
                Axis::linear("sensitivity, Hz/MPa"),
                Axis::linear("largest fall of a shift to 45°, %"),
                |merit| (merit.sensitivity_hz_per_mpa, 100.0 * merit.angle_influence),
            ),
        ),
        (
            "discrimination-time.svg",
            view(
                "Discrimination and time of the designs on the front",
                Axis::linear("time of one frequency, s"),
                Axis::linear("smallest gap between neighbouring samples over all angles, %"),
                |merit| (merit.point_s, 100.0 * merit.discrimination),
            ),
        ),
    ]
}

/// A readable selection of the points: the first in each field of a raster.
fn thinned(points: Vec<Point>) -> Vec<Point> {
    const FIELDS: f64 = 50.0;
    let ends = |of: fn(&Point) -> f64| {
        let least = points.iter().map(of).fold(f64::INFINITY, f64::min);
        let most = points.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
        (least, (most - least).max(f64::MIN_POSITIVE))
    };
    let (x, y) = (ends(|point| point.x), ends(|point| point.y));
    let mut taken = BTreeSet::new();
    let field = |value: f64, (least, width): (f64, f64)| {
        // Integers from 0 to 50, compared by their bits.
        ((value - least) / width * FIELDS).floor().to_bits()
    };
    points
        .into_iter()
        .filter(|point| taken.insert((field(point.x, x), field(point.y, y))))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The full grid takes too long for a test.
    #[test]
    fn the_document_holds_what_the_models_say_today() {
        let mut page = Page::default();
        indentation_and_arm(&mut page, Control::Indentation);
        let document = include_str!("../../../../docs/studies/design.md");
        for line in page.markdown("design").lines().skip(1) {
            assert!(document.contains(line), "docs/studies/design.md is out of date: {line}");
        }
    }
}
