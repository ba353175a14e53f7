//! How fast the descents of a protocol go on a rig. Its analyzer may integrate longer than it is asked to, and then a
//! run goes down more slowly than planned, or searches in steps.

use std::fmt;

use rig_analyzer::integration_s;
use rig_protocol::{Plan, descent_speed};

use crate::loaded_rig::LoadedRig;

/// Frequencies of the no-load window at which the time of a reading is looked at.
const FREQUENCIES: u32 = 16;

/// What becomes of the descents of a plan.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Descents {
    dialect: String,
    cycles: u32,
    /// How long a reading of these cycles integrates at the longest, s.
    integration_s: f64,
    /// The speed of the plan, mm/s.
    pub(crate) planned_mm_per_s: f64,
    /// Longest time of a reading, s.
    pub(crate) reading_s: f64,
    /// The speed of a run, mm/s; `None` if the search in steps is as fast, and takes the place of each descent.
    pub(crate) mm_per_s: Option<f64>,
}

impl Descents {
    /// `None` for a plan that finds its surfaces in steps.
    pub(crate) fn of(plan: &Plan, rig: &LoadedRig) -> Option<Self> {
        let approach = &plan.touch.approach;
        let planned_mm_per_s = approach.descent_mm_per_s?;
        let (window, cycles) = (plan.no_load_sweep.window, approach.cycles);
        let dialect = rig.instruments.analyzer;
        let integration_at = |step: u32| {
            let part = f64::from(step) / f64::from(FREQUENCIES);
            let frequency_hz = window.min_hz + part * (window.max_hz - window.min_hz);
            integration_s(dialect, cycles, frequency_hz)
        };
        let integration_s = (0..=FREQUENCIES).map(integration_at).fold(0.0, f64::max);
        let overhead_s = rig.file.limits.analyzer.stream.overhead_s.unwrap_or_default();
        let reading_s = integration_s + overhead_s;
        let mm_per_s = descent_speed(planned_mm_per_s, approach.coarse_step_mm, reading_s);
        let dialect = dialect.name.clone();
        Some(Self { dialect, cycles, integration_s, planned_mm_per_s, reading_s, mm_per_s })
    }

    /// Whether a run does as planned.
    pub(crate) fn are_as_planned(&self) -> bool {
        self.mm_per_s.is_some_and(|speed| self.planned_mm_per_s <= 1.001 * speed)
    }
}

/// What a person reads of descents that are not as planned.
impl fmt::Display for Descents {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { dialect, cycles, integration_s, planned_mm_per_s, reading_s, mm_per_s } = self;
        write!(
            f,
            "[approach] method = \"descent\": a reading of {cycles} cycles takes up to {:.0} ms on the {dialect}, \
             which integrates up to {:.0} ms of it; ",
            1e3 * reading_s,
            1e3 * integration_s
        )?;
        match mm_per_s {
            Some(speed) => write!(
                f,
                "the descents go down at {speed:.2} mm/s instead of {planned_mm_per_s:.2} mm/s"
            ),
            None => f.write_str(
                "no descent is faster than the search in steps, which takes the place of each of them; write \
                 method = \"stepped\", or a larger coarse_step_mm",
            ),
        }
    }
}
