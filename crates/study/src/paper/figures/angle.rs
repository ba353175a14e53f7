//! Figures 4 and 7: the shift over the angle, by equation (7) and by the models.

use rig_chart::{Axis, Chart, Series};
use rig_contact::{ContactLaw, Direction, Models, Sensor, Tier};

use super::{curve, mean_hz, noiseless};
use crate::{
    page::{Page, Table},
    paper_bench::{ANGLES_DEG, Control, SAMPLES_MPA},
    simulate::TouchSimulation,
};

pub(super) fn by_equation(page: &mut Page) {
    page.heading("Figure 4: the shift over the angle by equation (7)");
    let models = Models::new(&Sensor::reference(), ContactLaw::Paper);
    let mut chart = Chart::new(
        "Figure 4: shift of two samples over the angle by equation (7)",
        "The shifts of samples 3 and 4 fall from 0° to 90°; the fall to 45° is D1, their distance D2.",
        Axis::linear("contact angle, °").with_ticks(&[0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0]),
        Axis::linear("shift, Hz").including(0.0),
    );
    for (colour, sample) in [(0, 3), (1, 2)] {
        let simulation = TouchSimulation {
            law: ContactLaw::Paper,
            ..noiseless(&models, Tier::T0, Control::Indentation)
        };
        let points = (0..=89).map(f64::from).map(|angle| {
            (angle, simulation.exact_hz(SAMPLES_MPA[sample], Direction::Front, angle))
        });
        let line = Series::line(&format!("sample {}", sample + 1), colour, points);
        chart.series.push(line.named_at_end());
    }
    page.chart("figure-4.svg", chart);
    page.text(
        "The paper's figure is a sketch of D1 and D2 without numbers. By equation (7) D1 is the \
         same share of every shift, 11.9 % for R = δ, so that D1/D2 depends only on the two \
         stiffnesses:",
    );
    let simulation = TouchSimulation {
        law: ContactLaw::Paper,
        ..noiseless(&models, Tier::T0, Control::Indentation)
    };
    let mut table =
        Table::new(&["samples", "at 0°, Hz", "at 45°, Hz", "D1, Hz", "D2 at 0°, Hz", "D1/D2"]);
    for (hard, soft) in [(2, 0), (1, 0), (2, 1), (3, 2), (4, 3)] {
        let at = |sample: usize, angle| {
            simulation.exact_hz(SAMPLES_MPA[sample], Direction::Front, angle)
        };
        let (upright, leaning) = (at(hard, 0.0), at(hard, 45.0));
        let (d1, d2) = (upright - leaning, upright - at(soft, 0.0));
        let head = [format!("{} and {}", hard + 1, soft + 1)];
        let numbers = [upright, leaning, d1, d2].map(|hz| format!("{hz:.2}"));
        table.row(head.into_iter().chain(numbers).chain([format!("{:.3}", d1 / d2)]));
    }
    page.table(table);
}

pub(super) fn mean_of_directions(page: &mut Page, models: &Models) {
    page.heading("Figure 7: the mean of the directions");
    page.text(
        "The paper prints no numbers. It says that the curves are consistent with equation (7), \
         that the decrease is small, and that it is smaller for softer samples. By equation (7) \
         every shift falls by 11.9 % to 45°; tilt and tangential stiffness, which the equation \
         lacks, double this. Softer samples fall less in hertz; relative to the shift the softest \
         sample falls most. With the stage held the stiff samples fall less, because a smaller \
         part of the move indents them.",
    );
    let by_equation = Models::new(&Sensor::reference(), ContactLaw::Paper);
    let simulations = [
        (
            "equation (7), as T0",
            TouchSimulation {
                law: ContactLaw::Paper,
                ..noiseless(&by_equation, Tier::T0, Control::Indentation)
            },
        ),
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
        let line = curve().map(|angle| (angle, mean_hz(&simulations[1].1, young, angle)));
        let name = format!("sample {}", sample + 1);
        chart.series.push(Series::line(&name, sample, line.collect::<Vec<_>>()).named_at_end());
    }
    page.chart("figure-7.svg", chart);
    let mut table =
        Table::new(&["model", "sample", "0°, Hz", "15°", "30°", "45°", "fall to 45°, Hz", "%"]);
    for (name, simulation) in &simulations {
        for (sample, &young) in SAMPLES_MPA.iter().enumerate() {
            let shifts = ANGLES_DEG.map(|angle| mean_hz(simulation, young, angle));
            let fall = shifts[0] - shifts[3];
            let head = [(*name).to_owned(), (sample + 1).to_string()];
            let tail = [format!("{fall:.2}"), format!("{:.1}", 100.0 * fall / shifts[0])];
            table.row(head.into_iter().chain(shifts.map(|hz| format!("{hz:.2}"))).chain(tail));
        }
    }
    page.table(table);
}
