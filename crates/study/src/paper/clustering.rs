//! Figure 13: fifty blind touches by k-means and other methods, by model and noise.

use rayon::prelude::*;
use rig_analysis::{
    classes::count_classes,
    classify::{Classifier, Decision},
    cluster::{Clustering, lloyd, optimal},
    score::{score, wilson_95},
};
use rig_chart::{Axis, Chart, Point, Rule, Series};
use rig_contact::{ContactLaw, Direction, Friction, Models, Sensor, Tier, inverse::TissueKind};

use crate::{
    page::{Page, Table},
    paper_bench::{ANGLES_DEG, Control, SAMPLES_MPA},
    simulate::{Nuisances, TouchSimulation},
};
use rig_model::random::Stream;

/// Blind touches in the paper's experiment, and the number of correct ones.
const TRIALS: usize = 50;
const PRINTED_RIGHT: u32 = 46;

/// A model of the bench.
struct BenchModel {
    name: &'static str,
    tier: Tier,
    control: Control,
    directions: &'static [Direction],
    nuisances: Nuisances,
}

/// Every model is one of these with something else in it.
const T1: BenchModel = BenchModel {
    name: "T1, no noise",
    tier: Tier::T1,
    control: Control::Indentation,
    directions: &Direction::ALL,
    nuisances: Nuisances::NONE,
};
const E1: BenchModel = BenchModel { name: "E1, no noise", tier: Tier::E1, ..T1 };
const STAGE_HELD: BenchModel = BenchModel {
    name: "E1s, bench, stage held",
    tier: Tier::E1s,
    control: Control::Stage,
    nuisances: Nuisances::BENCH,
    ..T1
};
const LEFT: &[Direction] = &[Direction::Left];

const BENCHES: [BenchModel; 9] = [
    T1,
    BenchModel {
        name: "T1, 3.4 Hz",
        nuisances: Nuisances { shift_hz: 3.4, ..Nuisances::NONE },
        ..T1
    },
    BenchModel {
        name: "T1, 0.1 mm of depth",
        nuisances: Nuisances { depth_mm: 0.1, ..Nuisances::NONE },
        ..T1
    },
    BenchModel {
        name: "T1, 10 % of stiffness",
        nuisances: Nuisances { young_rel: 0.1, ..Nuisances::NONE },
        ..T1
    },
    E1,
    BenchModel { name: "E1, bench", nuisances: Nuisances::BENCH, ..E1 },
    BenchModel {
        name: "E1, bench, left only",
        directions: LEFT,
        nuisances: Nuisances::BENCH,
        ..E1
    },
    STAGE_HELD,
    BenchModel { name: "E1s, bench, stage held, left only", directions: LEFT, ..STAGE_HELD },
];

/// Methods of classification.
const METHODS: [&str; 6] = [
    "k-means on shifts",
    "k-means on shifts, one start",
    "k-means on logarithms",
    "calibrated centres, shifts",
    "calibrated centres, angle compensated",
    "classes counted, angle compensated",
];

/// The results of one experiment.
struct Experiment {
    /// Rate of correct classifications of each method.
    rates: [f64; METHODS.len()],
    /// Whether the number of classes is found from shifts.
    is_count_of_shifts_right: bool,
    /// Whether the number of classes is found from compensated stiffnesses.
    is_count_of_stiffness_right: bool,
}

/// Relative standard deviation of a touch in a calibration without scatter.
const SINGLE_TOUCH: f64 = 0.01;
/// Smallest relative width of a class.
const NARROWEST: f64 = 0.05;

/// Largest number of classes tried.
const MOST_CLASSES: usize = 10;

