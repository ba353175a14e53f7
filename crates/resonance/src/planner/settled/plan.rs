//! How a sweep of settled points ends soonest.
//!
//! Two or three stays are planned as a whole, and judged by the time until the wanted uncertainty is
//! reached: a far one that tells of the capacitance is worth most before the resonance is driven,
//! which sets it ringing, and worth nothing by itself.

use std::f64::consts::PI;

use num_complex::Complex64;
use rig_model::{SweepPoint, Window};

use crate::{
    fit::POINTS_MIN,
    leftover::Leftover,
    planner::{
        Goal,
        tracker::{Tracker, variance},
    },
    ringup::Visit,
    solve::Normal,
    trace::{Believed, CIRCUIT, Trace, UNKNOWNS, steady_slopes},
};

/// Stays one after the other.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plan {
    stays: [SweepPoint; STAYS_MAX],
    count: usize,
}

/// Where a plan starts from.
#[derive(Debug)]
pub(super) struct Ground {
    at: Believed,
    /// Circuits that may be.
    cases: Vec<Case>,
    /// The frequency of the drive, Hz.
    driven_hz: Option<f64>,
    noise_variance: f64,
    /// Variance of the logarithm of the resonance that is wanted, for noise of variance 1.
    wanted: f64,
    time_constant_s: f64,
    /// Shortest integration, s, but for looks on the way of a wait.
    shortest_s: f64,
    /// Longest integration, s.
    longest_s: f64,
    window: Window,
}

/// A circuit that may be.
#[derive(Debug)]
struct Case {
    at: Believed,
    /// What is left of the motion if it is.
    leftover: Leftover,
    /// The normal equations of the readings so far.
    normal: Normal<UNKNOWNS>,
    /// Variance of the logarithm of the resonance by them, for noise of variance 1.
    present: f64,
}

const STAYS_MAX: usize = 3;
/// Longest time constant believed, s: a quality of 150 at 140 Hz.
const TIME_CONSTANT_MAX_S: f64 = 0.35;
/// A point is integrated no longer than this part of the time so far, or one time constant: a plan
/// made from little must not take long.
const LONGEST_SHARE: f64 = 0.3;
/// What is counted for a point besides its time, s: it has to be ordered and answered.
const POINT_COST_S: f64 = 0.005;
/// The shortest reading, in cycles.
const CYCLES_MIN: u32 = 2;
/// A wait is looked at on the way, every so many time constants, unless it is nearly over: that costs
/// nothing, and shows whether this is where to wait, and how long.
const LOOK_WAIT: f64 = 1.2;
const NEARLY_OVER: f64 = 0.15;
/// Places of stays near the resonance that a search starts from, in half linewidths, and waits there,
/// in time constants.
const PLACES: [f64; 3] = [0.0, -0.9, 0.9];
const WAITS: [f64; 3] = [1.0, 2.5, 4.5];
const CYCLES_NEAR: u32 = 6;
const CYCLES_FAR: u32 = 8;
/// Plans tried for each point; about half a millisecond.
const EFFORT: usize = 300;
/// Where the search for a better plan ends, as a part of its first step.
const FINEST: f64 = 0.1;
/// First steps of the search: in the logarithm of the distance from the resonance, in time constants,
/// and the part by which a reading gets longer.
const PLACE_STEP: f64 = 0.7;
/// A plan must do well for resonances that are off by one standard deviation to either side. Up to
/// the first part of a linewidth they make no difference; beyond the second no plan does well for
/// both.
const CERTAIN: f64 = 0.05;
const UNCERTAIN: f64 = 0.3;

impl Ground {
    pub(super) fn new(tracker: &Tracker, goal: &Goal, elapsed_s: f64) -> Option<Self> {
        let (trace, at) = tracker.best()?;
        let time_constant_s = (at.q / (PI * at.resonance_hz)).min(TIME_CONSTANT_MAX_S);
        let noise = tracker.noise();
        Some(Self {
            at: *at,
            cases: cases(tracker, trace, at),
            driven_hz: trace.samples.last().map(|sample| sample.visit.frequency_hz),
            noise_variance: tracker.known_variance(),
            wanted: (goal.aim_hz / at.resonance_hz / noise).powi(2),
            time_constant_s,
            shortest_s: goal.shortest_s,
            longest_s: (LONGEST_SHARE * elapsed_s).max(time_constant_s),
            window: goal.window,
        })
    }

