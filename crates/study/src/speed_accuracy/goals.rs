//! The goals and their measurements.

use super::{
    accuracy,
    case::{Case, NOISE},
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
    pub(super) warm: Warm,
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

/// Runs of a planner from rest.
#[derive(Debug, Clone)]
pub(super) struct ColdRuns {
    group: Group,
    goal: ColdGoal,
}

/// Largest allowed ratio of error to bound.
pub(super) const RATIO_MAX: f64 = 1.05;
/// Share of the runs that must meet a time.
const RUNS: f64 = 0.95;
const WARM_TARGET_HZ: f64 = 0.03;
/// The goals of the free-decay planner from rest, the stays that exclude a second mode included.
const COLD: [ColdGoal; 5] = [
    cold_goal(100.0, 0.1, 0.01, 0.90),
    cold_goal(100.0, 0.02, 0.01, 1.1),
    cold_goal(30.0, 0.1, 0.01, 0.95),
    cold_goal(30.0, 0.02, 0.01, 2.2),
    cold_goal(10.0, 0.1, 0.01, 4.8),
];
const WARM_S: f64 = 0.5;

/// The warm runs of the goal.
pub(super) fn track(runs: u32, seed: u64) -> Warm {
    let case = Case { q: 30.0, coupling: 0.1, noise: NOISE };
    warm::track(case, WARM_TARGET_HZ, runs, seed)
}

/// The runs from rest of the goals.
pub(super) fn start(runs: u32, seed: u64) -> Vec<ColdRuns> {
    COLD.into_iter()
        .flat_map(|goal| {
            let ColdGoal { q, coupling, target_hz, .. } = goal;
            let case = Case { q, coupling, noise: NOISE };
            let groups = trial::run(case, Method::Decay { target_hz }, runs, seed);
            groups.into_iter().map(move |group| ColdRuns { group, goal })
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
    goals.push(warm_free_decay(&evidence.warm));
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
    let ColdRuns { group, goal: ColdGoal { target_hz, seconds, .. } } = runs;
    let share = group.reached(*target_hz, *seconds);
    let time = |share: f64| {
        let time_s = group.time_to_reach_s(*target_hz, share);
        time_s.map_or_else(|| "never".to_owned(), |time_s| format!("{time_s:.2} s"))
    };
    Goal {
        quantity: format!(
            "{}, cold, {}: {:.0} mHz",
            group.method.name(),
            group.case,
            1000.0 * target_hz
        ),
        limit: format!("{seconds} s in > 95 % of the runs"),
        measured: format!(
            "{:.1} % of the runs; median {}, 95 % within {}",
            100.0 * share,
            time(0.5),
            time(RUNS)
        ),
        is_met: share > RUNS,
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
        limit: format!("{WARM_S} s in > 95 % of the runs"),
        measured: if time_s.is_finite() {
            format!("95 % of the runs within {time_s:.2} s")
        } else {
            "fewer than 95 % of the runs reach the target".to_owned()
        },
        is_met: time_s <= WARM_S,
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
