//! Points that wait for nothing, for analyzers whose timing is known.
//!
//! What a visit to a frequency tells of the resonance depends on how the sensor is moving when it
//! begins, and a visit that tells little by itself may be what makes the next one tell much. So the
//! visits are planned as a whole: three frequencies, taken in turn until the wanted uncertainty is
//! reached, are judged by the time that takes. The first visit of the best plan found is made, and
//! everything is planned anew with what it has told.

use std::f64::consts::TAU;

use num_complex::Complex64;
use rig_model::{Reading, SweepPoint, SweepRequest, Window};

use super::{
    Goal,
    prior::{Prior, elapsed_s},
    tracker::{Tracker, variance},
};
use crate::{
    NoisePrior, Past, Timing,
    circuit::dual::Dual,
    circuit::ringup::{Motion, Visit},
    circuit::trace::{CIRCUIT, ModelEstimate, Sample, UNKNOWNS, ideal_row},
    noise::PooledVariance,
    numeric::descent::Normal,
};

/// The plan of one sweep.
#[derive(Debug, Clone)]
pub(super) struct Transient {
    tracker: Tracker,
    opening: std::array::IntoIter<SweepPoint, 2>,
    elsewhere: std::array::IntoIter<SweepPoint, 3>,
    hops: Option<FrequencyCycle>,
}

/// Three frequencies in turn, and how long at each: settled readings at two do not determine five
/// unknowns.
#[derive(Debug, Clone, Copy, PartialEq)]
struct FrequencyCycle {
    /// Distance from the resonance, Hz.
    offset_hz: [f64; PLACES],
    cycles: [f64; PLACES],
}

const PLACES: usize = 3;

/// Places in the window of the first two visits, and their length.
const OPENING: [f64; 2] = [0.3, 0.7];
const OPENING_CYCLES: u32 = 2;
/// Places in the whole window that are visited where the readings so far have no explanation.
const ELSEWHERE: [f64; 3] = [0.5, 0.1, 0.9];
/// A visit lasts no longer than this part of the time so far: a plan made from little must not.
const LONGEST_SHARE: f64 = 0.3;
/// Shortest and longest visit considered, in cycles.
const CYCLES_MIN: f64 = 2.0;
const CYCLES_MAX: f64 = 2000.0;
/// Overhead of a visit for command and answer, s.
const VISIT_COST_S: f64 = 0.002;
/// Visits that a plan is followed for.
const VISITS_AHEAD: usize = 24;
/// Starts of the search for a plan: distances from the resonance in linewidths, and cycles.
const STARTS: [[f64; PLACES]; 3] = [[-0.4, 0.4, 0.1], [-0.5, 1.2, -1.5], [-1.5, 1.5, 0.4]];
const STARTS_CYCLES: [f64; 4] = [2.0, 5.0, 12.0, 30.0];
/// Plans tried for each visit; about a millisecond.
const EFFORT: usize = 240;
/// A plan must be better than the last one by this factor to replace it.
const FAITH: f64 = 0.95;
/// Last step of the search for a better plan, relative to its first step.
const FINEST: f64 = 0.2;
/// Below this part of the static admittance a reading is not counted on to be as precise as others:
/// where static and motional current cancel, a relative error would become no error at all.
const NULL: f64 = 0.2;

impl Transient {
    pub(super) fn new(
        request: &SweepRequest,
        prior: Option<&Prior>,
        past: Past,
        noise: &NoisePrior,
    ) -> Self {
        let window = prior.map_or(request.window, |prior| prior.within);
        let tracker =
            Tracker::new(request, prior, Timing::Exact(past), PooledVariance::known(noise));
        // Two short visits, each near half of the window: whatever resonates in it, rings after them.
        let opening = OPENING.map(|part| short_visit(window, part)).into_iter();
        let elsewhere = ELSEWHERE.map(|part| short_visit(request.window, part)).into_iter();
        Self { tracker, opening, elsewhere, hops: None }
    }

    pub(super) fn add(&mut self, readings: &[Reading]) {
        for reading in readings {
            self.tracker.add(reading);
        }
    }

    pub(super) fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    pub(super) fn tracker_mut(&mut self) -> &mut Tracker {
        &mut self.tracker
    }

