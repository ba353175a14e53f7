//! Counts of a fault campaign: every fault in every phase of a touch.

use std::{
    collections::BTreeMap,
    fmt::{self, Display},
};

use rig_engine::{RigState, RunPhase};
use rigd::rig::Status;
use serde::{Deserialize, Serialize};

use crate::faults::MENU;

/// A phase in which a fault begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Phase {
    /// The rig is brought into service.
    Preparing,
    /// A run is under way.
    Run(RunPhase),
    /// On the way out of contact, after a fault or an abort.
    Recovery,
    /// Latched, until a person acknowledges.
    Latched,
}

/// All phases, in the order of a touch.
pub(crate) const PHASES: [Phase; 14] = [
    Phase::Preparing,
    Phase::Run(RunPhase::Prompt),
    Phase::Run(RunPhase::Rotation),
    Phase::Run(RunPhase::NoLoadSweep),
    Phase::Run(RunPhase::Baseline),
    Phase::Run(RunPhase::Search),
    Phase::Run(RunPhase::Indentation),
    Phase::Run(RunPhase::Dwell),
    Phase::Run(RunPhase::Sweep),
    Phase::Run(RunPhase::SlipCheck),
    Phase::Run(RunPhase::Retract),
    Phase::Run(RunPhase::Confirmation),
    Phase::Recovery,
    Phase::Latched,
];

impl Phase {
    /// The number of phases that every run has.
    pub(crate) const RUN: usize = 12;

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Preparing => "preparing",
            Self::Recovery => "recovery",
            Self::Latched => "latched",
            Self::Run(phase) => match phase {
                RunPhase::Between => "between",
                RunPhase::Prompt => "prompt",
                RunPhase::Rotation => "rotation",
                RunPhase::NoLoadSweep => "no-load sweep",
                RunPhase::Baseline => "baseline",
                RunPhase::Search => "search",
                RunPhase::Indentation => "indentation",
                RunPhase::Dwell => "dwell",
                RunPhase::Sweep => "sweep",
                RunPhase::SlipCheck => "slip check",
                RunPhase::Retract => "retract",
                RunPhase::Confirmation => "confirmation",
            },
        }
    }

    /// The phase of a rig; `None` while it is idle or paused, and between two steps.
    pub(crate) fn of(status: &Status) -> Option<Self> {
        let snapshot = &status.snapshot;
        Some(match snapshot.state {
            RigState::Preparing => Self::Preparing,
            RigState::Retracting => Self::Recovery,
            RigState::Latched => Self::Latched,
            RigState::WaitingForPerson => Self::Run(RunPhase::Prompt),
            RigState::Idle | RigState::Paused => return None,
            RigState::Running => match snapshot.progress.as_ref()?.phase {
                RunPhase::Between => return None,
                phase => Self::Run(phase),
            },
        })
    }

    /// Whether the probe is on its way into the sample or in it.
    pub(crate) const fn is_in_touch(self) -> bool {
        matches!(
            self,
            Self::Run(
                RunPhase::Search
                    | RunPhase::Indentation
                    | RunPhase::Dwell
                    | RunPhase::Sweep
                    | RunPhase::SlipCheck
            )
        )
    }
}

/// How often each fault of the menu began in each phase.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(into = "Named", try_from = "Named")]
pub(crate) struct Table(Vec<[u64; PHASES.len()]>);

/// The rows of a table by the names of their faults.
type Named = BTreeMap<String, [u64; PHASES.len()]>;

/// A table of another menu.
#[derive(Debug, thiserror::Error)]
#[error("no fault of the menu is called \"{name}\"")]
pub(crate) struct NotOnMenu {
    name: String,
}

impl From<Table> for Named {
    fn from(table: Table) -> Self {
        table.rows().map(|(name, counts)| (name.to_owned(), *counts)).collect()
    }
}

impl TryFrom<Named> for Table {
    type Error = NotOnMenu;

    fn try_from(named: Named) -> Result<Self, NotOnMenu> {
        let mut table = Self::default();
        for (name, counts) in named {
            let row = MENU.iter().position(|(known, _)| *known == name);
            table.0[row.ok_or(NotOnMenu { name })?] = counts;
        }
        Ok(table)
    }
}

impl Default for Table {
    fn default() -> Self {
        Self(vec![[0; PHASES.len()]; MENU.len()])
    }
}

impl Table {
    pub(crate) fn add(&mut self, row: usize, phase: Phase) {
        if let Some(column) = PHASES.iter().position(|one| *one == phase) {
            self.0[row][column] += 1;
        }
    }

    /// Adds the counts of another table.
    pub(crate) fn merge(&mut self, other: &Self) {
        for (count, more) in self.0.iter_mut().flatten().zip(other.0.iter().flatten()) {
            *count += more;
        }
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
            for (phase, count) in PHASES.iter().zip(counts) {
                let may_begin = !is_of_prompts || *phase == Phase::Run(RunPhase::Prompt);
                if *count == 0 && may_begin {
                    empty.push(format!("{name} in {}", phase.name()));
                }
            }
        }
        empty
    }
}

/// As a table of a page.
impl Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<&str> = PHASES.iter().map(|phase| phase.name()).collect();
        writeln!(f, "| fault | {} |", names.join(" | "))?;
        writeln!(f, "| --- |{}", " ---: |".repeat(PHASES.len()))?;
        for (name, cells) in self.rows() {
            let is_of_prompts = name.starts_with("person");
            let cell = |count: &u64| match count {
                0 if is_of_prompts => String::new(),
                count => count.to_string(),
            };
            let cells: Vec<String> = cells.iter().map(cell).collect();
            writeln!(f, "| {name} | {} |", cells.join(" | "))?;
        }
        Ok(())
    }
}
