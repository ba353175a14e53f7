//! Figure 6: the influence of the direction of the tilt.

use rig_chart::{Axis, Chart, Point, Series};
use rig_contact::{ContactLaw, Direction, Friction, Models, Sensor, SensorDesign, Tier};

use super::{curve, direction_keys, direction_style, noiseless, sample_at_end, spread};
use crate::{
    page::{Page, Table},
    paper_bench::{ANGLES_DEG, Control, SAMPLES_MPA},
    simulate::TouchSimulation,
};

pub(super) fn add(page: &mut Page, simulation: &TouchSimulation<'_>) {
    page.heading("Figure 6: front, back and left");
    page.text(
        "The paper: \"the detected direction has no significant influence\". With the arm of 8 mm \
         it has: through the slope of the probe the normal stiffness of the surface pulls along \
         the bimorph, forward or backward. The difference vanishes for h cos α = τ R/(1 − τ), \
         which is twice the ball's radius for an incompressible sample. The paper prints neither \
         numbers nor the arm.",
    );
    let mut chart = Chart::new(
        "Figure 6: shift over the angle in three directions",
        "Shifts of five samples; solid lines and circles to the front, dashed lines and squares to \
         the back, dotted lines and triangles to the left.",
        Axis::linear("contact angle, °").with_ticks(&ANGLES_DEG),
        Axis::linear("shift, Hz").including(0.0),
    );
    chart.size_px = (720, 520);
    chart.series.extend(direction_keys());
    let mut table = Table::new(&["sample", "direction", "0°, Hz", "15°", "30°", "45°"]);
    for (sample, &young_mpa) in SAMPLES_MPA.iter().enumerate() {
        for direction in Direction::ALL {
            let (marker, stroke) = direction_style(direction);
            let line =
                curve().map(|angle| (angle, simulation.exact_hz(young_mpa, direction, angle)));
            let line = Series::line("", sample, line.collect::<Vec<_>>());
            let end = sample_at_end(sample, direction);
            chart.series.push(Series { name: None, end, stroke: Some(stroke), ..line });
            let shifts = ANGLES_DEG.map(|angle| simulation.exact_hz(young_mpa, direction, angle));
            let points: Vec<Point> = ANGLES_DEG.into_iter().zip(shifts).map(Point::from).collect();
            let scatter = Series::scatter("", sample, points);
            chart.series.push(Series { name: None, marker: Some(marker), ..scatter });
            let head = [(sample + 1).to_string(), direction.name().to_owned()];
            table.row(head.into_iter().chain(shifts.map(|hz| format!("{hz:.2}"))));
        }
    }
    page.chart("figure-6.svg", chart);
    page.table(table);
    page.text(
        "The search for a probe without influence of the direction: the spread of the directions \
         at 45°, relative to their mean, and the largest over the five samples, by the arm and the \
         tangential over normal stiffness τ (0 slides, 0.667 sticks on an incompressible sample, 1 \
         is equally stiff both ways). A spread of 2 %, too small for a figure, needs a probe that \
         slides and has no arm, one that sticks and has an arm of 1 to 2 mm, or a longer arm and a \
         larger τ than an elastic half space has.",
    );
    page.table(spread_by_arm());
}

fn spread_by_arm() -> Table {
    const RATIOS: [f64; 5] = [0.0, 1.0 / 3.0, 2.0 / 3.0, 0.9, 1.0];
    let mut columns = vec!["arm, mm".to_owned()];
    columns.extend(RATIOS.map(|ratio| format!("τ = {ratio:.3}, %")));
    let mut table = Table { columns, rows: Vec::new() };
    for arm_mm in [0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 8.0, 12.0] {
        let design = SensorDesign { arm_mm, ..SensorDesign::reference() };
        let sensor = Sensor::new(design).expect("these arms can be built");
        let models = Models::new(&sensor, ContactLaw::Sneddon);
        let spread = |tangential_ratio: f64| {
            let simulation = TouchSimulation {
                friction: Friction::Elastic { tangential_ratio },
                ..noiseless(&models, Tier::Reference, Control::Indentation)
            };
            let largest =
                SAMPLES_MPA.iter().map(|&young| spread(&simulation, young)).fold(0.0, f64::max);
            format!("{:.1}", 100.0 * largest)
        };
        table.row([arm_mm.to_string()].into_iter().chain(RATIOS.map(spread)));
    }
    table
}
