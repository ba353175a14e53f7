//! The cost of an evaluation, including the contact at rest.
//!
//! Costs depend on the computer and its load. They are stored in separate files, so that the rest
//! of the study is reproducible.

use std::{
    collections::BTreeMap,
    hint::black_box,
    time::{Duration, Instant},
};

use num_complex::Complex64;
use rig_contact::{ContactLaw, Direction, Models, Sensor, Tier};

use super::variant::Variant;
use crate::{
    files::Csv,
    paper_bench::{Control, INDENTATION_MM, contact, tissue},
};

/// Nanoseconds of an evaluation by each variant.
pub(super) type Costs = BTreeMap<Variant, f64>;

/// Measured once in one session on one core, release build; `rig-study models --measure` measures
/// again.
const STORED: &str = include_str!("cost.csv");

/// The stored costs.
pub(super) fn stored() -> Costs {
    let line = |line: &str| {
        let [tier, law, control, nanoseconds] =
            line.split(',').collect::<Vec<_>>().try_into().ok()?;
        let tier = Tier::ALL.into_iter().find(|one| one.name() == tier)?;
        let law = ContactLaw::ALL.into_iter().find(|one| one.name() == law)?;
        let control = Control::ALL.into_iter().find(|one| one.name() == control)?;
        Some((Variant { tier, law, control }, nanoseconds.parse().ok()?))
    };
    STORED.lines().filter_map(line).collect()
}

/// The cost of E1 with the series contact radius and the indentation held, to which the page compares the others.
/// Ratios of one session differ less from computer to computer than nanoseconds.
pub(super) fn unit_ns(costs: &Costs) -> f64 {
    let (tier, law, control) = (Tier::E1, ContactLaw::SneddonSeries, Control::Indentation);
    costs.get(&Variant { tier, law, control }).copied().unwrap_or(f64::NAN)
}

/// A ratio with two digits.
pub(super) fn ratio(of_unit: f64) -> String {
    let decimals = if of_unit < 1.0 { 2 } else { usize::from(of_unit < 10.0) };
    format!("{of_unit:.decimals$}")
}

/// Measures every variant in turn, each by the shortest of several runs.
pub(super) fn measure() -> Costs {
    Variant::all().map(|variant| (variant, measure_one(variant))).collect()
}

/// The costs as a table.
pub(super) fn csv(costs: &Costs) -> String {
    let mut table = Csv::new(&["tier", "law", "control", "nanoseconds"]);
    for (variant, nanoseconds) in costs {
        let names = [variant.tier.name(), variant.law.name(), variant.control.name()];
        table.row(names.map(str::to_owned).into_iter().chain([format!("{nanoseconds:.0}")]));
    }
    table.text().to_owned()
}

/// Number of runs, of which the shortest counts, and evaluations in each run.
const RUNS: u32 = 9;
const EVALUATIONS: u32 = 2000;

fn measure_one(variant: Variant) -> f64 {
    let models = Models::new(&Sensor::reference(), variant.law);
    let depth = variant.control.depth(INDENTATION_MM);
    let contacts = Direction::ALL.map(|direction| contact(direction, 30.0, depth, variant.law));
    let least = (0..RUNS)
        .map(|_| {
            let start = Instant::now();
            for index in 0..EVALUATIONS {
                let tissue = tissue(black_box(0.02 + 1e-4 * f64::from(index)));
                let contact = &contacts[index as usize % contacts.len()];
                // A refusal would take less time.
                let found = models.predict(variant.tier, &tissue, black_box(contact));
                black_box(found.expect("the variants are within their tiers"));
            }
            start.elapsed()
        })
        .min();
    least.unwrap_or(Duration::MAX).as_secs_f64() * 1e9 / f64::from(EVALUATIONS)
}

/// Nanoseconds of each step of an impedance.
pub(super) type ImpedanceCosts = [(&'static str, f64); 3];

const IMPEDANCE: &str = include_str!("impedance.csv");
const STEPS: [&str; 3] = ["circuit of E1", "circuit of the reference", "201 points of a circuit"];

/// The stored costs.
pub(super) fn stored_impedance() -> ImpedanceCosts {
    STEPS.map(|step| {
        let line = IMPEDANCE.lines().find_map(|line| line.strip_prefix(step)?.strip_prefix(','));
        (step, line.and_then(|cell| cell.parse().ok()).unwrap_or(f64::NAN))
    })
}

/// The impedance costs as a table.
pub(super) fn impedance_csv(costs: &ImpedanceCosts) -> String {
    let mut table = Csv::new(&["step", "nanoseconds"]);
    for (step, nanoseconds) in costs {
        table.row([(*step).to_owned(), format!("{nanoseconds:.0}")]);
    }
    table.text().to_owned()
}

/// Measures the circuit of two tiers, and 201 points of impedance of a circuit.
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

/// The shortest of several runs of an evaluation.
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