pub(super) fn add(page: &mut Page, repeats: u32, seed: u64) {
    page.heading("Figure 13: fifty blind touches");
    let (low, high) = wilson_95(PRINTED_RIGHT, 50);
    page.text(format!(
        "The paper: {PRINTED_RIGHT} of 50 correct by k-means, 92 %; the 95 % interval of one such \
         experiment is {:.0} to {:.0} %. Our numbers are means over {repeats} experiments of fifty \
         touches at random angles up to 45°, by the optimal partition of least squares and by the \
         common k-means from one random start. With the indentation held, k-means on shifts fails systematically: the shifts \
         of the stiffest sample spread over as many hertz as separate the softest two, so that the \
         least squares split the one and merge the others. On a logarithmic scale all samples are \
         about equally wide. Centres calibrated beforehand, on twelve touches of each sample, do \
         not depend on the drawn touches. With a known and compensated angle, touches are \
         classified by stiffness, and even the number of classes is found; from shifts alone it is \
         not, because samples 3 and 4 overlap. The compensation has the model of the bench itself; \
         [truths.md](truths.md) has benches that differ.",
        100.0 * low,
        100.0 * high
    ));
    let mut table = Table::new(&[
        "bench",
        "k-means on shifts, %",
        "median",
        "printed",
        "from one start, %",
        "on logarithms, %",
        "calibrated centres, %",
        "calibrated centres, angle compensated, %",
        "classes counted and sorted, angle compensated, %",
        "number of classes found, %",
        "number of classes found, angle compensated, %",
    ]);
    let mut means = Vec::new();
    for (index, bench) in BENCHES.iter().enumerate() {
        let experiments = experiments(bench, repeats, seed, index as u64);
        let count = experiments.len() as f64;
        let rates: [f64; METHODS.len()] = std::array::from_fn(|method| {
            100.0 * experiments.iter().map(|one| one.rates[method]).sum::<f64>() / count
        });
        let mut of_shifts: Vec<f64> = experiments.iter().map(|one| one.rates[0]).collect();
        of_shifts.sort_by(f64::total_cmp);
        let counted = |is_right: fn(&Experiment) -> bool| {
            let right = experiments.iter().filter(|one| is_right(one)).count();
            format!("{:.0}", 100.0 * right as f64 / count)
        };
        let numbers = [
            counted(|one| one.is_count_of_shifts_right),
            counted(|one| one.is_count_of_stiffness_right),
        ];
        let [shifts, others @ ..] = rates.map(|rate| format!("{rate:.1}"));
        let median = format!("{:.0}", 100.0 * of_shifts[of_shifts.len() / 2]);
        let head = [bench.name.to_owned(), shifts, median, "92".to_owned()];
        table.row(head.into_iter().chain(others).chain(numbers));
        means.push(rates);
    }
    page.table(table);
    page.chart("figure-13-methods.svg", chart(&means));
}

fn chart(rates: &[[f64; METHODS.len()]]) -> Chart {
    let height = |row: usize| (rates.len() - row) as f64;
    let benches = BENCHES.iter().enumerate().map(|(row, bench)| (height(row), bench.name));
    let mut chart = Chart::new(
        "Classification of blind touches by method and bench",
        "Mean rate of right classifications for nine models of the bench, in the order of the \
         table; k-means on shifts is the paper's method.",
        Axis::linear("right, %"),
        Axis::linear("").with_range(0.0, height(0) + 1.0).with_names(benches),
    );
    for (method, name) in METHODS.iter().enumerate() {
        let points = rates.iter().zip(&BENCHES).enumerate().map(|(row, (rates, bench))| Point {
            x: rates[method],
            // Side by side, so that equal rates do not cover each other.
            y: height(row) + 0.13 * (2.5 - method as f64),
            error: None,
            note: Some(bench.name.to_owned()),
        });
        chart.series.push(Series::scatter(name, method, points.collect::<Vec<_>>()));
    }
    chart.size_px = (720, 520);
    chart.rules.push(Rule::AtX { value: 92.0, label: "printed: 92 %".to_owned() });
    chart
}

/// The results of many experiments.
fn experiments(bench: &BenchModel, repeats: u32, seed: u64, stream: u64) -> Vec<Experiment> {
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    let simulation = TouchSimulation {
        models: &models,
        tier: bench.tier,
        law: ContactLaw::Sneddon,
        friction: Friction::Sticking,
        control: bench.control,
        nuisances: bench.nuisances,
    };
    (0..repeats)
        .into_par_iter()
        .map(|repeat| {
            let mut random = Stream::new(seed, (200 + stream) << 32 | u64::from(repeat));
            experiment(&simulation, bench.directions, &mut random)
        })
        .collect()
}

/// A touch with its pose and shift.
struct SimulatedTouch {
    sample: usize,
    direction: Direction,
    angle_deg: f64,
    shift_hz: f64,
}

