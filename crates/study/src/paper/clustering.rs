//! Figure 13: what k-means makes of fifty blind touches, by model and by noise.

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
    simulate::{Nuisances, Way},
};
use rig_model::random::Stream;

/// Blind touches in the paper's experiment, and how many were right.
const TRIALS: usize = 50;
const PRINTED_RIGHT: u32 = 46;

/// A model of the bench.
struct Bench {
    name: &'static str,
    tier: Tier,
    control: Control,
    directions: &'static [Direction],
    nuisances: Nuisances,
}

const BENCHES: [Bench; 9] = [
    Bench {
        name: "T1, no noise",
        tier: Tier::T1,
        control: Control::Indentation,
        directions: &Direction::ALL,
        nuisances: Nuisances::NONE,
    },
    Bench {
        name: "T1, 3.4 Hz",
        tier: Tier::T1,
        control: Control::Indentation,
        directions: &Direction::ALL,
        nuisances: Nuisances { shift_hz: 3.4, ..Nuisances::NONE },
    },
    Bench {
        name: "T1, 0.1 mm of depth",
        tier: Tier::T1,
        control: Control::Indentation,
        directions: &Direction::ALL,
        nuisances: Nuisances { depth_mm: 0.1, ..Nuisances::NONE },
    },
    Bench {
        name: "T1, 10 % of stiffness",
        tier: Tier::T1,
        control: Control::Indentation,
        directions: &Direction::ALL,
        nuisances: Nuisances { young_rel: 0.1, ..Nuisances::NONE },
    },
    Bench {
        name: "E1, no noise",
        tier: Tier::E1,
        control: Control::Indentation,
        directions: &Direction::ALL,
        nuisances: Nuisances::NONE,
    },
    Bench {
        name: "E1, bench",
        tier: Tier::E1,
        control: Control::Indentation,
        directions: &Direction::ALL,
        nuisances: Nuisances::BENCH,
    },
    Bench {
        name: "E1, bench, left only",
        tier: Tier::E1,
        control: Control::Indentation,
        directions: &[Direction::Left],
        nuisances: Nuisances::BENCH,
    },
    Bench {
        name: "E1s, bench, stage held",
        tier: Tier::E1s,
        control: Control::Stage,
        directions: &Direction::ALL,
        nuisances: Nuisances::BENCH,
    },
    Bench {
        name: "E1s, bench, stage held, left only",
        tier: Tier::E1s,
        control: Control::Stage,
        directions: &[Direction::Left],
        nuisances: Nuisances::BENCH,
    },
];

/// How touches are sorted.
const METHODS: [&str; 6] = [
    "k-means on shifts",
    "k-means on shifts, one start",
    "k-means on logarithms",
    "calibrated centres, shifts",
    "calibrated centres, angle compensated",
    "classes counted, angle compensated",
];

/// The rate of each method, and whether the number of classes was found from shifts and from
/// compensated stiffnesses.
struct Experiment {
    rates: [f64; METHODS.len()],
    is_count_right: [bool; 2],
}

/// Relative standard deviation of a touch that even a calibration without scatter allows for.
const SINGLE_TOUCH: f64 = 0.01;
/// Relative width below which no class is taken to be: a touch is not better than that.
const NARROWEST: f64 = 0.05;

/// Classes are not sought beyond so many.
const MOST_CLASSES: usize = 10;

pub(super) fn add(page: &mut Page, repeats: u32, seed: u64) {
    page.heading("Figure 13: fifty blind touches");
    let (low, high) = wilson_95(PRINTED_RIGHT, 50);
    page.text(format!(
        "The paper: {PRINTED_RIGHT} of 50 right by k-means, 92 %; one such experiment says 92 % with \
         a 95 % interval from {:.0} to {:.0} %. Ours are means over {repeats} experiments of fifty \
         touches, each at a random angle up to 45°, sorted by the partition of least squares that \
         exists, and by the common k-means from one random start. k-means on shifts fails by \
         itself: the stiffest sample's shifts are spread over as many hertz as lie between the \
         softest two, so that the least squares are reached by splitting the one and merging the \
         others. On a logarithmic scale every sample is about equally wide. Centres calibrated \
         beforehand, on twelve touches of each sample, do not depend on what was drawn. With the \
         angle known and compensated, touches are sorted by stiffness, and even their number of \
         classes is found without being told; from shifts alone it is not, because samples 3 and 4 \
         run into each other.",
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
        "the same, angle compensated, %",
        "classes counted and sorted, angle compensated, %",
        "number of classes found, %",
        "the same, angle compensated, %",
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
        let counted = |how: usize| {
            let right = experiments.iter().filter(|one| one.is_count_right[how]).count();
            format!("{:.0}", 100.0 * right as f64 / count)
        };
        let [shifts, others @ ..] = rates.map(|rate| format!("{rate:.1}"));
        let median = format!("{:.0}", 100.0 * of_shifts[of_shifts.len() / 2]);
        let head = [bench.name.to_owned(), shifts, median, "92".to_owned()];
        table.row(head.into_iter().chain(others).chain([counted(0), counted(1)]));
        means.push(rates);
    }
    page.table(table);
    page.chart("figure-13-methods.svg", chart(&means));
}

fn chart(rates: &[[f64; METHODS.len()]]) -> Chart {
    let mut chart = Chart::new(
        "Classification of blind touches by method and bench",
        "Mean rate of right classifications for nine models of the bench, in the order of the \
         table; k-means on shifts is the paper's method.",
        Axis::linear("bench, row of the table")
            .with_ticks(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]),
        Axis::linear("right, %"),
    );
    for (method, name) in METHODS.iter().enumerate() {
        let points = (1_u8..).zip(rates).zip(&BENCHES).map(|((row, rates), bench)| Point {
            x: f64::from(row),
            y: rates[method],
            error: None,
            note: Some(bench.name.to_owned()),
        });
        chart.series.push(Series::scatter(name, method, points.collect::<Vec<_>>()));
    }
    chart.rules.push(Rule::AtY { value: 92.0, label: "printed: 92 %".to_owned() });
    chart
}

