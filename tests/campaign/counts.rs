//! Counts of a fault campaign: every fault in every phase of a touch.

use rig_engine::{RigState, RunPhase};
use rigd::rig::Status;

use crate::faults::MENU;

/// A phase in which a fault begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Phase {
    /// The rig is brought into service.
    Preparing,
    Prompt,
    Rotation,
    NoLoadSweep,
    Baseline,
    Search,
    Indentation,
    Sweep,
    SlipCheck,
    Retract,
    Confirmation,
    /// On the way out of contact, after a fault or an abort.
    Recovery,
    /// Latched, until a person acknowledges.
    Latched,
}

/// All phases, in the order of a touch.
pub(crate) const PHASES: [Phase; 13] = [
    Phase::Preparing,
    Phase::Prompt,
    Phase::Rotation,
    Phase::NoLoadSweep,
    Phase::Baseline,
    Phase::Search,
    Phase::Indentation,
    Phase::Sweep,
    Phase::SlipCheck,
    Phase::Retract,
    Phase::Confirmation,
    Phase::Recovery,
    Phase::Latched,
];

impl Phase {
    /// The number of phases that every run has.
    pub(crate) const RUN: usize = 11;

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Preparing => "preparing",
            Self::Prompt => "prompt",
            Self::Rotation => "rotation",
            Self::NoLoadSweep => "no-load sweep",
            Self::Baseline => "baseline",
            Self::Search => "search",
            Self::Indentation => "indentation",
            Self::Sweep => "sweep",
            Self::SlipCheck => "slip check",
            Self::Retract => "retract",
            Self::Confirmation => "confirmation",
            Self::Recovery => "recovery",
            Self::Latched => "latched",
        }
    }

    /// The phase of a rig; `None` while it is idle or paused.
    pub(crate) fn of(status: &Status) -> Option<Self> {
        let snapshot = &status.snapshot;
        Some(match snapshot.state {
            RigState::Preparing => Self::Preparing,
            RigState::Retracting => Self::Recovery,
            RigState::Latched => Self::Latched,
            RigState::WaitingForPerson => Self::Prompt,
            RigState::Idle | RigState::Paused => return None,
            RigState::Running => match snapshot.progress.as_ref()?.phase {
                RunPhase::Between => return None,
                RunPhase::Prompt => Self::Prompt,
                RunPhase::Rotation => Self::Rotation,
                RunPhase::NoLoadSweep => Self::NoLoadSweep,
                RunPhase::Baseline => Self::Baseline,
                RunPhase::Search => Self::Search,
                RunPhase::Indentation | RunPhase::Dwell => Self::Indentation,
                RunPhase::Sweep => Self::Sweep,
                RunPhase::SlipCheck => Self::SlipCheck,
                RunPhase::Retract => Self::Retract,
                RunPhase::Confirmation => Self::Confirmation,
            },
        })
    }
}

/// How often each fault of the menu began in each phase.
#[derive(Debug, Clone)]
pub(crate) struct Table(Vec<[u64; PHASES.len()]>);

impl Default for Table {
    fn default() -> Self {
        Self(vec![[0; PHASES.len()]; MENU.len()])
    }
}

impl Table {
    pub(crate) fn add(&mut self, row: usize, phase: Phase) {
        self.0[row][phase as usize] += 1;
    }

    /// All faults.
    pub(crate) fn total(&self) -> u64 {
        self.0.iter().flatten().sum()
    }

    pub(crate) fn rows(&self) -> impl Iterator<Item = (&'static str, &[u64; PHASES.len()])> {
        MENU.iter().map(|(name, _)| *name).zip(&self.0)
    }

    /// Cells without a count, of those that can have one: a prompt is answered late only in a prompt.
    pub(crate) fn empty(&self) -> Vec<String> {
        let mut empty = Vec::new();
        for (name, counts) in self.rows() {
            let is_of_prompts = name.starts_with("person");
            for phase in PHASES.iter().filter(|phase| !is_of_prompts || **phase == Phase::Prompt) {
                if counts[*phase as usize] == 0 {
                    empty.push(format!("{name} in {}", phase.name()));
                }
            }
        }
        empty
    }
}
