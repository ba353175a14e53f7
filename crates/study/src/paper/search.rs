//! Whether any nuisances of any size give all printed rates of Figure 9 together.

use rayon::prelude::*;
use rig_analysis::recognition::Credit;
use rig_contact::{ContactLaw, Friction, Models, Sensor, SensorDesign, Tier};

use super::lattice::{INTERVALS_DEG, PRINTED, RangeOf, pass, ranges};
use crate::{
    page::{Page, Table},
    paper_bench::Control,
    random::Stream,
    simulate::{Nuisances, Way},
};

/// What is searched over, each in the unit interval, and what it stands for at one.
const UNKNOWNS: [(&str, f64); 7] = [
    ("arm, mm", 10.0),
    ("tangential over normal stiffness", 1.0),
    ("frequency noise, Hz", 6.0),
    ("depth noise, mm", 0.15),
    ("angle noise, °", 6.0),
    ("stiffness scatter, relative", 0.4),
    ("pivot eccentricity, mm", 1.5),
];
/// Random starts, and steps of refinement of the best.
const STARTS: u64 = 3000;
const BEST: usize = 24;
const STEPS: u64 = 120;
/// Points of each sample in a trial.
const POINTS: u32 = 60;

type Unknowns = [f64; UNKNOWNS.len()];

/// What a candidate must reproduce.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Goal {
    /// All three sensors with the same nuisances.
    Together,
    /// One sensor by itself.
    Alone(usize),
}

impl Goal {
    fn sensors(self) -> &'static [usize] {
        match self {
            Self::Together => &[0, 1, 2],
            Self::Alone(0) => &[0],
            Self::Alone(1) => &[1],
            Self::Alone(_) => &[2],
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Together => "all three",
            Self::Alone(0) => "L 35, R 0.5 alone",
            Self::Alone(1) => "L 35, R 1 alone",
            Self::Alone(_) => "L 20, R 0.5 alone",
        }
    }
}

pub(super) fn add(page: &mut Page, seed: u64) {
    page.heading("Figure 9: the search for what could give it");
    page.text(format!(
        "{STARTS} random combinations of {} unknowns, the best {BEST} of them refined, against the \
         printed rates of the intervals that have a width; at 0° a range without width recognises \
         everything or, with noise, nothing. A model that explains the rates would bring the root \
         mean square below about 1.5 points, the scatter of 500 points.",
        UNKNOWNS.len()
    ));
    let mut columns = vec!["fitted", "rms, points", "rates, %"];
    columns.extend(UNKNOWNS.map(|(name, _)| name));
    let mut table = Table::new(&columns);
    for goal in [Goal::Together, Goal::Alone(0), Goal::Alone(1), Goal::Alone(2)] {
        let (unknowns, rms) = search(goal, seed);
        let rates = rates(goal, &unknowns, seed);
        let rates = rates.map_or_else(String::new, |rates| {
            let row = |row: &[f64; 4]| row.map(|rate| format!("{rate:.0}")).join("/");
            rates.iter().map(row).collect::<Vec<_>>().join(" ")
        });
        let values = unknowns.iter().zip(UNKNOWNS).map(|(share, (_, unit))| share * unit);
        let head = [goal.name().to_owned(), format!("{rms:.1}"), rates];
        table.row(head.into_iter().chain(values.map(|value| format!("{value:.3}"))));
    }
    page.table(table);
    page.text(
        "Each row by itself has some nuisances that give it or come near; the three together have \
         none. Noise of the frequency cannot make the ball of 1 mm worse than that of 0.5 mm, because \
         its shifts are larger; noise of depth, angle or stiffness acts alike on two sensors with the \
         same ball, whatever their length. What the paper changed between its sensors besides length \
         and ball, it does not say.",
    );
}

/// The best combination for a goal and its root mean square, in points.
fn search(goal: Goal, seed: u64) -> (Unknowns, f64) {
    let judged = |unknowns: Unknowns| (unknowns, misfit(goal, &unknowns, seed));
    let mut found: Vec<(Unknowns, f64)> = (0..STARTS)
        .into_par_iter()
        .map(|start| {
            let mut random = Stream::new(seed, 1000 + start);
            judged(std::array::from_fn(|_| random.uniform()))
        })
        .collect();
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    let refined: Vec<(Unknowns, f64)> = found
        .par_iter()
        .take(BEST)
        .enumerate()
        .map(|(index, &start)| {
            let mut random = Stream::new(seed, 100_000 + index as u64);
            let mut best = start;
            for step in 0..STEPS {
                // Smaller and smaller steps.
                let width = 0.3 * (1.0 - step as f64 / STEPS as f64);
                let near = best.0.map(|share| (share + width * random.normal()).clamp(0.0, 1.0));
                let candidate = judged(near);
                if candidate.1 < best.1 {
                    best = candidate;
                }
            }
            best
        })
        .collect();
    refined.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).expect("there are starts")
}

fn misfit(goal: Goal, unknowns: &Unknowns, seed: u64) -> f64 {
    let Some(rates) = rates(goal, unknowns, seed) else { return f64::INFINITY };
    let printed = goal.sensors().iter().map(|&sensor| PRINTED[sensor]);
    let squares = rates.iter().zip(printed).flat_map(|(ours, printed)| {
        ours.iter().zip(printed).map(|(ours, printed)| (ours - printed).powi(2)).collect::<Vec<_>>()
    });
    let count = 3.0 * goal.sensors().len() as f64;
    (squares.sum::<f64>() / count).sqrt()
}

/// The rates of the goal's sensors in percent, or none when a sensor cannot be built.
fn rates(goal: Goal, unknowns: &Unknowns, seed: u64) -> Option<Vec<[f64; 4]>> {
    let value = |index: usize| unknowns[index] * UNKNOWNS[index].1;
    let sensors = [(35.0, 0.5), (35.0, 1.0), (20.0, 0.5)];
    let mut rates = Vec::new();
    for &index in goal.sensors() {
        let (length_mm, probe_radius_mm) = sensors[index];
        let design = SensorDesign {
            length_mm,
            probe_radius_mm,
            arm_mm: value(0),
            ..SensorDesign::reference()
        };
        let models = Models::new(&Sensor::new(design).ok()?, ContactLaw::Sneddon);
        let way = Way {
            models: &models,
            tier: Tier::E1,
            law: ContactLaw::SneddonSeries,
            friction: Friction::Elastic { tangential_ratio: value(1) },
            control: Control::Indentation,
            nuisances: Nuisances {
                shift_hz: value(2),
                depth_mm: value(3),
                angle_deg: value(4),
                young_rel: value(5),
                eccentricity_mm: value(6),
            },
        };
        // At one angle a range has no width, and the rate is 100 % or means nothing.
        let mut row = [100.0; 4];
        for (rate, &largest_deg) in row.iter_mut().zip(&INTERVALS_DEG).skip(1) {
            // The same draws for every candidate, so that their difference is not chance.
            let mut random = Stream::new(seed, 50 + index as u64);
            let ranges = ranges(&way, largest_deg, RangeOf::Interval);
            let tally = pass(&way, &ranges, largest_deg, POINTS, &mut random);
            *rate = 100.0 * tally.rate(Credit::Shared)?;
        }
        rates.push(row);
    }
    Some(rates)
}
