//! Figures 4, 6, 7 and 8, and the sensitivity.

use rig_chart::{Axis, Chart, Marker, Point, Series};
use rig_contact::{
    ContactLaw, Direction, Friction, Models, Sensor, Tier,
    equations::{Arithmetic, angle_influence, influence_over_discrimination},
};

use super::{Compared, compared};
use crate::{
    page::{Page, Table},
    paper_bench::{ANGLES_DEG, Control, SAMPLES_MPA},
    simulate::{Nuisances, Way},
};

/// Angles of the curves, degrees.
fn curve() -> impl Iterator<Item = f64> {
    (0..=45).map(f64::from)
}

pub(super) fn noiseless(models: &Models, tier: Tier, control: Control) -> Way<'_> {
    Way {
        models,
        tier,
        law: ContactLaw::Sneddon,
        friction: Friction::Sticking,
        control,
        nuisances: Nuisances::default(),
    }
}

/// The mean of the three directions, Hz.
fn mean_hz(way: &Way<'_>, young_mpa: f64, angle_deg: f64) -> f64 {
    let sum: f64 =
        Direction::ALL.iter().map(|&direction| way.exact_hz(young_mpa, direction, angle_deg)).sum();
    sum / Direction::ALL.len() as f64
}

pub(super) fn add(page: &mut Page) {
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    figure_4(page);
    figure_6(page, &noiseless(&models, Tier::Reference, Control::Indentation));
    figure_7(page, &models);
    sensitivity(page, &models);
    figure_8(page);
}

fn figure_4(page: &mut Page) {
    page.heading("Figure 4: the shift over the angle by equation (7)");
    let models = Models::new(&Sensor::reference(), ContactLaw::Paper);
    let mut chart = Chart::new(
        "Figure 4: shift of two samples over the angle by equation (7)",
        "The shifts of samples 3 and 4 fall from 0° to 90°; the fall to 45° is D1, their distance D2.",
        Axis::linear("contact angle, °").with_ticks(&[0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0]),
        Axis::linear("shift, Hz").including(0.0),
    );
    for (colour, sample) in [(0, 3), (1, 2)] {
        let way =
            Way { law: ContactLaw::Paper, ..noiseless(&models, Tier::T0, Control::Indentation) };
        let points = (0..=89)
            .map(f64::from)
            .map(|angle| (angle, way.exact_hz(SAMPLES_MPA[sample], Direction::Front, angle)));
        chart.series.push(Series::line(&format!("sample {}", sample + 1), colour, points));
    }
    page.chart("figure-4.svg", chart);
}

fn figure_6(page: &mut Page, way: &Way<'_>) {
    page.heading("Figure 6: front, back and left");
    page.text(
        "The paper: \"the detected direction has no significant influence\". With the arm of 8 mm it \
         has: the probe's slope turns the surface's normal stiffness into a pull along the bimorph, \
         forward or backward. The difference vanishes where h cos α = τ R/(1 − τ), twice the ball's \
         radius for an incompressible sample, and is below 2 % for arms of 1 to 2 mm: the statement \
         says how short the paper's probe was, or that its contact was bonded.",
    );
    let mut chart = Chart::new(
        "Figure 6: shift over the angle in three directions",
        "Shifts of five samples; circles to the front, squares to the back, triangles to the left.",
        Axis::linear("contact angle, °").with_ticks(&ANGLES_DEG),
        Axis::linear("shift, Hz").including(0.0),
    );
    let mut table = Table::new(&["sample", "direction", "0°, Hz", "15°", "30°", "45°"]);
    for (sample, &young_mpa) in SAMPLES_MPA.iter().enumerate() {
        for (direction, marker) in
            Direction::ALL.into_iter().zip([Marker::of(0), Marker::of(1), Marker::of(2)])
        {
            let line = curve().map(|angle| (angle, way.exact_hz(young_mpa, direction, angle)));
            chart
                .series
                .push(Series { name: None, ..Series::line("", sample, line.collect::<Vec<_>>()) });
            let shifts = ANGLES_DEG.map(|angle| way.exact_hz(young_mpa, direction, angle));
            let points: Vec<Point> = ANGLES_DEG.into_iter().zip(shifts).map(Point::from).collect();
            let name = (direction == Direction::Front).then(|| format!("sample {}", sample + 1));
            chart.series.push(Series {
                name,
                points,
                colour: sample,
                marker: Some(marker),
                stroke: None,
            });
            let head = [(sample + 1).to_string(), direction.name().to_owned()];
            table.row(head.into_iter().chain(shifts.map(|hz| format!("{hz:.2}"))));
        }
    }
    page.chart("figure-6.svg", chart);
    page.table(table);
    page.text("The spread of the directions at 45°, relative to their mean, for other arms:");
    page.table(spread_by_arm());
}

