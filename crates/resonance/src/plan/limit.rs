//! The bounds of a planned sweep.
//!
//! Every sweep ends at its time limit or at one of these counts. Nearly every sweep that reaches its target needs
//! less than these counts, so that a sweep that exhausts one has too strict a target.

use crate::fit::decay::outliers::READINGS_OF_PLAN_MAX;

/// Largest number of readings of one sweep.
pub(crate) const READINGS_MAX: usize = READINGS_OF_PLAN_MAX;
/// Largest number of judgements of one sweep. Sweeps that reach their target hardly ever need 30, and
/// each judgement costs as much as a few readings.
pub(crate) const VERDICTS_MAX: usize = 36;

/// Time per row of work, s, about that of a desktop computer. Work counts against the time limit like
/// clock time. This bounds computing even if the clock stands still, and makes the points of a given
/// seed reproducible.
pub(super) const SECONDS_PER_ROW: f64 = 1e-7;
/// Rows counted for choosing a point: a few hundred plans of two or three stays each.
pub(super) const ROWS_PER_PLAN: u64 = 3000;
/// Rows counted for a verdict, per reading: the fit and all its alternatives.
pub(super) const ROWS_PER_READING_JUDGED: u64 = 200;
