//! Chooses the stay that gains most information per time.

use std::{borrow::Cow, f64::consts::TAU};

use num_complex::Complex64;
use rig_model::{SweepPoint, Window};

use crate::{
    circuit::trace::{CIRCUIT, UNKNOWNS},
    fit::decay::{
        Hypothesis, Stay, Stays,
        judge::MODE_WIDENS,
        mode::{Modes, SIZE_SEEN},
        model::{Amplitude, Model, Ring},
        stay::{Course, Forecast},
    },
    fit::grid::CircuitPrior,
    numeric::descent::Normal,
};

/// Places of a new stay, in linewidths from the resonance; in addition to the ends of the window.
const PLACES: [f64; 7] = [-1.5, -0.7, -0.3, 0.0, 0.3, 0.7, 1.5];
const CYCLES: [u32; 3] = [2, 6, 20];
/// Above this quality factor the longest readings have no advantage.
const LONG_Q: f64 = 60.0;
const COUNTS: [usize; 7] = [2, 3, 5, 8, 12, 18, COUNT_MAX];
const COUNT_MAX: usize = 27;
/// Numbers of readings for which pairs of stays are tried.
const PAIRED: [usize; 4] = [2, 5, 12, 27];
/// Number of trial phases of the free motion of a new stay.
const PHASES: usize = 3;
/// Largest offset of the second stay, in linewidths, because a beat alone is no evidence.
const NEAR: f64 = 1.0;
/// Offset in linewidths beyond which the beat is so fast that only the timing errors are visible.
const FAR: f64 = 4.0;
/// Fraction of a plan, and of the time spent, after which the plan is made again.
const PART: f64 = 0.5;
/// Stays shorter than this are not divided, s.
const SHORT_S: f64 = 0.03;
/// Assumed gap between two readings before any is measured, s.
const GAP_S: f64 = 1.5e-3;
/// Largest ratio of variances, used before the readings determine one.
const MISSING_MAX: f64 = 1e12;

/// Durations of readings.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pace {
    /// Mean gap between two readings of a stay, s.
    gap_s: f64,
    /// The analyzer integrates no shorter than this, s.
    shortest_s: f64,
}

impl Pace {
    pub(super) fn of(stays: Option<&Stays>, shortest_s: f64) -> Self {
        let (mut sum, mut count) = (GAP_S, 1.0);
        let stays = stays.map_or(&[][..], |stays| &stays.all);
        for pair in stays.iter().flat_map(|one| one.samples.windows(2)) {
            sum += (pair[1].start_s - pair[0].start_s - pair[0].integration_s).max(0.0);
            count += 1.0;
        }
        Self { gap_s: sum / count, shortest_s }
    }

    /// The integration time of a reading, s.
    fn integration_s(&self, cycles: u32, frequency_hz: f64) -> f64 {
        (f64::from(cycles) / frequency_hz).max(self.shortest_s)
    }

    /// Duration of one reading with the gap before it, s.
    fn reading_s(&self, cycles: u32, frequency_hz: f64) -> f64 {
        self.gap_s + self.integration_s(cycles, frequency_hz)
    }

    /// The duration of this reading with its settling and the gap before it, s.
    pub(crate) fn point_s(&self, point: &SweepPoint) -> f64 {
        point.settle_s + self.reading_s(point.cycles, point.frequency_hz)
    }
}

/// The inputs of a plan.
#[derive(Debug)]
pub(super) struct PlanStart<'a> {
    pub(super) stays: &'a Stays,
    pub(super) best: &'a Hypothesis,
    pub(super) expected: &'a CircuitPrior,
    pub(super) window: Window,
    pub(super) aim: Aim,
    pub(super) modes: Option<&'a Modes>,
    pub(super) pace: Pace,
    /// Duration of the sweep so far, s.
    pub(super) spent_s: f64,
    /// Remaining time, s.
    pub(super) left_s: f64,
}