fn spread_by_arm() -> Table {
    let mut table = Table::new(&["arm, mm", "sample 1, %", "sample 3, %", "sample 5, %"]);
    for arm_mm in [0.0, 1.0, 2.0, 4.0, 8.0, 12.0] {
        let design = rig_contact::SensorDesign { arm_mm, ..rig_contact::SensorDesign::reference() };
        let sensor = Sensor::new(design).expect("these arms can be built");
        let models = Models::new(&sensor, ContactLaw::Sneddon);
        let way = noiseless(&models, Tier::Reference, Control::Indentation);
        let spread = |sample: usize| {
            let young = SAMPLES_MPA[sample];
            let shifts = Direction::ALL.map(|direction| way.exact_hz(young, direction, 45.0));
            let most = shifts.into_iter().fold(f64::MIN, f64::max);
            let least = shifts.into_iter().fold(f64::MAX, f64::min);
            format!("{:.1}", 100.0 * (most - least) / mean_hz(&way, young, 45.0))
        };
        table.row([arm_mm.to_string()].into_iter().chain([0, 2, 4].map(spread)));
    }
    table
}

fn figure_7(page: &mut Page, models: &Models) {
    page.heading("Figure 7: the mean of the directions");
    page.text(
        "The paper: the decrease is small, and smaller for softer samples. In hertz it is smaller; \
         relative to the shift itself the softest sample falls most. A tier without tangential \
         stiffness and tilt falls by about half as much.",
    );
    let ways = [
        ("reference, indentation held", noiseless(models, Tier::Reference, Control::Indentation)),
        ("reference, stage held", noiseless(models, Tier::Reference, Control::Stage)),
        ("T1", noiseless(models, Tier::T1, Control::Indentation)),
    ];
    let mut chart = Chart::new(
        "Figure 7: shift over the angle, mean of the directions",
        "Shifts of five samples by the reference with the indentation held.",
        Axis::linear("contact angle, °").with_ticks(&ANGLES_DEG),
        Axis::linear("shift, Hz").including(0.0),
    );
    for (sample, &young) in SAMPLES_MPA.iter().enumerate() {
        let line = curve().map(|angle| (angle, mean_hz(&ways[0].1, young, angle)));
        let name = format!("sample {}", sample + 1);
        chart.series.push(Series::line(&name, sample, line.collect::<Vec<_>>()));
    }
    page.chart("figure-7.svg", chart);
    let mut table =
        Table::new(&["model", "sample", "0°, Hz", "15°", "30°", "45°", "fall to 45°, Hz", "%"]);
    for (name, way) in &ways {
        for (sample, &young) in SAMPLES_MPA.iter().enumerate() {
            let shifts = ANGLES_DEG.map(|angle| mean_hz(way, young, angle));
            let fall = shifts[0] - shifts[3];
            let head = [(*name).to_owned(), (sample + 1).to_string()];
            let tail = [format!("{fall:.2}"), format!("{:.1}", 100.0 * fall / shifts[0])];
            table.row(head.into_iter().chain(shifts.map(|hz| format!("{hz:.2}"))).chain(tail));
        }
    }
    page.table(table);
}

fn sensitivity(page: &mut Page, models: &Models) {
    page.heading("The sensitivity");
    page.text(
        "The paper prints 134.11 Hz/MPa from 0.045 to 0.649 MPa. Any model with one free constant \
         can have that; what it cannot have is a straight line. The shift is concave in the \
         stiffness, so that the slope depends on where it is taken:",
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
    for (name, tier, control) in [
        ("T0", Tier::T0, Control::Indentation),
        ("T1", Tier::T1, Control::Indentation),
        ("E1", Tier::E1, Control::Indentation),
        ("reference, indentation held", Tier::Reference, Control::Indentation),
        ("reference, stage held", Tier::Reference, Control::Stage),
    ] {
        let way = noiseless(models, tier, control);
        let at = |young: f64| way.exact_hz(young, Direction::Front, 0.0);
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
            format!("{:+.2}", chord - 134.11),
        ];
        table.row(head.into_iter().chain([0.045, 0.235, 0.649, 1.0, 3.0].map(slope)));
    }
    page.table(table);
}

