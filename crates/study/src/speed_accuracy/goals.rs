//! The goals and their measurements.

use rig_model::SweepMethod;

use super::{
    accuracy, best_plan,
    case::{Case, NOISE},
    charts,
    method::Method,
    trial::{self, Group},
    warm::{self, Warm},
};
use crate::page::Table;

/// A goal and its measurement.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Goal {
    pub(super) quantity: String,
    pub(super) limit: String,
    pub(super) measured: String,
    pub(super) is_met: bool,
}

/// The measurements behind the goals.
pub(super) struct Evidence {
    pub(super) groups: Vec<Group>,
    /// Planners from rest.
    pub(super) cold: Vec<ColdRuns>,
    pub(super) chart_cases: Vec<Group>,
    pub(super) map_cases: Vec<Group>,
    pub(super) warm_transient: Vec<Warm>,
    pub(super) warm_decay: Warm,
}

/// A goal of a planner from rest.
#[derive(Debug, Clone, Copy)]
struct ColdGoal {
    q: f64,
    coupling: f64,
    target_hz: f64,
    /// Time in which 95 % of the runs must reach the target, s.
    seconds: f64,
}

const fn cold_goal(q: f64, coupling: f64, target_hz: f64, seconds: f64) -> ColdGoal {
    ColdGoal { q, coupling, target_hz, seconds }
}

/// The goals of the transient-aware planner from rest.
const COLD_TRANSIENT: [ColdGoal; 8] = [
    cold_goal(30.0, 0.1, 0.03, 0.2),
    cold_goal(100.0, 0.02, 0.03, 0.3),
    cold_goal(10.0, 0.1, 0.03, 0.45),
    cold_goal(100.0, 0.1, 0.01, 0.3),
    cold_goal(100.0, 0.02, 0.01, 0.45),
    cold_goal(30.0, 0.1, 0.01, 0.4),
    cold_goal(30.0, 0.02, 0.01, 1.1),
    cold_goal(10.0, 0.1, 0.01, 3.6),
];
/// Runs of a planner from rest.
#[derive(Debug, Clone)]
pub(super) struct ColdRuns {
    group: Group,
    goal: ColdGoal,
    /// The time of the best plan for a known sensor, without waiting, s.
    best_s: Option<f64>,
}

/// The sensors of the goals for warm readings: quality factor and coupling.
const WARM_TRANSIENT: [(f64, f64); 4] = [(30.0, 0.02), (30.0, 0.1), (100.0, 0.02), (100.0, 0.1)];
/// Largest allowed ratio of error to bound.
pub(super) const RATIO_MAX: f64 = 1.05;
/// Share of the runs that must meet a time.
const RUNS: f64 = 0.95;
const TIMES_THE_BEST: f64 = 1.3;
/// Longest plan, s.
const BEST_LIMIT_S: f64 = 10.0;
/// A target at which measuring, and not the search, takes the time.
const FINE_TARGET_HZ: f64 = 0.01;
const WARM_PER_SECOND: f64 = 4.0;
const DECAY_TARGET_HZ: f64 = 0.03;
/// The goals of the free-decay planner from rest, the stays that exclude a second mode included.
const COLD_DECAY: [ColdGoal; 5] = [
    cold_goal(100.0, 0.1, 0.01, 0.90),
    cold_goal(100.0, 0.02, 0.01, 1.1),
    cold_goal(30.0, 0.1, 0.01, 0.95),
    cold_goal(30.0, 0.02, 0.01, 2.2),
    cold_goal(10.0, 0.1, 0.01, 4.8),
];
const DECAY_WARM_S: f64 = 0.5;

/// The warm runs of the goals.
pub(super) fn track(runs: u32, seed: u64) -> (Vec<Warm>, Warm) {
    let case = |q, coupling| Case { q, coupling, noise: NOISE };
    let transient = WARM_TRANSIENT.map(|(q, coupling)| {
        warm::track(SweepMethod::Transient, case(q, coupling), 0.01, runs, seed)
    });
    let decay = warm::track(SweepMethod::Adaptive, case(30.0, 0.1), DECAY_TARGET_HZ, runs, seed);
    (transient.to_vec(), decay)
}

/// The runs from rest of the goals.
pub(super) fn start(runs: u32, seed: u64) -> Vec<ColdRuns> {
    let transient = COLD_TRANSIENT.map(|goal| (goal, true));
    let all = transient.into_iter().chain(COLD_DECAY.map(|goal| (goal, false)));
    all.flat_map(|(goal, is_transient)| {
        let ColdGoal { q, coupling, target_hz, .. } = goal;
        let case = Case { q, coupling, noise: NOISE };
        let best_s = is_transient.then(|| best_plan::time_s(&case, target_hz, BEST_LIMIT_S));
        let method = if is_transient {
            Method::Transient { target_hz }
        } else {
            Method::Decay { target_hz }
        };
        let groups = trial::run(case, method, runs, seed);
        groups.into_iter().map(move |group| ColdRuns { group, goal, best_s })
    })
    .collect()
}