    /// The next visit, or `None` when the readings so far lead nowhere.
    pub(super) fn next(&mut self, readings: &[Reading], goal: &Goal) -> Option<SweepPoint> {
        if let Some(point) = self.opening.next() {
            return Some(point);
        }
        let Some(ground) = PlanStart::new(&self.tracker, readings, goal) else {
            return self.elsewhere.next();
        };
        let hops = ground.plan(self.hops.as_ref());
        self.hops = Some(hops);
        let longest_s = LONGEST_SHARE * elapsed_s(readings);
        Some(ground.point(&hops, goal.shortest_s, longest_s))
    }
}

/// The start of a plan.
#[derive(Debug)]
struct PlanStart {
    at: ModelEstimate,
    normal: Normal<UNKNOWNS>,
    motion: Motion<Dual>,
    past: Dual,
    free: usize,
    /// Overhead of every visit, s; the drive goes on during it.
    rest_s: f64,
    /// Variance of the logarithm of the resonance that is wanted, for noise of variance 1.
    wanted: f64,
    window: Window,
}

impl FrequencyCycle {
    /// The same, beginning with another of them.
    fn from(mut self, first: usize) -> Self {
        self.offset_hz.rotate_left(first);
        self.cycles.rotate_left(first);
        self
    }
}

impl PlanStart {
    fn new(tracker: &Tracker, readings: &[Reading], goal: &Goal) -> Option<Self> {
        let (trace, at) = tracker.best()?;
        let state = trace.rows(at, |_, _| ());
        Some(Self {
            at: *at,
            normal: tracker.normal(trace, at),
            motion: state.motion,
            past: state.past,
            free: CIRCUIT + trace.extra_term().count(),
            rest_s: typical_rest_s(readings),
            wanted: (goal.aim_hz / at.resonance_hz / tracker.noise()).powi(2),
            window: goal.window,
        })
    }

    /// The best plan found near the last one and near some that are never far off.
    fn plan(&self, last: Option<&FrequencyCycle>) -> FrequencyCycle {
        let width = self.at.resonance_hz / self.at.q;
        let mut best = Tried::default();
        if let Some(last) = last {
            // The next of the three comes next. A plan that is not clearly better must not put off
            // what this one is about to do, or it would be put off for ever.
            best.consider(self, last.from(1));
            best.time_s *= FAITH;
            best.consider(self, *last);
        }
        for cycles in STARTS_CYCLES {
            for offsets in STARTS {
                let offset_hz =
                    offsets.map(|offset| (offset.abs() * width).max(1.0).copysign(offset));
                let hops = FrequencyCycle { offset_hz, cycles: [cycles; PLACES] };
                for first in 0..PLACES {
                    best.consider(self, hops.from(first));
                }
            }
        }
        let mut size = 1.0;
        while best.count < EFFORT && size > FINEST {
            let before = best.time_s;
            for which in 0..PLACES {
                for factor in [1.0 + size, 1.0 / (1.0 + size)] {
                    let mut hops = best.hops;
                    hops.cycles[which] =
                        (hops.cycles[which] * factor).round().clamp(CYCLES_MIN, CYCLES_MAX);
                    best.consider(self, hops);
                }
                for by in [-0.7 * size, 0.7 * size] {
                    let mut hops = best.hops;
                    hops.offset_hz[which] += by * width.max(1.0);
                    best.consider(self, hops);
                }
            }
            if best.time_s >= before {
                size *= 0.5;
            }
        }
        best.hops
    }

    /// The time until the wanted variance is reached, s.
    fn time_s(&self, hops: &FrequencyCycle) -> f64 {
        let (mut normal, mut motion, mut past) = (self.normal, self.motion, self.past);
        let mut elapsed_s = 0.0;
        let mut before = variance(&normal, self.free);
        for i in 0..VISITS_AHEAD {
            let which = i % PLACES;
            let (offset_hz, cycles) = (hops.offset_hz[which], hops.cycles[which]);
            let step_s =
                self.make(offset_hz, cycles, &mut normal, &mut motion, &mut past) + VISIT_COST_S;
            let now = variance(&normal, self.free);
            if now <= self.wanted {
                // Where on the way: the inverse of the variance grows about evenly.
                let part = (1.0 / self.wanted - 1.0 / before) / (1.0 / now - 1.0 / before);
                return elapsed_s + step_s * part.clamp(0.3, 1.0);
            }
            elapsed_s += step_s;
            before = now;
        }
        // Beyond the horizon information comes as fast as within it.
        let start = variance(&self.normal, self.free);
        let gained = 1.0 / before - 1.0 / start;
        if gained > 0.0 {
            elapsed_s * (1.0 / self.wanted - 1.0 / start) / gained
        } else {
            f64::INFINITY
        }
    }