fn figure_8(page: &mut Page) {
    page.heading("Figure 8: the three sensors");
    page.text(
        "The paper finds D1 and D1/D2 of (35, 0.5) to be the best of the three. By its own equations \
         (8) and (9) D1/D2 does not contain the length at all, and D1 of the shorter sensor is \
         smaller, because it resonates higher. No model that vibrates gives the paper's order of D1.",
    );
    let mut table =
        Table::new(&["model", "quantity", "L 35, R 0.5", "L 35, R 1", "L 20, R 0.5", "best"]);
    let ratio = SAMPLES_MPA[2] / SAMPLES_MPA[0];
    let by_equation = |sensor: &Compared| {
        let depth = 0.5 / sensor.radius_mm;
        influence_over_discrimination(depth, ratio, Arithmetic::Exact)
            .expect("the paper's depths are within its equation")
    };
    let frozen = |sensor: &Compared| {
        let fall = angle_influence(0.5 / sensor.radius_mm, Arithmetic::Exact)
            .expect("the paper's depths are within its equation");
        fall * sensor.radius_mm * 35.0 / sensor.length_mm
    };
    let sensors = compared(ContactLaw::Sneddon);
    push(&mut table, "equation (9)", "D1/D2", sensors.each_ref().map(by_equation), 4);
    let of_first = frozen(&sensors[0]);
    let relative = sensors.each_ref().map(|sensor| frozen(sensor) / of_first);
    push(&mut table, "equation (8), ω and Z1 kept", "D1, relative", relative, 3);
    for (name, tier, control) in [
        ("T1", Tier::T1, Control::Indentation),
        ("reference, indentation held", Tier::Reference, Control::Indentation),
        ("reference, stage held", Tier::Reference, Control::Stage),
    ] {
        let d1_d2 = sensors.each_ref().map(|sensor| {
            let way = noiseless(&sensor.models, tier, control);
            let [soft, hard] = [0, 2].map(|sample| mean_hz(&way, SAMPLES_MPA[sample], 0.0));
            let d1 = hard - mean_hz(&way, SAMPLES_MPA[2], 45.0);
            (d1, d1 / (hard - soft))
        });
        push(&mut table, name, "D1 of sample 3, Hz", d1_d2.map(|(d1, _)| d1), 2);
        push(&mut table, name, "D1/D2", d1_d2.map(|(_, quotient)| quotient), 3);
    }
    page.table(table);
    page.text("No-load resonance and sensitivity of the three:");
    let mut facts = Table::new(&["sensor", "no-load resonance, Hz", "sensitivity, Hz/MPa"]);
    for sensor in &sensors {
        let way = noiseless(&sensor.models, Tier::Reference, Control::Indentation);
        let at = |young: f64| way.exact_hz(young, Direction::Front, 0.0);
        let chord = (at(SAMPLES_MPA[4]) - at(SAMPLES_MPA[0])) / (SAMPLES_MPA[4] - SAMPLES_MPA[0]);
        let no_load = sensor.models.no_load_hz(Tier::Reference);
        facts.row([sensor.name.to_owned(), format!("{no_load:.1}"), format!("{chord:.1}")]);
    }
    page.table(facts);
}

fn push(table: &mut Table, model: &str, quantity: &str, values: [f64; 3], digits: usize) {
    let best = (0..3)
        .min_by(|&a, &b| values[a].total_cmp(&values[b]))
        .map_or("", |index| ["L 35, R 0.5", "L 35, R 1", "L 20, R 0.5"][index]);
    // Equal to the last digit shown is no better.
    let is_shared = values
        .iter()
        .filter(|v| (*v - values.iter().copied().fold(f64::MAX, f64::min)).abs() < 1e-9)
        .count()
        > 1;
    let best = if is_shared { "both lengths" } else { best };
    let head = [model.to_owned(), quantity.to_owned()];
    let shown = values.map(|value| format!("{value:.digits$}"));
    table.row(head.into_iter().chain(shown).chain([best.to_owned()]));
}