/// The rates of every method in each of many experiments.
fn experiments(bench: &Bench, repeats: u32, seed: u64, stream: u64) -> Vec<Experiment> {
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    let way = Way {
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
            experiment(&way, bench.directions, &mut random)
        })
        .collect()
}

/// A touch as the analysis has it: what was read, and how the probe stood.
struct Read {
    sample: usize,
    direction: Direction,
    angle_deg: f64,
    shift_hz: f64,
}

fn experiment(way: &Way<'_>, directions: &[Direction], random: &mut Stream) -> Experiment {
    let count = SAMPLES_MPA.len();
    let known = calibration(way, directions, random);
    let blind = blind(way, directions, random);
    let labels: Vec<usize> = blind.iter().map(|read| read.sample).collect();
    let shifts: Vec<f64> = blind.iter().map(|read| read.shift_hz).collect();
    let logs: Vec<f64> = shifts.iter().map(|shift| shift.ln()).collect();
    let rate = |clustering: Clustering| {
        score(&labels, &clustering.clusters, count, count).rate().expect("there are touches")
    };
    let one_start = lloyd(&shifts, count, random.generator()).map(|found| found.clustering);
    let [best, one_start, logarithms] = [optimal(&shifts, count), one_start, optimal(&logs, count)]
        .map(|found| found.map_or(0.0, rate));
    let compensated = |read: &Read| {
        let contact = way.contact(read.direction, read.angle_deg);
        // Noise of the size of the softest sample's shift may take a touch away.
        way.models
            .young_of_shift_mpa(way.tier, read.shift_hz, TissueKind::SOFT, &contact)
            .unwrap_or(1e-6)
    };
    let calibrated = |value: &dyn Fn(&Read) -> f64| {
        let values: Vec<f64> = known.iter().map(value).collect();
        let of: Vec<usize> = known.iter().map(|read| read.sample).collect();
        let classifier = Classifier::calibrated(&values, &of, count)
            .expect("there are four values of each sample at least");
        let is_right = |read: &&Read| {
            let verdict = classifier.classify(value(read), SINGLE_TOUCH);
            matches!(verdict, Some(Decision::Class { class, .. }) if class == read.sample)
        };
        blind.iter().filter(is_right).count() as f64 / TRIALS as f64
    };
    // Fewer samples than five may have been drawn; those that were are to be found.
    let drawn = (0..count).filter(|sample| labels.contains(sample)).count();
    let young: Vec<f64> = blind.iter().map(compensated).collect();
    let counted = [&shifts, &young].map(|values| count_classes(values, NARROWEST, MOST_CLASSES));
    let is_count_right =
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
    Experiment { rates, is_count_right }
}

/// Touches of every sample in every direction at the paper's angles.
fn calibration(way: &Way<'_>, directions: &[Direction], random: &mut Stream) -> Vec<Read> {
    let mut known = Vec::new();
    for sample in 0..SAMPLES_MPA.len() {
        for &direction in directions {
            for angle_deg in ANGLES_DEG {
                known.push(read(way, sample, direction, angle_deg, random));
            }
        }
    }
    known
}

/// Fifty touches at random.
fn blind(way: &Way<'_>, directions: &[Direction], random: &mut Stream) -> Vec<Read> {
    (0..TRIALS)
        .map(|_| {
            let sample = random.pick(&[0, 1, 2, 3, 4]);
            let angle_deg = 45.0 * random.uniform();
            read(way, sample, random.pick(directions), angle_deg, random)
        })
        .collect()
}

fn read(
    way: &Way<'_>,
    sample: usize,
    direction: Direction,
    angle_deg: f64,
    random: &mut Stream,
) -> Read {
    let shift = way.read_hz(SAMPLES_MPA[sample], direction, angle_deg, random);
    // No noise makes a contact look like none to those who press.
    Read { sample, direction, angle_deg, shift_hz: shift.max(1e-3) }
}
