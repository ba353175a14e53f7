//! Figure 8: the three sensors that the paper compares.

use rig_chart::{Axis, Chart, Marker, Point, Rule, Series, Stroke};
use rig_contact::{
    ContactLaw, Direction, Tier,
    equations::{Arithmetic, angle_influence, influence_over_discrimination},
};

use super::{curve, mean_hz, noiseless};
use crate::{
    page::{Page, Table},
    paper::{Compared, compared},
    paper_bench::{ANGLES_DEG, Control, SAMPLES_MPA},
};

pub(super) fn add(page: &mut Page) {
    page.heading("Figure 8: the three sensors");
    page.text(
        "The paper prints no numbers; it says that (35, 0.5) has the best, that is the smallest, \
         D1 and D1/D2. Its own equation (9) does not contain the length. Equation (8) gives the \
         paper's order of D1 only if ω and Z1 of the long sensor are used for the short one too; a \
         shorter sensor resonates higher, and its shifts and D1 are smaller. None of these \
         vibrating models gives the paper's order of D1, and only T1, which lacks the tilt, that of D1/D2.",
    );
    let mut table = Table::new(&[
        "model",
        "quantity",
        "L 35, R 0.5",
        "L 35, R 1",
        "L 20, R 0.5",
        "best",
        "printed",
        "agrees",
    ]);
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
    for (name, tier, control) in MODELS {
        let d1_d2 = sensors.each_ref().map(|sensor| optimum(sensor, tier, control));
        push(&mut table, name, "D1 of sample 3, Hz", d1_d2.map(|(d1, _)| d1), 2);
        push(&mut table, name, "D1/D2", d1_d2.map(|(_, quotient)| quotient), 3);
    }
    page.table(table);
    page.chart("figure-8-shift.svg", shift_chart(&sensors));
    page.chart("figure-8-optimum.svg", optimum_chart(&sensors));
    page.text("No-load resonance and sensitivity of the three:");
    let mut facts = Table::new(&["sensor", "no-load resonance, Hz", "sensitivity, Hz/MPa"]);
    for sensor in &sensors {
        let simulation = noiseless(&sensor.models, Tier::Reference, Control::Indentation);
        let at = |young: f64| simulation.exact_hz(young, Direction::Front, 0.0);
        let chord = (at(SAMPLES_MPA[4]) - at(SAMPLES_MPA[0])) / (SAMPLES_MPA[4] - SAMPLES_MPA[0]);
        let no_load = sensor.models.no_load_hz(Tier::Reference);
        facts.row([sensor.name.to_owned(), format!("{no_load:.1}"), format!("{chord:.1}")]);
    }
    page.table(facts);
}

/// Figure 8a: the shift over the angle for samples 1 and 3.
fn shift_chart(sensors: &[Compared; 3]) -> Chart {
    let mut chart = Chart::new(
        "Figure 8a: shift over the angle of three sensors",
        "Mean of the directions for sample 3 (solid) and sample 1 (dashed), by the reference with the \
         indentation held.",
        Axis::linear("contact angle, °").with_ticks(&ANGLES_DEG),
        Axis::linear("shift, Hz").including(0.0),
    );
    for (colour, sensor) in sensors.iter().enumerate() {
        let simulation = noiseless(&sensor.models, Tier::Reference, Control::Indentation);
        for (sample, stroke) in [(2, Stroke::Solid), (0, Stroke::Dashed)] {
            let line =
                curve().map(|angle| (angle, mean_hz(&simulation, SAMPLES_MPA[sample], angle)));
            let name = format!("{}, sample {}", sensor.name, sample + 1);
            let line = Series::line(&name, colour, line.collect::<Vec<_>>());
            chart.series.push(Series { stroke: Some(stroke), ..line }.named_at_end());
        }
    }
    chart
}

/// Figure 8b: D1 and D1/D2 over those of the first sensor.
fn optimum_chart(sensors: &[Compared; 3]) -> Chart {
    let mut chart = Chart::new(
        "Figure 8b: D1 and D1/D2 of three sensors, over those of the first",
        "Circles are D1 of sample 3, diamonds D1/D2, each over its value for the first sensor. \
         By the paper both are smallest for the first sensor, so that every point would be above 1.",
        Axis::linear("sensor: length and ball radius, mm")
            .with_range(0.5, 3.5)
            .with_names((1_u8..).map(f64::from).zip(sensors.iter().map(|sensor| sensor.name))),
        Axis::linear("over that of the first sensor").including(0.0),
    );
    for (name, marker) in QUANTITIES {
        chart.series.push(Series::key(name, Some(marker), None));
    }
    for (colour, (name, tier, control)) in MODELS.into_iter().enumerate() {
        let values = sensors.each_ref().map(|sensor| optimum(sensor, tier, control));
        chart.series.push(Series::key(name, None, Some(Stroke::Solid)).coloured(colour));
        let values = values.map(|(d1, quotient)| [d1, quotient]);
        for (index, (_, marker)) in QUANTITIES.into_iter().enumerate() {
            // Side by side, so that equal values do not cover each other.
            let beside = (f64::from(u8::try_from(2 * colour + index).unwrap_or(0)) - 2.5) * 0.08;
            let points = (1_u8..).zip(&values).map(|(at, value)| Point {
                x: f64::from(at) + beside,
                y: value[index] / values[0][index],
                error: None,
                note: Some(name.to_owned()),
            });
            let scatter = Series::scatter("", colour, points);
            chart.series.push(Series { name: None, marker: Some(marker), ..scatter });
        }
    }
    chart.rules.push(Rule::AtY { value: 1.0, label: "as the first sensor".to_owned() });
    chart
}

/// The quantities of Figure 8b with their markers.
const QUANTITIES: [(&str, Marker); 2] = [("D1", Marker::Circle), ("D1/D2", Marker::Diamond)];

/// The models that the sensors are compared by.
const MODELS: [(&str, Tier, Control); 3] = [
    ("T1", Tier::T1, Control::Indentation),
    ("reference, indentation held", Tier::Reference, Control::Indentation),
    ("reference, stage held", Tier::Reference, Control::Stage),
];

/// D1 of sample 3, Hz, and D1/D2 with sample 1.
fn optimum(sensor: &Compared, tier: Tier, control: Control) -> (f64, f64) {
    let simulation = noiseless(&sensor.models, tier, control);
    let [soft, hard] = [0, 2].map(|sample| mean_hz(&simulation, SAMPLES_MPA[sample], 0.0));
    let d1 = hard - mean_hz(&simulation, SAMPLES_MPA[2], 45.0);
    (d1, d1 / (hard - soft))
}

/// A row. The smallest value of either quantity is the best.
fn push(table: &mut Table, model: &str, quantity: &str, values: [f64; 3], digits: usize) {
    const NAMES: [&str; 3] = ["L 35, R 0.5", "L 35, R 1", "L 20, R 0.5"];
    let least = values.into_iter().fold(f64::MAX, f64::min);
    // Values that are equal within rounding share the rank.
    let best: Vec<&str> = NAMES
        .into_iter()
        .zip(values)
        .filter(|(_, value)| value - least < 1e-9)
        .map(|(name, _)| name)
        .collect();
    let agrees = match best[..] {
        [one] if one == NAMES[0] => "yes",
        [_] => "no",
        _ => "in part",
    };
    let head = [model.to_owned(), quantity.to_owned()];
    let shown = values.map(|value| format!("{value:.digits$}"));
    let tail = [best.join(" and "), NAMES[0].to_owned(), agrees.to_owned()];
    table.row(head.into_iter().chain(shown).chain(tail));
}