/// The quantity to determine.
#[derive(Debug, Clone, Copy)]
pub(super) struct Aim {
    /// The variance of the logarithm of the resonance.
    pub(super) variance: f64,
    /// Index of the place of a possible second mode.
    pub(super) place: Option<usize>,
    /// Whether the survey of the bench limits the size of that mode.
    pub(super) is_limited: bool,
    /// Target variance of the size of the second mode; it replaces that of the resonance.
    pub(super) size_variance: Option<f64>,
}

/// Number of unknowns: the circuit and the size of a second mode.
const FREE: usize = CIRCUIT + 1;

type Matrix = [[f64; FREE]; FREE];

/// A candidate for the next stay.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    frequency_hz: f64,
    cycles: u32,
    count: usize,
    seconds: f64,
    /// Information that it adds, for each phase of its free motion.
    adds: [Matrix; PHASES],
}

impl Aim {
    /// Ratio of the present variance to the target variance.
    fn missing(&self, matrix: &Matrix, c1: f64) -> f64 {
        // All unknowns after the resonance and the second mode are eliminated, starting with the last.
        let mut rest = *matrix;
        for last in (2..FREE).rev() {
            let row = rest[last];
            let pivot = row[last];
            if pivot <= 0.0 {
                return f64::INFINITY;
            }
            for i in 0..last {
                let factor = row[i] / pivot;
                for k in 0..=i {
                    rest[i][k] -= factor * row[k];
                }
            }
        }
        let (alone, mixed, size) = (rest[0][0], rest[1][0], rest[1][1]);
        let over = |precision: f64, wanted: f64| {
            if precision > 0.0 { 1.0 / (precision * wanted) } else { f64::INFINITY }
        };
        if self.place.is_none() {
            return over(alone, self.variance);
        }
        if let Some(wanted) = self.size_variance {
            return over(size - mixed * mixed / alone, wanted);
        }
        let widened = self.variance * MODE_WIDENS * MODE_WIDENS;
        let seen = (SIZE_SEEN * c1).powi(2);
        let mut by_mode = over(alone - mixed * mixed / size, widened);
        if !self.is_limited {
            by_mode = by_mode.min(over(size - mixed * mixed / alone, seen));
        }
        over(alone, self.variance).max(by_mode)
    }
}

/// The candidates so far and the best of them.
#[derive(Debug)]
struct Shortlist<'a> {
    aim: Aim,
    c1: f64,
    now: &'a Matrix,
    before: f64,
    all: Vec<Candidate>,
    /// Index of the candidate that reaches the aim soonest, and its duration, s.
    best: Option<usize>,
    least_s: f64,
    /// Index of the candidate with the largest gain per time, and that gain; used if none reaches the
    /// aim.
    steepest: Option<usize>,
    slope: f64,
}

impl<'a> Shortlist<'a> {
    fn new(aim: Aim, c1: f64, now: &'a Matrix) -> Self {
        let before = aim.missing(now, c1).min(MISSING_MAX);
        let (best, least_s) = (None, f64::INFINITY);
        let (steepest, slope) = (None, f64::NEG_INFINITY);
        Self { aim, c1, now, before, all: Vec::new(), best, least_s, steepest, slope }
    }

    /// Ratio of the variance after one candidate to the target, averaged over the phases.
    fn missing(&self, one: &Candidate) -> f64 {
        let of = |adds| self.aim.missing(&sum(self.now, adds), self.c1);
        one.adds.iter().map(of).sum::<f64>() / PHASES as f64
    }

    /// Whether two candidates reach the aim, averaged over the phases.
    fn is_reached(&self, one: &Candidate, other: &Candidate) -> bool {
        let mut total = 0.0;
        one.adds.iter().zip(&other.adds).all(|(one, other)| {
            total += self.aim.missing(&sum(&sum(self.now, one), other), self.c1);
            total <= PHASES as f64
        })
    }