    /// The best plan found near the last one and near some that are never far off.
    pub(super) fn plan(&self, last: Option<Plan>) -> Plan {
        let mut best = Tried::default();
        if let Some(last) = last {
            best.consider(self, last);
        }
        for plan in self.starts() {
            best.consider(self, plan);
        }
        let mut size = 1.0;
        while best.count < EFFORT && size > FINEST {
            let before = best.time_s;
            for which in 0..best.plan.count {
                for change in Change::ALL {
                    for by in [-size, size] {
                        let mut plan = best.plan;
                        self.change(&mut plan.stays[which], change, by);
                        best.consider(self, plan);
                    }
                }
            }
            for which in 0..best.plan.count {
                if best.plan.count > 1 {
                    best.consider(self, best.plan.without(which));
                }
            }
            if best.time_s >= before {
                size *= 0.5;
            }
        }
        best.plan
    }

    /// A stay near the resonance, alone or after far ones, or going on where the drive is.
    fn starts(&self) -> impl Iterator<Item = Plan> + '_ {
        let Window { min_hz, max_hz } = self.window;
        let far = |frequency_hz| SweepPoint { frequency_hz, settle_s: 0.0, cycles: CYCLES_FAR };
        let (low, high) = (far(min_hz), far(max_hz));
        PLACES.into_iter().flat_map(move |place| WAITS.map(|wait| (place, wait))).flat_map(
            move |(place, wait)| {
                let settle_s = wait * self.time_constant_s;
                let frequency_hz = self.frequency_hz(place);
                let near = SweepPoint { frequency_hz, settle_s, cycles: CYCLES_NEAR };
                let here =
                    SweepPoint { frequency_hz: self.driven_hz.unwrap_or(frequency_hz), ..near };
                [
                    Plan::of(&[near]),
                    Plan::of(&[low, near]),
                    Plan::of(&[high, near]),
                    Plan::of(&[low, high, near]),
                    Plan::of(&[high, low, near]),
                    Plan::of(&[here]),
                    Plan::of(&[here, near]),
                    Plan::of(&[low, here, near]),
                ]
            },
        )
    }

    /// The first point of a plan, and what is left of the plan then.
    pub(super) fn first(&self, plan: &Plan, readings: usize) -> (SweepPoint, Option<Plan>) {
        let stay = plan.stays[0];
        let mut rest = *plan;
        let look_s = LOOK_WAIT * self.time_constant_s;
        let look = SweepPoint { settle_s: look_s, cycles: CYCLES_MIN, ..stay };
        let left_s = stay.settle_s - look.duration_s();
        if left_s > NEARLY_OVER * look_s {
            rest.stays[0].settle_s = left_s;
            return (look, Some(rest));
        }
        let (shortest, longest) =
            (self.shortest(stay.frequency_hz), self.longest(stay.frequency_hz));
        let cycles = match plan.count {
            // The last stay makes as many readings as a fit must have.
            1 => stay.cycles.div_ceil(missing(readings)).min(longest),
            _ => stay.cycles.min(longest),
        };
        let point = SweepPoint { cycles: cycles.max(shortest), ..stay };
        if point.cycles < stay.cycles {
            rest.stays[0] =
                SweepPoint { settle_s: 0.0, cycles: stay.cycles - point.cycles, ..stay };
            return (point, Some(rest));
        }
        (point, (plan.count > 1).then(|| plan.without(0)))
    }

    /// The shortest reading, in cycles.
    fn shortest(&self, frequency_hz: f64) -> u32 {
        whole(self.shortest_s * frequency_hz).max(CYCLES_MIN)
    }

    /// The longest reading, in cycles.
    fn longest(&self, frequency_hz: f64) -> u32 {
        whole(self.longest_s * frequency_hz)
    }

    fn half_width_hz(&self) -> f64 {
        0.5 * self.at.resonance_hz / self.at.q
    }

    /// So many half linewidths from the resonance, on a scale that grows with the distance.
    fn frequency_hz(&self, place: f64) -> f64 {
        let frequency_hz = self.at.resonance_hz + self.half_width_hz() * place.sinh();
        frequency_hz.clamp(self.window.min_hz, self.window.max_hz)
    }

    fn place(&self, frequency_hz: f64) -> f64 {
        ((frequency_hz - self.at.resonance_hz) / self.half_width_hz()).asinh()
    }

    fn change(&self, stay: &mut SweepPoint, change: Change, by: f64) {
        match change {
            Change::Place => {
                let place = self.place(stay.frequency_hz) + PLACE_STEP * by;
                stay.frequency_hz = self.frequency_hz(place);
            }
            Change::Wait => {
                stay.settle_s = (stay.settle_s + by * self.time_constant_s).max(0.0);
            }
            Change::Length => {
                let factor = if by > 0.0 { 1.0 + by } else { 1.0 / (1.0 - by) };
                let cycles = whole((f64::from(stay.cycles) * factor).round());
                stay.cycles = cycles.min(self.longest(stay.frequency_hz)).max(CYCLES_MIN);
            }
        }
    }

    /// The time until the wanted variance is reached, s: the mean over what may be.
    fn time_s(&self, plan: &Plan) -> f64 {
        let times = self.cases.iter().map(|case| self.time_if_s(plan, case));
        times.sum::<f64>() / self.cases.len() as f64
    }

    fn time_if_s(&self, plan: &Plan, case: &Case) -> f64 {
        let &Case { ref at, mut leftover, mut normal, present } = case;
        let mut time_s = 0.0;
        for stay in &plan.stays[..plan.count] {
            let weight = self.weight(stay, at, &mut leftover);
            let slopes = steady_slopes(at, stay.frequency_hz);
            normal.add(Complex64::ZERO, &slopes, weight);
            time_s += stay.duration_s() + POINT_COST_S;
        }
        let reached = variance(&normal, CIRCUIT);
        if reached <= self.wanted {
            return time_s;
        }
        // What is left to be told comes as fast as what the plan tells.
        let gained = 1.0 / reached - 1.0 / present;
        let needed = 1.0 / self.wanted - 1.0 / present;
        if gained > 0.0 { time_s * needed / gained } else { f64::INFINITY }
    }

    /// For how much a reading will count.
    fn weight(&self, point: &SweepPoint, at: &Believed, leftover: &mut Leftover) -> f64 {
        let SweepPoint { frequency_hz, settle_s, cycles } = *point;
        let integration_s = f64::from(cycles) / frequency_hz;
        let visit = Visit { frequency_hz, settle_s, integration_s, rest_s: 0.0 };
        let admittance = at.circuit(1.0).admittance_siemens(frequency_hz).norm_sqr();
        let motional = at.c1 * at.c1 * leftover.visit(&visit);
        1.0 / (10.0 / f64::from(cycles) + motional / (admittance * self.noise_variance))
    }
}

