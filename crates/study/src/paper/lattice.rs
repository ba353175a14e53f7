//! Figure 9: recognition of the points of a lattice.

use rig_analysis::{
    classify::{Classifier, Decision},
    recognition::{Credit, Range, Tally, judge},
    score::grouped_95,
};
use rig_chart::{Axis, Chart, Series, Stroke};
use rig_contact::{ContactLaw, Direction, Friction, Tier};

use super::{Compared, compared};
use crate::{
    page::{Page, Table},
    paper_bench::{Control, SAMPLES_MPA},
    simulate::{Nuisances, TouchSimulation},
};
use rig_model::random::Stream;

/// Points of a sample's lattice.
const POINTS: u32 = 100;
/// Largest angles of the paper's intervals, degrees.
pub(super) const INTERVALS_DEG: [f64; 4] = [0.0, 15.0, 30.0, 45.0];
/// The rates that the paper prints, percent, for its three sensors over these intervals.
pub(super) const PRINTED: [[f64; 4]; 3] =
    [[100.0, 100.0, 100.0, 94.1], [100.0, 96.7, 79.6, 73.7], [100.0, 77.3, 67.0, 55.4]];

/// The definition of a sample's range of shifts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RangeOf {
    /// The shifts at the ends of the interval of angles, as the paper words it.
    Ends,
    /// The least and the greatest shift in the interval.
    Interval,
}

/// The treatment of a point outside every range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outside {
    /// The point is not recognised.
    Lost,
    /// The point counts for the sample with the nearest range.
    Nearest,
}

impl Outside {
    /// The shift that is judged: for `Nearest` the nearest end of a range.
    fn judged_hz(self, ranges: &[Range], shift_hz: f64) -> f64 {
        if self == Self::Lost || ranges.iter().any(|range| range.contains(shift_hz)) {
            return shift_hz;
        }
        let ends = ranges.iter().flat_map(|range| [range.min_hz, range.max_hz]);
        ends.min_by(|a, b| (a - shift_hz).abs().total_cmp(&(b - shift_hz).abs()))
            .unwrap_or(shift_hz)
    }
}

/// Each sample's range of shifts over an interval of angles, in all directions.
pub(super) fn ranges(
    simulation: &TouchSimulation<'_>,
    largest_deg: f64,
    of: RangeOf,
) -> Vec<Range> {
    let range = |&young_mpa: &f64| {
        let shifts = Direction::ALL.into_iter().flat_map(|direction| {
            let shift = |angle: f64| simulation.exact_hz(young_mpa, direction, angle);
            let highest = (of == RangeOf::Interval).then(|| highest(shift, largest_deg));
            [shift(0.0), shift(largest_deg)].into_iter().chain(highest)
        });
        Range::of(shifts).expect("an interval has ends")
    };
    SAMPLES_MPA.iter().map(range).collect()
}

/// The largest shift in an interval of angles, for a shift with a single maximum.
fn highest(shift: impl Fn(f64) -> f64, largest_deg: f64) -> f64 {
    /// Cuts of a third of the interval, down to 3e-4 of it; the shift is flat at its maximum.
    const CUTS: u32 = 20;
    let (mut low, mut high) = (0.0, largest_deg);
    for _ in 0..CUTS {
        let (left, right) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if shift(left) < shift(right) { low = left } else { high = right }
    }
    shift(0.5 * (low + high))
}

/// One pass over the lattices of all samples.
pub(super) fn pass(
    simulation: &TouchSimulation<'_>,
    ranges: &[Range],
    outside: Outside,
    largest_deg: f64,
    points: u32,
    random: &mut Stream,
) -> Tally {
    let mut tally = Tally::default();
    for (sample, &young_mpa) in SAMPLES_MPA.iter().enumerate() {
        for _ in 0..points {
            let direction = random.pick(&Direction::ALL);
            let angle = largest_deg * random.uniform();
            let shift = simulation.read_hz(young_mpa, direction, angle, random);
            tally.add(judge(ranges, sample, outside.judged_hz(ranges, shift)));
        }
    }
    tally
}