    fn visit(&self, offset_hz: f64, cycles: f64) -> Visit {
        let Window { min_hz, max_hz } = self.window;
        let frequency_hz = (self.at.resonance_hz + offset_hz).clamp(min_hz, max_hz);
        let integration_s = cycles / frequency_hz;
        Visit { frequency_hz, settle_s: 0.0, integration_s, rest_s: self.rest_s }
    }

    /// The first visit of a plan, no longer than it must be.
    fn point(&self, hops: &FrequencyCycle, shortest_s: f64, longest_s: f64) -> SweepPoint {
        let frequency_hz = self.visit(hops.offset_hz[0], 1.0).frequency_hz;
        let longest = hops.cycles[0].max(shortest_s * frequency_hz);
        let longest = longest.min(longest_s * frequency_hz).clamp(CYCLES_MIN, CYCLES_MAX);
        let reaches = |cycles: f64| {
            let (mut normal, mut motion, mut past) = (self.normal, self.motion, self.past);
            self.make(hops.offset_hz[0], cycles, &mut normal, &mut motion, &mut past);
            variance(&normal, self.free) <= self.wanted
        };
        let (mut short, mut long) = (CYCLES_MIN, longest);
        if reaches(long) {
            while long - short > 1.0 {
                let middle = 0.5 * (short + long);
                if reaches(middle) { long = middle } else { short = middle }
            }
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        SweepPoint { frequency_hz, settle_s: 0.0, cycles: long.ceil() as u32 }
    }

    /// Makes one visit in thought; gives the time it takes, s.
    fn make(
        &self,
        offset_hz: f64,
        cycles: f64,
        normal: &mut Normal<UNKNOWNS>,
        motion: &mut Motion<Dual>,
        past: &mut Dual,
    ) -> f64 {
        let visit = self.visit(offset_hz, cycles);
        let response = motion.visit(&visit, past);
        let at = &self.at;
        let omega = TAU * visit.frequency_hz;
        let motional = at.c1 * response.motional.value
            + at.extra[0] * response.past[0].value
            + at.extra[1] * response.past[1].value;
        let admittance = Complex64::new(at.g, at.c0) * omega + motional;
        let null = NULL * omega * at.c0;
        let weight = 0.1 * cycles * (admittance.norm_sqr() / (null * null)).min(1.0);
        let sample = Sample::ideal(visit, weight);
        normal.add(Complex64::ZERO, &ideal_row(at, &sample, &response).slopes, weight);
        visit.integration_s + visit.rest_s
    }
}

/// A short visit at this part of a window.
fn short_visit(window: Window, part: f64) -> SweepPoint {
    let frequency_hz = window.min_hz * (window.max_hz / window.min_hz).powf(part);
    SweepPoint { frequency_hz, settle_s: 0.0, cycles: OPENING_CYCLES }
}

/// The best of the plans considered.
#[derive(Debug)]
struct Tried {
    hops: FrequencyCycle,
    time_s: f64,
    count: usize,
}

impl Default for Tried {
    fn default() -> Self {
        let hops = FrequencyCycle { offset_hz: [0.0; PLACES], cycles: [4.0; PLACES] };
        Self { hops, time_s: f64::INFINITY, count: 0 }
    }
}

impl Tried {
    fn consider(&mut self, ground: &PlanStart, hops: FrequencyCycle) {
        let time_s = ground.time_s(&hops);
        self.count += 1;
        if time_s < self.time_s {
            (self.hops, self.time_s) = (hops, time_s);
        }
    }
}

/// The gap between the end of one visit and the begin of the next, s: the median of those so far.
fn typical_rest_s(readings: &[Reading]) -> f64 {
    let mut rests: Vec<f64> = readings
        .windows(2)
        .map(|pair| {
            let stay_s = pair[1].started.since(pair[0].started).as_secs_f64();
            (stay_s - pair[0].settle_s - pair[0].integration_s).max(0.0)
        })
        .collect();
    if rests.is_empty() {
        return 0.0;
    }
    let middle = rests.len() / 2;
    *rests.select_nth_unstable_by(middle, f64::total_cmp).1
}