/// The circuit, or two whose resonances are off by one standard deviation.
fn cases(tracker: &Tracker, trace: &Trace, at: &Believed) -> Vec<Case> {
    let off_hz = tracker.spread_hz();
    let linewidths = off_hz * at.q / at.resonance_hz;
    let is_between = (CERTAIN..UNCERTAIN).contains(&linewidths);
    let offsets: &[f64] = if is_between { &[-off_hz, off_hz] } else { &[0.0] };
    let case = |off_hz: &f64| {
        let at = Believed { resonance_hz: at.resonance_hz + off_hz, ..*at };
        let mut leftover = Leftover::new(at.resonance_hz, at.q);
        for sample in &trace.samples {
            leftover.visit(&sample.visit);
        }
        // With the slopes of this circuit: a place that was read with those of another would look
        // new, and promise what it never tells.
        let normal = tracker.solvable(trace, &at);
        Case { at, leftover, normal, present: variance(&normal, CIRCUIT) }
    };
    offsets.iter().map(case).collect()
}

/// The whole part of a positive number of cycles.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a positive number, of which the largest will do"
)]
fn whole(cycles: f64) -> u32 {
    cycles as u32
}

/// How many readings a fit must have besides these, at least one.
fn missing(readings: usize) -> u32 {
    u32::try_from(POINTS_MIN.saturating_sub(readings)).map_or(1, |missing| missing.max(1))
}

/// What is varied of a stay.
#[derive(Debug, Clone, Copy)]
enum Change {
    Place,
    Wait,
    Length,
}

impl Change {
    const ALL: [Self; 3] = [Self::Place, Self::Wait, Self::Length];
}

impl Plan {
    fn of(stays: &[SweepPoint]) -> Self {
        let none = SweepPoint { frequency_hz: 0.0, settle_s: 0.0, cycles: 0 };
        let mut plan = Self { stays: [none; STAYS_MAX], count: stays.len() };
        plan.stays[..stays.len()].copy_from_slice(stays);
        plan
    }

    fn without(&self, which: usize) -> Self {
        let mut plan = *self;
        plan.stays.copy_within(which + 1.., which);
        plan.count -= 1;
        plan
    }
}

/// The best of the plans considered.
#[derive(Debug)]
struct Tried {
    plan: Plan,
    time_s: f64,
    count: usize,
}

impl Default for Tried {
    fn default() -> Self {
        Self { plan: Plan::of(&[]), time_s: f64::INFINITY, count: 0 }
    }
}

impl Tried {
    fn consider(&mut self, ground: &Ground, plan: Plan) {
        let time_s = ground.time_s(&plan);
        self.count += 1;
        if time_s < self.time_s || self.plan.count == 0 {
            (self.plan, self.time_s) = (plan, time_s);
        }
    }
}
