//! The sensitivity, and the deviation from a straight line.

use rig_contact::{Direction, Models, Tier};

use super::noiseless;
use crate::{
    page::{Page, Table},
    paper_bench::{Control, SAMPLES_MPA},
};

pub(super) fn add(page: &mut Page, models: &Models) {
    page.heading("The sensitivity");
    page.text(
        "The paper prints 134.11 Hz/MPa from 0.045 to 0.649 MPa. Any model with one free constant \
         can have this chord, but not a straight line: the shift is concave in the stiffness, so \
         that the slope depends on the stiffness:",
    );
    let mut table = Table::new(&[
        "model",
        "chord, Hz/MPa",
        "printed",
        "difference",
        "slope at 0.045 MPa",
        "at 0.235",
        "at 0.649",
        "at 1",
        "at 3",
    ]);
    let mut lines = Table::new(&["model", "slope, Hz/MPa", "R²", "largest deviation, Hz"]);
    for (name, tier, control) in [
        ("T0", Tier::T0, Control::Indentation),
        ("T1", Tier::T1, Control::Indentation),
        ("E1", Tier::E1, Control::Indentation),
        ("reference, indentation held", Tier::Reference, Control::Indentation),
        ("reference, stage held", Tier::Reference, Control::Stage),
    ] {
        let simulation = noiseless(models, tier, control);
        let at = |young: f64| simulation.exact_hz(young, Direction::Front, 0.0);
        let chord = (at(SAMPLES_MPA[4]) - at(SAMPLES_MPA[0])) / (SAMPLES_MPA[4] - SAMPLES_MPA[0]);
        let slope = |young: f64| {
            // Tier T0 ends with the range that it was fitted on.
            if tier == Tier::T0 && young > 1.2 {
                return "refused".to_owned();
            }
            format!("{:.1}", (at(young * 1.01) - at(young * 0.99)) / (0.02 * young))
        };
        let head = [
            name.to_owned(),
            format!("{chord:.2}"),
            "134.11".to_owned(),
            // Without the sign of a zero.
            format!("{:+.2}", (100.0 * (chord - 134.11)).round() / 100.0 + 0.0),
        ];
        table.row(head.into_iter().chain([0.045, 0.235, 0.649, 1.0, 3.0].map(slope)));
        let Line { slope, r_squared, largest } = Line::through(&SAMPLES_MPA.map(|e| (e, at(e))));
        let found = [format!("{slope:.2}"), format!("{r_squared:.4}"), format!("{largest:.2}")];
        lines.row([name.to_owned()].into_iter().chain(found));
    }
    page.table(table);
    page.text(
        "The least-squares line through the shifts of the five samples. The coefficient of \
         determination of a concave curve exceeds 0.99 as well, so that a line in a figure proves \
         nothing:",
    );
    page.table(lines);
}

/// A least-squares line.
struct Line {
    slope: f64,
    r_squared: f64,
    largest: f64,
}

impl Line {
    fn through(points: &[(f64, f64)]) -> Self {
        let count = points.len() as f64;
        let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
        let (x0, y0) = (mean(|p| p.0), mean(|p| p.1));
        let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
            points.iter().map(|&(x, y)| of(x - x0, y - y0)).sum()
        };
        let slope = sum(&|x, y| x * y) / sum(&|x, _| x * x);
        let left = sum(&|x, y| (y - slope * x).powi(2));
        let deviations = points.iter().map(|&(x, y)| (y - y0 - slope * (x - x0)).abs());
        let r_squared = 1.0 - left / sum(&|_, y| y * y);
        Self { slope, r_squared, largest: deviations.fold(0.0, f64::max) }
    }
}