    fn add(&mut self, one: &Candidate) {
        let after = self.missing(one);
        let place = self.all.len();
        if after <= 1.0 && one.seconds < self.least_s {
            (self.best, self.least_s) = (Some(place), one.seconds);
        }
        let gain = (self.before / after).ln() / one.seconds;
        if gain > self.slope {
            (self.steepest, self.slope) = (Some(place), gain);
        }
        self.all.push(*one);
    }

    /// Searches for two stays that together reach the aim sooner; the longer one becomes the best.
    fn pair(&mut self) {
        let is_paired = |i: &usize| PAIRED.contains(&self.all[*i].count);
        let mut paired: Vec<usize> = (0..self.all.len()).filter(is_paired).collect();
        paired.sort_unstable_by(|&i, &k| self.all[i].seconds.total_cmp(&self.all[k].seconds));
        for (n, &longer) in paired.iter().enumerate() {
            for &shorter in &paired[..n] {
                let (one, other) = (&self.all[longer], &self.all[shorter]);
                let seconds = one.seconds + other.seconds;
                if seconds >= self.least_s {
                    break;
                }
                let is_elsewhere = one.frequency_hz.to_bits() != other.frequency_hz.to_bits();
                if is_elsewhere && self.is_reached(one, other) {
                    (self.best, self.least_s) = (Some(longer), seconds);
                }
            }
        }
    }
}

