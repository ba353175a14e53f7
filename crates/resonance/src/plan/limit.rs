//! The bounds of a planned sweep.
//!
//! Every sweep ends: at its time limit, or where one of these counts is used up. They are far above
//! what a sweep needs that reaches its target, so that a sweep which meets one asks for too much.

use super::tracker;
use crate::{fit::grid::Grid, numeric::descent::STEPS_MAX};

/// Most readings of one sweep. Sweeps that reach their target take up to 120 of them; beyond
/// [`READINGS_SHORT`] each lasts so long that a day of measuring does not take twice as many.
pub(crate) const READINGS_MAX: usize = 180;
/// From this many readings on none is shorter than this part of the time so far: what has not been
/// found in as many short looks is found by reading longer, and the work for each grows with their
/// number.
pub(super) const READINGS_SHORT: usize = 64;
pub(super) const SHORTEST_SHARE: f64 = 0.1;
/// How often one sweep is judged: hardly ever 30 times where it reaches its target, and each time costs
/// as much as a few readings.
pub(crate) const VERDICTS_MAX: usize = 36;

/// What a row of work stands for, s: about what a desktop computer takes. Work counts against the time
/// limit as the clock does, so that thinking is bounded where the clock stands still meanwhile, and
/// the same seed gives the same points.
pub(super) const SECONDS_PER_ROW: f64 = 1e-7;
/// Rows that choosing a point is counted for: a few hundred plans of two or three stays each.
pub(super) const ROWS_PER_PLAN: u64 = 3000;
/// Rows that a verdict is counted for, for each reading: the fit, and all that may speak against it.
pub(super) const ROWS_PER_READING_JUDGED: u64 = 200;

/// The most rows between two readings: following them, agreeing on their weights, the grid, the plan,
/// and a verdict. Following is looked at after each descent, which may be the longest there is.
pub(super) const STEP_WORK_MAX: u64 = {
    let readings = READINGS_MAX as u64;
    let descent = 2 * (STEPS_MAX as u64 + 2) * readings;
    2 * (tracker::WORK_MAX + descent)
        + tracker::ROWS_PER_TRIAL * Grid::TRIALS_MAX
        + ROWS_PER_PLAN
        + ROWS_PER_READING_JUDGED * readings
};