pub(super) fn add(page: &mut Page, repeats: u32, seed: u64) {
    page.heading("Figure 9: blind recognition in simulation");
    page.text(
        "As the paper defines it, a sample's range of shifts runs over the interval of angles. A \
         point at a random angle is recognised if it lies in its own range and in no other, and \
         \"may be misjudged\" if it lies in another range too. Such points count by half here. \
         Rates of 100 points of 5 samples are multiples of 0.2 %; of the printed rates 96.7, 77.3, \
         73.7 and 94.1 are not, so that points were counted in parts or by directions. The paper \
         takes the range at the boundary of the interval; with an arm, the shift to the front \
         rises first, and such a range misses the points in between. The ranges are those of the model \
         that also makes the points: a bench that differs from its model recognises fewer.",
    );
    page.table(by_ranges(repeats, seed));
    page.text(
        "With ranges over the whole interval and an arm of 8 mm, the first row follows from \
         mechanics alone, without noise: only samples 3 and 4 overlap, and only beyond 30°. With this \
         arm the directions spread by a fifth, which the paper does not have (see the three statements \
         below). The other two rows do not follow: by the same mechanics they are about as good as \
         the first.",
    );
    page.chart("figure-9.svg", chart(repeats, seed));
    page.heading("Figure 9: recognition by calibrated classes");
    page.text(format!(
        "The same five samples and intervals, with the errors of a bench: {} Hz, {} mm of depth, \
         {}° of angle, {} % of stiffness from point to point. Logarithms of shifts are compared \
         with centres calibrated on twelve touches of each sample, in the paper's directions and \
         angles. With a known angle the shift is first divided by that of the reference sample at \
         the same pose.",
        Nuisances::BENCH.shift_hz,
        Nuisances::BENCH.depth_mm,
        Nuisances::BENCH.angle_deg,
        100.0 * Nuisances::BENCH.young_rel,
    ));
    page.table(by_classifier(repeats, seed));
}

/// Figure 9 as a chart: our rates without noise beside the printed ones.
fn chart(repeats: u32, seed: u64) -> Chart {
    let mut chart = Chart::new(
        "Figure 9: recognised points over the largest angle",
        "Rates of the three sensors: solid lines are ours without noise, dashed lines the printed \
         ones.",
        Axis::linear("largest contact angle, °").with_ticks(&INTERVALS_DEG),
        Axis::linear("recognised, %"),
    );
    for (index, sensor) in compared(ContactLaw::Sneddon).iter().enumerate() {
        let ours = INTERVALS_DEG.iter().enumerate().map(|(interval, &largest_deg)| {
            let quiet = Nuisances::NONE;
            (
                largest_deg,
                rate(
                    sensor,
                    [index, interval],
                    quiet,
                    RangeOf::Interval,
                    Credit::Shared,
                    repeats,
                    seed,
                ),
            )
        });
        let ours: Vec<(f64, f64)> = ours.collect();
        let ours = Series::joined(&format!("{}, ours", sensor.name), index, ours);
        chart.series.push(ours.named_at_end());
        let printed: Vec<(f64, f64)> = INTERVALS_DEG.into_iter().zip(PRINTED[index]).collect();
        let printed = Series::joined(&format!("{}, printed", sensor.name), index, printed);
        chart.series.push(Series { stroke: Some(Stroke::Dashed), ..printed }.named_at_end());
    }
    chart
}

/// The rate of a sensor over an interval, percent.
fn rate(
    sensor: &Compared,
    [index, interval]: [usize; 2],
    nuisances: Nuisances,
    of: RangeOf,
    credit: Credit,
    repeats: u32,
    seed: u64,
) -> f64 {
    let largest_deg = INTERVALS_DEG[interval];
    let simulation = TouchSimulation {
        models: &sensor.models,
        tier: Tier::E1,
        law: ContactLaw::Sneddon,
        friction: Friction::Sticking,
        control: Control::Indentation,
        nuisances,
    };
    let ranges = ranges(&simulation, largest_deg, of);
    let mut random = Stream::new(seed, (4 * index + interval) as u64);
    let points = POINTS * repeats;
    let tally = pass(&simulation, &ranges, Outside::Lost, largest_deg, points, &mut random);
    100.0 * tally.rate(credit).expect("points were judged")
}