impl PlanStart<'_> {
    /// The frequency, the cycles per reading and the number of readings.
    pub(super) fn choose(&self) -> (f64, u32, usize) {
        let at = &self.best.at;
        let otherwise = (at.resonance_hz, CYCLES[0], COUNTS[2]);
        let Some(present) = self.present() else { return otherwise };
        let mut list = Shortlist::new(self.aim, at.c1, &present.now);
        self.fill(&present, &mut list);
        list.pair();
        let Some(chosen) = list.best.or(list.steepest).map(|i| &list.all[i]) else {
            return otherwise;
        };
        let reading_s = self.pace.reading_s(chosen.cycles, chosen.frequency_hz);
        let allowed_s =
            (PART * chosen.seconds).min(PART * self.spent_s).min(self.left_s).max(SHORT_S);
        let whole = chosen.seconds <= SHORT_S;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small")]
        let part = ((allowed_s / reading_s).ceil() as usize).clamp(2, chosen.count.max(2));
        (chosen.frequency_hz, chosen.cycles, if whole { chosen.count } else { part })
    }

    /// The present stay, and the information with and without it.
    fn present(&self) -> Option<Present<'_>> {
        let at = &self.best.at;
        let stays = &self.stays.all;
        let modes = match self.modes {
            Some(modes) => Cow::Borrowed(modes),
            None => Cow::Owned(Modes::new(self.stays, self.best)),
        };
        let place = self.aim.place.unwrap_or(0);
        let of = |count: usize| {
            let mut normal = modes.normal(place, count);
            self.expected.add_to(&mut normal, at, 1.0);
            leading(&normal)
        };
        let (model, ring, amplitude) = self.stays.last(self.best)?;
        let (now, without) = (of(stays.len()), of(stays.len().saturating_sub(1)));
        Some(Present { stay: stays.last()?, model, ring, amplitude, now, without, modes, place })
    }

    fn fill(&self, present: &Present<'_>, list: &mut Shortlist<'_>) {
        let Window { min_hz, max_hz } = self.window;
        let linewidth_hz = self.best.linewidth_hz();
        self.going_on(present, list);
        let is_first = self.stays.all.len() == 1;
        // The second stay must provide more than a beat.
        let near = PLACES.into_iter().filter(|place| !is_first || place.abs() <= NEAR);
        let resonance_hz = self.best.at.resonance_hz;
        let is_far = |end_hz: &f64| (end_hz - resonance_hz).abs() > FAR * linewidth_hz;
        let ends = [min_hz, max_hz].into_iter().filter(|end_hz| !is_first && !is_far(end_hz));
        let places = near.map(|place| resonance_hz + place * linewidth_hz).chain(ends);
        // A resonance outside the window is measured from the nearer end.
        let mut inside: Vec<f64> = places.map(|hz| hz.clamp(min_hz, max_hz)).collect();
        inside.dedup();
        for frequency_hz in inside {
            self.stays_at(frequency_hz, present, list);
        }
    }

    /// The lengths of a reading that are tried, in cycles.
    fn cycles(&self) -> impl Iterator<Item = u32> {
        let q = self.best.at.q;
        CYCLES.into_iter().filter(move |&n| n < 20 || q < LONG_Q)
    }

    /// Adds candidates that continue the present stay.
    fn going_on(&self, present: &Present<'_>, list: &mut Shortlist<'_>) {
        let Present { stay, model, ring, now, without, modes, place, .. } = present;
        for cycles in self.cycles() {
            let frequency_hz = stay.frequency_hz;
            let reading_s = self.pace.reading_s(cycles, frequency_hz);
            let reading = (reading_s, self.pace.integration_s(cycles, frequency_hz));
            let next = Course::new(model, &stay.samples, reading, COUNT_MAX);
            let model = (model, &self.stays.known);
            let mut forecast = Forecast::new(model, ring, modes.last(*place), &stay.samples, &next);
            for count in COUNTS {
                let seconds = count as f64 * reading_s;
                if seconds >= list.least_s {
                    break;
                }
                let after = sum(without, &leading(&forecast.with(count)));
                let adds = [difference(&after, now); PHASES];
                list.add(&Candidate { frequency_hz, cycles, count, seconds, adds });
            }
        }
    }

    /// Adds candidates for a new stay at this frequency, with an arbitrary phase of the drive.
    /// Candidates longer than the best are omitted, because neither they nor a pair with them can be
    /// better.
    fn stays_at(&self, frequency_hz: f64, present: &Present<'_>, list: &mut Shortlist<'_>) {
        let at = &self.best.at;
        let since_s =
            present.stay.samples.last().map_or(0.0, |last| last.start_s + last.integration_s);
        let square = { present.amplitude }.change(frequency_hz, since_s);
        let model = Model::new(at, frequency_hz);
        let end = present.model.motion(at, present.ring.amplitude, since_s);
        let end_of_mode = present.modes.last(present.place).motion(since_s);
        for cycles in self.cycles() {
            let reading_s = self.pace.reading_s(cycles, frequency_hz);
            let reading = (reading_s, self.pace.integration_s(cycles, frequency_hz));
            let next = Course::new(&model, &[], reading, COUNT_MAX);
            let mut forecasts: [Forecast<'_>; PHASES] = std::array::from_fn(|phase| {
                let turn = Complex64::cis(TAU * phase as f64 / PHASES as f64);
                let ring = Ring { square, amplitude: model.amplitude(at, end * turn) };
                let mode = present.modes.branch(present.place, frequency_hz, end_of_mode * turn);
                Forecast::new((&model, &self.stays.known), &ring, mode, &[], &next)
            });
            for count in COUNTS {
                let seconds = count as f64 * reading_s;
                if seconds >= list.least_s {
                    break;
                }
                let adds = forecasts.each_mut().map(|forecast| leading(&forecast.with(count)));
                list.add(&Candidate { frequency_hz, cycles, count, seconds, adds });
            }
        }
    }
}

/// The present stay and its information.
#[derive(Debug)]
struct Present<'a> {
    stay: &'a Stay,
    model: Model,
    ring: Ring,
    amplitude: Amplitude,
    /// Information from all readings; `without` is that from the earlier stays only.
    now: Matrix,
    without: Matrix,
    modes: Cow<'a, Modes>,
    place: usize,
}

/// Reorders the unknowns so that the resonance and the second mode come first.
fn leading(normal: &Normal<UNKNOWNS>) -> Matrix {
    const ORDER: [usize; FREE] = [0, CIRCUIT, 1, 2, 3, 4];
    ORDER.map(|i| ORDER.map(|k| normal.matrix[i][k]))
}

fn sum(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|k| a[i][k] + b[i][k]))
}

fn difference(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|k| a[i][k] - b[i][k]))
}
