//! What was aimed at, and what was measured.

use rig_model::SweepMethod;

use super::{
    accuracy, best_plan,
    cell::{Cell, NOISE},
    charts,
    trial::{self, Group},
    warm::{self, Warm},
    way::Way,
};
use crate::page::Table;

/// A goal and its measurement.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Goal {
    pub(super) what: String,
    pub(super) wanted: String,
    pub(super) measured: String,
    pub(super) is_met: bool,
}

/// Everything that goals are judged by.
pub(super) struct Evidence {
    pub(super) groups: Vec<Group>,
    /// Planners from rest.
    pub(super) cold: Vec<ColdRuns>,
    pub(super) chart_cells: Vec<Group>,
    pub(super) map_cells: Vec<Group>,
    pub(super) warm_transient: Vec<Warm>,
    pub(super) warm_settled: Warm,
}

/// (Q, k², target in Hz, seconds): what the transient-aware planner is to reach from rest.
const COLD_TRANSIENT: [(f64, f64, f64, f64); 8] = [
    (30.0, 0.1, 0.03, 0.2),
    (100.0, 0.02, 0.03, 0.3),
    (10.0, 0.1, 0.03, 0.45),
    (100.0, 0.1, 0.01, 0.3),
    (100.0, 0.02, 0.01, 0.45),
    (30.0, 0.1, 0.01, 0.4),
    (30.0, 0.02, 0.01, 1.1),
    (10.0, 0.1, 0.01, 3.6),
];
/// Runs of a planner from rest, with the time in which it is to reach its target.
#[derive(Debug, Clone)]
pub(super) struct ColdRuns {
    group: Group,
    target_hz: f64,
    seconds: f64,
    /// The time of the best plan without waiting, found with the sensor known.
    best_s: Option<f64>,
}

/// (Q, k²) in which it is to track.
const WARM_TRANSIENT: [(f64, f64); 4] = [(30.0, 0.02), (30.0, 0.1), (100.0, 0.02), (100.0, 0.1)];
/// The goal of the error over its bound.
pub(super) const RATIO_MAX: f64 = 1.05;
/// The share of the runs that must be as fast.
const RUNS: f64 = 0.95;
const TIMES_THE_BEST: f64 = 1.3;
/// How far plans are followed, s.
const BEST_LIMIT_S: f64 = 10.0;
/// Where measuring takes the time, and not finding what to measure.
const FINE_TARGET_HZ: f64 = 0.01;
const WARM_PER_SECOND: f64 = 4.0;
const SETTLED_TARGET_HZ: f64 = 0.03;
const SETTLED_COLD_S: f64 = 2.5;
const SETTLED_WARM_S: f64 = 0.9;

/// The warm runs of the goals.
pub(super) fn track(runs: u32, seed: u64) -> (Vec<Warm>, Warm) {
    let cell = |q, coupling| Cell { q, coupling, noise: NOISE };
    let transient = WARM_TRANSIENT.map(|(q, coupling)| {
        warm::track(SweepMethod::Transient, cell(q, coupling), 0.01, runs, seed)
    });
    let settled =
        warm::track(SweepMethod::Adaptive, cell(30.0, 0.1), SETTLED_TARGET_HZ, runs, seed);
    (transient.to_vec(), settled)
}

/// The runs from rest of the goals.
pub(super) fn start(runs: u32, seed: u64) -> Vec<ColdRuns> {
    let transient = COLD_TRANSIENT.map(|(q, coupling, target_hz, seconds)| {
        ((q, coupling), Way::Transient { target_hz }, target_hz, seconds)
    });
    let target_hz = SETTLED_TARGET_HZ;
    let settled = ((30.0, 0.1), Way::Settled { target_hz }, target_hz, SETTLED_COLD_S);
    let all = transient.into_iter().chain([settled]);
    all.flat_map(|((q, coupling), way, target_hz, seconds)| {
        let cell = Cell { q, coupling, noise: NOISE };
        let is_transient = matches!(way, Way::Transient { .. });
        let best_s = is_transient.then(|| best_plan::time_s(&cell, target_hz, BEST_LIMIT_S));
        let groups = trial::run(cell, way, runs, seed);
        groups.into_iter().map(move |group| ColdRuns { group, target_hz, seconds, best_s })
    })
    .collect()
}

pub(super) fn judge(evidence: &Evidence) -> Vec<Goal> {
    let mut goals = vec![
        accuracy("of the charts", &evidence.chart_cells),
        accuracy(
            &format!("with a figure of merit of at least {}", accuracy::MERIT_MIN),
            &evidence.map_cells,
        ),
    ];
    goals.extend(evidence.cold.iter().map(cold));
    goals.push(near_the_best(&evidence.cold));
    goals.extend(evidence.warm_transient.iter().map(warm_rate));
    goals.push(warm_settled(&evidence.warm_settled));
    goals
}