fn by_ranges(repeats: u32, seed: u64) -> Table {
    let mut table = Table::new(&[
        "sensor",
        "angles",
        "printed, %",
        "ours, no noise, %",
        "difference",
        "ambiguous not counted / counted in full",
        "ranges from the ends, %",
        "ours on the bench, %",
    ]);
    for (index, sensor) in compared(ContactLaw::Sneddon).iter().enumerate() {
        for (interval, &largest_deg) in INTERVALS_DEG.iter().enumerate() {
            let rate = |nuisances: Nuisances, of: RangeOf, credit: Credit| {
                rate(sensor, [index, interval], nuisances, of, credit, repeats, seed)
            };
            let quiet = |of, credit| rate(Nuisances::NONE, of, credit);
            let ours = quiet(RangeOf::Interval, Credit::Shared);
            let [none, full] =
                [Credit::None, Credit::Full].map(|credit| quiet(RangeOf::Interval, credit));
            let printed = PRINTED[index][interval];
            // A range without width recognises no noisy point.
            let on_bench = if largest_deg > 0.0 {
                format!("{:.1}", rate(Nuisances::BENCH, RangeOf::Interval, Credit::Shared))
            } else {
                "no range".to_owned()
            };
            table.row([
                sensor.name.to_owned(),
                format!("0 to {largest_deg}°"),
                format!("{printed:.1}"),
                format!("{ours:.1}"),
                format!("{:+.1}", ours - printed),
                format!("{none:.1} / {full:.1}"),
                format!("{:.1}", quiet(RangeOf::Ends, Credit::Shared)),
                on_bench,
            ]);
        }
    }
    table
}

fn by_classifier(repeats: u32, seed: u64) -> Table {
    let mut table = Table::new(&[
        "sensor",
        "angles",
        "printed, %",
        "angle unknown, %",
        "95 % interval",
        "angle known, %",
        "95 % interval",
    ]);
    for (index, sensor) in compared(ContactLaw::Sneddon).iter().enumerate() {
        let simulation = TouchSimulation {
            models: &sensor.models,
            tier: Tier::E1,
            law: ContactLaw::Sneddon,
            friction: Friction::Sticking,
            control: Control::Indentation,
            nuisances: Nuisances::BENCH,
        };
        for (interval, &largest_deg) in INTERVALS_DEG.iter().enumerate() {
            let mut random = Stream::new(seed, 100 + (4 * index + interval) as u64);
            let counts = [false, true].map(|is_known| -> Vec<u32> {
                let experiment = |_| recognised(&simulation, largest_deg, is_known, &mut random);
                (0..repeats).map(experiment).collect()
            });
            let [unknown, known] = counts.map(|correct| {
                // The touches of an experiment share their calibration.
                let (low, high) = grouped_95(&correct, TRIALS);
                let correct = f64::from(correct.iter().sum::<u32>());
                let rate = 100.0 * correct / f64::from(repeats * TRIALS);
                [format!("{rate:.2}"), format!("{:.2} to {:.2}", 100.0 * low, 100.0 * high)]
            });
            let head = [
                sensor.name.to_owned(),
                format!("0 to {largest_deg}°"),
                format!("{:.1}", PRINTED[index][interval]),
            ];
            table.row(head.into_iter().chain(unknown).chain(known));
        }
    }
    table
}

/// Blind touches after each calibration.
const TRIALS: u32 = 100;

/// The number of recognised blind touches after one calibration.
fn recognised(
    simulation: &TouchSimulation<'_>,
    largest_deg: f64,
    is_known: bool,
    random: &mut Stream,
) -> u32 {
    // With an unknown pose the shift is compared without division.
    let divisor = |direction, angle| {
        if is_known { simulation.exact_hz(SAMPLES_MPA[2], direction, angle) } else { 1.0 }
    };
    let (mut values, mut labels) = (Vec::new(), Vec::new());
    for (sample, &young_mpa) in SAMPLES_MPA.iter().enumerate() {
        for direction in Direction::ALL {
            for share in [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0] {
                let angle = share * largest_deg;
                let shift = simulation.read_hz(young_mpa, direction, angle, random);
                values.push(shift / divisor(direction, angle));
                labels.push(sample);
            }
        }
    }
    let classifier = Classifier::calibrated(&values, &labels, SAMPLES_MPA.len())
        .expect("shifts of the samples are far above the noise");
    let is_right = |random: &mut Stream| {
        let sample = random.pick(&[0, 1, 2, 3, 4]);
        let direction = random.pick(&Direction::ALL);
        let angle = largest_deg * random.uniform();
        let shift = simulation.read_hz(SAMPLES_MPA[sample], direction, angle, random);
        let verdict = classifier.classify(shift / divisor(direction, angle), 0.0);
        matches!(verdict, Some(Decision::Class { class, .. }) if class == sample)
    };
    (0..TRIALS).map(|_| u32::from(is_right(random))).sum()
}
