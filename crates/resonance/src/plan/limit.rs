//! The bounds of a planned sweep.
//!
//! Every sweep ends: at its time limit, or where one of these counts is used up. They are far above
//! what a sweep needs that reaches its target, so that a sweep which meets one asks for too much.

/// Most readings of one sweep. Sweeps that reach their target take up to 120 of them.
pub(crate) const READINGS_MAX: usize = 180;
/// How often one sweep is judged: hardly ever 30 times where it reaches its target, and each time costs
/// as much as a few readings.
pub(crate) const VERDICTS_MAX: usize = 36;

/// Time of a row of work, s, about that of a desktop computer. Work counts against the time limit like
/// the clock does: computing is then bounded even if the clock stands still, and the same seed gives
/// the same points.
pub(super) const SECONDS_PER_ROW: f64 = 1e-7;
/// Rows that choosing a point is counted for: a few hundred plans of two or three stays each.
pub(super) const ROWS_PER_PLAN: u64 = 3000;
/// Rows that a verdict is counted for, for each reading: the fit, and all that may speak against it.
pub(super) const ROWS_PER_READING_JUDGED: u64 = 200;
