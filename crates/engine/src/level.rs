//! Whether the resonance is the same at half the level of the drive.
//!
//! ```text
//! survey ─▶ half ─┬─ the same ──────────────────────▶ linear
//!                 └─ apart ─▶ full ─▶ half ─▶ full ─▶ linear, or not
//! ```
//!
//! A resonance that drifts differs between two sweeps as well. Only where both are apart, sweeps at both levels follow in
//! turn: an even drift cancels in them, and what the references so far say of the walk is the limit of the rest.

use rig_model::RigTime;
use rig_resonance::{Bench, Resonance};

use crate::drift::Drift;

/// Sweeps after which the levels are judged.
const ALL: usize = 5;

/// The time, in units of that between two sweeps, in which a walk makes as much as of the difference of the last four.
/// It is the sum of the squares of ¼, ½ and ¼, by which the three steps between them enter.
const WALKED: f64 = 0.375;

/// A check of the level after a survey.
#[derive(Debug, Clone)]
pub(crate) struct LevelCheck {
    /// From the survey.
    pub(crate) bench: Option<Bench>,
    /// Every resonance, with the middle of its sweep: the survey, and then half and full level in turn.
    found: Vec<(RigTime, Resonance)>,
}

/// What follows a sweep of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Levels {
    /// Another sweep is needed.
    Open,
    /// The resonance does not depend on the level.
    Same,
    /// It does.
    Differ,
}

impl LevelCheck {
    /// Begins with the survey.
    pub(crate) fn new(bench: Option<Bench>, survey: &(RigTime, Resonance)) -> Self {
        Self { bench, found: vec![*survey] }
    }

    /// Whether the next sweep is at half the level.
    pub(crate) const fn is_half_next(&self) -> bool {
        self.found.len() % 2 == 1
    }

    /// The resonances so far.
    pub(crate) fn into_found(self) -> Vec<(RigTime, Resonance)> {
        self.found
    }

    /// Takes in the resonance of a sweep. `drift` is what the references before the survey say.
    pub(crate) fn take(&mut self, found: &(RigTime, Resonance), drift: &Drift) -> Levels {
        self.found.push(*found);
        match self.found[..] {
            [(_, survey), (_, half)] if !survey.is_apart_from(&half) => Levels::Same,
            _ if self.found.len() < ALL => Levels::Open,
            _ if self.differ(drift) => Levels::Differ,
            _ => Levels::Same,
        }
    }

    /// Whether the last four sweeps show a difference that no walk makes.
    fn differ(&self, drift: &Drift) -> bool {
        let [.., one, two, three, four] = self.found[..] else { return false };
        let mut drift = drift.clone();
        for (at, full) in self.found.iter().step_by(2) {
            drift.measured(*at, full.resonance_hz, full.sigma_hz);
        }
        let parts = [(0.25, one.1), (-0.75, two.1), (0.75, three.1), (-0.25, four.1)];
        let off_hz = parts.iter().map(|(part, found)| part * found.resonance_hz).sum();
        let variance: f64 = parts.iter().map(|(part, found)| (part * found.sigma_hz).powi(2)).sum();
        let apart_s = four.0.since(one.0).as_secs_f64() / 3.0;
        drift.is_beyond_walk(off_hz, variance.sqrt(), WALKED * apart_s)
    }
}
