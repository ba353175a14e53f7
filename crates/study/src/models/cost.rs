//! What an evaluation costs, the contact at rest included.
//!
//! Costs are of a computer and an hour. They are kept in files by themselves, so that everything
//! else that the study writes is the same wherever it runs.

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

/// Nanoseconds of each step to an impedance.
pub(super) type ImpedanceCosts = [(&'static str, f64); 3];

const IMPEDANCE: &str = include_str!("impedance.csv");
const STEPS: [&str; 3] = ["circuit of E1", "circuit of the reference", "201 points of a circuit"];

/// The costs measured once.
pub(super) fn stored_impedance() -> ImpedanceCosts {
    STEPS.map(|step| {
        let line = IMPEDANCE.lines().find_map(|line| line.strip_prefix(step)?.strip_prefix(','));
        (step, line.and_then(|cell| cell.parse().ok()).unwrap_or(f64::NAN))
    })
}

/// The table.
pub(super) fn impedance_csv(costs: &ImpedanceCosts) -> String {
    let mut table = Csv::new(&["step", "nanoseconds"]);
    for (step, nanoseconds) in costs {
        table.row([(*step).to_owned(), format!("{nanoseconds:.0}")]);
    }
    table.text().to_owned()
}

/// Measures a circuit by two tiers, and 201 points of impedance of one.
pub(super) fn measure_impedance() -> ImpedanceCosts {
    let sensor = Sensor::reference();
    let models = Models::new(&sensor, ContactLaw::SneddonSeries);
    let depth = Control::Indentation.depth(INDENTATION_MM);
    let contact = contact(Direction::Front, 30.0, depth, ContactLaw::SneddonSeries);
    let tissue = tissue(0.235);
    let circuit = |tier| {
        models
            .circuit(tier, black_box(&tissue), black_box(&contact))
            .expect("the contact is within the tier")
    };
    let read = circuit(Tier::E1);
    let mut points = [Complex64::ZERO; 201];
    let mut of_points = || {
        let circuit = black_box(read);
        for (index, point) in (0_u32..).zip(&mut points) {
            *point = circuit.impedance_ohm(112.0 + 0.28 * f64::from(index));
        }
        black_box(&mut points);
    };
    let [element, reference, sweep] = STEPS;
    [
        (element, least_ns(|| circuit(Tier::E1))),
        (reference, least_ns(|| circuit(Tier::Reference))),
        (sweep, least_ns(&mut of_points)),
    ]
}

/// The least of several runs of an evaluation.
fn least_ns<T>(mut evaluate: impl FnMut() -> T) -> f64 {
    const IN_EACH: u32 = 200;
    let least = (0..RUNS)
        .map(|_| {
            let start = Instant::now();
            for _ in 0..IN_EACH {
                black_box(evaluate());
            }
            start.elapsed()
        })
        .min();
    least.unwrap_or(Duration::MAX).as_secs_f64() * 1e9 / f64::from(IN_EACH)
}
