//! Whether the resonance is the same at half the level of the drive.
//!
//! ```text
//! survey ─▶ half ─▶ full ─▶ half ─▶ full … ─▶ linear, or not
//! ```
//!
//! A spring that the drive bends shifts the resonance with the square of the level: by four thirds of the difference of the
//! two levels. So the sweeps go on until the difference is known better than a resonance of the run. A resonance that drifts
//! differs between two sweeps as well: an even drift is an unknown of the difference, and what the references so far say of
//! the walk is the limit of the rest.

use rig_model::RigTime;
use rig_resonance::{Bench, Resonance};

use crate::drift::Drift;

/// Sweeps after which the levels are judged at the earliest and at the latest, the survey among them. The last one is at the
/// full level.
const LEAST: usize = 9;
const MOST: usize = 49;
/// A difference is judged once it is known to this part of the usual standard deviation of a sweep at the full level.
const PART: f64 = 0.5;
/// The levels are the same if their difference is certainly less than this many of these standard deviations. A resonance at the
/// full level is then shifted by less than four thirds of that.
const SAME_SIGMAS: f64 = 2.0;
/// Standard deviations of the difference that are certain, in one check of four thousand not.
const CERTAIN: f64 = 3.5;

/// A check of the level after a survey.
#[derive(Debug, Clone)]
pub struct LevelCheck {
    /// From the survey.
    pub(crate) bench: Option<Bench>,
    /// Every resonance, with the middle of its sweep: the survey, and then half and full level in turn.
    found: Vec<(RigTime, Resonance)>,
}

/// What follows a sweep of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Levels {
    /// Another sweep is needed.
    Open,
    /// The resonance does not depend on the level.
    Same,
    /// It does.
    Differ,
}

/// By how much the resonance at half the level is above that at the full one.
#[derive(Debug, Clone, Copy)]
struct Difference {
    hz: f64,
    sigma_hz: f64,
    /// The time in which a walk makes as much as of the difference, s.
    walked_s: f64,
}

impl LevelCheck {
    /// Begins with the survey.
    pub fn new(bench: Option<Bench>, survey: &(RigTime, Resonance)) -> Self {
        Self { bench, found: vec![*survey] }
    }

    /// Whether the next sweep is at half the level.
    pub const fn is_half_next(&self) -> bool {
        self.found.len() % 2 == 1
    }

    /// Number of sweeps so far, with the survey.
    pub const fn sweeps(&self) -> usize {
        self.found.len()
    }

    /// The resonances so far. The last one is at the full level.
    pub(crate) fn into_found(self) -> Vec<(RigTime, Resonance)> {
        self.found
    }

    /// Takes in the resonance of a sweep. `drift` is what the references before the survey say.
    pub fn take(&mut self, found: &(RigTime, Resonance), drift: &Drift) -> Levels {
        self.found.push(*found);
        if !self.is_half_next() {
            return Levels::Open;
        }
        let Some(difference) = self.difference() else { return Levels::Open };
        let usual_hz = self.usual_sigma_hz();
        let is_known = self.found.len() >= LEAST && difference.sigma_hz <= PART * usual_hz;
        if !is_known && self.found.len() < MOST {
            return Levels::Open;
        }
        let mut drift = drift.clone();
        for (at, full) in self.found.iter().step_by(2) {
            drift.measured(*at, full.resonance_hz, full.sigma_hz);
        }
        let Difference { hz, sigma_hz, walked_s } = difference;
        if drift.is_beyond_walk(hz, sigma_hz, walked_s) {
            return Levels::Differ;
        }
        let is_same = hz.abs() + CERTAIN * sigma_hz < SAME_SIGMAS * usual_hz;
        if is_same || self.found.len() >= MOST { Levels::Same } else { Levels::Open }
    }

    /// The standard deviation of a sweep at the full level, Hz, without the survey. Those that know more count more, because
    /// a shift is larger in theirs.
    fn usual_sigma_hz(&self) -> f64 {
        let full = self.found.iter().step_by(2).skip(1).map(|(_, full)| full.sigma_hz.powi(-2));
        let (sum, count) = full.fold((0.0, 0.0), |(sum, count), one| (sum + one, count + 1.0));
        f64::sqrt(count / sum)
    }

    /// The difference by least squares, beside a resonance and an even drift; `None` as long as these can make it.
    fn difference(&self) -> Option<Difference> {
        let (begun, first) = *self.found.first().filter(|_| self.found.len() > 3)?;
        let all = |of: &dyn Fn(usize, &(RigTime, Resonance)) -> f64| -> Vec<f64> {
            self.found.iter().enumerate().map(|(index, found)| of(index, found)).collect()
        };
        let weights = all(&|_, (_, found)| found.sigma_hz.powi(-2));
        let dot = |one: &[f64], other: &[f64]| -> f64 {
            let terms = weights.iter().zip(one).zip(other);
            terms.map(|((weight, one), other)| weight * one * other).sum()
        };
        let ones = vec![1.0; weights.len()];
        let centred = |values: Vec<f64>| -> Vec<f64> {
            let mean = dot(&values, &ones) / dot(&ones, &ones);
            values.iter().map(|value| value - mean).collect()
        };
        let times = centred(all(&|_, (at, _)| at.since(begun).as_secs_f64()));
        let halves = centred(all(&|index, _| if index % 2 == 1 { 1.0 } else { 0.0 }));
        let offs = all(&|_, (_, found)| found.resonance_hz - first.resonance_hz);
        // What no even drift makes of the levels.
        let slope = dot(&halves, &times) / dot(&times, &times);
        let own: Vec<f64> =
            halves.iter().zip(&times).map(|(half, time)| half - slope * time).collect();
        let information = dot(&own, &own);
        // A step of the walk enters by all sweeps behind it.
        let (mut walked_s, mut behind) = (0.0, 0.0);
        for index in (1..times.len()).rev() {
            behind += weights[index] * own[index] / information;
            walked_s += behind * behind * (times[index] - times[index - 1]);
        }
        let hz = dot(&own, &offs) / information;
        Some(Difference { hz, sigma_hz: information.sqrt().recip(), walked_s })
    }
}
