//! Figure 9: what the paper says of its sensor, judged together over the arm and the tangential
//! stiffness.

use rayon::prelude::*;
use rig_analysis::recognition::{Credit, Tally, judge};
use rig_chart::{Axis, Chart, Point, Rule, Series};
use rig_contact::{ContactLaw, Direction, Friction, Models, Sensor, SensorDesign, Tier};

use super::{
    figures::{mean_hz, noiseless, spread},
    lattice::{INTERVALS_DEG, PRINTED, RangeOf, ranges},
};
use crate::{
    files::Csv,
    page::{Page, Table},
    paper_bench::{Control, SAMPLES_MPA},
    simulate::TouchSimulation,
};

/// Largest spread of the directions at 45° without significant influence, percent.
const SPREAD_MAX: f64 = 5.0;
/// Largest difference from a printed rate, points: the scatter of 500 points.
const RATE_MAX: f64 = 1.5;
/// Largest small fall of the mean shift to 45°, percent. By equation (7) it is 11.9 %.
const FALL_MAX: f64 = 15.0;

/// A combination with its three numbers.
#[derive(Debug, Clone, Copy)]
struct Combination {
    arm_mm: f64,
    ratio: f64,
    /// Largest over the samples, percent.
    spread: f64,
    /// Rates of the intervals of angles, percent.
    rates: [f64; 4],
    /// Largest over the samples, percent.
    fall: f64,
}

impl Combination {
    fn of(arm_mm: f64, ratio: f64) -> Self {
        let design = SensorDesign { arm_mm, ..SensorDesign::reference() };
        let sensor = Sensor::new(design).expect("these arms can be built");
        let models = Models::new(&sensor, ContactLaw::Sneddon);
        let simulation = TouchSimulation {
            law: ContactLaw::SneddonSeries,
            friction: Friction::Elastic { tangential_ratio: ratio },
            ..noiseless(&models, Tier::E1, Control::Indentation)
        };
        let fall = |&young: &f64| {
            1.0 - mean_hz(&simulation, young, 45.0) / mean_hz(&simulation, young, 0.0)
        };
        let most = |found: f64, value: f64| f64::max(found, 100.0 * value);
        Self {
            arm_mm,
            ratio,
            spread: SAMPLES_MPA.iter().map(|young| spread(&simulation, *young)).fold(0.0, most),
            rates: INTERVALS_DEG.map(|largest_deg| rate(&simulation, largest_deg)),
            fall: SAMPLES_MPA.iter().map(fall).fold(f64::MIN, most),
        }
    }

    /// Whether each of the three statements holds: direction, rates, fall.
    fn holds(&self) -> [bool; 3] {
        let worst = self.rates.iter().zip(PRINTED[0]).map(|(rate, printed)| (rate - printed).abs());
        [self.spread <= SPREAD_MAX, worst.fold(0.0, f64::max) <= RATE_MAX, self.fall <= FALL_MAX]
    }

    /// By how much the statements fail, each in units of its limit; zero where all hold.
    fn miss(&self) -> f64 {
        let worst = self.rates.iter().zip(PRINTED[0]).map(|(rate, printed)| (rate - printed).abs());
        let worst = worst.fold(0.0, f64::max);
        [self.spread / SPREAD_MAX, worst / RATE_MAX, self.fall / FALL_MAX]
            .into_iter()
            .fold(0.0, |most, part| f64::max(most, part - 1.0))
    }
}

/// The rate without noise over an interval of angles, percent, by even steps of the angle.
fn rate(simulation: &TouchSimulation<'_>, largest_deg: f64) -> f64 {
    const STEPS: u32 = 100;
    let ranges = ranges(simulation, largest_deg, RangeOf::Interval);
    let mut tally = Tally::default();
    for (sample, &young_mpa) in SAMPLES_MPA.iter().enumerate() {
        for direction in Direction::ALL {
            for step in 0..STEPS {
                let angle = largest_deg * (f64::from(step) + 0.5) / f64::from(STEPS);
                let shift_hz = simulation.exact_hz(young_mpa, direction, angle);
                tally.add(judge(&ranges, sample, shift_hz));
            }
        }
    }
    100.0 * tally.rate(Credit::Shared).expect("points were judged")
}