fn experiment(
    simulation: &TouchSimulation<'_>,
    directions: &[Direction],
    random: &mut Stream,
) -> Experiment {
    let count = SAMPLES_MPA.len();
    let known = calibration(simulation, directions, random);
    let blind = blind(simulation, directions, random);
    let labels: Vec<usize> = blind.iter().map(|read| read.sample).collect();
    let shifts: Vec<f64> = blind.iter().map(|read| read.shift_hz).collect();
    let logs: Vec<f64> = shifts.iter().map(|shift| shift.ln()).collect();
    let rate = |clustering: Clustering| {
        score(&labels, &clustering.clusters, count, count).rate().expect("there are touches")
    };
    let one_start = lloyd(&shifts, count, random.generator()).map(|found| found.clustering);
    let [best, one_start, logarithms] = [optimal(&shifts, count), one_start, optimal(&logs, count)]
        .map(|found| found.map_or(0.0, rate));
    let compensated = |read: &SimulatedTouch| {
        let contact = simulation.contact(read.direction, read.angle_deg);
        // Noise may exceed the shift of the softest sample.
        simulation
            .models
            .young_of_shift_mpa(simulation.tier, read.shift_hz, TissueKind::SOFT, &contact)
            .unwrap_or(1e-6)
    };
    let calibrated = |value: &dyn Fn(&SimulatedTouch) -> f64| {
        let values: Vec<f64> = known.iter().map(value).collect();
        let of: Vec<usize> = known.iter().map(|read| read.sample).collect();
        let classifier = Classifier::calibrated(&values, &of, count)
            .expect("there are four values of each sample at least");
        let is_right = |read: &&SimulatedTouch| {
            let verdict = classifier.classify(value(read), SINGLE_TOUCH);
            matches!(verdict, Some(Decision::Class { class, .. }) if class == read.sample)
        };
        blind.iter().filter(is_right).count() as f64 / TRIALS as f64
    };
    // The number of classes is the number of drawn samples, which may be less than five.
    let drawn = (0..count).filter(|sample| labels.contains(sample)).count();
    let young: Vec<f64> = blind.iter().map(compensated).collect();
    let counted = [&shifts, &young].map(|values| count_classes(values, NARROWEST, MOST_CLASSES));
    let [is_count_of_shifts_right, is_count_of_stiffness_right] =
        counted.each_ref().map(|found| found.as_ref().is_ok_and(|found| found.count == drawn));
    let counted_rate = counted[1].as_ref().map_or(0.0, |found| {
        let score = score(&labels, &found.clustering.clusters, count, found.count);
        score.rate().expect("there are touches")
    });
    let rates = [
        best,
        one_start,
        logarithms,
        calibrated(&|read| read.shift_hz),
        calibrated(&compensated),
        counted_rate,
    ];
    Experiment { rates, is_count_of_shifts_right, is_count_of_stiffness_right }
}

/// Touches of every sample in every direction at the paper's angles.
fn calibration(
    simulation: &TouchSimulation<'_>,
    directions: &[Direction],
    random: &mut Stream,
) -> Vec<SimulatedTouch> {
    let mut known = Vec::new();
    for sample in 0..SAMPLES_MPA.len() {
        for &direction in directions {
            for angle_deg in ANGLES_DEG {
                known.push(read(simulation, sample, direction, angle_deg, random));
            }
        }
    }
    known
}

/// Random blind touches.
fn blind(
    simulation: &TouchSimulation<'_>,
    directions: &[Direction],
    random: &mut Stream,
) -> Vec<SimulatedTouch> {
    (0..TRIALS)
        .map(|_| {
            let sample = random.pick(&[0, 1, 2, 3, 4]);
            let angle_deg = 45.0 * random.uniform();
            read(simulation, sample, random.pick(directions), angle_deg, random)
        })
        .collect()
}

fn read(
    simulation: &TouchSimulation<'_>,
    sample: usize,
    direction: Direction,
    angle_deg: f64,
    random: &mut Stream,
) -> SimulatedTouch {
    let shift = simulation.read_hz(SAMPLES_MPA[sample], direction, angle_deg, random);
    // A contact has a positive shift.
    SimulatedTouch { sample, direction, angle_deg, shift_hz: shift.max(1e-3) }
}
