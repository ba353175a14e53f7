//! The goals and their measurements.

use super::{
    accuracy,
    case::{Case, NOISE},
    method::{Method, SURVEY_S},
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
    /// Planners from rest, for targets near the linewidth.
    pub(super) loose: Vec<Group>,
    pub(super) warm: Vec<Warm>,
}

/// A goal of a planner from rest.
#[derive(Debug, Clone, Copy)]
struct ColdGoal {
    q: f64,
    coupling: f64,
    /// Times in which half and 95 % of the runs must reach the target, s.
    seconds: [f64; 2],
}

const fn cold_goal(q: f64, coupling: f64, seconds: [f64; 2]) -> ColdGoal {
    ColdGoal { q, coupling, seconds }
}

/// Runs of a planner from rest.
#[derive(Debug, Clone)]
pub(super) struct ColdRuns {
    group: Group,
    goal: ColdGoal,
}

/// Largest allowed ratio of error to bound.
pub(super) const RATIO_MAX: f64 = 1.05;
/// The target of the goals from rest, Hz.
const COLD_TARGET_HZ: f64 = 0.01;
/// The goals of the free-decay planner from rest. Without a survey its own stays exclude a second mode.
const COLD: [ColdGoal; 5] = [
    cold_goal(100.0, 0.1, [0.70, 0.90]),
    cold_goal(100.0, 0.02, [0.80, 1.1]),
    cold_goal(30.0, 0.1, [0.80, 0.95]),
    cold_goal(30.0, 0.02, [1.8, 2.2]),
    cold_goal(10.0, 0.1, [4.2, 4.8]),
];
/// Loose targets, Hz, and the largest mean error in stated standard deviations.
const LOOSE_TARGETS_HZ: [f64; 2] = [0.1, 0.3];
const BIAS_MAX_SIGMAS: f64 = 0.2;
/// Quality factors and targets of the warm runs, Hz.
const WARM: [(f64, f64); 4] = [(30.0, 0.03), (100.0, 0.03), (30.0, 0.01), (100.0, 0.01)];
/// Fewest warm readings a second.
const WARM_PER_SECOND: f64 = 3.0;

/// The warm runs of the goal.
pub(super) fn track(runs: u32, seed: u64) -> Vec<Warm> {
    let one = |(q, target_hz)| {
        warm::track(Case { q, coupling: 0.1, noise: NOISE }, target_hz, runs, seed)
    };
    WARM.into_iter().map(one).collect()
}

/// The runs from rest of the goals.
pub(super) fn start(runs: u32, seed: u64) -> Vec<ColdRuns> {
    let target_hz = COLD_TARGET_HZ;
    [Method::Unsurveyed { target_hz }, Method::Decay { target_hz }]
        .into_iter()
        .flat_map(|method| COLD.map(|goal| (method, goal)))
        .flat_map(|(method, goal)| {
            let ColdGoal { q, coupling, .. } = goal;
            let groups = trial::run(Case { q, coupling, noise: NOISE }, method, runs, seed);
            groups.into_iter().map(move |group| ColdRuns { group, goal })
        })
        .collect()
}

/// The runs from rest for loose targets.
pub(super) fn start_loosely(runs: u32, seed: u64) -> Vec<Group> {
    let cases = Case::all().into_iter().filter(|case| case.noise == NOISE);
    let of = |target_hz| Method::Decay { target_hz };
    cases
        .flat_map(|case| LOOSE_TARGETS_HZ.map(|target_hz| (case, of(target_hz))))
        .flat_map(|(case, method)| trial::run(case, method, runs, seed))
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
    goals.extend(LOOSE_TARGETS_HZ.map(|target_hz| loose(target_hz, &evidence.loose)));
    goals.extend(evidence.warm.iter().map(warm_free_decay));
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
    let ColdRuns { group, goal: ColdGoal { seconds: [median_s, most_s], .. } } = runs;
    let time = |share: f64| group.time_to_reach_s(COLD_TARGET_HZ, share);
    let in_words = |time_s: Option<f64>| {
        time_s.map_or_else(|| "never".to_owned(), |time_s| format!("{time_s:.3} s"))
    };
    let after = match group.method {
        Method::Decay { .. } => format!(" after a survey of {SURVEY_S} s"),
        _ => String::new(),
    };
    let is_within = |share, limit_s: f64| time(share).is_some_and(|time_s| time_s <= limit_s);
    Goal {
        quantity: format!(
            "{}, cold{after}, {}: {:.0} mHz",
            group.method.name(),
            group.case,
            1000.0 * COLD_TARGET_HZ
        ),
        limit: format!("median {median_s:.2} s, 95 % within {most_s:.2} s"),
        measured: format!(
            "median {}, mean {:.3} s, 95 % within {}, 99 % within {}; {:.1} % of the {} runs within {most_s:.2} s; \
             {:.1} % of the 95 % intervals contain the truth, the farthest error is {:.1} standard deviations",
            in_words(time(0.5)),
            group.mean_time_s(),
            in_words(time(0.95)),
            in_words(time(0.99)),
            100.0 * group.reached(COLD_TARGET_HZ, *most_s),
            group.trials.len(),
            100.0 * group.coverage().unwrap_or(f64::NAN),
            group.worst_sigmas().unwrap_or(f64::NAN),
        ),
        is_met: is_within(0.5, *median_s) && is_within(0.95, *most_s),
    }
}

fn loose(target_hz: f64, groups: &[Group]) -> Goal {
    let of_target = groups.iter().filter(|group| group.method == Method::Decay { target_hz });
    let worst = of_target
        .filter_map(|group| Some((group.bias_sigmas()?, group.case)))
        .max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
    let (bias, at) =
        worst.map_or((f64::INFINITY, String::new()), |(bias, case)| (bias, format!(" ({case})")));
    Goal {
        quantity: format!(
            "free-decay planner, cold, {:.0} mHz: mean error over the stated standard deviation, \
             worst case",
            1000.0 * target_hz
        ),
        limit: format!("within ±{BIAS_MAX_SIGMAS}"),
        measured: format!("{bias:+.2}{at}"),
        is_met: bias.abs() <= BIAS_MAX_SIGMAS,
    }
}

fn warm_free_decay(warm: &Warm) -> Goal {
    let Warm { case, target_hz, .. } = warm;
    let per_second = warm.per_second();
    let within = |share| trial::quantile(&warm.times_s, share);
    Goal {
        quantity: format!("free-decay planner, warm, {case}: {:.0} mHz", 1000.0 * target_hz),
        limit: format!("{WARM_PER_SECOND} readings a second"),
        measured: format!(
            "{per_second:.1} a second; median {:.2} s, 95 % within {:.2} s, 99 % within {:.2} s; {} of {} \
             miss the target",
            within(0.5),
            within(0.95),
            within(0.99),
            warm.missed,
            warm.times_s.len()
        ),
        is_met: per_second >= WARM_PER_SECOND,
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
