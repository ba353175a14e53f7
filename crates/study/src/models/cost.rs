//! What an evaluation costs, the contact at rest included.

use std::{
    collections::BTreeMap,
    hint::black_box,
    time::{Duration, Instant},
};

use num_complex::Complex64;
use rig_contact::{ContactLaw, Direction, Models, Sensor, Tier};

use super::errors::Way;
use crate::{
    files::Csv,
    paper_bench::{Control, INDENTATION_MM, contact, tissue},
};

/// Nanoseconds of each way to a shift.
pub(super) type Costs = BTreeMap<Way, f64>;

/// Measured once in one run on one core, release build; `rig-study models --measure` measures anew.
const STORED: &str = include_str!("cost.csv");

/// The costs measured once.
pub(super) fn stored() -> Costs {
    let line = |line: &str| {
        let [tier, law, control, nanoseconds] =
            line.split(',').collect::<Vec<_>>().try_into().ok()?;
        let tier = Tier::ALL.into_iter().find(|one| one.name() == tier)?;
        let law = ContactLaw::ALL.into_iter().find(|one| one.name() == law)?;
        let control = Control::ALL.into_iter().find(|one| one.name() == control)?;
        Some((Way { tier, law, control }, nanoseconds.parse().ok()?))
    };
    STORED.lines().filter_map(line).collect()
}

/// Measures every way in turn, each by the least of several runs.
pub(super) fn measure() -> Costs {
    Way::all().map(|way| (way, measure_one(way))).collect()
}

/// The table.
pub(super) fn csv(costs: &Costs) -> String {
    let mut table = Csv::new(&["tier", "law", "control", "nanoseconds"]);
    for (way, nanoseconds) in costs {
        let names = [way.tier.name(), way.law.name(), way.control.name()];
        table.row(names.map(str::to_owned).into_iter().chain([format!("{nanoseconds:.0}")]));
    }
    table.text().to_owned()
}

/// Runs of which the least counts, and evaluations in each.
const RUNS: u32 = 9;
const EVALUATIONS: u32 = 2000;

fn measure_one(way: Way) -> f64 {
    let models = Models::new(&Sensor::reference(), way.law);
    let depth = way.control.depth(INDENTATION_MM);
    let contacts = Direction::ALL.map(|direction| contact(direction, 30.0, depth, way.law));
    let least = (0..RUNS)
        .map(|_| {
            let start = Instant::now();
            for index in 0..EVALUATIONS {
                let tissue = tissue(black_box(0.02 + 1e-4 * f64::from(index)));
                let contact = &contacts[index as usize % contacts.len()];
                // The shift of a refused contact would cost nothing.
                let found = models.predict(way.tier, &tissue, black_box(contact));
                black_box(found.expect("the ways are within their tiers"));
            }
            start.elapsed()
        })
        .min();
    least.unwrap_or(Duration::MAX).as_secs_f64() * 1e9 / f64::from(EVALUATIONS)
}

/// Microseconds for 201 points of impedance, and for the circuit that they come from.
pub(super) fn measure_impedance() -> (f64, f64) {
    let sensor = Sensor::reference();
    let models = Models::new(&sensor, ContactLaw::SneddonSeries);
    let depth = Control::Indentation.depth(INDENTATION_MM);
    let contact = contact(Direction::Front, 30.0, depth, ContactLaw::SneddonSeries);
    let tissue = tissue(0.235);
    let mut points = [Complex64::ZERO; 201];
    let (mut of_points, mut of_circuit) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..1000 {
        let start = Instant::now();
        let circuit = models
            .circuit(Tier::E1, black_box(&tissue), black_box(&contact))
            .expect("the contact is within the tier");
        of_circuit = of_circuit.min(start.elapsed().as_secs_f64() * 1e6);
        let circuit = black_box(circuit);
        let start = Instant::now();
        for (index, point) in (0_u32..).zip(&mut points) {
            *point = circuit.impedance_ohm(112.0 + 0.28 * f64::from(index));
        }
        black_box(&mut points);
        of_points = of_points.min(start.elapsed().as_secs_f64() * 1e6);
    }
    (of_points, of_circuit)
}