fn accuracy(what: &str, groups: &[Group]) -> Goal {
    let unanswered = groups.iter().filter(|group| accuracy::ratio(group).is_none()).count();
    let worst = groups
        .iter()
        .filter_map(|group| Some((accuracy::ratio(group)?, group.cell)))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let (ratio, at) =
        worst.map_or((f64::INFINITY, String::new()), |(ratio, cell)| (ratio, format!(" ({cell})")));
    let refused = match unanswered {
        0 => String::new(),
        some => format!("; {some} cells refuse more than 1 % of the sweeps"),
    };
    Goal {
        what: format!("error over bound, 101 points, worst of {} cells {what}", groups.len()),
        wanted: format!("≤ {RATIO_MAX}"),
        measured: format!("{ratio:.3}{at}{refused}"),
        is_met: ratio <= RATIO_MAX && unanswered == 0,
    }
}

fn cold(runs: &ColdRuns) -> Goal {
    let ColdRuns { group, target_hz, seconds, best_s } = runs;
    let share = group.reached(*target_hz, *seconds);
    let time = |share: f64| {
        let time_s = group.time_to_reach_s(*target_hz, share);
        time_s.map_or_else(|| "for ever".to_owned(), |time_s| format!("{time_s:.2} s"))
    };
    let best =
        best_s.map_or_else(String::new, |best_s| format!("; with the sensor known {best_s:.2} s"));
    Goal {
        what: format!("{}, cold, {}: {:.0} mHz", group.way.name(), group.cell, 1000.0 * target_hz),
        wanted: format!("{seconds} s in > 95 % of the runs"),
        measured: format!(
            "{:.1} % of the runs; half take up to {}, 95 % up to {}{best}",
            100.0 * share,
            time(0.5),
            time(RUNS)
        ),
        is_met: share > RUNS,
    }
}

fn near_the_best(cold: &[ColdRuns]) -> Goal {
    let ratio = |runs: &ColdRuns| {
        let best_s = runs.best_s.filter(|_| runs.target_hz <= FINE_TARGET_HZ)?;
        let median_s = runs.group.time_to_reach_s(runs.target_hz, 0.5).unwrap_or(f64::INFINITY);
        Some((median_s / best_s, runs.group.cell))
    };
    let worst = cold.iter().filter_map(ratio).max_by(|a, b| a.0.total_cmp(&b.0));
    let (ratio, at) =
        worst.map_or((f64::INFINITY, String::new()), |(ratio, cell)| (ratio, format!(" ({cell})")));
    Goal {
        what:
            "transient-aware planner, cold, 10 mHz: median time over that of the best plan found \
               with the sensor known, worst of the cells above"
                .to_owned(),
        wanted: format!("≤ {TIMES_THE_BEST}"),
        measured: format!("{ratio:.2}{at}"),
        is_met: ratio <= TIMES_THE_BEST,
    }
}

fn warm_rate(warm: &Warm) -> Goal {
    let rate = warm.per_second();
    let floor_s = (charts::floor_hz(&warm.cell, 1.0) / warm.target_hz).powi(2);
    let floor = if floor_s * WARM_PER_SECOND > 1.0 {
        format!("; integration alone at the best frequencies takes {floor_s:.2} s a reading")
    } else {
        String::new()
    };
    Goal {
        what: format!(
            "transient-aware planner, warm, {}: {:.0} mHz",
            warm.cell,
            1000.0 * warm.target_hz
        ),
        wanted: format!("≥ {WARM_PER_SECOND} readings per second"),
        measured: format!("{rate:.2} per second{floor}"),
        is_met: rate >= WARM_PER_SECOND,
    }
}

fn warm_settled(warm: &Warm) -> Goal {
    let time_s = trial::quantile(&warm.times_s, RUNS);
    Goal {
        what: format!("settled planner, warm, {}: {:.0} mHz", warm.cell, 1000.0 * warm.target_hz),
        wanted: format!("{SETTLED_WARM_S} s in > 95 % of the runs"),
        measured: if time_s.is_finite() {
            format!("95 % of the runs take up to {time_s:.2} s")
        } else {
            "fewer than 95 % of the runs get there".to_owned()
        },
        is_met: time_s <= SETTLED_WARM_S,
    }
}

pub(super) fn table(goals: &[Goal]) -> Table {
    let mut table = Table::new(&["what", "goal", "measured", "met"]);
    for goal in goals {
        let verdict = if goal.is_met { "yes" } else { "**no**" };
        table.row(
            [&goal.what, &goal.wanted, &goal.measured, &verdict.to_owned()].map(String::clone),
        );
    }
    table
}