pub(super) fn add(page: &mut Page) {
    let arms = (0..=40).map(|step| 0.3 * f64::from(step));
    let grid: Vec<(f64, f64)> =
        arms.flat_map(|arm| (0..=24).map(move |step| (arm, 0.05 * f64::from(step)))).collect();
    let all: Vec<Combination> =
        grid.into_par_iter().map(|(arm_mm, ratio)| Combination::of(arm_mm, ratio)).collect();
    page.heading("Figure 9: three statements together");
    page.text(format!(
        "The paper says three things of one sensor: the direction has no significant influence \
         (Figure 6), the rates are 100, 100, 100 and 94.1 % (Figure 9), and the fall of the shift \
         to 45° is small (Figure 7). Each of them holds for some sensor. Here they are judged \
         together, without noise, over {} combinations of an arm from 0 to 12 mm and a tangential \
         over normal stiffness from 0 to 1.2: a spread of the directions at 45° of at most \
         {SPREAD_MAX} %, rates within {RATE_MAX} points of the printed ones (the scatter of 500 \
         points), and a mean shift that falls by at most {FALL_MAX} %, for every sample.",
        all.len()
    ));
    page.table(table(&all));
    let together = all.iter().filter(|one| one.holds() == [true; 3]).count();
    page.text(if together == 0 {
        "None of these combinations gives all three. The rate to 45° that our sensor of 8 mm gives from \
         mechanics alone, in the first table of Figure 9, belongs to an arm whose directions differ by a \
         fifth at 45°, and whose shift falls by as much. This does not show that no sensor has all three; \
         none was found."
            .to_owned()
    } else {
        format!("{together} of these combinations give all three.")
    });
    page.chart("figure-9-joint.svg", chart(&all));
    let mut data = Csv::new(&[
        "arm_mm",
        "tangential_ratio",
        "spread_percent",
        "rate_15_percent",
        "rate_30_percent",
        "rate_45_percent",
        "fall_percent",
    ]);
    for one in &all {
        let [_, to_15, to_30, to_45] = one.rates;
        let values = [one.arm_mm, one.ratio, one.spread, to_15, to_30, to_45, one.fall];
        data.row(values.map(|value| format!("{value:.2}")));
    }
    page.data("joint.csv", data.text());
}

/// For each choice of statements, the combinations and the one that comes closest to the rest.
fn table(all: &[Combination]) -> Table {
    let count = |wanted: [bool; 3]| {
        let meets =
            |one: &&Combination| one.holds().iter().zip(wanted).all(|(is, want)| *is || !want);
        let found: Vec<&Combination> = all.iter().filter(meets).collect();
        let closest = found.iter().min_by(|a, b| a.miss().total_cmp(&b.miss())).copied();
        (found.len(), closest)
    };
    let mut table = Table::new(&[
        "statements that hold",
        "combinations",
        "closest to the rest: arm, mm",
        "tangential over normal stiffness",
        "spread, %",
        "rates, %",
        "fall, %",
    ]);
    let rows = [
        ("direction", [true, false, false]),
        ("rates", [false, true, false]),
        ("fall", [false, false, true]),
        ("direction and rates", [true, true, false]),
        ("direction and fall", [true, false, true]),
        ("rates and fall", [false, true, true]),
        ("all three", [true; 3]),
    ];
    for (name, wanted) in rows {
        let (found, closest) = count(wanted);
        let cells = closest.map_or_else(
            || std::array::from_fn(|_| String::new()),
            |one| {
                [
                    format!("{:.1}", one.arm_mm),
                    format!("{:.2}", one.ratio),
                    format!("{:.1}", one.spread),
                    one.rates.map(|rate| format!("{rate:.1}")).join("/"),
                    format!("{:.1}", one.fall),
                ]
            },
        );
        table.row([name.to_owned(), found.to_string()].into_iter().chain::<[String; 5]>(cells));
    }
    table
}

fn chart(all: &[Combination]) -> Chart {
    let mut chart = Chart::new(
        "Figure 9: direction, rate and fall together",
        "Spread of the directions at 45° against the fall of the mean shift, for each combination \
         of arm and tangential stiffness. Marks tell whether the rates are those of the paper; all \
         three statements would hold in the lower left corner, left of and below the dashed lines.",
        Axis::linear("spread of the directions at 45°, %").with_range(0.0, 60.0),
        Axis::linear("fall of the mean shift to 45°, %"),
    );
    for (colour, (name, is_printed)) in
        [("other rates", false), ("rates of the paper", true)].into_iter().enumerate()
    {
        let points = all
            .iter()
            .filter(|one| one.holds()[1] == is_printed && one.spread <= 60.0)
            .map(|one| Point {
                x: one.spread,
                y: one.fall,
                error: None,
                note: Some(format!("arm {:.1} mm, ratio {:.2}", one.arm_mm, one.ratio)),
            });
        chart.series.push(Series::scatter(name, colour, points.collect::<Vec<_>>()));
    }
    chart.rules.push(Rule::AtX { value: SPREAD_MAX, label: format!("{SPREAD_MAX} %") });
    chart.rules.push(Rule::AtY { value: FALL_MAX, label: format!("small: {FALL_MAX} %") });
    chart
}