pub(super) fn judge(evidence: &Evidence) -> Vec<Goal> {
    let mut goals = vec![
        accuracy("of the charts", &evidence.chart_cases),
        accuracy(
            &format!("with a figure of merit of at least {}", accuracy::MERIT_MIN),
            &evidence.map_cases,
        ),
    ];
    goals.extend(evidence.cold.iter().map(cold));
    goals.push(near_the_best(&evidence.cold));
    goals.extend(evidence.warm_transient.iter().map(warm_rate));
    goals.push(warm_free_decay(&evidence.warm_decay));
    goals
}

fn accuracy(what: &str, groups: &[Group]) -> Goal {
    let unanswered = groups.iter().filter(|group| accuracy::ratio(group).is_none()).count();
    let worst = groups
        .iter()
        .filter_map(|group| Some((accuracy::ratio(group)?, group.case)))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let (ratio, at) =
        worst.map_or((f64::INFINITY, String::new()), |(ratio, case)| (ratio, format!(" ({case})")));
    let refused = match unanswered {
        0 => String::new(),
        some => format!("; {some} cases refuse more than 1 % of the sweeps"),
    };
    Goal {
        quantity: format!("error over bound, 101 points, worst of {} cases {what}", groups.len()),
        limit: format!("≤ {RATIO_MAX}"),
        measured: format!("{ratio:.3}{at}{refused}"),
        is_met: ratio <= RATIO_MAX && unanswered == 0,
    }
}

fn cold(runs: &ColdRuns) -> Goal {
    let ColdRuns { group, goal: ColdGoal { target_hz, seconds, .. }, best_s } = runs;
    let share = group.reached(*target_hz, *seconds);
    let time = |share: f64| {
        let time_s = group.time_to_reach_s(*target_hz, share);
        time_s.map_or_else(|| "never".to_owned(), |time_s| format!("{time_s:.2} s"))
    };
    let best = best_s
        .map_or_else(String::new, |best_s| format!("; best plan for a known sensor {best_s:.2} s"));
    Goal {
        quantity: format!(
            "{}, cold, {}: {:.0} mHz",
            group.method.name(),
            group.case,
            1000.0 * target_hz
        ),
        limit: format!("{seconds} s in > 95 % of the runs"),
        measured: format!(
            "{:.1} % of the runs; median {}, 95 % within {}{best}",
            100.0 * share,
            time(0.5),
            time(RUNS)
        ),
        is_met: share > RUNS,
    }
}

fn near_the_best(cold: &[ColdRuns]) -> Goal {
    let ratio = |runs: &ColdRuns| {
        let best_s = runs.best_s.filter(|_| runs.goal.target_hz <= FINE_TARGET_HZ)?;
        let median_s =
            runs.group.time_to_reach_s(runs.goal.target_hz, 0.5).unwrap_or(f64::INFINITY);
        Some((median_s / best_s, runs.group.case))
    };
    let worst = cold.iter().filter_map(ratio).max_by(|a, b| a.0.total_cmp(&b.0));
    let (ratio, at) =
        worst.map_or((f64::INFINITY, String::new()), |(ratio, case)| (ratio, format!(" ({case})")));
    Goal {
        quantity:
            "transient-aware planner, cold, 10 mHz: median time over that of the best plan for a \
               known sensor, worst of the cases above"
                .to_owned(),
        limit: format!("≤ {TIMES_THE_BEST}"),
        measured: format!("{ratio:.2}{at}"),
        is_met: ratio <= TIMES_THE_BEST,
    }
}

fn warm_rate(warm: &Warm) -> Goal {
    let rate = warm.per_second();
    let floor_s = (charts::floor_hz(&warm.case, 1.0) / warm.target_hz).powi(2);
    let floor = if floor_s * WARM_PER_SECOND > 1.0 {
        format!("; integration alone at the best frequencies takes {floor_s:.2} s a reading")
    } else {
        String::new()
    };
    Goal {
        quantity: format!(
            "transient-aware planner, warm, {}: {:.0} mHz",
            warm.case,
            1000.0 * warm.target_hz
        ),
        limit: format!("≥ {WARM_PER_SECOND} readings per second"),
        measured: format!("{rate:.2} per second{floor}"),
        is_met: rate >= WARM_PER_SECOND,
    }
}

fn warm_free_decay(warm: &Warm) -> Goal {
    let time_s = trial::quantile(&warm.times_s, RUNS);
    Goal {
        quantity: format!(
            "free-decay planner, warm, {}: {:.0} mHz",
            warm.case,
            1000.0 * warm.target_hz
        ),
        limit: format!("{DECAY_WARM_S} s in > 95 % of the runs"),
        measured: if time_s.is_finite() {
            format!("95 % of the runs within {time_s:.2} s")
        } else {
            "fewer than 95 % of the runs reach the target".to_owned()
        },
        is_met: time_s <= DECAY_WARM_S,
    }
}

pub(super) fn table(goals: &[Goal]) -> Table {
    let mut table = Table::new(&["quantity", "goal", "measured", "met"]);
    for goal in goals {
        let met = if goal.is_met { "yes" } else { "**no**" };
        table
            .row([&goal.quantity, &goal.limit, &goal.measured, &met.to_owned()].map(String::clone));
    }
    table
}
